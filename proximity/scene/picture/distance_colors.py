"""Colours of signed distances: red inside, white on the surface, blue outside."""

from typing import Any

import numpy as np

from proximity.errors import QueryError
from proximity.system.extras import needed

MAP = "RdBu"
TICKS = 9
SHARE_OF_RANGE = 0.12  # the smaller side of zero reaches at least as far as this share of the larger


class DistanceColors:
    """A colour map for the signed distances of one picture.

    *signed_distance*: all that will be shown; what is not finite is left out. *metres*: metres in the unit in
    which steps are round numbers.
    """

    def __init__(self, signed_distance: np.ndarray, metres: float) -> None:
        matplotlib = load_matplotlib()
        finite = signed_distance[np.isfinite(signed_distance)] / metres
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
        low, high = min(low, 0.0), max(high, 0.0)
        reach = max(high, -low) or 1.0
        low, high = min(low, -SHARE_OF_RANGE * reach), max(high, SHARE_OF_RANGE * reach)
        steps = matplotlib.ticker.MaxNLocator(TICKS, steps=[1, 2, 5, 10])
        self.levels: np.ndarray = steps.tick_values(
            low, high
        )  # in the unit; the range is that of the outer ones
        self.metres = metres
        self.step: float = float(self.levels[1] - self.levels[0]) / 2 * metres  # m, between iso lines
        norm = matplotlib.colors.TwoSlopeNorm(0.0, self.levels[0], self.levels[-1])
        values = np.linspace(self.levels[0], self.levels[-1], 1024)
        self.table = matplotlib.colormaps[MAP](norm(values))[:, :3]
        self.map = matplotlib.colors.ListedColormap(self.table)
        self.norm = matplotlib.colors.Normalize(self.levels[0], self.levels[-1])

    def __call__(self, signed_distance: np.ndarray) -> np.ndarray:
        """Return colours, the shape of the distances (m) + (3,); nan is grey."""
        share = self.norm(np.asarray(signed_distance) / self.metres)
        rows = np.nan_to_num(np.asarray(share) * len(self.table)).astype(np.intp)
        colors = self.table[np.clip(rows, 0, len(self.table) - 1)]
        return np.where(np.isnan(share)[..., None], 0.5, colors)


def load_matplotlib() -> Any:
    """Return matplotlib with what a page takes."""
    with needed("pictures need", "picture", QueryError):
        import matplotlib
        import matplotlib.figure
        import matplotlib.lines
        import matplotlib.patches
        import matplotlib.patheffects
        import matplotlib.ticker
    return matplotlib
