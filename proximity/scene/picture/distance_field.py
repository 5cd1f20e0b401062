"""Signed distance on a plane across a scene, and its colours.

The colours are red inside, white at the surface and blue outside.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from proximity.errors import ArgumentError
from proximity.system.extras import needed

if TYPE_CHECKING:
    from proximity.scene.scene import Scene

AXES = "xyz"
SHOWN_AXES = {"x": (1, 2), "y": (0, 2), "z": (0, 1)}
"""Horizontal and vertical axis of the map of a plane, by the axis that is perpendicular to it."""
MARGIN = 0.18  # around the scene's box, as a share of its longer side
CELLS = 480  # along the longer side of the map
MAP = "RdBu"
TICKS = 9
SHARE_OF_RANGE = 0.12  # the smaller side of zero reaches at least to this share of the larger


@dataclass(frozen=True, slots=True, eq=False)
class FieldSlice:
    """Signed distances on a grid of points. Rows are ordered upwards, columns to the right."""

    axis: str  # of AXES, across the plane
    position: float  # m, where the plane cuts the axis
    right: np.ndarray  # (W,) m
    up: np.ndarray  # (H,) m
    points: np.ndarray  # (H, W, 3) m, scene's frame
    signed_distance: np.ndarray  # (H, W) m

    @classmethod
    def of(
        cls, scene: "Scene", axis: str, position: float, *, unit: str = "m", metres: float = 1.0
    ) -> "FieldSlice":
        """Return a slice of a scene that includes a margin around its parts."""
        if axis not in SHOWN_AXES:
            raise ArgumentError(f"a slice across {axis!r}, expected one of x, y, z")
        lower, upper = scene.bounds
        across = AXES.index(axis)
        extent = float((upper - lower).max())
        if not lower[across] - extent <= position <= upper[across] + extent:
            raise ArgumentError(
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
        return cls(axis, position, right, up, points, np.asarray(scene.signed_distance(points, workers=-1)))


def load_matplotlib() -> Any:
    """Import and return matplotlib with the modules that a page uses."""
    with needed("pictures need", "picture"):
        import matplotlib
        import matplotlib.figure
        import matplotlib.lines
        import matplotlib.patches
        import matplotlib.patheffects
        import matplotlib.ticker
    return matplotlib


class DistanceColors:
    """A colour map for the signed distances of one picture.

    *signed_distance*: all distances that will be shown; values that are not finite are ignored. *metres*:
    length of the unit in which the steps are round numbers. *is_even*: whether the bar is equally long on
    both sides of zero. *reach*: the two ends of the bar, m, if they are fixed.
    """

    def __init__(
        self,
        signed_distance: np.ndarray,
        metres: float,
        *,
        is_even: bool = False,
        reach: tuple[float, float] | None = None,
    ) -> None:
        matplotlib = load_matplotlib()
        finite = signed_distance[np.isfinite(signed_distance)] / metres
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
        largest = max(high, -low) or 1.0
        least = largest if is_even else SHARE_OF_RANGE * largest
        low, high = min(low, -least), max(high, least)
        steps = matplotlib.ticker.MaxNLocator(TICKS, steps=[1, 2, 5, 10])
        self.levels: np.ndarray = steps.tick_values(
            low, high
        )  # in the unit; the range is that of the outer ones
        if reach is not None:
            self.levels = np.array([reach[0], reach[0] / 2, 0.0, reach[1] / 2, reach[1]]) / metres
        self.metres = metres
        self.step: float = float(self.levels[1] - self.levels[0]) / 2 * metres  # m, between iso lines
        norm = matplotlib.colors.TwoSlopeNorm(0.0, self.levels[0], self.levels[-1])
        values = np.linspace(self.levels[0], self.levels[-1], 1024)
        self.table = matplotlib.colormaps[MAP](norm(values))[:, :3]
        self.map = matplotlib.colors.ListedColormap(self.table)
        self.norm = matplotlib.colors.Normalize(self.levels[0], self.levels[-1])

    def share(self, signed_distance: np.ndarray) -> float:
        """Return the share of distances, m, that are between the ends of the bar."""
        ends = self.levels[[0, -1]] * self.metres
        return float(np.mean((signed_distance >= ends[0]) & (signed_distance <= ends[1])))

    def __call__(self, signed_distance: np.ndarray) -> np.ndarray:
        """Return the colours of distances, m, in an array with one more axis of length 3.

        The colour of nan is grey.
        """
        share = self.norm(np.asarray(signed_distance) / self.metres)
        rows = np.nan_to_num(np.asarray(share) * len(self.table)).astype(np.intp)
        colors = self.table[np.clip(rows, 0, len(self.table) - 1)]
        return np.where(np.isnan(share)[..., None], 0.5, colors)
