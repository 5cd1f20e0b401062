"""The smallest clearance of a part over a whole motion, with bounds that also hold between the samples.

A distance changes by at most the length of the path of the part's points (conservative advancement, Mirtich
1996). So between two poses with distances a and b and a path of length w, it is at least (a + b - w) / 2. The
interval with the smallest bound is halved until the bounds meet the tolerance.
"""

from collections.abc import Iterable
from heapq import heapify, heappop, heappush
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from proximity.checks import not_negative
from proximity.errors import SceneError
from proximity.kernels.entries import move_parts
from proximity.pose import Pose
from proximity.scene.model.assembly import EXACT_ENOUGH, Model, finished
from proximity.scene.pairs import SHARING, Clearance, PairQueries, Relation, connect, nearest_pairs
from proximity.scene.queries.html_table import html_table
from proximity.scene.solid import Solid

if TYPE_CHECKING:
    from proximity.scene.motion import Motion, Span

SAMPLES = 48
"""Number of intervals at the beginning, in all spans together. Each span has at least two."""
MAX_SAMPLES = 20_000
TOLERANCE, OUT_TOLERANCE = 0.05, 0.01
"""Relative, between the bounds of a distance, and of the way out of parts that overlap."""
RESOLUTION = 1e-6
"""Relative to the part's path: the search does not bring bounds closer than this."""
TOUCH_RESOLUTION = 1e-9
"""Relative to the part's path: precision of the first touch."""
ROUNDING = 1e-12
"""Error of a distance, as a share of the largest coordinate."""


class MotionClearance(NamedTuple):
    """The smallest distance of a moving part over its motion.

    ``nearest`` is the clearance at ``position``, where the distance is smallest. The true minimum over the
    whole motion is between ``lower`` and ``distance``, m. ``first_touch`` is None if no touch was found.
    Otherwise it is two positions: the part certainly does not touch before the first, and touches at the
    second. ``positions`` (N,) are the sampled ones in the order of the motion. ``distances`` (N,), m, are the
    distances there, and ``bounds`` (N - 1,), m, are lower bounds between two successive positions.
    ``is_complete`` is False if the search ended at its limit of samples before the bounds met the tolerance.
    """

    nearest: Clearance
    position: float
    distance: float
    lower: float
    first_touch: tuple[float, float] | None
    positions: np.ndarray
    distances: np.ndarray
    bounds: np.ndarray
    is_complete: bool

    def _repr_html_(self) -> str:
        names = "position", "distance", "lower", "first_touch", "is_complete"
        row = [*self.nearest[:2], *(getattr(self, name) for name in names)]
        return html_table("MotionClearance", ("first", "second", *names), [row])


class Gap(NamedTuple):
    """The distance that one part can move along a direction before it touches another.

    ``first`` moves along ``direction``, (3,), scene's frame, and ``second`` rests. The true gap is between
    ``lower`` and ``distance``, m. It is negative for parts that overlap: the first part must move back by as
    much until they are free. It is inf if the first part passes the second.
    """

    first: str
    second: str
    direction: np.ndarray
    distance: float
    lower: float

    def _repr_html_(self) -> str:
        return html_table("Gap", self._fields, [self])


class _Interval(NamedTuple):
    """Two samples and a lower bound of the distance between them. Intervals are compared by the bound."""

    lower: float
    start: float
    end: float
    distance_at_start: float
    distance_at_end: float
    span: int


