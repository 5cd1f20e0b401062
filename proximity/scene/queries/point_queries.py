"""Queries of points: closest, distances, containment."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy import empty, inf  # looked up in NumPy, each would cost calls of five points 2 %

from proximity.arrays import as_points
from proximity.errors import NotWatertightError
from proximity.kernels.compiler import CompiledCall
from proximity.kernels.geometry.morton_order import SORT_FROM
from proximity.kernels.scene import small_batches
from proximity.kernels.scene.point_queries import (
    POINT_ANSWER_WIDTH,
    closest_batch,
    contains_batch,
    distance_batch,
    has_inside,
    signed_batch,
)
from proximity.scene.queries.batches import (
    ONE_THREAD,
    HasSnapshot,
    first_slice,
    morton_order_of,
    row_count,
    run_batch,
)
from proximity.scene.queries.query_arguments import broadcast_limits, is_length
from proximity.scene.queries.results import ClosestPoints, Reals, record_of

_closest_few = CompiledCall(small_batches.closest_few, small_batches.CLOSEST)
_signed_few = CompiledCall(small_batches.signed_few, small_batches.DISTANCE)
_distance_few = CompiledCall(small_batches.distance_few, small_batches.DISTANCE)
_contains_few = CompiledCall(small_batches.contains_few, small_batches.CONTAINS)


class PointQueries(HasSnapshot):
    """Queries of points, for what has a `Model`.

    Small batches of plain float64 are answered at once by compiled code; everything else is checked and
    sliced first, in methods of its own. The model is held by name while it is asked: what nobody holds is
    written anew when parts move.
    """

    __slots__ = ()

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
        normals of faces back to back cancel, there is no direction out: the gradient is 0.
        Cost: about O(log F) on the surface, O(√F) near one that is finely meshed, towards O(F) at centres of
        symmetry.
        Thread: any number of threads may ask; the interpreter lock is released.
        Source: Bærentzen & Aanæs 2005; Barill et al. 2018; see `kernels`.
        """
        is_plain = workers is ONE_THREAD and (max_distance is inf or is_length(max_distance))
        if is_plain and (count := row_count(points)) < SORT_FROM:
            answers = empty((count, POINT_ANSWER_WIDTH))
            model = self.snapshot()
            if _closest_few.call(model.handle, points, max_distance, answers):
                record = ClosestPoints()
                record._table = answers
                return record
        return self._closest(points, max_distance, workers)

    def _closest(self, points: Any, max_distance: Any, workers: int) -> ClosestPoints:
        limits, (points,) = broadcast_limits(max_distance, [as_points(points)], "points")
        rows = points.reshape(-1, 3)
        answers = empty((len(rows), POINT_ANSWER_WIDTH))
        model = self.snapshot()
        run_batch(
            lambda order, rows, limits, answers: closest_batch(model.handle, rows, order, limits, answers),
            [rows, limits, answers],
            workers,
            morton_order_of,
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

    def _distances(self, points: Any, workers: int, few: CompiledCall, batch: Callable[..., Any]) -> Any:
        """Signed or unsigned, by kernels for small batches and for large ones."""
        if workers is ONE_THREAD and (count := row_count(points)) < SORT_FROM:
            distances = empty(count)
            model = self.snapshot()
            if few.call(model.handle, points, distances):
                return distances
        return self._distances_of_any(as_points(points), workers, few, batch)

    def _distances_of_any(
        self, points: np.ndarray, workers: int, few: CompiledCall, batch: Callable[..., Any]
    ) -> Any:
        rows = points if points.ndim == 2 else points.reshape(-1, 3)
        distances = empty(len(rows))
        model = self.snapshot()
        is_certain = len(rows) < SORT_FROM and workers == 1 and workers is not True
        if not (is_certain and few.call(model.handle, rows, distances)):
            run_batch(
                lambda order, rows, distances: batch(model.handle, rows, order, distances),
                [rows, distances],
                workers,
                morton_order_of,
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
        if workers is ONE_THREAD and (count := row_count(points)) < SORT_FROM:
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
            morton_order_of,
            first_slice(model.reals.nbytes),
        )
        return inside.reshape(points.shape[:-1])[()]


def _distance_batch(handle: int, points: np.ndarray, order: np.ndarray, distances: np.ndarray) -> None:
    distance_batch(handle, points, order, inf, distances)
