"""Connection of faces across edges.

An edge of two faces connects them. At an edge of more than two faces, bodies touch. A piece with equal
numbers of forward and backward faces at that edge is complete there. The other faces are paired around the
edge, each with the face across its wedge of material (`wedges`). If the total volume of touching bodies is
negative, they are inside out: their material is on the other side.
"""

from math import frexp, ldexp
from typing import NamedTuple

import numpy as np

from proximity.kernels.bodies.wedges import Wedges, pair_around_edge
from proximity.kernels.mesh.components import component_labels, join, root_of, unlinked
from proximity.kernels.mesh.edges import sorted_half_edges
from proximity.kernels.mesh.faces import enclosed_volumes
from proximity.kernels.mesh.positions import AHEAD, gathered, rows_where
from proximity.native import allocating_kernel, kernel
from proximity.native.simd import prefetch


class Pieces(NamedTuple):
    """K faces that form P connected pieces."""

    labels: np.ndarray  # (K,) int64, 0 .. P - 1
    is_turned: np.ndarray  # (K,) bool, oriented against most faces of its piece
    is_open: np.ndarray  # (K, 3) bool, edge k has no partner
    is_closed: np.ndarray  # (P,) bool, no open edge, and orientable


@allocating_kernel
def connect_given(given, corners, points, edges, vertices, exponent):
    """Connect faces into pieces, by vertex numbers if these close a piece and otherwise by positions.

    *given*: (K, 3), rows of *vertices*. *corners*: (K, 3), rows of *points*; *edges*: their edges. *points*
    are scaled by two to the power of *exponent*, to coordinates of at most 1.
    """
    vertex_count = _distinct_count(given, len(vertices))
    if vertex_count == _distinct_count(corners, len(points)) or vertex_count == 3 * len(given):
        return connect_faces(corners, points, edges)
    numbered = connect_faces(given, scaled(vertices, exponent), sorted_half_edges(given))
    labels, is_turned, is_open, is_closed = numbered
    is_certain = np.empty(len(labels), np.bool_)
    for face in range(len(labels)):
        is_certain[face] = is_closed[labels[face]]
    rows = rows_where(is_certain, False)
    if len(rows) == 0:
        return numbered
    uncertain = gathered(corners, rows)
    others = connect_faces(uncertain, points, sorted_half_edges(uncertain))
    # The pieces by positions come first, then the closed ones.
    closed_at, count = np.full(len(is_closed), -1, np.int64), len(others.is_closed)
    for piece in range(len(is_closed)):
        if is_closed[piece]:
            closed_at[piece] = count
            count += 1
    for face in range(len(labels)):
        labels[face] = closed_at[labels[face]]
    for row in range(len(rows)):
        face = rows[row]
        labels[face], is_turned[face] = others.labels[row], others.is_turned[row]
        for k in range(3):
            is_open[face, k] = others.is_open[row, k]
    all_closed = np.ones(count, np.bool_)
    for piece in range(len(others.is_closed)):
        all_closed[piece] = others.is_closed[piece]
    return Pieces(labels, is_turned, is_open, all_closed)


@kernel
def unit_exponent(points):
    """Return the exponent of the power of two that scales coordinates to at most 1. This scaling is exact."""
    largest = 0.0
    for row in range(len(points)):
        for axis in range(3):
            largest = max(largest, abs(points[row, axis]))
    return -frexp(largest)[1]


@allocating_kernel
def scaled(points, exponent):
    """Return points (N, 3) times two to the power of *exponent*."""
    found = np.empty(points.shape)
    for row in range(len(points)):
        for axis in range(3):
            found[row, axis] = ldexp(points[row, axis], exponent)
    return found


@allocating_kernel
def _distinct_count(ids, size):
    """Return the number of distinct values in *ids* (K, 3), which are below *size*."""
    is_used, found = np.zeros(size, np.bool_), 0
    for row in range(len(ids)):
        for k in range(3):
            found += not is_used[ids[row, k]]
            is_used[ids[row, k]] = True
    return found


