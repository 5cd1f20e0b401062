"""Boxes of two parts, and points of the second, in the local frame of the first.

A box of the second part is replaced by the axis-aligned box around it in that frame. The separation of two
patches of faces along the current best connection is another bound of their distance. It is not enlarged by
rotation, and uses their normal slabs, which are thin where boxes are not: wavy rings of 84 thousand faces at
a fifth of their size take 960 steps instead of 8004.
"""

import numpy as np

from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import (
    MOMENT_AREA_NORMAL,
    MOMENT_SLAB_LARGEST,
    MOMENT_SLAB_LEAST,
    MOMENT_STRIDE,
    NODE_STRIDE,
)
from proximity.kernels.nodes import corner_at, load_points, lower_at, upper_at
from proximity.kernels.stack_arrays import stack_f64
from proximity.native import inlined, kernel
from proximity.native.simd import fma, like, load, maximum, select, splat, widen

SHRINK = 1.0 - 2.0**-40
"""Factor on squared distances of boxes: covers their rounding."""
MAP_ROUNDING = 2.0**-48
"""Bound of the rounding of a box mapped to the other frame, in sizes of coordinates."""
ALIGNED_SQ = 0.995
"""Squared cosine, of 4 degrees, from which an axis counts as one of coordinates."""
POSE_SIZE = 12
"""Numbers of a part's pose: rotation by rows, and translation."""


@kernel
def frames_between(frames, first, second, turn, offset):
    """Fill the map from the local frame of part *second* to that of *first*: (9,) by rows, and (3,)."""
    one, other = stack_f64(POSE_SIZE), stack_f64(POSE_SIZE)
    for k in range(9):
        one[k], other[k] = frames[first].rotation[k], frames[second].rotation[k]
    for k in range(3):
        one[9 + k], other[9 + k] = frames[first].translation[k], frames[second].translation[k]
    frames_at(frames, first, second, one, other, turn, offset)


@kernel
def frames_at(frames, first, second, one, other, turn, offset):
    """Fill the map like `frames_between`, for parts in poses *one* and *other*, (`POSE_SIZE`,)."""
    ratio = frames[first].scale / frames[second].scale
    moved = stack_f64(3)
    for axis in range(3):
        moved[axis] = other[9 + axis] - one[9 + axis]
        for k in range(3):
            moved[axis] += other[3 * axis + k] * frames[second].centre[k]
    for axis in range(3):
        for k in range(3):
            total = 0.0
            for i in range(3):
                total += one[3 * i + axis] * other[3 * i + k]
            turn[3 * axis + k] = total * ratio
        total = 0.0
        for i in range(3):
            total += one[3 * i + axis] * moved[i]
        offset[axis] = (total - frames[first].centre[axis]) * frames[first].scale


@inlined
def mapped(turn, offset, x, y, z):
    """Map a point of the second frame, or eight, to the first."""
    return (
        fma(like(turn[0], x), x, fma(like(turn[1], x), y, fma(like(turn[2], x), z, like(offset[0], x)))),
        fma(like(turn[3], x), x, fma(like(turn[4], x), y, fma(like(turn[5], x), z, like(offset[1], x)))),
        fma(like(turn[6], x), x, fma(like(turn[7], x), y, fma(like(turn[8], x), z, like(offset[2], x)))),
    )


