"""Half-edges of faces sorted by edge, and the topology that follows from them.

An edge is an unordered pair of corners. A *half-edge* is one face's side of an edge: half-edge ``3 * face +
k`` runs from corner k to corner k + 1 of that face. It is *forward* if it runs from the lower corner to the
higher one. An edge between two equal corners (of a face without area) connects no faces.
"""

from typing import NamedTuple

import numpy as np

from proximity.kernels.mesh.components import component_labels, join, unlinked
from proximity.kernels.mesh.positions import AHEAD
from proximity.native import allocating_kernel, entry, inlined, kernel
from proximity.native.simd import prefetch

INSERTED = 16
"""Length of the longest run that is sorted by insertion."""
NO_NEIGHBOR = -1
"""Code for an edge that no other face has."""
MANY_NEIGHBORS = -2
"""Code for an edge of more than two faces, or of two faces with the same direction."""
EDGES, BOUNDARY, NONMANIFOLD, MISORIENTED, UNBALANCED = range(5)
"""Kinds of edges that are counted.

They are all edges; those of one face, or between equal corners; those of more than two faces; those of two
faces with the same direction; and those with unequal numbers of forward and backward half-edges.
"""


class EdgeRuns(NamedTuple):
    """Half-edges sorted by edge. The half-edges of edge e are ``order[starts[e] : starts[e + 1]]``.

    Edges are sorted by the lower corner, then by the higher one. Within an edge, forward half-edges come
    first, and each kind is in ascending order.
    """

    order: np.ndarray  # (3 F,) int32
    starts: np.ndarray  # (E + 1,) int32
    forward_counts: np.ndarray  # (E,) int32


@allocating_kernel
def sorted_half_edges(corners):
    """Return the half-edges of faces, sorted by edge. *corners*: (F, 3) int32, not negative.

    They are sorted by the lower corner with a counting sort. Then each short run is sorted by the higher
    corner.
    """
    order, keys = np.empty(corners.size, np.int32), np.empty(corners.size, np.uint32)
    ends = _spread(corners, order, keys)
    starts, forward_counts = np.empty(corners.size + 1, np.int32), np.empty(corners.size, np.int32)
    longest, first = 0, 0
    for low in range(len(ends)):
        longest, first = max(longest, ends[low] - first), ends[low]
    other_keys, other_rows = np.empty(longest, np.uint32), np.empty(longest, np.int32)
    found, first = 0, 0
    for low in range(len(ends)):
        sort_run(keys, order, first, ends[low], other_keys, other_rows)
        for position in range(first, ends[low]):
            if position == first or keys[position] >> 1 != keys[position - 1] >> 1:
                starts[found], forward_counts[found] = position, 0
                found += 1
            forward_counts[found - 1] += keys[position] & 1 == 0
        first = ends[low]
    starts[found] = corners.size
    return EdgeRuns(order, starts[: found + 1].copy(), forward_counts[:found].copy())


@inlined
def ends_of(corners, half_edge):
    """Return the start and end corner of a half-edge."""
    face, k = half_edge // 3, half_edge % 3
    return corners[face, k], corners[face, (k + 1) % 3]


@inlined
def is_loop(corners, half_edge):
    """Test whether an edge is between two equal corners."""
    start, end = ends_of(corners, half_edge)
    return start == end


@allocating_kernel
def _spread(corners, order, keys):
    """Sort half-edges by the lower corner of their edge into *order*. Return the end of each corner's run.

    *keys* is filled with twice the higher corner, plus one for backward half-edges.
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
        for k in range(3 if face + AHEAD < len(corners) else 0):
            prefetch(ends, np.int64(min(corners[face + AHEAD, k], corners[face + AHEAD, (k + 1) % 3])))
        for k in range(3):
            one, other = corners[face, k], corners[face, (k + 1) % 3]
            position = ends[min(one, other)]
            order[position] = 3 * face + k
            keys[position] = 2 * np.int64(max(one, other)) + (one > other)
            ends[min(one, other)] = position + 1
    return ends


@kernel
def sort_run(keys, rows, first, end, other_keys, other_rows):
    """Sort a run of *rows* by its *keys*. Rows with equal keys keep their order.

    *other_keys*, *other_rows*: scratch memory, with the length of the run.
    """
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
    """Merge two adjacent sorted runs. Rows with equal keys keep their order."""
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


@entry("int32[:, 3] -> int32[:, :], int64[:]", makes_arrays=True)
def face_topology(corners):
    """Return the face across each edge of each face, (F, 3) int32, and the counts of edges, (5,).

    If there is not exactly one such face, its place has `NO_NEIGHBOR` or `MANY_NEIGHBORS`. The counts are
    described at `EDGES`. *corners*: (F, 3), with one number per position.
    """
    edges = sorted_half_edges(corners)
    order, starts, forward_counts = edges
    neighbors, counts = np.empty(corners.shape, np.int32), np.zeros(UNBALANCED + 1, np.int64)
    counts[EDGES] = len(forward_counts)
    for edge in range(len(forward_counts)):
        first, count = starts[edge], starts[edge + 1] - starts[edge]
        if first + AHEAD + 1 < len(order):
            prefetch(corners, np.int64(order[first + AHEAD]))
            prefetch(neighbors, np.int64(order[first + AHEAD]))
            prefetch(neighbors, np.int64(order[first + AHEAD + 1]))
        alone = NO_NEIGHBOR
        if count == 1 or is_loop(corners, order[first]):
            counts[BOUNDARY] += 1
            counts[UNBALANCED] += not is_loop(corners, order[first])
        else:
            alone = MANY_NEIGHBORS
            counts[NONMANIFOLD] += count > 2
            counts[MISORIENTED] += count == 2 and forward_counts[edge] != 1
            counts[UNBALANCED] += 2 * forward_counts[edge] != count
            if count == 2 and forward_counts[edge] == 1:
                one, other = order[first], order[first + 1]
                neighbors[one // 3, one % 3], neighbors[other // 3, other % 3] = other // 3, one // 3
                continue
        for position in range(first, first + count):
            neighbors[order[position] // 3, order[position] % 3] = alone
    return neighbors, counts


@entry("int32[:, 3] -> int, bool", makes_arrays=True)
def surface_shells(corners):
    """Return the number of surfaces connected by edges of two faces, and whether they are oriented.

    They are oriented if at each inner edge the numbers of forward and backward half-edges are equal, or
    differ by one where their sum is odd.
    """
    order, starts, forward_counts = sorted_half_edges(corners)
    links, is_oriented = unlinked(len(corners)), True
    for edge in range(len(forward_counts)):
        first, count = starts[edge], starts[edge + 1] - starts[edge]
        if is_loop(corners, order[first]):
            continue
        is_oriented &= abs(2 * forward_counts[edge] - count) <= count % 2
        if count == 2:
            join(links, order[first] // 3, order[first + 1] // 3, 0)
    return component_labels(links)[1], is_oriented
