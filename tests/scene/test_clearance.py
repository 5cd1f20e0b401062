"""The clearance between two parts, compared with known shapes and another library."""

import threading
from itertools import combinations

import numpy as np
import pytest
import shapes
import trimesh
from manifold3d import Manifold, Mesh

import proximity
from proximity import NO_FACE, ArgumentError, Scene, SceneError, Solid
from proximity.kernels.answers import CLEARANCE_ANSWER
from proximity.kernels.pair.part_query import connect_parts

FAR = 100.0


def test_of_two_cubes_it_is_the_gap_between_their_sides():
    scene = Scene([Solid(*shapes.cube(0.1), name="a"), Solid(*shapes.cube(0.1), name="b")])
    scene.move("b", proximity.Pose(None, [0.13, 0.02, 0.0]))

    found = scene.clearance("a", "b")

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

    found = scene.clearance("a", "b")

    assert found.distance == pytest.approx(solids[0].min_gap(solids[1], FAR), abs=1e-7)  # float32 arithmetic
    apart = np.linalg.norm(found.point_on_second - found.point_on_first)
    assert found.distance == pytest.approx(apart, abs=1e-15)
    assert scene.clearance("b", "a").distance == found.distance


@pytest.mark.parametrize(
    ("place", "there", "back"),
    [
        ([0.05, 0.01, 0.02], "crossing", "crossing"),
        ([0.01, 0.01, 0.01], "second inside first", "first inside second"),
        ([0.06, 0.01, 0.02], "touching", "touching"),
    ],
)
def test_parts_that_meet_have_none_and_how_they_meet_is_told(place, there, back):
    middle = (0, 0, 0)
    scene = Scene([Solid(*shapes.cube(0.1, middle), name="a"), Solid(*shapes.cube(0.02, middle), name="b")])
    scene.move("b", proximity.Pose(None, place))

    for names, relation in (("ab", there), ("ba", back)):
        found = scene.clearance(*names)
        assert (found.first, found.second) == tuple(names)
        assert 0.0 == found.lower <= found.distance == pytest.approx(0.0, abs=1e-16)
        assert found.relation == relation


def test_what_is_hidden_is_measured_and_stays_hidden():
    scene = Scene(
        [Solid(*shapes.cube(0.1, (0, 0, 0)), name="a"), Solid(*shapes.cube(0.1, (0.2, 0, 0)), name="b")]
    )
    scene.hide("b")

    assert scene.clearance("a", "b").distance == pytest.approx(0.1)
    assert scene.part("b").is_hidden


def test_a_part_that_is_not_there_is_named():
    scene = Scene([Solid(*shapes.cube(0.1), name="a")])
    with pytest.raises(SceneError, match="'lid'"):
        scene.clearance("a", "lid")


def brute_force_clearance(one, other, count=41):
    """The smallest distance from a grid of points on every face of each part to the other part."""
    shares = np.linspace(0.0, 1.0, count)
    first, second = (each[np.add.outer(shares, shares) <= 1.0] for each in np.meshgrid(shares, shares))
    weights = np.stack([1.0 - first - second, first, second], axis=1)
    return min(
        float(to.distance(np.einsum("kc,fcd->fkd", weights, of.mesh.vertices[of.mesh.faces])).min())
        for of, to in ((one, other), (other, one))
    )


def clearance_of(one, other):
    return Scene([Solid(*one, name="a"), Solid(*other, name="b")]).clearance("a", "b")


def test_a_small_box_above_a_large_plate_is_as_far_as_its_bottom():
    """Regression: raised "ValueError: attempt to get argmin of an empty sequence"."""
    plate = shapes.box((0.0, 0.0, -0.01), (1.0, 1.0, 0.0))
    box = shapes.box((0.123, 0.046, 0.002), (0.133, 0.056, 0.012))

    found = clearance_of(box, plate)

    assert found.distance == pytest.approx(0.002, abs=1e-15)
    assert clearance_of(plate, box).distance == found.distance
    assert found.point_on_first[2] == pytest.approx(0.002) and found.point_on_second[2] == 0.0


def test_a_second_body_inside_the_other_part_is_found():
    """Regression: returned the gap between the surfaces, 49 mm."""
    two = shapes.join(shapes.cube(0.002, (1.0, 0.0, 0.0)), shapes.cube(0.002, (0.0, 0.0, 0.0)))
    around = shapes.cube(0.1, (0.0, 0.0, 0.0))

    found = clearance_of(two, around)

    assert found.distance == clearance_of(around, two).distance == 0.0
    assert Solid(*around).contains(found.point_on_first)


def test_an_unused_vertex_inside_the_other_part_is_no_contact():
    """Regression: returned 0 m."""
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

    found = Scene(solids).clearance("0.0", "0.15")

    expected = brute_force_clearance(*solids)
    assert found.distance <= expected + 1e-15
    assert found.distance == pytest.approx(expected, rel=5e-3)


def single(*corners, name):
    return Solid(np.array(corners, dtype=float), [[0, 1, 2]], name=name)


