"""The method that decides the sign for a body, and the message about it."""

import re
from itertools import pairwise

import judging
import numpy as np
import pytest
import shapes
from models import welded_model_of

import oracle
from proximity.mesh.topology import build_topology
from proximity.mesh.triangle_mesh import TriangleMesh
from proximity.message import ContactFlag
from proximity.scene.scene import Scene
from proximity.scene.sign import SignMethod, choose_sign
from proximity.scene.solid import Solid
from proximity.tracker.tracker import Tracker

AGREES = r"closed and oriented; agrees with the winding number at (\d+) of \1 sample points"
MEETS_ITSELF = (
    r"closed and oriented, but it intersects itself or has shells that face the wrong way: the nearest face "
    r"and the winding number disagree at [1-9]\d* of \d+ sample points"
)
MANY_FACES = r"closed, but edges have more than two faces"
SMALL_HOLE = r"not closed, but the winding number is clear below \d+% of the surface"
OPEN = "not closed: there is no inside, so distances have no sign"
NO_AREA = r"no face has an area: there is no inside, so distances have no sign"


def half_of(mesh):
    vertices, faces = mesh
    return vertices, faces[vertices[faces].mean(axis=1)[:, 2] > 0.0]


def without_a_face(mesh, face=0):
    return mesh[0], np.delete(mesh[1], face, axis=0)


def scaled(mesh, size, place):
    return mesh[0] * size + np.asarray(place, float), mesh[1]


def handle(half_width, end):
    """The unit cube with a square pipe that extends from its top, bends, and ends above it or deep inside."""
    square = half_width * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    x, y = square.T
    cube = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    rings = [
        np.column_stack(columns)
        for columns in (
            (cube, np.zeros(4)),
            (cube, np.ones(4)),
            (0.3 + x, 0.5 + y, np.ones(4)),
            (0.3 + x, 0.5 + y, 1.2 - x),
            (0.6 - x, 0.5 + y, 1.2 - x),
            (0.6 - x, 0.5 + y, np.full(4, end)),
        )
    ]
    k = np.arange(4)
    sides = [(4 * ring + k, 4 * ring + (k + 1) % 4) for ring in range(len(rings))]
    quads = [np.column_stack((a, b, d, c)) for (a, b), (c, d) in pairwise(sides)]
    last = 4 * (len(rings) - 1)
    quads = np.concatenate([[[3, 2, 1, 0]], *quads, [last + k]])
    return np.concatenate(rings), np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))


def quartered(times, mesh):
    for _ in range(times):
        mesh = shapes.quartered(*mesh)
    return mesh


def with_bump(size, overlap):
    """The unit cube and a small one that reaches into its side."""
    return shapes.join(shapes.cube(), shapes.cube(size, (1.0 + 0.5 * size - overlap, 0.52, 0.53)))


SMALL_MEETINGS = {
    "handle of 4 cm": (handle(0.02, 0.7), (0.6, 0.5, 0.85), 0.12),
    "handle of 2 cm": (handle(0.01, 0.7), (0.6, 0.5, 0.85), 0.12),
    "handle of 1 cm": (handle(0.005, 0.7), (0.6, 0.5, 0.85), 0.12),
    "handle just below the top": (handle(0.005, 0.99), (0.6, 0.5, 0.99), 0.03),
    "cube of 5 cm half in": (with_bump(0.05, 0.025), (1.0, 0.52, 0.53), 0.06),
    "cube of 5 cm just in": (with_bump(0.05, 0.004), (1.0, 0.52, 0.53), 0.06),
    "cube of 1 cm half in": (with_bump(0.01, 0.005), (1.0, 0.52, 0.53), 0.02),
    "cubes whose corners overlap": (
        shapes.join(shapes.cube(), shapes.cube(center=(1.48, 1.47, 1.46))), (0.99, 0.985, 0.98), 0.05,
    ),
    "cubes of many faces and of few": (
        shapes.join(quartered(4, shapes.cube()), shapes.cube(0.05, (1.0, 0.52, 0.53))),
        (1.0, 0.52, 0.53),
        0.06,
    ),
}  # fmt: skip

