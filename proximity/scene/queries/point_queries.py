"""Queries of points: closest, distances, containment."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy import inf  # looked up in NumPy, it would cost calls of five points 2 %

from proximity.errors import NotWatertightError, ProximityError
from proximity.kernels.scene.point_queries import (
    POINT_ANSWER_WIDTH,
    closest_batch,
    contains_batch,
    distance_batch,
    signed_batch,
)
from proximity.scene.queries.batches import HasSnapshot
from proximity.scene.queries.checked_query import CheckedQuery
from proximity.scene.queries.results import ClosestPoints, Reals


def _no_inside(_: int) -> ProximityError:
    return NotWatertightError(
        "no part has an inside, so that nothing can be contained; sign_reason of each part says why"
    )


def _query(name: str, entry: object, width: int, dtype: type = np.float64) -> Callable[..., Any]:
    return CheckedQuery(name, entry, ("points",), "points", width, _no_inside, dtype=dtype).quick()


_closest = _query("closest_batch", closest_batch, POINT_ANSWER_WIDTH)
_signed_distance = _query("signed_batch", signed_batch, 1)
_distance = _query("distance_batch", distance_batch, 1)
_contains = _query("contains_batch", contains_batch, 1, np.bool_)


class PointQueries(HasSnapshot):
    """Queries of points, for what has a `Model`."""

    __slots__ = ()

    def closest(
        self, points: npt.ArrayLike, *, max_distance: npt.ArrayLike = inf, workers: int = 1
    ) -> ClosestPoints:
        """Return the surface points nearest to *points*, with signed distances.

        Parameters
        ----------
        points : (..., 3) float64, m
            Points to measure from. A point that is not finite, or farther away than 1e100 part sizes, is
            answered with nan and `NO_FACE`; the others are answered as usual.
        max_distance : float or (...) float64, m
            Search no farther than this. An array broadcasts against the leading shape of *points*, which
            then is that of both. It changes the cost, never an answer within it. Points deeper inside than
            this have no answer.
        workers : int
            Threads; -1 for all cores. The answers are the same, bit for bit.

        Returns
        -------
        ClosestPoints
            Arrays of the leading shape of *points* and *max_distance*.

        Raises
        ------
        ArgumentError
            If *points* are not numbers of shape (..., 3), *max_distance* is negative or nan or does not
            broadcast, or *workers* is not a number of threads.

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
        Thread: any number of threads may query; the interpreter lock is released.
        Source: Bærentzen & Aanæs 2005; Barill et al. 2018; see `kernels`.
        """
        record = ClosestPoints()
        record._table = _closest(self.snapshot(), points, max_distance, workers)
        return record

    def signed_distance(self, points: npt.ArrayLike, *, workers: int = 1) -> Reals:
        """Return signed distances, m, negative inside: as `closest`, and faster.

        Parameters
        ----------
        points : (..., 3) float64, m
            Points to measure from. A point that is not finite is answered with nan.
        workers : int
            Threads; -1 for all cores.

        Returns
        -------
        (...) float64, m

        Raises
        ------
        ArgumentError
            If *points* are not numbers of shape (..., 3), or *workers* is not a number of threads.
        """
        return _signed_distance(self.snapshot(), points, inf, workers)

    def distance(self, points: npt.ArrayLike, *, workers: int = 1) -> Reals:
        """Return distances to the nearest surface of any part, m, without sign: the fastest query.

        Parameters
        ----------
        points : (..., 3) float64, m
            Points to measure from. A point that is not finite is answered with nan.
        workers : int
            Threads; -1 for all cores.

        Returns
        -------
        (...) float64, m

        Raises
        ------
        ArgumentError
            If *points* are not numbers of shape (..., 3), or *workers* is not a number of threads.
        """
        return _distance(self.snapshot(), points, inf, workers)

    def contains(self, points: npt.ArrayLike, *, workers: int = 1) -> npt.NDArray[np.bool_]:
        """Return whether points are inside some part.

        Parameters
        ----------
        points : (..., 3) float64, m
            Points to test. A point that is not finite is not inside.
        workers : int
            Threads; -1 for all cores.

        Returns
        -------
        (...) bool
            On the surface itself: False.

        Raises
        ------
        ArgumentError
            If *points* are not numbers of shape (..., 3), or *workers* is not a number of threads.
        NotWatertightError
            If no part has an inside.
        """
        return _contains(self.snapshot(), points, inf, workers)
