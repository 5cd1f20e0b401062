"""Open3D as a contender."""

import importlib

import numpy as np

from benchmarks.rivals.interface import Contender, Task, as_float32


class Open3D(Contender):
    """Open3D's RaycastingScene (Embree inside); float32. Sign from the parity of one ray."""

    name = "Open3D"
    package = "open3d-cpu"

    def __init__(self) -> None:
        super().__init__()
        self.library = importlib.import_module("open3d")

    def _tensor(self, array):
        return self.library.core.Tensor(np.ascontiguousarray(array))

    def builder(self, vertices, faces):
        positions, triangles = self._tensor(as_float32(vertices)), self._tensor(faces.astype(np.uint32))
        probe = self._tensor(np.zeros((1, 3), dtype=np.float32))

        def build():
            scene = self.library.t.geometry.RaycastingScene(nthreads=1)
            scene.add_triangles(positions, triangles)
            scene.compute_distance(probe, nthreads=1)  # the first query builds the tree
            return scene

        return build

    def distance(self, points):
        queries, scene = self._tensor(as_float32(points)), self.engine
        return Task(lambda: scene.compute_distance(queries, nthreads=1), _from_tensor)

    def signed_distance(self, points):
        queries, scene = self._tensor(as_float32(points)), self.engine
        return Task(lambda: scene.compute_signed_distance(queries, nthreads=1), _from_tensor)

    def closest(self, points):
        queries, scene = self._tensor(as_float32(points)), self.engine
        find = scene.compute_closest_points
        return Task(lambda: find(queries, nthreads=1), lambda found: _from_tensor(found["points"]))

    def contains(self, points):
        queries, scene = self._tensor(as_float32(points)), self.engine
        return Task(
            lambda: scene.compute_occupancy(queries, nthreads=1), lambda found: _from_tensor(found) > 0.5
        )

    def cast(self, origins, directions):
        rays, scene = self._tensor(as_float32(np.hstack([origins, directions]))), self.engine
        return Task(lambda: scene.cast_rays(rays, nthreads=1), lambda hits: _from_tensor(hits["t_hit"]))


def _from_tensor(tensor):
    return tensor.numpy().astype(np.float64)
