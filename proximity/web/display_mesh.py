"""Displayed form of a mesh: faces with normals that are smooth on smooth surfaces, and its sharp edges.

For display alone: single precision, relative to the middle of the part; distances are never computed from it.
"""

from dataclasses import dataclass

import numpy as np

SHARP_DEGREES = 30.0
"""Angle of two faces from which their edge is drawn."""
MAX_CELLS = 1024
"""Cells along an axis of the grid in which corners of an open surface are merged."""


@dataclass(frozen=True, slots=True, eq=False)
class DisplayMesh:
    """A drawn part, relative to its centre."""

    centre: np.ndarray  # (3,) float64, m, part frame: offset of the positions
    positions: np.ndarray  # (V, 3) float32, m, from the centre
    normals: np.ndarray  # (V, 3) float32, unit
    faces: np.ndarray  # (F, 3) uint32
    edges: np.ndarray  # (E, 2) uint32, rows of positions: feature edges and borders


def display_mesh(vertices: np.ndarray, faces: np.ndarray) -> DisplayMesh:
    """Return the drawn form of a mesh.

    *vertices*: (V, 3) m; *faces*: (F, 3).

    Notes
    -----
    Degenerate: a face without area gets the normal of its neighbours.
    Cost: about 1 s for half a million faces.
    """
    used, dense = np.unique(faces, return_inverse=True)
    corners, faces = vertices[used], dense.reshape(-1, 3)
    centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    corners = corners - centre
    area_normals = _area_normals(corners, faces)
    pairs, edges = _edges(faces, area_normals)
    group = _smooth_groups(faces, pairs)
    count = int(group.max()) + 1
    weighted = area_normals[np.repeat(np.arange(len(faces)), 3)] * _corner_angles(corners, faces)[:, None]
    normals = np.stack([np.bincount(group, weighted[:, axis], count) for axis in range(3)], axis=1)
    positions = np.empty((count, 3), np.float32)
    positions[group] = corners[faces.reshape(-1)]
    corner_of_vertex = np.zeros(len(corners), np.int64)
    corner_of_vertex[faces.reshape(-1)] = group
    return DisplayMesh(
        centre,
        positions,
        _unit(normals).astype(np.float32),
        group.reshape(-1, 3).astype(np.uint32),
        corner_of_vertex[edges].astype(np.uint32),
    )


def coarser(vertices: np.ndarray, faces: np.ndarray, target: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a simplified mesh of similar appearance with about *target* faces at most.

    *vertices*: (V, 3) m; *faces*: (F, 3). *target*: wanted number of faces; a larger one than present has no
    effect.

    Notes
    -----
    manifold3d collapses edges of closed meshes within a tolerance; for other meshes, or if it fails, corners
    are merged in the cells of a grid.
    """
    if len(faces) <= target:
        return vertices, faces
    extent = float(np.ptp(vertices[np.unique(faces)], axis=0).max())
    simplified = _simplified(vertices, faces, target, extent)
    return _clustered(vertices, faces, target, extent) if simplified is None else simplified


def _simplified(
    vertices: np.ndarray, faces: np.ndarray, target: int, extent: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Simplify by manifold3d, with the least of a few tolerances; None if it fails or stays too fine."""
    import manifold3d  # slow to import, and only for large parts

    mesh = manifold3d.Mesh64(np.array(vertices), np.array(faces, np.uint64))  # writeable: it insists
    solid = manifold3d.Manifold(mesh)
    if solid.status() != manifold3d.Error.NoError or solid.is_empty():
        return None
    for step in range(-17, -7):
        solid = solid.simplify(extent * 2.0**step)
        if solid.num_tri() <= target:
            made = solid.to_mesh64()
            return np.asarray(made.vert_properties)[:, :3], np.asarray(made.tri_verts).astype(np.int64)
    return None


def _clustered(
    vertices: np.ndarray, faces: np.ndarray, target: int, extent: float
) -> tuple[np.ndarray, np.ndarray]:
    """Merge the corners in each cell into their mean; faces that lose an edge are removed."""
    lower, cells = vertices[np.unique(faces)].min(axis=0), MAX_CELLS
    while True:
        cell = np.floor((vertices - lower) * (cells / extent)).astype(np.int64)
        _, group = np.unique(cell, axis=0, return_inverse=True)
        group = group.reshape(-1)
        kept = group[faces]
        kept = kept[(kept[:, 0] != kept[:, 1]) & (kept[:, 1] != kept[:, 2]) & (kept[:, 2] != kept[:, 0])]
        if (len(kept) <= target and len(kept)) or cells <= 8:
            break
        cells = cells * 3 // 4
    counts = np.bincount(group)
    means = np.stack([np.bincount(group, vertices[:, axis]) for axis in range(3)], axis=1) / counts[:, None]
    return (means, kept) if len(kept) else (vertices, faces[:target])


def _area_normals(corners: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (corners[faces[:, k]] for k in range(3))
    return _unit(np.cross(b - a, c - a))


def _corner_angles(corners: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the angle of each face at each of its corners, rad, in the order of the corners."""
    points = corners[faces]
    onward = _unit(np.roll(points, -1, axis=1) - points)
    back = _unit(np.roll(points, 1, axis=1) - points)
    return np.arccos(np.clip(np.einsum("ijk,ijk->ij", onward, back), -1.0, 1.0)).reshape(-1)


def _edges(faces: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of corners joined by a smooth surface, and the drawn edges, by their vertices.

    A corner is numbered by its position among all corners. An edge of two nearly parallel faces is smooth.
    """
    corner = np.arange(faces.size).reshape(-1, 3)
    start, end = corner.reshape(-1), np.roll(corner, -1, axis=1).reshape(-1)
    first, second = faces.reshape(-1)[start], faces.reshape(-1)[end]
    key = np.minimum(first, second) * (int(faces.max()) + 1) + np.maximum(first, second)
    order = np.argsort(key, kind="stable")
    begins = np.flatnonzero(np.diff(key[order], prepend=-1))
    sizes = np.diff(begins, append=len(order))
    one, other = order[begins], order[np.minimum(begins + 1, len(order) - 1)]
    cosine = np.einsum("ij,ij->i", normals[one // 3], normals[other // 3])
    has_no_area = ~normals[one // 3].any(axis=1) | ~normals[other // 3].any(axis=1)
    runs_back = first[one] == second[other]
    is_smooth = (sizes == 2) & runs_back & ((cosine >= np.cos(np.radians(SHARP_DEGREES))) | has_no_area)
    smooth_one, smooth_other = one[is_smooth], other[is_smooth]
    pairs = np.concatenate(
        [
            np.stack([start[smooth_one], end[smooth_other]], axis=1),
            np.stack([end[smooth_one], start[smooth_other]], axis=1),
        ]
    )
    seen = one[~is_smooth]
    return pairs, np.stack([first[seen], second[seen]], axis=1)


def _smooth_groups(faces: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return for every corner the number of its drawn vertex, shared by all corners joined with it."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    ones = np.ones(len(pairs), np.int8)
    joined = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(faces.size, faces.size))
    return connected_components(joined, directed=False)[1]


def _unit(vectors: np.ndarray) -> np.ndarray:
    lengths = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))[..., None]
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)
