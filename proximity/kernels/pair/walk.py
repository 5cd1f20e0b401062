"""The walk over two parts' trees at once: the nearest two triangles, or two that cross.

Everything is computed in the local frame of the first part. A pair of boxes waits with a squared distance
below which nothing in them lies; the larger box of the nearest pair is opened, and its eight children are
compared with the other box at once. A box of the second part is taken into the frame of the first with a box
around it.

Boxes and pairs are looked at in float64: the turned boxes of the second part are the looser ones by far.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.triangle import TINY, corners_of_block, cross, dot, offset_of
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    LANES,
    MAX_DEPTH,
    NO_SLOT,
    NODE_CHILDREN,
    NODE_STRIDE,
)
from proximity.kernels.pair.boxes import (
    SHRINK,
    begins_of,
    box_at,
    boxes_at,
    ends_of,
    farther,
    frames_between,
    gaps_sq,
    lanes_of,
    mapped,
    mapped_box_at,
    mapped_boxes,
)
from proximity.kernels.pair.connection import BOTH, connect
from proximity.kernels.pair.triangles import CROSSING, SIDE_ROUNDING, between, triangles_apart
from proximity.kernels.stack_arrays import stack_f64, stack_i64_rows
from proximity.native import inlined, kernel
from proximity.native.simd import (
    bits,
    horizontal_min,
    load,
    load_int,
    maximum,
    minimum,
    select,
    splat,
    square_root,
    store,
    trailing_zeros,
)

MOST_PAIRS = 2 * MAX_DEPTH * (LANES - 1) + LANES * LANES
"""Each opened box leaves at most seven children waiting; at first all children of both roots wait."""
MAP_ROUNDING = 2.0**-48
"""More than rounding can move a box that is taken into the other frame, in sizes of coordinates."""


@inlined
def _used(words, base):
    """Which lanes of a node have children: bits."""
    return bits(load(words, base) <= load(words, base + 24))


@inlined
def _size_at(words, position):
    """The longest side of the box at a child's position."""
    return max(
        words[position + 24] - words[position],
        words[position + 32] - words[position + 8],
        words[position + 40] - words[position + 16],
    )


@inlined
def _wait(waiting, at, one, other, bounds, open_lanes, is_first):
    """Leave pairs of the children at a node with a box waiting, the nearest as the last; *at* behind them.

    *one*, *other*: positions; of the part whose node is opened (*is_first*: the first) that of its lane 0.
    """
    positions, limits, lane_bounds = waiting
    store(lane_bounds, 0, bounds)
    begin, nearest = at, at
    while open_lanes:
        lane = trailing_zeros(open_lanes)
        open_lanes &= open_lanes - 1
        positions[at, 0] = one + (lane if is_first else 0)
        positions[at, 1] = other + (0 if is_first else lane)
        limits[at] = lane_bounds[lane]
        if limits[at] < limits[nearest]:
            nearest = at
        at += 1
    if at > begin:
        _swap(positions, limits, nearest, at - 1)
    return at


@inlined
def _swap(positions, limits, one, other):
    """Exchange two pairs that wait."""
    limits[one], limits[other] = limits[other], limits[one]
    for k in range(2):
        positions[one, k], positions[other, k] = positions[other, k], positions[one, k]


@inlined
def _triangle_in_all(reals, at):
    """The corners of the triangle at *at*, in all lanes."""
    return (
        (splat(reals[at]), splat(reals[at + 8]), splat(reals[at + 16])),
        (splat(reals[at + 24]), splat(reals[at + 32]), splat(reals[at + 40])),
        (splat(reals[at + 48]), splat(reals[at + 56]), splat(reals[at + 64])),
    )


