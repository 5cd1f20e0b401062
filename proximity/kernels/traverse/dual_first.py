"""Loop over two trees, as a factory of inlined kernels.

The *frontier* is the list of open entries. An entry is a pair of boxes, or a node of one tree and a box of
the other, with those children of the node that are too far. Each has a *limit*, a lower bound of its
distances. Boxes and nodes are given by their positions in ``words``.

A walk that drops entries opens the last one and appends its children, the nearest at the end. A walk that
keeps them goes through the list in sweeps and leaves the entries that are too far in it, as the start of the
next walk. With a budget a sweep opens only the nearest entries, so that the lowest limit rises quickly.

A kept entry has a *side*: an axis along which its boxes are separated by the limit, or 0, and a ball around
the box of the second tree. Motion across the axis then does not lower the limit.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from proximity.kernels.geometry.frames import ROUNDED_UP
from proximity.kernels.layout import LANES, NODE_STRIDE
from proximity.kernels.nodes import child_at, lower_at, upper_at, used_lanes
from proximity.kernels.stack_arrays import stack_f64
from proximity.native import inlined, kernel
from proximity.native.simd import bits, horizontal_min, load, minimum, splat, store, trailing_zeros

CHILDREN = 255
OPENED_FIRST = 256
BLOCKS = 512
BOXES = 1024
"""Bits of an entry: remaining children; node of the first tree; pair of blocks; pair of boxes."""
NEARLY = 1.0 - 2.0**-40
"""Share of the reach at which a kept entry is far enough; covers the rounding of a square root."""
PAIR_SWEEP_SHARE = 0.25
"""Share of the interval from the lowest limit to the reach that a sweep covers, with a budget."""
SIDE = 7
"""Numbers of a side: axis; middle and radius of the ball, in the second frame."""
OVERFLOW = -1
"""Count returned by a walk that has exceeded the frontier's capacity."""


class Frontier(NamedTuple):
    """A run of entries, with room for the children of one more and a full vector past the end."""

    limits: np.ndarray  # float64
    entries: np.ndarray  # (…, 3) int32: positions in words of both trees, and bits
    sides: np.ndarray  # (SIDE * …,) float64, by number; empty if entries are not kept
    begin: int
    capacity: int


@inlined
def append_entry(frontier, count, one, other, marks, limit):
    """Append an entry; return the count."""
    at = frontier.begin + count
    frontier.limits[at] = limit
    frontier.entries[at, 0], frontier.entries[at, 1], frontier.entries[at, 2] = one, other, marks
    return count + 1


@inlined
def _side_at(words, position, axis):
    """Return the side of a box along an axis."""
    return np.float64(upper_at(words, position, axis)) - np.float64(lower_at(words, position, axis))


@inlined
def set_axis(frontier, at, axis):
    """Set the axis of an entry, which is at *at* in the arrays."""
    stride = len(frontier.sides) // SIDE
    for k in range(3):
        frontier.sides[k * stride + at] = axis[k]


@inlined
def set_side(frontier, at, x, y, z, radius):
    """Set the ball of an entry, without an axis."""
    sides, stride = frontier.sides, len(frontier.sides) // SIDE
    set_axis(frontier, at, (0.0, 0.0, 0.0))
    sides[3 * stride + at], sides[4 * stride + at], sides[5 * stride + at] = x, y, z
    sides[6 * stride + at] = radius


@inlined
def _set_side_of_box(frontier, at, words, other):
    """Set the ball of an entry to that around the box *other*."""
    hx, hy, hz = (
        0.5 * _side_at(words, other, 0),
        0.5 * _side_at(words, other, 1),
        0.5 * _side_at(words, other, 2),
    )
    x, y, z = lower_at(words, other, 0) + hx, lower_at(words, other, 1) + hy, lower_at(words, other, 2) + hz
    set_side(frontier, at, x, y, z, sqrt(hx * hx + hy * hy + hz * hz) * ROUNDED_UP)


@inlined
def append_children(frontier, count, one, other, is_first, lanes, lane_limits):
    """Append pairs of children (bits) of the node *one* or *other* with the other box; return the count."""
    while lanes:
        lane = trailing_zeros(lanes)
        lanes &= lanes - 1
        below, beside = one + (lane if is_first else 0), other + (0 if is_first else lane)
        count = append_entry(frontier, count, below, beside, BOXES, lane_limits[lane])
    return count


@inlined
def nearest_to_end(frontier, favorite, begin, count):
    """Exchange the last entry with the nearest from *begin* on; ties go to the *favorite*, or the first."""
    limits, entries, last = frontier.limits, frontier.entries, frontier.begin + count - 1
    nearest = frontier.begin + favorite
    for at in range(frontier.begin + begin, last + 1):
        if limits[at] < limits[nearest]:
            nearest = at
    if count > begin:
        limits[nearest], limits[last] = limits[last], limits[nearest]
        for k in range(3):
            entries[nearest, k], entries[last, k] = entries[last, k], entries[nearest, k]


