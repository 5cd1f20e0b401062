"""NVIDIA Warp as a contender, on the processor."""

import importlib

import numpy as np

from benchmarks.rivals.interface import Contender, Task, as_float32


class Warp(Contender):
    """Warp with recorded launches into arrays made before; float32. Sign by pseudo-normals."""

    name = "Warp"
    package = "warp-lang"
    sign_kernel = "signed_by_normal"

    def __init__(self) -> None:
        super().__init__()
        self.library = importlib.import_module("warp")
        self.library.config.log_level = self.library.LOG_ERROR  # no greeting, no messages on graphics cards
        self.kernels = importlib.import_module("benchmarks.rivals.warp_kernels")

    def _array(self, rows, dtype=None):
        return self.library.array(rows, dtype=dtype or self.library.vec3, device="cpu")

    def builder(self, vertices, faces):
        positions = self._array(as_float32(vertices))
        triangles = self._array(faces.astype(np.int32).ravel(), self.library.int32)
        with_winding = self.sign_kernel == "signed_by_winding"
        return lambda: self.library.Mesh(positions, triangles, support_winding_number=with_winding)

    def distance(self, points):
        return self._launch("distance", self.library.float32, points)

    def signed_distance(self, points):
        return self._launch(self.sign_kernel, self.library.float32, points)

    def closest(self, points):
        return self._launch("closest", self.library.vec3, points)

    def contains(self, points):
        signed = self.signed_distance(points)
        return Task(signed.run, lambda found: signed.read(found) < 0.0)

    def cast(self, origins, directions):
        return self._launch("cast", self.library.float32, origins, directions)

    def _launch(self, kernel_name, out_type, *rows):
        out = self.library.zeros(len(rows[0]), dtype=out_type, device="cpu")
        command = self.library.launch(
            getattr(self.kernels, kernel_name),
            dim=len(rows[0]),
            inputs=[self.engine.id, *(self._array(as_float32(each)) for each in rows)],
            outputs=[out],
            device="cpu",
            record_cmd=True,
        )
        return Task(command.launch, lambda _: out.numpy().astype(np.float64))


class WarpVotes(Warp):
    """Warp, sign by the vote of three rays (its default query)."""

    name = "Warp (votes)"
    questions = ("signed_distance",)
    sign_kernel = "signed_by_votes"


class WarpParity(Warp):
    """Warp, sign by the parity of crossings."""

    name = "Warp (parity)"
    questions = ("signed_distance",)
    sign_kernel = "signed_by_parity"


class WarpWinding(Warp):
    """Warp, sign by its fast winding number."""

    name = "Warp (winding)"
    questions = ("signed_distance",)
    sign_kernel = "signed_by_winding"
    query_limit = 2000