CASES = {
    "tetrahedron": (shapes.tetrahedron(), SignMethod.PSEUDONORMAL, AGREES),
    "cube": (shapes.cube(), SignMethod.PSEUDONORMAL, AGREES),
    "cube of loose triangles": (shapes.soup(*shapes.cube()), SignMethod.PSEUDONORMAL, AGREES),
    "torus": (shapes.torus(), SignMethod.PSEUDONORMAL, AGREES),
    "cavity": (shapes.hollow_cube(), SignMethod.PSEUDONORMAL, AGREES),
    "thin wall": (
        shapes.join(shapes.sphere(1.0, 3), shapes.inside_out(shapes.sphere(0.88, 3))),
        SignMethod.PSEUDONORMAL,
        AGREES,
    ),
    "plate": (shapes.box((0, 0, 0), (1, 1, 1e-5)), SignMethod.PSEUDONORMAL, AGREES),
    "two bodies": (
        shapes.join(shapes.cube(), shapes.cube(center=(3, 0, 0))), SignMethod.PSEUDONORMAL, AGREES,
    ),
    "a nanometre at 10 km": (scaled(shapes.cube(), 2e-9, (1e4, -1e4, 1e4)), SignMethod.PSEUDONORMAL, AGREES),
    "a tenth of a micrometre at 10 km": (
        scaled(shapes.sphere(1.0, 2), 1e-7, (1e4, 1e4, 1e4)), SignMethod.PSEUDONORMAL, AGREES,
    ),
    "astronomic": (scaled(shapes.sphere(1.0, 1), 1e60, (0, 0, 0)), SignMethod.PSEUDONORMAL, AGREES),
    "two cubes that overlap": (
        shapes.join(shapes.cube(), shapes.cube(center=(1, 1, 1))), SignMethod.WINDING_NUMBER, MEETS_ITSELF,
    ),
    "cube in a cube, both outward": (
        shapes.join(shapes.cube(3.0), shapes.cube(1.0)), SignMethod.WINDING_NUMBER, MEETS_ITSELF,
    ),
    "the same cube twice": (shapes.join(shapes.cube(), shapes.cube()), SignMethod.WINDING_NUMBER, MANY_FACES),
    "two faces back to back": (
        (shapes.cube()[0], np.array([[0, 2, 3], [0, 3, 2]])), SignMethod.WINDING_NUMBER, MEETS_ITSELF,
    ),
    "two cubes that share an edge": (
        shapes.join(shapes.cube(), shapes.cube(center=(1.5, 1.5, 0.5))),
        SignMethod.WINDING_NUMBER,
        MANY_FACES,
    ),
    "sphere without one face": (without_a_face(shapes.sphere(1.0, 3)), SignMethod.WINDING_NUMBER, SMALL_HOLE),
    "cube without one face": (without_a_face(shapes.cube()), SignMethod.NONE, OPEN),
    "box without its lid": (shapes.open_box(), SignMethod.NONE, OPEN),
    "hemisphere": (half_of(shapes.sphere(1.0, 3)), SignMethod.NONE, OPEN),
    "sheet": (shapes.grid(), SignMethod.NONE, OPEN),
    "tube": (shapes.strip(24), SignMethod.NONE, OPEN),
    "Moebius strip": (shapes.strip(24, half_turns=1), SignMethod.NONE, OPEN),
    "one triangle": ((np.eye(3), np.array([[0, 1, 2]])), SignMethod.NONE, OPEN),
    "faces without area": ((np.eye(3), np.array([[0, 1, 1], [2, 2, 0]])), SignMethod.NONE, NO_AREA),
    "one point": ((np.ones((1, 3)), np.array([[0, 0, 0]])), SignMethod.NONE, NO_AREA),
    "denormal point": ((np.full((1, 3), 5e-324), np.array([[0, 0, 0]])), SignMethod.NONE, NO_AREA),
    "two faces on a line": (
        (np.arange(3.0)[:, None] * np.ones(3), np.array([[0, 1, 2], [0, 2, 1]])), SignMethod.NONE, NO_AREA,
    ),
}  # fmt: skip


