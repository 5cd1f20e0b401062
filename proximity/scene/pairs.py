"""Questions about two parts: how far they are apart, and which of a scene are nearest to each other."""

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
from proximity.scene.solid import Solid

if TYPE_CHECKING:
    from proximity.scene.penetration import DeepestPoint, Penetration


class Relation(StrEnum):
    """How two parts lie to each other.

    ``TOUCHING``: the surfaces meet, to within rounding, 1e-13 of sizes, and the parts have no volume in
    common. ``CROSSING``: the surfaces meet and the parts have volume in common; faces cross, or lie flush
    with the material on the same side. Open parts cross where their faces do. ``FIRST_INSIDE`` and
    ``SECOND_INSIDE``: the whole part, or one of its surfaces, is inside the other part, and touches its
    surface in single points at most.
    """

    APART = "apart"
    TOUCHING = "touching"
    CROSSING = "crossing"
    FIRST_INSIDE = "first inside second"
    SECOND_INSIDE = "second inside first"


SHARING = (Relation.CROSSING, Relation.FIRST_INSIDE, Relation.SECOND_INSIDE)
"""Relations of parts with volume in common; open parts may cross without."""
LEAST_TOLERANCE = 1e-9
"""Of a depth: bounds that are nearer to each other are not looked for."""
_RELATIONS = tuple(Relation)
"""As kernels number them."""


