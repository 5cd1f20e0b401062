"""Distance from a triangle to eight others, whether they cross, and the shortest connection of two triangles.

Two triangles that do not cross are nearest at a corner of one and anywhere on the other, or between the
insides of two edges. The latter is the distance of two lines, of which the normal is a compensated cross
product: so the error stays at a few roundings of the coordinates, however parallel the edges are; edges that
are parallel altogether are nearest at a corner as well.

Triangles cross where an edge of one has its ends on both sides of the other and passes its three edges on the
same side. The side on which two lines pass each other is the sign of one volume, which serves both: of three
edges and three edges there are nine. Sides count where they are more than rounding: what is not is so near
that the distance tells.

Triangles that meet without a clear side do not cross here: `meeting` decides.

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
"""Squared distance of triangles that cross."""
SIDE_ROUNDING = 2.0**-46
"""Heights and distances below it, times the size of coordinates, are of no side."""
BOTH = 18
"""Numbers of two triangles: three corners each, x, y and z."""


@inlined
def between(start, end):
    """The vector from one point to another."""
    return end[0] - start[0], end[1] - start[1], end[2] - start[2]


@inlined
def in_all_lanes(a, b, c):
    """The corners of a triangle, (x, y, z) each, in all lanes."""
    return (
        (splat(a[0]), splat(a[1]), splat(a[2])),
        (splat(b[0]), splat(b[1]), splat(b[2])),
        (splat(c[0]), splat(c[1]), splat(c[2])),
    )


@inlined
def _sides(value, least_sq):
    """Where a number is above and below zero by more than its rounding, of which the square is given."""
    is_clear = value * value > least_sq
    zero = like(0.0, value)
    return is_clear & (value > zero), is_clear & (value < zero)


@inlined
def edges_apart(p, d, q, e, rounding_sq):
    """Squared distance of the edges from *p* along *d* and from *q* along *e*; on which sides they pass.

    Inf where they are not nearest in their insides. *rounding_sq*: squared, of a length.
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
    """Whether a line passes three edges on the same side."""
    return (first[0] & second[0] & third[0]) | (first[1] & second[1] & third[1])


@inlined
def _is_through(start, end):
    """Whether two ends are on both sides of a plane."""
    return (start[0] & end[1]) | (start[1] & end[0])


@inlined
def _heights(triangle, edges, points, rounding_sq):
    """On which side of a triangle's plane three points are."""
    normal = cross(*edges[0], *edges[1])
    least_sq = rounding_sq * dot(*normal, *normal)
    return (
        _sides(dot(*normal, *between(triangle[0], points[0])), least_sq),
        _sides(dot(*normal, *between(triangle[0], points[1])), least_sq),
        _sides(dot(*normal, *between(triangle[0], points[2])), least_sq),
    )


@inlined
def _from_corners(points, triangle):
    """Squared distance from the nearest of three points to a triangle."""
    return minimum(
        point_triangle_distance_sq(points[0], *triangle),
        minimum(
            point_triangle_distance_sq(points[1], *triangle), point_triangle_distance_sq(points[2], *triangle)
        ),
    )


@inlined
def triangles_apart(a, b, rounding_sq):
    """Squared distances of triangles *a* and *b*, three corners (x, y, z) each; `CROSSING` where they cross.

    Vectors of eight, of which those of one triangle are the same in all lanes. *rounding_sq*: the square of
    `SIDE_ROUNDING` times the largest coordinate, likewise.
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
    """Corner *k* of a triangle, 0 or 1; after the third comes the first again."""
    at = 9 * triangle + 3 * (k % 3)
    return corners[at], corners[at + 1], corners[at + 2]


@inlined
def _keep_nearer(apart_sq, one, other, ends):
    """Keep a connection in *ends*, (6,), where it is shorter; return the lesser squared length."""
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
    """The point of a triangle, 0 or 1, that is nearest to another point."""
    for k in range(3):
        closest.corners[k, 0], closest.corners[k, 1], closest.corners[k, 2] = corner_of(corners, triangle, k)
    closest_on_triangle(x, y, z, closest)
    return vector(closest.point)


@inlined
def between_edges(p, d, q, e):
    """Whether two edges are nearest in their insides, and where."""
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
    """Fill the points of two triangles that are nearest to each other, (6,); return their squared distance.

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
