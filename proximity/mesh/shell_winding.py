"""Winding numbers of one shell, by a tree of its own."""

import numpy as np

from proximity.kernels.sign.winding_number import winding_numbers
from proximity.mesh.bvh import build_bvh, local_frame
from proximity.mesh.part_arrays import moments_of
from proximity.mesh.part_memory import joined


class ShellWinding:
    """The winding number of one shell: whole for a closed one, to a few hundredths.

    *triangles*: (K, 3, 3).
    """

    def __init__(self, triangles: np.ndarray) -> None:
        corners = triangles.reshape(-1, 3)
        self._frame = local_frame(corners.min(axis=0), corners.max(axis=0))
        faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
        bvh = build_bvh(np.ascontiguousarray(self._frame.of(corners)), faces)
        self._words, (_, self._moments) = joined([[bvh.nodes], [moments_of(bvh)]], np.float32)
        self._blocks = bvh.blocks

    def turns(self, points: np.ndarray) -> np.ndarray:
        """Return how often the shell winds around *points* (..., 3)."""
        local = np.ascontiguousarray(self._frame.of(points)).reshape(-1, 3)
        turns = np.empty(len(local))
        winding_numbers(self._blocks, self._words, 0, self._moments, local, turns)
        return turns.reshape(points.shape[:-1])