@inlined
def to_second(frame_map, x, y, z):
    """Map a point of the first frame to the second, by the inverse of the map from `frames_between`."""
    turn, offset = frame_map
    inverse_sq = 1.0 / (turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
    dx, dy, dz = x - offset[0], y - offset[1], z - offset[2]
    return (
        (turn[0] * dx + turn[3] * dy + turn[6] * dz) * inverse_sq,
        (turn[1] * dx + turn[4] * dy + turn[7] * dz) * inverse_sq,
        (turn[2] * dx + turn[5] * dy + turn[8] * dz) * inverse_sq,
    )


@inlined
def rounding_size(frames, first, second, offset):
    """Return the size of coordinates of both parts in the frame of the first, for `MAP_ROUNDING`."""
    ratio = abs(frames[first].scale / frames[second].scale)
    size = 1.0 + 2.0 * ratio
    for k in range(3):
        size = max(size, abs(offset[k]) + 2.0 * ratio)
    return size


@inlined
def gap_along(one, other, axis):
    """Return the gap between parts' boxes along an axis, m; negative if they overlap. *one*: its frame."""
    return max(one.box_lower[axis] - other.box_upper[axis], other.box_lower[axis] - one.box_upper[axis])


@inlined
def _reach_along(turn, row, hx, hy, hz):
    """Return the half side of the axis-aligned box around rotated boxes with those half sides."""
    return fma(splat(abs(turn[row])), hx, fma(splat(abs(turn[row + 1])), hy, splat(abs(turn[row + 2])) * hz))


@inlined
def mapped_boxes(boxes, turn, offset):
    """Return the axis-aligned boxes, in the first frame, around eight boxes of the second part.

    Unused lanes, with infinite sides, are undefined.
    """
    (lx, ly, lz), (ux, uy, uz) = boxes
    half = splat(0.5)
    hx, hy, hz = (ux - lx) * half, (uy - ly) * half, (uz - lz) * half
    x, y, z = mapped(turn, offset, (lx + ux) * half, (ly + uy) * half, (lz + uz) * half)
    rx, ry, rz = (
        _reach_along(turn, 0, hx, hy, hz),
        _reach_along(turn, 3, hx, hy, hz),
        _reach_along(turn, 6, hx, hy, hz),
    )
    return (x - rx, y - ry, z - rz), (x + rx, y + ry, z + rz)


@inlined
def signed_gaps(one, other, slack):
    """Return how far boxes lie above others along each axis, and below, reduced by *slack*."""
    (ax, ay, az), (bx, by, bz) = one
    (cx, cy, cz), (dx, dy, dz) = other
    above = cx - bx - slack, cy - by - slack, cz - bz - slack
    return above, (ax - dx - slack, ay - dy - slack, az - dz - slack)


@inlined
def gaps_sq(above, below):
    """Return squared distances between boxes, from `signed_gaps`."""
    zero = splat(0.0)
    gx = maximum(maximum(above[0], below[0]), zero)
    gy = maximum(maximum(above[1], below[1]), zero)
    gz = maximum(maximum(above[2], below[2]), zero)
    return fma(gx, gx, fma(gy, gy, gz * gz)) * splat(SHRINK)


@inlined
def box_at(words, position, box):
    """Write the box at a child's position, (6,): lower and upper corner."""
    for k in range(3):
        box[k] = np.float64(lower_at(words, position, k))
        box[k + 3] = np.float64(upper_at(words, position, k))


@inlined
def mapped_box_at(words, position, turn, offset, box):
    """Write a box of the second part like `box_at`, in the first frame."""
    for row in range(3):
        middle, reach = offset[row], 0.0
        for k in range(3):
            low, high = np.float64(lower_at(words, position, k)), np.float64(upper_at(words, position, k))
            middle += turn[3 * row + k] * 0.5 * (low + high)
            reach += abs(turn[3 * row + k]) * 0.5 * (high - low)
        box[row], box[row + 3] = middle - reach, middle + reach


@inlined
def opposite_in_second(turn, axis):
    """Return the opposite of an axis of the first frame, in the second; not of unit length."""
    x, y, z = axis
    return (
        -(x * turn[0] + y * turn[3] + z * turn[6]),
        -(x * turn[1] + y * turn[4] + z * turn[7]),
        -(x * turn[2] + y * turn[5] + z * turn[8]),
    )


@inlined
def _is_aligned(axis):
    """Test whether an axis is almost one of coordinates: boxes are then as tight as slabs along it."""
    x, y, z = axis[0] * axis[0], axis[1] * axis[1], axis[2] * axis[2]
    return max(max(x, y), z) >= ALIGNED_SQ * (x + y + z)


@inlined
def _upper(x, lower, upper):
    """Return the largest product of *x* with a number between two others."""
    return maximum(x * lower, x * upper)


@inlined
def upper_ends(words, moments, base, boxes, axis):
    """Return upper bounds of the scalar products of an axis with the points of a node's eight children.

    *boxes*: of the children. *moments*: offset in words of the moments of node 0. The axis is divided into a
    multiple of the child's mean normal, bounded by the slab, and a rest, bounded by the box.
    """
    (lx, ly, lz), (ux, uy, uz) = boxes
    x, y, z = splat(axis[0]), splat(axis[1]), splat(axis[2])
    by_box = _upper(x, lx, ux) + (_upper(y, ly, uy) + _upper(z, lz, uz))
    if _is_aligned(axis):
        return by_box
    at = moments + MOMENT_STRIDE * (base // NODE_STRIDE)
    nx, ny, nz = load_points(words, at + MOMENT_AREA_NORMAL)
    nx, ny, nz = widen(nx), widen(ny), widen(nz)
    share = dot(nx, ny, nz, x, y, z) / dot(nx, ny, nz, nx, ny, nz)
    largest, least = widen(load(words, at + MOMENT_SLAB_LARGEST)), widen(load(words, at + MOMENT_SLAB_LEAST))
    end = select(share > splat(0.0), largest, least)
    rx, ry, rz = x - share * nx, y - share * ny, z - share * nz
    by_slab = fma(share, end, _upper(rx, lx, ux) + (_upper(ry, ly, uy) + _upper(rz, lz, uz)))
    return select(by_slab < by_box, by_slab, by_box)  # not if it is nan, without a mean normal


@inlined
def upper_end_at(words, moments, position, axis):
    """Return the upper bound of `upper_ends` for the child at a position."""
    x, y, z = axis
    by_box = _upper_of_box(words, position, x, y, z)
    if _is_aligned(axis):
        return by_box
    at = moments + MOMENT_STRIDE * (position // NODE_STRIDE) + position % NODE_STRIDE
    nx, ny, nz = corner_at(words, at + MOMENT_AREA_NORMAL, 0)
    nx, ny, nz = np.float64(nx), np.float64(ny), np.float64(nz)
    normal_sq = dot(nx, ny, nz, nx, ny, nz)
    share = dot(nx, ny, nz, x, y, z) / normal_sq if normal_sq > 0.0 else 0.0
    end = np.float64(words[at + (MOMENT_SLAB_LARGEST if share > 0.0 else MOMENT_SLAB_LEAST)])
    rest = _upper_of_box(words, position, x - share * nx, y - share * ny, z - share * nz)
    return min(share * end + rest, by_box)


@inlined
def _upper_of_box(words, position, x, y, z):
    """Return the largest scalar product of a vector with the points of one child's box."""
    return (
        max(x * np.float64(lower_at(words, position, 0)), x * np.float64(upper_at(words, position, 0)))
        + max(y * np.float64(lower_at(words, position, 1)), y * np.float64(upper_at(words, position, 1)))
        + max(z * np.float64(lower_at(words, position, 2)), z * np.float64(upper_at(words, position, 2)))
    )


@inlined
def farther(bounds, gaps):
    """Return the maximum of squared distances and those of separations along an axis."""
    gap = maximum(gaps, splat(0.0))
    return maximum(bounds, gap * gap * splat(SHRINK))


@inlined
def lanes_of(box):
    """Broadcast a box, (6,), to all lanes."""
    return (splat(box[0]), splat(box[1]), splat(box[2])), (splat(box[3]), splat(box[4]), splat(box[5]))
