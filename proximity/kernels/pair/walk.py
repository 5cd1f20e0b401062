"""Nearest or crossing triangles of two parts: simultaneous traversal of both trees.

All computations are in the local frame of the first part, with boxes in float64. The larger box of a pair is
opened, and its eight children are tested against the other box together. A box of the second part is replaced
by the axis-aligned box around it in that frame.

A search without a frontier opens the nearest pair first; its limits are squared distances. A search from the
last frontier continues from it: limits, which are distances, are reduced by the motion of the parts, and only
entries nearer than the best are opened again.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.closest_feature import (
    closest_on_triangle,
    read_corners,
    stack_closest,
)
from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import LANES, MAX_DEPTH, NO_SLOT, NODE_STRIDE, STACKS_SIZE
from proximity.kernels.nodes import used_lanes, wide_boxes_of
from proximity.kernels.pair.blocks import nearer_in_blocks, turn_axis
from proximity.kernels.pair.boxes import (
    MAP_ROUNDING,
    box_at,
    farther,
    gaps_sq,
    lanes_of,
    mapped,
    mapped_box_at,
    mapped_boxes,
    opposite_in_second,
    rounding_size,
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
    Frontier,
    append_children,
    append_entry,
    dual_first,
    lower_limits,
    nearest_to_end,
)
from proximity.native import inlined, kernel
from proximity.native.simd import bits, splat, square_root, store, trailing_zeros

MAX_TURNS = 4
"""Maximum alternations of the initial search between the surfaces."""
MAX_PAIRS = 2 * MAX_DEPTH * (LANES - 1) + LANES * LANES + 3 * LANES
"""Each opened box leaves at most seven waiting children; at first all children of both roots wait."""


@inlined
def _children_sq(model, query, one, other, is_first):
    """Return lower bounds of the squared distances of a node's eight children from a box.

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
        gaps = splat(begin) - upper_ends(words, moments, one, boxes, ahead)
        return farther(gaps_sq(boxes, lanes_of(box), margin), gaps, margin)
    box_at(words, one, box)
    boxes = wide_boxes_of(words, other)
    end = upper_end_at(words, moments, one, ahead)
    gaps = splat(start) - upper_ends(words, moments, other, boxes, back) - splat(end)
    return farther(gaps_sq(lanes_of(box), mapped_boxes(boxes, turn, offset), margin), gaps, margin)


@inlined
def _children(model, query, one, other, is_first):
    return square_root(_children_sq(model, query, one, other, is_first))


@inlined
def _look_into_sq(model, query, first, second, best):
    """Update the best squared distance with two blocks; also return a lower bound of theirs."""
    pair, frame_map, slack, _, _, axis, _, slots = query
    return nearer_in_blocks(model, pair, first, second, frame_map, slack, best, axis, slots)


@inlined
def _look_into(model, query, first, second, best):
    best, min_sq = _look_into_sq(model, query, first, second, best)
    meeting_sq = query[3]
    return best, _reach(query, best) if best == meeting_sq else sqrt(max(min_sq, 0.0))


@inlined
def _reach_sq(query, best):
    """Return the squared distance at which the search ends: the best, reduced by the tolerance."""
    return best * query[4]


@inlined
def _reach(query, best):
    return sqrt(max(best, 0.0)) * query[4]


_walk_from_nothing = dual_first(_children_sq, _look_into_sq, _reach_sq, is_kept=False)
_walk_from_frontier = dual_first(_children, _look_into, _reach, is_kept=True)


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
    frontier = Frontier(limits, entries, np.int64(0), np.int64(MAX_PAIRS))
    axis, box, lane_limits = stack_f64(3), stack_f64(6), stack_f64(LANES)
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
        store(lane_limits, 0, gaps_sq(lanes_of(box), boxes, margin))
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
def nearest_from_frontier(
    model, first, second, frame_map, frontier, count, moved, best, tolerance, budget, slots
):
    """Compute `nearest_of_parts` from a frontier of *count* entries (0: none), and update it.

    *moved*: maximum displacement of any point of either part since, local units. Also returns the new count,
    or `OVERFLOW` if the frontier was too small; the other results are then invalid.
    """
    words, parts, axis, box = model.words, model.parts, stack_f64(3), stack_f64(6)
    share = 1.0 / (1.0 + tolerance)
    query, best = _begin(model, first, second, frame_map, best, share, axis, box, slots)
    if count > 0:
        lower_limits(frontier, count, moved)
    else:
        one, other = NODE_STRIDE * parts[first].root, NODE_STRIDE * parts[second].root
        left, marks = bits(used_lanes(words, one)), bits(used_lanes(words, other))
        while left:
            count = append_entry(frontier, count, one + trailing_zeros(left), other, marks, 0.0)
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
