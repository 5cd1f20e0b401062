"""Queries of a scene for several parts of each point, the nearest first."""

from typing import Any

import numpy as np
import numpy.typing as npt
from numpy import inf

from proximity.checks import whole
from proximity.errors import NotWatertightError, ProximityError
from proximity.kernels.answers import POINT_ANSWER_WIDTH
from proximity.kernels.entries import closest_parts_batch
from proximity.scene.model.assembly import Model
from proximity.scene.queries.checked_query import CheckedQuery
from proximity.scene.queries.queries import Ignored, Queries, _closest, model_with_parts
from proximity.scene.queries.results import ClosestPoints, Reals


class ClosestPartQueries(Queries):
    """Queries of points that answer for several parts."""

    __slots__ = ()

    def closest_parts(
        self,
        points: npt.ArrayLike,
        *,
        most: int,
        max_distance: npt.ArrayLike = inf,
        workers: int = 1,
        ignore: Ignored = None,
    ) -> ClosestPoints:
        """Return the nearest parts of each point, with the closest point of each.

        Parameters
        ----------
        points : (..., 3) float64, m
            Points to measure from. A point that is not finite, or farther away than 1e100 part sizes, is
            answered with nan and `NO_FACE`; the others are not affected.
        most : int
            Number of parts to report for each point, at least 1.
        max_distance : float or (...) float64, m
            Report no part that is farther away than this, or that contains the point more deeply. An array
            broadcasts against the leading shape of *points*.
        workers : int
            Threads; -1 for all cores. The answers are the same, bit for bit.
        ignore : str, int, or several
            Parts that this query leaves out, by name or index. An unknown one is a `SceneError`.

        Returns
        -------
        ClosestPoints
            Arrays of the leading shape of *points* and *max_distance*, followed by an axis of length *most*,
            in ascending order of the signed distance. Rows without a part have distance ``inf``, points nan,
            `NO_FACE` and `NO_PART`.

        Raises
        ------
        ArgumentError
            If *most* is not a whole number of at least 1, *points* are not numbers of shape (..., 3),
            *max_distance* is negative or nan or does not broadcast, or *workers* is not a number of threads.

        Notes
        -----
        Sign: per part, see `SignMethod`. Each row is the answer of `closest` with all other parts ignored:
        parts that contain the point come first, the deepest of them at the beginning. Outside all parts the
        first row is the answer of `closest`. A part without an inside counts with its distance.
        On the surface: distance 0, gradient is the pseudo-normal of the feature.
        Ties: the lower part first; within a part any of the nearest faces, the same on every run.
        Cost: for one part hardly more than `closest`; in batches about as much again for each further part,
        and up to a few times that for single points.
        Thread: any number of threads may query; the interpreter lock is released.
        """
        count = whole("most", most)
        record = ClosestPoints()
        model = self.snapshot() if ignore is None else self._ignoring(ignore)
        table = _query_of(model, count).ask(model, points, max_distance, workers)
        record._table = table.reshape((*table.shape[:-1], count, POINT_ANSWER_WIDTH))
        return record

    def signed_distance_bounds(
        self, points: npt.ArrayLike, *, workers: int = 1, ignore: Ignored = None
    ) -> tuple[Reals, Reals]:
        """Return bounds of the signed distances to the CAD surfaces of STEP files, negative inside.

        Parameters
        ----------
        points : (..., 3) float64, m
            Points to measure from. A point that is not finite is answered with nan.
        workers : int
            Threads; -1 for all cores.
        ignore : str, int, or several
            Parts that this query leaves out, by name or index. An unknown one is a `SceneError`.

        Returns
        -------
        lower, upper : (...) float64, m
            Both are the signed distance for parts from files of triangles. They are infinite if the
            deviation is not known: the lower one of any visible part, the upper one of the nearest part.

        Raises
        ------
        ArgumentError
            If *points* are not numbers of shape (..., 3), or *workers* is not a number of threads.

        Notes
        -----
        The signed distance to the triangles of a part differs from that to its CAD surfaces by at most
        `Part.deviation`, also near the surface, where the sign may differ. The upper bound has the deviation
        of the nearest part, the lower one the largest of all parts, any of which may be nearest.
        Cost: that of `closest`.
        """
        model, parts = model_with_parts(
            self, lambda: self.snapshot() if ignore is None else self._ignoring(ignore)
        )
        hits = ClosestPoints()
        hits._table = _closest(model, points, inf, workers)
        # Read after the search: a part that was deformed in the meantime has an unknown deviation.
        deviations = np.array([*(part.deviation for part in parts), 0.0])  # the last row: no part
        largest = deviations[:-1][model.parts["is_hidden"][:-1] == 0].max(initial=0.0)
        distances = hits.signed_distance
        return distances - largest, distances + deviations[hits.part]


def _query_of(model: Model, most: int) -> CheckedQuery:
    """Return the query for *most* parts of each point, whose answers are side by side in a row."""
    reported = min(most, len(model.parts) - 1)

    def fill(packed: Any, points: np.ndarray, order: np.ndarray, limits: np.ndarray, answers: Any) -> int:
        keys, slots = np.empty(reported), np.empty((reported, 2), np.int64)
        rows = answers.reshape(-1, POINT_ANSWER_WIDTH)
        return int(closest_parts_batch(packed, points, order, limits, keys, slots, rows))

    width = most * POINT_ANSWER_WIDTH
    return CheckedQuery("closest_parts_batch", fill, ("points",), "points", width, _no_refusal)


def _no_refusal(_: int) -> ProximityError:
    return NotWatertightError("no point is refused")
