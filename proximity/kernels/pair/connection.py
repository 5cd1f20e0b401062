"""The shortest connection between two triangles: a point on each."""

import numpy as np

from proximity.kernels.geometry.closest_feature import CLOSEST_POINT, CLOSEST_SIZE, CLOSEST_TRIANGLE
from proximity.kernels.geometry.closest_feature import closest_on_triangle as closest_on_corners
from proximity.kernels.geometry.triangle import TINY, cross, dot
from proximity.kernels.nodes import corner_at, offset_of
from proximity.kernels.pair.boxes import mapped
from proximity.kernels.pair.triangles import between
from proximity.kernels.stack_arrays import stack_f64
from proximity.native import inlined, kernel

BOTH = 18
"""Numbers of two triangles: three corners each, x, y and z."""


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
    for k in range(9):
        closest[CLOSEST_TRIANGLE + k] = corners[9 * triangle + k]
    closest_on_corners(x, y, z, closest)
    return closest[CLOSEST_POINT], closest[CLOSEST_POINT + 1], closest[CLOSEST_POINT + 2]


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
    closest, best = stack_f64(CLOSEST_SIZE), np.inf
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