def chosen(mesh):
    vertices, faces = mesh
    topology = build_topology(TriangleMesh(vertices, faces))
    return choose_sign(welded_model_of(vertices, faces), topology)


@pytest.mark.parametrize("name", CASES)
def test_method_and_sentence_are_those_of_the_shape(name):
    mesh, method, sentence = CASES[name]

    found, why = chosen(mesh)

    assert found is method, why
    assert re.fullmatch(sentence, why), why


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case[1] is not SignMethod.NONE])
def test_side_agrees_with_the_winding_number(name):
    vertices, faces = CASES[name][0]
    solid = Solid(vertices, faces)
    rng = np.random.default_rng(7)
    lower, upper = vertices[faces].min(axis=(0, 1)), vertices[faces].max(axis=(0, 1))
    points = rng.uniform(lower - 0.2 * (upper - lower), upper + 0.2 * (upper - lower), (400, 3))
    points = points[oracle.closest(vertices, faces, points).distance > 1e-12 * np.abs(points).max()]
    inside = oracle.winding_number(vertices, faces, points) > 0.5

    np.testing.assert_array_equal(solid.signed_distance(points) < 0.0, inside)
    np.testing.assert_array_equal(solid.contains(points), inside)


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case[1] is SignMethod.NONE])
def test_what_has_no_inside_has_distances_without_sign(name):
    vertices, faces = CASES[name][0]
    solid = Solid(vertices, faces)
    points = np.random.default_rng(7).uniform(-2, 2, (60, 3))

    assert not solid.has_inside
    assert (solid.signed_distance(points) >= 0.0).all()
    assert not solid.closest(points).is_signed.any()


@pytest.mark.parametrize("hole", ["outside", "cavity"])
def test_cavity_of_a_body_with_a_small_hole_is_outside(hole):
    """Separately, the outer shell would be full, and the cavity a solid or a sheet."""
    outside, cavity = shapes.sphere(1.0, 3), shapes.inside_out(shapes.sphere(0.5, 2))
    if hole == "outside":
        outside = without_a_face(outside)
    else:
        cavity = without_a_face(cavity)
    scene = Scene.from_mesh(*shapes.join(outside, cavity))

    assert scene.contains([[0.0, 0.0, 0.0], [0.1, 0.2, 0.1], [0.7, 0.1, 0.0]]).tolist() == [
        False,
        False,
        True,
    ]
    assert scene.signed_distance([0.0, 0.0, 0.0]) == pytest.approx(0.5, rel=0.03)


def test_cube_inside_out_is_turned_and_says_so():
    solid = Solid(*shapes.inside_out(shapes.cube()))

    assert solid.sign_method is SignMethod.PSEUDONORMAL
    assert re.fullmatch(
        AGREES + "; all faces were flipped: they ran clockwise seen from outside", solid.sign_reason
    )
    assert solid.signed_distance([0.5, 0.5, 0.5]) == -0.5
    point = (2.0, 0.3, 0.4)
    judging.assert_answer_holds_together(solid.closest(point), solid.mesh.vertices, solid.mesh.faces, point)


