"""Clearances of integer parts compared with exact distances of all pairs of their triangles."""

import math

import numpy as np
import pytest
import shapes
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import Error
from shapes import Mesh
from whole_numbers import are_crossing, triangles_distance_sq

import oracle
from proximity import Pose, Scene, Solid
from proximity.mesh.diagnosis import manifold_solid

ROUNDING = 1e-14


def on_grid(mesh: Mesh, size: float) -> Mesh:
    """Round the vertices of a mesh to integers; faces may lose their area."""
    return np.round(mesh[0] * size), mesh[1]


def shape(rng: np.random.Generator) -> Mesh:
    """A small integer mesh near the origin."""
    kind, place = rng.integers(5), rng.integers(-4, 5, 3) * rng.choice([0, 1, 1, 2])
    if kind == 0:
        return np.array(rng.integers(-4, 5, (3, 3)) + place, float), np.array([[0, 1, 2]])
    if kind == 1:
        vertices, faces = rng.integers(-4, 5, (4, 3)) + place, shapes.tetrahedron()[1]
        return vertices.astype(float), faces if shapes.volume(vertices, faces) > 0.0 else faces[:, ::-1]
    if kind == 2:
        return shapes.box(place, place + rng.integers(1, 6, 3))
    if kind == 3:
        return shapes.moved(on_grid(shapes.sphere(1.0, 0), float(rng.choice([2, 3, 5, 9]))), place)
    return shapes.moved(on_grid(shapes.octahedron(), float(rng.choice([1, 2, 4]))), place)


def exact(one: Mesh, other: Mesh) -> tuple[float, set[str]]:
    """The distance of two surfaces, and the relations that the surfaces allow.

    Pairs of triangles are processed in order of the distances of their boxes, which are exact too.
    """
    first, second = (mesh[0][mesh[1]].astype(np.int64) for mesh in (one, other))
    gaps = np.maximum(
        first.min(axis=1)[:, None] - second.max(axis=1), second.min(axis=1) - first.max(axis=1)[:, None]
    )
    boxes_sq = (np.maximum(gaps, 0) ** 2).sum(axis=-1)
    best, relations = math.inf, {"apart"}
    for at in np.argsort(boxes_sq, axis=None):
        row, column = divmod(int(at), len(second))
        if boxes_sq[row, column] > best:
            break
        pair = first[row].tolist(), second[column].tolist()
        best = min(best, triangles_distance_sq(*pair))
        if are_crossing(*pair, is_strict=True):
            return 0.0, {"crossing"}
        if are_crossing(*pair, is_strict=False):
            relations = {"crossing", "touching"}
    if best == 0:
        return 0.0, common_volume_says(one, other, relations)
    return oracle.root(best), {"apart", "first inside second", "second inside first"}


def common_volume_says(one: Mesh, other: Mesh, relations: set[str]) -> set[str]:
    """The relations allowed by the common volume of parts whose surfaces meet."""
    solids = [manifold_solid(vertices, faces) for vertices, faces in (one, other)]
    if any(solid.status() != Error.NoError or solid.volume() <= 0.0 for solid in solids):
        return relations if "crossing" in relations else {"touching"}
    common, (volume, back) = (solids[0] ^ solids[1]).volume(), (solid.volume() for solid in solids)
    if common <= 1e-9:
        return {"touching"}
    first = {"first inside second"} if volume - common <= 1e-9 else set()
    return {"crossing"} | first | ({"second inside first"} if back - common <= 1e-9 else set())


def inside(inner: Mesh, outer: Mesh) -> bool:
    """Test whether a part is inside another that it does not meet, by any of its faces."""
    if not Solid(*outer).has_inside:
        return False
    corners = inner[0][inner[1][:, 0]]
    return bool((oracle.winding_number(*outer, corners) > 0.5).any())


def clearance(one: Mesh, other: Mesh, pose: Pose | None = None):
    """The clearance by the scene."""
    scene = Scene([Solid(*one, name="a"), Solid(*other, name="b")])
    if pose is not None:
        scene.move_many(["a", "b"], [pose, pose])
    return scene.clearance("a", "b")


@pytest.mark.parametrize("seed", range(120))
def test_random_parts_are_as_far_apart_as_whole_numbers_say(seed):
    rng = np.random.default_rng(seed)
    for _ in range(5):
        one, other = shape(rng), shape(rng)
        distance, relations = exact(one, other)
        if distance > 0.0:
            relations = {"second inside first"} if inside(other, one) else {"apart"}
            relations = {"first inside second"} if inside(one, other) else relations
        found = clearance(one, other)

        assert found.relation in relations, (one, other)
        expected = 0.0 if "inside" in found.relation else distance
        assert found.distance == pytest.approx(expected, abs=20.0 * ROUNDING), (one, other)


@st.composite
def triangles(draw):
    """Two triangles on a coarse grid, which often touch, share corners, or are coplanar."""
    numbers = draw(st.lists(st.integers(-2, 2), min_size=18, max_size=18))
    return np.array(numbers, float).reshape(2, 3, 3)


@settings(max_examples=400)
@given(pair=triangles())
def test_triangles_meet_where_whole_numbers_say(pair):
    one, other = ((corners, np.array([[0, 1, 2]])) for corners in pair)
    distance, relations = exact(one, other)

    found = clearance(one, other)

    assert found.relation in relations
    assert found.distance == pytest.approx(distance, abs=4.0 * ROUNDING)


SEEDS = st.integers(0, 2**32 - 1)


@given(seed=SEEDS)
def test_moving_swapping_and_refining_both_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    one, other = shape(rng), shape(rng)
    found = clearance(one, other)
    pose = Pose(shapes.rotation(seed), rng.uniform(-100.0, 100.0, 3))

    moved, back = clearance(one, other, pose), clearance(other, one)
    fine = clearance(shapes.quartered(*one), shapes.quartered(*shapes.quartered(*other)))

    assert moved.distance == pytest.approx(found.distance, abs=200.0 * ROUNDING)
    assert back.distance == pytest.approx(found.distance, abs=20.0 * ROUNDING)
    assert fine.distance == pytest.approx(found.distance, abs=20.0 * ROUNDING)
    if found.relation != "touching":
        assert moved.relation == fine.relation == found.relation


@given(seed=SEEDS)
def test_no_point_of_one_is_nearer_to_the_other(seed):
    rng = np.random.default_rng(seed)
    one, other = shape(rng), shape(rng)
    found = clearance(one, other)
    for mesh, to in ((one, other), (other, one)):
        corners = mesh[0][mesh[1][rng.integers(len(mesh[1]), size=50)]]
        points = np.einsum("nk,nkd->nd", rng.dirichlet(np.ones(3) * 0.3, 50), corners)
        assert found.distance <= Solid(*to).distance(points).min() + 20.0 * ROUNDING
