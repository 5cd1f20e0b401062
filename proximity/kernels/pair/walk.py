"""Nearest or crossing triangles of two parts: simultaneous traversal of both trees.

All computations are in the local frame of the first part, with boxes in float64. The larger box of a pair is
opened, and its eight children are tested against the other box together. A box of the second part is replaced
by the axis-aligned box around it in that frame.

A search without a frontier opens the nearest pair first; its limits are squared distances. A search from the
last frontier continues from it: limits, which are distances, fall by the motion of the boxes against the axes
that separate them, and only entries nearer than the best are opened again.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.closest_feature import (
    closest_on_triangle,
    read_corners,
    stack_closest,
)
from proximity.kernels.geometry.frames import ROUNDED_UP
from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import LANES, MAX_DEPTH, NO_SLOT, NODE_STRIDE, STACKS_SIZE
from proximity.kernels.nodes import used_lanes, wide_boxes_of
from proximity.kernels.pair.blocks import nearer_in_blocks, turn_axis
from proximity.kernels.pair.boxes import (
    MAP_ROUNDING,
    SHRINK,
    box_at,
    farther,
    gaps_sq,
    lanes_of,
    mapped,
    mapped_box_at,
    mapped_boxes,
    opposite_in_second,
    rounding_size,
    signed_gaps,
    to_second,
    upper_end_at,
    upper_ends,
)
from proximity.kernels.pair.meeting import meeting_reach
from proximity.kernels.point.walk import NOTHING_SEEN, closest_in_part
from proximity.kernels.stack_arrays import stack_f32, stack_f64, stack_i32_rows, stack_i64
from proximity.kernels.traverse.dual_first import (
    NEARLY,
    OVERFLOW,
    SIDE,
    Frontier,
    append_children,
    append_entry,
    dual_first,
    lower_limits,
    nearest_to_end,
    set_side,
)
from proximity.native import inlined, kernel
from proximity.native.simd import bits, fma, lane, load, select, splat, square_root, store, trailing_zeros

MOTION_ROUNDING = 8.0 * MAP_ROUNDING
"""Bound of the rounding of a ball's motion, in sizes of coordinates."""
ROOT_RADIUS = 2.0
"""Of a ball around any part, local units."""
MAX_TURNS = 4
"""Maximum alternations of the initial search between the surfaces."""
MAX_PAIRS = 2 * MAX_DEPTH * (LANES - 1) + LANES * LANES + 3 * LANES
"""Each opened box leaves at most seven waiting children; at first all children of both roots wait."""


@inlined
def _children_sq(model, query, one, other, is_first):
    """Return lower bounds of the squared distances of a node's eight children from a box, and their gaps.

    *one*, *other*: for the part whose node is opened (*is_first*: the first) a node, for the other the
    position of a box.
    """
    (_, (turn, offset), slack, _, _, axis, box, _), words = query, model.words
    moments, margin = model.parts[0].moments, splat(MAP_ROUNDING * slack)
    ahead = axis[0], axis[1], axis[2]
    back = opposite_in_second(turn, ahead)
    start = dot(*ahead, offset[0], offset[1], offset[2])
    if is_first:
        mapped_box_at(words, other, turn, offset, box)
        boxes = wide_boxes_of(words, one)
        begin = start - upper_end_at(words, moments, other, back)
        gaps = splat(begin) - upper_ends(words, moments, one, boxes, ahead) - margin
        above, below = signed_gaps(boxes, lanes_of(box), margin)
        return farther(gaps_sq(above, below), gaps), (ahead, gaps, above, below)
    box_at(words, one, box)
    boxes = wide_boxes_of(words, other)
    end = upper_end_at(words, moments, one, ahead)
    gaps = splat(start) - upper_ends(words, moments, other, boxes, back) - splat(end) - margin
    above, below = signed_gaps(lanes_of(box), mapped_boxes(boxes, turn, offset), margin)
    return farther(gaps_sq(above, below), gaps), (ahead, gaps, above, below)


@inlined
def _children(model, query, one, other, is_first):
    bounds_sq, gaps = _children_sq(model, query, one, other, is_first)
    return square_root(bounds_sq), gaps