class MotionSearch:
    """Search for the smallest distance of one part along a motion. The scene itself does not change."""

    def __init__(
        self, model: Model, solids: list[Solid], row: int, others: set[int], motion: "Motion"
    ) -> None:
        self._row = row
        self._frames, self._parts = model.frames.copy(), model.parts.copy()
        self._parts["is_hidden"][:-1] = 1
        self._parts["is_hidden"][list(others)] = 0
        self._model = finished(model.reals, model.words, self._frames, self._parts, names=model.names)
        self._versions = np.zeros(len(self._parts), np.int64)
        frame, corners = model.frames[row], solids[row].mesh.vertices
        pose = Pose.known(frame["rotation"].reshape(3, 3), frame["translation"])
        self._spans = motion.spans(pose, 0.5 * (corners.min(axis=0) + corners.max(axis=0)))
        self._lengths = [span.path_length(corners) for span in self._spans]
        extent = max(float(np.abs(model.frames[name]).max()) for name in ("box_lower", "box_upper"))
        self._rounding = ROUNDING * (extent + sum(self._lengths))
        self._nearest: tuple[float, float, Clearance] | None = None  # distance, position, clearance
        self._count = 0

    def search(self, tolerance: float, below: float | None) -> MotionClearance:
        """Search until the bounds meet the *tolerance*, or decide whether a distance is less than *below*."""
        open_intervals = self._first_intervals()
        heapify(open_intervals)
        resolution = RESOLUTION * sum(self._lengths)
        while self._count < MAX_SAMPLES:
            least, distance = open_intervals[0].lower, self._smallest
            if distance == 0.0 or least >= distance * (1.0 - tolerance) - resolution:
                break
            if below is not None and (least >= below or distance < below):
                break
            for half in self._halves(heappop(open_intervals)):
                heappush(open_intervals, half)
        is_complete = self._count < MAX_SAMPLES
        intervals = sorted(open_intervals, key=lambda each: (each.span, self._share(each.span, each.start)))
        touch = self._first_touch(intervals) if self._smallest == 0.0 else None
        assert self._nearest is not None
        distance, position, nearest = self._nearest
        bounds = np.array([max(each.lower, 0.0) for each in intervals])
        positions = [each.start for each in intervals] + [intervals[-1].end]
        distances = [each.distance_at_start for each in intervals] + [intervals[-1].distance_at_end]
        return MotionClearance(
            nearest, position, distance, min(float(bounds.min()), distance), touch, np.array(positions),
            np.array(distances), bounds, is_complete,
        )  # fmt: skip

    @property
    def _smallest(self) -> float:
        return inf if self._nearest is None else self._nearest[0]

    def _share(self, span: int, position: float) -> float:
        start, end = self._spans[span].start, self._spans[span].end
        return (position - start) / (end - start)

    def _path(self, span: int, start: float, end: float) -> float:
        """Return an upper bound, m, of the path of any point of the part between two positions."""
        return self._lengths[span] * (self._share(span, end) - self._share(span, start))

    def _first_intervals(self) -> list[_Interval]:
        count = max(SAMPLES // len(self._spans), 2)
        found = []
        for number, span in enumerate(self._spans):
            positions = np.linspace(span.start, span.end, count + 1).tolist()
            distances = [self._distance(span, position) for position in positions]
            for k in range(count):
                found.append(self._interval(number, *positions[k : k + 2], *distances[k : k + 2]))
        return found

    def _interval(self, number: int, start: float, end: float, at_start: float, at_end: float) -> _Interval:
        path = self._path(number, start, end)
        lower = min(0.5 * (at_start + at_end - path), at_start, at_end) - self._rounding
        return _Interval(lower, start, end, at_start, at_end, number)

    def _halves(self, interval: _Interval) -> tuple[_Interval, _Interval]:
        _, start, end, at_start, at_end, number = interval
        middle = 0.5 * (start + end)
        distance = self._distance(self._spans[number], middle)
        return (
            self._interval(number, start, middle, at_start, distance),
            self._interval(number, middle, end, distance, at_end),
        )

    def _distance(self, span: "Span", position: float) -> float:
        """Return the distance at a position, and store it with its clearance if it is the smallest so far."""
        self._count += 1
        matrix = span.pose_at(position).matrix[None]
        none = np.empty((0, 3))
        rows = np.array([self._row], np.int64)
        move_parts(self._frames, self._parts, self._versions, 0, rows, matrix, none, none, EXACT_ENOUGH)
        (best,) = nearest_pairs(self._model, inf, self._row, 1)
        if best.distance < self._smallest:
            is_second = best.second == self._model.names[self._row]
            self._nearest = best.distance, position, _swapped(best) if is_second else best
        return best.distance

    def _first_touch(self, intervals: list[_Interval]) -> tuple[float, float]:
        """Return a position up to which the part certainly does not touch, and one at which it touches."""
        waiting = intervals[::-1]
        free = intervals[0].start
        while waiting:
            interval = waiting.pop()
            if interval.distance_at_start == 0.0:
                return free, interval.start
            if interval.lower > 0.0:
                free = interval.end
                continue
            path = self._path(interval.span, interval.start, interval.end)
            if path <= TOUCH_RESOLUTION * sum(self._lengths) or self._count >= 2 * MAX_SAMPLES:
                ends = [each.end for each in (interval, *waiting[::-1]) if each.distance_at_end == 0.0]
                return free, ends[0]
            waiting += self._halves(interval)[::-1]
        return free, intervals[-1].end


def _swapped(pair: Clearance) -> Clearance:
    """Return the clearance of the same two parts in the other order."""
    inside = {
        Relation.FIRST_INSIDE: Relation.SECOND_INSIDE,
        Relation.SECOND_INSIDE: Relation.FIRST_INSIDE,
    }
    return Clearance(
        pair.second, pair.first, pair.distance, pair.lower, inside.get(pair.relation, pair.relation),
        pair.point_on_second, pair.point_on_first, pair.face_on_second, pair.face_on_first,
    )  # fmt: skip


class MotionQueries(PairQueries):
    """Queries of a scene about pairs of its parts, including those over a motion."""

    def clearance_along(
        self,
        part: str | int,
        motion: "Motion",
        *,
        others: Iterable[str | int] | None = None,
        tolerance: float = TOLERANCE,
        below: float | None = None,
    ) -> MotionClearance:
        """Return the smallest distance of a part over a whole motion, also between the samples.

        The scene does not change.

        Parameters
        ----------
        part : str or int
            Name or index of the part that moves; it may be hidden.
        motion : Motion
            Its motion, relative to its present pose or through given poses.
        others : iterable of str or int
            Parts to which the distance is measured; hidden ones are ignored. Default: all other visible
            parts. Leave out the parts that it rests on or turns in, because it touches them all the time.
        tolerance : float
            The returned distance may be longer than the true minimum by this share of it.
        below : m
            End as soon as it is certain whether the smallest distance is less than this.

        Returns
        -------
        MotionClearance
            The smallest distance with its bounds, its position and points; the first touch; and the curve.

        Raises
        ------
        SceneError
            If there is no such part, or no other part to measure to.
        ArgumentError
            If the tolerance or ``below`` is out of range.
        PoseError
            If the motion leaves the range of poses.

        Notes
        -----
        Cost: that of `clearance` for each sample. There are 50 samples for a part that keeps away, and more
        for a path that is long relative to the smallest distance; 20 000 at most, see ``is_complete``.
        Source: conservative advancement, Mirtich 1996.
        """
        tolerance = not_negative("tolerance", tolerance, "shares")
        limit = None if below is None else not_negative("below", below, "metres")
        names = [] if others is None else list(others)
        model, parts, (row, *rows) = self._state_with_rows(part, *names)
        visible = np.flatnonzero(model.parts["is_hidden"][:-1] == 0).tolist()
        measured = {each for each in (visible if others is None else rows) if each != row} & set(visible)
        if not measured:
            raise SceneError(f"there is no other visible part to measure {part!r} to")
        return MotionSearch(model, parts.solids, row, measured, motion).search(tolerance, limit)

    def gap(self, first: str | int, second: str | int, direction: Any) -> Gap:
        """Return how far a part can move along a direction before it touches another.

        Parameters
        ----------
        first, second : str or int
            Names or indices of two parts, hidden or not; the first moves.
        direction : (3,) array-like, scene's frame
            Direction of the motion, of any length.

        Returns
        -------
        Gap
            The gap with its bounds; negative for parts that overlap.

        Raises
        ------
        SceneError
            If there is no such part, or both are the same.
        ArgumentError
            If the direction is not three finite numbers, or zero.

        Notes
        -----
        Degenerate: parts that touch have the gap 0, also if the motion separates them.
        Cost: that of 50 calls of `clearance`, and more if the first part passes others closely.
        """
        model, parts, (row, other) = self._state_with_rows(first, second)
        if row == other:
            raise SceneError(f"the gap of {first!r} to itself was requested, expected two parts")
        # Not needed by other queries.
        from proximity.scene.motion import Motion, unit_vector
        from proximity.scene.penetration import measure_exit

        along = unit_vector("direction", direction)
        names, solids = (model.names[row], model.names[other]), parts.solids
        if connect(model, solids, row, other).relation in SHARING:
            faces = solids[row].surface_faces, solids[other].surface_faces
            out = measure_exit(model, (row, other), faces, -along, OUT_TOLERANCE)
            return Gap(*names, along, -float(out["lower"]), -float(out["depth"]))
        least, farthest = (_extent(model, each, along)[side] for each, side in ((row, 0), (other, 1)))
        if farthest <= least:
            return Gap(*names, along, inf, inf)
        motion = Motion.slide(along, 0.0, farthest - least)
        found = MotionSearch(model, solids, row, {other}, motion).search(TOLERANCE, None)
        if found.first_touch is not None:
            return Gap(*names, along, found.first_touch[1], found.first_touch[0])
        unsure = np.flatnonzero(found.bounds <= 0.0)
        return Gap(*names, along, inf, float(found.positions[unsure[0]]) if len(unsure) else inf)


def _extent(model: Model, row: int, along: np.ndarray) -> tuple[float, float]:
    """Return the least and the greatest coordinate of a part's box along a direction."""
    box = np.stack([model.frames[row][name] * along for name in ("box_lower", "box_upper")])
    return float(box.min(axis=0).sum()), float(box.max(axis=0).sum())
