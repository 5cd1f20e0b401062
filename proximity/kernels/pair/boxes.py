"""Boxes of two parts, and points of the second, in the local frame of the first.

A box of the second part is replaced by the axis-aligned box around it in that frame. The separation of boxes
along the current best connection is another bound of their distance, not enlarged by rotation.
"""

import numpy as np

from proximity.kernels.nodes import lower_at, upper_at, wide_boxes_of
from proximity.kernels.stack_arrays import stack_f64
from proximity.native import inlined, kernel
from proximity.native.simd import fma, like, maximum, minimum, splat

SHRINK = 1.0 - 2.0**-40
"""Factor on squared distances of boxes: covers their rounding."""
MAP_ROUNDING = 2.0**-48
"""Bound of the rounding of a box mapped to the other frame, in sizes of coordinates."""
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
def mapped_boxes(words, base, turn, offset):
    """Return the axis-aligned boxes, in the first frame, around the eight boxes at *base* of the second part.

    Unused lanes, with infinite sides, are undefined.
    """
    (lx, ly, lz), (ux, uy, uz) = wide_boxes_of(words, base)
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
def gaps_sq(one, other, slack):
    """Return squared distances between boxes, reduced by *slack* along each axis."""
    zero = splat(0.0)
    gx = maximum(maximum(other[0][0] - one[1][0], one[0][0] - other[1][0]) - slack, zero)
    gy = maximum(maximum(other[0][1] - one[1][1], one[0][1] - other[1][1]) - slack, zero)
    gz = maximum(maximum(other[0][2] - one[1][2], one[0][2] - other[1][2]) - slack, zero)
    return fma(gx, gx, fma(gy, gy, gz * gz)) * splat(SHRINK)


@inlined
def box_at(words, position, axis, box):
    """Write the box at a child's position: lower and upper corner, and its upper end along an axis; (7,)."""
    end = 0.0
    for k in range(3):
        low, high = np.float64(lower_at(words, position, k)), np.float64(upper_at(words, position, k))
        box[k], box[k + 3] = low, high
        end += max(axis[k] * low, axis[k] * high)
    box[6] = end


@inlined
def mapped_box_at(words, position, turn, offset, axis, box):
    """Write a box of the second part like `box_at`, in the first frame, and its lower end along an axis."""
    begin = 0.0
    for row in range(3):
        middle, reach = offset[row], 0.0
        for k in range(3):
            low, high = np.float64(lower_at(words, position, k)), np.float64(upper_at(words, position, k))
            middle += turn[3 * row + k] * 0.5 * (low + high)
            reach += abs(turn[3 * row + k]) * 0.5 * (high - low)
        box[row], box[row + 3] = middle - reach, middle + reach
        begin += axis[row] * middle
    for k in range(3):
        side = np.float64(upper_at(words, position, k)) - np.float64(lower_at(words, position, k))
        begin -= abs(_axis_along(axis, turn, k)) * 0.5 * side
    box[6] = begin


@inlined
def _axis_along(axis, turn, k):
    """Return the component of an axis of the first frame along axis *k* of the second."""
    return axis[0] * turn[k] + axis[1] * turn[3 + k] + axis[2] * turn[6 + k]


@inlined
def ends_of(boxes, axis):
    """Return the upper ends of eight boxes along an axis."""
    (lx, ly, lz), (ux, uy, uz) = boxes
    x, y, z = splat(axis[0]), splat(axis[1]), splat(axis[2])
    return maximum(x * lx, x * ux) + (maximum(y * ly, y * uy) + maximum(z * lz, z * uz))


@inlined
def begins_of(words, base, turn, offset, axis):
    """Return the lower ends of the eight boxes at *base* of the second part along an axis of the first."""
    (lx, ly, lz), (ux, uy, uz) = wide_boxes_of(words, base)
    x = splat(_axis_along(axis, turn, 0))
    y = splat(_axis_along(axis, turn, 1))
    z = splat(_axis_along(axis, turn, 2))
    begin = splat(axis[0] * offset[0] + axis[1] * offset[1] + axis[2] * offset[2])
    return begin + (minimum(x * lx, x * ux) + (minimum(y * ly, y * uy) + minimum(z * lz, z * uz)))


@inlined
def farther(bounds, begins, ends, slack):
    """Return the maximum of squared distances and those along an axis."""
    gap = maximum(begins - ends - slack, splat(0.0))
    return maximum(bounds, gap * gap * splat(SHRINK))


@inlined
def lanes_of(box):
    """Broadcast a box, (6,), to all lanes."""
    return (splat(box[0]), splat(box[1]), splat(box[2])), (splat(box[3]), splat(box[4]), splat(box[5]))
