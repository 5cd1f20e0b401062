"""The thinnest positions of a whole part, with a bound of its least wall thickness.

A wall is where a ray against the normal of a face leaves the material through a face that is parallel to it
within a given angle: the edge of a cube is not a thin wall, and the edge of a sharp wedge is. Rays from
samples of the surface find the thinnest walls, and `facing_faces` bounds the walls at all other points from
below.
"""

from math import cos, inf, pi
from typing import Any, NamedTuple

import numpy as np

from proximity.checks import not_negative, positive
from proximity.errors import ArgumentError
from proximity.scene.queries.html_table import html_table
from proximity.scene.solid import Solid
from proximity.scene.walls.facing_faces import Facing, least_facing
from proximity.scene.walls.thickness import (
    DISTANCE_ROUNDING,
    ends_of_rays,
    face_areas,
    face_normals,
    largest_coordinate,
    require_inside,
)

WALL_ANGLE = pi / 4
SAMPLES = 4_000
"""Number of squares with the side of the default resolution that cover the surface."""
DEFAULT_SAMPLES, MAX_SAMPLES = 100_000, 1_000_000
"""Largest number of samples with the default resolution, which else is enlarged, and with a given one."""
LARGEST_SAMPLE = 0.433 + 1e-3
"""Area of a triangle with equal edges of length 1."""
SINGLE_ROUNDING = 1e-7
"""Relative to the size: a wall thinner than a limit by less keeps it, as files have single precision."""
MAX_SLACK = 0.01
"""Relative to the limit, of the same."""
MAX_POSITIONS = 10
APART = 0.05
"""Distance between the positions that are listed, as a share of the size of the part."""
TOWARDS_MIDDLE = (0.3, 0.03, 3e-3, 3e-4, 3e-5, 3e-6)
"""Shares of the line from a corner of a polygon to its middle, at which the least thickness is measured."""


class ThinWalls(NamedTuple):
    """The thinnest walls of a part, in the scene's frame.

    The least thickness of a wall is between ``lower`` and ``upper``, m; both are inf if the part has no wall.
    ``point`` and ``opposite``, (3,) m, are the ends of the line of the length ``upper``. ``is_thin`` is True
    if a wall is thinner than the limit, False if certainly none is, and None if the bounds do not decide, or
    without a limit. ``share`` is the share of the sampled area that is thinner than the limit, nan without
    one.

    ``thickness`` (K,), ``points`` (K, 3), ``opposites`` (K, 3), m, and ``face_ids`` (K,) are the thinnest
    positions, the thinnest first; with a limit, only those below it. ``samples`` (N, 3, 3) are triangles of
    the surface with edges no longer than ``resolution``, m. ``sample_thickness`` (N,), m, is measured in
    their middle; inf where the part has no wall. ``part`` is the part's name.
    """

    part: str
    lower: float
    upper: float
    point: np.ndarray  # (3,) m
    opposite: np.ndarray  # (3,) m
    is_thin: bool | None
    share: float
    thickness: np.ndarray  # (K,) m
    points: np.ndarray  # (K, 3) m
    opposites: np.ndarray  # (K, 3) m
    face_ids: np.ndarray  # (K,) int32, rows of the part's faces
    resolution: float
    samples: np.ndarray  # (N, 3, 3) m, corners
    sample_thickness: np.ndarray  # (N,) m

    def _repr_html_(self) -> str:
        names = ("part", "lower", "upper", "is_thin", "share", "point", "opposite")
        cells = [str(each) if each is None else each for each in (getattr(self, name) for name in names)]
        return html_table("ThinWalls", names, [cells])


class _Walls(NamedTuple):
    """Walls at points of the surface, in the part's frame; inf without a wall."""

    thickness: np.ndarray  # (N,)
    point: np.ndarray  # (N, 3)
    opposite: np.ndarray  # (N, 3)
    face_id: np.ndarray  # (N,)