@kernel
def lower_limits(frontier, count, by):
    """Subtract *by* from all limits; return the lowest."""
    lowest, end = splat(np.inf), frontier.begin + count
    store(frontier.limits, end, lowest)
    for at in range(frontier.begin, end, LANES):
        limits = load(frontier.limits, at) - splat(by)
        store(frontier.limits, at, limits)
        lowest = minimum(lowest, limits)
    return horizontal_min(lowest)


@inlined
def _size_at(words, position):
    """Return the longest side of a box."""
    return max(_side_at(words, position, 0), _side_at(words, position, 1), _side_at(words, position, 2))


@inlined
def _node_of_boxes(words, one, other, ratio):
    """Open a pair of boxes: unless both are blocks, the larger one becomes a node with all its children."""
    below_one, below_other = child_at(words, one), child_at(words, other)
    if below_one < 0 and below_other < 0:
        return one, other, np.int64(BLOCKS)
    is_first = below_other < 0 or (below_one >= 0 and _size_at(words, one) > ratio * _size_at(words, other))
    node = NODE_STRIDE * np.int64(below_one if is_first else below_other)
    marks = np.int64(bits(used_lanes(words, node)))
    return (node, other, marks | OPENED_FIRST) if is_first else (one, node, marks)


def dual_first(open_children, look_into, reach_of, axis_of):
    """Return a walk over a frontier of *count* entries; it returns the best, the new count, and the steps.

    - ``open_children(model, query, one, other, is_first)``: limits of the eight pairs of children and box,
      and their gaps for ``axis_of``;
    - ``look_into(model, query, one, other, best)``: *best* updated with two blocks, their limit and axis;
    - ``reach_of(query, best)``: the limit up to which entries are opened;
    - ``axis_of(gaps, lane_limits, lanes, reach)``: of those children, the limit and its axis; without it,
      entries are dropped.

    *best*: only smaller distances are searched, and the walk ends when it is 0 or less. *ratio*: the second
    tree's unit of length in that of the first. *budget*: maximum steps (opened entries), or 0 for no limit.
    """
    is_kept = axis_of is not None

    @inlined
    def walk(model, query, ratio, frontier, count, best, budget):
        limits, entries, begin = frontier.limits, frontier.entries, frontier.begin
        words, lane_limits, reach = model.words, stack_f64(LANES), reach_of(query, best)
        steps, number, sweep, stride = 0, count, 0.0, len(frontier.sides) // SIDE
        while best > 0.0 and (budget == 0 or steps < budget):
            if is_kept:
                while number < count and not limits[begin + number] < min(sweep, reach * NEARLY):
                    number += 1
                if number >= count:
                    number, lowest = 0, lower_limits(frontier, count, 0.0)
                    sweep = reach if budget == 0 else lowest + PAIR_SWEEP_SHARE * (reach - lowest)
                    if not lowest < reach * NEARLY:
                        break
                    continue
            else:
                while count > 0 and not limits[begin + count - 1] < reach:
                    count -= 1
                if count == 0:
                    break
                number = count - 1
            steps += 1
            at = begin + number
            one, other, marks = np.int64(entries[at, 0]), np.int64(entries[at, 1]), np.int64(entries[at, 2])
            if marks == BOXES:
                one, other, marks = _node_of_boxes(words, one, other, ratio)
            if marks == BLOCKS:
                blocks = ~child_at(words, one), ~child_at(words, other)
                best, limit, axis = look_into(model, query, *blocks, best)
                reach = reach_of(query, best)
                limits[at] = max(limits[at], limit)
                if is_kept and limits[at] == limit:
                    set_axis(frontier, at, axis)
                number += 1
                count = count if is_kept else count - 1
                continue
            if count + 3 * LANES > frontier.capacity:
                return best, OVERFLOW, steps
            is_first = marks & OPENED_FIRST != 0
            bounds, gaps = open_children(model, query, one, other, is_first)
            store(lane_limits, 0, bounds)
            near = bits(bounds < splat(reach)) & marks & CHILDREN
            left = marks & CHILDREN & ~near
            if not is_kept:
                end = append_children(frontier, count - 1, one, other, is_first, near, lane_limits)
                nearest_to_end(frontier, count - 1, count - 1, end)
                count = end
                continue
            end = count
            count = append_children(frontier, count, one, other, is_first, near, lane_limits)
            for new in range(begin + end, begin + count):
                _set_side_of_box(frontier, new, words, np.int64(entries[new, 1]))
            if not left:  # replaced by the last entry
                count -= 1
                limits[at] = limits[begin + count]
                for k in range(3):
                    entries[at, k] = entries[begin + count, k]
                for k in range(SIDE):
                    frontier.sides[k * stride + at] = frontier.sides[k * stride + begin + count]
                continue
            entries[at, 0], entries[at, 1], entries[at, 2] = one, other, left | (marks & OPENED_FIRST)
            limits[at], axis = axis_of(gaps, lane_limits, left, reach)
            set_axis(frontier, at, axis)
            number += 1
        return best, count, steps

    return walk
