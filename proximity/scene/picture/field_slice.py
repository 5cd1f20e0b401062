"""Signed distance on a plane across the scene."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from proximity.errors import QueryError

if TYPE_CHECKING:
    from proximity.scene.scene import Scene

AXES = "xyz"
SHOWN_AXES = {"x": (1, 2), "y": (0, 2), "z": (0, 1)}
"""To the right and up in the map of a plane across this axis."""
MARGIN = 0.18  # of the longer side of the scene's box, around it
CELLS = 480  # along the longer side of the map


@dataclass(frozen=True, slots=True, eq=False)
class FieldSlice:
    """Signed distances on a grid of points; rows go up, columns to the right."""

    axis: str  # of AXES, across the plane
    position: float  # m, where the plane cuts the axis
    right: np.ndarray  # (W,) m
    up: np.ndarray  # (H,) m
    signed_distance: np.ndarray  # (H, W) m

    @classmethod
    def of(
        cls, scene: "Scene", axis: str, position: float, *, unit: str = "m", metres: float = 1.0
    ) -> "FieldSlice":
        """Return the slice of a scene, a margin around its parts included."""
        if axis not in SHOWN_AXES:
            raise QueryError(f"a slice across {axis!r}, expected one of x, y, z")
        lower, upper = scene.bounds
        across = AXES.index(axis)
        extent = float((upper - lower).max())
        if not lower[across] - extent <= position <= upper[across] + extent:
            raise QueryError(
                f"the slice at {axis} = {position / metres:g} {unit} passes far from the parts: expected "
                f"{lower[across] / metres:g} to {upper[across] / metres:g} {unit}"
            )
        shown = list(SHOWN_AXES[axis])
        margin = MARGIN * float((upper - lower)[shown].max())
        sides = upper[shown] - lower[shown] + 2 * margin
        counts = np.maximum(2, np.round(CELLS * sides / sides.max()).astype(int)) + 1
        right, up = (
            np.linspace(lower[row] - margin, upper[row] + margin, count)
            for row, count in zip(shown, counts, strict=True)
        )
        points = np.empty((len(up), len(right), 3))
        points[..., shown[0]], points[..., shown[1]], points[..., across] = right, up[:, None], position
        return cls(axis, position, right, up, np.asarray(scene.signed_distance(points, workers=-1)))

    @property
    def corners(self) -> np.ndarray:
        """The four corners of the map, (4, 3), m, scene's frame."""
        points = np.empty((4, 3))
        points[:, AXES.index(self.axis)] = self.position
        for row, values in zip(
            SHOWN_AXES[self.axis], (self.right[[0, -1, -1, 0]], self.up[[0, 0, -1, -1]]), strict=True
        ):
            points[:, row] = values
        return points

    def at(self, points: np.ndarray) -> np.ndarray:
        """Return signed distances between the grid's points, linearly; nan outside the map.

        *points*: (..., 3) m, scene's frame.
        """
        first, second = SHOWN_AXES[self.axis]
        column, is_right = _cells(points[..., first], self.right)
        row, is_up = _cells(points[..., second], self.up)
        left, low = column.astype(np.intp), row.astype(np.intp)
        x, y = column - left, row - low
        field = self.signed_distance
        value = (1 - y) * ((1 - x) * field[low, left] + x * field[low, left + 1]) + y * (
            (1 - x) * field[low + 1, left] + x * field[low + 1, left + 1]
        )
        return np.where(is_right & is_up, value, np.nan)


def _cells(values: np.ndarray, grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions among the cells of a grid, kept within it, and whether they were."""
    position = (values - grid[0]) / (grid[-1] - grid[0]) * (len(grid) - 1)
    is_within = (position >= 0.0) & (position <= len(grid) - 1)
    return np.clip(np.nan_to_num(position), 0.0, len(grid) - 1 - 1e-9), is_within