@pytest.mark.parametrize("height", [0.0, 1e-12, 1e-9])
@pytest.mark.parametrize("seed", range(6))
def test_side_is_right_beside_a_thin_face_that_closes_a_junction(seed, height):
    """A T-junction on a sharp edge, closed by a thin face whose normal is unreliable."""
    rng = np.random.default_rng(seed)
    vertices, faces = shapes.tetrahedron()
    vertices = vertices * [1.0, 1.0, 0.3] @ (shapes.rotation(seed) if seed else np.eye(3))
    a, b, c = faces[1 + seed % 3]
    way = vertices[b] - vertices[a]
    off = np.cross(way, rng.normal(size=3))
    share = rng.uniform(0.2, 0.8) if seed else 0.5
    vertices = np.vstack([vertices, vertices[a] + share * way + height * off / np.linalg.norm(off)])
    faces = np.vstack([np.delete(faces, 1 + seed % 3, axis=0), [[a, 4, c], [4, b, c], [a, b, 4]]])
    offs = np.cross(way, rng.normal(size=(400, 3)))
    offs *= 10.0 ** rng.uniform(-4, -0.5, (400, 1)) / np.linalg.norm(offs, axis=1, keepdims=True)
    points = vertices[a] + rng.uniform(0.0, 1.0, (400, 1)) * way + offs
    inside = oracle.winding_number(vertices, faces, points) > 0.5

    for asked in (Solid(vertices, faces), Scene.from_mesh(*shapes.soup(vertices, faces))):
        np.testing.assert_array_equal(asked.signed_distance(points) < 0.0, inside)
        np.testing.assert_array_equal(asked.contains(points), inside)


def test_thin_faces_are_said():
    vertices, faces = shapes.cube()
    vertices = np.concatenate([vertices, [[0.5, 0.0, 0.0]]])
    faces = [row for row in faces.tolist() if row != [0, 1, 5]] + [[0, 8, 5], [8, 1, 5], [0, 1, 8]]
    solid = Solid(vertices, faces)

    assert solid.is_watertight
    assert solid.sign_method is SignMethod.PSEUDONORMAL
    assert re.fullmatch(
        AGREES + "; 10 faces are as thin as a line, or next to such faces: there the winding number decides",
        solid.sign_reason,
    )


def test_body_that_meets_itself_is_deepest_where_both_halves_are():
    solid = Solid(*CASES["two cubes that overlap"][0])

    # Distance to the nearest face, although that face is inside the other cube.
    assert solid.signed_distance([0.75, 0.75, 0.75]) == -0.25
    assert solid.signed_distance([1.25, 1.25, 1.25]) == -0.25
    assert solid.contains([[0.25, 0.25, 0.25], [0.75, 0.75, 0.75], [1.9, 1.9, 0.4]]).tolist() == [
        True,
        True,
        False,
    ]


@pytest.mark.parametrize("name", SMALL_MEETINGS)
def test_small_place_where_a_body_meets_itself_is_seen(name):
    mesh, place, reach = SMALL_MEETINGS[name]
    solid = Solid(*mesh)
    assert solid.is_watertight
    assert solid.sign_method is SignMethod.WINDING_NUMBER, solid.sign_reason
    assert re.fullmatch(MEETS_ITSELF, solid.sign_reason), solid.sign_reason

    points = np.asarray(place) + np.random.default_rng(7).uniform(-reach, reach, (400, 3))
    inside = oracle.winding_number(*mesh, points) > 0.5
    contacts = Tracker(Scene([solid]), fingers=len(points), radius=0.0).tick(points, 10**6, 10**6)

    assert inside.any()
    np.testing.assert_array_equal(solid.signed_distance(points) < 0.0, inside)
    np.testing.assert_array_equal(solid.contains(points), inside)
    np.testing.assert_array_equal(contacts["flags"] & ContactFlag.INSIDE != 0, inside)


@pytest.mark.parametrize("half_width", [0.02, 0.005])
@pytest.mark.parametrize("end", [1.1, 1.0001])
def test_body_that_nearly_meets_itself_keeps_its_normals(half_width, end):
    found, why = chosen(handle(half_width, end))

    assert found is SignMethod.PSEUDONORMAL, why
    assert re.fullmatch(AGREES, why), why


def test_far_point_is_never_inside():
    # From 1e16 part sizes on, both sides of the part are equally far within rounding.
    solid = Solid(*shapes.cube())
    for distance in (1e9, 1e16, 1e20, 1e30, 1e90):
        points = distance * np.concatenate([np.eye(3), -np.eye(3), np.ones((1, 3))])

        assert (solid.signed_distance(points) > 0.0).all()
        assert (solid.closest(points).signed_distance > 0.0).all()
        assert not solid.contains(points).any()
