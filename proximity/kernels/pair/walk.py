"""The walk over two parts' trees at once: the nearest two triangles, or two that cross.

Everything is computed in the local frame of the first part. A pair of boxes waits with a squared distance
below which nothing in them lies; the larger box of the nearest pair is opened, and its eight children are
compared with the other box at once. A box of the second part is taken into the frame of the first with a box
around it.

Boxes and pairs are looked at in float64: the turned boxes of the second part are the looser ones by far.
"""

import numpy as np

from proximity.kernels.geometry.closest_feature import (
    CLOSEST_POINT,
    CLOSEST_SIZE,
    closest_on_triangle,
    read_corners,
)
from proximity.kernels.layout import (
    LANES,
    MAX_DEPTH,
    NO_SLOT,
    NODE_STRIDE,
    STACKS_SIZE,
)
from proximity.kernels.nodes import child_at, lower_at, upper_at, used_lanes, wide_boxes_of
from proximity.kernels.pair.blocks import MAP_ROUNDING, nearer_in_blocks, turn_axis
from proximity.kernels.pair.boxes import (
    begins_of,
    box_at,
    ends_of,
    farther,
    gaps_sq,
    lanes_of,
    mapped,
    mapped_box_at,
    mapped_boxes,
)
from proximity.kernels.pair.meeting import meeting_reach, to_second
from proximity.kernels.point.walk import NOTHING_SEEN, closest_in_part
from proximity.kernels.stack_arrays import stack_f32, stack_f64, stack_i64, stack_i64_rows
from proximity.native import inlined, kernel
from proximity.native.simd import (
    bits,
    splat,
    store,
    trailing_zeros,
)

MOST_TURNS = 4
"""Times that a search between surfaces goes to and fro."""
MOST_PAIRS = 2 * MAX_DEPTH * (LANES - 1) + LANES * LANES
"""Each opened box leaves at most seven children waiting; at first all children of both roots wait."""


@inlined
def size_at(words, position):
    """The longest side of the box at a child's position."""
    return max(
        upper_at(words, position, 0) - lower_at(words, position, 0),
        upper_at(words, position, 1) - lower_at(words, position, 1),
        upper_at(words, position, 2) - lower_at(words, position, 2),
    )


@inlined
def opens_first(words, below_one, below_other, one, other, ratio):
    """Whether the box of the first part is opened, not that of the second: the larger, if no block."""
    return below_other < 0 or (below_one >= 0 and size_at(words, one) > ratio * size_at(words, other))


@inlined
def rounding_size(frames, first, second, offset):
    """The size of coordinates of both parts in the frame of the first, for `MAP_ROUNDING`."""
    ratio = abs(frames[first].scale / frames[second].scale)
    size = 1.0 + 2.0 * ratio
    for k in range(3):
        size = max(size, abs(offset[k]) + 2.0 * ratio)
    return size


@inlined
def bounds_of_children(words, one, other, is_first, frame_map, margin, axis, box):
    """Squared distances of the eight children of a node with a box that none of them is nearer than.

    *one*, *other*: that of the part whose node is opened (*is_first*: the first) is a node, the other the
    position of a box. *box*: (7,), written to.
    """
    turn, offset = frame_map
    if is_first:
        mapped_box_at(words, other, turn, offset, axis, box)
        opened = wide_boxes_of(words, one)
        return farther(gaps_sq(opened, lanes_of(box), margin), splat(box[6]), ends_of(opened, axis), margin)
    box_at(words, one, axis, box)
    bounds = gaps_sq(lanes_of(box), mapped_boxes(words, other, turn, offset), margin)
    return farther(bounds, begins_of(words, other, turn, offset, axis), splat(box[6]), margin)


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


@kernel
def begin_short(model, first, second, turn, offset, best, axis, slots):
    """Set slots and axis to those of a short connection, if it is below *best*; return the lesser square.

    It is that of the last slots, or else, from the second part's middle, the nearest of the nearest, to and
    fro.
    """
    reals, _, _, parts = model
    stacks, tried = stack_f32(STACKS_SIZE), stack_i64(2)
    tried[0], tried[1], slots[0], slots[1] = slots[0], slots[1], NO_SLOT, NO_SLOT
    turns = MOST_TURNS if tried[0] == NO_SLOT else 0
    if turns == 0:
        best = _keep_shorter(reals, tried, turn, offset, best, axis, slots)
    x, y, z = offset[0], offset[1], offset[2]
    for _ in range(turns):
        before = best
        _, tried[0] = closest_in_part(
            model, first, parts[first].root, (x, y, z), np.inf, np.int64(NO_SLOT), NOTHING_SEEN, stacks
        )
        x, y, z = _nearest_on(reals, tried[0], x, y, z)
        x, y, z = to_second((turn, offset), x, y, z)
        _, tried[1] = closest_in_part(
            model, second, parts[second].root, (x, y, z), np.inf, np.int64(NO_SLOT), NOTHING_SEEN, stacks
        )
        x, y, z = _nearest_on(reals, tried[1], x, y, z)
        x, y, z = mapped(turn, offset, x, y, z)
        best = _keep_shorter(reals, tried, turn, offset, best, axis, slots)
        if not best < before:
            break
    return best


