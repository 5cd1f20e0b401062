"""libigl as a contender."""

import importlib
from typing import Any

import numpy as np

from benchmarks.rivals.interface import Contender, Task, as_is


class Libigl(Contender):
    """libigl: its tree, and its fast winding number for the sign; float64."""

    name = "libigl"
    package = "libigl"
    questions = ("distance", "signed_distance", "closest", "contains")
    query_limit = 2000

    def __init__(self) -> None:
        super().__init__()
        self.library = importlib.import_module("igl")
        self.mesh: tuple[np.ndarray, ...] = ()
        self.winding: Any = None

    def builder(self, vertices, faces):
        self.mesh = (np.ascontiguousarray(vertices), np.ascontiguousarray(faces, dtype=np.int64))
        self.winding = None

        def build():
            tree = self.library.AABB()
            tree.init(*self.mesh)
            return tree

        return build

    def distance(self, points):
        return Task(lambda: self.engine.squared_distance(*self.mesh, points), lambda found: np.sqrt(found[0]))

    def closest(self, points):
        return Task(lambda: self.engine.squared_distance(*self.mesh, points), lambda found: found[2])

    def contains(self, points):
        self._make_winding()
        return Task(lambda: self.winding.winding_number(points, 2.0) > 0.5, as_is)

    def signed_distance(self, points):
        self._make_winding()

        def run():
            distance_sq = self.engine.squared_distance(*self.mesh, points)[0]
            return np.where(self.winding.winding_number(points, 2.0) > 0.5, -1.0, 1.0) * np.sqrt(distance_sq)

        return Task(run, as_is)

    def _make_winding(self):
        if self.winding is None:
            self.winding = self.library.FastWindingNumberBVH()
            self.winding.init(*self.mesh, 2)


class LibiglNormals(Libigl):
    """libigl's signed_distance by pseudo-normals, which rebuilds its tree in every call."""

    name = "libigl (normals)"
    questions = ("signed_distance",)

    def signed_distance(self, points):
        method = self.library.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
        return Task(lambda: self.library.signed_distance(points, *self.mesh, method), lambda found: found[0])
