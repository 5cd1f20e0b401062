"""Upper bounds of the distance of triangles from surfaces of elementary form.

Arrays have a row for each triangle or point, with the surface of that row. Bounds are exact for planes, cones
(a cylinder is a cone with a tangent of 0) and spheres. Those of tori are refined by subdivision.
"""

from typing import NamedTuple

import numpy as np

MAX_LEVEL = 6
"""Maximum number of subdivisions of a triangle."""
MAX_RATIO = 1.1
"""Subdivision ends at this ratio of the bound to the largest distance found."""
MAX_TRIANGLES = 200_000
"""Maximum number of triangles of one subdivision."""


class Surfaces(NamedTuple):
    """Surfaces of one kind, one for each row."""

    origin: np.ndarray  # (N, 3) m
    axis: np.ndarray  # (N, 3) unit
    size: np.ndarray  # (N,) m, radius at the origin, or major radius
    second: np.ndarray  # (N,) tangent of a cone, or minor radius, m

    def rows(self, rows: np.ndarray) -> "Surfaces":
        """Return the surfaces of some rows."""
        return Surfaces(*(column[rows] for column in self))


def signed_distances(kind: str, surfaces: Surfaces, points: np.ndarray) -> np.ndarray:
    """Return the signed distances of points from surfaces.

    *points*: (N, ..., 3) m; the result has the shape (N, ...).
    """
    ones = (1,) * (points.ndim - 2)
    origin, axis = (column.reshape(-1, *ones, 3) for column in surfaces[:2])
    size, second = (column.reshape(-1, *ones) for column in surfaces[2:])
    offset = points - origin
    height = _dot(offset, axis)
    if kind == "plane":
        return height
    if kind == "sphere":
        return _length(offset) - size
    radius = _length(offset - height[..., None] * axis)
    if kind == "cone":
        return (radius - size - height * second) / np.sqrt(1.0 + second * second)
    return np.hypot(radius - size, height) - second


def upper_bounds(
    kind: str, surfaces: Surfaces, triangles: np.ndarray, groups: np.ndarray, distances: np.ndarray
) -> np.ndarray:
    """Return upper bounds of the largest distance of any point of each triangle from its surface.

    *triangles*: (N, 3, 3) m. *groups*: (N,) int, number of the face that the triangle belongs to; only the
    largest bound of each face is refined. *distances*: (N, 3) m, of `signed_distances` for the corners.
    Degenerate: a triangle that the axis of a cone passes through is as deep as the radius there.
    """
    at_corners = np.abs(distances).max(axis=1)
    if kind == "plane":
        return at_corners
    if kind == "sphere":
        return np.maximum(at_corners, surfaces.size - _least_radius(triangles - surfaces.origin[:, None]))
    if kind == "cone":
        return np.maximum(at_corners, _depth_in_cone(surfaces, triangles))
    return _torus_bounds(surfaces, triangles, groups)


def _depth_in_cone(surfaces: Surfaces, triangles: np.ndarray) -> np.ndarray:
    """Return the largest depth of each triangle in its cone.

    The difference of the distance from the axis and the radius is convex, and constant along a generator, so
    that its minimum in a triangle is on an edge, unless the axis passes through the triangle.
    """
    offset = triangles - surfaces.origin[:, None]
    height = _dot(offset, surfaces.axis[:, None])
    flat = offset - height[..., None] * surfaces.axis[:, None]
    radius = surfaces.size[:, None] + height * surfaces.second[:, None]
    depth = np.zeros(len(triangles))
    turns = np.empty((len(triangles), 3))
    for corner in range(3):
        following = (corner + 1) % 3
        start, side = flat[:, corner], flat[:, following] - flat[:, corner]
        slope = radius[:, following] - radius[:, corner]
        # The distance from the axis is the root of length * ((t - middle)^2 + gap^2).
        length = _dot(side, side)
        with np.errstate(divide="ignore", invalid="ignore"):
            middle = -_dot(start, side) / length
            gap_sq = np.maximum(_dot(start, start) / length - middle * middle, 0.0)
            least = middle + slope * np.sqrt(gap_sq / np.maximum(length - slope * slope, 0.0))
        least = np.clip(np.nan_to_num(least, nan=0.5, posinf=1.0, neginf=0.0), 0.0, 1.0)
        nearest = start + least[:, None] * side
        found = radius[:, corner] + least * slope - _length(nearest)
        depth = np.maximum(depth, found)
        turns[:, corner] = _dot(np.cross(start, flat[:, following]), surfaces.axis)
    # A turn is the weight of the third corner for the point on the axis.
    total = turns.sum(axis=1)
    is_pierced = ((turns >= 0.0).all(axis=1) | (turns <= 0.0).all(axis=1)) & (total != 0.0)
    on_axis = (turns * np.roll(radius, 1, axis=1)).sum(axis=1) / np.where(is_pierced, total, 1.0)
    depth = np.where(is_pierced, np.maximum(depth, on_axis), depth)
    return depth / np.sqrt(1.0 + surfaces.second * surfaces.second)


