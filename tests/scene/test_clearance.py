"""The clearance between two parts, beside shapes that are known and another library."""

import numpy as np
import pytest
import shapes
import trimesh
from manifold3d import Manifold, Mesh

import proximity
from proximity import NO_FACE, Scene, SceneError, Solid, clearance
from proximity.kernels.pair import part_query

FAR = 100.0


def test_of_two_cubes_it_is_the_gap_between_their_sides():
    scene = Scene([Solid(*shapes.cube(0.1), name="a"), Solid(*shapes.cube(0.1), name="b")])
    scene.move("b", proximity.Pose(None, [0.13, 0.02, 0.0]))

    found = clearance(scene, "a", "b")

    assert found.distance == pytest.approx(0.03, abs=1e-15)
    np.testing.assert_allclose(found.point_on_second - found.point_on_first, [0.03, 0, 0], atol=1e-15)


@pytest.mark.parametrize("seed", range(8))
def test_it_is_what_another_library_finds(seed):
    rng = np.random.default_rng(seed)
    shapes_ = [trimesh.creation.icosphere(2, 0.02), trimesh.creation.torus(0.05, 0.01, 24, 12)]
    scene = Scene(
        [Solid(mesh.vertices, mesh.faces, name=name) for mesh, name in zip(shapes_, "ab", strict=True)]
    )
    solids = []
    for mesh, name in zip(shapes_, "ab", strict=True):
        matrix = trimesh.transformations.random_rotation_matrix(rng.random(3))
        matrix[:3, 3] = rng.normal(size=3) * 0.05
        scene.move(name, matrix)
        there = mesh.copy().apply_transform(matrix)
        single = Mesh(
            vert_properties=there.vertices.astype(np.float32), tri_verts=there.faces.astype(np.uint32)
        )
        solids.append(Manifold(single))

    found = clearance(scene, "a", "b")

    assert found.distance == pytest.approx(
        solids[0].min_gap(solids[1], FAR), abs=1e-7
    )  # it computes in float32
    apart = np.linalg.norm(found.point_on_second - found.point_on_first)
    assert found.distance == pytest.approx(apart, abs=1e-15)
    assert clearance(scene, "b", "a").distance == found.distance


def test_parts_that_cross_or_are_inside_one_another_have_none():
    middle = (0, 0, 0)
    scene = Scene([Solid(*shapes.cube(0.1, middle), name="a"), Solid(*shapes.cube(0.02, middle), name="b")])
    for place in ([0.05, 0.01, 0.02], [0.01, 0.01, 0.01]):
        scene.move("b", proximity.Pose(None, place))
        assert clearance(scene, "a", "b").distance == 0.0
        assert clearance(scene, "b", "a").distance == 0.0


def test_what_is_hidden_is_measured_and_stays_hidden():
    scene = Scene(
        [Solid(*shapes.cube(0.1, (0, 0, 0)), name="a"), Solid(*shapes.cube(0.1, (0.2, 0, 0)), name="b")]
    )
    scene.hide("b")

    assert clearance(scene, "a", "b").distance == pytest.approx(0.1)
    assert scene.part("b").is_hidden


def test_a_part_that_is_not_there_is_named():
    scene = Scene([Solid(*shapes.cube(0.1), name="a")])
    with pytest.raises(SceneError, match="'lid'"):
        clearance(scene, "a", "lid")


def brute_force_clearance(one, other, count=41):
    """The smallest distance of points on a grid over every face of each part from the other part."""
    shares = np.linspace(0.0, 1.0, count)
    first, second = (each[np.add.outer(shares, shares) <= 1.0] for each in np.meshgrid(shares, shares))
    weights = np.stack([1.0 - first - second, first, second], axis=1)
    return min(
        float(to.distance(np.einsum("kc,fcd->fkd", weights, of.mesh.vertices[of.mesh.faces])).min())
        for of, to in ((one, other), (other, one))
    )


def clearance_of(one, other):
    return clearance(Scene([Solid(*one, name="a"), Solid(*other, name="b")]), "a", "b")


