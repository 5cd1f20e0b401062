"""FCPW as a contender."""

import importlib

import numpy as np

from benchmarks.rivals.interface import Contender, Task, as_float32, inf_from

SMALL_BATCH = 16  # up to here single calls in a loop are faster than one array call, which starts threads
FLOAT32_MAX = np.finfo(np.float32).max
# Names in the wheel (1.2.0), built without vector instructions, and in the source (1.2.1).
NEWER_NAMES = {
    "scene_3D": "Scene3D",
    "interaction_3D": "Interaction3D",
    "interaction_3D_list": "Interaction3DList",
    "ray_3D": "Ray3D",
    "float_3D_list": "Float3List",
    "uint32_list": "Uint32List",
    "aggregate_type": "AggregateType",
}


class Fcpw(Contender):
    """FCPW on the processor; float32. Sign from its normals of faces, edges and corners.

    Reading the distances out of its list of records, one Python object a query, is not timed; the sign is,
    because only the record's own method computes it. Its lists of spheres and rays are not used: a query
    shrinks them in place, so that a second run starts from the answer of the first (and loses hits).
    Its ray test has an absolute tolerance: on the plate, 0.3 m wide, 5 % of rays pass through small faces;
    with the same plate in millimetres 0.04 % do (version 1.2).
    """

    name = "FCPW"
    package = "fcpw"

    def __init__(self) -> None:
        super().__init__()
        self.library = importlib.import_module("fcpw")
        for older, newer in NEWER_NAMES.items():
            if not hasattr(self.library, older):
                setattr(self.library, older, getattr(self.library, newer))

    def builder(self, vertices, faces):
        positions = np.asfortranarray(vertices, dtype=np.float32)
        triangles = np.asfortranarray(faces, dtype=np.int32)

        def build():
            scene = self.library.scene_3D()
            scene.set_object_count(1)
            scene.set_object_vertices(positions, 0)
            scene.set_object_triangles(triangles, 0)
            kinds = self.library.aggregate_type
            by_area = getattr(kinds, "bvh_surface_area", None) or kinds.Bvh_SurfaceArea
            scene.build(by_area, True)
            return scene

        return build

    def distance(self, points):
        return Task(self._finder(points, False), lambda records: np.array([record.d for record in records]))

    def closest(self, points):
        return Task(self._finder(points, True), lambda records: np.array([record.p for record in records]))

    def signed_distance(self, points):
        find = self._finder(points, True)
        rows = list(as_float32(points))
        signed = self.library.interaction_3D.signed_distance
        return Task(lambda: list(map(signed, find(), rows)), np.array)

    def contains(self, points):
        return Task(self._inside(points), lambda found: np.array(list(found), dtype=bool))

    def _inside(self, points):
        """Return a call that tests points: in a loop for small batches, in one call for others."""
        scene, rows = self.engine, list(as_float32(points))
        if len(rows) <= SMALL_BATCH:
            return lambda: [scene.contains(row) for row in rows]
        # The array form of contains() writes its answers into a copy (1.2); the list form works.
        queries, inside = self.library.float_3D_list(rows), self.library.uint32_list()

        def ask_many():
            scene.contains(queries, inside)
            return inside

        return ask_many

    def _finder(self, points, record_normal):
        """Return a call for a record of each point: in a loop for small batches, else in one call."""
        scene = self.engine
        if len(points) > SMALL_BATCH:
            queries = np.asfortranarray(points, dtype=np.float32)
            radii_sq = np.full(len(points), FLOAT32_MAX)
            many = self.library.interaction_3D_list()

            def find_many():
                scene.find_closest_points(queries, radii_sq, many, record_normal)
                return many

            return find_many

        rows = list(as_float32(points))
        records = [self.library.interaction_3D() for _ in rows]

        def find_few():
            for row, record in zip(rows, records, strict=True):
                scene.find_closest_point(row, record, FLOAT32_MAX, record_normal)
            return records

        return find_few

    def cast(self, origins, directions):
        scene, library = self.engine, self.library
        if len(origins) > SMALL_BATCH:
            starts = np.asfortranarray(origins, dtype=np.float32)
            rays = np.asfortranarray(directions, dtype=np.float32)
            bounds = np.full(len(origins), FLOAT32_MAX)
            many = library.interaction_3D_list()

            def cast_many():
                scene.intersect(starts, rays, bounds, many)
                return many

            return Task(cast_many, lambda hits: inf_from(np.array([hit.d for hit in hits]), FLOAT32_MAX))

        rows = list(zip(as_float32(origins), as_float32(directions), strict=True))
        hit = library.interaction_3D()

        def cast_few():
            return [hit.d if scene.intersect(library.ray_3D(*row), hit) else np.inf for row in rows]

        return Task(cast_few, np.array)


class FcpwContains(Fcpw):
    """FCPW, sign from its own inside test."""

    name = "FCPW (contains)"
    questions = ("signed_distance",)

    def signed_distance(self, points):
        find, ask = self._finder(points, False), self._inside(points)

        def read(found):
            records, is_inside = (list(each) for each in found)
            return np.array([record.d for record in records]) * np.where(is_inside, -1.0, 1.0)

        return Task(lambda: (find(), ask()), read)
