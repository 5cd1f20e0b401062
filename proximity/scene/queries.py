"""The questions that solids and scenes answer alike; arguments are checked here, once."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy import empty, inf  # looked up in NumPy, each would cost calls of five points 2 %

from proximity.arrays import as_points
from proximity.errors import NotWatertightError, QueryError
from proximity.kernels.compiler import Settled
from proximity.kernels.geometry.morton_order import SORT_FROM, morton_order
from proximity.kernels.ray.hit_rows import ANSWER_WIDTH as HIT_WIDTH
from proximity.kernels.ray.hit_rows import DISTANCE_WIDTH
from proximity.kernels.ray.ray_order import ray_order
from proximity.kernels.scene import point_queries, segment_queries, small_batches
from proximity.kernels.scene.point_queries import (
    closest_batch,
    contains_batch,
    distance_batch,
    has_inside,
    signed_batch,
)
from proximity.kernels.scene.ray_queries import NO_ROW, cast_batch
from proximity.kernels.scene.segment_queries import segment_batch
from proximity.model.assembly import Model
from proximity.scene.batches import IN_ORDER, LARGEST_SLICE, first_slice, run_batch
from proximity.scene.query_arguments import broadcast_limits, broadcast_rows, is_length
from proximity.scene.results import ClosestPoints, RayHits, Reals, SegmentHits, record_of

SORT_RAYS_FROM = 1024
"""Rays from which on a batch is sorted."""
SORT_RAYS_IN = 1 << 20
"""Bytes of a model from which on that is worth it: it costs 15 ns a ray; in one that fits into a nearer cache
it spares no more than that."""
ONE_THREAD = 1

_closest_few = Settled(small_batches.closest_few, small_batches.CLOSEST)
_signed_few = Settled(small_batches.signed_few, small_batches.DISTANCE)
_distance_few = Settled(small_batches.distance_few, small_batches.DISTANCE)
_contains_few = Settled(small_batches.contains_few, small_batches.CONTAINS)
_cast_few = Settled(small_batches.cast_few, small_batches.CAST)
_lengths_few = Settled(small_batches.lengths_few, small_batches.LENGTHS)
_segments_few = Settled(small_batches.segments_few, small_batches.SEGMENTS)


class Queries:
    """Distance, inside, rays and segments; a base for what has a `Model`.

    Few rows from somebody in a hurry are answered at once, if compiled code finds them plain float64; what
    else may come is sorted out in functions of its own: variables that they share with one within would be
    made at every call. The model is held by name while it is asked: what nobody holds is written anew when
    parts move.
    """

    __slots__ = ()

    def snapshot(self) -> Model:
        """Return the arrays that are asked, up to date."""
        raise NotImplementedError

    def closest(
        self, points: npt.ArrayLike, *, max_distance: npt.ArrayLike = inf, workers: int = 1
    ) -> ClosestPoints:
        """Return the surface points nearest to *points*, with signed distances.

        Parameters
        ----------
        points : (..., 3) float64, m
            Where to measure from. A row that is not finite, or farther than 1e100 part sizes, answers nan and
            `NO_FACE`; the others go on.
        max_distance : float or (...) float64, m
            Search no farther than this. An array broadcasts against the leading shape of *points*, which
            then is that of both. It changes the cost, never an answer within it; what is deeper
            inside than this has none.
        workers : int
            Threads; -1 for all cores. The answers are the same, bit for bit.

        Returns
        -------
        ClosestPoints
            Arrays of the leading shape of *points* and *max_distance*.

        Raises
        ------
        QueryError
            If *points* are not numbers of shape (..., 3), *max_distance* is negative or nan or does not
            broadcast, or *workers* is no number of threads.

        Notes
        -----
        Sign: per part, see `SignMethod`; of a scene, the smallest signed distance over its parts: exact
        outside, inside a lower bound of the depth. A part without an inside counts with its distance.
        On the surface: distance 0, gradient is the pseudo-normal of the feature.
        Ties: the lowest part; within a part any of the nearest faces, the same on every run.
        Degenerate: faces without area answer as their edges. On them, and on edges and corners where the
        normals of faces back to back cancel, there is no way out: the gradient is 0.
        Cost: about O(log F) on the surface, O(√F) near one that is finely meshed, towards O(F) at centres of
        symmetry.
        Thread: any number of threads may ask; the interpreter lock is released.
        Source: Bærentzen & Aanæs 2005; Barill et al. 2018; see `kernels`.
        """
        is_plain = workers is ONE_THREAD and (max_distance is inf or is_length(max_distance))
        if is_plain and (count := _count(points)) < SORT_FROM:
            answers = empty((count, point_queries.ANSWER_WIDTH))
            model = self.snapshot()
            if _closest_few.call(model.handle, points, max_distance, answers):
                record = ClosestPoints()
                record._table = answers
                return record
        return self._closest(points, max_distance, workers)

    def _closest(self, points: Any, max_distance: Any, workers: int) -> ClosestPoints:
        limits, (points,) = broadcast_limits(max_distance, [as_points(points)], "points")
        rows = points.reshape(-1, 3)
        answers = empty((len(rows), point_queries.ANSWER_WIDTH))
        model = self.snapshot()
        run_batch(
            lambda order, rows, limits, answers: closest_batch(model.handle, rows, order, limits, answers),
            [rows, limits, answers],
            workers,
            _along_curve,
            first_slice(model.reals.nbytes),
        )
        return record_of(ClosestPoints, answers, points.shape[:-1])

    def signed_distance(self, points: npt.ArrayLike, *, workers: int = 1) -> Reals:
        """Return signed distances, m, negative inside: as `closest`, and faster.

        Parameters
        ----------
        points : (..., 3) float64, m
            Where to measure from. A row that is not finite answers nan.
        workers : int
            Threads; -1 for all cores.

        Returns
        -------
        (...) float64, m

        Raises
        ------
        QueryError
            If *points* are not numbers of shape (..., 3), or *workers* is no number of threads.
        """
        return self._distances(points, workers, _signed_few, signed_batch)

    def distance(self, points: npt.ArrayLike, *, workers: int = 1) -> Reals:
        """Return distances to the surface, m, without sign: the fastest query.

        Parameters
        ----------
        points : (..., 3) float64, m
            Where to measure from. A row that is not finite answers nan.
        workers : int
            Threads; -1 for all cores.

        Returns
        -------
        (...) float64, m

        Raises
        ------
        QueryError
            If *points* are not numbers of shape (..., 3), or *workers* is no number of threads.
        """
        return self._distances(points, workers, _distance_few, _distance_batch)

    def _distances(self, points: Any, workers: int, few: Settled, batch: Callable[..., Any]) -> Any:
        """Signed or unsigned, by kernels for small batches and for large ones."""
        if workers is ONE_THREAD and (count := _count(points)) < SORT_FROM:
            distances = empty(count)
            model = self.snapshot()
            if few.call(model.handle, points, distances):
                return distances
        return self._distances_of_any(as_points(points), workers, few, batch)

    def _distances_of_any(
        self, points: np.ndarray, workers: int, few: Settled, batch: Callable[..., Any]
    ) -> Any:
        rows = points if points.ndim == 2 else points.reshape(-1, 3)
        distances = empty(len(rows))
        model = self.snapshot()
        is_settled = len(rows) < SORT_FROM and workers == 1 and workers is not True
        if not (is_settled and few.call(model.handle, rows, distances)):
            run_batch(
                lambda order, rows, distances: batch(model.handle, rows, order, distances),
                [rows, distances],
                workers,
                _along_curve,
                first_slice(model.reals.nbytes),
            )
        return distances if rows is points else distances.reshape(points.shape[:-1])[()]

    def contains(self, points: npt.ArrayLike, *, workers: int = 1) -> npt.NDArray[np.bool_]:
        """Return whether points are inside some part.

        Parameters
        ----------
        points : (..., 3) float64, m
            Where to look. A row that is not finite is not inside.
        workers : int
            Threads; -1 for all cores.

        Returns
        -------
        (...) bool
            On the surface itself: False.

        Raises
        ------
        QueryError
            If *points* are not numbers of shape (..., 3), or *workers* is no number of threads.
        NotWatertightError
            If nothing here has an inside.
        """
        if workers is ONE_THREAD and (count := _count(points)) < SORT_FROM:
            inside = empty(count, np.bool_)
            model = self.snapshot()
            if _contains_few.call(model.handle, points, inside):
                return inside
        return self._contains(points, workers)

    def _contains(self, points: Any, workers: int) -> Any:
        points = as_points(points)
        model = self.snapshot()
        if not has_inside(model.handle):
            raise NotWatertightError(
                "no part has an inside, so that nothing can be contained; sign_reason of each part says why"
            )
        rows = points.reshape(-1, 3)
        inside = empty(len(rows), np.bool_)
        run_batch(
            lambda order, rows, inside: contains_batch(model.handle, rows, order, inside),
            [rows, inside],
            workers,
            _along_curve,
            first_slice(model.reals.nbytes),
        )
        return inside.reshape(points.shape[:-1])[()]

    def cast(
        self,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        *,
        max_distance: npt.ArrayLike = inf,
        workers: int = 1,
    ) -> RayHits:
        """Return the first hits of rays.

        Parameters
        ----------
        origins : (..., 3) float64, m
            Where rays start. Shapes broadcast against *directions*.
        directions : (..., 3) float64
            Where they go; any length but zero.
        max_distance : float or (...) float64, m
            Look no farther along a ray than this; an array broadcasts against the leading shape of the rays.
        workers : int
            Threads; -1 for all cores.

        Returns
        -------
        RayHits
            Arrays of the broadcast leading shape. A row that is not finite, or starts farther off than 1e100
            part sizes, answers nan and `NO_FACE`.

        Raises
        ------
        QueryError
            If shapes or types do not fit, a direction is zero, *max_distance* is negative or nan, or
            *workers* is no number of threads.

        Notes
        -----
        On the surface: a ray that starts there hits at distance 0.
        Ties: the lowest part; within a part any of the faces, the same on every run.
        Degenerate: through an edge or corner of a closed surface a ray never slips; a face seen edge on is
        not hit.
        Source: Woop, Benthin, Wald 2013, "Watertight ray/triangle intersection".
        """
        is_plain = workers is ONE_THREAD and (max_distance is inf or is_length(max_distance))
        if is_plain and (count := _count(origins)) < SORT_FROM:
            answers = empty((count, HIT_WIDTH))
            model = self.snapshot()
            if _cast_few.call(model.handle, origins, directions, max_distance, answers) == NO_ROW:
                record = RayHits()
                record._table = answers
                return record
        return record_of(RayHits, *self._cast(origins, directions, max_distance, workers, HIT_WIDTH))

    def cast_distance(
        self,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        *,
        max_distance: npt.ArrayLike = inf,
        workers: int = 1,
    ) -> Reals:
        """Return how far rays go until they hit something, m: the distances of `cast`, and faster.

        Parameters
        ----------
        origins : (..., 3) float64, m
            Where rays start. Shapes broadcast against *directions*.
        directions : (..., 3) float64
            Where they go; any length but zero.
        max_distance : float or (...) float64, m
            Look no farther along a ray than this; an array broadcasts against the leading shape of the rays.
        workers : int
            Threads; -1 for all cores.

        Returns
        -------
        (...) float64, m
            Of the broadcast leading shape; inf where nothing is hit, nan in a row that is not finite, or
            starts farther off than 1e100 part sizes.

        Raises
        ------
        QueryError
            If shapes or types do not fit, a direction is zero, *max_distance* is negative or nan, or
            *workers* is no number of threads.
        """
        is_plain = workers is ONE_THREAD and (max_distance is inf or is_length(max_distance))
        if is_plain and (count := _count(origins)) < SORT_FROM:
            distances = empty(count)
            model = self.snapshot()
            if _lengths_few.call(model.handle, origins, directions, max_distance, distances) == NO_ROW:
                return distances
        answers, shape = self._cast(origins, directions, max_distance, workers, DISTANCE_WIDTH)
        return answers.reshape(shape)[()]

    def _cast(
        self, origins: Any, directions: Any, max_distance: Any, workers: int, width: int
    ) -> tuple[np.ndarray, tuple[int, ...]]:
        """A table of answers so many columns wide, and the shape of the rays."""
        rays = as_points(origins, "origins"), as_points(directions, "directions")
        limits, (origins, directions) = broadcast_limits(
            max_distance, broadcast_rows(*rays, ("origins", "directions")), "rays"
        )
        starts, ways = origins, directions
        if origins.ndim != 2:
            starts, ways = origins.reshape(-1, 3), directions.reshape(-1, 3)
        answers = empty((len(starts), width))
        model = self.snapshot()
        is_sorted = len(starts) >= SORT_RAYS_FROM and model.reals.nbytes >= SORT_RAYS_IN
        if workers == 1 and workers is not True and not is_sorted and len(starts) <= LARGEST_SLICE:
            zero_row = cast_batch(model.handle, starts, ways, IN_ORDER, limits, answers)
        else:
            zero_row = _cast_in_slices(model, [starts, ways, limits, answers], workers, is_sorted)
        if zero_row != NO_ROW:
            raise QueryError(f"direction {zero_row} is zero, expected a vector with a length")
        return answers, origins.shape[:-1]

    def closest_to_segments(
        self,
        starts: npt.ArrayLike,
        ends: npt.ArrayLike,
        *,
        max_distance: npt.ArrayLike = inf,
        workers: int = 1,
    ) -> SegmentHits:
        """Return the shortest connections between segments and the surface.

        Parameters
        ----------
        starts, ends : (..., 3) float64, m
            Ends of the segments; shapes broadcast. A segment of no length is a point.
        max_distance : float or (...) float64, m
            Search no farther than this; an array broadcasts against the leading shape of the segments.
        workers : int
            Threads; -1 for all cores.

        Returns
        -------
        SegmentHits
            Arrays of the broadcast leading shape. A row that is not finite, or with an end farther off than
            1e100 part sizes, answers nan and `NO_FACE`.

        Raises
        ------
        QueryError
            If shapes or types do not fit, *max_distance* is negative or nan, or *workers* is no number of
            threads.

        Notes
        -----
        On the surface: a segment that crosses or touches it has distance 0; of several crossings the one
        nearest to the start is told.
        Ties: the lowest part; within a part any of the nearest faces, the same on every run.
        """
        is_plain = workers is ONE_THREAD and (max_distance is inf or is_length(max_distance))
        if is_plain and (count := _count(starts)) < SORT_FROM:
            answers = empty((count, segment_queries.ANSWER_WIDTH))
            model = self.snapshot()
            if _segments_few.call(model.handle, starts, ends, max_distance, answers):
                record = SegmentHits()
                record._table = answers
                return record
        return self._closest_to_segments(starts, ends, max_distance, workers)

    def _closest_to_segments(self, starts: Any, ends: Any, max_distance: Any, workers: int) -> SegmentHits:
        segments = as_points(starts, "starts"), as_points(ends, "ends")
        limits, (starts, ends) = broadcast_limits(
            max_distance, broadcast_rows(*segments, ("starts", "ends")), "segments"
        )
        here, there = starts.reshape(-1, 3), ends.reshape(-1, 3)
        answers = empty((len(here), segment_queries.ANSWER_WIDTH))
        model = self.snapshot()
        run_batch(
            lambda order, starts, ends, *others: segment_batch(model.handle, starts, ends, order, *others),
            [here, there, limits, answers],
            workers,
            _along_curve,
            first_slice(model.reals.nbytes),
        )
        return record_of(SegmentHits, answers, starts.shape[:-1])


def _along_curve(rows: np.ndarray, *_: np.ndarray) -> np.ndarray:
    order: np.ndarray = morton_order(rows)
    return order


def _distance_batch(handle: int, points: np.ndarray, order: np.ndarray, distances: np.ndarray) -> None:
    distance_batch(handle, points, order, inf, distances)


def _count(rows: Any) -> int:
    """How many rows these may be; too many where that is not to be told."""
    try:
        return len(rows)
    except TypeError:
        return SORT_FROM


def _cast_in_slices(model: Model, arrays: list[np.ndarray], workers: Any, is_sorted: bool) -> int:
    """Fill the answers to many rays; the lowest row whose direction is zero, or `NO_ROW`."""
    found = run_batch(
        lambda order, starts, ways, *others: cast_batch(model.handle, starts, ways, order, *others),
        arrays,
        workers,
        (lambda starts, ways, *_: ray_order(model.handle, starts, ways)) if is_sorted else None,
    )
    return min((first + row for first, row in found if row != NO_ROW), default=NO_ROW)
