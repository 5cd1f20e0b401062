"""Upper bounds of the distance of triangles from B-spline surfaces, and of chords from B-spline curves.

A triangle whose corners have parameters is compared with the surface at the interpolated parameters. The
difference is at most that at the corners and (a du^2 + 2 b du dv + c dv^2) / 8, where a, b and c bound the
second derivatives. They follow from the control points of the derivatives. A kink at k between parameters l
and h, at which the first derivative jumps by j, adds at most j (h - k) (k - l) / (h - l).
"""

from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from proximity.formats.step.shapes import Spline
from proximity.formats.step.spline_net import Net
from proximity.formats.step.surface_distance import MAX_LEVEL, MAX_RATIO, MAX_TRIANGLES, middles_of, quartered

_MAX_HALVINGS = 8
"""Maximum number of subdivisions of a chord."""
_PIECES = 16
"""Number of pieces along each parameter up to which those of a surface are split. Smaller pieces have tighter
bounds of the second derivatives."""
_STEPS = 12
"""Number of Newton steps for the parameters of a point."""
_SMALL = 1e-10
"""Improvement of a distance, as a share of the coordinates, that is not worth another step."""
_SAMPLES = 3
"""Number of starting points for each degree and piece."""


Rows = tuple[np.ndarray, np.ndarray]
"""Rows of the first control points along both parameters."""
Bases = tuple[np.ndarray, np.ndarray]
"""Basis functions one degree lower, and of the degree of a spline."""


