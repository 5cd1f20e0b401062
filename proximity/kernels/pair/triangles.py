"""Distance and crossing of a triangle and eight others, and the shortest connection of two triangles.

Two triangles that do not cross are nearest at a corner of one and any point of the other, or between the
interiors of two edges. The latter is the distance of two lines, whose normal is a compensated cross product:
the error stays at a few roundings of the coordinates for nearly parallel edges. Exactly parallel edges are
nearest at a corner as well.

Triangles cross if an edge of one has its ends on both sides of the other and passes its three edges on the
same side. The side on which two lines pass each other is the sign of a volume shared by both tests: nine for
three edges and three edges. Sides count if they exceed rounding; otherwise the distance is small enough to
decide. Triangles that meet without a clear side do not cross here: `meeting` decides.

Source: Ericson, Real-Time Collision Detection, 5.1.8 and 5.1.9 (distances); Segura, Feito 2001 (crossing by
signed volumes).
"""

import numpy as np

from proximity.kernels.geometry.closest_feature import closest_on_triangle, stack_closest
from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import TINY, cross, dot, point_triangle_distance_sq
from proximity.kernels.nodes import corner_at, offset_of
from proximity.kernels.pair.boxes import mapped
from proximity.native import inlined, kernel
from proximity.native.simd import like, minimum, select, splat

CROSSING = -1.0
"""Squared distance returned for crossing triangles."""
SIDE_ROUNDING = 2.0**-46
"""Heights and distances below this, times the size of coordinates, have no side."""
BOTH = 18
"""Numbers of two triangles: three corners each, x, y and z."""


@inlined
def between(start, end):
    """Return the vector from one point to another."""
    return end[0] - start[0], end[1] - start[1], end[2] - start[2]


@inlined
def in_all_lanes(a, b, c):
    """Broadcast the corners of a triangle, (x, y, z) each, to all lanes."""
    return (
        (splat(a[0]), splat(a[1]), splat(a[2])),
        (splat(b[0]), splat(b[1]), splat(b[2])),
        (splat(c[0]), splat(c[1]), splat(c[2])),
    )


@inlined
def _sides(value, min_sq):
    """Return masks of numbers above and below zero by more than their rounding, with square *min_sq*."""
    is_clear = value * value > min_sq
    zero = like(0.0, value)
    return is_clear & (value > zero), is_clear & (value < zero)


@inlined
def edges_apart(p, d, q, e, rounding_sq):
    """Return squared distances of the edges *p* along *d* and *q* along *e*, and the sides they pass on.

    Inf unless they are nearest in their interiors. *rounding_sq*: square of the rounding of a length.
    """
    normal = cross(d[0], d[1], d[2], e[0], e[1], e[2])
    normal_sq = dot(*normal, *normal)
    r = between(p, q)
    volume = dot(*normal, *r)
    along_d = dot(*cross(r[0], r[1], r[2], e[0], e[1], e[2]), *normal)
    along_e = dot(*cross(r[0], r[1], r[2], d[0], d[1], d[2]), *normal)
    zero = like(0.0, volume)
    is_inside = (
        (minimum(along_d, along_e) >= zero)
        & (along_d <= normal_sq)
        & (along_e <= normal_sq)
        & (normal_sq > like(TINY, volume))
    )
    apart_sq = select(is_inside, volume * volume / normal_sq, like(np.inf, volume))
    return apart_sq, _sides(volume, rounding_sq * dot(*d, *d) * dot(*e, *e))


@inlined
def _passes(first, second, third):
    """Test whether a line passes three edges on the same side."""
    return (first[0] & second[0] & third[0]) | (first[1] & second[1] & third[1])


@inlined
def _is_through(start, end):
    """Test whether two ends are on different sides of a plane."""
    return (start[0] & end[1]) | (start[1] & end[0])


@inlined
def _heights(triangle, edges, points, rounding_sq):
    """Return the sides of a triangle's plane on which three points are."""
    normal = cross(*edges[0], *edges[1])
    min_sq = rounding_sq * dot(*normal, *normal)
    return (
        _sides(dot(*normal, *between(triangle[0], points[0])), min_sq),
        _sides(dot(*normal, *between(triangle[0], points[1])), min_sq),
        _sides(dot(*normal, *between(triangle[0], points[2])), min_sq),
    )


@inlined
def _from_corners(points, triangle):
    """Return the squared distance from the nearest of three points to a triangle."""
    return minimum(
        point_triangle_distance_sq(points[0], *triangle),
        minimum(
            point_triangle_distance_sq(points[1], *triangle), point_triangle_distance_sq(points[2], *triangle)
        ),
    )