@allocating_kernel
def connect_faces(corners, points, edges):
    """Return the pieces formed by faces. Each face has three distinct corners.

    *corners*: (K, 3), rows of *points*, which are scaled to coordinates of at most 1. *edges*: the edges of
    the faces.
    """
    order, starts, forward_counts = edges
    links, is_twisted_face = unlinked(len(corners)), np.zeros(len(corners), np.bool_)
    is_open, longest = np.zeros(corners.shape, np.bool_), 0
    for edge in range(len(forward_counts)):
        first, count = starts[edge], starts[edge + 1] - starts[edge]
        longest = max(longest, count)
        if first + AHEAD < len(order):
            prefetch(links, np.int64(order[first + AHEAD]) // 3)
        if count == 1:
            is_open[order[first] // 3, order[first] % 3] = True
        elif count == 2:
            face = order[first] // 3
            is_crossed = np.int64(forward_counts[edge] != 1)
            is_twisted_face[face] |= not join(links, face, order[first + 1] // 3, is_crossed)
    pieces = _pieces_of(links, is_twisted_face, is_open)
    if longest > 2:
        _join_across_wedges(corners, points, edges, longest, pieces, links, is_twisted_face)
        pieces = _pieces_of(links, is_twisted_face, is_open)
    _turn_fewest(pieces)
    for face in range(len(corners)):
        if is_open[face, 0] or is_open[face, 1] or is_open[face, 2]:
            pieces.is_closed[pieces.labels[face]] = False
    return pieces


@allocating_kernel
def _pieces_of(links, is_twisted_face, is_open):
    """Return the pieces of linked faces, with the faces flipped that oppose the first face of their piece.

    A piece with a twisted face is not orientable, like a Moebius strip, and does not count as closed.
    """
    labels, count = component_labels(links)
    is_turned, is_closed = np.empty(len(labels), np.bool_), np.ones(count, np.bool_)
    for face in range(len(labels)):
        if is_twisted_face[face]:
            is_closed[labels[face]] = False
    for face in range(len(labels)):
        is_turned[face] = root_of(links, face) & 1 == 1 and is_closed[labels[face]]
    return Pieces(labels, is_turned, is_open, is_closed)


@allocating_kernel
def _turn_fewest(pieces):
    """In each piece with most faces flipped, flip the other faces instead."""
    labels, is_turned, _, is_closed = pieces
    majority = np.zeros(len(is_closed), np.int64)
    for face in range(len(labels)):
        majority[labels[face]] += 1 if is_turned[face] else -1
    for face in range(len(labels)):
        is_turned[face] = is_turned[face] != (majority[labels[face]] > 0)


@allocating_kernel
def _join_across_wedges(corners, points, edges, longest, pieces, links, is_twisted_face):
    """Join the faces at edges of more than two faces, each with the face across its wedge of material.

    *longest*: largest number of faces at an edge.
    """
    order, starts, forward_counts = edges
    labels, is_turned, is_open, is_sided = pieces
    is_inside_out = _are_inside_out(corners, points, edges, pieces)
    balances, counts = np.zeros(len(is_sided), np.int64), np.zeros(len(is_sided), np.int64)
    wedges = Wedges(
        np.empty(longest, np.int32),
        np.empty(longest, np.bool_),
        np.empty(longest, np.int64),
        np.empty(longest),
        np.empty(longest),
        np.empty(longest, np.int64),
        np.empty(longest, np.int64),
        np.empty(longest, np.int64),
        np.empty(longest, np.int64),
    )
    for edge in range(len(forward_counts)):
        first, end = starts[edge], starts[edge + 1]
        if end - first <= 2:
            continue
        for position in range(first, end):
            face = order[position] // 3
            is_forward = (position < first + forward_counts[edge]) != is_turned[face]
            balances[labels[face]] += 1 if is_forward else -1
            counts[labels[face]] += 1
        contested_count = 0
        for position in range(first, end):
            half_edge = order[position]
            face = half_edge // 3
            piece = labels[face]
            # A piece is complete at an edge with equal numbers of its forward and backward faces.
            if (balances[piece] if is_sided[piece] else counts[piece] % 2) == 0:
                continue
            is_forward = (position < first + forward_counts[edge]) != is_turned[face]
            wedges.half_edges[contested_count] = half_edge
            wedges.is_forward[contested_count] = is_forward != is_inside_out[face]
            contested_count += 1
            is_open[face, half_edge % 3] = True
        for position in range(first, end):
            balances[labels[order[position] // 3]] = counts[labels[order[position] // 3]] = 0
        is_crossed = np.int64(pair_around_edge(corners, points, wedges, contested_count))
        for row in range(contested_count):
            if wedges.partner[row] < 0:
                continue
            one, other = wedges.half_edges[row], wedges.half_edges[wedges.partner[row]]
            is_open[one // 3, one % 3] = is_open[other // 3, other % 3] = False
            crossed = is_crossed ^ np.int64(is_turned[one // 3] != is_turned[other // 3])
            is_twisted_face[one // 3] |= not join(links, one // 3, other // 3, crossed)


@allocating_kernel
def _are_inside_out(corners, points, edges, pieces):
    """Return a mask of the faces of touching bodies whose total volume is negative, (K,) bool."""
    touching = unlinked(len(pieces.is_closed))
    for edge in range(len(edges.forward_counts)):
        first, end = edges.starts[edge], edges.starts[edge + 1]
        if end - first > 2:
            piece = pieces.labels[edges.order[first] // 3]
            for position in range(first + 1, end):
                join(touching, piece, pieces.labels[edges.order[position] // 3], 0)
    groups, count = component_labels(touching)
    wound, labels = corners.copy(), np.empty(len(corners), np.int64)
    for face in range(len(corners)):
        labels[face] = groups[pieces.labels[face]]
        if pieces.is_turned[face]:
            wound[face, 0], wound[face, 2] = wound[face, 2], wound[face, 0]
    volumes, are_inside_out = enclosed_volumes(points, wound, labels, count), np.empty(len(corners), np.bool_)
    for face in range(len(corners)):
        are_inside_out[face] = volumes[labels[face]] < 0.0
    return are_inside_out
