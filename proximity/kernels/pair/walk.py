"""The nearest two triangles of two parts, or two that cross: walks over both trees at once.

Everything is computed in the local frame of the first part, and boxes in float64. The larger box of a pair
is opened, and its eight children are compared with the other box at once. A box of the second part is taken
into the frame of the first with a box around it.

A walk from nothing opens the nearest pair first; its limits are squared distances. A walk from the frontier
of the last one continues where that ended: limits, which are distances, are lowered by how far a part has
moved, and only entries that are then nearer than the best are opened again.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.closest_feature import (
    closest_on_triangle,
    read_corners,
    stack_closest,
)
from proximity.kernels.geometry.rows import vector
from proximity.kernels.layout import LANES, MAX_DEPTH, NO_SLOT, NODE_STRIDE, STACKS_SIZE
from proximity.kernels.nodes import used_lanes, wide_boxes_of
from proximity.kernels.pair.blocks import nearer_in_blocks, turn_axis
from proximity.kernels.pair.boxes import (
    MAP_ROUNDING,
    begins_of,
    box_at,
    ends_of,
    farther,
    gaps_sq,
    lanes_of,
    mapped,
    mapped_box_at,
    mapped_boxes,
    rounding_size,
    to_second,
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

MOST_TURNS = 4
"""Times that a search between surfaces goes to and fro."""
MOST_PAIRS = 2 * MAX_DEPTH * (LANES - 1) + LANES * LANES + 3 * LANES
"""Each opened box leaves at most seven children waiting; at first all children of both roots wait."""


@inlined
def _children_sq(model, query, one, other, is_first):
    """Squared distances of the eight children of a node with a box that none of them is nearer than.

    *one*, *other*: that of the part whose node is opened (*is_first*: the first) is a node, the other the
    position of a box.
    """
    (_, (turn, offset), slack, _, _, axis, box, _), words = query, model.words
    margin = splat(MAP_ROUNDING * slack)
    if is_first:
        mapped_box_at(words, other, turn, offset, axis, box)
        opened = wide_boxes_of(words, one)
        return farther(gaps_sq(opened, lanes_of(box), margin), splat(box[6]), ends_of(opened, axis), margin)
    box_at(words, one, axis, box)
    bounds = gaps_sq(lanes_of(box), mapped_boxes(words, other, turn, offset), margin)
    return farther(bounds, begins_of(words, other, turn, offset, axis), splat(box[6]), margin)


@inlined
def _children(model, query, one, other, is_first):
    return square_root(_children_sq(model, query, one, other, is_first))


@inlined
def _look_into_sq(model, query, first, second, best):
    """The best squared distance with what two blocks have, and one below which none of their triangles is."""
    pair, frame_map, slack, _, _, axis, _, slots = query
    return nearer_in_blocks(model, pair, first, second, frame_map, slack, best, axis, slots)


@inlined
def _look_into(model, query, first, second, best):
    best, least_sq = _look_into_sq(model, query, first, second, best)
    meeting_sq = query[3]
    return best, _reach(query, best) if best == meeting_sq else sqrt(max(least_sq, 0.0))


@inlined
def _reach_sq(query, best):
    """Squared distance from which on nothing is looked for: the best, less a share."""
    return best * query[4]


@inlined
def _reach(query, best):
    return sqrt(max(best, 0.0)) * query[4]


_walk_from_nothing = dual_first(_children_sq, _look_into_sq, _reach_sq, is_kept=False)
_walk_from_frontier = dual_first(_children, _look_into, _reach, is_kept=True)


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
    closest = stack_closest(1)[0]
    read_corners(reals, slot, closest)
    closest_on_triangle(x, y, z, closest)
    return vector(closest.point)


@inlined
def _begin(model, first, second, frame_map, best, share, axis, box, slots):
    """The query of a walk, and the best squared distance to begin with."""
    slack, (turn, offset) = rounding_size(model.frames, first, second, frame_map[1]), frame_map
    meeting_sq = meeting_reach(slack) * meeting_reach(slack)
    axis[0], axis[1], axis[2] = 0.0, 0.0, 0.0
    best = max(begin_short(model, first, second, turn, offset, best, axis, slots), meeting_sq)
    return ((first, second), frame_map, slack, meeting_sq, share, axis, box, slots), best


@inlined
def _ratio(frames, first, second):
    """Length of the second part's local unit in the first's."""
    return abs(frames[first].scale / frames[second].scale)


@kernel
def nearest_of_parts(model, first, second, frame_map, best, tolerance, budget, slots):
    """Squared distance, in the local frame of part *first*, to part *second*; one that none is below; steps.

    `CROSSING` where they cross. *frame_map*: `frames_between` them. *best*: only what is nearer is looked
    for, and nothing that is nearer by less than a share of *tolerance*. *budget*: opened nodes and blocks at
    most; 0: as many as it takes. *slots* (2,) int64: of the last answer, or `NO_SLOT`; filled with those of
    the nearest triangles, or of two that cross, or `NO_SLOT`.
    """
    words, parts, (turn, offset) = model.words, model.parts, frame_map
    limits, entries = stack_f64(MOST_PAIRS), stack_i32_rows(MOST_PAIRS, 3)
    frontier = Frontier(limits, entries, np.int64(0), np.int64(MOST_PAIRS))
    axis, box, lane_limits = stack_f64(3), stack_f64(7), stack_f64(LANES)
    share = 1.0 / ((1.0 + tolerance) * (1.0 + tolerance))
    query, best = _begin(model, first, second, frame_map, best, share, axis, box, slots)
    margin = splat(MAP_ROUNDING * query[2])
    one, other = NODE_STRIDE * parts[first].root, NODE_STRIDE * parts[second].root
    count, left = 0, bits(used_lanes(words, one))
    while left:
        position, begin = one + trailing_zeros(left), count
        left &= left - 1
        box_at(words, position, axis, box)
        store(lane_limits, 0, gaps_sq(lanes_of(box), mapped_boxes(words, other, turn, offset), margin))
        used = bits(used_lanes(words, other))
        count = append_children(frontier, count, position, other, False, used, lane_limits)
        nearest_to_end(frontier, begin, begin, count)
    nearest_to_end(frontier, count - 1, 0, count)
    ratio = _ratio(model.frames, first, second)
    best, count, steps = _walk_from_nothing(model, query, ratio, frontier, count, best, budget)
    if best == query[3] and slots[0] != NO_SLOT:
        return 0.0, 0.0, steps
    # What still waits was not looked into.
    return best, min(_reach_sq(query, best), lower_limits(frontier, count, 0.0)), steps


@kernel
def nearest_from_frontier(
    model, first, second, frame_map, frontier, count, moved, best, tolerance, budget, slots
):
    """As `nearest_of_parts`, from a frontier of *count* entries, 0: none, which it renews.

    *moved*: how far anything on either part has moved since, local units. Also returns the new count;
    `OVERFLOW` where there was no room for the frontier: then nothing else is of use.
    """
    words, parts, axis, box = model.words, model.parts, stack_f64(3), stack_f64(7)
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
