"""The arrays of one part of a model, renumbered from zero."""

from typing import NamedTuple

import numpy as np

from proximity.kernels.layout import FOLDED_AT, MOMENT_STRIDE, NO_GRID, ORIENTED_STRIDE
from proximity.mesh.bvh import Bvh, LocalFrame


class PartArrays(NamedTuple):
    """One part in its local frame."""

    frame: LocalFrame
    bvh: Bvh
    moments: np.ndarray  # (M * MOMENT_STRIDE,) float32
    boxes: np.ndarray  # (B * ORIENTED_STRIDE,) float32, of blocks
    faces: np.ndarray  # (F, 3) int32, rows of corners
    neighbors: np.ndarray  # (F, 3) int32
    corners: np.ndarray  # (K, 3) float64, local
    normals: np.ndarray  # (K, 3) float64, unit
    lower: np.ndarray  # (3,) m, box
    upper: np.ndarray  # (3,) m
    grid: np.ndarray  # uint32, packed states
    grid_counts: tuple[int, int, int]
    grid_lower: tuple[float, float, float]
    grid_rate: float
    folded: np.ndarray  # (B,) uint8


def part_arrays(model, row):
    """Copy a part's arrays."""
    part, frame, bvh = model.parts[row], model.frames[row], model.bvh(row)
    counts = int(part["grid_x"]), int(part["grid_y"]), int(part["grid_z"])
    grid_words = -(-int(np.prod(counts)) // 16) if part["grid"] != NO_GRID else 0

    def words(at, count, dtype=np.float32):
        return model.words[at : at + count].view(dtype).copy()

    def rows(name, dtype):
        count = 3 * part["corner_count" if dtype == np.float64 else "face_count"]
        array = model.reals if dtype == np.float64 else model.words
        return array[part[name] : part[name] + count].view(dtype).reshape(-1, 3).copy()

    notes = words(part["block_notes"] + part["first_block"], bvh.block_count, np.int32)
    return PartArrays(
        frame=LocalFrame.read(frame),
        bvh=bvh,
        moments=words(part["moments"] + MOMENT_STRIDE * part["root"], MOMENT_STRIDE * bvh.node_count),
        boxes=words(
            part["block_boxes"] + ORIENTED_STRIDE * part["first_block"], ORIENTED_STRIDE * bvh.block_count
        ),
        faces=rows("faces", np.int32),
        neighbors=rows("neighbors", np.int32),
        corners=rows("corners", np.float64),
        normals=rows("corner_normals", np.float64),
        lower=frame["own_lower"].copy(),
        upper=frame["own_upper"].copy(),
        grid=words(max(part["grid"], 0), grid_words, np.uint32),
        grid_counts=counts,
        grid_lower=tuple(frame["grid_lower"]),
        grid_rate=float(frame["grid_rate"]),
        folded=(notes >> FOLDED_AT).astype(np.uint8),
    )