def nearest_by_projection(first, second, rounds=3000):
    """Distance of two triangles by alternating projection of a point."""
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

    found = Scene([single(*first, name="a"), single(*second, name="b")]).clearance("a", "b")

    assert found.distance == pytest.approx(nearest_by_projection(first, second), abs=2e-3)
    assert found.distance <= nearest_by_projection(first, second) + 1e-12
    for solid, point in zip((first, second), (found.point_on_first, found.point_on_second), strict=True):
        assert Solid(solid, [[0, 1, 2]]).distance(point) == pytest.approx(0.0, abs=1e-14)
    assert np.linalg.norm(found.point_on_second - found.point_on_first) == pytest.approx(
        found.distance, abs=1e-14
    )


FLAT = ((0, 0, 0), (1, 0, 0), (0, 1, 0))


@pytest.mark.parametrize(
    ("other", "distance"),
    [
        (((0, 0, 0.5), (1, 0, 0.5), (0, 1, 0.5)), 0.5),  # parallel
        (((2, 0, 0), (3, 0, 0), (2, 1, 0)), 1.0),  # coplanar, apart
        (((0.1, 0.1, 0), (0.3, 0.1, 0), (0.1, 0.3, 0)), 0.0),  # coplanar, inside
        (((-1, -1, 0), (4, -1, 0), (-1, 4, 0)), 0.0),  # coplanar, around
        (((0.2, 0.2, -1), (0.2, 0.2, 1), (0.3, 0.3, 1)), 0.0),  # through the middle
        (((5.0, -1, -1e-12), (5.0, 1, 1e-12), (6, 0, 0)), 4.0),  # crosses the plane, far outside
        (((1, 0, 0), (2, 0, 1), (2, 0, -1)), 0.0),  # a common corner
        (((0, -1, 1), (1, -1, 1), (0.5, -2, 2)), 2**0.5),  # parallel edges
        (((0.5, 0.5, 2**-30), (0.5, 0.5, 1), (1, 1, 1)), 2**-30),  # a corner above an edge
        (((0.25, 0.25, 1), (0.25, 0.25, 1), (0.25, 0.25, 1)), 1.0),  # a point
        (((-1, 0.25, 1), (2, 0.25, 1), (2, 0.25, 1)), 1.0),  # a line
    ],
)
def test_distance_of_two_triangles_is_known(other, distance):
    for place in ([0, 0, 0], [1e3, -2e3, 5e2]):
        moved = [np.array(each, dtype=float) + place for each in (FLAT, other)]
        found = Scene([single(*moved[0], name="a"), single(*moved[1], name="b")]).clearance("a", "b")

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
    found = scene.clearance("a", "b")
    together = proximity.Pose(shapes.rotation(seed + 9), rng.normal(size=3))
    moved = Scene(solids)
    moved.move("a", together)
    moved.move("b", together @ scene.part("b").pose)

    assert scene.clearance("b", "a").distance == found.distance
    assert moved.clearance("a", "b").distance == pytest.approx(found.distance, abs=1e-14)
    ends = (found.point_on_first, found.point_on_second), (found.face_on_first, found.face_on_second)
    for name, point, face in zip("ab", *ends, strict=True):
        part = scene.part(name)
        corners = part.pose.point(part.solid.mesh.vertices[part.solid.mesh.faces[face]])
        assert Solid(corners, [[0, 1, 2]]).distance(point) == pytest.approx(0.0, abs=1e-14)


def test_parts_of_very_different_sizes_are_measured():
    scene = Scene([Solid(*shapes.cube(1e3), name="a"), Solid(*shapes.cube(1e-4, (0, 0, 0)), name="b")])
    scene.move("b", proximity.Pose(shapes.rotation(3), [0.0, 0.0, 501.0]))
    lowest = (scene.part("b").pose.point(scene.part("b").solid.mesh.vertices))[:, 2].min()
    top = scene.part("a").solid.mesh.vertices[:, 2].max()

    assert scene.clearance("a", "b").distance == pytest.approx(lowest - top, abs=1e-11)


def connection_of(scene, *, limit=np.inf, tolerance=0.0, budget=0):
    answer = np.empty(1, CLEARANCE_ANSWER)
    connect_parts(scene.snapshot().packed, 0, 1, limit, tolerance, budget, answer)
    return answer[0]


@pytest.mark.parametrize("seed", range(4))
def test_bounds_hold_with_a_limit_a_tolerance_and_a_budget(seed):
    solids = [Solid(*shapes.torus(0.05, 0.02), name="a"), Solid(*shapes.sphere(0.03, 3), name="b")]
    scene = Scene(solids)
    scene.move("b", proximity.Pose(shapes.rotation(seed), [0.11, 0.01 * seed, 0.02]))
    lower, exact = connection_of(scene).tolist()[:2]

    assert lower == exact == scene.clearance("a", "b").distance > 0.0
    for options in ({"tolerance": 0.2}, *({"budget": steps} for steps in (1, 10, 30, 100))):
        lower, upper = connection_of(scene, **options).tolist()[:2]
        assert lower <= exact <= upper
        assert "budget" in options or lower >= upper / 1.2 * (1.0 - 1e-12)
    assert connection_of(scene, limit=1.5 * exact)["distance"] == exact
    missed = connection_of(scene, limit=0.9 * exact)
    assert missed["lower"] == 0.9 * exact and missed["distance"] == np.inf
    assert missed["faces"].tolist() == [NO_FACE, NO_FACE]