def find_thin_walls(part: Any, below: Any, resolution: Any, wall_angle: Any, workers: int) -> ThinWalls:
    """Return the thinnest walls of a part; the arguments are those of `Part.thin_places`."""
    limit = inf if below is None else positive("below", below, "metres")
    angle = not_negative("wall_angle", wall_angle, "radians", most=1.5)
    solid, size = part.solid, float(np.subtract(*part.solid.bounds[::-1]).max())
    require_inside(solid)
    corners = solid.mesh.vertices[solid.mesh.faces]
    samples, face_ids, step = _samples(corners, resolution)
    walls = _walls(solid, samples.mean(axis=1), face_ids, angle, workers)
    rounding = DISTANCE_ROUNDING * largest_coordinate(solid)
    longest = float(np.linalg.norm(np.subtract(*solid.bounds))) if size else 0.0
    thinnest = float(walls.thickness.min(initial=inf))
    lower, facing = least_facing(corners, min(thinnest + rounding, longest), cos(angle) - DISTANCE_ROUNDING)
    refined = _refined(solid, facing, angle, workers)
    found = _Walls(*(np.concatenate(each) for each in zip(walls, refined, strict=True)))
    least = float(found.thickness.min())
    best = int((found.thickness <= least + rounding).argmax())  # a sample if several are equal
    lower = inf if least == inf and not len(facing.distance) else max(min(lower, least - rounding), 0.0)
    upper = least + rounding
    slack = min(SINGLE_ROUNDING * size, MAX_SLACK * limit)
    is_below = found.thickness < limit - slack
    listed = np.flatnonzero(is_below & (found.thickness < inf))
    shown = _apart(found, listed, max(APART * size, 2.0 * step), 10.0 * rounding)
    is_thin = None if lower < limit - slack and upper >= limit - slack else upper < limit - slack
    pose, sample_area = part.pose, face_areas(samples)
    share = float(sample_area[is_below[: len(samples)]].sum() / sample_area.sum())
    return ThinWalls(
        part.name, lower, upper, pose.point(found.point[best]), pose.point(found.opposite[best]),
        None if below is None else is_thin, np.nan if below is None else share, found.thickness[shown],
        pose.point(found.point[shown]), pose.point(found.opposite[shown]), found.face_id[shown], step,
        pose.point(samples), walls.thickness,
    )  # fmt: skip


def _samples(corners: np.ndarray, resolution: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Return triangles that cover the surface, (N, 3, 3), their faces, and their longest edge allowed."""
    if resolution is not None:
        step = positive("resolution", resolution, "metres")
        cut = _cut(corners, step, max(MAX_SAMPLES, 2 * len(corners)))
        if cut is None:
            raise ArgumentError(
                f"resolution is {step:g} m: more than {MAX_SAMPLES} samples, expected a larger length"
            )
        return *cut, step
    step = float((face_areas(corners).sum() / SAMPLES) ** 0.5)
    while (cut := _cut(corners, step, max(DEFAULT_SAMPLES, 2 * len(corners)))) is None:
        step *= 1.5
    return *cut, step


def _cut(corners: np.ndarray, longest: float, most: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Cut triangles at the middle of their longest edges until none is longer than *longest*.

    Return the triangles and the rows of those that they are part of, or None for more than *most*.
    """
    if face_areas(corners).sum() > LARGEST_SAMPLE * longest**2 * most:
        return None
    ready, face_ids = [], []
    faces, count = np.arange(len(corners), dtype=np.int32), 0
    while len(corners):
        sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)  # side k: corners k, k + 1
        first = sides.argmax(axis=1)
        is_long = sides.max(axis=1) > longest
        ready.append(corners[~is_long])
        face_ids.append(faces[~is_long])
        rows = np.flatnonzero(is_long)
        a, b, c = (corners[rows, (first[rows] + k) % 3] for k in range(3))
        middle = 0.5 * (a + b)
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        faces = np.tile(faces[rows], 2)
        count += len(ready[-1])
        if count + len(corners) > most:
            return None
    return np.concatenate(ready), np.concatenate(face_ids)


def _walls(solid: Solid, points: np.ndarray, face_ids: np.ndarray, angle: float, workers: int) -> _Walls:
    """Return the walls at points of faces."""
    normals = face_normals(solid.mesh.vertices[solid.mesh.faces[face_ids]])
    ends = ends_of_rays(solid, points, normals, workers)
    is_wall = -(normals * ends.normal).sum(axis=1) >= cos(angle) - DISTANCE_ROUNDING  # nan fails
    return _Walls(np.where(is_wall, ends.length, inf), points, ends.point, face_ids)


def _refined(solid: Solid, facing: Facing, angle: float, workers: int) -> _Walls:
    """Return the walls near the corners of polygons, where the bound of the least thickness is attained."""
    lines = [facing.corner + share * (facing.middle - facing.corner) for share in TOWARDS_MIDDLE]
    face_ids = np.tile(facing.face_id, len(lines)).astype(np.int32)
    return _walls(solid, np.concatenate(lines), face_ids, angle, workers)


def _apart(walls: _Walls, rows: np.ndarray, distance: float, equal: float) -> np.ndarray:
    """Return the thinnest of some walls whose points are not nearer to each other than *distance*.

    Of those whose thickness differs by about *equal*, the first in *rows* is preferred.
    """
    rows = rows[np.argsort(np.round(walls.thickness[rows] / max(equal, 1e-300)), kind="stable")]
    chosen: list[int] = []
    while len(rows) and len(chosen) < MAX_POSITIONS:
        chosen.append(int(rows[0]))
        rows = rows[np.linalg.norm(walls.point[rows] - walls.point[rows[0]], axis=1) >= distance]
    return np.array(chosen, np.intp)
