"""Building of a binary tree over boxes by the binned surface area heuristic.

A box is *packed* into eight float32: its lower x, y, z, a zero, its negated upper x, y, z, a zero. The box
around two others is their lane-wise minimum.

Boxes are moved along with the numbers of their faces, so that every pass reads memory sequentially. Each run
of boxes takes two passes. One assigns its boxes to bins by their centres, the other partitions it; the boxes
of both sides come from the bins.

Source: Wald 2007, "On fast construction of SAH-based bounding volume hierarchies" (bins).
"""

import numpy as np

from proximity.kernels.geometry.rows import copy_numbers, copy_row
from proximity.kernels.layout import BOX_STRIDE
from proximity.native import allocating_kernel, inlined, kernel
from proximity.native.simd import halves_swapped, lane, load, minimum, splat32, store

LINK_LEFT = 0
"""Columns of the links of a binary tree (int32).

They are the two children of a node, or -1 in a leaf; and the first face and the number of faces of a leaf, in
the order of faces.
"""
LINK_RIGHT = 1
LINK_FIRST = 2
LINK_COUNT = 3
NO_CHILD = -1
BIN_COUNT = 16
HALVED_DEPTH = 64
"""Level from which on runs are halved by count. The tree of any mesh then ends at most 28 levels later."""
MAX_WAITING_NODES = 64
"""Length of the stack of runs.

The larger side of a run is pushed first, so that the entries are at most the number of halvings of 2^31
faces.
"""

# Offsets of a split's results for both sides: packed boxes, and doubled centres.
_LEFT_BOX, _LEFT_MIDDLES, _RIGHT_BOX, _RIGHT_MIDDLES = 0, 8, 16, 24


@inlined
def _sides(box):
    """Return the negated sides of a packed box along x, y and z."""
    sides = box + halves_swapped(box)
    return lane(sides, 0), lane(sides, 1), lane(sides, 2)


@inlined
def half_area(box):
    """Return half of the surface area of a packed box."""
    dx, dy, dz = _sides(box)
    return dx * (dy + dz) + dy * dz


@inlined
def thickness(box):
    """Return the shortest side of a packed box."""
    dx, dy, dz = _sides(box)
    return -max(dx, dy, dz)


@inlined
def unpack(record, box):
    """Write a packed box to *box* (6,), as its lower and upper corner."""
    for axis in range(3):
        box[axis], box[axis + 3] = lane(record, axis), -lane(record, axis + 4)


@inlined
def _middles(box):
    """Return a packed box that has only one point, which is twice the centre of *box*."""
    return box - halves_swapped(box)


@inlined
def _nowhere():
    """Return a packed box that is empty."""
    return splat32(np.float32(np.inf))


@kernel
def _measure(boxes, first, count, sides, at):
    """Write the box of a run, and the box of its doubled centres, to *sides*."""
    box, middles = _nowhere(), _nowhere()
    for position in range(first, first + count):
        record = load(boxes, BOX_STRIDE * position)
        box, middles = minimum(box, record), minimum(middles, _middles(record))
    store(sides, at, box)
    store(sides, at + BOX_STRIDE, middles)


@inlined
def _bins_for(count):
    """Return the number of bins along an axis for a run."""
    return min(BIN_COUNT, 2 * count)


@inlined
def _bin_rate(middles, at, axis, bin_count):
    """Return the number of bins per unit of doubled centres along an axis."""
    extent = -middles[at + 4 + axis] - middles[at + axis]
    return np.float32(bin_count * 0.9999) / extent if extent > 0.0 else np.float32(0.0)


@inlined
def _bin(boxes, position, axis, start, rate, bin_count):
    """Return the number of the bin for the box at *position*."""
    at = BOX_STRIDE * position + axis
    return min(np.int64((boxes[at] - boxes[at + 4] - start) * rate), bin_count - 1)


