"""The walk over two parts' trees that goes on where the last one ended.

What a walk opened and did not go into stays in the *frontier*: pairs of a node and a box, with those children
of the node that were too far, and a distance below which none of them is; and pairs of blocks, with one below
which none of their triangles is. When a part has moved, all distances are lowered by how far; only what is
then nearer than the best is looked at again. It is the argument of the coherent point search.

With a budget the nearest are looked at first, sweep by sweep, so that the bound rises as far as it can.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from proximity.kernels.layout import LANES, NO_SLOT, NODE_STRIDE
from proximity.kernels.nodes import child_at, used_lanes
from proximity.kernels.pair.blocks import MAP_ROUNDING, nearer_in_blocks
from proximity.kernels.pair.meeting import meeting_reach
from proximity.kernels.pair.walk import begin_short, bounds_of_children, opens_first, rounding_size
from proximity.kernels.stack_arrays import stack_f64
from proximity.native import inlined, kernel
from proximity.native.simd import (
    bits,
    horizontal_min,
    load,
    minimum,
    splat,
    store,
    trailing_zeros,
)

FRONTIER_ENTRIES = 32_768
"""Of all frontiers together: with 20 bytes each, 655 KB."""
FEWEST_FRONTIERS, MOST_FRONTIERS = 4, 32
"""As many as there are pairs of parts, within these limits."""
CHILDREN = 255
OPENED_FIRST = 256
BLOCKS = 512
"""Bits of an entry: children that are too far; whether the node is the first part's; a pair of blocks."""
NEARLY = 1.0 - 2.0**-40
"""Share of the best at which an entry is far enough: so much a root may be rounded down."""
OVERFLOW = -2.0
"""Bound of a walk that had no room left."""
PAIR_SWEEP_SHARE = 0.25
"""Share of the way from the lowest bound to the best that a sweep looks at, where there is a budget."""


class Frontier(NamedTuple):
    """Where a frontier is: so many entries from *begin* on, with room for a vector behind the last."""

    limits: np.ndarray  # float64, local units of the first part: nothing in an entry is nearer
    entries: np.ndarray  # (…, 3) int32: positions in words of both parts, and bits
    begin: int
    capacity: int


@inlined
def _add(frontier, count, one, other, marks, limit):
    """Append an entry; return how many there are then."""
    at = frontier.begin + count
    frontier.limits[at] = limit
    frontier.entries[at, 0], frontier.entries[at, 1], frontier.entries[at, 2] = one, other, marks
    return count + 1


@kernel
def _plant(words, parts, first, second, frontier):
    """Begin a frontier with the children of both roots; return the count."""
    one, other, count = NODE_STRIDE * parts[first].root, NODE_STRIDE * parts[second].root, 0
    left, marks = bits(used_lanes(words, one)), bits(used_lanes(words, other))
    while left:
        lane = trailing_zeros(left)
        left &= left - 1
        count = _add(frontier, count, one + lane, other, marks, 0.0)
    return count


@kernel
def _lower(frontier, count, by):
    """Lower all limits; return the lowest."""
    lowest = splat(np.inf)
    for at in range(frontier.begin, frontier.begin + count, LANES):
        limits = load(frontier.limits, at) - splat(by)
        store(frontier.limits, at, limits)
        lowest = minimum(lowest, limits)
    return horizontal_min(lowest)


