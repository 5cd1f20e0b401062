"""Starting positions of the search for the worst positions.

They are random in the box within reach of a hand, near surfaces, and at positions where queries are known to
be costly, equally far from several faces: centres of balls that touch the surface at a sample and shrink
until their inside is empty, middles of parts, and centres of balls fitted to parts.
"""

import numpy as np

from proximity.lab.certificate.subject import Subject
from proximity.lab.certificate.work import GROUP
from proximity.scene.part import Part
from proximity.scene.scene import Scene

NEAR_DISTANCE = 0.02
"""m, of positions near the surface from it: normally distributed."""
SHRINKS = 12
"""Maximum shrinkings of a ball; it converges to the medial axis like Newton's method, in four or five."""
CLOSE = 1e-9
"""Share of a ball's radius by which it may finally be too large."""
SAME = 1e-9
"""Share of the scene's diagonal within which two points of the surface are one."""
MAX_MIDDLES = 200
"""Parts whose middles are used."""
MEDIAL_BUDGET = 500
"""Budget for the nearest face of a ball's centre: a nearby face shrinks it as well."""


def starting_positions(
    subject: Subject, counts: tuple[int, int, int], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return starting positions, (K, 3) m, and the origin of each, (K,) text."""
    scene, reach = subject.scene, subject.working_range
    lower, upper = scene.bounds
    random = rng.uniform(lower - reach, upper + reach, (counts[0], 3))
    points, normals = surface_samples(scene, counts[1], rng)
    near = points + rng.normal(0.0, NEAR_DISTANCE, (len(points), 1)) * normals
    medial = medial_positions(subject, *surface_samples(scene, counts[2], rng))
    found = {"random": random, "near the surface": near, "medial": medial, "centre": centres(scene)}
    return np.concatenate(list(found.values())), np.repeat(list(found), list(map(len, found.values())))


def surface_samples(scene: Scene, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return points of the surface, evenly by area, and the faces' normals there, (K, 3) each."""
    corners = [part.pose.point(part.solid.mesh.vertices[part.solid.mesh.faces]) for part in _shown(scene)]
    areas = np.concatenate([_area_vectors(each) for each in corners])
    sizes = np.linalg.norm(areas, axis=1)
    if count == 0 or not sizes.sum() > 0.0:
        return np.zeros((0, 3)), np.zeros((0, 3))
    chosen = rng.choice(len(sizes), count, p=sizes / sizes.sum())
    weights = rng.dirichlet((1.0, 1.0, 1.0), count)
    triangles = np.concatenate(corners)[chosen]
    return (weights[:, :, None] * triangles).sum(axis=1), areas[chosen] / sizes[chosen, None]


def medial_positions(subject: Subject, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return centres of empty balls that touch the surface at points, on both sides, (2 K, 3).

    *points*, *normals*: (K, 3).

    Source: Ma, Bae & Choi 2012, "3D medial axis point approximation using nearest neighbors and the normal
    field"; here the neighbours are the surface itself.
    """
    lower, upper = subject.scene.bounds
    touching, directions = np.concatenate([points, points]), np.concatenate([normals, -normals])
    extent = float(np.linalg.norm(upper - lower))
    radii = np.full(len(touching), extent + subject.working_range)
    for _ in range(SHRINKS):
        ends = touching + radii[:, None] * directions
        arms = nearest_points(subject, ends) - touching
        along, squares = 2.0 * (arms * directions).sum(axis=1), (arms**2).sum(axis=1)
        # A ball is empty if its centre is nearest to its own surface point, within rounding.
        is_other = (along > 0.0) & (squares > (SAME * extent) ** 2)
        smaller = np.divide(squares, along, out=radii.copy(), where=is_other)
        is_less = (smaller < radii * (1.0 - CLOSE)) & (smaller > 0.0)
        if not is_less.any():
            break
        radii[is_less] = smaller[is_less]
    return np.asarray(touching + radii[:, None] * directions)


def nearest_points(subject: Subject, positions: np.ndarray) -> np.ndarray:
    """Return surface points nearest, or nearly nearest if that is costly, to points, (K, 3)."""
    tracker = subject.tracker(fingers=GROUP, budget=MEDIAL_BUDGET)
    found, tips = np.empty_like(positions), np.full((GROUP, 3), np.nan)
    for first in range(0, len(positions), GROUP):
        group = positions[first : first + GROUP]
        tips[: len(group)] = group
        tracker.reset()
        found[first : first + GROUP] = tracker.tick(tips, 0, 0)["point_on_part"][: len(group)]
    return found


def centres(scene: Scene) -> np.ndarray:
    """Return middles of parts, means of their corners, and centres of balls fitted to them, (K, 3) m."""
    found = [np.mean(scene.bounds, axis=0)]
    for part in _shown(scene)[:MAX_MIDDLES]:
        corners = part.pose.point(part.solid.mesh.vertices)
        found += [
            0.5 * (corners.min(axis=0) + corners.max(axis=0)),
            corners.mean(axis=0),
            _fitted_centre(corners),
        ]
    positions = np.array(found)
    return positions[np.isfinite(positions).all(axis=1)]


def _fitted_centre(corners: np.ndarray) -> np.ndarray:
    """Return the centre of the least-squares ball: |p|^2 = 2 c p + (r^2 - |c|^2), linear in the unknowns."""
    middle = corners.mean(axis=0)
    arms = corners - middle
    terms = np.concatenate([2.0 * arms, np.ones((len(arms), 1))], axis=1)
    solved = np.linalg.lstsq(terms, (arms**2).sum(axis=1), rcond=None)[0]
    return np.asarray(middle + solved[:3])


def _area_vectors(corners: np.ndarray) -> np.ndarray:
    return 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _shown(scene: Scene) -> list[Part]:
    return [part for part in scene.parts if not part.is_hidden]