@inlined
def _axis_of(separations, lane_limits, lanes, reach):
    """Return the limit of children (bits), and the axis along which it separates them: 0 if none does so.

    The axis is that of the best connection, or that of the gap of the nearest child.
    """
    ahead, gaps, above, below = separations
    limits, along, nearest = stack_f64(LANES), np.inf, trailing_zeros(lanes)
    store(limits, 0, gaps)
    left = lanes
    while left:
        k = trailing_zeros(left)
        left &= left - 1
        along = min(along, limits[k])
        nearest = k if lane_limits[k] < lane_limits[nearest] else nearest
    if along >= reach:
        return along * SHRINK, (ahead[0] * SHRINK, ahead[1] * SHRINK, ahead[2] * SHRINK)
    x, y, z = (
        _wider(lane(above[0], nearest), lane(below[0], nearest)),
        _wider(lane(above[1], nearest), lane(below[1], nearest)),
        _wider(lane(above[2], nearest), lane(below[2], nearest)),
    )
    length = sqrt(dot(x, y, z, x, y, z))
    if length > 0.0:
        x, y, z, along = x / length, y / length, z / length, np.inf
        across = _part_along(y, above[1], below[1]) + _part_along(z, above[2], below[2])
        store(limits, 0, _part_along(x, above[0], below[0]) + across)
        left = lanes
        while left:
            along = min(along, limits[trailing_zeros(left)])
            left &= left - 1
        if along >= reach:
            return along * SHRINK, (x * SHRINK, y * SHRINK, z * SHRINK)
    return lane_limits[nearest], (0.0, 0.0, 0.0)


@inlined
def _wider(above, below):
    """Return the gap along an axis of coordinates, negative if it lies below."""
    return above if above > 0.0 else -max(below, 0.0)


@inlined
def _part_along(x, above, below):
    return splat(x) * above if x > 0.0 else splat(-x) * below


@inlined
def _look_into_sq(model, query, first, second, best):
    """Update the best squared distance with two blocks; also return a lower bound of theirs."""
    pair, frame_map, slack, _, _, axis, _, slots = query
    best, min_sq = nearer_in_blocks(model, pair, first, second, frame_map, slack, best, axis, slots)
    return best, min_sq, (axis[3], axis[4], axis[5])


@inlined
def _look_into(model, query, first, second, best):
    best, min_sq, axis = _look_into_sq(model, query, first, second, best)
    meeting_sq = query[3]
    return best, _reach(query, best) if best == meeting_sq else sqrt(max(min_sq, 0.0)), axis


@inlined
def _reach_sq(query, best):
    """Return the squared distance at which the search ends: the best, reduced by the tolerance."""
    return best * query[4]


@inlined
def _reach(query, best):
    return sqrt(max(best, 0.0)) * query[4]


_walk_from_nothing = dual_first(_children_sq, _look_into_sq, _reach_sq, None)
_walk_from_frontier = dual_first(_children, _look_into, _reach, _axis_of)


@kernel
def begin_short(model, first, second, turn, offset, best, axis, slots):
    """Set slots and axis to a short connection, if below *best*; return the lesser squared length.

    Uses the last slots or, without any, alternating closest-point queries from the second part's centre.
    """
    reals, _, _, parts = model
    stacks, tried = stack_f32(STACKS_SIZE), stack_i64(2)
    tried[0], tried[1], slots[0], slots[1] = slots[0], slots[1], NO_SLOT, NO_SLOT
    turns = MAX_TURNS if tried[0] == NO_SLOT else 0
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
    """Store slots with a connection shorter than the best, and its direction; return the lesser square."""
    direction = stack_f64(3)
    length_sq = turn_axis(reals, tried, turn, offset, direction)
    if not length_sq < best:
        return best
    slots[0], slots[1] = tried[0], tried[1]
    axis[0], axis[1], axis[2] = direction[0], direction[1], direction[2]
    return length_sq


@kernel
def _nearest_on(reals, slot, x, y, z):
    """Return the point of a triangle nearest to another point."""
    closest = stack_closest(1)[0]
    read_corners(reals, slot, closest)
    closest_on_triangle(x, y, z, closest)
    return vector(closest.point)


@inlined
def _begin(model, first, second, frame_map, best, share, axis, box, slots):
    """Return the query of a walk, and the initial best squared distance."""
    slack, (turn, offset) = rounding_size(model.frames, first, second, frame_map[1]), frame_map
    meeting_sq = meeting_reach(slack) * meeting_reach(slack)
    axis[0], axis[1], axis[2] = 0.0, 0.0, 0.0
    best = max(begin_short(model, first, second, turn, offset, best, axis, slots), meeting_sq)
    return ((first, second), frame_map, slack, meeting_sq, share, axis, box, slots), best


@inlined
def _ratio(frames, first, second):
    """Return the length of the second part's local unit in the first's."""
    return abs(frames[first].scale / frames[second].scale)