def test_a_small_box_above_a_large_plate_is_as_far_as_its_bottom():
    """It was "ValueError: attempt to get argmin of an empty sequence"."""
    plate = shapes.box((0.0, 0.0, -0.01), (1.0, 1.0, 0.0))
    box = shapes.box((0.123, 0.046, 0.002), (0.133, 0.056, 0.012))

    found = clearance_of(box, plate)

    assert found.distance == pytest.approx(0.002, abs=1e-15)
    assert clearance_of(plate, box).distance == found.distance
    assert found.point_on_first[2] == pytest.approx(0.002) and found.point_on_second[2] == 0.0


def test_a_second_body_inside_the_other_part_is_found():
    """It was the gap between surfaces, 49 mm."""
    two = shapes.join(shapes.cube(0.002, (1.0, 0.0, 0.0)), shapes.cube(0.002, (0.0, 0.0, 0.0)))
    around = shapes.cube(0.1, (0.0, 0.0, 0.0))

    found = clearance_of(two, around)

    assert found.distance == clearance_of(around, two).distance == 0.0
    assert Solid(*around).contains(found.point_on_first)


def test_an_unused_vertex_inside_the_other_part_is_no_contact():
    """It was 0 m."""
    vertices, faces = shapes.cube(0.1, (0.3, 0.0, 0.0))
    unused = np.concatenate([[[0.0, 0.0, 0.0]], vertices]), faces + 1

    assert clearance_of(unused, shapes.cube(0.1, (0.0, 0.0, 0.0))).distance == pytest.approx(0.2)


@pytest.mark.parametrize("seed", range(6))
def test_it_is_what_brute_force_finds(seed):
    rng = np.random.default_rng(seed)
    solids = []
    for offset in (0.0, 0.15):
        mesh = trimesh.creation.icosphere(1, 0.05 * rng.uniform(0.2, 1.0))
        place = [offset, *rng.uniform(-0.02, 0.02, 2)]
        turned = mesh.vertices * rng.uniform(0.3, 1.0, 3) @ shapes.rotation(seed)
        solids.append(Solid(turned + place, mesh.faces, name=str(offset)))

    found = clearance(Scene(solids), "0.0", "0.15")

    expected = brute_force_clearance(*solids)
    assert found.distance <= expected + 1e-15
    assert found.distance == pytest.approx(expected, rel=5e-3)


def single(*corners, name):
    return Solid(np.array(corners, dtype=float), [[0, 1, 2]], name=name)


def nearest_by_projection(first, second, rounds=3000):
    """The distance of two triangles: a point goes to and fro between the nearest points of both."""
    one, other = (Solid(each, [[0, 1, 2]]) for each in (first, second))
    point = first.mean(axis=0)
    for _ in range(rounds):
        point = one.closest(other.closest(point).point).point
    return float(other.distance(point))


@pytest.mark.parametrize("seed", range(40))
def test_triangles_are_as_far_apart_as_projection_to_and_fro_finds(seed):
    rng = np.random.default_rng(seed)
    first, second = rng.normal(size=(2, 3, 3))
    second[:, 0] += rng.choice([0.0, 1.0, 3.0])

    found = clearance(Scene([single(*first, name="a"), single(*second, name="b")]), "a", "b")

    assert found.distance == pytest.approx(nearest_by_projection(first, second), abs=2e-3)
    assert found.distance <= nearest_by_projection(first, second) + 1e-12
    for solid, point in zip((first, second), found[1:3], strict=True):
        assert Solid(solid, [[0, 1, 2]]).distance(point) == pytest.approx(0.0, abs=1e-14)
    assert np.linalg.norm(found.point_on_second - found.point_on_first) == pytest.approx(
        found.distance, abs=1e-14
    )


FLAT = ((0, 0, 0), (1, 0, 0), (0, 1, 0))


