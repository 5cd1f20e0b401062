"""Control points of B-splines and of their derivatives."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

MAX_SPANS = 20_000
"""Maximum number of pieces of a surface."""
_SMOOTH = 1e-11
"""Maximum jump of the first derivative, as a share of it, that is rounding."""


@dataclass(slots=True, eq=False)
class Net:
    """Control points of a spline or of one of its derivatives."""

    degrees: tuple[int, int]
    knots: tuple[np.ndarray, np.ndarray]
    control: np.ndarray  # (m, n, 4)

    def derived(self, axis: int) -> "Net":
        """Return the derivative along one parameter; that of a constant is zero."""
        degree, knots = self.degrees[axis], self.knots[axis]
        if degree == 0:
            return Net(self.degrees, self.knots, np.zeros_like(self.control))
        spans = knots[degree + 1 : -1] - knots[1 : -degree - 1]
        factors = np.divide(degree, spans, out=np.zeros_like(spans), where=spans > 0.0)
        control = np.diff(self.control, axis=axis) * (
            factors[:, None, None] if axis == 0 else factors[:, None]
        )
        pairs = list(self.degrees), list(self.knots)
        pairs[0][axis], pairs[1][axis] = degree - 1, knots[1:-1]
        return Net((pairs[0][0], pairs[0][1]), (pairs[1][0], pairs[1][1]), control)

    @property
    def is_bounded(self) -> bool:
        """Whether the spline is continuous, and the number of pieces is within its limit."""
        pieces = 1
        for knots, degree in zip(self.knots, self.degrees, strict=True):
            values, counts = np.unique(knots[degree + 1 : -degree - 1], return_counts=True)
            if len(counts) and counts.max() > max(degree, 1):
                return False
            pieces *= len(values) + 1
        return pieces <= MAX_SPANS

    def kinks(self, axis: int) -> list[tuple[float, float]]:
        """Return parameters at which the first derivative jumps, with bounds of the jump."""
        degree, knots = self.degrees[axis], self.knots[axis]
        control, slopes = (np.moveaxis(net.control, axis, 0) for net in (self, self.derived(axis)))
        values, counts = np.unique(knots[degree + 1 : -degree - 1], return_counts=True)
        found = []
        for value in values[counts >= max(degree, 1)].tolist():
            row = int(np.searchsorted(knots, value)) - 1  # of the control points at the kink
            points, weights = control[row, :, :3] / control[row, :, 3:], control[row, :, 3]
            # A jump proportional to the control points, in the direction of the weights, moves nothing.
            jump = slopes[row] - slopes[row - 1]
            jump = jump - (jump[:, 3] / weights).mean() * control[row]
            middle = points.mean(axis=0)
            reach = np.linalg.norm(points - middle, axis=1).max()
            length = np.linalg.norm(jump[:, :3] - jump[:, 3:] * middle, axis=1).max()
            length = (length + np.abs(jump[:, 3]).max() * reach) / weights.min()
            least = float(np.abs(slopes[row]).max() + np.abs(slopes[row - 1]).max()) * _SMOOTH
            if length > least / weights.min():
                found.append((value, float(length)))
        return found

    def profile(self, axis: int) -> "Net":
        """Return the curve that a parameter moves, or the same net if it does more than move a curve."""
        if not self._is_extruded(axis):
            return self
        degrees, knots = list(self.degrees), list(self.knots)
        degrees[axis], knots[axis] = 0, knots[axis][1:-1]
        control = self.control[:1] if axis == 0 else self.control[:, :1]
        return Net((degrees[0], degrees[1]), (knots[0], knots[1]), control)

    def _is_extruded(self, axis: int) -> bool:
        """Whether a parameter moves all points by the same vector: its second derivatives are zero."""
        if self.degrees[axis] != 1 or self.control.shape[axis] != 2:
            return False
        first, second = np.moveaxis(self.control, axis, 0)
        moves = second[:, :3] / second[:, 3:] - first[:, :3] / first[:, 3:]
        error = 8 * np.finfo(float).eps * float(np.abs(moves).max())
        is_same = np.abs(second[:, 3] - first[:, 3]).max() <= 4 * np.finfo(float).eps * first[:, 3].max()
        return bool(is_same and np.ptp(moves, axis=0).max() <= error)

    def split(self, count: int) -> "Net":
        """Insert knots until each parameter has at least *count* pieces."""
        knots, control = list(self.knots), self.control
        for axis, degree in enumerate(self.degrees):
            if degree < 2:
                continue  # its second derivatives are zero
            breaks = np.unique(knots[axis][degree : len(knots[axis]) - degree])
            parts = -(-count // (len(breaks) - 1))
            inner = [np.linspace(a, b, parts + 1)[1:-1] for a, b in pairwise(breaks)]
            control = np.moveaxis(control, axis, 0)
            for value in np.concatenate(inner):
                knots[axis], control = _with_knot(knots[axis], control, degree, value)
            control = np.moveaxis(control, 0, axis)
        return Net(self.degrees, (knots[0], knots[1]), control)

    def windows(self, spans: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Return the control points of each piece, (S, T, degree + 1, degree + 1, 4)."""
        rows = [
            np.searchsorted(knots, starts, side="right")[:, None] - 1 - np.arange(degree, -1, -1)
            for degree, knots, starts in zip(self.degrees, self.knots, spans, strict=True)
        ]
        return self.control[rows[0][:, None, :, None], rows[1][None, :, None, :]]


def _with_knot(
    knots: np.ndarray, control: np.ndarray, degree: int, value: float
) -> tuple[np.ndarray, np.ndarray]:
    """Insert a knot; the spline stays the same (Boehm 1980)."""
    span = int(np.searchsorted(knots, value, side="right")) - 1
    rows = np.arange(span - degree + 1, span + 1)
    shares = ((value - knots[rows]) / (knots[rows + degree] - knots[rows]))[:, None, None]
    mixed = shares * control[rows] + (1.0 - shares) * control[rows - 1]
    parts = control[: span - degree + 1], mixed, control[span:]
    return np.insert(knots, span + 1, value), np.concatenate(parts)
