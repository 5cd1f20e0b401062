"""The clearance between two parts: the shortest connection of their surfaces."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from proximity.errors import NotWatertightError
from proximity.scene.part import Part
from proximity.scene.scene import Scene


class Clearance(NamedTuple):
    """The shortest connection between two parts, in the scene's frame.

    ``distance``, m, is 0 where they touch, cross, or one is inside the other. ``point_on_first`` and
    ``point_on_second``, (3,) m, are its ends; where one part is inside the other, a point of both.
    """

    distance: float
    point_on_first: np.ndarray
    point_on_second: np.ndarray


def clearance(scene: Scene, first: str, second: str, *, workers: int = 1) -> Clearance:
    """Return the distance between two parts of a scene, hidden or not.

    Parameters
    ----------
    scene : Scene
        The scene of the parts; their present poses are used.
    first, second : str
        Names of the parts.
    workers : int
        Threads; -1 for all cores.

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
    The shortest connection between two triangles that do not intersect has an end on an edge of one of
    them. So the distance of the edges of each part from the other part is computed, for those edges only
    that may be nearer than the nearest vertex.
    """
    parts = scene.part(first), scene.part(second)
    others = _alone(parts[1]), _alone(parts[0])
    vertices = [part.pose.point(part.solid.mesh.vertices) for part in parts]
    edges = [_edges(part.solid.mesh.faces) for part in parts]
    reach = [other.distance(points, workers=workers) for other, points in zip(others, vertices, strict=True)]
    nearest = min(float(far[begins].min()) for far, (begins, _) in zip(reach, edges, strict=True))
    found = []
    for (begins, ends), points, far, other in zip(edges, vertices, reach, others, strict=True):
        lengths = np.linalg.norm(points[begins] - points[ends], axis=1)
        may_be_nearest = 0.5 * (far[begins] + far[ends] - lengths) <= nearest * (1.0 + 1e-12)
        begins, ends = begins[may_be_nearest], ends[may_be_nearest]
        hits = other.closest_to_segments(points[begins], points[ends], workers=workers)
        row = int(np.argmin(hits.distance))
        found.append((float(hits.distance[row]), hits.point_on_segment[row], hits.point_on_solid[row]))
    (one, on_first, to_second), (two, on_second, to_first) = found
    best = Clearance(one, on_first, to_second) if one <= two else Clearance(two, to_first, on_second)
    if best.distance > 0.0:
        for points, other in zip(vertices, others, strict=True):
            if _is_inside(other, points[0]):
                return Clearance(0.0, points[0], points[0])
    return best


def _alone(part: Part) -> Scene:
    """A scene of this part only, where it stands."""
    return Scene([replace(part, is_hidden=False)])


def _edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The vertices at both ends of each edge, every edge once."""
    pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique = np.unique(pairs, axis=0)
    return unique[:, 0], unique[:, 1]


def _is_inside(scene: Scene, point: np.ndarray) -> bool:
    try:
        return bool(scene.contains(point))
    except NotWatertightError:
        return False
