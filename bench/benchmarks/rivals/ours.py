"""This package as a contender: scenes made of arrays, in float64."""

import importlib

import numpy as np

from benchmarks.rivals.interface import Contender, Task, as_is


class Proximity(Contender):
    """This package; a scene made of arrays, in float64."""

    name = "proximity"
    package = "proximity"

    def __init__(self) -> None:
        super().__init__()
        self.library = importlib.import_module("proximity")
        self.library.warm_up()

    @property
    def version(self) -> str:
        return self.library.__version__

    @property
    def memory_bytes(self) -> int | None:
        return self.engine.memory_bytes

    def builder(self, vertices, faces):
        return lambda: self.library.Scene.from_mesh(vertices, faces)

    def distance(self, points):
        ask = self.engine.distance
        return Task(lambda: ask(points), as_is)

    def signed_distance(self, points):
        ask = self.engine.signed_distance
        return Task(lambda: ask(points), as_is)

    def closest(self, points):
        ask = self.engine.closest
        return Task(lambda: ask(points), lambda hits: hits.point)

    def contains(self, points):
        ask = self.engine.contains
        return Task(lambda: ask(points), as_is)

    def cast(self, origins, directions):
        ask = self.engine.cast
        return Task(lambda: ask(origins, directions), lambda hits: hits.distance)


class ProximityLengths(Proximity):
    """Our rays, distances alone."""

    name = "proximity (distances)"
    questions = ("cast",)
    beside = name

    def cast(self, origins, directions):
        ask = self.engine.cast_distance
        return Task(lambda: ask(origins, directions), as_is)


class ProximityTree(Proximity):
    """Our tree alone, as the others build it: without welding, bodies, checks and sign."""

    name = "proximity (tree alone)"
    questions = ()
    memory_bytes = None

    def builder(self, vertices, faces):
        bvh = importlib.import_module("proximity.mesh.bvh")
        corners = bvh.local_frame(vertices.min(axis=0), vertices.max(axis=0)).of(vertices)
        rows = np.ascontiguousarray(faces, dtype=np.int32)
        return lambda: bvh.build_bvh(corners, rows)