@inlined
def _box_of(triangle):
    """The boxes of triangles."""
    a, b, c = triangle
    return (
        (
            minimum(minimum(a[0], b[0]), c[0]),
            minimum(minimum(a[1], b[1]), c[1]),
            minimum(minimum(a[2], b[2]), c[2]),
        ),
        (
            maximum(maximum(a[0], b[0]), c[0]),
            maximum(maximum(a[1], b[1]), c[1]),
            maximum(maximum(a[2], b[2]), c[2]),
        ),
    )


@inlined
def _gap_along(axis, triangle, others, slack, axis_sq):
    """Squared distances between triangles as seen along an axis of any length, to both sides."""
    a0, a1, a2 = dot(*axis, *triangle[0]), dot(*axis, *triangle[1]), dot(*axis, *triangle[2])
    b0, b1, b2 = dot(*axis, *others[0]), dot(*axis, *others[1]), dot(*axis, *others[2])
    above = minimum(minimum(b0, b1), b2) - maximum(maximum(a0, a1), a2)
    below = minimum(minimum(a0, a1), a2) - maximum(maximum(b0, b1), b2)
    # In units of the axis' length, and so is the slack.
    gap = maximum(maximum(above, below) - slack * square_root(axis_sq), splat(0.0))
    return select(axis_sq > splat(TINY), gap * gap * splat(SHRINK) / axis_sq, splat(0.0))


@kernel
def read_both(reals, slots, turn, offset, corners):
    """Write the corners of two triangles, (18,), in the first frame."""
    for number in range(2):
        at = offset_of(slots[number])
        for k in range(3):
            x, y, z = reals[at + 24 * k], reals[at + 24 * k + 8], reals[at + 24 * k + 16]
            if number:
                x, y, z = mapped(turn, offset, x, y, z)
            to = 9 * number + 3 * k
            corners[to], corners[to + 1], corners[to + 2] = x, y, z


@kernel
def _turn_axis(reals, slots, turn, offset, axis):
    """Set the axis to the direction of the best connection, from the first part to the second."""
    corners, ends = stack_f64(BOTH), stack_f64(6)
    read_both(reals, slots, turn, offset, corners)
    length = sqrt(connect(corners, ends))
    for k in range(3):
        axis[k] = (ends[3 + k] - ends[k]) / length if length > 0.0 else 0.0


@kernel
def _nearer_in_blocks(reals, first, second, turn, offset, slack, best, axis, slots):
    """Update the best squared distance, its slots and its axis with triangles of two blocks; return it."""
    a, b, c = corners_of_block(reals, BLOCK_STRIDE * second)
    others = mapped(turn, offset, *a), mapped(turn, offset, *b), mapped(turn, offset, *c)
    other_boxes = _box_of(others)
    normals = cross(*between(others[0], others[1]), *between(others[0], others[2]))
    normal_sq = dot(*normals, *normals)
    margin, rounding_sq = splat(MAP_ROUNDING * slack), splat(SIDE_ROUNDING * slack * SIDE_ROUNDING * slack)
    for lane in range(LANES):
        at = BLOCK_STRIDE * first + lane
        if reals[at] != reals[at]:
            break
        triangle = _triangle_in_all(reals, at)
        may_be = gaps_sq(_box_of(triangle), other_boxes, margin) < splat(best)
        along = splat(axis[0]), splat(axis[1]), splat(axis[2])
        may_be = may_be & (_gap_along(along, triangle, others, margin, splat(1.0)) < splat(best))
        if not bits(may_be):
            continue
        normal = cross(*between(triangle[0], triangle[1]), *between(triangle[0], triangle[2]))
        axis_sq = dot(*normal, *normal)
        may_be = may_be & (_gap_along(normal, triangle, others, margin, axis_sq) < splat(best))
        may_be = may_be & (_gap_along(normals, triangle, others, margin, normal_sq) < splat(best))
        if not bits(may_be):
            continue
        apart_sq = triangles_apart(triangle, others, rounding_sq)
        apart_sq = select(apart_sq < splat(best), apart_sq, splat(np.inf))
        smallest = horizontal_min(apart_sq)
        if smallest < best:
            best = smallest
            slots[0] = LANES * first + lane
            slots[1] = LANES * second + trailing_zeros(bits(apart_sq <= splat(smallest)))
            if best == CROSSING:
                break
            _turn_axis(reals, slots, turn, offset, axis)
    return best