@inlined
def triangles_apart(a, b, rounding_sq):
    """Return squared distances of triangles *a* and *b*, three corners (x, y, z) each, or `CROSSING`.

    Vectors of eight; one of the triangles is the same in all lanes. *rounding_sq*: the square of
    `SIDE_ROUNDING` times the largest coordinate.
    """
    d = between(a[0], a[1]), between(a[1], a[2]), between(a[2], a[0])
    e = between(b[0], b[1]), between(b[1], b[2]), between(b[2], b[0])
    apart00, side00 = edges_apart(a[0], d[0], b[0], e[0], rounding_sq)
    apart01, side01 = edges_apart(a[0], d[0], b[1], e[1], rounding_sq)
    apart02, side02 = edges_apart(a[0], d[0], b[2], e[2], rounding_sq)
    apart10, side10 = edges_apart(a[1], d[1], b[0], e[0], rounding_sq)
    apart11, side11 = edges_apart(a[1], d[1], b[1], e[1], rounding_sq)
    apart12, side12 = edges_apart(a[1], d[1], b[2], e[2], rounding_sq)
    apart20, side20 = edges_apart(a[2], d[2], b[0], e[0], rounding_sq)
    apart21, side21 = edges_apart(a[2], d[2], b[1], e[1], rounding_sq)
    apart22, side22 = edges_apart(a[2], d[2], b[2], e[2], rounding_sq)
    over_b = _heights(b, e, a, rounding_sq)
    over_a = _heights(a, d, b, rounding_sq)
    is_crossing = (
        (_is_through(over_b[0], over_b[1]) & _passes(side00, side01, side02))
        | (_is_through(over_b[1], over_b[2]) & _passes(side10, side11, side12))
        | (_is_through(over_b[2], over_b[0]) & _passes(side20, side21, side22))
        | (_is_through(over_a[0], over_a[1]) & _passes(side00, side10, side20))
        | (_is_through(over_a[1], over_a[2]) & _passes(side01, side11, side21))
        | (_is_through(over_a[2], over_a[0]) & _passes(side02, side12, side22))
    )
    apart_sq = minimum(
        minimum(minimum(apart00, apart01), minimum(apart02, apart10)),
        minimum(minimum(apart11, apart12), minimum(minimum(apart20, apart21), apart22)),
    )
    apart_sq = minimum(apart_sq, minimum(_from_corners(a, b), _from_corners(b, a)))
    return select(is_crossing, like(CROSSING, apart_sq), apart_sq)


@inlined
def corner_of(corners, triangle, k):
    """Return corner *k*, modulo 3, of a triangle, 0 or 1."""
    at = 9 * triangle + 3 * (k % 3)
    return corners[at], corners[at + 1], corners[at + 2]


@inlined
def _keep_nearer(apart_sq, one, other, ends):
    """Store a connection in *ends*, (6,), if it is shorter; return the lesser squared length."""
    dx, dy, dz = between(one, other)
    length_sq = dx * dx + dy * dy + dz * dz
    if length_sq < apart_sq:
        ends[0], ends[1], ends[2] = one
        ends[3], ends[4], ends[5] = other
        return length_sq
    return apart_sq


@kernel
def read_both(reals, slots, turn, offset, corners):
    """Write the corners of two triangles, (18,), in the first frame."""
    for number in range(2):
        at = offset_of(slots[number])
        for k in range(3):
            x, y, z = corner_at(reals, at, k)
            if number:
                x, y, z = mapped(turn, offset, x, y, z)
            to = 9 * number + 3 * k
            corners[to], corners[to + 1], corners[to + 2] = x, y, z


@kernel
def on_triangle(corners, triangle, x, y, z, closest):
    """Return the point of a triangle, 0 or 1, nearest to another point."""
    for k in range(3):
        closest.corners[k, 0], closest.corners[k, 1], closest.corners[k, 2] = corner_of(corners, triangle, k)
    closest_on_triangle(x, y, z, closest)
    return vector(closest.point)


@inlined
def between_edges(p, d, q, e):
    """Return whether two edges are nearest in their interiors, and the two points."""
    nx, ny, nz = cross(*d, *e)
    normal_sq = dot(nx, ny, nz, nx, ny, nz)
    if not normal_sq > TINY:
        return False, p, q
    r = between(p, q)
    s = dot(*cross(*r, *e), nx, ny, nz) / normal_sq
    t = dot(*cross(*r, *d), nx, ny, nz) / normal_sq
    is_inside = 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0
    on_first = p[0] + s * d[0], p[1] + s * d[1], p[2] + s * d[2]
    return is_inside, on_first, (q[0] + t * e[0], q[1] + t * e[1], q[2] + t * e[2])


@kernel
def connect(corners, ends):
    """Fill the points of two triangles nearest to each other, (6,); return their squared distance.

    *corners*: (`BOTH`,).
    """
    closest, best = stack_closest(1)[0], np.inf
    for k in range(3):
        x, y, z = corner_of(corners, 0, k)
        best = _keep_nearer(best, (x, y, z), on_triangle(corners, 1, x, y, z, closest), ends)
        x, y, z = corner_of(corners, 1, k)
        best = _keep_nearer(best, on_triangle(corners, 0, x, y, z, closest), (x, y, z), ends)
    for i in range(3):
        p = corner_of(corners, 0, i)
        d = between(p, corner_of(corners, 0, i + 1))
        for j in range(3):
            q = corner_of(corners, 1, j)
            is_inside, one, other = between_edges(p, d, q, between(q, corner_of(corners, 1, j + 1)))
            if is_inside:
                best = _keep_nearer(best, one, other, ends)
    return best
