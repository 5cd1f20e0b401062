"""Welding of nearly equal vertices, which is done only if it closes a body.

Only the rims of open pieces are considered. Welds that close no piece are discarded, because moving vertices
changes the surface.
"""

from math import sqrt

import numpy as np

from proximity.kernels.bodies.connected_faces import connect_faces, scaled, unit_exponent
from proximity.kernels.bodies.near_points import near_pairs
from proximity.kernels.mesh.components import join, root_of, unlinked
from proximity.kernels.mesh.edges import ends_of, is_loop, sorted_half_edges
from proximity.kernels.mesh.faces import shell_boxes
from proximity.kernels.mesh.positions import gathered, merged_faces, rows_where
from proximity.native import allocating_kernel, entry, kernel

MAX_WELD = 1e-6
"""Largest displacement, relative to the diagonal of the body.

Exporters that write six digits err by this much.
"""
WELD_STEPS = MAX_WELD * 10.0 ** np.arange(-6, 1)
"""Displacements to try in ascending order, so that a body that closes early keeps its finer detail."""


@allocating_kernel
def weld_near(corners, points, pieces):
    """Weld vertices that are near each other, if that closes a piece.

    Return the corners of the faces, (K, 3), and a mask of the faces that became lines, (K,) bool. *corners*:
    (K, 3), rows of *points* (C, 3). *pieces*: the pieces before welding, at least one of them open.
    """
    welded, is_collapsed = corners.copy(), np.zeros(len(corners), np.bool_)
    is_left, is_rim = np.empty(len(corners), np.bool_), np.zeros(len(points), np.bool_)
    for face in range(len(corners)):
        is_left[face] = not pieces.is_closed[pieces.labels[face]]
        for k in range(3):
            if is_left[face] and pieces.is_open[face, k]:
                is_rim[corners[face, k]] = is_rim[corners[face, (k + 1) % 3]] = True
    rows, rim = rows_where(is_left, True), rows_where(is_rim, True)
    whole = np.zeros(len(rows), np.int64)
    diagonal = _diagonal(shell_boxes(points, gathered(corners, rows), whole, 1), 0)
    near, distances = near_pairs(gathered(points, rim), MAX_WELD * diagonal)
    links, linked_to = unlinked(len(points)), -1.0
    for step in WELD_STEPS:
        reach, is_any_new = step * diagonal, False
        for row in range(len(rim)):
            for n in range(near.shape[1]):
                if near[row, n] >= 0 and linked_to < distances[row, n] <= reach:
                    join(links, rim[row], rim[near[row, n]], 0)
                    is_any_new = True
        linked_to = reach
        if not is_any_new or len(rows) == 0:
            continue
        before = gathered(corners, rows)
        after, is_mended, collapses = _mended_faces(before, points, links)
        for row in range(len(rows)):
            if is_mended[row]:
                is_left[rows[row]], is_collapsed[rows[row]] = False, collapses[row]
                for k in range(3):
                    welded[rows[row], k] = after[row, k]
        rows = rows_where(is_left, True)
    return welded, is_collapsed


@kernel
def _diagonal(boxes, row):
    x, y, z = boxes[row, 3] - boxes[row, 0], boxes[row, 4] - boxes[row, 1], boxes[row, 5] - boxes[row, 2]
    return sqrt(x * x + y * y + z * z)


@kernel
def distance_between(points, one, other):
    """Return the distance between two rows of *points* (C, 3)."""
    x, y, z = (
        points[other, 0] - points[one, 0],
        points[other, 1] - points[one, 1],
        points[other, 2] - points[one, 2],
    )
    return sqrt(x * x + y * y + z * z)


