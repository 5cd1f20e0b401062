"""Straight lines fitted to the logarithms of both: the growth of a cost at its upper end."""

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.stats import linregress

from benchmarks.growth.samples import GrowthRow

UPPER_DECADES = 2.0
FEWEST = 3  # minimum number of points for a meaningful error


@dataclass(frozen=True, slots=True)
class Fit:
    """y = factor · x^slope over the upper decades of a curve's medians."""

    axis: str
    series: str
    quantity: str
    slope: float
    error: float  # standard error of the slope
    factor: float
    first: float  # the fitted points
    last: float
    count: int

    @property
    def words(self) -> str:
        """Return slope and error as text; never a negative zero."""
        return f"{round(self.slope, 2) + 0.0:.2f} ± {self.error:.2f}"


def fit_rows(rows: list[GrowthRow]) -> list[Fit]:
    """Return the fit of each curve that has enough points."""

    def curve(row: GrowthRow) -> tuple[str, str, str]:
        return row.axis, row.series, row.quantity

    curves = itertools.groupby(sorted(rows, key=curve), key=curve)
    fits = (_fit(*key, list(own)) for key, own in curves)
    return [fit for fit in fits if fit is not None]


def _fit(axis, series, quantity, rows):
    x, y = np.array([[row.x, row.median] for row in rows]).T
    # A little more than the decades: sizes are rounded to whole quads.
    is_upper = (x >= 0.9 * x.max() / 10.0**UPPER_DECADES) & (y > 0.0)
    if is_upper.sum() < FEWEST:
        return None
    x, y = x[is_upper], y[is_upper]
    found = linregress(np.log10(x), np.log10(y))
    factor = 10.0 ** float(found.intercept)
    # Without any residual the quotient of two zeros is nan.
    slope, error = float(found.slope), float(np.nan_to_num(found.stderr))
    return Fit(axis, series, quantity, slope, error, factor, float(x.min()), float(x.max()), len(x))
