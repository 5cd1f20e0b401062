"""Splitting of faces into bodies, which are welded, cleaned and oriented outward. See `mesh.body_split`."""

from math import ldexp
from typing import NamedTuple

import numpy as np

from proximity.kernels.bodies.cavities import nest_shells, rows_by_label
from proximity.kernels.bodies.connected_faces import connect_given, scaled, unit_exponent
from proximity.kernels.bodies.degenerate_faces import LEFT, SLIVER, useless_faces
from proximity.kernels.bodies.vertex_weld import distance_between, weld_near
from proximity.kernels.mesh.components import component_labels, join, unlinked
from proximity.kernels.mesh.edges import sorted_half_edges
from proximity.kernels.mesh.faces import enclosed_volumes
from proximity.kernels.mesh.positions import gathered, merged_faces, rows_where
from proximity.native import allocating_kernel, entry

MERGED, WELDED, WELD_DISTANCE, SLIVERS, DUPLICATES, TURNED, TURNED_INSIDE_OUT = range(7)
"""Columns of the repairs of a body. See `mesh.body_split.Repairs`."""


class Stock(NamedTuple):
    """The given faces, and the results of the steps so far."""

    given: np.ndarray  # (F, 3) int32, rows of vertices
    merged: np.ndarray  # (F, 3) int32, rows of positions
    corners: np.ndarray  # (F, 3) int32, likewise, after welding
    kinds: np.ndarray  # (F,) uint8, see `degenerate_faces`
    is_turned: np.ndarray  # (F,) bool, flipped to match the orientation of the others
    is_inside_out: np.ndarray  # (F,) bool, flipped (again) with all others
    points: np.ndarray  # (C, 3) float64, positions scaled to coordinates of at most 1
    exponent: int  # of the scale, a power of two: products of three neither over- nor underflow


@entry(
    "float64[:, 3], int32[:, 3] -> float64[:, :], int32[:, :], int32[:], int64[:, :], float64[:, :]",
    makes_arrays=True,
)
def split_faces(vertices, faces):
    """Split faces into bodies, and weld, clean and orient each body.

    *vertices*: (V, 3) m, finite if used by a face. *faces*: (F, 3), F >= 1, rows of *vertices*.

    Five arrays are returned, with the bodies in the order of their first faces. They are vertices (W, 3),
    distinct within a body and without -0.0; faces (K, 3), numbered within the vertices of their body; the
    rows of these faces in *faces* (K,), ascending within a body; the ends of the vertices and faces of each
    body (B, 2); and the repairs of each body (B, 7), see `MERGED`. There are no bodies if no face has an
    area.
    """
    merged, positions = merged_faces(vertices, faces)
    exponent = unit_exponent(positions)
    points = scaled(positions, exponent)
    edges = sorted_half_edges(merged)
    kinds = useless_faces(merged, points, edges)
    is_turned, is_inside_out = np.zeros(len(faces), np.bool_), np.zeros(len(faces), np.bool_)
    stock = Stock(faces, merged, merged.copy(), kinds, is_turned, is_inside_out, points, exponent)
    rows = rows_where(kinds, LEFT)
    labels, body_count = np.empty(0, np.int64), 0
    if len(rows) > 0:
        rows, labels, body_count = _bodies_of_faces(stock, vertices, edges, rows)
    face_starts, order = rows_by_label(labels, body_count)
    sources = np.empty(len(rows), np.int32)
    for row in range(len(rows)):
        sources[row] = rows[order[row]]
    split, repairs = gathered(stock.corners, sources), np.zeros((body_count, TURNED_INSIDE_OUT + 1))
    for row in range(len(rows)):
        if is_turned[sources[row]] != is_inside_out[sources[row]]:
            split[row, 1], split[row, 2] = split[row, 2], split[row, 1]
    uses, vertex_counts = _corner_uses(split, face_starts, len(positions))
    if body_count > 0:
        _count_lost_faces(stock, uses, repairs)
    _count_repairs(stock, sources, face_starts, len(vertices), vertex_counts, repairs)
    ends, end = np.empty((body_count, 2), np.int64), 0
    for body in range(body_count):
        end += vertex_counts[body]
        ends[body, 0], ends[body, 1] = end, face_starts[body + 1]
    return _number_by_body(split, positions, uses, ends), split, sources, ends, repairs