@allocating_kernel
def _welded(corners, links):
    """Replace corners (K, 3) by the roots of their links.

    Return them and a mask of the collapsed faces, (K,).
    """
    welded, collapses = np.empty(corners.shape, np.int32), np.empty(len(corners), np.bool_)
    for face in range(len(corners)):
        for k in range(3):
            welded[face, k] = root_of(links, corners[face, k]) >> 1
        a, b, c = welded[face, 0], welded[face, 1], welded[face, 2]
        collapses[face] = a == b or b == c or c == a
    return welded, collapses


@allocating_kernel
def _mended_faces(corners, points, links):
    """Weld the corners of faces and return them with two masks.

    The first marks the faces of pieces that the weld has closed, the second marks collapsed faces.
    """
    welded, collapses = _welded(corners, links)
    is_mended, standing = np.zeros(len(corners), np.bool_), rows_where(collapses, False)
    if len(standing) == 0:
        return welded, is_mended, collapses
    left = gathered(welded, standing)
    labels, _, _, is_good = connect_faces(left, points, sorted_half_edges(left))
    boxes = shell_boxes(points, gathered(corners, standing), labels, len(is_good))
    farthest = np.zeros(len(is_good))
    for row in range(len(standing)):
        face, piece = standing[row], labels[row]
        for k in range(3):
            moved = distance_between(points, corners[face, k], welded[face, k])
            farthest[piece] = max(farthest[piece], moved)
    for piece in range(len(is_good)):
        is_good[piece] = is_good[piece] and farthest[piece] <= MAX_WELD * _diagonal(boxes, piece)
    is_mended_corner = np.zeros(len(points), np.bool_)
    for row in range(len(standing)):
        is_mended[standing[row]] = is_good[labels[row]]
        if is_good[labels[row]]:
            for k in range(3):
                is_mended_corner[left[row, k]] = True
    for face in range(len(corners)):
        if collapses[face]:
            for k in range(3):
                is_mended[face] |= is_mended_corner[welded[face, k]]
    return welded, is_mended, collapses


@entry("float64[:, 3], int32[:, 3] -> float64[:, :]", makes_arrays=True)
def open_edge_middles(vertices, faces):
    """Return the midpoints of the unpaired edges of a body, (E, 3) float64, m.

    *vertices* (V, 3) m; *faces* (F, 3). See `mesh.topology.open_edges`.
    """
    corners, positions = merged_faces(vertices, faces)
    is_rim, links = np.zeros(len(positions), np.bool_), unlinked(len(positions))
    unpaired = _unpaired_edges(corners)
    for edge in range(len(unpaired)):
        one, other = ends_of(corners, unpaired[edge])
        is_rim[one] = is_rim[other] = True
    rim, whole = rows_where(is_rim, True), np.zeros(len(corners), np.int64)
    points = scaled(positions, unit_exponent(positions))
    reach = MAX_WELD * _diagonal(shell_boxes(points, corners, whole, 1), 0)
    near, _ = near_pairs(gathered(points, rim), reach)
    for row in range(len(rim)):
        for n in range(near.shape[1]):
            if near[row, n] >= 0:
                join(links, rim[row], rim[near[row, n]], 0)
    welded, collapses = _welded(corners, links)
    standing = gathered(welded, rows_where(collapses, False))
    unpaired = _unpaired_edges(standing)
    middles = np.empty((len(unpaired), 3))
    for edge in range(len(unpaired)):
        one, other = ends_of(standing, unpaired[edge])
        for axis in range(3):
            middles[edge, axis] = 0.5 * (positions[one, axis] + positions[other, axis])
    return middles


@allocating_kernel
def _unpaired_edges(corners):
    """Return one half-edge of each unpaired edge, (E,) int32."""
    order, starts, forward_counts = sorted_half_edges(corners)
    found, count = np.empty(len(forward_counts), np.int32), 0
    for edge in range(len(forward_counts)):
        half_edge = order[starts[edge]]
        if 2 * forward_counts[edge] != starts[edge + 1] - starts[edge] and not is_loop(corners, half_edge):
            found[count] = half_edge
            count += 1
    return found[:count].copy()
