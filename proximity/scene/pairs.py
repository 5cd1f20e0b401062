"""Queries of pairs of parts: their distance, and the nearest pairs of a scene."""

from enum import StrEnum
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from proximity import native
from proximity.checks import as_float64, not_negative, shown, whole
from proximity.errors import ArgumentError, SceneError
from proximity.kernels import answers
from proximity.kernels.entries import connect_pairs, connect_parts, decide_inside, list_pairs
from proximity.scene.model.assembly import Model
from proximity.scene.queries.html_table import html_table
from proximity.scene.queries.queries import model_with_parts
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
SURFACES = ("triangles", "cad")
"""Surfaces that a clearance or a penetration may be between."""
MIN_TOLERANCE = 1e-9
"""Relative to a depth: the search does not bring its bounds closer than this."""
_RELATIONS = tuple(Relation)
"""In the order of the numbers in kernels."""


class Clearance(NamedTuple):
    """The shortest connection between two parts, in the scene's frame.

    ``first`` and ``second`` are the parts' names. ``distance``, m, is 0 for parts that touch, cross, or
    contain one another, as in ``relation``. ``point_on_first`` and ``point_on_second``, (3,) m, are its ends:
    one point of both surfaces if the parts cross; the point of the inner surface that is nearest to the outer
    one if a part is inside the other. ``face_on_first`` and ``face_on_second`` are the faces of the ends;
    `NO_FACE` if a part is inside the other. The true distance is between ``lower``, m, and ``distance``,
    which are equal unless a tolerance or a budget ended the search early, or they are bounds of the distance
    between CAD surfaces.
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

    snapshot: Any

    def _state_with_rows(self, *names: str | int) -> tuple[Model, Any, list[int]]:
        """Return a model, the `SceneParts` that it is of, and the rows of the named parts."""
        model, parts = model_with_parts(self, self.snapshot)
        return model, parts, [parts.find(name) for name in names]

    def clearance(
        self,
        first: str | int,
        second: str | int,
        *,
        tolerance: float = 0.0,
        budget: int | None = None,
        surface: str = "triangles",
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
        surface : {"triangles", "cad"}
            Surfaces that the distance is between. With "cad", ``lower`` and ``distance`` are bounds of the
            distance between the CAD surfaces of STEP files: the deviations of both parts are subtracted and
            added (`Part.deviation`). The relation, the points and the faces are those of the triangles.

        Returns
        -------
        Clearance
            Exact up to rounding, without a tolerance or a budget. With "cad" and a part whose deviation is
            not known, ``lower`` is 0 and ``distance`` is ``inf``.

        Raises
        ------
        SceneError
            If a part does not exist, or both are the same.
        ArgumentError
            If the tolerance or the budget is out of range, or the surface is not one of the two.

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
        _check_surface(surface)
        model, parts, (row, other) = self._state_with_rows(first, second)
        if row == other:
            raise SceneError(f"{first!r} is asked how far it is from itself, expected two parts")
        found = connect(model, parts.solids, row, other, tolerance, steps)
        if surface == "triangles":
            return found
        # Read after the search: a part that was deformed in the meantime has an unknown deviation.
        return widened(found, parts[row].deviation + parts[other].deviation)

    def penetration(
        self,
        first: str | int,
        second: str | int,
        *,
        direction: Any = None,
        tolerance: float = 0.01,
        surface: str = "triangles",
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
        surface : {"triangles", "cad"}
            Surfaces between which the deepest point is. With "cad", ``deepest_lower`` and ``deepest`` are
            bounds for the CAD surfaces of STEP files: the deviations of both parts are subtracted and added
            (`Part.deviation`). A lower bound of 0 means that the parts may fit. The way out, and the point,
            are those of the triangles.

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
            If the direction is not three finite numbers, or zero, the tolerance is out of range, or the
            surface is not one of the two.

        Notes
        -----
        Degenerate: 0 for parts that are apart or touch; the direction is then that of their distance. Two
        open parts have no inside: ``lower`` and ``deepest`` are 0.
        Cost: 1 to 15 ms each for parts of 3 to 80 thousand faces; with a direction a third of it.
        Thread: as all queries.
        Source: directional penetration depth, Dobkin, Hershberger, Kirkpatrick, Suri 1993.
        """
        tolerance = max(not_negative("tolerance", tolerance, "shares"), MIN_TOLERANCE)
        _check_surface(surface)
        along = np.zeros(3) if direction is None else _direction(direction)
        model, parts, (row, other) = self._state_with_rows(first, second)
        if row == other:
            raise SceneError(f"{first!r} is asked how deep it is in itself, expected two parts")
        faces = parts.solids[row].surface_faces, parts.solids[other].surface_faces
        from proximity.scene import penetration  # not needed by other queries

        found = penetration.measure_exit(model, (row, other), faces, along, tolerance)
        deepest = penetration.DeepestPoint(0.0, 0.0, np.full(3, np.nan), 0)
        if found["depth"] > 0.0:
            deepest = penetration.find_deepest(model, row, other, tolerance)
        if surface == "cad":
            gap = connect(model, parts.solids, row, other).lower if found["depth"] == 0.0 else 0.0
            deviation = parts[row].deviation + parts[other].deviation
            lower, upper = widened_bounds(deepest.lower, deepest.upper, deviation)
            deepest = deepest._replace(lower=lower, upper=max(upper - gap, 0.0))
        out = float(found["depth"]), float(found["lower"]), found["direction"].copy()
        return penetration.Penetration(model.names[row], model.names[other], *out, *deepest[:3])

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
        count = None if most is None else whole("most", most, 0)
        model, _, rows = self._state_with_rows(*(() if of is None else (of,)))
        return nearest_pairs(model, limit, rows[0] if rows else -1, count)


