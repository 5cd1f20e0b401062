"""Positions of corners. Vertices at exactly equal positions count as one corner; -0.0 equals 0.0."""

import numpy as np

from proximity.native import allocating_kernel, entry, inlined, kernel
from proximity.native.simd import prefetch

AHEAD = 12
"""Faces or half-edges before its turn that a row is prefetched: a large mesh does not fit into the cache."""
NO_ROW_YET = -1
HASH_FACTOR = 0x2545F491
"""Factor for hashing. It is odd and without a pattern; below 2**30, its product with 32 bits fits int64."""
LOW_BITS = 0xFFFFFFFF


@entry("float64[:, 3], int32[:, 3] -> int32[:, :], float64[:, :]", makes_arrays=True)
def merged_faces(vertices, faces):
    """Return faces with positions instead of vertices, (F, 3) int32, and the positions, (K, 3), without -0.0.

    Positions are numbered in the order of their first vertices. *vertices*: (V, 3), finite if used by a face.
    """
    number = np.full(len(vertices), NO_ROW_YET, np.int32)
    for face in range(len(faces)):
        for k in range(3):
            number[faces[face, k]] = 0
    used_count = 0
    for vertex in range(len(vertices)):
        if number[vertex] == 0:
            number[vertex] = used_count
            used_count += 1
    used = np.empty((used_count, 3))
    for vertex in range(len(vertices)):
        if number[vertex] >= 0:
            for axis in range(3):
                used[number[vertex], axis] = vertices[vertex, axis] + 0.0  # the sum turns -0.0 into 0.0
    # At first this is the first equal row of each row. The number of its position then replaces it.
    position = first_of_equal_rows(used)
    found = 0
    for row in range(used_count):
        if position[row] < row:
            position[row] = position[position[row]]
            continue
        for axis in range(3):
            used[found, axis] = used[row, axis]
        position[row] = found
        found += 1
    ids = np.empty(faces.shape, np.int32)
    for face in range(len(faces)):
        for k in range(3):
            ids[face, k] = position[number[faces[face, k]]]
    return ids, used[:found].copy()


@allocating_kernel
def first_of_equal_rows(rows):
    """Return the first row that equals each of *rows*, (N,) int32. *rows*: (N, 3) float64, without -0.0."""
    size = 4
    while size < 2 * len(rows):
        size *= 2
    bits = rows.view(np.int64)
    first, row_at = np.empty(len(rows), np.int32), np.full(size, NO_ROW_YET, np.int32)
    for row in range(len(rows)):
        at = _hash_of(bits, row) & (size - 1)
        while row_at[at] != NO_ROW_YET and not _are_equal(rows, row_at[at], row):
            at = (at + 1) & (size - 1)
        if row_at[at] == NO_ROW_YET:
            row_at[at] = row
        first[row] = row_at[at]
    return first


@inlined
def fetch_corners(corners, faces, face):
    """Prefetch the corners of the face `AHEAD` rows after *face*, if there is one."""
    if face + AHEAD < len(faces):
        for k in range(3):
            prefetch(corners, 3 * np.int64(faces[face + AHEAD, k]))
            prefetch(corners, 3 * np.int64(faces[face + AHEAD, k]) + 2)


@kernel
def _hash_of(bits, row):
    mixed = 0
    for axis in range(3):
        word = bits[row, axis]
        mixed = _mixed_with(_mixed_with(mixed, word & LOW_BITS), (word >> 32) & LOW_BITS)
    return mixed


@inlined
def _mixed_with(mixed, half):
    mixed = ((mixed ^ half) * HASH_FACTOR) & LOW_BITS
    return mixed ^ (mixed >> 15)  # the low bits of a product depend only on the low bits of its factors


@inlined
def _are_equal(rows, one, other):
    return (
        rows[one, 0] == rows[other, 0] and rows[one, 1] == rows[other, 1] and rows[one, 2] == rows[other, 2]
    )


@allocating_kernel
def gathered(table, rows):
    """Return some *rows* of a table (N, 3)."""
    taken = np.empty((len(rows), 3), table.dtype)
    for row in range(len(rows)):
        for k in range(3):
            taken[row, k] = table[rows[row], k]
    return taken


@allocating_kernel
def rows_where(values, wanted):
    """Return the rows at which *values* (N,) equal *wanted*, in ascending order, (K,) int32."""
    rows, found = np.empty(len(values), np.int32), 0
    for row in range(len(values)):
        if values[row] == wanted:
            rows[found] = row
            found += 1
    return rows[:found].copy()
