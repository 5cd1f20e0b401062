"""Queries of pairs of parts: their distance, and the nearest pairs of a scene."""

from bisect import insort
from collections.abc import Iterator
from enum import StrEnum
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from proximity.checks import as_float64, not_negative, shown, whole
from proximity.errors import ArgumentError, SceneError
from proximity.kernels import answers
from proximity.kernels.entries import connect_parts, contains_corner
from proximity.kernels.layout import NO_FACE
from proximity.scene.html_table import html_table
from proximity.scene.model.assembly import Model
from proximity.scene.solid import Solid

if TYPE_CHECKING:
    from proximity.scene.penetration import DeepestPoint, Penetration


class Relation(StrEnum):
    """Position of two parts relative to each other.

    ``TOUCHING``: the surfaces meet, within rounding, 1e-13 of sizes, and the parts have no common volume.
    ``CROSSING``: the surfaces meet and the parts have a common volume; faces cross, or lie flush with the
    material on the same side. Open parts cross if their faces do. ``FIRST_INSIDE`` and ``SECOND_INSIDE``: the
    whole part, or one of its surfaces, is inside the other part, and touches its surface in single points at
    most.
    """

    APART = "apart"
    TOUCHING = "touching"
    CROSSING = "crossing"
    FIRST_INSIDE = "first inside second"
    SECOND_INSIDE = "second inside first"


SHARING = (Relation.CROSSING, Relation.FIRST_INSIDE, Relation.SECOND_INSIDE)
"""Relations of parts with common volume; open parts may cross without."""
WIDER = 1.0 + 2.0**-40
LEAST_TOLERANCE = 1e-9
"""Relative to a depth: the search does not bring its bounds closer than this."""
LEAST_LIMIT = 1e-12  # m
"""A search finds only shorter distances: these two make it find one that equals the limit, 0 included."""
_RELATIONS = {
    answers.APART: Relation.APART,
    answers.TOUCHES: Relation.TOUCHING,
    answers.CROSSES: Relation.CROSSING,
}


class Clearance(NamedTuple):
    """The shortest connection between two parts, in the scene's frame.

    ``first`` and ``second`` are the parts' names. ``distance``, m, is 0 for parts that touch, cross, or
    contain one another, as in ``relation``. ``point_on_first`` and ``point_on_second``, (3,) m, are its ends:
    one point of both surfaces if the parts cross; the point of the inner surface that is nearest to the outer
    one if a part is inside the other. ``face_on_first`` and ``face_on_second`` are the faces of the ends;
    `NO_FACE` if a part is inside the other. The true distance is between ``lower``, m, and ``distance``,
    which are equal unless a tolerance or a budget ended the search early.
    """

    first: str
    second: str
    distance: float
    lower: float
    relation: Relation
    point_on_first: np.ndarray
    point_on_second: np.ndarray
    face_on_first: int
    face_on_second: int

    def _repr_html_(self) -> str:
        return html_table("Clearance", self._fields, [self])


