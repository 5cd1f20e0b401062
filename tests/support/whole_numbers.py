"""Exact distances and crossings in integers. Part of the oracle.

Coordinates in double precision are fractions over a power of two; they are scaled to Python integers.
"""

import math
from fractions import Fraction

import numpy as np

ROOT_BITS = 200  # binary digits after the point of a root


def exact_hit(origin, direction, corners, *, end=None):
    """Ray parameter at the face's plane, whether the face is hit, and the signed crossing: -1, 0 or 1.

    Faces parallel to the line are not hit. A crossing through an edge or a corner is resolved by symbolic
    perturbation, the same for all faces: only a line strictly to the left of an edge that rises (seen along
    the ray) is inside.
    """
    _, (start, way), (triangle,) = whole_numbers([origin, direction if end is None else end], corners[None])
    if end is not None:
        way = _minus(way, start)
    a, b, c = (_minus(corner, start) for corner in triangle)
    normal = _cross(_minus(b, a), _minus(c, a))
    speed = _dot(normal, way)
    if speed == 0:
        return -1, False, 0
    up = _cross(way, [int(k == min(range(3), key=lambda axis: abs(way[axis]))) for k in range(3)])
    turn, sides = 0, []
    for x, y in ((a, b), (b, c), (c, a)):
        side = _dot(way, _cross(x, y))
        below_x, below_y = _dot(up, x) <= 0, _dot(up, y) <= 0
        turn += (below_x and not below_y and side > 0) - (below_y and not below_x and side < 0)
        sides.append(side)
    is_hit = all(side >= 0 for side in sides) or all(side <= 0 for side in sides)
    return Fraction(_dot(normal, a), speed), is_hit, turn


def half_solid_angle(point, corners):
    """Half the solid angle of a face, in -pi … pi; 0 in the plane of the face, or pi on the face itself."""
    _, (origin,), (triangle,) = whole_numbers([point], corners[None])
    a, b, c = (_minus(corner, origin) for corner in triangle)
    volume = _dot(_cross(a, b), c) << 3 * ROOT_BITS
    length_a, length_b, length_c = (math.isqrt(_dot(corner, corner) << 2 * ROOT_BITS) for corner in (a, b, c))
    sides = _dot(a, b) * length_c + _dot(b, c) * length_a + _dot(c, a) * length_b
    spread = length_a * length_b * length_c + (sides << 2 * ROOT_BITS)
    largest = max(abs(volume), abs(spread), 1)
    return math.atan2(volume / largest, spread / largest)


def whole_numbers(points, triangles):
    """The scale that makes all coordinates integers, and the scaled points and triangles."""
    ratios = [float(x).as_integer_ratio() for array in (points, triangles) for x in np.ravel(array)]
    scale = max(denominator for _, denominator in ratios)
    numbers = [numerator * (scale // denominator) for numerator, denominator in ratios]
    vectors = [numbers[k : k + 3] for k in range(0, len(numbers), 3)]
    rest = vectors[len(points) :]
    return scale, vectors[: len(points)], [rest[k : k + 3] for k in range(0, len(rest), 3)]


def _minus(u, v):
    return [x - y for x, y in zip(u, v, strict=True)]


def _dot(u, v):
    return sum(x * y for x, y in zip(u, v, strict=True))


def _cross(u, v):
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]


def triangle_distance_sq(p, a, b, c):
    normal = _cross(_minus(b, a), _minus(c, a))
    normal_sq = _dot(normal, normal)
    edges = ((a, b), (b, c), (c, a))
    sides = [_dot(normal, _cross(_minus(y, x), _minus(p, x))) for x, y in edges]
    if normal_sq > 0 and min(sides) >= 0:
        return Fraction(_dot(normal, _minus(p, a)) ** 2, normal_sq)
    return min(_segment_distance_sq(p, x, y) for x, y in edges)


def _segment_distance_sq(p, a, b):
    along, gap = _minus(b, a), _minus(p, a)
    length_sq, reach = _dot(along, along), _dot(along, gap)
    if reach <= 0:
        return Fraction(_dot(gap, gap))
    if reach >= length_sq:
        return Fraction(_dot(_minus(p, b), _minus(p, b)))
    return _dot(gap, gap) - Fraction(reach**2, length_sq)


def triangles_distance_sq(one, other):
    """Squared distance of two integer triangles; 0 if they meet."""
    if are_crossing(one, other, is_strict=True):
        return Fraction(0)
    corners = [triangle_distance_sq(p, *other) for p in one] + [triangle_distance_sq(p, *one) for p in other]
    return min(corners + [_edges_distance_sq(*x, *y) for x in _edges(one) for y in _edges(other)])


def are_crossing(one, other, *, is_strict):
    """Test whether two integer triangles cross each other, not only touch.

    Strict: an edge of one passes through the interior of the other. Otherwise: they share a line segment,
    whose ends may lie on edges of both.
    """
    if is_strict:
        pairs = [(edge, other) for edge in _edges(one)] + [(edge, one) for edge in _edges(other)]
        return any(_passes(*edge, triangle) for edge, triangle in pairs)
    normals = [_cross(_minus(b, a), _minus(c, a)) for a, b, c in (one, other)]
    line, pieces = _cross(*normals), []
    for triangle, normal, corner in ((one, normals[1], other[0]), (other, normals[0], one[0])):
        heights = [_dot(normal, _minus(p, corner)) for p in triangle]
        if min(heights) >= 0 or max(heights) <= 0:
            return False
        ends = []
        for k in range(3):
            h, g, p, q = heights[k], heights[k - 2], triangle[k], triangle[k - 2]
            if h * g <= 0 and h != g:
                ends.append(_dot(line, p) + Fraction(h, h - g) * _dot(line, _minus(q, p)))
        pieces.append((min(ends), max(ends)))
    return max(begin for begin, _ in pieces) < min(end for _, end in pieces)


def _edges(triangle):
    return [(triangle[k - 1], triangle[k]) for k in range(3)]


def _passes(p, q, triangle):
    """Test whether an edge passes through a triangle's interior, with an end on either side."""
    a, b, c = triangle
    normal = _cross(_minus(b, a), _minus(c, a))
    if _dot(normal, _minus(p, a)) * _dot(normal, _minus(q, a)) >= 0:
        return False
    sides = [_dot(_minus(q, p), _cross(_minus(x, p), _minus(y, p))) for x, y in _edges(triangle)]
    return min(sides) > 0 or max(sides) < 0


def _edges_distance_sq(p, q, a, b):
    """Squared distance of two edges, if it is between their interiors; else of an end point."""
    d, e, r = _minus(q, p), _minus(b, a), _minus(a, p)
    normal = _cross(d, e)
    normal_sq = _dot(normal, normal)
    if normal_sq == 0:
        return _segment_distance_sq(p, a, b)
    s, t = _dot(_cross(r, e), normal), _dot(_cross(r, d), normal)
    if not (0 <= s <= normal_sq and 0 <= t <= normal_sq):
        return _segment_distance_sq(p, a, b)
    return Fraction(_dot(r, normal) ** 2, normal_sq)
