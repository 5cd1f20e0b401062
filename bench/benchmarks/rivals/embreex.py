"""Embree, through embreex, as a contender."""

import importlib
from typing import Any, ClassVar

import numpy as np

from benchmarks.rivals.interface import Contender, Task, as_float32, inf_from
from benchmarks.rivals.ours import Proximity, ProximityLengths

EMBREE_MISS = 1e37  # minimum length of a miss


class Embreex(Contender):
    """Embree through embreex's own scene, distances alone; float32, Embree's default flags."""

    name = "embreex"
    package = "embreex"
    questions = ("cast",)
    beside = ProximityLengths.name
    arguments: ClassVar[dict[str, Any]] = {"query": "DISTANCE"}

    def __init__(self) -> None:
        super().__init__()
        self.scenes = importlib.import_module("embreex.rtcore_scene")
        self.meshes = importlib.import_module("embreex.mesh_construction")

    def builder(self, vertices, faces):
        positions, triangles = as_float32(vertices), np.ascontiguousarray(faces, dtype=np.int32)
        probe = np.ones((1, 3), dtype=np.float32)

        def build():
            scene = self.scenes.EmbreeScene()
            self.meshes.TriangleMesh(scene, positions, triangles)
            scene.run(probe, probe)  # the first query builds the tree
            return scene

        return build

    def cast(self, origins, directions):
        starts, rays = as_float32(origins), as_float32(directions)
        run, arguments = self.engine.run, self.arguments
        return Task(lambda: run(starts, rays, **arguments), self._read)

    @staticmethod
    def _read(lengths):
        return inf_from(lengths, EMBREE_MISS).astype(np.float64)


class EmbreexAll(Embreex):
    """embreex with all fields of our `cast`: distance, face, barycentric and normal."""

    name = "embreex (all outputs)"
    beside = Proximity.name
    arguments: ClassVar[dict[str, Any]] = {"output": True}

    @staticmethod
    def _read(hits):
        return np.where(hits["primID"] >= 0, hits["tfar"], np.inf).astype(np.float64)
