"""Polygons to triangles, each with the row of the polygon that it came from.

A polygon of n corners, convex or concave, always gives n - 2 triangles that use its corners and keep its
orientation. Corners on a straight side are legal and never cut into a triangle without area if that can be
avoided: such a triangle would be dropped later and leave a hole.

Quadrilaterals are cut here, all together; larger polygons by `manifold3d`, in the plane.
"""

from collections.abc import Callable

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import text_rows

MAX_CORNERS = 20_000
"""Maximum size of a polygon. Cutting takes up to the square of it: a second for a star of this size."""
_LARGE, _MAX_IN_LARGE = 1000, 10 * MAX_CORNERS  # corners: of a large one, and of all of them

Piece = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Polygons of rows of one width: polygon rows (n,), corner counts (n,), the rows (n, width)."""


def assemble(
    vertices: np.ndarray, pieces: list[Piece], polygon_count: int, locate: Callable[[int], str]
) -> tuple[np.ndarray, np.ndarray]:
    """Sort polygons, check them, and cut them into triangles.

    *vertices*: (V, 3). *pieces*: together every polygon once; values after the corners in a row are ignored.
    *locate*: polygon row -> its place in the file.
    """
    sizes = np.zeros(polygon_count, dtype=np.int64)
    for row_ids, counts, _ in pieces:
        sizes[row_ids] = counts
    first_corner = np.cumsum(sizes) - sizes
    corners = np.empty(int(sizes.sum()), dtype=np.int64)
    for row_ids, counts, table in pieces:
        columns = np.arange(table.shape[1])
        is_corner = columns < counts[:, None]
        values = text_rows.as_integers(np.where(is_corner, table, 0), text_rows.located_in(locate, row_ids))
        corners[(first_corner[row_ids, None] + columns)[is_corner]] = values[is_corner]
    check_polygons(corners, sizes, len(vertices), locate)
    return triangulate(vertices, corners, sizes)


def check_polygons(
    corners: np.ndarray, sizes: np.ndarray, vertex_count: int, locate: Callable[[int], str]
) -> None:
    """Raise if a polygon has too few or too many corners, or refers to a vertex that is not there.

    *locate*: polygon row -> its place in the file.
    """
    small = np.flatnonzero(sizes < 3)
    if len(small):
        raise MeshFormatError(f"{locate(int(small[0]))} has {sizes[small[0]]} corners, expected at least 3")
    large = np.flatnonzero(sizes > MAX_CORNERS)
    if len(large):
        raise MeshFormatError(
            f"{locate(int(large[0]))} has {sizes[large[0]]} corners, expected at most {MAX_CORNERS}"
        )
    if sizes[sizes > _LARGE].sum() > _MAX_IN_LARGE:
        raise MeshFormatError(
            f"its polygons of more than {_LARGE} corners have {sizes[sizes > _LARGE].sum()} together, "
            f"expected at most {_MAX_IN_LARGE}"
        )
    outside = np.flatnonzero((corners < 0) | (corners >= vertex_count))
    if len(outside):
        polygon = int(np.searchsorted(np.cumsum(sizes), outside[0], side="right"))
        raise MeshFormatError(
            f"{locate(polygon)} refers to vertex {corners[outside[0]]} (counted from 0), "
            f"but there are {vertex_count} vertices"
        )


def triangulate(
    vertices: np.ndarray, corners: np.ndarray, sizes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cut polygons into triangles.

    *vertices*: (V, 3); positions, which need not be finite.
    """
    source_faces = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes - 2)
    if (sizes == 3).all():
        return corners.reshape(-1, 3), source_faces
    faces = np.empty((len(source_faces), 3), dtype=np.int64)
    first_corner = np.cumsum(sizes) - sizes
    first_face = np.cumsum(sizes - 2) - (sizes - 2)
    # triangles and quadrilaterals together, the others one by one
    rows = np.flatnonzero(sizes == 3)
    faces[first_face[rows]] = corners[first_corner[rows, None] + np.arange(3)]
    rows = np.flatnonzero(sizes == 4)
    halves = _cut_quads(vertices, corners[first_corner[rows, None] + np.arange(4)])
    faces[first_face[rows]], faces[first_face[rows] + 1] = halves
    rows = np.flatnonzero(sizes > 4)
    if len(rows):
        _cut_rings(vertices, corners, first_corner[rows], sizes[rows], faces, first_face[rows])
    return faces, source_faces


def _cut_quads(vertices: np.ndarray, quads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both triangles of each quadrilateral: cut from corner 0 to corner 2 if both have one orientation
    then, else from corner 1 to corner 3.
    """
    if not len(quads):
        return np.empty((0, 3), dtype=np.int64), np.empty((0, 3), dtype=np.int64)
    with np.errstate(all="ignore"):
        sides = np.roll(vertices[quads], -1, axis=1) - vertices[quads]
        normals = np.cross(sides, np.roll(sides, -1, axis=1))  # of triangles 012, 123, 230, 301
        agree_02 = np.einsum("ij,ij->i", normals[:, 0], normals[:, 2])
        agree_13 = np.einsum("ij,ij->i", normals[:, 1], normals[:, 3])
        cut_13 = ((agree_02 <= 0.0) & (agree_13 > agree_02))[:, None]
    first = np.where(cut_13, quads[:, [0, 1, 3]], quads[:, [0, 1, 2]])
    second = np.where(cut_13, quads[:, [1, 2, 3]], quads[:, [0, 2, 3]])
    return first, second


def _cut_rings(
    vertices: np.ndarray,
    corners: np.ndarray,
    firsts: np.ndarray,
    sizes: np.ndarray,
    faces: np.ndarray,
    first_faces: np.ndarray,
) -> None:
    """Cut polygons of any size into rows of *faces*, each from its first corner and its first face.

    Degenerate: one that crosses itself, or has no area, is cut into triangles that overlap, or have none.
    Cost: 0.1 ms for one of a few corners, 50 ms for a gear of 5 000.
    """
    import manifold3d  # 40 ms; most files have no such polygons

    for first, size, first_face in zip(firsts, sizes, first_faces, strict=True):
        ring = corners[first : first + size]
        # The library guarantees size - 2 triangles along the edges of any polygon.
        faces[first_face : first_face + size - 2] = ring[manifold3d.triangulate([_flattened(vertices[ring])])]


def _flattened(points: np.ndarray) -> np.ndarray:
    """Return the polygon in the plane, counter-clockwise, without the axis of its largest area."""
    with np.errstate(all="ignore"):
        # in units of the polygon's own size, so that products neither overflow nor vanish
        centred = points - points.mean(axis=0)
        centred = np.nan_to_num(centred / np.abs(centred).max(), posinf=0.0, neginf=0.0)
    area = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)  # Newell's normal
    axis = int(np.argmax(np.abs(area)))
    u, v = (axis + 1) % 3, (axis + 2) % 3
    return centred[:, [u, v]] if area[axis] >= 0.0 else centred[:, [v, u]]