@kernel
def _open_entry(model, first, second, frame_map, frontier, at, count, reach, axis):
    """Look at the children of an entry again, and append those that are within reach; return the count.

    The entry keeps the others; its marks are 0 where none is left.
    """
    words, frames = model.words, model.frames
    one, other, marks = frontier.entries[at, 0], frontier.entries[at, 1], frontier.entries[at, 2]
    is_first = marks & OPENED_FIRST != 0
    ratio = abs(frames[first].scale / frames[second].scale)
    margin = splat(MAP_ROUNDING * rounding_size(frames, first, second, frame_map[1]))
    bounds = bounds_of_children(words, one, other, is_first, frame_map, margin, axis, stack_f64(7))
    lane_bounds = stack_f64(LANES)
    store(lane_bounds, 0, bounds)
    near = bits(bounds < splat(reach * reach)) & marks & CHILDREN
    left, lowest = marks & CHILDREN & ~near, np.inf
    frontier.entries[at, 2] = (left | (marks & OPENED_FIRST)) if left else 0
    while left:
        lowest = min(lowest, lane_bounds[trailing_zeros(left)])
        left &= left - 1
    frontier.limits[at] = sqrt(lowest)
    while near:
        lane = trailing_zeros(near)
        near &= near - 1
        below, beside = one + (lane if is_first else 0), other + (0 if is_first else lane)
        below_one = child_at(words, below)
        below_other = child_at(words, beside)
        limit = sqrt(lane_bounds[lane])
        if below_one < 0 and below_other < 0:
            count = _add(frontier, count, below, beside, BLOCKS, limit)
        elif opens_first(words, below_one, below_other, below, beside, ratio):
            node = NODE_STRIDE * below_one
            count = _add(frontier, count, node, beside, bits(used_lanes(words, node)) | OPENED_FIRST, limit)
        else:
            node = NODE_STRIDE * below_other
            count = _add(frontier, count, below, node, bits(used_lanes(words, node)), limit)
    return count


@inlined
def _remove(frontier, at, count):
    """Put the last entry where one was; return how many are left."""
    last = frontier.begin + count - 1
    frontier.limits[at] = frontier.limits[last]
    for k in range(3):
        frontier.entries[at, k] = frontier.entries[last, k]
    # What is loaded beyond the last entry is far.
    frontier.limits[last] = np.inf
    return count - 1


@kernel
def nearest_from_frontier(
    model, first, second, frame_map, frontier, count, moved, best, tolerance, budget, slots
):
    """As `nearest_of_parts`, from a frontier of *count* entries, 0: none, which it renews.

    *moved*: how far anything on either part has moved since, local units. Also returns the new count. The
    bound is `OVERFLOW` where there was no room for the frontier: then nothing else is of use.
    """
    words, parts, frames = model.words, model.parts, model.frames
    axis, steps = stack_f64(3), 0
    axis[0], axis[1], axis[2] = 0.0, 0.0, 0.0
    slack = rounding_size(frames, first, second, frame_map[1])
    meeting_sq = meeting_reach(slack) * meeting_reach(slack)
    best = begin_short(model, first, second, frame_map[0], frame_map[1], best, axis, slots)
    best = max(best, meeting_sq)
    if count == 0:
        count = _plant(words, parts, first, second, frontier)
        store(frontier.limits, frontier.begin + count, splat(np.inf))
        moved = 0.0
    share, lowest = 1.0 / (1.0 + tolerance), _lower(frontier, count, moved)
    reach = sqrt(best) * share
    while best > 0.0 and lowest < reach * NEARLY and (budget == 0 or steps < budget):
        sweep = reach if budget == 0 else lowest + PAIR_SWEEP_SHARE * (reach - lowest)
        at = frontier.begin
        while at < frontier.begin + count and best > 0.0 and (budget == 0 or steps < budget):
            if not frontier.limits[at] < min(sweep, reach * NEARLY):
                at += 1
                continue
            steps += 1
            if frontier.entries[at, 2] == BLOCKS:
                one = ~child_at(words, frontier.entries[at, 0])
                other = ~child_at(words, frontier.entries[at, 1])
                best, least_sq = nearer_in_blocks(
                    model, (first, second), one, other, frame_map, slack, best, axis, slots
                )
                reach = sqrt(max(best, 0.0)) * share
                least = reach if best == meeting_sq else sqrt(max(least_sq, 0.0))
                frontier.limits[at] = max(frontier.limits[at], least)
                at += 1
            else:
                if count + 3 * LANES > frontier.capacity:
                    return best, OVERFLOW, steps, 0
                count = _open_entry(model, first, second, frame_map, frontier, at, count, reach, axis)
                store(frontier.limits, frontier.begin + count, splat(np.inf))
                if frontier.entries[at, 2] == 0:
                    count = _remove(frontier, at, count)
                else:
                    at += 1
        lowest = _lower(frontier, count, 0.0)
    if best == meeting_sq and slots[0] != NO_SLOT:
        return 0.0, 0.0, steps, count
    lower = reach if lowest >= reach * NEARLY else max(lowest, 0.0)
    return best, lower * lower if best > 0.0 else 0.0, steps, count