@pytest.mark.parametrize(
    ("other", "distance"),
    [
        (((0, 0, 0.5), (1, 0, 0.5), (0, 1, 0.5)), 0.5),  # parallel
        (((2, 0, 0), (3, 0, 0), (2, 1, 0)), 1.0),  # in one plane, beside
        (((0.1, 0.1, 0), (0.3, 0.1, 0), (0.1, 0.3, 0)), 0.0),  # in one plane, inside
        (((-1, -1, 0), (4, -1, 0), (-1, 4, 0)), 0.0),  # in one plane, around
        (((0.2, 0.2, -1), (0.2, 0.2, 1), (0.3, 0.3, 1)), 0.0),  # through the middle
        (((5.0, -1, -1e-12), (5.0, 1, 1e-12), (6, 0, 0)), 4.0),  # crosses the plane, far outside
        (((1, 0, 0), (2, 0, 1), (2, 0, -1)), 0.0),  # a corner in common
        (((0, -1, 1), (1, -1, 1), (0.5, -2, 2)), 2**0.5),  # edges that are parallel
        (((0.5, 0.5, 2**-30), (0.5, 0.5, 1), (1, 1, 1)), 2**-30),  # a corner over an edge
        (((0.25, 0.25, 1), (0.25, 0.25, 1), (0.25, 0.25, 1)), 1.0),  # a point
        (((-1, 0.25, 1), (2, 0.25, 1), (2, 0.25, 1)), 1.0),  # a line
    ],
)
def test_distance_of_two_triangles_is_known(other, distance):
    for place in ([0, 0, 0], [1e3, -2e3, 5e2]):
        moved = [np.array(each, dtype=float) + place for each in (FLAT, other)]
        found = clearance(Scene([single(*moved[0], name="a"), single(*moved[1], name="b")]), "a", "b")

        assert found.distance == pytest.approx(distance, abs=1e-12 if place == [0, 0, 0] else 1e-11)


@pytest.mark.parametrize("seed", range(4))
def test_moving_both_and_swapping_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    solids = [
        Solid(*shapes.torus(0.05, 0.02), name="a"),
        Solid(*shapes.sphere(0.03, 2), name="b"),
    ]
    scene = Scene(solids)
    scene.move("b", proximity.Pose(shapes.rotation(seed), rng.normal(size=3) * 0.1))
    found = clearance(scene, "a", "b")
    together = proximity.Pose(shapes.rotation(seed + 9), rng.normal(size=3))
    moved = Scene(solids)
    moved.move("a", together)
    moved.move("b", together @ scene.part("b").pose)

    assert clearance(scene, "b", "a").distance == found.distance
    assert clearance(moved, "a", "b").distance == pytest.approx(found.distance, abs=1e-14)
    for name, point, face in zip("ab", found[1:3], found[3:], strict=True):
        part = scene.part(name)
        corners = part.pose.point(part.solid.mesh.vertices[part.solid.mesh.faces[face]])
        assert Solid(corners, [[0, 1, 2]]).distance(point) == pytest.approx(0.0, abs=1e-14)


def test_parts_of_very_different_sizes_are_measured():
    scene = Scene([Solid(*shapes.cube(1e3), name="a"), Solid(*shapes.cube(1e-4, (0, 0, 0)), name="b")])
    scene.move("b", proximity.Pose(shapes.rotation(3), [0.0, 0.0, 501.0]))
    lowest = (scene.part("b").pose.point(scene.part("b").solid.mesh.vertices))[:, 2].min()
    top = scene.part("a").solid.mesh.vertices[:, 2].max()

    assert clearance(scene, "a", "b").distance == pytest.approx(lowest - top, abs=1e-11)


def connection_of(scene, *, limit=np.inf, tolerance=0.0, budget=0):
    answer = np.empty(part_query.ANSWER_SIZE)
    part_query.connect_parts(scene.snapshot().packed, 0, 1, limit, tolerance, budget, answer)
    return answer


@pytest.mark.parametrize("seed", range(4))
def test_bounds_hold_with_a_limit_a_tolerance_and_a_budget(seed):
    solids = [Solid(*shapes.torus(0.05, 0.02), name="a"), Solid(*shapes.sphere(0.03, 3), name="b")]
    scene = Scene(solids)
    scene.move("b", proximity.Pose(shapes.rotation(seed), [0.11, 0.01 * seed, 0.02]))
    lower, exact = connection_of(scene)[:2]

    assert lower == exact == clearance(scene, "a", "b").distance > 0.0
    for options in ({"tolerance": 0.2}, *({"budget": steps} for steps in (1, 10, 30, 100))):
        lower, upper = connection_of(scene, **options)[:2]
        assert lower <= exact <= upper
        assert "budget" in options or lower >= upper / 1.2 * (1.0 - 1e-12)
    assert connection_of(scene, limit=1.5 * exact)[1] == exact
    missed = connection_of(scene, limit=0.9 * exact)
    assert missed[0] == 0.9 * exact and missed[1] == np.inf and list(missed[8:]) == [NO_FACE, NO_FACE]