@kernel
def _keep_shorter(reals, tried, turn, offset, best, axis, slots):
    """Keep slots whose connection is shorter than the best, and its direction; return the lesser square."""
    direction = stack_f64(3)
    length_sq = turn_axis(reals, tried, turn, offset, direction)
    if not length_sq < best:
        return best
    slots[0], slots[1] = tried[0], tried[1]
    axis[0], axis[1], axis[2] = direction[0], direction[1], direction[2]
    return length_sq


@kernel
def _nearest_on(reals, slot, x, y, z):
    """The point of a triangle that is nearest to another point."""
    closest = stack_f64(CLOSEST_SIZE)
    read_corners(reals, slot, closest)
    closest_on_triangle(x, y, z, closest)
    return closest[CLOSEST_POINT], closest[CLOSEST_POINT + 1], closest[CLOSEST_POINT + 2]


@kernel
def nearest_of_parts(model, first, second, frame_map, best, tolerance, budget, slots):
    """Squared distance, in the local frame of part *first*, to part *second*; one that none is below; steps.

    `CROSSING` where they cross. *frame_map*: `frames_between` them. *best*: only what is nearer is looked
    for, and nothing that is nearer by less than a share of *tolerance*. *budget*: opened nodes and blocks at
    most; 0: as many as it takes. *slots* (2,) int64: of the last answer, or `NO_SLOT`; filled with those of
    the nearest triangles, or of two that cross, or `NO_SLOT`.
    """
    _, words, frames, parts = model
    turn, offset = frame_map
    positions, limits = stack_i64_rows(MOST_PAIRS, 2), stack_f64(MOST_PAIRS)
    waiting = positions, limits, stack_f64(LANES)
    box, axis = stack_f64(7), stack_f64(3)
    axis[0], axis[1], axis[2] = 0.0, 0.0, 0.0
    ratio = abs(frames[first].scale / frames[second].scale)
    slack = rounding_size(frames, first, second, offset)
    margin = splat(MAP_ROUNDING * slack)
    meeting_sq = meeting_reach(slack) * meeting_reach(slack)
    best = max(begin_short(model, first, second, turn, offset, best, axis, slots), meeting_sq)
    one, other = NODE_STRIDE * parts[first].root, NODE_STRIDE * parts[second].root
    at, left = 0, bits(used_lanes(words, one))
    while left:
        lane = trailing_zeros(left)
        left &= left - 1
        box_at(words, one + lane, axis, box)
        bounds = gaps_sq(lanes_of(box), mapped_boxes(words, other, turn, offset), margin)
        at = _wait(waiting, at, one + lane, other, bounds, bits(used_lanes(words, other)), False)
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
        below_one = child_at(words, one)
        below_other = child_at(words, other)
        if below_one < 0 and below_other < 0:
            best, _ = nearer_in_blocks(
                model, (first, second), ~below_one, ~below_other, frame_map, slack, best, axis, slots
            )
            reach = best * share_sq
        elif opens_first(words, below_one, below_other, one, other, ratio):
            node = NODE_STRIDE * below_one
            bounds = bounds_of_children(words, node, other, True, frame_map, margin, axis, box)
            is_open = bits(bounds < splat(reach)) & bits(used_lanes(words, node))
            at = _wait(waiting, at, node, other, bounds, is_open, True)
        else:
            node = NODE_STRIDE * below_other
            bounds = bounds_of_children(words, one, node, False, frame_map, margin, axis, box)
            is_open = bits(bounds < splat(reach)) & bits(used_lanes(words, node))
            at = _wait(waiting, at, one, node, bounds, is_open, False)
    if best == meeting_sq and slots[0] != NO_SLOT:
        return 0.0, 0.0, steps
    # What still waits was not looked into.
    lower = reach
    for k in range(at):
        lower = min(lower, limits[k])
    return best, lower, steps
