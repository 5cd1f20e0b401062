"""Removal of redundant faces, which have no area or equal another face.

A face is removed only if afterwards no more edges are unbalanced (with unequal numbers of forward and
backward faces) than before. A sliver between two rows of faces that meet at different points along a line has
no area but closes the surface. Coincident faces of two bodies may have the same orientation, and both are
needed. Groups of faces connected by edges are judged together, so that a body that occurs twice is removed as
a whole.
"""

import numpy as np

from proximity.kernels.mesh.components import join, root_of, unlinked
from proximity.kernels.mesh.faces import thin_faces
from proximity.kernels.mesh.positions import first_of_equal_rows, rows_where
from proximity.native import allocating_kernel

DEGENERATE_HEIGHT = 16.0 * 2.0**-52
"""A face without area is lower than this, relative to the largest coordinate.

Such a height is within rounding.
"""
LEFT, SLIVER, DUPLICATE = range(3)


@allocating_kernel
def useless_faces(corners, points, edges):
    """Return for each face whether it stays, or else the reason for its removal, (F,) uint8.

    *corners*: (F, 3). *points*: (C, 3), scaled to coordinates of at most 1. *edges*: the edges of the faces.
    Of several equal faces, the first stays.
    """
    kinds = np.empty(len(corners), np.uint8)
    for face in range(len(corners)):
        a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
        kinds[face] = LEFT if a != b and b != c and c != a else SLIVER
    _drop(edges, kinds, _equals_earlier_face(corners, edges, kinds), DUPLICATE)
    _drop(edges, kinds, thin_faces(points, corners, DEGENERATE_HEIGHT), SLIVER)
    return kinds


@allocating_kernel
def _equals_earlier_face(corners, edges, kinds):
    """Return a mask of the faces with the same corners and winding as an earlier face, (F,) bool."""
    crowded_sides, is_twin = np.zeros(len(corners), np.uint8), np.zeros(len(corners), np.bool_)
    # Equal faces have equal half-edges: only faces at edges with several in one direction are candidates.
    order, starts, forward_counts = edges
    for edge in range(len(forward_counts)):
        first, end, forward = starts[edge], starts[edge + 1], forward_counts[edge]
        if forward > 1 or end - first - forward > 1:
            for position in range(first, end):
                crowded_sides[order[position] // 3] += kinds[order[position] // 3] == LEFT
    rows = rows_where(crowded_sides, 3)
    wound = np.empty((len(rows), 3))
    for row in range(len(rows)):
        a, b, c = corners[rows[row], 0], corners[rows[row], 1], corners[rows[row], 2]
        lowest = 0 if a < min(b, c) else (1 if b < c else 2)
        for k in range(3):
            wound[row, k] = corners[rows[row], (lowest + k) % 3]
    first_equal = first_of_equal_rows(wound)
    for row in range(len(rows)):
        is_twin[rows[row]] = first_equal[row] < row
    return is_twin


@allocating_kernel
def _drop(edges, kinds, is_candidate, kind):
    """Mark candidates (F,) for removal, by setting their *kind*.

    A group of candidates is removed if no more edges are unbalanced without it.
    """
    if len(rows_where(is_candidate, True)) == 0:
        return
    links, worse = unlinked(len(kinds)), np.zeros(len(kinds), np.int64)
    for turn in range(2):
        for edge in range(len(edges.forward_counts)):
            first, balance, without, last = edges.starts[edge], 0, 0, -1
            for position in range(first, edges.starts[edge + 1]):
                face = edges.order[position] // 3
                if kinds[face] != LEFT:
                    continue
                direction = 1 if position < first + edges.forward_counts[edge] else -1
                balance += direction
                if not is_candidate[face]:
                    without += direction
                    continue
                if last >= 0 and turn == 0:
                    join(links, last, face, 0)
                last = face
            if last >= 0 and turn == 1:  # an edge belongs to one group: all candidates at it are connected
                worse[root_of(links, last) >> 1] += abs(without) - abs(balance)
    for face in range(len(kinds)):
        if kinds[face] == LEFT and is_candidate[face] and worse[root_of(links, face) >> 1] <= 0:
            kinds[face] = kind
