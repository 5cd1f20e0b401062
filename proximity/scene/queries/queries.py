"""Point, ray and segment queries, common to solids and scenes."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy import inf  # looked up in NumPy, it would add 2 % to calls of five points

from proximity.checks import shown
from proximity.errors import ArgumentError, NotWatertightError, ProximityError
from proximity.kernels.answers import (
    DISTANCE_WIDTH,
    POINT_ANSWER_WIDTH,
    RAY_ANSWER_WIDTH,
    SEGMENT_ANSWER_WIDTH,
)
from proximity.kernels.entries import (
    cast_batch,
    closest_batch,
    contains_batch,
    distance_batch,
    ray_order,
    segment_batch,
    signed_batch,
)
from proximity.scene.model.assembly import Model
from proximity.scene.queries.checked_query import MAX_SLICE, CheckedQuery, OrderOf
from proximity.scene.queries.crossings import crossings_of, first_hits_beyond, zero_direction
from proximity.scene.queries.results import ClosestPoints, RayCrossings, RayHits, Reals, SegmentHits

SORT_RAYS_FROM = 1024
"""Number of rays from which a batch is sorted."""
SORT_RAYS_IN = 1 << 20
"""Bytes of a model from which sorting pays: it costs 15 ns a ray, no less than it saves with a model that
fits into a nearer cache."""


ANY_DISTANCE = 0.0
"""The default of *min_distance*, which skips nothing."""


def _no_inside(_: int) -> ProximityError:
    return NotWatertightError(
        "no part has an inside, so that nothing can be contained; sign_reason of each part says why"
    )


def _query(name: str, entry: object, width: int, dtype: type = np.float64) -> Callable[..., Any]:
    return CheckedQuery(name, entry, ("points",), "points", width, _no_inside, dtype=dtype).quick()


def _order_of_rays(model: Model, count: int) -> tuple[OrderOf | None, int]:
    if count < SORT_RAYS_FROM or model.reals.nbytes < SORT_RAYS_IN:
        return None, MAX_SLICE
    return lambda origins, directions, *_: ray_order(model.packed, origins, directions), MAX_SLICE


def _ray_query(width: int) -> Callable[..., Any]:
    names = ("origins", "directions")
    return CheckedQuery(
        "cast_batch", cast_batch, names, "rays", width, zero_direction, _order_of_rays
    ).quick()


_closest = _query("closest_batch", closest_batch, POINT_ANSWER_WIDTH)
_signed_distance = _query("signed_batch", signed_batch, 1)
_distance = _query("distance_batch", distance_batch, 1)
_contains = _query("contains_batch", contains_batch, 1, np.bool_)
_cast, _cast_distance = _ray_query(RAY_ANSWER_WIDTH), _ray_query(DISTANCE_WIDTH)
_closest_to_segments = CheckedQuery(
    "segment_batch", segment_batch, ("starts", "ends"), "segments", SEGMENT_ANSWER_WIDTH, zero_direction
).quick()


Ignored = str | int | Iterable[str | int] | None
"""Parts that a query leaves out: a name or an index, several, or none."""


def model_with_parts(scene: Any, read: Callable[[], Model]) -> tuple[Model, Any]:
    """Return the model of a scene from *read*, and the `SceneParts` that it is of."""
    while True:
        parts, model = scene._parts, read()
        if parts is scene._parts:
            return model, parts


class Queries:
    """Distance, containment, ray and segment queries; a base class of owners of a `Model`."""

    __slots__ = ()

    def snapshot(self) -> Model:
        """Return the up-to-date arrays for queries."""
        raise NotImplementedError

    def _ignoring(self, ignore: Ignored) -> Model:
        """Return the same without the parts named; only a scene has some."""
        raise ArgumentError(f"ignore is {shown(ignore)}, but a solid has no parts that could be ignored")

    def closest(
        self,
        points: npt.ArrayLike,
        *,
        max_distance: npt.ArrayLike = inf,
        workers: int = 1,
        ignore: Ignored = None,
    ) -> ClosestPoints:
        """Return the surface points nearest to *points*, with signed distances.

        Parameters
        ----------
        points : (..., 3) float64, m
            Points to measure from. A point that is not finite, or farther away than 1e100 part sizes, is
            answered with nan and `NO_FACE`; the others are not affected.
        max_distance : float or (...) float64, m
            Search no farther than this. An array broadcasts against the leading shape of *points*; the answer
            has the common shape. The limit changes the cost, never an answer within it. Points deeper inside
            than this have no answer.
        workers : int
            Threads; -1 for all cores. The answers are the same, bit for bit.
        ignore : str, int, or several
            Parts of a scene that this query leaves out, by name or index. An unknown one is a
            `SceneError`.

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
        outside, a lower bound of the depth inside. A part without an inside counts with its distance.
        On the surface: distance 0, gradient is the pseudo-normal of the feature.
        Ties: the lowest part; within a part any of the nearest faces, the same on every run.
        Degenerate: faces without area answer as their edges. On them, and on edges and corners where the
        normals of faces back to back cancel, no direction is outward: the gradient is 0.
        Cost: about O(log F) on the surface, O(√F) near a finely meshed one, towards O(F) at centres of
        symmetry.
        Thread: any number of threads may query; the interpreter lock is released.
        Source: Bærentzen & Aanæs 2005; Barill et al. 2018; see `kernels`.
        """
        record = ClosestPoints()
        model = self.snapshot() if ignore is None else self._ignoring(ignore)
        record._table = _closest(model, points, max_distance, workers)
        return record

    def signed_distance(self, points: npt.ArrayLike, *, workers: int = 1, ignore: Ignored = None) -> Reals:
        """Return signed distances, m, negative inside: as `closest`, and faster.

        Parameters
        ----------
        points : (..., 3) float64, m
            Points to measure from. A point that is not finite is answered with nan.
        workers : int
            Threads; -1 for all cores.
        ignore : str, int, or several
            Parts of a scene that this query leaves out, by name or index. An unknown one is a
            `SceneError`.

        Returns
        -------
        (...) float64, m

        Raises
        ------
        ArgumentError
            If *points* are not numbers of shape (..., 3), or *workers* is not a number of threads.
        """
        model = self.snapshot() if ignore is None else self._ignoring(ignore)
        return _signed_distance(model, points, inf, workers)

    def distance(self, points: npt.ArrayLike, *, workers: int = 1, ignore: Ignored = None) -> Reals:
        """Return distances to the nearest surface of any part, m, without sign: the fastest query.

        Parameters
        ----------
        points : (..., 3) float64, m
            Points to measure from. A point that is not finite is answered with nan.
        workers : int
            Threads; -1 for all cores.
        ignore : str, int, or several
            Parts of a scene that this query leaves out, by name or index. An unknown one is a
            `SceneError`.

        Returns
        -------
        (...) float64, m

        Raises
        ------
        ArgumentError
            If *points* are not numbers of shape (..., 3), or *workers* is not a number of threads.
        """
        model = self.snapshot() if ignore is None else self._ignoring(ignore)
        return _distance(model, points, inf, workers)

    def contains(
        self, points: npt.ArrayLike, *, workers: int = 1, ignore: Ignored = None
    ) -> npt.NDArray[np.bool_]:
        """Return whether points are inside some part.

        Parameters
        ----------
        points : (..., 3) float64, m
            Points to test. A point that is not finite is not inside.
        workers : int
            Threads; -1 for all cores.
        ignore : str, int, or several
            Parts of a scene that this query leaves out, by name or index. An unknown one is a
            `SceneError`.

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
        model = self.snapshot() if ignore is None else self._ignoring(ignore)
        return _contains(model, points, inf, workers)

    def cast(
        self,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        *,
        max_distance: npt.ArrayLike = inf,
        min_distance: npt.ArrayLike = ANY_DISTANCE,
        workers: int = 1,
        ignore: Ignored = None,
    ) -> RayHits:
        """Return the first hits of rays.

        Parameters
        ----------
        origins : (..., 3) float64, m
            Starting points of the rays. Shapes broadcast against *directions*.
        directions : (..., 3) float64
            Directions of the rays; any length except zero.
        max_distance : float or (...) float64, m
            Search no farther along a ray than this; an array broadcasts against the leading shape of the
            rays.
        min_distance : float or (...) float64, m
            Skip hits that are nearer than this; an array broadcasts as *max_distance* does.
        workers : int
            Threads; -1 for all cores.
        ignore : str, int, or several
            Parts of a scene that this query leaves out, by name or index. An unknown one is a
            `SceneError`.

        Returns
        -------
        RayHits
            Arrays of the broadcast leading shape. A row that is not finite, or starts farther away than
            1e100 part sizes, answers nan and `NO_FACE`.

        Raises
        ------
        ArgumentError
            If shapes or types do not fit, a direction is zero, a distance is negative or nan, or *workers*
            is not a number of threads.

        Notes
        -----
        On the surface: a ray that starts there hits at distance 0.
        Ties: the lowest part; within a part any of the faces, the same on every run.
        Degenerate: a ray never passes through an edge or corner of a closed surface. A face parallel to the
        ray is not hit.
        Source: Woop, Benthin, Wald 2013, "Watertight ray/triangle intersection".
        """
        record = RayHits()
        model = self.snapshot() if ignore is None else self._ignoring(ignore)
        if min_distance is ANY_DISTANCE:
            record._table = _cast(model, origins, directions, max_distance, workers)
        else:
            limits = min_distance, max_distance
            record._table = first_hits_beyond(model, origins, directions, limits, workers)
        return record

    def cast_all(
        self,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        *,
        max_distance: npt.ArrayLike = inf,
        min_distance: npt.ArrayLike = ANY_DISTANCE,
        workers: int = 1,
        ignore: Ignored = None,
    ) -> RayCrossings:
        """Return every crossing of rays with surfaces, in order along each ray.

        Parameters
        ----------
        origins : (..., 3) float64, m
            Starting points of the rays. Shapes broadcast against *directions*.
        directions : (..., 3) float64
            Directions of the rays; any length except zero.
        max_distance : float or (...) float64, m
            Look no farther along a ray than this; an array broadcasts against the leading shape of the rays.
        min_distance : float or (...) float64, m
            Leave out crossings that are nearer than this; an array broadcasts as *max_distance* does.
        workers : int
            Threads; -1 for all cores.
        ignore : str, int, or several
            Parts of a scene that this query leaves out, by name or index. An unknown one is a
            `SceneError`.

        Returns
        -------
        RayCrossings
            Arrays over all crossings, and ``offsets`` of the rays; ``crossings[k]`` has those of ray k. A row
            that is not finite, or starts farther away than 1e100 part sizes, has none and is not
            ``is_valid``.

        Raises
        ------
        ArgumentError
            If shapes or types do not fit, a direction is zero, a distance is negative or nan, or *workers*
            is not a number of threads.

        Notes
        -----
        On the surface: a ray that starts there has a crossing at distance 0, unless it only touches.
        Ties: crossings of several parts at one distance are in the order of the parts.
        Degenerate: a ray through an edge or a corner, along an edge or within a face counts as if it were
        shifted sideways by an infinitesimal amount, the same for all faces of a part. A shared edge or corner
        is one crossing if the ray changes its side there, and none if it only touches, although `cast`
        reports a touch as a hit. Crossings of one part closer together than 2^-46 of the size of the scene,
        or of their distance if that is larger, are merged: one crossing if the side changes, else none. The
        crossings of a closed part that does not intersect itself therefore alternate, and their number is odd
        if the origin is inside. A face that is parallel to the ray is not crossed; rounding decides on which
        side of its plane a ray in that plane passes.
        Source: Edelsbrunner & Mücke 1990, "Simulation of simplicity"; Woop, Benthin, Wald 2013,
        "Watertight ray/triangle intersection".
        """
        limits = min_distance, max_distance
        model = self.snapshot() if ignore is None else self._ignoring(ignore)
        return crossings_of(model, origins, directions, limits, workers)

    def cast_distance(
        self,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        *,
        max_distance: npt.ArrayLike = inf,
        workers: int = 1,
        ignore: Ignored = None,
    ) -> Reals:
        """Return the distances of `cast`, m, faster than `cast`.

        Parameters
        ----------
        origins : (..., 3) float64, m
            Starting points of the rays. Shapes broadcast against *directions*.
        directions : (..., 3) float64
            Directions of the rays; any length except zero.
        max_distance : float or (...) float64, m
            Search no farther along a ray than this; an array broadcasts against the leading shape of the
            rays.
        workers : int
            Threads; -1 for all cores.
        ignore : str, int, or several
            Parts of a scene that this query leaves out, by name or index. An unknown one is a
            `SceneError`.

        Returns
        -------
        (...) float64, m
            Of the broadcast leading shape; inf for a ray without a hit, nan in a row that is not finite, or
            starts farther away than 1e100 part sizes.

        Raises
        ------
        ArgumentError
            If shapes or types do not fit, a direction is zero, *max_distance* is negative or nan, or
            *workers* is not a number of threads.
        """
        model = self.snapshot() if ignore is None else self._ignoring(ignore)
        return _cast_distance(model, origins, directions, max_distance, workers)

    def closest_to_segments(
        self,
        starts: npt.ArrayLike,
        ends: npt.ArrayLike,
        *,
        max_distance: npt.ArrayLike = inf,
        workers: int = 1,
        ignore: Ignored = None,
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
        ignore : str, int, or several
            Parts of a scene that this query leaves out, by name or index. An unknown one is a
            `SceneError`.

        Returns
        -------
        SegmentHits
            Arrays of the broadcast leading shape. A row that is not finite, or with an end farther off than
            1e100 part sizes, answers nan and `NO_FACE`.

        Raises
        ------
        ArgumentError
            If shapes or types do not fit, *max_distance* is negative or nan, or *workers* is not a number
            of threads.

        Notes
        -----
        On the surface: a segment that crosses or touches it has distance 0; the crossing nearest to the start
        is reported.
        Ties: the lowest part; within a part any of the nearest faces, the same on every run.
        """
        record = SegmentHits()
        model = self.snapshot() if ignore is None else self._ignoring(ignore)
        record._table = _closest_to_segments(model, starts, ends, max_distance, workers)
        return record
