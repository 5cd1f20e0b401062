"""Brute-force reference results. Imports nothing from the package.

Every face is tested. Distances are computed in `numpy.longdouble` (64 bits of mantissa on x86) with
compensated cross products, which keeps slivers and faces without area accurate; crossings and wide solid
angles are computed in integers. Bounding spheres and side tests, with a margin for rounding, only skip faces
that cannot affect the result.

The conventions are the package's: metres, faces counter-clockwise seen from outside, signed distance negative
inside, `(..., 3)` points give results of shape `(...)`; no result is face -1, distance inf, point nan.
Coordinates may lie between about 1e-100 and 1e100.
"""

import math
from dataclasses import dataclass
from decimal import Decimal, localcontext

import numpy as np
import whole_numbers

NO_FACE = -1
PAIR_COUNT = 200_000  # pairs of query and face per block; bounds the memory
ROUNDING = 2.0**-52
LONG = np.longdouble
SPLITTER = LONG(2) ** ((np.finfo(LONG).nmant + 2) // 2) + 1  # splits a number; the halves' products are exact


@dataclass(frozen=True, slots=True, eq=False)
class Closest:
    """Nearest surface points; S is the leading shape of the points."""

    distance: np.ndarray  # S, unsigned
    point: np.ndarray  # S + (3,)
    face_id: np.ndarray  # S int64, the lowest among equals
    barycentric: np.ndarray  # S + (3,), >= 0, sum 1


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """Intersections of rays with the surface; S is the leading shape of the rays."""

    distance: np.ndarray  # S, to the first hit
    face_id: np.ndarray  # S int64, the lowest among equals
    crossing_count: np.ndarray  # S int64, exits minus entries: the winding number of a closed mesh


@dataclass(frozen=True, slots=True, eq=False)
class Witnesses:
    """Ends of the shortest connections; S is the leading shape of the segments."""

    distance: np.ndarray  # S, 0 where the segment crosses the surface
    point_on_segment: np.ndarray  # S + (3,)
    point_on_solid: np.ndarray  # S + (3,)
    face_id: np.ndarray  # S int64


def closest(vertices, faces, points):
    """Closest points of the surface, accurate to the rounding of the coordinates for faces of any shape."""
    corners = _corners(vertices, faces)
    points = np.asarray(points, dtype=np.float64)
    flat = points.reshape(-1, 3)
    distance, face_id = _nothing(len(flat))
    point, barycentric = np.full((2, len(flat), 3), np.nan)
    for query, face in _near_pairs(corners, flat, flat):
        found, where, weights = _point_triangle(LONG(flat[query]), *_gather(corners, face))
        best = _first_of_each(query, found, face)
        row = query[best]
        distance[row], face_id[row] = found[best], face[best]
        point[row], barycentric[row] = where[best], weights[best]
    shape = points.shape[:-1]
    return Closest(
        distance.reshape(shape),
        point.reshape(points.shape),
        face_id.reshape(shape),
        barycentric.reshape(points.shape),
    )


def closest_exact(vertices, faces, point):
    """Exact squared distance of one point as a fraction (slow: a few dozen faces)."""
    scale, (origin,), triangles = whole_numbers.whole_numbers([point], _corners(vertices, faces))
    return min(whole_numbers.triangle_distance_sq(origin, *triangle) for triangle in triangles) / scale**2


def winding_number(vertices, faces, points):
    """Sum of the solid angles of all faces over 4 pi; a face that contains the point adds half a turn or 0.

    Source: van Oosterom & Strackee 1983, "The solid angle of a plane triangle".
    """
    corners = _corners(vertices, faces)
    points = np.asarray(points, dtype=np.float64)
    flat = points.reshape(-1, 3)
    turns = np.full(len(flat), np.nan)
    for rows in _blocks(len(flat), len(corners)):
        with np.errstate(invalid="ignore"):
            half_angles, is_wide = _half_solid_angles(
                *(corners[None, :, k] - flat[rows, None] for k in range(3))
            )
        for query, face in np.argwhere(is_wide).tolist():
            half_angles[query, face] = whole_numbers.half_solid_angle(flat[rows][query], corners[face])
        turns[rows] = half_angles.sum(axis=1) / (2.0 * np.pi)
    return turns.reshape(points.shape[:-1])


def ray(vertices, faces, origins, directions):
    """First hit and signed crossings of rays, decided without rounding.

    A ray through an edge or a corner hits every face there, and crosses exactly one of them. Faces parallel
    to the ray are not hit; their neighbours are. A hit at the origin itself counts as the first hit, but not
    as a crossing.
    """
    corners = _corners(vertices, faces)
    origins, directions = _together(origins, directions)
    starts, ways = origins.reshape(-1, 3), directions.reshape(-1, 3)
    distance, face_id = _nothing(len(starts))
    crossing_count = np.zeros(len(starts), dtype=np.int64)
    for rows in _blocks(len(starts), len(corners)):
        may_hit = _may_hit(starts[rows, None], ways[rows, None], *(corners[None, :, k] for k in range(3)))
        first = {}
        for query, face in zip(*(ids.tolist() for ids in np.nonzero(may_hit)), strict=True):
            row = rows.start + query
            time, is_hit, turn = whole_numbers.exact_hit(starts[row], ways[row], corners[face])
            crossing_count[row] += turn if time > 0 else 0
            if is_hit and time >= 0 and time < first.get(row, math.inf):
                first[row] = time
                distance[row] = float(LONG(float(time)) * _length(LONG(ways[row])))
                face_id[row] = face
    answers = (distance, face_id, crossing_count)
    return Hits(*(_shaped(answer, origins.shape[:-1]) for answer in answers))


def segment_distance(vertices, faces, starts, ends):
    """Shortest connections between segments and the surface; distance 0 if they cross."""
    corners = _corners(vertices, faces)
    starts, ends = _together(starts, ends)
    flat_starts, flat_ends = starts.reshape(-1, 3), ends.reshape(-1, 3)
    distance, face_id = _nothing(len(flat_starts))
    on_segment, on_solid = np.full((2, len(flat_starts), 3), np.nan)
    for query, face in _near_pairs(corners, flat_starts, flat_ends):
        p, q = flat_starts[query], flat_ends[query]
        found, here, there = _segment_triangle(LONG(p), LONG(q), *_gather(corners, face))
        for k in np.flatnonzero(_may_hit(p, q - p, *np.moveaxis(corners[face], 1, 0))):
            time, is_hit, _ = whole_numbers.exact_hit(p[k], None, corners[face[k]], end=q[k])
            if is_hit and 0 <= time <= 1:
                found[k] = 0
                here[k] = there[k] = LONG(p[k]) + LONG(float(time)) * (LONG(q[k]) - LONG(p[k]))
        best = _first_of_each(query, found, face)
        row = query[best]
        distance[row], face_id[row] = found[best], face[best]
        on_segment[row], on_solid[row] = here[best], there[best]
    shape = starts.shape[:-1]
    return Witnesses(
        distance.reshape(shape),
        on_segment.reshape(starts.shape),
        on_solid.reshape(starts.shape),
        face_id.reshape(shape),
    )


def sphere(points, radius):
    """Signed distance to a sphere around the origin."""
    return np.linalg.norm(points, axis=-1) - radius


def box(points, lower, upper):
    """Signed distance to an axis-aligned box."""
    beyond = np.maximum(np.asarray(lower) - points, points - np.asarray(upper))
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    return outside + np.minimum(beyond.max(axis=-1), 0.0)


def torus(points, major_radius, minor_radius):
    """Signed distance to a torus around the z axis."""
    points = np.asarray(points)
    from_ring = np.hypot(points[..., 0], points[..., 1]) - major_radius
    return np.hypot(from_ring, points[..., 2]) - minor_radius


def capsule(points, start, end, radius):
    """Signed distance to a capsule of *radius* around a segment."""
    points, start, along = np.asarray(points), np.asarray(start), np.subtract(end, start)
    fraction = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(points - start - fraction[..., None] * along, axis=-1) - radius


def root(square):
    """Square root of a fraction, correctly rounded except for ties of sixty digits."""
    with localcontext() as context:
        context.prec, context.Emin, context.Emax = 60, -(10**6), 10**6
        return float((Decimal(square.numerator) / Decimal(square.denominator)).sqrt())


def _corners(vertices, faces):
    return np.asarray(vertices, dtype=np.float64)[np.asarray(faces).reshape(-1, 3)]


def _gather(corners, face):
    return (LONG(corners[face, k]) for k in range(3))


def _together(points, others):
    return np.broadcast_arrays(np.asarray(points, dtype=np.float64), np.asarray(others, dtype=np.float64))


def _nothing(count):
    return np.full(count, np.inf), np.full(count, NO_FACE, dtype=np.int64)


def _shaped(answer, shape):
    return answer.reshape(shape + answer.shape[1:])


def _blocks(query_count, face_count):
    step = max(1, PAIR_COUNT // max(1, face_count))
    for start in range(0, query_count, step):
        yield slice(start, min(start + step, query_count))


def _near_pairs(corners, starts, ends):
    """Candidate pairs of queries (points are segments of zero length) and faces that may be closest."""
    centers = 0.5 * (corners.min(axis=1) + corners.max(axis=1))
    radii = np.linalg.norm(corners - centers[:, None], axis=-1).max(axis=1)
    finite = np.isfinite(starts).all(axis=1) & np.isfinite(ends).all(axis=1)
    for rows in _blocks(len(starts), len(corners)):
        start, end = starts[rows, None], ends[rows, None]
        with np.errstate(invalid="ignore", divide="ignore"):
            along = end - start
            fraction = ((centers - start) * along).sum(axis=-1) / (along * along).sum(axis=-1)
            fraction = np.clip(np.nan_to_num(fraction), 0.0, 1.0)[..., None]
            gaps = np.linalg.norm(centers - start - fraction * along, axis=-1)
            largest = np.maximum(abs(start), abs(end)).max(axis=-1) + abs(corners).max()
            bound = (gaps + radii).min(axis=1, keepdims=True) + 256 * ROUNDING * largest
            is_near = (gaps - radii <= bound) & finite[rows, None]
        query, face = np.nonzero(is_near)
        if len(query):
            yield query + rows.start, face


def _first_of_each(query, distance, face):
    """Position of the nearest face of each query, the lowest face among equals."""
    order = np.lexsort((face, distance, query))
    return order[np.unique(query[order], return_index=True)[1]]


def _dot(u, v):
    return (u * v).sum(axis=-1)


def _length(u):
    return np.sqrt(_dot(u, u))


def _product_error(x, y, product):
    """Rounding error of *product*. Source: Dekker 1971."""
    x_high, y_high = (SPLITTER * each - (SPLITTER * each - each) for each in (x, y))
    x_low, y_low = x - x_high, y - y_high
    return ((x_high * y_high - product) + x_high * y_low + x_low * y_high) + x_low * y_low


def _cross(u, v):
    """Cross product with every component accurate to its own rounding, even for nearly parallel vectors."""
    components = []
    for i, j in ((1, 2), (2, 0), (0, 1)):
        plus, minus = u[..., i] * v[..., j], u[..., j] * v[..., i]
        lost = _product_error(u[..., i], v[..., j], plus) - _product_error(u[..., j], v[..., i], minus)
        components.append((plus - minus) + lost)
    return np.stack(components, axis=-1)


def _point_segment(p, a, b):
    """Distance, closest point and weight of *b*, measured from the nearer end."""
    along = b - a
    length_sq = np.where(_dot(along, along) > 0, _dot(along, along), 1)
    from_a = np.clip(_dot(p - a, along) / length_sq, 0, 1)[:, None]
    from_b = np.clip(_dot(b - p, along) / length_sq, 0, 1)[:, None]
    near_a = from_a <= from_b
    gap = np.where(near_a, (p - a) - from_a * along, (p - b) + from_b * along)
    foot = np.where(near_a, a + from_a * along, b - from_b * along)
    return _length(gap), foot, np.where(near_a, from_a, 1 - from_b)[:, 0]


def _point_triangle(p, a, b, c):
    """Distance, closest point and barycentric weights: the foot on the plane, or the best of three edges."""
    best, point, weights = np.full(len(p), np.inf, LONG), np.empty_like(p), np.empty_like(p)
    corners = (a, b, c)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        found, foot, share = _point_segment(p, corners[i], corners[j])
        edge_weights = np.zeros_like(p)
        edge_weights[:, i], edge_weights[:, j] = 1 - share, share
        nearer = found < best
        best[nearer], point[nearer], weights[nearer] = found[nearer], foot[nearer], edge_weights[nearer]

    normal = _cross(b - a, c - a)
    size = _length(normal)
    sides = np.stack([_dot(normal, _cross(y - x, p - x)) for x, y in ((b, c), (c, a), (a, b))], axis=-1)
    inside = (sides >= 0).all(axis=1) & (size > 0) & (sides.sum(axis=1) > 0)
    unit = normal[inside] / size[inside, None]
    height = _dot(unit, p[inside] - a[inside])
    best[inside], point[inside] = abs(height), p[inside] - height[:, None] * unit
    weights[inside] = sides[inside] / sides[inside].sum(axis=1, keepdims=True)
    return best, point, weights


def _segment_triangle(p, q, a, b, c):
    """Distance and both witness points of segments *pq* that do not cross the face."""
    options = []
    for end in (p, q):
        found, there, _ = _point_triangle(end, a, b, c)
        options.append((found, end, there))
    for corner in (a, b, c):
        found, here, _ = _point_segment(corner, p, q)
        options.append((found, here, corner))
    for x, y in ((a, b), (b, c), (c, a)):
        options.append(_between_lines(p, q, x, y))
    distances = np.stack([option[0] for option in options])
    choice, row = distances.argmin(axis=0), np.arange(len(p))
    return (
        distances[choice, row],
        np.stack([option[1] for option in options])[choice, row],
        np.stack([option[2] for option in options])[choice, row],
    )


def _between_lines(p, q, a, b):
    """Distance and feet of the common perpendicular of two segments; inf if a foot is outside its segment."""
    normal = _cross(q - p, b - a)
    size = _length(normal)
    crossing = np.where(size > 0, size, 1)
    unit = normal / crossing[:, None]
    fraction_pq = _dot(_cross(a - p, b - a), unit) / crossing
    fraction_ab = _dot(_cross(a - p, q - p), unit) / crossing
    is_between = (size > 0) & (abs(fraction_pq - 0.5) <= 0.5) & (abs(fraction_ab - 0.5) <= 0.5)
    distance = np.where(is_between, abs(_dot(a - p, unit)), np.inf)
    return distance, p + fraction_pq[:, None] * (q - p), a + fraction_ab[:, None] * (b - a)


def _half_solid_angles(a, b, c):
    """Half the solid angles, accurate to rounding, and a mask of wide ones that are not."""
    lengths = [_length(corner) for corner in (a, b, c)]
    volume = _dot(np.cross(a, b), c)
    product = lengths[0] * lengths[1] * lengths[2]
    spread = product + _dot(a, b) * lengths[2] + _dot(b, c) * lengths[0] + _dot(c, a) * lengths[1]
    return np.arctan2(volume, spread), spread < product


def _may_hit(origin, direction, a, b, c):
    """False if the line certainly misses the face despite rounding."""
    a, b, c = a - origin, b - origin, c - origin
    with np.errstate(invalid="ignore"):
        edges = ((b, c), (c, a), (a, b))
        sides = [(_dot(direction, np.cross(x, y)), _length(x) * _length(y)) for x, y in edges]
        margin = 32 * ROUNDING * _length(direction)
        is_left = np.logical_or.reduce([side > margin * size for side, size in sides])
        is_right = np.logical_or.reduce([side < -margin * size for side, size in sides])
        return ~(is_left & is_right) & np.isfinite(margin * _length(a))
