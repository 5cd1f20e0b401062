"""Triangles by vertex index. They are validated once and read-only afterwards.

A mesh is independent of files, bodies, signs and trees. Units are metres.
"""

from typing import Any

import numpy as np

from proximity.checks import as_array, as_float64, is_whole
from proximity.errors import ArgumentError, MeshError

MAX_FACE_COUNT = 2**31 - 1
"""Maximum number of faces and of vertices, both of which are numbered by int32."""


class TriangleMesh:
    """An indexed set of triangles. It owns read-only copies of its arrays.

    Parameters
    ----------
    vertices : (V, 3) float64, m
        Corners. Those that a face uses must be finite.
    faces : (F, 3) integers
        Rows of *vertices*, counter-clockwise seen from outside. At least one face.

    Raises
    ------
    MeshError
        If shapes, types, ranges or values cannot be used; the message names the first invalid entry.
    """

    __slots__ = ("faces", "vertices")

    vertices: np.ndarray  # (V, 3) float64, m, read-only
    faces: np.ndarray  # (F, 3) int32, read-only

    def __init__(self, vertices: Any, faces: Any) -> None:
        self.vertices = _checked_vertices(vertices)
        self.faces = _checked_faces(faces, len(self.vertices))
        _check_finite(self.vertices, self.faces)
        self.vertices.flags.writeable = False
        self.faces.flags.writeable = False

    @classmethod
    def _from_checked(cls, vertices: np.ndarray, faces: np.ndarray) -> "TriangleMesh":
        """Return a mesh that shares the read-only arrays of another mesh."""
        mesh = cls.__new__(cls)
        mesh.vertices, mesh.faces = vertices, faces
        return mesh

    @classmethod
    def of_own(cls, vertices: np.ndarray, faces: np.ndarray) -> "TriangleMesh":
        """Return a mesh that takes ownership of arrays and makes them read-only.

        Parameters
        ----------
        vertices : (V, 3) float64, m
            Finite; C-ordered.
        faces : (F, 3) int32
            Rows of *vertices*, at least one; C-ordered.
        """
        vertices.flags.writeable = faces.flags.writeable = False
        return cls._from_checked(vertices, faces)

    def __reduce__(self) -> tuple[Any, ...]:
        return TriangleMesh.of_own, (self.vertices, self.faces)

    @property
    def face_count(self) -> int:
        """Number of faces."""
        return len(self.faces)

    @property
    def vertex_count(self) -> int:
        """Number of vertices, used or not."""
        return len(self.vertices)

    def with_vertices(self, vertices: np.ndarray) -> "TriangleMesh":
        """Return a mesh with the same faces and other vertices.

        Parameters
        ----------
        vertices : (V, 3) float64, m
            As many as in this mesh, already validated. The mesh takes them over and makes them read-only.
        """
        mesh = TriangleMesh.__new__(TriangleMesh)
        mesh.vertices, mesh.faces = vertices, self.faces
        vertices.flags.writeable = False
        return mesh

    def __repr__(self) -> str:
        return f"TriangleMesh({self.vertex_count} vertices, {self.face_count} faces)"


def _checked_vertices(vertices: Any) -> np.ndarray:
    array = as_float64(vertices, "vertices", expected="numbers of shape (V, 3)")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ArgumentError(f"vertices have shape {array.shape}, expected (V, 3)")
    if len(array) > MAX_FACE_COUNT:
        raise MeshError(f"the mesh has {len(array)} vertices, at most {MAX_FACE_COUNT} can be numbered")
    return array.copy()


def _checked_faces(faces: Any, vertex_count: int) -> np.ndarray:
    try:
        array = np.asarray(as_array(faces, "faces"))
    except ArgumentError:
        raise
    except ValueError as ragged:
        raise MeshError(
            "faces have rows of different lengths, expected triangles: integers of shape (F, 3)"
        ) from ragged
    if array.size == 0:
        raise MeshError("the mesh has no faces, expected at least one")
    if np.ma.is_masked(faces):
        raise MeshError("some entries of faces are masked, expected a vertex at every corner")
    if array.dtype.kind == "O":
        array = _from_objects(array)
    if array.dtype.kind == "f" and _holds_whole_numbers(array):
        array = array.astype(np.int64)
    if array.dtype.kind not in "iu":
        raise MeshError(f"faces have dtype {array.dtype}, expected integers of shape (F, 3)")
    if array.ndim != 2 or array.shape[1] != 3:
        raise MeshError(f"faces have shape {array.shape}, expected (F, 3)")
    if len(array) > MAX_FACE_COUNT:
        raise MeshError(f"the mesh has {len(array)} faces, at most {MAX_FACE_COUNT} can be numbered")
    outside = (array < 0) | (array >= vertex_count)
    if outside.any():
        face_id, corner = np.argwhere(outside)[0]
        raise MeshError(
            f"face {face_id} refers to vertex {array[face_id, corner]}, "
            f"but the mesh has {vertex_count} vertices"
        )
    return np.array(array, dtype=np.int32, order="C")


def _holds_whole_numbers(array: np.ndarray) -> bool:
    """Whether all floats are finite and integral, and small enough to become integers."""
    wide = array.astype(np.float64)
    return bool((np.abs(wide) <= MAX_FACE_COUNT).all() and (wide == np.rint(wide)).all())


def _from_objects(array: np.ndarray) -> np.ndarray:
    """Convert an object array to integers, or raise an error."""
    for value in array.flat:
        if not is_whole(value):
            raise MeshError(f"faces hold {value!r}, expected integers of shape (F, 3)")
    try:
        return array.astype(np.int64)
    except OverflowError as large:
        raise MeshError("faces contain a number beyond 64 bits, expected rows of vertices") from large


def _check_finite(vertices: np.ndarray, faces: np.ndarray) -> None:
    bad = ~np.isfinite(vertices).all(axis=1)
    if not bad.any():
        return
    used = np.zeros(len(vertices), dtype=bool)
    used[faces.ravel()] = True
    bad &= used
    if bad.any():
        vertex = int(np.flatnonzero(bad)[0])
        values = ", ".join(str(float(value)) for value in vertices[vertex])
        raise MeshError(
            f"vertex {vertex} is not finite: ({values}); {int(bad.sum())} of the {int(used.sum())} vertices "
            f"in use are not finite"
        )
