"""Faces that add nothing: without area, or equal to another face.

Such a face goes only where its going leaves no more edges unbalanced (run more often one way than the
other) than before. A sliver between two rows of faces that meet at different points along a line has no area
and still closes the surface; the coincident faces of two bodies may run the same way and are both needed.
Faces are judged in groups connected by edges: a body that occurs twice goes as a whole.
"""

import numpy as np

from proximity.kernels.entries import thin_faces
from proximity.mesh.connected_faces import linked_components
from proximity.mesh.topology import EdgeRuns, edge_runs

DEGENERATE_HEIGHT = 16 * np.finfo(np.float64).eps
"""A face has no area when its height drowns in the rounding of its coordinates; times the largest of them."""


def find_useless_faces(
    corners: np.ndarray, unit_positions: np.ndarray
) -> tuple[np.ndarray, np.ndarray, EdgeRuns | None]:
    """Return which of the (F, 3) *corners* are slivers to drop, and which are duplicates to drop.

    And the edges of the faces, if none is to be dropped. *unit_positions* are those of the corners, scaled to
    coordinates of at most 1. Of equal faces the first stays.
    """
    a, b, c = corners.T
    is_folded = (a == b) | (b == c) | (c == a)
    rows = np.flatnonzero(~is_folded)
    is_sliver, is_duplicate = is_folded, np.zeros(len(corners), dtype=bool)
    if len(rows) == 0:
        return is_sliver, is_duplicate, None
    left = corners if len(rows) == len(corners) else corners[rows]
    edges = edge_runs(left)
    is_twin = _equals_earlier_face(left, edges)
    is_twin &= _can_go(edges, is_twin)
    is_duplicate[rows[is_twin]] = True
    is_flat = thin_faces(unit_positions, left, DEGENERATE_HEIGHT) & ~is_twin
    if is_flat.any():
        kept = np.flatnonzero(~is_twin)
        own_edges = edges if len(kept) == len(rows) else edge_runs(left[kept])
        can_go = _can_go(own_edges, is_flat[kept])
        is_sliver[rows[kept[can_go]]] = True
    is_any_useless = is_sliver.any() or is_duplicate.any()
    return is_sliver, is_duplicate, None if is_any_useless else edges


def _equals_earlier_face(corners: np.ndarray, edges: EdgeRuns) -> np.ndarray:
    """Whether an earlier face has the same corners in the same winding."""
    is_twin = np.zeros(len(corners), dtype=bool)
    # Equal faces run along their edges the same way: only faces at such edges need a look.
    is_crowded = (edges.forward_counts > 1) | (edges.counts - edges.forward_counts > 1)
    crowded = np.zeros(corners.size, dtype=bool)
    crowded[edges.order] = np.repeat(is_crowded, edges.counts)
    rows = np.flatnonzero(crowded.reshape(-1, 3).all(axis=1))
    if len(rows):
        lowest_first = (np.argmin(corners[rows], axis=1)[:, None] + np.arange(3)) % 3
        wound = np.take_along_axis(corners[rows], lowest_first, axis=1)
        first = np.unique(wound, axis=0, return_index=True)[1]
        is_twin[rows] = True
        is_twin[rows[first]] = False
    return is_twin


def _can_go(edges: EdgeRuns, is_candidate: np.ndarray) -> np.ndarray:
    """Which candidates go: groups of them without which no more edges are unbalanced than with them."""
    if not is_candidate.any():
        return is_candidate
    face_count, edge_count = len(is_candidate), len(edges.counts)
    face, edge = edges.order // 3, np.repeat(np.arange(edge_count), edges.counts)
    direction = np.where(edges.is_forward, 1.0, -1.0)
    balance = np.bincount(edge, weights=direction)
    theirs = is_candidate[face]
    without = balance - np.bincount(edge[theirs], weights=direction[theirs], minlength=edge_count)
    group = linked_components(face_count + edge_count, face[theirs], face_count + edge[theirs])
    # An edge belongs to one group: whatever shares it is connected.
    worse = np.bincount(
        group[face_count:], weights=np.abs(without) - np.abs(balance), minlength=group.max() + 1
    )
    can_go: np.ndarray = is_candidate & (worse[group[:face_count]] <= 0)
    return can_go
