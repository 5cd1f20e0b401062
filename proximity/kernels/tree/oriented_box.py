"""Oriented boxes of leaf blocks, by which a point query can skip blocks.

An axis-aligned box is nearer to a point than a tilted or curved patch of faces, by about the size of the
patch. A box along the axes of the patch - its mean normal, its longest edge, and their cross product - errs
only by the sagitta. In float32 it is one cache line; the block is nine, and takes five times the work.

A block has `ORIENTED_STRIDE` words: x of the three axes, then y, then z; the least scalar product of a corner
with each axis, then the largest; and 0.

**Rounding.** For a point within `FAR` and a corner, both in the local frame, a computed gap exceeds the true
one by at most 12 x 2^-24: five from the sum, four from the difference, two from rounding the point, one from
the box. The axes are orthonormal within 2^-21. So the root of the computed square is at most `BOX_ROUNDING`
above the true distance to any point of a triangle, within the factor `BOX_SLACK`.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.triangle import TINY, cross, dot
from proximity.kernels.layout import BLOCK_STRIDE, ORIENTED_STRIDE
from proximity.kernels.nodes import corners_of_block
from proximity.native import inlined, kernel
from proximity.native.simd import (
    bits,
    fma,
    horizontal_min,
    lane,
    lane_minima,
    lane_sums,
    maximum,
    minimum,
    select,
    splat,
    trailing_zeros,
)

BOX_ROUNDING = 2.0**-19
BOX_SLACK = 1.0 + 2.0**-18
LEAST, LARGEST = 9, 12
"""Offsets of the least and of the largest scalar products in a box."""


@inlined
def _gap_sq(words, at, axis, x, y, z):
    along = fma(x, words[at + axis], fma(y, words[at + 3 + axis], z * words[at + 6 + axis]))
    below, above = words[at + LEAST + axis] - along, along - words[at + LARGEST + axis]
    gap = max(max(below, above), np.float32(0.0))
    return gap * gap


@inlined
def oriented_box_distance_sq(words, at, x, y, z):
    """Return the squared distance from a point to the box at *at*, in float32.

    The point must be within `FAR`. Compare the result with the limit of `reach_into_boxes`.
    """
    first, second = _gap_sq(words, at, 0, x, y, z), _gap_sq(words, at, 1, x, y, z)
    return first + second + _gap_sq(words, at, 2, x, y, z)


@inlined
def reach_into_boxes(best_sq):
    """Return the limit for computed squared distances to boxes.

    Blocks whose box is beyond it can be skipped.
    """
    reach = sqrt(best_sq) + BOX_ROUNDING
    return np.float32(reach * reach * BOX_SLACK)


@kernel
def fill_oriented_boxes(blocks, boxes):
    """Compute the oriented box of each block.

    Return their surface area relative to that of axis-aligned boxes.
    """
    oriented, along_axes = 0.0, 0.0
    for block in range(len(blocks) // BLOCK_STRIDE):
        base = BLOCK_STRIDE * block
        a, b, c = corners_of_block(blocks, base)
        ab, ac = _between(a, b), _between(a, c)
        is_used, zero = a[0] == a[0], splat(0.0)
        nx, ny, nz = cross(*ab, *ac)
        normal = select(is_used, nx, zero), select(is_used, ny, zero), select(is_used, nz, zero)
        at = ORIENTED_STRIDE * block
        write_oriented_box(boxes, at, a, b, c, normal)
        oriented += _surface(
            boxes[at + LARGEST] - boxes[at + LEAST],
            boxes[at + LARGEST + 1] - boxes[at + LEAST + 1],
            boxes[at + LARGEST + 2] - boxes[at + LEAST + 2],
        )
        along_axes += _surface(_extent(a, b, c, 0), _extent(a, b, c, 1), _extent(a, b, c, 2))
    return oriented / along_axes if along_axes > 0.0 else 1.0


@inlined
def _surface(x, y, z):
    """Return half the surface area of a box with the given sides."""
    return np.float64(x) * y + np.float64(y) * z + np.float64(z) * x


@inlined
def _extent(a, b, c, axis):
    """Return the extent of eight triangles along an axis."""
    least = minimum(minimum(a[axis], b[axis]), c[axis])
    largest = maximum(maximum(a[axis], b[axis]), c[axis])
    is_used, none = least == least, splat(np.inf)
    lower = horizontal_min(select(is_used, least, none))
    return -horizontal_min(select(is_used, splat(0.0) - largest, none)) - lower


@inlined
def write_oriented_box(words, at, a, b, c, normals):
    """Write the oriented box of the triangles *a b c* of a block to *at*.

    *normals*: any multiple of the area normals of the triangles, 0 in unused lanes.
    """
    zero = splat(0.0)
    sums = lane_sums(normals[0], normals[1], normals[2], zero, zero, zero, zero, zero)
    nx, ny, nz = _unit(lane(sums, 0), lane(sums, 1), lane(sums, 2), 0.0, 0.0, 1.0)
    ex, ey, ez = _longest_edge(a, b, c)
    along = ex * nx + ey * ny + ez * nz
    # Without an edge across the normal any perpendicular direction works.
    ox, oy, oz = _across(nx, ny, nz)
    tx, ty, tz = _unit(ex - along * nx, ey - along * ny, ez - along * nz, ox, oy, oz)
    sx, sy, sz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
    low_n, high_n = _write_axis(words, at, 0, nx, ny, nz, a, b, c)
    low_t, high_t = _write_axis(words, at, 1, tx, ty, tz, a, b, c)
    low_s, high_s = _write_axis(words, at, 2, sx, sy, sz, a, b, c)
    ends = lane_minima(low_n, low_t, low_s, high_n, high_t, high_s, zero, zero)
    for axis in range(3):
        words[at + LEAST + axis] = lane(ends, axis)
        words[at + LARGEST + axis] = -lane(ends, axis + 3)
    words[at + LARGEST + 3] = 0.0


@inlined
def _between(start, end):
    return end[0] - start[0], end[1] - start[1], end[2] - start[2]


@inlined
def _unit(x, y, z, other_x, other_y, other_z):
    """Return the unit vector along (x, y, z), or the other vector if this one is zero."""
    length_sq = x * x + y * y + z * z
    if length_sq > TINY:
        share = 1.0 / sqrt(length_sq)
        return x * share, y * share, z * share
    return other_x, other_y, other_z


@inlined
def _across(x, y, z):
    """Return a unit vector that is perpendicular to a given one."""
    if abs(x) < 0.6:
        return _unit(0.0, z, -y, 1.0, 0.0, 0.0)
    return _unit(-z, 0.0, x, 0.0, 1.0, 0.0)


@inlined
def _longest_edge(a, b, c):
    """Return the longest edge of eight triangles, as a vector."""
    ab, bc, ca = _between(a, b), _between(b, c), _between(c, a)
    first, second, third = dot(*ab, *ab), dot(*bc, *bc), dot(*ca, *ca)
    is_second = second > first
    length_sq = select(is_second, second, first)
    is_third = third > length_sq
    length_sq = select(is_third, third, length_sq)
    # Unused lanes are NaN and never the longest.
    shortness = select(length_sq > splat(0.0), splat(0.0) - length_sq, splat(0.0))
    it = trailing_zeros(bits(shortness <= splat(horizontal_min(shortness))))
    return (
        lane(select(is_third, ca[0], select(is_second, bc[0], ab[0])), it),
        lane(select(is_third, ca[1], select(is_second, bc[1], ab[1])), it),
        lane(select(is_third, ca[2], select(is_second, bc[2], ab[2])), it),
    )


@inlined
def _write_axis(words, at, axis, x, y, z, a, b, c):
    """Write an axis.

    Return the least scalar products of eight triangles with it, and the negated largest ones. They are
    infinite in unused lanes.
    """
    words[at + axis], words[at + 3 + axis], words[at + 6 + axis] = x, y, z
    x, y, z = (
        splat(np.float64(words[at + axis])),
        splat(np.float64(words[at + 3 + axis])),
        splat(np.float64(words[at + 6 + axis])),
    )
    on_a, on_b, on_c = dot(x, y, z, *a), dot(x, y, z, *b), dot(x, y, z, *c)
    least, largest = minimum(minimum(on_a, on_b), on_c), maximum(maximum(on_a, on_b), on_c)
    is_used, none = on_a == on_a, splat(np.inf)
    return select(is_used, least, none), select(is_used, splat(0.0) - largest, none)