class PairQueries:
    """Queries of a scene about pairs of its parts."""

    _parts: Any
    snapshot: Any

    def _state_with_rows(self, *names: str | int) -> tuple[Model, list[Solid], list[int]]:
        """Return a model, the solids of its parts, and the rows of the named parts."""
        while True:
            parts, model = self._parts, self.snapshot()
            if parts is self._parts:
                return model, parts.solids, [parts.find(name) for name in names]

    def clearance(
        self, first: str | int, second: str | int, *, tolerance: float = 0.0, budget: int | None = None
    ) -> Clearance:
        """Return the shortest distance between two parts, hidden or not, and its ends.

        Parameters
        ----------
        first, second : str or int
            Names or indices of two parts.
        tolerance : float
            Relative tolerance: the distance returned may exceed the true one by this share of it; ``lower``
            is a lower bound. 0 is exact.
        budget : int
            Steps of the search (boxes opened and groups of eight triangles compared) after which it returns
            its present bounds; None for no limit.

        Returns
        -------
        Clearance
            Exact up to rounding, without a tolerance or a budget.

        Raises
        ------
        SceneError
            If a part does not exist, or both are the same.
        ArgumentError
            If the tolerance or the budget is out of range.

        Notes
        -----
        Degenerate: a part that is not closed contains nothing. Common volumes thinner than 1e-9 of the size
        count as touching.
        Cost: 10 to 200 µs for parts of 3 to 80 thousand faces that are apart; several ms if large surfaces
        are nearly parallel at a small distance.
        Thread: as all queries.
        """
        tolerance = not_negative("tolerance", tolerance, "shares")
        steps = 0 if budget is None else whole("budget", budget)
        model, solids, (row, other) = self._state_with_rows(first, second)
        if row == other:
            raise SceneError(f"{first!r} is asked how far it is from itself, expected two parts")
        return _clearance(model, solids, row, other, inf, tolerance, steps)

    def penetration(
        self, first: str | int, second: str | int, *, direction: Any = None, tolerance: float = 0.01
    ) -> "Penetration":
        """Return the penetration of two parts: the way out, and the deepest point.

        A screw in its hole comes free only along its axis, by its length, but no point of it is far inside
        the other part, as triangles approximate both round surfaces: compare ``deepest`` with a tolerance.

        Parameters
        ----------
        first, second : str or int
            Names or indices of two parts, hidden or not. The way out moves the first.
        direction : (3,) array-like, scene's frame
            Direction of the way out. Default: a direction with a short way; the axes of both parts and the
            line between their middles are compared, and the best is turned to the normal at which the part
            comes free.
        tolerance : float
            Relative difference allowed between the bounds of each depth. They differ by more after 48 probes
            of the way out, as the part may be free briefly before. The deepest point is found to 1e-7 of the
            smaller part's size at best, and in at most two million steps.

        Returns
        -------
        Penetration
            Bounds of the displacement at which the parts do not overlap for the first time, and of the
            largest distance of a point of their common volume to the surface of either part. They do not
            depend on the tessellation. Along another direction the way out may be shorter.

        Raises
        ------
        SceneError
            If a part does not exist, or both are the same.
        ArgumentError
            If the direction is not three finite numbers, or zero, or the tolerance is out of range.

        Notes
        -----
        Degenerate: 0 for parts that are apart or touch; the direction is then that of their distance. Two
        open parts have no inside: ``lower`` and ``deepest`` are 0.
        Cost: 1 to 15 ms each for parts of 3 to 80 thousand faces; with a direction a third of it.
        Thread: as all queries.
        Source: directional penetration depth, Dobkin, Hershberger, Kirkpatrick, Suri 1993.
        """
        tolerance = max(not_negative("tolerance", tolerance, "shares"), LEAST_TOLERANCE)
        along = None if direction is None else _unit(direction)
        model, solids, (row, other) = self._state_with_rows(first, second)
        if row == other:
            raise SceneError(f"{first!r} is asked how deep it is in itself, expected two parts")
        faces = solids[row].surface_faces, solids[other].surface_faces
        from proximity.scene import penetration  # not needed by other queries

        search = penetration.PenetrationSearch(model, row, other, faces)
        search.search(tolerance) if along is None else search.look_along(along, tolerance)
        deepest = penetration.DeepestPoint(0.0, 0.0, np.full(3, np.nan), 0)
        if search.depth > 0.0:
            deepest = penetration.find_deepest(model, row, other, tolerance)
        names = model.names
        return penetration.Penetration(
            names[row], names[other], search.depth, search.lower, search.direction, *deepest[:3]
        )

    def closest_pairs(
        self, *, max_distance: float = inf, most: int | None = None, of: str | int | None = None
    ) -> list[Clearance]:
        """Return the shortest connections of all pairs of visible parts, the nearest pair first.

        Parameters
        ----------
        max_distance : m
            Pairs that are farther apart are left out.
        most : int
            Largest number of pairs to return; None for all.
        of : str or int
            Name or index of one part: only its pairs are returned. It may be hidden.

        Returns
        -------
        list of Clearance
            Each as from `clearance`; pairs at the same distance are in the order of their parts.

        Raises
        ------
        SceneError
            If the part does not exist.
        ArgumentError
            If ``max_distance`` or ``most`` is out of range.

        Notes
        -----
        Cost: that of `clearance` for every pair whose boxes are within the limit.
        """
        limit = not_negative("max_distance", max_distance, "metres", may_be_infinite=True)
        if most is not None and whole("most", most, 0) == 0:
            limit = -1.0
        model, solids, rows = self._state_with_rows(*(() if of is None else (of,)))
        only = rows[0] if rows else None
        found: list[tuple[float, int, int, Clearance]] = []
        for gap, one, other in _pairs_by_gap(model, only):
            if gap > limit:
                break
            pair = _clearance(model, solids, one, other, max(limit * WIDER, LEAST_LIMIT))
            if pair.distance <= limit:
                insort(found, (pair.distance, one, other, pair))
                if most is not None and len(found) >= most:
                    del found[most:]
                    limit = min(limit, found[-1][0])
        return [pair for *_, pair in found]