def test_a_part_and_itself_are_no_pair():
    scene = Scene([Solid(*shapes.cube(0.1), name="a")])
    with pytest.raises(SceneError, match="'a' is asked how far it is from itself, expected two parts"):
        scene.clearance("a", "a")


@pytest.mark.parametrize("limits", [{"tolerance": -0.1}, {"tolerance": np.nan}, {"budget": 0}])
def test_limits_that_are_none_are_refused(limits):
    scene = Scene([Solid(*shapes.cube(0.1), name="a"), Solid(*shapes.cube(0.1, (1, 0, 0)), name="b")])
    with pytest.raises(ArgumentError, match="expected"):
        scene.clearance("a", "b", **limits)


@pytest.fixture(scope="module")
def cloud():
    """Parts of three kinds at random poses: apart, crossing, and one inside another."""
    rng = np.random.default_rng(4)
    kinds = shapes.torus(0.03, 0.01), shapes.sphere(0.02, 2), shapes.cube(0.05, (0.0, 0.0, 0.0))
    scene = Scene([Solid(*kinds[k % 3], name=f"part {k}") for k in range(14)])
    for k in range(14):
        scene.move(f"part {k}", proximity.Pose(shapes.rotation(k), rng.uniform(-0.12, 0.12, 3)))
    scene.move("part 1", scene.part("part 2").pose)
    scene.hide("part 5")
    return scene


def every_pair(scene):
    names = [part.name for part in scene.parts if not part.is_hidden]
    found = [scene.clearance(*pair) for pair in combinations(names, 2)]
    return sorted(found, key=lambda pair: pair.distance)


@pytest.mark.parametrize(
    "limits", [{}, {"max_distance": 0.03}, {"most": 5}, {"most": 9, "max_distance": 0.05}, {"most": 0}]
)
def test_closest_pairs_are_those_of_all_pairs(cloud, limits):
    found, expected = cloud.closest_pairs(**limits), every_pair(cloud)

    expected = [pair for pair in expected if pair.distance <= limits.get("max_distance", np.inf)]
    expected = expected[: limits.get("most")]
    assert [pair[:5] for pair in found] == [pair[:5] for pair in expected]
    assert not limits or len(found) < 78


def test_closest_pairs_of_one_part_are_its_own(cloud):
    found = cloud.closest_pairs(of="part 5", max_distance=0.1)

    others = {pair.first if pair.second == "part 5" else pair.second for pair in found}
    assert "part 5" not in others and len(others) == len(found) > 2
    assert all(pair.distance == cloud.clearance(pair.first, pair.second).distance for pair in found)


def test_pairs_at_exactly_the_distance_are_found():
    cubes = [Solid(*shapes.cube(0.5, (float(k), 0.0, 0.0)), name=str(k)) for k in range(3)]

    assert [pair.distance for pair in Scene(cubes).closest_pairs(max_distance=0.5)] == [0.5, 0.5]


def test_pairs_that_touch_are_found_within_no_distance():
    cubes = [Solid(*shapes.cube(0.5, (0.5 * k, 0.0, 0.0)), name=str(k)) for k in range(4)]

    found = Scene(cubes).closest_pairs(max_distance=0.0)

    assert [(pair.first, pair.second) for pair in found] == [("0", "1"), ("1", "2"), ("2", "3")]
    assert {pair.relation for pair in found} == {"touching"}


@pytest.mark.parametrize("limits", [{"max_distance": -1.0}, {"max_distance": np.nan}, {"most": -1}])
def test_pairs_within_no_distance_are_refused(cloud, limits):
    with pytest.raises(ArgumentError, match="expected"):
        cloud.closest_pairs(**limits)


def test_pairs_are_of_one_state_while_parts_move():
    """Two parts jump together by 1 m; no result mixes poses from before and after."""
    solids = [Solid(*shapes.cube(0.1, (0, 0, 0)), name=name) for name in "ab"]
    scene, ended = Scene(solids), threading.Event()
    places = [[np.eye(4), np.eye(4)], [np.eye(4), np.eye(4)]]
    for k in range(2):
        places[k][0][0, 3], places[k][1][0, 3] = k, k + 0.2

    def jump():
        k = 0
        while not ended.is_set():
            k = 1 - k
            scene.move_many(["a", "b"], places[k])

    scene.move_many(["a", "b"], places[0])
    mover = threading.Thread(target=jump)
    mover.start()
    try:
        seen = {round(scene.clearance("a", "b").distance, 9) for _ in range(2000)}
    finally:
        ended.set()
        mover.join()
    assert seen == {0.1}
