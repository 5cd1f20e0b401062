"""Queries of rays and segments."""

from typing import Any

import numpy as np
import numpy.typing as npt
from numpy import empty, inf  # looked up in NumPy, each would cost calls of five rays 2 %

from proximity.arrays import as_points
from proximity.errors import QueryError
from proximity.kernels.compiler import CompiledCall
from proximity.kernels.geometry.morton_order import SORT_FROM
from proximity.kernels.layout import NO_ROW
from proximity.kernels.ray.hit_rows import DISTANCE_WIDTH, RAY_ANSWER_WIDTH
from proximity.kernels.ray.ray_order import ray_order
from proximity.kernels.scene import small_batches
from proximity.kernels.scene.ray_queries import cast_batch
from proximity.kernels.scene.segment_queries import SEGMENT_ANSWER_WIDTH, segment_batch
from proximity.model.assembly import Model
from proximity.scene.queries.batches import (
    IN_ORDER,
    LARGEST_SLICE,
    ONE_THREAD,
    HasSnapshot,
    first_slice,
    morton_order_of,
    row_count,
    run_batch,
)
from proximity.scene.queries.query_arguments import broadcast_limits, broadcast_rows, is_length
from proximity.scene.queries.results import RayHits, Reals, SegmentHits, record_of

SORT_RAYS_FROM = 1024
"""Rays from which on a batch is sorted."""
SORT_RAYS_IN = 1 << 20
"""Bytes of a model from which on that is worth it: it costs 15 ns a ray; in one that fits into a nearer cache
it spares no more than that."""

_cast_few = CompiledCall(small_batches.cast_few, small_batches.CAST)
_lengths_few = CompiledCall(small_batches.lengths_few, small_batches.LENGTHS)
_segments_few = CompiledCall(small_batches.segments_few, small_batches.SEGMENTS)


class LineQueries(HasSnapshot):
    """Queries of rays and segments, for what has a `Model`; small batches as in `PointQueries`."""

    __slots__ = ()

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
        if is_plain and (count := row_count(origins)) < SORT_FROM:
            answers = empty((count, RAY_ANSWER_WIDTH))
            model = self.snapshot()
            if _cast_few.call(model.handle, origins, directions, max_distance, answers) == NO_ROW:
                record = RayHits()
                record._table = answers
                return record
        return record_of(RayHits, *self._cast(origins, directions, max_distance, workers, RAY_ANSWER_WIDTH))

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
        if is_plain and (count := row_count(origins)) < SORT_FROM:
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
        starts, flat_directions = origins, directions
        if origins.ndim != 2:
            starts, flat_directions = origins.reshape(-1, 3), directions.reshape(-1, 3)
        answers = empty((len(starts), width))
        model = self.snapshot()
        is_sorted = len(starts) >= SORT_RAYS_FROM and model.reals.nbytes >= SORT_RAYS_IN
        if workers == 1 and workers is not True and not is_sorted and len(starts) <= LARGEST_SLICE:
            zero_row = cast_batch(model.handle, starts, flat_directions, IN_ORDER, limits, answers)
        else:
            zero_row = _cast_in_slices(model, [starts, flat_directions, limits, answers], workers, is_sorted)
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
        nearest to the start is reported.
        Ties: the lowest part; within a part any of the nearest faces, the same on every run.
        """
        is_plain = workers is ONE_THREAD and (max_distance is inf or is_length(max_distance))
        if is_plain and (count := row_count(starts)) < SORT_FROM:
            answers = empty((count, SEGMENT_ANSWER_WIDTH))
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
        flat_starts, flat_ends = starts.reshape(-1, 3), ends.reshape(-1, 3)
        answers = empty((len(flat_starts), SEGMENT_ANSWER_WIDTH))
        model = self.snapshot()
        run_batch(
            lambda order, starts, ends, *others: segment_batch(model.handle, starts, ends, order, *others),
            [flat_starts, flat_ends, limits, answers],
            workers,
            morton_order_of,
            first_slice(model.reals.nbytes),
        )
        return record_of(SegmentHits, answers, starts.shape[:-1])


def _cast_in_slices(model: Model, arrays: list[np.ndarray], workers: Any, is_sorted: bool) -> int:
    """Fill the answers to many rays; the lowest row whose direction is zero, or `NO_ROW`."""
    found = run_batch(
        lambda order, starts, flat_directions, *others: cast_batch(
            model.handle, starts, flat_directions, order, *others
        ),
        arrays,
        workers,
        (lambda starts, flat_directions, *_: ray_order(model.handle, starts, flat_directions))
        if is_sorted
        else None,
    )
    return min((first + row for first, row in found if row != NO_ROW), default=NO_ROW)
