"""Decomposition of scene-graph matrices into rigid poses and a remainder applied to the vertices."""

from dataclasses import dataclass

import numpy as np

from proximity.errors import MeshFormatError
from proximity.pose import Pose

RIGID_TOLERANCE = 4 * float(np.finfo(np.float32).eps)
"""Maximum difference of stretches from one another, or from 1, that count as equal: scene graphs are written
in single precision. A rotation within it is replaced by the nearest exact one."""


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A matrix as *turn and shift* after *deform*."""

    rotation: np.ndarray  # (3, 3), exact
    translation: np.ndarray  # (3,), in the units of the file
    scale: float  # uniform, negative where it mirrors; 1.0 where `stretch` is given
    stretch: np.ndarray | None  # (3, 3), where the scale is not uniform

    @property
    def is_mirrored(self) -> bool:
        """Return whether faces must be reversed to keep facing outward."""
        return self.scale < 0.0 or (self.stretch is not None and bool(np.linalg.det(self.stretch) < 0.0))

    def part_vertices(self, vertices: np.ndarray, metres_per_number: float) -> np.ndarray:
        """Return vertices deformed and in metres; the same array where nothing changes.

        *vertices*: (V, 3) units of the file.
        """
        factor = self.scale * metres_per_number
        with np.errstate(over="ignore", invalid="ignore"):  # infinities are found and named later
            deformed = vertices if self.stretch is None else vertices @ self.stretch.T
            return deformed if factor == 1.0 else deformed * factor

    def pose(self, metres_per_number: float) -> Pose:
        """Return world_from_part, in metres."""
        return Pose(self.rotation, self.translation * metres_per_number)


def place(matrix: np.ndarray | None) -> Placement:
    """Split a matrix into a rigid motion after a deformation.

    *matrix*: (4, 4) or None; world from mesh, acting on columns; None is the identity.
    """
    if matrix is None:
        return Placement(np.eye(3), np.zeros(3), 1.0, None)
    if not np.isfinite(matrix).all():
        raise MeshFormatError("it is placed by a matrix that is not finite")
    if np.abs(matrix[3] - (0.0, 0.0, 0.0, 1.0)).max() > RIGID_TOLERANCE:
        raise MeshFormatError(f"the last row of its matrix is {matrix[3].tolist()}, expected [0, 0, 0, 1]")
    linear, translation = matrix[:3, :3], matrix[:3, 3].copy()
    left, stretches, right = np.linalg.svd(linear)
    if stretches[2] <= RIGID_TOLERANCE * stretches[0]:
        raise MeshFormatError("it is placed by a matrix that flattens it, expected an invertible one")
    sign = 1.0 if np.linalg.det(left) * np.linalg.det(right) > 0.0 else -1.0
    rotation = sign * (left @ right)
    if stretches[0] - stretches[2] > RIGID_TOLERANCE * stretches[0]:
        return Placement(rotation, translation, 1.0, sign * (right.T * stretches) @ right)
    scale = float(stretches[1])  # exact where the matrix is diagonal
    return Placement(
        rotation, translation, sign * (1.0 if abs(scale - 1.0) <= RIGID_TOLERANCE else scale), None
    )