@kernel
def nearest_of_parts(model, first, second, frame_map, best, tolerance, budget, slots):
    """Return squared distance of two parts, local frame of *first*, its lower bound, and the steps.

    `CROSSING` if they cross. *frame_map*: from `frames_between`. *best*: initial bound of the search; the
    result may exceed the minimum by the relative *tolerance*. *budget*: maximum opened nodes and blocks; 0:
    no limit. *slots* (2,) int64: of the last answer, or `NO_SLOT`; receives those of the nearest or crossing
    triangles, or `NO_SLOT`.
    """
    words, parts, (turn, offset) = model.words, model.parts, frame_map
    limits, entries = stack_f64(MAX_PAIRS), stack_i32_rows(MAX_PAIRS, 3)
    frontier = Frontier(limits, entries, limits, np.int64(0), np.int64(MAX_PAIRS))
    axis, box, lane_limits = stack_f64(6), stack_f64(6), stack_f64(LANES)
    share = 1.0 / ((1.0 + tolerance) * (1.0 + tolerance))
    query, best = _begin(model, first, second, frame_map, best, share, axis, box, slots)
    margin = splat(MAP_ROUNDING * query[2])
    one, other = NODE_STRIDE * parts[first].root, NODE_STRIDE * parts[second].root
    count, left = 0, bits(used_lanes(words, one))
    while left:
        position, begin = one + trailing_zeros(left), count
        left &= left - 1
        box_at(words, position, box)
        boxes = mapped_boxes(wide_boxes_of(words, other), turn, offset)
        store(lane_limits, 0, gaps_sq(*signed_gaps(lanes_of(box), boxes, margin)))
        used = bits(used_lanes(words, other))
        count = append_children(frontier, count, position, other, False, used, lane_limits)
        nearest_to_end(frontier, begin, begin, count)
    nearest_to_end(frontier, count - 1, 0, count)
    ratio = _ratio(model.frames, first, second)
    best, count, steps = _walk_from_nothing(model, query, ratio, frontier, count, best, budget)
    if best == query[3] and slots[0] != NO_SLOT:
        return 0.0, 0.0, steps
    # Waiting entries have not been searched.
    return best, min(_reach_sq(query, best), lower_limits(frontier, count, 0.0)), steps


@kernel
def _move_limits(frontier, count, motion, rounding):
    """Lower the limits of entries by the *motion* of their balls against their axes, or in any direction."""
    sides, stride, turning_sq = frontier.sides, len(frontier.sides) // SIDE, 0.0
    for k in range(9):
        turning_sq += motion[0][k] * motion[0][k]
    turning = splat(sqrt(turning_sq) * ROUNDED_UP)
    for at in range(frontier.begin, frontier.begin + count, LANES):
        x, y, z = load(sides, at), load(sides, stride + at), load(sides, 2 * stride + at)
        middle = load(sides, 3 * stride + at), load(sides, 4 * stride + at), load(sides, 5 * stride + at)
        mx, my, mz = mapped(*motion, *middle)
        displacement = square_root(dot(mx, my, mz, mx, my, mz)) * splat(ROUNDED_UP)
        fall = select(dot(x, y, z, x, y, z) > splat(0.0), -dot(x, y, z, mx, my, mz), displacement)
        fall = fma(turning, load(sides, 6 * stride + at), fall + splat(rounding))
        store(frontier.limits, at, load(frontier.limits, at) - fall)


@kernel
def nearest_from_frontier(
    model, first, second, frame_map, frontier, count, motion, best, tolerance, budget, slots
):
    """Compute `nearest_of_parts` from a frontier of *count* entries (0: none), and update it.

    *motion*: change of *frame_map* since. Also returns the new count, or `OVERFLOW` if the frontier was too
    small; the other results are then invalid.
    """
    words, parts, axis, box = model.words, model.parts, stack_f64(6), stack_f64(6)
    share = 1.0 / (1.0 + tolerance)
    query, best = _begin(model, first, second, frame_map, best, share, axis, box, slots)
    if count > 0:
        _move_limits(frontier, count, motion, MOTION_ROUNDING * query[2])
    else:
        one, other = NODE_STRIDE * parts[first].root, NODE_STRIDE * parts[second].root
        left, marks = bits(used_lanes(words, one)), bits(used_lanes(words, other))
        while left:
            count = append_entry(frontier, count, one + trailing_zeros(left), other, marks, 0.0)
            set_side(frontier, frontier.begin + count - 1, 0.0, 0.0, 0.0, ROOT_RADIUS)
            left &= left - 1
    ratio = _ratio(model.frames, first, second)
    best, count, steps = _walk_from_frontier(model, query, ratio, frontier, count, best, budget)
    if count == OVERFLOW:
        return best, 0.0, steps, count
    if best == query[3] and slots[0] != NO_SLOT:
        return 0.0, 0.0, steps, count
    reach, lowest = _reach(query, best), lower_limits(frontier, count, 0.0)
    lower = reach if lowest >= reach * NEARLY else max(lowest, 0.0)
    return best, lower * lower if best > 0.0 else 0.0, steps, count
