"""The arrays of one part, in its local frame and numbered from zero."""

from dataclasses import dataclass, field

import numpy as np

from proximity.kernels import entries, layout
from proximity.kernels.layout import MOMENT_STRIDE
from proximity.kernels.thresholds import MOVING_MARGIN
from proximity.mesh.bvh import Bvh, LocalFrame, local_frame
from proximity.mesh.part_memory import PartMemory


@dataclass(frozen=True, slots=True, eq=False)
class PartArrays:
    """One part in its local frame, numbered from zero."""

    frame: LocalFrame
    bvh: Bvh
    moments: np.ndarray  # (M * MOMENT_STRIDE,) float32
    boxes: np.ndarray  # (B * ORIENTED_STRIDE,) float32, of blocks
    is_oblique: bool
    faces: np.ndarray  # (F, 3) int32, rows of corners
    neighbors: np.ndarray  # (F, 3) int32
    corners: np.ndarray  # (K, 3) float64, local
    normals: np.ndarray  # (K, 3) float64, unit
    lower: np.ndarray  # (3,) m, box
    upper: np.ndarray  # (3,) m
    sign: int = layout.SIGN_NONE
    grid: np.ndarray = field(default_factory=lambda: np.zeros(0, np.uint32))  # uint32, packed states
    grid_counts: tuple[int, int, int] = (0, 0, 0)
    grid_lower: tuple[float, float, float] = (0.0, 0.0, 0.0)
    grid_rate: float = 0.0
    folded: np.ndarray = field(default_factory=lambda: np.zeros(0, np.uint8))  # (blocks,) uint8
    memory: PartMemory | None = None  # where the arrays are, if they are where a model has them


def moments_of(bvh: Bvh) -> np.ndarray:
    """Return what the winding number needs of a tree, (M * MOMENT_STRIDE,) float32."""
    moments = np.empty(bvh.node_count * MOMENT_STRIDE, np.float32)
    entries.fill_moments(bvh.nodes, bvh.blocks, bvh.node_count, moments)
    return moments


def common_frame(lower: np.ndarray, upper: np.ndarray) -> LocalFrame:
    """Return a frame for parts that go together, with space for them to move.

    *lower*, *upper*: (3,) m.
    """
    frame = local_frame(lower, upper)
    return LocalFrame(frame.centre, frame.scale * MOVING_MARGIN)


def grid_size(extent: np.ndarray, wanted: int) -> tuple[float, tuple[int, int, int]]:
    """Return cells a unit of length, and how many along each axis, of a grid over a box.

    *extent*: (3,).
    """
    rate, nx, ny, nz = entries.grid_size(extent, wanted)
    return rate, (nx, ny, nz)