@allocating_kernel
def _bodies_of_faces(stock, vertices, edges, rows):
    """Weld and orient faces.

    Return the remaining faces (K,), the body of each (K,), and the number of bodies.
    """
    given, corners = gathered(stock.given, rows), gathered(stock.corners, rows)
    if len(rows) < len(stock.given):
        edges = sorted_half_edges(corners)
    pieces = connect_given(given, corners, stock.points, edges, vertices, stock.exponent)
    if len(rows_where(pieces.is_closed, False)) > 0:
        welded, is_collapsed = weld_near(corners, stock.points, pieces)
        for row in range(len(rows)):
            if is_collapsed[row]:
                stock.kinds[rows[row]] = SLIVER
            for k in range(3):
                stock.corners[rows[row], k] = welded[row, k]
        rows = rows_where(stock.kinds, LEFT)
        given, corners = gathered(stock.given, rows), gathered(stock.corners, rows)
        edges = sorted_half_edges(corners)
        pieces = connect_given(given, corners, stock.points, edges, vertices, stock.exponent)
    labels, is_turned, _, is_closed = pieces
    for row in range(len(rows)):
        if is_turned[row]:
            stock.is_turned[rows[row]] = True
            corners[row, 1], corners[row, 2] = corners[row, 2], corners[row, 1]
    volumes = enclosed_volumes(stock.points, corners, labels, len(is_closed))
    for piece in range(len(is_closed)):
        is_closed[piece] = is_closed[piece] and volumes[piece] != 0.0
    if len(rows_where(is_closed, False)) > 0:
        labels, is_closed = _joined_at_corners(corners, labels, is_closed, len(stock.points))
        volumes = enclosed_volumes(stock.points, corners, labels, len(is_closed))
    body_of_shell, is_inside_out = nest_shells(stock.points, corners, labels, volumes, is_closed)
    body_at, body_count = np.full(len(is_closed), -1, np.int64), 0
    for row in range(len(rows)):
        stock.is_inside_out[rows[row]] = is_inside_out[labels[row]]
        body = body_of_shell[labels[row]]
        if body_at[body] < 0:
            body_at[body] = body_count
            body_count += 1
        labels[row] = body_at[body]
    return rows, labels, body_count


@allocating_kernel
def _joined_at_corners(corners, labels, is_closed, corner_count):
    """Merge pieces without a volume that share a corner.

    Sides that were meshed independently match at no edge and enclose a volume only together; a two-sided
    sheet decomposes into flat pieces. Return the shell of each face (K,), and which shells are closed.
    """
    links, piece_at = unlinked(len(is_closed)), np.full(corner_count, -1, np.int64)
    for face in range(len(labels)):
        piece = labels[face]
        if is_closed[piece]:
            continue
        for k in range(3):
            corner = corners[face, k]
            if piece_at[corner] >= 0:
                join(links, piece_at[corner], piece, 0)
            piece_at[corner] = piece
    shells, count = component_labels(links)
    joined, are_closed = np.empty(len(labels), np.int64), np.empty(count, np.bool_)
    for piece in range(len(is_closed)):
        are_closed[shells[piece]] = is_closed[piece]
    for face in range(len(labels)):
        joined[face] = shells[labels[face]]
    return joined, are_closed


class Uses(NamedTuple):
    """The bodies at each corner.

    Those at corner c are in ascending order, from ``starts[c]`` to ``starts[c + 1]``.
    """

    starts: np.ndarray  # (C + 1,) int64
    bodies: np.ndarray  # (N,) int64
    numbers: np.ndarray  # (N,) int32, of the corner within that body


