"""Meshes: accepted input, error messages for invalid input, and immutability."""

import re

import numpy as np
import pytest
import shapes

from proximity.errors import ArgumentError, MeshError
from proximity.mesh.triangle_mesh import TriangleMesh

VERTICES, FACES = shapes.tetrahedron()


def test_arrays_are_kept_in_the_agreed_types():
    mesh = TriangleMesh(VERTICES.astype(np.float32).tolist(), FACES.astype(np.uint8))

    assert (mesh.vertices.dtype, mesh.faces.dtype) == (np.float64, np.int32)
    assert mesh.vertices.flags.c_contiguous and mesh.faces.flags.c_contiguous
    assert np.array_equal(mesh.vertices, VERTICES)
    assert np.array_equal(mesh.faces, FACES)
    assert (mesh.face_count, mesh.vertex_count) == (4, 4)
    assert repr(mesh) == "TriangleMesh(4 vertices, 4 faces)"


def test_arrays_are_copies():
    vertices, faces = VERTICES.copy(), FACES.astype(np.int32)
    mesh = TriangleMesh(vertices, faces)

    vertices[:], faces[:] = 9.0, 0

    assert np.array_equal(mesh.vertices, VERTICES)
    assert np.array_equal(mesh.faces, FACES)
    assert vertices.flags.writeable and faces.flags.writeable


@pytest.mark.parametrize(
    "faces",
    [
        FACES.tolist(), FACES.astype(np.float64), FACES.astype(">i8"), FACES.astype(object),
        np.asfortranarray(FACES),
    ],
)  # fmt: skip
def test_faces_of_any_whole_numbers_are_taken(faces):
    assert np.array_equal(TriangleMesh(VERTICES, faces).faces, FACES)


@pytest.mark.parametrize(
    "vertices, message",
    [
        ([1.0, 2.0, 3.0], "vertices have shape (3,), expected (V, 3)"),
        (np.ones((4, 2)), "vertices have shape (4, 2), expected (V, 3)"),
        ([[1, 2], [3]], "vertices have rows of different lengths, expected numbers of shape (V, 3)"),
        (VERTICES + 1j, "vertices have dtype complex128, expected numbers of shape (V, 3)"),
        (np.array([[None] * 3] * 4), "vertices hold None, which is not a number, expected numbers"),
    ],
)
def test_vertices_that_cannot_be_used_are_refused(vertices, message):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        TriangleMesh(vertices, FACES)


@pytest.mark.parametrize(
    "faces, message",
    [
        ([], "the mesh has no faces, expected at least one"),
        ([[0, 1, 2], [0, 1]], "faces have rows of different lengths, expected triangles: integers of shape"),
        ([[0, 1, 2, 3]], "faces have shape (1, 4), expected (F, 3)"),
        ([[0.0, 1.0, 2.5]], "faces have dtype float64, expected integers of shape (F, 3)"),
        ([[True, False, True]], "faces have dtype bool, expected integers of shape (F, 3)"),
        (
            np.ma.array([[0, 1, 2]], mask=[[0, 0, 1]]),  # masked entries are not vertex ids
            "some entries of faces are masked, expected a vertex at every corner",
        ),
        (np.array([[0, 1, None]], object), "faces hold None, expected integers of shape (F, 3)"),
        ([[0, 1, 2**70]], "faces contain a number beyond 64 bits, expected rows of vertices"),
        ([[0, 2, 1], [0, 9, 3]], "face 1 refers to vertex 9, but the mesh has 4 vertices"),
        ([[0, 2, 1], [0, -1, 3]], "face 1 refers to vertex -1, but the mesh has 4 vertices"),
        (np.array([[0, 1, 2**63]], np.uint64), "face 0 refers to vertex 9223372036854775808, but the mesh"),
    ],
)
def test_faces_that_cannot_be_used_are_refused(faces, message):
    with pytest.raises(MeshError, match=re.escape(message)):
        TriangleMesh(VERTICES, faces)


def test_vertices_that_are_not_finite_are_named_and_counted():
    vertices = VERTICES.copy()
    vertices[1, 2], vertices[3, 0] = np.nan, -np.inf

    expected = "vertex 1 is not finite: (1.0, 0.0, nan); 2 of the 4 vertices in use are not finite"
    with pytest.raises(MeshError, match=re.escape(expected)):
        TriangleMesh(vertices, FACES)


def test_unused_vertices_need_not_be_finite():
    vertices = np.concatenate([VERTICES, [[np.nan, 0.0, np.inf]]])

    assert TriangleMesh(vertices, FACES).vertex_count == 5


def test_more_faces_than_can_be_numbered_are_refused(monkeypatch):
    monkeypatch.setattr("proximity.mesh.triangle_mesh.MAX_FACE_COUNT", 3)

    with pytest.raises(MeshError, match=r"^the mesh has 4 faces, at most 3 can be numbered$"):
        TriangleMesh(VERTICES[:3], FACES % 3)
    with pytest.raises(MeshError, match=r"^the mesh has 4 vertices, at most 3 can be numbered$"):
        TriangleMesh(VERTICES, FACES)