@kernel
def nearest_of_parts(model, first, second, best, tolerance, budget, slots):
    """Squared distance, in the local frame of part *first*, to part *second*, and one that none is below.

    `CROSSING` where they cross. *best*: only what is nearer is looked for, and nothing that is nearer by less
    than a share of *tolerance*. *budget*: opened nodes and blocks at most; 0: as many as it takes. *slots*
    (2,) int64: filled with the slots of the nearest triangles, or those that cross, or `NO_SLOT`.
    """
    reals, words, frames, parts = model
    turn, offset = stack_f64(9), stack_f64(3)
    frames_between(frames, first, second, turn, offset)
    positions, limits = stack_i64_rows(MOST_PAIRS, 2), stack_f64(MOST_PAIRS)
    waiting = positions, limits, stack_f64(LANES)
    box, axis = stack_f64(7), stack_f64(3)
    axis[0], axis[1], axis[2] = 0.0, 0.0, 0.0
    ratio = abs(frames[first].scale / frames[second].scale)
    slack = 1.0 + 2.0 * ratio
    for k in range(3):
        slack = max(slack, abs(offset[k]) + 2.0 * ratio)
    margin = splat(MAP_ROUNDING * slack)
    slots[0] = slots[1] = NO_SLOT
    one, other = NODE_STRIDE * parts[first].root, NODE_STRIDE * parts[second].root
    at, left = 0, _used(words, one)
    while left:
        lane = trailing_zeros(left)
        left &= left - 1
        box_at(words, one + lane, axis, box)
        bounds = gaps_sq(lanes_of(box), mapped_boxes(words, other, turn, offset), margin)
        at = _wait(waiting, at, one + lane, other, bounds, _used(words, other), False)
    nearest = at - 1
    for k in range(at):
        if limits[k] < limits[nearest]:
            nearest = k
    _swap(positions, limits, nearest, at - 1)
    share_sq = 1.0 / ((1.0 + tolerance) * (1.0 + tolerance))
    reach, steps = best * share_sq, 0
    while at > 0 and best > 0.0 and (budget == 0 or steps < budget):
        at -= 1
        if not limits[at] < reach:
            continue
        steps += 1
        one, other = positions[at, 0], positions[at, 1]
        below_one = load_int(words, one + NODE_CHILDREN)
        below_other = load_int(words, other + NODE_CHILDREN)
        if below_one < 0 and below_other < 0:
            best = _nearer_in_blocks(reals, ~below_one, ~below_other, turn, offset, slack, best, axis, slots)
            reach = best * share_sq
        elif below_other < 0 or (below_one >= 0 and _size_at(words, one) > ratio * _size_at(words, other)):
            node = NODE_STRIDE * below_one
            mapped_box_at(words, other, turn, offset, axis, box)
            opened = boxes_at(words, node)
            bounds = gaps_sq(opened, lanes_of(box), margin)
            bounds = farther(bounds, splat(box[6]), ends_of(opened, axis), margin)
            is_open = bits(bounds < splat(reach)) & _used(words, node)
            at = _wait(waiting, at, node, other, bounds, is_open, True)
        else:
            node = NODE_STRIDE * below_other
            box_at(words, one, axis, box)
            bounds = gaps_sq(lanes_of(box), mapped_boxes(words, node, turn, offset), margin)
            bounds = farther(bounds, begins_of(words, node, turn, offset, axis), splat(box[6]), margin)
            is_open = bits(bounds < splat(reach)) & _used(words, node)
            at = _wait(waiting, at, one, node, bounds, is_open, False)
    # What still waits was not looked into.
    lower = reach
    for k in range(at):
        lower = min(lower, limits[k])
    return best, lower