def _least_radius(triangles: np.ndarray) -> np.ndarray:
    """Return the distances of triangles from the origin."""
    start, sides = triangles, np.roll(triangles, -1, axis=1) - triangles
    with np.errstate(divide="ignore", invalid="ignore"):
        least = np.clip(np.nan_to_num(-_dot(start, sides) / _dot(sides, sides)), 0.0, 1.0)
    of_edges = _length(start + least[..., None] * sides).min(axis=1)
    normal = np.cross(sides[:, 0], sides[:, 1])
    turns = _dot(np.cross(start, np.roll(start, -1, axis=1)), normal[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        of_plane = np.nan_to_num(np.abs(_dot(start[:, 0], normal)) / _length(normal))
    is_above = (turns >= 0.0).all(axis=1) & (_length(normal) > 0.0)
    return np.where(is_above, np.minimum(of_plane, of_edges), of_edges)


def _torus_bounds(surfaces: Surfaces, triangles: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Return bounds for tori.

    The distance is at most its maximum at the corners and half of M R^2, where M bounds the curvature of the
    surfaces at equal distance, and R the radius of a circle around the triangle (Waldron 1998, "The error in
    linear interpolation at the vertices of a simplex").
    """
    bounds = np.zeros(len(triangles))
    found = np.zeros(groups.max(initial=-1) + 1)  # largest distance of each face
    rows = np.arange(len(triangles))
    for level in range(MAX_LEVEL + 1):
        own = surfaces.rows(rows)
        corners = np.abs(signed_distances("torus", own, triangles)).max(axis=1)
        sides = _length(np.roll(triangles, -1, axis=1) - triangles).max(axis=1)
        around = sides / np.sqrt(3.0)
        offset = triangles - own.origin[:, None]
        flat = offset - _dot(offset, own.axis[:, None])[..., None] * own.axis[:, None]
        inner = own.second - corners - around
        radius = _length(flat).min(axis=1) - around
        with np.errstate(divide="ignore"):
            curvature = np.where(
                (inner > 0.0) & (radius > 0.0), np.maximum(1.0 / inner, 1.0 / radius), np.inf
            )
        upper = corners + np.minimum(0.5 * curvature * around * around, around)
        np.maximum.at(found, groups[rows], corners)
        is_last = level == MAX_LEVEL or 4 * len(rows) > MAX_TRIANGLES
        is_done = (upper <= MAX_RATIO * found[groups[rows]]) | is_last
        np.maximum.at(bounds, rows[is_done], upper[is_done])
        triangles, rows = triangles[~is_done], np.repeat(rows[~is_done], 4)
        triangles = quartered(triangles, middles_of(triangles))
        if not len(rows):
            break
    return bounds


def middles_of(triangles: np.ndarray) -> np.ndarray:
    """Return the middles of the sides of triangles, (N, 3, ...), from the first side on."""
    return np.asarray(0.5 * (triangles + np.roll(triangles, -1, axis=1)))


def quartered(triangles: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """Split triangles at the middles of their sides.

    Both are (N, 3, ...); the result is (4 N, 3, ...), the parts of one triangle in succession.
    """
    a, b, c = (triangles[:, corner] for corner in range(3))
    ab, bc, ca = (middles[:, side] for side in range(3))
    parts = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1)
    return parts.reshape(-1, 3, *triangles.shape[2:])


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray((a * b).sum(axis=-1))


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt((vectors * vectors).sum(axis=-1))