@allocating_kernel
def _corner_uses(corners, face_starts, corner_count):
    """Return the bodies at each corner, and the number of corners of each body, (B,) int64.

    *corners*: the corners of the faces, body by body.
    """
    starts, last_body = np.zeros(corner_count + 1, np.int64), np.full(corner_count, -1, np.int32)
    counts = np.zeros(len(face_starts) - 1, np.int64)
    for body in range(len(counts)):
        for face in range(face_starts[body], face_starts[body + 1]):
            for k in range(3):
                starts[corners[face, k] + 1] += last_body[corners[face, k]] != body
                last_body[corners[face, k]] = body
    for corner in range(corner_count):
        starts[corner + 1] += starts[corner]
    ends, bodies = starts.copy(), np.zeros(starts[corner_count], np.int64)
    for body in range(len(counts) if len(counts) > 1 else 0):
        for face in range(face_starts[body], face_starts[body + 1]):
            for k in range(3):
                corner = corners[face, k]
                if ends[corner] == starts[corner] or bodies[ends[corner] - 1] != body:
                    bodies[ends[corner]] = body
                    ends[corner] += 1
    numbers = np.empty(len(bodies), np.int32)
    for use in range(len(bodies)):
        numbers[use] = counts[bodies[use]]
        counts[bodies[use]] += 1
    return Uses(starts, bodies, numbers), counts


@allocating_kernel
def _number_by_body(corners, positions, uses, ends):
    """Number the corners of each body, and return the vertices of all bodies.

    *corners*: (K, 3), the faces body by body; they are renumbered in place.
    """
    starts, bodies, numbers = uses
    vertices, last_use = np.empty((len(bodies), 3)), starts.copy()
    for corner in range(len(positions)):
        for use in range(starts[corner], starts[corner + 1]):
            body = bodies[use]
            vertex = numbers[use] + (ends[body - 1, 0] if body > 0 else 0)
            for axis in range(3):
                vertices[vertex, axis] = positions[corner, axis]
    if len(ends) == 1 and len(bodies) == len(positions):  # their numbers are the same
        return vertices
    for body in range(len(ends)):
        for face in range(ends[body - 1, 1] if body > 0 else 0, ends[body, 1]):
            for k in range(3):
                corner = corners[face, k]
                while bodies[last_use[corner]] != body:
                    last_use[corner] += 1
                corners[face, k] = numbers[last_use[corner]]
    return vertices


@allocating_kernel
def _count_lost_faces(stock, uses, repairs):
    """Count the removed faces of each body. A face belongs to the body that has most of its corners."""
    votes = np.zeros(len(repairs), np.int64)
    for face in range(len(stock.kinds)):
        if stock.kinds[face] == LEFT:
            continue
        owner, most = 0, 0
        for k in range(3):
            corner = stock.corners[face, k]
            for use in range(uses.starts[corner], uses.starts[corner + 1]):
                votes[uses.bodies[use]] += 1
        for k in range(3):
            corner = stock.corners[face, k]
            for use in range(uses.starts[corner], uses.starts[corner + 1]):
                body = uses.bodies[use]
                if votes[body] > most or (votes[body] == most and body < owner):
                    owner, most = body, votes[body]
        for k in range(3):
            corner = stock.corners[face, k]
            for use in range(uses.starts[corner], uses.starts[corner + 1]):
                votes[uses.bodies[use]] = 0
        repairs[owner, SLIVERS if stock.kinds[face] == SLIVER else DUPLICATES] += 1.0


@allocating_kernel
def _count_repairs(stock, sources, face_starts, vertex_count, welded_counts, repairs):
    """Count the other repairs. *sources*: (K,), rows of faces by body. *welded_counts*: (B,), of corners."""
    all_given, all_merged, all_welded, _, is_turned, is_inside_out, points, exponent = stock
    given_of, merged_of = np.full(vertex_count, -1, np.int32), np.full(len(points), -1, np.int32)
    for body in range(len(repairs)):
        given_count, merged_count, farthest = 0, 0, 0.0
        for row in range(face_starts[body], face_starts[body + 1]):
            face = sources[row]
            repairs[body, TURNED] += is_turned[face]
            if is_inside_out[face]:
                repairs[body, TURNED_INSIDE_OUT] = 1.0
            for k in range(3):
                given, merged, welded = all_given[face, k], all_merged[face, k], all_welded[face, k]
                given_count += given_of[given] != body
                merged_count += merged_of[merged] != body
                given_of[given] = merged_of[merged] = body
                if merged != welded:
                    farthest = max(farthest, distance_between(points, merged, welded))
        repairs[body, MERGED] = given_count - merged_count
        repairs[body, WELDED] = merged_count - welded_counts[body]
        repairs[body, WELD_DISTANCE] = ldexp(farthest, -exponent)
