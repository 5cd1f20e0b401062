"""The clearance between two parts: the shortest connection of their surfaces."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from proximity.errors import NotWatertightError
from proximity.kernels.mesh.edges import connected
from proximity.scene.part import Part
from proximity.scene.scene import Scene

ROUNDING = 1e-12
"""Of distances, relative to them and to coordinates: edges within it may be the nearest."""


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
        rounding = ROUNDING * (nearest + np.abs(points).max())
        may_be_nearest = 0.5 * (far[begins] + far[ends] - lengths) <= nearest + rounding
        if not may_be_nearest.any():
            continue  # the edges of the other part are nearer
        begins, ends = begins[may_be_nearest], ends[may_be_nearest]
        hits = other.closest_to_segments(points[begins], points[ends], workers=workers)
        row = int(np.argmin(hits.distance))
        ends_of_it = hits.point_on_segment[row], hits.point_on_solid[row]
        found.append(Clearance(float(hits.distance[row]), *ends_of_it[:: 1 if other is others[0] else -1]))
    best = min(found, key=lambda each: each.distance)
    if best.distance > 0.0:  # no surfaces cross: each connected one is inside as a whole, or not at all
        for points, (begins, ends), other in zip(vertices, edges, others, strict=True):
            labels = connected(len(points), begins, ends)[begins]
            inside = _inside(other, points[begins[np.unique(labels, return_index=True)[1]]])
            if len(inside):
                return Clearance(0.0, inside[0], inside[0])
    return best


def _alone(part: Part) -> Scene:
    """A scene of this part only, where it stands."""
    return Scene([replace(part, is_hidden=False)])


def _edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The vertices at both ends of each edge, every edge once."""
    pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    begins, ends = np.unique(pairs, axis=0).T.astype(np.int64, order="C")
    return begins, ends


def _inside(scene: Scene, points: np.ndarray) -> np.ndarray:
    """Those of the points that a part contains."""
    try:
        inside: np.ndarray = points[scene.contains(points)]
    except NotWatertightError:
        return points[:0]
    return inside
