"""The clearance between two parts: the shortest connection of their surfaces."""

from typing import NamedTuple

import numpy as np

from proximity.errors import NotWatertightError
from proximity.kernels.layout import NO_FACE
from proximity.kernels.pair.part_query import (
    ANSWER_DISTANCE,
    ANSWER_FACES,
    ANSWER_POINTS,
    ANSWER_SIZE,
    connect_parts,
)
from proximity.scene.part import Part
from proximity.scene.scene import Scene


class Clearance(NamedTuple):
    """The shortest connection between two parts, in the scene's frame.

    ``distance``, m, is 0 where they touch, cross, or one is inside the other. ``point_on_first`` and
    ``point_on_second``, (3,) m, are its ends; where parts cross or one is inside the other, a point of both.
    ``face_on_first`` and ``face_on_second`` are the faces of the ends; `NO_FACE` where one part is inside the
    other.
    """

    distance: float
    point_on_first: np.ndarray
    point_on_second: np.ndarray
    face_on_first: int
    face_on_second: int


def clearance(scene: Scene, first: str, second: str) -> Clearance:
    """Return the distance between two parts of a scene, hidden or not.

    Parameters
    ----------
    scene : Scene
        The scene of the parts; their present poses are used.
    first, second : str
        Names of the parts.

    Returns
    -------
    Clearance
        Exact but for rounding.

    Raises
    ------
    SceneError
        If there is no such part.

    Notes
    -----
    Both parts' trees are walked at once, see `kernels.pair.walk`. Where no faces cross, each connected
    surface of one part is inside the other as a whole, or not at all: one point of each tells.
    """
    parts = scene.part(first), scene.part(second)
    model = scene.snapshot()
    rows = [model.names.index(name) for name in (first, second)]
    answer = np.empty(ANSWER_SIZE)
    # In this order whoever asks first: so both ways the answer is the same.
    is_swapped = rows[0] > rows[1]
    connect_parts(model.packed, min(rows), max(rows), np.inf, 0.0, 0, answer)
    points = answer[ANSWER_POINTS:ANSWER_FACES].reshape(2, 3)
    ends = (points[0], int(answer[ANSWER_FACES])), (points[1], int(answer[ANSWER_FACES + 1]))
    (one, face), (other, other_face) = ends[::-1] if is_swapped else ends
    if answer[ANSWER_DISTANCE] > 0.0 and _may_be_inside(model.frames[rows]):
        for part, around in (parts, parts[::-1]):
            inside = _inside(around, part)
            if len(inside):
                return Clearance(0.0, inside[0], inside[0], NO_FACE, NO_FACE)
    return Clearance(float(answer[ANSWER_DISTANCE]), one, other, face, other_face)


def _may_be_inside(frames: np.ndarray) -> bool:
    """Whether the boxes of two parts overlap."""
    return bool((frames["box_lower"].max(axis=0) <= frames["box_upper"].min(axis=0)).all())


def _inside(around: Part, part: Part) -> np.ndarray:
    """Those of a point of each connected surface of a part that another part contains; scene's frame."""
    points = part.pose.point(part.solid.surface_points)
    try:
        inside: np.ndarray = points[around.solid.contains(around.pose.inverse.point(points))]
    except NotWatertightError:
        return points[:0]
    return inside
