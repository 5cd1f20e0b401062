"""Equal corners of faces, their half-edges sorted by edge, and what links connect, by union and find."""

import numpy as np

from proximity.native import allocating_kernel, entry, inlined, kernel

NO_EQUAL = -1
INSERTED = 16
"""Rows up to which a run is sorted by insertion."""
NO_NEIGHBOR = -1
"""No other face has this edge."""
MANY_NEIGHBORS = -2
"""More than two faces have this edge, or two that run along it the same way."""


@entry("float64[:, 3], uint32[:] -> int32[:]", makes_arrays=True)
def first_of_equal_rows(rows, keys):
    """Return for each of *rows* (N, 3) float64 the first one that equals it, (N,) int32.

    *keys* (N,) uint32: equal ones for equal rows, others for most others.
    """
    size = 4
    while size < 2 * len(rows):
        size *= 2
    first, row_at = np.empty(len(rows), np.int32), np.full(size, NO_EQUAL, np.int32)
    for row in range(len(rows)):
        position = np.int64(keys[row]) & (size - 1)
        while row_at[position] != NO_EQUAL and not _are_equal(rows, row_at[position], row):
            position = (position + 1) & (size - 1)
        if row_at[position] == NO_EQUAL:
            row_at[position] = row
        first[row] = row_at[position]
    return first


@inlined
def _are_equal(rows, one, other):
    return (
        rows[one, 0] == rows[other, 0] and rows[one, 1] == rows[other, 1] and rows[one, 2] == rows[other, 2]
    )


@entry("int32[:, 3] -> int32[:], bool[:], int32[:], int32[:], int32[:], bool[:]", makes_arrays=True)
def sorted_half_edges(corners):
    """Return half-edges by the lower, then the higher corner of their edges; forward ones come first.

    *corners* (F, 3) int32, not negative. Half-edge ``3 * face + k`` runs from corner k of a face to the next;
    forward is from the lower corner to the higher.

    Returned: of each edge: its first position in that order, how many there are, and how many run forward.

    Notes
    -----
    By counting for the lower corners; of the few that share one each run is sorted by itself.
    """
    order, keys = np.empty(corners.size, np.int32), np.empty(corners.size, np.uint32)
    ends = _spread(corners, order, keys)
    is_forward, is_loop = np.empty(corners.size, np.bool_), np.empty(corners.size, np.bool_)
    starts, forward_counts = np.empty(corners.size + 1, np.int32), np.empty(corners.size, np.int32)
    longest, first = 0, 0
    for low in range(len(ends)):
        longest, first = max(longest, ends[low] - first), ends[low]
    other_keys, other_rows = np.empty(longest, np.uint32), np.empty(longest, np.int32)
    found, first = 0, 0
    for low in range(len(ends)):
        _sort_run(keys, order, first, ends[low], other_keys, other_rows)
        for position in range(first, ends[low]):
            high = keys[position] >> 1
            if position == first or high != keys[position - 1] >> 1:
                starts[found], is_loop[found], forward_counts[found] = position, high == low, 0
                found += 1
            is_forward[position] = keys[position] & 1 == 0
            forward_counts[found - 1] += is_forward[position]
        first = ends[low]
    starts[found] = corners.size
    counts = np.empty(found, np.int32)
    for edge in range(found):
        counts[edge] = starts[edge + 1] - starts[edge]
    return (
        order,
        is_forward,
        starts[:found].copy(),
        counts,
        forward_counts[:found].copy(),
        is_loop[:found].copy(),
    )


@allocating_kernel
def _spread(corners, order, keys):
    """Put half-edges to *order* by the lower corner of their edges, and return where each corner's end.

    *keys*: twice the higher corner, and one more where they run backward.
    """
    largest = 0
    for face in range(len(corners)):
        largest = max(largest, corners[face, 0], corners[face, 1], corners[face, 2])
    ends = np.zeros(largest + 2, np.int64)
    for face in range(len(corners)):
        for k in range(3):
            ends[min(corners[face, k], corners[face, (k + 1) % 3]) + 1] += 1
    for low in range(1, len(ends)):
        ends[low] += ends[low - 1]
    for face in range(len(corners)):
        for k in range(3):
            one, other = corners[face, k], corners[face, (k + 1) % 3]
            position = ends[min(one, other)]
            order[position] = 3 * face + k
            keys[position] = 2 * np.int64(max(one, other)) + (one > other)
            ends[min(one, other)] = position + 1
    return ends


@kernel
def _sort_run(keys, rows, first, end, other_keys, other_rows):
    """Sort a run by its keys; equal ones keep their order. The last two: scratch, as long as the run."""
    for start in range(first, end, INSERTED):
        for position in range(start + 1, min(start + INSERTED, end)):
            key, row, at = keys[position], rows[position], position
            while at > start and keys[at - 1] > key:
                keys[at], rows[at] = keys[at - 1], rows[at - 1]
                at -= 1
            keys[at], rows[at] = key, row
    width = INSERTED
    while width < end - first:
        for start in range(first, end - width, 2 * width):
            _merge(keys, rows, start, start + width, min(start + 2 * width, end), other_keys, other_rows)
        width *= 2


@kernel
def _merge(keys, rows, first, middle, end, other_keys, other_rows):
    """Merge two sorted runs, one behind the other; of equal keys those of the first come first."""
    count = middle - first
    for k in range(count):
        other_keys[k], other_rows[k] = keys[first + k], rows[first + k]
    left, right, at = 0, middle, first
    while left < count:
        if right < end and keys[right] < other_keys[left]:
            keys[at], rows[at] = keys[right], rows[right]
            right += 1
        else:
            keys[at], rows[at] = other_keys[left], other_rows[left]
            left += 1
        at += 1


@entry("int32[:], int32[:], int32[:], bool[:], bool[:] -> int32[:]", makes_arrays=True)
def neighbors_across(order, starts, counts, is_loop, is_opposed):
    """Return the face across each half-edge, (H,) int32, or `NO_NEIGHBOR` or `MANY_NEIGHBORS`.

    *order*, *starts*, *counts*, *is_loop*: as `sorted_half_edges` returns them. *is_opposed* (E,): the edge
    has two half-edges that run opposite ways.
    """
    neighbors = np.empty(len(order), np.int32)
    for edge in range(len(starts)):
        first = starts[edge]
        if is_opposed[edge]:
            one, other = order[first], order[first + 1]
            neighbors[one], neighbors[other] = other // 3, one // 3
            continue
        alone = NO_NEIGHBOR if counts[edge] == 1 or is_loop[edge] else MANY_NEIGHBORS
        for position in range(first, first + counts[edge]):
            neighbors[order[position]] = alone
    return neighbors


@kernel
def _root(parents, node):
    """The lowest node known to be connected with *node*; paths there are halved."""
    while parents[node] != node:
        parents[node] = parents[parents[node]]
        node = parents[node]
    return node


@entry("int, int64[:], int64[:] -> int32[:]", makes_arrays=True)
def connected(count, one, other):
    """Return labels (count,) int32 of nodes that the links *one* to *other* (L,) int64 connect.

    They count from 0 and rise with the lowest node of each component.
    """
    parents = np.arange(count)
    for link in range(len(one)):
        first, last = _root(parents, one[link]), _root(parents, other[link])
        parents[max(first, last)] = min(first, last)
    labels = np.empty(count, np.int32)
    found = 0
    for node in range(count):
        root = _root(parents, node)
        if root == node:
            labels[node] = found
            found += 1
        else:
            labels[node] = labels[root]
    return labels