@kernel
def _fill_bins(boxes, first, count, middles, at, bins, bin_counts):
    """Assign the boxes of a run to bins along each of the three axes."""
    used = _bins_for(count)
    for axis in range(3):
        for b in range(BIN_COUNT * axis, BIN_COUNT * axis + used):
            bin_counts[b] = 0
            store(bins, BOX_STRIDE * b, _nowhere())
    start_x, start_y, start_z = middles[at], middles[at + 1], middles[at + 2]
    rate_x, rate_y, rate_z = (
        _bin_rate(middles, at, 0, used),
        _bin_rate(middles, at, 1, used),
        _bin_rate(middles, at, 2, used),
    )
    for position in range(first, first + count):
        record = load(boxes, BOX_STRIDE * position)
        x = _bin(boxes, position, 0, start_x, rate_x, used)
        y = _bin(boxes, position, 1, start_y, rate_y, used) + BIN_COUNT
        z = _bin(boxes, position, 2, start_z, rate_z, used) + 2 * BIN_COUNT
        for b in (x, y, z):
            box = minimum(load(bins, BOX_STRIDE * b), record)
            # Between load and store: LLVM would otherwise make them a masked store, slow on AMD (1.8 times).
            bin_counts[np.uint64(b)] += 1
            store(bins, BOX_STRIDE * b, box)


@kernel
def _best_plane(bins, bin_counts, used, leaf_shift, right_costs):
    """Return the last bin on the left side of the best plane of all axes, or -1 if no plane separates boxes.

    Only the first *used* bins of each axis are filled. The cost of a side is its surface area times its
    number of leaves.
    """
    round_up = (1 << leaf_shift) - 1
    best_cost, best = np.float32(np.inf), -1
    for axis in range(3):
        box, number = _nowhere(), 0
        for b in range(used - 1, 0, -1):
            number += bin_counts[BIN_COUNT * axis + b]
            box = minimum(box, load(bins, BOX_STRIDE * (BIN_COUNT * axis + b)))
            leaves = np.float32((number + round_up) >> leaf_shift)
            right_costs[b] = half_area(box) * leaves if number else np.float32(np.inf)
        box, number = _nowhere(), 0
        for b in range(used - 1):
            number += bin_counts[BIN_COUNT * axis + b]
            box = minimum(box, load(bins, BOX_STRIDE * (BIN_COUNT * axis + b)))
            if number == 0:
                continue
            leaves = np.float32((number + round_up) >> leaf_shift)
            cost = half_area(box) * leaves + right_costs[b + 1]
            if cost < best_cost:
                best_cost, best = cost, BIN_COUNT * axis + b
    return best


@kernel
def _divide(boxes, order, first, count, middles, at, bins, plane, sides):
    """Partition the boxes of a run by a plane. Return how many are on its left, and fill *sides*."""
    axis, last, used = plane // BIN_COUNT, plane % BIN_COUNT, _bins_for(count)
    start, rate = middles[at + axis], _bin_rate(middles, at, axis, used)
    left_middles, right_middles = _nowhere(), _nowhere()
    left, right = first, first + count - 1
    while left <= right:
        record = load(boxes, BOX_STRIDE * left)
        if _bin(boxes, left, axis, start, rate, used) <= last:
            left_middles = minimum(left_middles, _middles(record))
            left += 1
        else:
            right_middles = minimum(right_middles, _middles(record))
            store(boxes, BOX_STRIDE * left, load(boxes, BOX_STRIDE * right))
            store(boxes, BOX_STRIDE * right, record)
            order[left], order[right] = order[right], order[left]
            right -= 1
    left_box, right_box = _nowhere(), _nowhere()
    for b in range(used):
        box = load(bins, BOX_STRIDE * (BIN_COUNT * axis + b))
        if b <= last:
            left_box = minimum(left_box, box)
        else:
            right_box = minimum(right_box, box)
    store(sides, _LEFT_BOX, left_box)
    store(sides, _LEFT_MIDDLES, left_middles)
    store(sides, _RIGHT_BOX, right_box)
    store(sides, _RIGHT_MIDDLES, right_middles)
    return left - first


