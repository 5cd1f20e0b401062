"""Welding of vertices that are nearly equal, where that closes a body.

Only the rims of open pieces are looked at, and what a weld does not close is left as it was given: pulling
vertices together changes the surface, so it must be worth it.
"""

import numpy as np

from proximity.mesh.connected_faces import Pieces, connect_faces, linked_components
from proximity.mesh.topology import edge_runs, merged_positions

MAX_WELD = 1e-6
"""Share of the diagonal of the body: what exporters leave that write coordinates with six digits."""

WELD_STEPS = MAX_WELD * 10.0 ** np.arange(-6, 1)
"""Tried one after the other, the smallest first: whatever closes a body early keeps its finer detail."""

_NEAR_COUNT = 9
"""Near vertices looked at from each; more at one position are found through one another."""


def weld_near(
    corners: np.ndarray, unit_positions: np.ndarray, pieces: Pieces
) -> tuple[np.ndarray, np.ndarray]:
    """Return *corners* after welding, and which faces collapsed to a line by it.

    *corners*: (K, 3); *unit_positions*: (C, 3). *pieces*: what the faces make up unwelded; one of them at
    least is open.
    """
    welded, is_collapsed = corners.copy(), np.zeros(len(corners), dtype=bool)
    rows = np.flatnonzero(~pieces.is_closed[pieces.labels])
    diagonal = float(np.linalg.norm(np.ptp(unit_positions[corners[rows]].reshape(-1, 3), axis=0)))
    rim = _rim_corners(corners[rows], pieces.has_open_edge[rows])
    links, distances = _near_pairs(rim, unit_positions, MAX_WELD * diagonal)
    tried_count = 0
    for step in WELD_STEPS:
        is_within = distances <= step * diagonal
        if is_within.sum() == tried_count or len(rows) == 0:
            continue
        tried_count = is_within.sum()
        representative = _representatives(links[:, is_within], len(unit_positions))
        is_mended, collapses = _mended_faces(corners[rows], representative, unit_positions)
        welded[rows[is_mended]] = representative[corners[rows[is_mended]]]
        is_collapsed[rows[is_mended]] = collapses[is_mended]
        rows = rows[~is_mended]
    return welded, is_collapsed


def open_edges(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the middles of the edges of a body that are not closed, (E, 3) float64, m.

    *vertices*: (V, 3) m; *faces*: (F, 3).

    Notes
    -----
    Vertices that a weld may pull together count as one: where it did not close the body, the seams that it
    would have closed are not what is open. At a closed edge as many faces run one way as the other.
    """
    corners, positions = merged_positions(vertices, faces)
    rim = np.unique(_unpaired_edges(corners))
    reach = MAX_WELD * float(np.linalg.norm(np.ptp(positions, axis=0)))
    links, _ = _near_pairs(rim, positions, reach)
    welded = _representatives(links, len(positions))[corners]
    collapses = (welded == np.roll(welded, 1, axis=1)).any(axis=1)
    middles: np.ndarray = positions[_unpaired_edges(welded[~collapses])].mean(axis=1)
    return middles


def _unpaired_edges(corners: np.ndarray) -> np.ndarray:
    """The ends of the edges that are not closed, (E, 2)."""
    edges = edge_runs(corners)
    half_edges = edges.order[edges.starts[(2 * edges.forward_counts != edges.counts) & ~edges.is_loop]]
    return _ends(corners, *np.divmod(half_edges, 3))


def _rim_corners(corners: np.ndarray, has_open_edge: np.ndarray) -> np.ndarray:
    return np.unique(_ends(corners, *np.nonzero(has_open_edge)))


def _ends(corners: np.ndarray, face: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """Both corners of edges, (E, 2)."""
    return np.stack([corners[face, edge], corners[face, (edge + 1) % 3]], axis=1)


def _near_pairs(rim: np.ndarray, unit_positions: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of *rim* corners, (2, L), at most *reach* apart, and their distances (L,)."""
    from scipy.spatial import cKDTree  # slow to import; most bodies close without

    # SciPy's reach is exclusive.
    distances, near = cKDTree(unit_positions[rim]).query(
        unit_positions[rim], k=_NEAR_COUNT, distance_upper_bound=np.nextafter(reach, np.inf)
    )
    one, column = np.nonzero(np.isfinite(distances))
    other = near[one, column]
    is_real = one != other
    links = np.stack([rim[one[is_real]], rim[other[is_real]]])
    return links, distances[one[is_real], column[is_real]]


def _representatives(links: np.ndarray, count: int) -> np.ndarray:
    """For each corner the first of those that *links* connect it with."""
    labels = linked_components(count, links[0], links[1])
    first = np.unique(labels, return_index=True)[1]
    representative: np.ndarray = first.astype(np.int32)[labels]
    return representative


def _mended_faces(
    corners: np.ndarray, representative: np.ndarray, unit_positions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Which faces are part of a piece that the weld closes, and which of all faces collapse by it."""
    welded = representative[corners]
    collapses = (welded == np.roll(welded, 1, axis=1)).any(axis=1)
    standing = np.flatnonzero(~collapses)
    is_mended = np.zeros(len(corners), dtype=bool)
    if len(standing) == 0:
        return is_mended, collapses
    pieces = connect_faces(welded[standing], unit_positions)
    moved = np.linalg.norm(unit_positions[corners[standing]] - unit_positions[welded[standing]], axis=2)
    order = np.argsort(pieces.labels, kind="stable")
    starts = np.flatnonzero(np.diff(pieces.labels[order], prepend=-1))
    points = unit_positions[corners[standing[order]]]
    extent = np.maximum.reduceat(points.max(axis=1), starts) - np.minimum.reduceat(points.min(axis=1), starts)
    farthest = np.maximum.reduceat(moved.max(axis=1)[order], starts)
    is_good = pieces.is_closed & (farthest <= MAX_WELD * np.linalg.norm(extent, axis=1))
    is_mended[standing] = is_good[pieces.labels]
    is_mended_corner = np.zeros(len(unit_positions), dtype=bool)
    is_mended_corner[welded[is_mended]] = True
    is_mended |= collapses & is_mended_corner[welded].any(axis=1)
    return is_mended, collapses
