"""Read dialects of STL, PLY and OBJ that the readers of this package do not support, by trimesh.

trimesh ignores much that it does not know: of 56 damaged files that the tests expect to be refused, it reads
19 with other contents (5.2, November 2026). A reader therefore passes on a file only because of its grammar,
never because of missing or contradictory numbers. It also passes on the number of faces that trimesh has to
find.

On some files the time that trimesh takes grows with the square of their size.
"""

import io

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats.contents import DialectError, RawFile, RawMesh

_MAX_SECONDS, _MAX_BYTES = 60, 4 << 30


def read_dialect(data: bytes, kind: str, refusal: DialectError) -> RawFile:
    """Read a file that the reader of this package refused.

    *kind*: "stl", "ply" or "obj". *refusal*: error of the reader, which is raised if trimesh does not find
    the same number of faces.
    """
    try:
        vertices, faces = _read(data, kind)
    except Exception:  # trimesh did not read the file, for any reason
        raise MeshFormatError(str(refusal)) from None
    is_mesh = faces.shape == (refusal.face_count, 3) and 0 <= faces.min() <= faces.max() < len(vertices)
    # The corners of STL facets were counted. In the other formats the mesh must be closed.
    if not is_mesh or not (kind == "stl" or _is_closed(vertices, faces)):
        raise MeshFormatError(str(refusal))
    rows = np.arange(len(faces), dtype=np.int32)
    note = f"trimesh read it, and numbered its faces; the reader of this package refuses it: {refusal}"
    return RawFile(kind.upper(), [RawMesh("", vertices, faces, rows)], notes=[note])


def _read(data: bytes, kind: str) -> tuple[np.ndarray, np.ndarray]:
    from proximity.formats.libraries import run_library  # imported here, since few files need a process

    done = run_library("trimesh", data, seconds=_MAX_SECONDS, byte_count=_MAX_BYTES, kind=kind)
    arrays = np.load(io.BytesIO(done.output))
    return arrays["vertices"].astype(np.float64).reshape(-1, 3), arrays["faces"].astype(np.int64)


def _is_closed(vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Return whether every edge between two positions is used equally often in both directions."""
    positions = np.unique(vertices, axis=0, return_inverse=True)[1].reshape(-1)
    starts = positions[faces].ravel()
    ends = positions[faces[:, [1, 2, 0]]].ravel()
    forth, back = starts * len(vertices) + ends, ends * len(vertices) + starts
    return bool(np.array_equal(np.sort(forth), np.sort(back)))
