"""The half-edges of faces, sorted by edge."""

import numpy as np

from proximity.native import entry, kernel


@entry("int32[:, 3] -> int64[:], bool[:], int64[:], int64[:], int64[:], bool[:]", makes_arrays=True)
def sorted_half_edges(corners):
    """Return half-edges by the lower, then the higher corner of their edges; forward ones come first.

    *corners* (F, 3) int32, not negative. Half-edge ``3 * face + k`` runs from corner k of a face to the next;
    forward is from the lower corner to the higher.

    Returns
    -------
    order : (H,) int64
        Half-edges; of one kind and edge by number.
    is_forward : (H,) bool
        In that order.
    starts, counts, forward_counts : (E,) int64
        Of each edge: its first position in that order, how many there are, and how many run forward.
    is_loop : (E,) bool
        Both corners are equal.

    Notes
    -----
    Sorted by counting, from the least digit on: linear, whatever meets at a corner.
    """
    lows, highs = np.empty(corners.size, np.int32), np.empty(corners.size, np.int32)
    flags = np.empty(corners.size, np.bool_)
    for face in range(len(corners)):
        for k in range(3):
            one, other = corners[face, k], corners[face, (k + 1) % 3]
            lows[3 * face + k], highs[3 * face + k] = min(one, other), max(one, other)
            flags[3 * face + k] = one <= other
    by_direction, order = np.empty(corners.size, np.int64), np.empty(corners.size, np.int64)
    forward, backward, largest = 0, 0, 0
    for half in range(corners.size):
        backward += flags[half]
        largest = max(largest, highs[half])
    for half in range(corners.size):
        if flags[half]:
            by_direction[forward] = half
            forward += 1
        else:
            by_direction[backward] = half
            backward += 1
    next_positions = np.empty(largest + 2, np.int64)
    _sort_by(highs, by_direction, next_positions, order)
    _sort_by(lows, order, next_positions, by_direction)
    order, is_forward = by_direction, np.empty(corners.size, np.bool_)
    starts, forward_counts = np.empty(corners.size + 1, np.int64), np.zeros(corners.size, np.int64)
    is_loop = np.empty(corners.size, np.bool_)
    found, low, high = 0, np.int32(-1), np.int32(-1)
    for position in range(corners.size):
        half = order[position]
        if lows[half] != low or highs[half] != high:
            low, high = lows[half], highs[half]
            starts[found], is_loop[found] = position, low == high
            found += 1
        is_forward[position] = flags[half]
        forward_counts[found - 1] += flags[half]
    starts[found] = corners.size
    counts = np.empty(found, np.int64)
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


@kernel
def _sort_by(keys, rows, next_positions, into):
    """Fill *into* with *rows*, by their keys; equal ones keep their order. *next_positions*: scratch."""
    next_positions[:] = 0
    for row in rows:
        next_positions[keys[row] + 1] += 1
    for key in range(1, len(next_positions)):
        next_positions[key] += next_positions[key - 1]
    for row in rows:
        into[next_positions[keys[row]]] = row
        next_positions[keys[row]] += 1
