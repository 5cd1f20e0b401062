"""The arrays of one part, in its local frame and numbered from zero."""

from dataclasses import dataclass, field

import numpy as np

from proximity.kernels import layout
from proximity.kernels.thresholds import MOVING_MARGIN
from proximity.mesh.bvh import Bvh, LocalFrame, local_frame


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


def common_frame(lower: np.ndarray, upper: np.ndarray) -> LocalFrame:
    """Return a frame for parts that go together, with space for them to move.

    *lower*, *upper*: (3,) m.
    """
    frame = local_frame(lower, upper)
    return LocalFrame(frame.centre, frame.scale * MOVING_MARGIN)