class SplineShape:
    """A surface or a curve with its derivatives."""

    def __init__(self, spline: Spline) -> None:
        given = Net(spline.degrees, spline.knots, spline.control)
        self.is_bounded = given.is_bounded
        self.direction = spline.direction
        self.net = given.split(_PIECES)
        self._kinks = [given.kinks(axis) if self.is_bounded else [] for axis in (0, 1)]
        self._slopes = self.net.derived(0), self.net.derived(1)
        lows = [knots[degree] for degree, knots in zip(self.net.degrees, self.net.knots, strict=True)]
        highs = [knots[-degree - 1] for degree, knots in zip(self.net.degrees, self.net.knots, strict=True)]
        self.lower, self.upper = np.array(lows), np.array(highs)
        inner = [
            np.unique(knots[(knots >= low) & (knots <= high)])
            for knots, low, high in zip(self.net.knots, lows, highs, strict=True)
        ]
        self._turns = np.array([
            self.upper[axis] - self.lower[axis] if self._is_closed(axis) else 0.0 for axis in (0, 1)
        ])  # fmt: skip
        self._small = _SMALL * float(np.abs(self.net.control[..., :3]).max())
        self._starts = inner[0][:-1], inner[1][:-1]
        self._breaks = inner
        self._tree: tuple[cKDTree, np.ndarray] | None = None

    def distances(self, points: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """Return the largest distance of points, (N, K, 3), from those at parameters, (N, K, 2)."""
        at = self.points(parameters.reshape(-1, 2)).reshape(points.shape)
        return np.asarray(np.linalg.norm(at - points, axis=2).max(axis=1))

    def points(self, parameters: np.ndarray) -> np.ndarray:
        """Return points at parameters, (N, 2)."""
        rows, (_, u), (_, v) = self._rows_and_bases(parameters)
        values = _combined(self.net.control, rows, u, v)
        return values[:, :3] / values[:, 3:]

    def points_and_slopes(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return points at parameters, (N, 2), and the first derivatives, (N, 2, 3)."""
        rows, (lower_u, u), (lower_v, v) = self._rows_and_bases(parameters)
        values = _combined(self.net.control, rows, u, v)
        weights = values[:, 3:]
        points = values[:, :3] / weights
        along_u = _combined(self._slopes[0].control, rows, lower_u, v)
        is_curve = self.net.degrees[1] == 0
        along_v = np.zeros_like(along_u) if is_curve else _combined(self._slopes[1].control, rows, u, lower_v)
        pairs = [(each[:, :3] - each[:, 3:] * points) / weights for each in (along_u, along_v)]
        return points, np.stack(pairs, axis=1)

    def _rows_and_bases(self, parameters: np.ndarray) -> tuple[Rows, Bases, Bases]:
        firsts, bases = [], []
        for axis, (degree, knots) in enumerate(zip(self.net.degrees, self.net.knots, strict=True)):
            first, lower, basis = _basis(knots, degree, parameters[:, axis])
            firsts.append(first)
            bases.append((lower, basis))
        return (firsts[0], firsts[1]), bases[0], bases[1]

    def nearest_parameters(self, points: np.ndarray) -> np.ndarray:
        """Return the parameters of surface points near *points*, (N, 2)."""
        if self._tree is None:
            grids = [
                _between(breaks, 1 + _SAMPLES * max(degree, 1))
                for breaks, degree in zip(self._breaks, self.net.degrees, strict=True)
            ]
            for axis, end in self._poles():  # a search from a pole has no direction around it
                rows = (0, 1) if end == self.lower[axis] else (-1, -2)
                grids[axis][rows[0]] += 0.1 * (grids[axis][rows[1]] - end)
            grid = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, 2)
            self._tree = cKDTree(self.points(grid)), grid
        tree, grid = self._tree
        return self.refined(points, grid[tree.query(points)[1]], self._turns)

    def refined(
        self, points: np.ndarray, parameters: np.ndarray, turns: np.ndarray | float = 0.0
    ) -> np.ndarray:
        """Improve parameters of points by Gauss-Newton steps, and return them.

        A step that would increase the distance is shortened. A point is done when it improves little. Steps
        across an end continue at the other end if *turns* is the length of that parameter.
        """
        best, rows = parameters.copy(), np.arange(len(points))
        found, slopes = self.points_and_slopes(parameters)
        distances = np.linalg.norm(found - points, axis=1)
        factor = np.ones((len(points), 1))
        for _ in range(_STEPS):
            step = _solved(
                np.einsum("nic,njc->nij", slopes, slopes), np.einsum("nic,nc->ni", slopes, points - found)
            )
            tried = best[rows] + factor * step
            tried += turns * ((tried < self.lower).astype(float) - (tried > self.upper))
            tried = np.clip(tried, self.lower, self.upper)
            new_found, new_slopes = self.points_and_slopes(tried)
            new = np.linalg.norm(new_found - points, axis=1)
            is_better = new < distances
            best[rows[is_better]] = tried[is_better]
            least = 1e-3 * distances + self._small
            moves = np.linalg.norm(np.einsum("nic,ni->nc", slopes, step), axis=1)
            is_open = (distances - new > least) | (~is_better & (factor[:, 0] > 0.1) & (moves > least))
            found[is_better], slopes[is_better] = new_found[is_better], new_slopes[is_better]
            factor = np.where(is_better[:, None], 1.0, 0.25 * factor)
            distances = np.minimum(new, distances)
            if not is_open.any():
                break
            points, rows, found, slopes = points[is_open], rows[is_open], found[is_open], slopes[is_open]
            distances, factor = distances[is_open], factor[is_open]
        return best

    @cached_property
    def _table(self) -> np.ndarray:
        """Bounds of the second derivatives on each piece, (S, T, 3): along u, mixed, along v.

        Points are relative to the middle of the piece's control points, so that weights count little.
        """
        profile = self.net.profile(0).profile(1)
        slopes = profile.derived(0), profile.derived(1)
        nets = [profile, *slopes, slopes[0].derived(0), slopes[0].derived(1), slopes[1].derived(1)]
        windows = [net.windows(self._starts) for net in nets]
        weights = windows[0][..., 3]
        middle = (windows[0][..., :3] / weights[..., None]).mean(axis=(2, 3))[:, :, None, None]

        def norms(window: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """Return the largest norms of the vectors about the middle, and of the weights."""
            shifted = window[..., :3] - middle * window[..., 3:]
            return np.linalg.norm(shifted, axis=-1).max(axis=(2, 3)), np.abs(window[..., 3]).max(axis=(2, 3))

        least = weights.min(axis=(2, 3))
        reach = np.linalg.norm(windows[0][..., :3] / weights[..., None] - middle, axis=-1).max(axis=(2, 3))
        (u, wu), (v, wv), (uu, wuu), (uv, wuv), (vv, wvv) = map(norms, windows[1:])
        u, v = (u + wu * reach) / least, (v + wv * reach) / least
        return np.stack([
            (uu + 2 * wu * u + wuu * reach) / least,
            (uv + wu * v + wv * u + wuv * reach) / least,
            (vv + 2 * wv * v + wvv * reach) / least,
        ], axis=-1)  # fmt: skip

    def excess(self, parameters: np.ndarray) -> np.ndarray:
        """Return bounds of the distance of the surface from its linear interpolation between corners.

        *parameters*: (N, K, 2) of the corners.
        """
        lower, upper = parameters.min(axis=1), parameters.max(axis=1)
        along_u, mixed, along_v = self.second_bounds(lower, upper).T
        u, v = (upper - lower).T
        smooth = (along_u * u * u + 2.0 * mixed * u * v + along_v * v * v) / 8.0
        return np.asarray(smooth + self.jumps(lower, upper)[1])

    def _is_closed(self, axis: int) -> bool:
        """Return whether the surface has the same points at both ends of a parameter."""
        control = np.moveaxis(self.net.control, axis, 0)
        size = float(np.abs(control).max())
        return len(control) > 1 and np.allclose(control[0], control[-1], rtol=0.0, atol=1e-9 * size)

    def _poles(self) -> list[tuple[int, float]]:
        """Return the parameters, and their ends, at which the surface is a point."""
        points, found = self.net.control[..., :3] / self.net.control[..., 3:], []
        small = 1e-9 * float(np.abs(points).max())
        for axis in (0, 1):
            rows = np.moveaxis(points, axis, 0)
            for end, row in ((self.lower[axis], rows[0]), (self.upper[axis], rows[-1])):
                if len(row) > 1 and np.ptp(row, axis=0).max() <= small:
                    found.append((axis, float(end)))
        return found

    def jumps(self, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return bounds for boxes of parameters with kinks: of the jump of the first derivatives, and of the
        distance from the linear interpolation that is due to it.
        """
        total, excess = np.zeros((2, len(lower)))
        for axis, kinks in enumerate(self._kinks):
            low, high = lower[:, axis], upper[:, axis]
            for value, jump in kinks:
                is_inside = (low < value) & (value < high)
                width = np.where(is_inside, high - low, 1.0)
                total += np.where(is_inside, jump, 0.0)
                excess += np.where(is_inside, jump * (high - value) * (value - low) / width, 0.0)
        return total, excess

    def flattened(self, points: np.ndarray) -> np.ndarray:
        """Return points, (..., 3), in the plane of the profile of an extrusion; the same for others."""
        if self.direction is None:
            return points
        return np.asarray(points - (points @ self.direction)[..., None] * self.direction)

    def second_bounds(self, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Return bounds of the second derivatives on boxes of parameters, (N, 3): along u, mixed, along v."""
        table = self._table
        firsts, lasts = [], []
        for axis, starts in enumerate(self._starts):
            last = len(starts) - 1
            firsts.append(np.clip(np.searchsorted(starts, lower[:, axis], side="right") - 1, 0, last))
            lasts.append(np.clip(np.searchsorted(starts, upper[:, axis], side="left") - 1, firsts[-1], last))
        extents = [int((last - first).max(initial=0)) for first, last in zip(firsts, lasts, strict=True)]
        if (extents[0] + 1) * (extents[1] + 1) > 64:
            return np.broadcast_to(table.max(axis=(0, 1)), (len(lower), 3))
        found = np.zeros((len(lower), 3))
        for along_u in range(extents[0] + 1):
            rows = np.minimum(firsts[0] + along_u, lasts[0])
            for along_v in range(extents[1] + 1):
                np.maximum(found, table[rows, np.minimum(firsts[1] + along_v, lasts[1])], out=found)
        return found

    def joined(self, parameters: np.ndarray) -> np.ndarray:
        """Return the parameters of corners, (N, K, 2), moved across the seam of a closed surface to their
        neighbours, and those of a pole to the middle of the others.
        """
        parameters = parameters.copy()
        for axis in (0, 1):
            low, high = self.lower[axis], self.upper[axis]
            values = parameters[..., axis]
            if self._turns[axis]:
                middle = 0.5 * (low + high)
                edge = 1e-6 * (high - low)
                is_wide = np.ptp(values, axis=1) > middle - low
                is_high = (np.where(is_wide[:, None], values, middle) > middle).sum(axis=1)
                is_low = values.shape[1] - is_high
                at_low, at_high = values <= low + edge, values >= high - edge
                to_high = is_wide[:, None] & at_low & (is_high > 0)[:, None]
                to_low = is_wide[:, None] & at_high & (is_low > 0)[:, None]
                # Either all corners at the lower end move, or all at the upper end: the narrower is kept.
                one, other = np.where(to_high, high, values), np.where(to_low, low, values)
                is_one = (np.ptp(one, axis=1) <= np.ptp(other, axis=1))[:, None]
                parameters[..., axis] = np.where(is_wide[:, None], np.where(is_one, one, other), values)
        for pole, end in self._poles():
            around = 1 - pole
            span = self.upper[pole] - self.lower[pole]
            is_pole = np.abs(parameters[..., pole] - end) <= 1e-6 * span
            count = (~is_pole).sum(axis=1)
            total = np.where(is_pole, 0.0, parameters[..., around]).sum(axis=1)
            middle = np.divide(total, count, out=np.full(len(total), self.lower[around]), where=count > 0)
            parameters[..., around] = np.where(is_pole, middle[:, None], parameters[..., around])
        return parameters


def _basis(knots: np.ndarray, degree: int, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return first control points, and basis functions one degree lower and of the degree.

    Source: de Boor 1972, "On calculating with B-splines".
    """
    spans = np.clip(np.searchsorted(knots, values, side="right") - 1, degree, len(knots) - degree - 2)
    lower = basis = np.ones((len(values), 1))
    for each in range(1, degree + 1):
        after = knots[spans[:, None] + 1 + np.arange(each)]
        before = knots[spans[:, None] + 1 - each + np.arange(each)]
        shares = basis / (after - before)
        lower, basis = basis, np.zeros((len(values), each + 1))
        basis[:, :-1] += (after - values[:, None]) * shares
        basis[:, 1:] += (values[:, None] - before) * shares
    return spans - degree, lower, basis


def _combined(control: np.ndarray, firsts: Rows, along_u: np.ndarray, along_v: np.ndarray) -> np.ndarray:
    """Return the sums of control points, (m, n, 4), weighted by basis functions, as (N, 4)."""
    rows = firsts[0][:, None] + np.arange(along_u.shape[1])
    if control.shape[1] == 1:  # a curve
        return np.einsum("ni,nic->nc", along_u, control[rows, 0])
    columns = firsts[1][:, None] + np.arange(along_v.shape[1])
    own = control[rows[:, :, None], columns[:, None, :]]
    return np.einsum("ni,nic->nc", along_u, np.einsum("nj,nijc->nic", along_v, own))


def _between(breaks: np.ndarray, count: int) -> np.ndarray:
    """Return *count* values from each break to the next, without repetition."""
    return np.unique(np.concatenate([np.linspace(a, b, count) for a, b in pairwise(breaks)]))


def _solved(matrices: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Solve symmetric equations of two unknowns, scaled by their diagonals."""
    scale = np.sqrt(np.maximum(matrices[:, [0, 1], [0, 1]], np.finfo(float).tiny))
    mixed = matrices[:, 0, 1] / (scale[:, 0] * scale[:, 1])
    right = sides / scale
    determinant = np.maximum(1.0 - mixed * mixed, 1e-12)
    first = (right[:, 0] - mixed * right[:, 1]) / determinant
    second = (right[:, 1] - mixed * right[:, 0]) / determinant
    return np.stack([first, second], axis=1) / scale


@lru_cache(maxsize=256)
def shape_of(spline: Spline) -> SplineShape:
    """Return the shape of a spline."""
    return SplineShape(spline)


def surface_bound(shape: SplineShape, triangles: np.ndarray) -> float:
    """Return an upper bound of the largest distance of triangles, (N, 3, 3) m, from a surface."""
    if not shape.is_bounded:
        return np.inf
    triangles = shape.flattened(triangles)
    corners, inverse = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    parameters = shape.nearest_parameters(corners)[inverse.reshape(-1)].reshape(-1, 3, 2)
    bound = found = 0.0
    for level in range(MAX_LEVEL + 1):
        parameters = shape.joined(parameters)
        distances = shape.distances(triangles, parameters)
        # No point of a triangle is farther from a corner; near a pole that is less.
        around = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2).max(axis=1) / np.sqrt(3.0)
        upper = distances + np.minimum(shape.excess(parameters), around)
        found = max(found, float(distances.max(initial=0.0)))
        is_last = level == MAX_LEVEL or 4 * len(triangles) > MAX_TRIANGLES
        is_done = (upper <= MAX_RATIO * found) | is_last
        bound = max(bound, float(upper[is_done].max(initial=0.0)))
        if is_done.all():
            break
        triangles, parameters = triangles[~is_done], parameters[~is_done]
        guess, middles = middles_of(parameters), middles_of(triangles)
        refined = shape.refined(middles.reshape(-1, 3), guess.reshape(-1, 2)).reshape(-1, 3, 2)
        parameters, triangles = quartered(parameters, refined), quartered(triangles, middles)
    return bound


def chord_bounds(shape: SplineShape, chords: np.ndarray, fit: float) -> np.ndarray:
    """Return upper bounds of the distance of chords, (N, 2, 3) m, from a curve, point by point along both.

    Chords with an end farther than *fit*, m, have an infinite bound.
    """
    bounds = np.full(len(chords), np.inf)
    if not shape.is_bounded:
        return bounds
    parameters = shape.nearest_parameters(chords.reshape(-1, 3)).reshape(-1, 2, 2)
    is_near = shape.distances(chords, parameters) <= fit
    rows = np.flatnonzero(is_near)
    chords, parameters = chords[rows], shape.joined(parameters[rows])
    bounds[rows] = 0.0
    found = 0.0
    for level in range(_MAX_HALVINGS + 1):
        distances = shape.distances(chords, parameters)
        upper = distances + shape.excess(parameters)
        found = max(found, float(distances.max(initial=0.0)))
        is_done = (upper <= MAX_RATIO * np.maximum(found, distances)) | (level == _MAX_HALVINGS)
        np.maximum.at(bounds, rows[is_done], upper[is_done])
        if is_done.all():
            break
        rows = np.repeat(rows[~is_done], 2)
        chords, guess = (_halved(each[~is_done]) for each in (chords, parameters))
        # The new middle is moved to the nearest point between the ends, so that parameters stay in order.
        middle = shape.refined(chords[::2, 1], guess[::2, 1])
        limits = np.sort(np.stack([guess[::2, 0, 0], guess[1::2, 1, 0]]), axis=0)
        middle[:, 0] = np.clip(middle[:, 0], *limits)
        guess[::2, 1] = guess[1::2, 0] = middle
        parameters = guess
    return bounds


def _halved(pairs: np.ndarray) -> np.ndarray:
    """Split pairs, (N, 2, ...), at their middles; the halves of one pair are in succession."""
    middle = pairs.mean(axis=1)
    return np.stack([pairs[:, 0], middle, middle, pairs[:, 1]], axis=1).reshape(-1, *pairs.shape[1:])