def widened_bounds(lower: float, upper: float, deviation: float) -> tuple[float, float]:
    """Return the bounds of a length between CAD surfaces from those of one between triangles, m.

    *deviation*: sum of the deviations at both ends, m.
    """
    return max(lower - deviation, 0.0), upper + deviation


def widened(found: Clearance, deviation: float) -> Clearance:
    """Return a clearance with the bounds of the distance between CAD surfaces, as `widened_bounds`."""
    lower, distance = widened_bounds(found.lower, found.distance, deviation)
    return found._replace(lower=lower, distance=distance)


def connect(
    model: Model, solids: list[Solid], row: int, other: int, tolerance: float = 0.0, budget: int = 0
) -> Clearance:
    """Return the clearance of two parts of a model; *tolerance*, *budget*: as of `connect_parts`."""
    answer = np.empty(1, answers.CLEARANCE_ANSWER)
    connect_parts(model.packed, row, other, inf, tolerance, budget, answer)
    if answer["may_be_inside"][0]:
        faces = solids[row].surface_faces, solids[other].surface_faces
        decide_inside(model.packed, row, other, *faces, answer)
    return _clearance(model.names, row, other, answer[0])


def nearest_pairs(model: Model, limit: float, only: int, count: int | None) -> list[Clearance]:
    """Return the nearest pairs within *limit*, m: of the part *only*, or of all visible ones if it is -1."""
    arrays = _pair_search(model, limit, only, count)
    search = native.packed(arrays)
    list_pairs(model.packed, search)
    while connect_pairs(model.packed, search):
        pass  # where it can be interrupted
    found = int(arrays.search["found"][0])
    pairs = zip(arrays.pairs[:found].tolist(), arrays.answers[:found], strict=True)
    return [_clearance(model.names, one, other, answer) for (one, other), answer in pairs]


def deepest_of(queries: PairQueries, first: str, second: str, tolerance: float) -> "DeepestPoint":
    """Return the deepest point of two parts without their way out; *tolerance* as in `penetration`."""
    model, _, (row, other) = queries._state_with_rows(first, second)
    from proximity.scene.penetration import find_deepest

    return find_deepest(model, row, other, tolerance)


def _check_surface(surface: Any) -> None:
    if surface not in SURFACES:
        raise ArgumentError(f"surface is {shown(surface)}, expected one of {', '.join(SURFACES)}")


def _direction(direction: Any) -> np.ndarray:
    """Return a direction of nonzero length as an array."""
    vector = as_float64(direction, "direction", expected="three numbers")
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not 0.0 < length < inf:
        raise ArgumentError(f"direction is {shown(direction)}, expected three finite numbers, not all 0")
    return np.array(vector)


def _pair_search(model: Model, limit: float, only: int, most: int | None) -> answers.PairSearchArrays:
    """Return the arrays of the search of `nearest_pairs`."""
    parts, search = model.parts, np.zeros(1, answers.PAIR_SEARCH)
    search["limit"], search["only"] = limit, only
    others = len(parts) - 2
    count = others if only >= 0 else others * (others + 1) // 2
    rows = count if most is None else min(most, count)
    return answers.PairSearchArrays(
        search,
        np.empty(count),
        np.empty(count, np.int64),
        np.empty(2 * int(parts["face_count"][:-1].sum()), np.int32),
        np.empty((len(parts), 2), np.int64),
        np.empty((rows, 2), np.int32),
        np.empty(rows, answers.CLEARANCE_ANSWER),
    )


def _clearance(names: tuple[str, ...], first: int, second: int, answer: Any) -> Clearance:
    """Return an answer of kernels with the names of the parts."""
    lower, distance, points, faces, relation, _ = answer.tolist()
    one, other = np.array(points).reshape(2, 3)
    face, other_face = map(int, faces)
    return Clearance(
        names[first], names[second], distance, lower, _RELATIONS[relation], one, other, face, other_face
    )