def deepest_of(queries: PairQueries, first: str, second: str, tolerance: float) -> "DeepestPoint":
    """Return the deepest point of two parts without their way out; *tolerance* as in `penetration`."""
    model, _, (row, other) = queries._state_with_rows(first, second)
    from proximity.scene.penetration import find_deepest

    return find_deepest(model, row, other, tolerance)


def _unit(direction: Any) -> np.ndarray:
    """Return a direction scaled to length 1."""
    vector = as_float64(direction, "direction", expected="three numbers")
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not 0.0 < length < inf:
        raise ArgumentError(f"direction is {shown(direction)}, expected three finite numbers, not all 0")
    return vector / length


def _pairs_by_gap(model: Model, only: int | None) -> Iterator[tuple[float, int, int]]:
    """Yield the distances of the boxes of two parts, ascending, and their rows, the lower one first."""
    frames = model.frames[:-1]
    visible = np.flatnonzero(model.parts["is_hidden"][:-1] == 0)
    if only is None:
        at, behind = np.triu_indices(len(visible), 1)
        ones, others = visible[at], visible[behind]
    else:
        rest = visible[visible != only]
        ones, others = np.minimum(rest, only), np.maximum(rest, only)
    lower, upper = frames["box_lower"], frames["box_upper"]
    apart = np.maximum(lower[others] - upper[ones], lower[ones] - upper[others])
    gaps = np.linalg.norm(np.maximum(apart, 0.0), axis=1)
    for row in np.argsort(gaps, kind="stable"):
        yield float(gaps[row]) * (1.0 - 1e-12), int(ones[row]), int(others[row])


def _clearance(
    model: Model,
    solids: list[Solid],
    first: int,
    second: int,
    limit: float,
    tolerance: float = 0.0,
    budget: int = 0,
) -> Clearance:
    """Return the connection of two parts; if it is not shorter than *limit*, m, it may be inf."""
    answer, point, names = np.empty(1, answers.CLEARANCE_ANSWER), np.empty(3), model.names
    connect_parts(model.packed, first, second, limit, tolerance, budget, answer)
    lower, distance, _, (face, other_face), relation_row, may_be_inside = answer[0].tolist()
    relation = _RELATIONS[relation_row]
    if may_be_inside:
        for inner, outer, found in (
            (first, second, Relation.FIRST_INSIDE),
            (second, first, Relation.SECOND_INSIDE),
        ):
            if contains_corner(model.packed, outer, inner, solids[inner].surface_faces, point):
                lower, distance, face, other_face, relation = 0.0, 0.0, NO_FACE, NO_FACE, found
                if np.isnan(answer["points"][0, 0]):
                    connect_parts(model.packed, first, second, inf, 0.0, 0, answer)
                break
    one, other = answer["points"].reshape(2, 3)
    if relation == Relation.FIRST_INSIDE:
        other = one
    elif relation == Relation.SECOND_INSIDE:
        one = other
    return Clearance(
        names[first], names[second], distance, lower, relation, one, other, int(face), int(other_face)
    )