@inlined
def _write_leaf(links, node, first, count):
    """Write a node of the binary tree that has faces, and no children yet."""
    links[node, LINK_LEFT], links[node, LINK_RIGHT] = NO_CHILD, NO_CHILD
    links[node, LINK_FIRST], links[node, LINK_COUNT] = first, count


@allocating_kernel
def halve(boxes, order, leaf_shift):
    """Return the boxes (N * `BOX_STRIDE`) and the links (N, 4) of a binary tree, whose root is node 0.

    *boxes*: (F * `BOX_STRIDE`,) float32, the boxes of the faces, F >= 1. *order*: the numbers of the faces.
    Both are sorted into the order of the tree. *leaf_shift*: a leaf has at most ``2 ** leaf_shift`` faces.
    """
    capacity = max(64, len(order) >> leaf_shift << 1)
    nodes = np.empty(capacity * BOX_STRIDE, np.float32)
    links = np.empty((capacity, 4), np.int32)
    bins = np.empty(3 * BIN_COUNT * BOX_STRIDE, np.float32)
    bin_counts = np.empty(3 * BIN_COUNT, np.int32)
    right_costs = np.empty(BIN_COUNT, np.float32)
    sides = np.empty(4 * BOX_STRIDE, np.float32)
    waiting = np.empty((MAX_WAITING_NODES, 2), np.int64)  # node and depth
    middles = np.empty(MAX_WAITING_NODES * BOX_STRIDE, np.float32)
    _measure(boxes, 0, len(order), sides, 0)
    copy_numbers(sides, 0, nodes, 0, BOX_STRIDE)
    copy_numbers(sides, BOX_STRIDE, middles, 0, BOX_STRIDE)
    _write_leaf(links, 0, 0, len(order))
    waiting[0, 0], waiting[0, 1] = 0, 0
    node_count, waiting_count = 1, 1
    while waiting_count:
        waiting_count -= 1
        node, depth = waiting[waiting_count]
        first, count = np.int64(links[node, LINK_FIRST]), np.int64(links[node, LINK_COUNT])
        if count <= 1 << leaf_shift:
            continue
        plane = -1
        if depth < HALVED_DEPTH and count > 2:
            _fill_bins(boxes, first, count, middles, BOX_STRIDE * waiting_count, bins, bin_counts)
            plane = _best_plane(bins, bin_counts, _bins_for(count), leaf_shift, right_costs)
        if plane >= 0:
            left = _divide(
                boxes, order, first, count, middles, BOX_STRIDE * waiting_count, bins, plane, sides
            )
        else:
            left = count // 2
            _measure(boxes, first, left, sides, _LEFT_BOX)
            _measure(boxes, first + left, count - left, sides, _RIGHT_BOX)
        if node_count + 2 > capacity:
            capacity *= 2
            more_nodes, more_links = (
                np.empty(capacity * BOX_STRIDE, np.float32),
                np.empty((capacity, 4), np.int32),
            )
            copy_numbers(nodes, 0, more_nodes, 0, BOX_STRIDE * node_count)
            for kept in range(node_count):
                copy_row(links, kept, more_links, kept)
            nodes, links = more_nodes, more_links
        links[node, LINK_LEFT], links[node, LINK_RIGHT] = node_count, node_count + 1
        _write_leaf(links, node_count, first, left)
        _write_leaf(links, node_count + 1, first + left, count - left)
        # The larger side waits longer.
        smaller = 0 if left <= count - left else 1
        for side in (1 - smaller, smaller):
            at = _RIGHT_BOX if side else _LEFT_BOX
            copy_numbers(sides, at, nodes, BOX_STRIDE * (node_count + side), BOX_STRIDE)
            copy_numbers(sides, at + BOX_STRIDE, middles, BOX_STRIDE * waiting_count, BOX_STRIDE)
            waiting[waiting_count, 0], waiting[waiting_count, 1] = node_count + side, depth + 1
            waiting_count += 1
        node_count += 2
    return nodes[: BOX_STRIDE * node_count].copy(), links[:node_count].copy()