class Clearance(NamedTuple):
    """The shortest connection between two parts, in the scene's frame.

    ``first`` and ``second`` are the parts' names. ``distance``, m, is 0 where they touch, cross, or one is
    inside the other: ``relation`` tells which. ``point_on_first`` and ``point_on_second``, (3,) m, are its
    ends. Where parts cross they are one point of both surfaces; where one part is inside the other, the point
    of the inner surface that is nearest to the outer one. ``face_on_first`` and
    ``face_on_second`` are the faces of the ends; `NO_FACE` where one part is inside the other. The true
    distance is between ``lower``, m, and ``distance``: they are equal but where a tolerance or a budget ended
    the search early.
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


class PairQueries:
    """What a scene answers about pairs of its parts."""

    _parts: Any
    snapshot: Any

    def _state_with_rows(self, *names: str | int) -> tuple[Model, list[Solid], list[int]]:
        """A model, the solids of its parts, and the rows of some."""
        while True:
            parts, model = self._parts, self.snapshot()
            if parts is self._parts:
                return model, parts.solids, [parts.find(name) for name in names]

    def clearance(
        self, first: str | int, second: str | int, *, tolerance: float = 0.0, budget: int | None = None
    ) -> Clearance:
        """Return the shortest distance between two parts, hidden or not, and where it is.

        Parameters
        ----------
        first, second : str or int
            Names or indices of two parts.
        tolerance : float
            The distance returned may be longer than the true one by this share of it; ``lower`` is a lower
            bound. 0 is exact.
        budget : int
            Steps of the search (boxes opened and groups of eight triangles compared) after which it ends
            with what it knows; None for as many as it takes.

        Returns
        -------
        Clearance
            Exact but for rounding, without a tolerance or a budget.

        Raises
        ------
        SceneError
            If there is no such part, or both are the same.
        ArgumentError
            If the tolerance or the budget is out of range.

        Notes
        -----
        Degenerate: a part that is not closed contains nothing. Common volumes thinner than 1e-9 of the size
        count as touching.
        Cost: 10 to 200 µs for parts of 3 to 80 thousand faces that are apart; several ms where large surfaces
        run along each other at a small distance.
        Thread: as all queries.
        """
        tolerance = not_negative("tolerance", tolerance, "shares")
        steps = 0 if budget is None else whole("budget", budget)
        model, solids, (row, other) = self._state_with_rows(first, second)
        if row == other:
            raise SceneError(f"{first!r} is asked how far it is from itself, expected two parts")
        answer = np.empty(1, answers.CLEARANCE_ANSWER)
        connect_parts(model.packed, row, other, inf, tolerance, steps, answer)
        if answer["may_be_inside"][0]:
            faces = solids[row].surface_faces, solids[other].surface_faces
            decide_inside(model.packed, row, other, *faces, answer)
        return _clearance(model.names, row, other, answer[0])

    def penetration(
        self, first: str | int, second: str | int, *, direction: Any = None, tolerance: float = 0.01
    ) -> "Penetration":
        """Return how deep two parts are in each other: the way out, and the deepest point.

        A screw in its hole comes free only along its axis, by its length, but where triangles stand for round
        surfaces no point of it is far inside the other part: compare ``deepest`` with a tolerance.

        Parameters
        ----------
        first, second : str or int
            Names or indices of two parts, hidden or not. For the way out the first one is moved.
        direction : (3,) array-like, scene's frame
            Direction of the way out. Default: a direction with a short way; the axes of both parts and the
            line between their middles are compared, and the best is turned to the normal at which the part
            comes free.
        tolerance : float
            Share by which the bounds of each depth may differ. They differ by more after 48 probes of the way
            out, where the part may be free for a moment before, and by 1e-7 of the smaller part's size for
            the deepest point, or after two million steps.

        Returns
        -------
        Penetration
            Bounds of the displacement at which the parts do not overlap for the first time, and of the
            largest distance of a point of their common volume to the surface of either part. They do not
            depend on how finely surfaces are divided. Along another direction the way out may be shorter.

        Raises
        ------
        SceneError
            If there is no such part, or both are the same.
        ArgumentError
            If the direction is not three finite numbers, or zero, or the tolerance is out of range.

        Notes
        -----
        Degenerate: 0 where the parts are apart, or touch; the direction is then that of their distance. Where
        both are open, ``lower`` is 0 and so is ``deepest``: they have no inside.
        Cost: 1 to 15 ms each for parts of 3 to 80 thousand faces; with a direction a third of it.
        Thread: as all queries.
        Source: directional penetration depth, Dobkin, Hershberger, Kirkpatrick, Suri 1993.
        """
        tolerance = max(not_negative("tolerance", tolerance, "shares"), LEAST_TOLERANCE)
        along = np.zeros(3) if direction is None else _direction(direction)
        model, solids, (row, other) = self._state_with_rows(first, second)
        if row == other:
            raise SceneError(f"{first!r} is asked how deep it is in itself, expected two parts")
        faces = solids[row].surface_faces, solids[other].surface_faces
        from proximity.scene import penetration  # other queries do not need it

        found = penetration.measure_exit(model, (row, other), faces, along, tolerance)
        deepest = penetration.DeepestPoint(0.0, 0.0, np.full(3, np.nan), 0)
        if found["depth"] > 0.0:
            deepest = penetration.find_deepest(model, row, other, tolerance)
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
            How many pairs to return at most; None for all.
        of : str or int
            Name or index of one part: only pairs of it and another part. It may be hidden.

        Returns
        -------
        list of Clearance
            Each as `clearance` returns it; of pairs at the same distance first those of the earlier parts.

        Raises
        ------
        SceneError
            If there is no such part.
        ArgumentError
            If ``max_distance`` or ``most`` is out of range.

        Notes
        -----
        Cost: that of `clearance` for every pair whose boxes are nearer than what is asked for.
        """
        limit = not_negative("max_distance", max_distance, "metres", may_be_infinite=True)
        count = None if most is None else whole("most", most, 0)
        model, _, rows = self._state_with_rows(*(() if of is None else (of,)))
        arrays = _pair_search(model, limit, rows[0] if rows else -1, count)
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


def _direction(direction: Any) -> np.ndarray:
    """A direction with a length."""
    vector = as_float64(direction, "direction", expected="three numbers")
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not 0.0 < length < inf:
        raise ArgumentError(f"direction is {shown(direction)}, expected three finite numbers, not all 0")
    return np.array(vector)


def _pair_search(model: Model, limit: float, only: int, most: int | None) -> answers.PairSearchArrays:
    """Arrays of a search for the nearest pairs, of one part if it is not -1, or of all visible ones."""
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
