"""The clearance between two parts, beside shapes that are known and another library."""

from itertools import combinations

import numpy as np
import pytest
import shapes
import trimesh
from changing import seen_while
from manifold3d import Manifold, Mesh

import proximity
from proximity import NO_FACE, ArgumentError, Scene, SceneError, Solid
from proximity.kernels.answers import CLEARANCE_SIZE
from proximity.kernels.pair.part_query import connect_parts

FAR = 100.0


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
    assert found.distance == pytest.approx(
        solids[0].min_gap(solids[1], FAR), abs=1e-7
    )  # it computes in float32
    apart = np.linalg.norm(found.point_on_second - found.point_on_first)
    assert found.distance == pytest.approx(apart, abs=1e-15)
    assert (found.first, found.second) == ("a", "b")


def test_what_is_hidden_is_measured_and_stays_hidden():
    scene = Scene(
        [Solid(*shapes.cube(0.1, (0, 0, 0)), name="a"), Solid(*shapes.cube(0.1, (0.2, 0, 0)), name="b")]
    )
    scene.hide("b")
    assert scene.clearance("a", "b").distance == pytest.approx(0.1)
    assert scene.part("b").is_hidden


@pytest.mark.parametrize("seed", range(4))
def test_the_faces_that_are_named_have_the_nearest_points(seed):
    solids = [Solid(*shapes.torus(0.05, 0.02), name="a"), Solid(*shapes.sphere(0.03, 2), name="b")]
    scene = Scene(solids)
    scene.move("b", proximity.Pose(shapes.rotation(seed), np.random.default_rng(seed).normal(size=3) * 0.1))
    found, back = scene.clearance("a", "b"), scene.clearance("b", "a")
    assert (back.first, back.second, back.distance) == (found.second, found.first, found.distance)
    ends = (found.point_on_first, found.point_on_second), (found.face_on_first, found.face_on_second)
    for name, point, face in zip("ab", *ends, strict=True):
        part = scene.part(name)
        corners = part.pose.point(part.solid.mesh.vertices[part.solid.mesh.faces[face]])
        assert Solid(corners, [[0, 1, 2]]).distance(point) == pytest.approx(0.0, abs=1e-14)


def connection_of(scene, *, limit=np.inf, tolerance=0.0, budget=0):
    answer = np.empty(CLEARANCE_SIZE)
    connect_parts(scene.snapshot().packed, 0, 1, limit, tolerance, budget, answer)
    return answer


@pytest.mark.parametrize("seed", range(4))
def test_bounds_hold_with_a_limit_a_tolerance_and_a_budget(seed):
    solids = [Solid(*shapes.torus(0.05, 0.02), name="a"), Solid(*shapes.sphere(0.03, 3), name="b")]
    scene = Scene(solids)
    scene.move("b", proximity.Pose(shapes.rotation(seed), [0.11, 0.01 * seed, 0.02]))
    lower, exact = connection_of(scene)[:2]
    assert lower == exact == scene.clearance("a", "b").distance > 0.0
    for options in ({"tolerance": 0.2}, *({"budget": steps} for steps in (1, 10, 30, 100))):
        lower, upper = connection_of(scene, **options)[:2]
        assert lower <= exact <= upper
        assert "budget" in options or lower >= upper / 1.2 * (1.0 - 1e-12)
    assert connection_of(scene, limit=1.5 * exact)[1] == exact
    missed = connection_of(scene, limit=0.9 * exact)
    assert missed[0] == 0.9 * exact and missed[1] == np.inf and list(missed[8:10]) == [NO_FACE, NO_FACE]


TWO = Scene([Solid(*shapes.cube(0.1), name="a"), Solid(*shapes.cube(0.1, (1, 0, 0)), name="b")])


@pytest.mark.parametrize(
    ("ask", "error", "words"),
    [
        (lambda: TWO.clearance("a", "lid"), SceneError, "'lid'"),
        (lambda: TWO.clearance("a", "a"), SceneError,
         "'a' is asked how far it is from itself, expected two parts"),
        (lambda: TWO.clearance("a", "b", tolerance=-0.1), ArgumentError, "tolerance is -0.1, expected"),
        (lambda: TWO.clearance("a", "b", tolerance=np.nan), ArgumentError, "tolerance is nan, expected"),
        (lambda: TWO.clearance("a", "b", budget=0), ArgumentError, "budget is 0, expected"),
        (lambda: TWO.closest_pairs(max_distance=-1.0), ArgumentError, "max_distance is -1.0, expected"),
        (lambda: TWO.closest_pairs(max_distance=np.nan), ArgumentError, "max_distance is nan, expected"),
        (lambda: TWO.closest_pairs(most=-1), ArgumentError, "most is -1, expected"),
    ],
)  # fmt: skip
def test_names_and_limits_that_do_not_fit_are_refused(ask, error, words):
    with pytest.raises(error, match=words):
        ask()


@pytest.mark.parametrize(
    ("step", "limit", "pairs", "distance", "relation"),
    [(1.0, 0.5, ["01", "12"], 0.5, "apart"), (0.5, 0.0, ["01", "12", "23"], 0.0, "touching")],
)
def test_pairs_at_exactly_the_distance_are_found(step, limit, pairs, distance, relation):
    count = len(pairs) + 1
    cubes = [Solid(*shapes.cube(0.5, (step * k, 0.0, 0.0)), name=str(k)) for k in range(count)]
    found = Scene(cubes).closest_pairs(max_distance=limit)
    assert [pair.first + pair.second for pair in found] == pairs
    assert {(pair.distance, pair.relation) for pair in found} == {(distance, relation)}


@pytest.fixture(scope="module")
def cloud():
    """Parts of three kinds all over the place: apart, crossing, and one inside another."""
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


def test_pairs_are_of_one_state_while_parts_move():
    """Two parts jump together, 1 m: no answer mixes poses of before and after."""
    scene = Scene([Solid(*shapes.cube(0.1, (0, 0, 0)), name=name) for name in "ab"])
    places = np.tile(np.eye(4), (2, 2, 1, 1))
    places[:, :, 0, 3] = [[0.0, 0.2], [1.0, 1.2]]
    scene.move_many(["a", "b"], places[0])

    def jump():
        for k in range(4000):
            scene.move_many(["a", "b"], places[k % 2])

    seen = seen_while(jump, lambda: round(scene.clearance("a", "b").distance, 9))
    assert set().union(*seen) == {0.1}
