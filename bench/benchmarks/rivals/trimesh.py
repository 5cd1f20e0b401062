"""trimesh as a contender."""

import importlib

from benchmarks.rivals.interface import Contender, Task, as_is


class Trimesh(Contender):
    """trimesh with rtree; float64."""

    name = "trimesh"
    package = "trimesh"
    questions = ("distance", "signed_distance", "closest", "contains")
    query_limit = 200

    def __init__(self) -> None:
        super().__init__()
        self.library = importlib.import_module("trimesh")
        importlib.import_module("rtree")

    def builder(self, vertices, faces):
        def build():
            mesh = self.library.Trimesh(vertices, faces, process=False)
            _ = mesh.triangles_tree
            return mesh

        return build

    def distance(self, points):
        return self._find(points, 1)

    def closest(self, points):
        return self._find(points, 0)

    def _find(self, points, column):
        closest_point = self.library.proximity.closest_point
        return Task(lambda: closest_point(self.engine, points), lambda found: found[column])

    def contains(self, points):
        return Task(lambda: self.engine.contains(points), as_is)

    def signed_distance(self, points):
        inside_positive = self.library.proximity.signed_distance
        return Task(lambda: inside_positive(self.engine, points), lambda found: -found)
