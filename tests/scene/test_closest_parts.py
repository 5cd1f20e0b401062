"""The nearest parts of a point: `closest` for each part alone, in order, and brute force."""

import judging
import numpy as np
import pytest
import shapes
from hypothesis import given, settings
from hypothesis import strategies as st
from query_rows import MESHES, mesh_of, some_points
from scene_parts import part_of, some_parts, some_pose, some_questions

from proximity.errors import ArgumentError, SceneError, UnitsWarning
from proximity.kernels.layout import NO_FACE, NO_PART
from proximity.pose import Pose
from proximity.scene.queries.results import ClosestPoints
from proximity.scene.scene import Part, Scene
from proximity.scene.solid import Solid

FIELDS = ClosestPoints._fields


def one_by_one(scene, points, *, ignore=(), max_distance=np.inf):
    """Rows of (N, P): the answers of `closest` for each visible part alone, sorted by signed distance.

    The values of a field are sorted, too; a part without an answer comes last.
    """
    shown = [row for row, part in enumerate(scene.parts) if not part.is_hidden and part.name not in ignore]
    alone = [
        scene.closest(
            points, max_distance=max_distance, ignore=[other for other in range(len(scene)) if other != row]
        )
        for row in shown
    ]
    distances = np.stack([hits.signed_distance for hits in alone], axis=-1)
    order = np.argsort(distances, axis=-1, kind="stable")
    found = {}
    for field in FIELDS:
        values = np.stack([getattr(hits, field) for hits in alone], axis=1)
        found[field] = np.take_along_axis(values, order if values.ndim == 2 else order[..., None], axis=1)
    return found


def assert_as_one_by_one(scene, points, *, ignore=(), **options):
    expected = one_by_one(scene, points, ignore=ignore, **options)
    count = expected["part"].shape[1]
    found = scene.closest_parts(points, most=count + 2, ignore=list(ignore), **options)
    for field in FIELDS:
        assert judging.same_bits(getattr(found, field)[:, :count], expected[field]), field
    is_finite = np.isfinite(points).all(axis=-1)
    assert (found.part[:, count:] == NO_PART).all() and (found.face_id[:, count:] == NO_FACE).all()
    assert np.isnan(found.point[:, count:]).all()
    assert np.array_equal(found.signed_distance[:, count:] == np.inf, is_finite[:, None].repeat(2, axis=1))
    for most in {1, 2, max(count // 2, 1)}:
        few = scene.closest_parts(points, most=most, ignore=list(ignore), **options)
        distances = np.full((len(points), most), np.nan)
        distances[is_finite] = np.inf
        distances[:, : min(most, count)] = expected["signed_distance"][:, :most]
        # Of parts that are as near but for rounding, either may be the last.
        np.testing.assert_allclose(few.signed_distance, distances, rtol=1e-13, atol=1e-13)
        assert_rows_are_answers(few, expected)


def assert_rows_are_answers(found, expected):
    """Each row is that of its part in *expected*, and no part is reported twice."""
    for number, parts in enumerate(found.part):
        for row in np.flatnonzero(parts != NO_PART):
            (at,) = np.flatnonzero(expected["part"][number] == parts[row])
            for field in FIELDS:
                assert judging.same_bits(getattr(found, field)[number, row], expected[field][number, at])
        reported = parts[parts != NO_PART]
        assert len(set(reported.tolist())) == len(reported)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**31), count=st.integers(2, 14))
def test_each_row_is_the_answer_for_that_part_alone(seed, count):
    """Of parts that overlap, stand still or move, are turned or not, and some of them hidden."""
    rng = np.random.default_rng(seed)
    scene = Scene(some_parts(count, seed=seed, is_turned=bool(seed % 2)))
    points, _ = some_questions(rng, 40, 4.0)
    for _ in range(3):
        names = [part.name for part in scene.parts]
        ignore = [str(name) for name in rng.permutation(names)[: rng.integers(count - 1)]]
        assert_as_one_by_one(scene, points, ignore=ignore)
        assert_as_one_by_one(scene, points, max_distance=float(rng.uniform(0.1, 3.0)))
        scene.move(str(rng.choice(names)), some_pose(rng, 3.0))
        if rng.integers(2):
            scene.hide(names[0])


@pytest.mark.parametrize("seed", range(6))
def test_open_thin_and_intersecting_parts_are_answered_alike(seed):
    rng = np.random.default_rng(seed)
    names = rng.choice(sorted(MESHES), 8)
    scene = Scene([part_of(mesh_of(name), f"part {k}", some_pose(rng, 1.5)) for k, name in enumerate(names)])
    near = [
        part.pose.point(some_points(name, 20, seed)) for part, name in zip(scene.parts, names, strict=True)
    ]

    assert_as_one_by_one(scene, np.concatenate(near))
    assert_as_one_by_one(scene, np.concatenate(near), max_distance=0.4)


def test_bodies_of_one_mesh_are_parts_of_their_own():
    """Leaves of the scene's tree are nodes and blocks of parts; some parts move."""
    bodies = [shapes.moved(shapes.torus(n=16, m=8), (3.0 * (k % 4), 3.0 * (k // 4), 0.0)) for k in range(16)]
    bodies += [shapes.moved(shapes.tetrahedron(), (1.5 + 3.0 * k, 1.5, 0.0)) for k in range(3)]
    scene, rng = Scene.from_mesh(*shapes.join(*bodies)), np.random.default_rng(5)
    points = rng.uniform(-3.0, 12.0, (100, 3))
    assert scene.snapshot().parts["is_fused"][:-1].all()

    assert_as_one_by_one(scene, points)
    for name in [part.name for part in scene.parts][::3]:
        scene.move(name, some_pose(rng, 5.0))
    assert_as_one_by_one(scene, points)
    assert_as_one_by_one(scene, points, ignore=[scene.parts[0].name, scene.parts[1].name])


def test_parts_that_contain_the_point_come_first_and_the_deepest_before_them():
    boxes = [part_of(shapes.cube(2.0**-k, (0.0, 0.0, 0.0)), f"box {k}") for k in range(4)]
    vertices, faces = shapes.grid(1, 1)
    scene = Scene([*boxes, part_of(((vertices - 0.5) * (4.0, 4.0, 0.0), faces), "sheet")])

    found = scene.closest_parts([0.02, 0.01, 0.01], most=5)

    np.testing.assert_allclose(found.signed_distance, [-0.48, -0.23, -0.105, -0.0425, 0.01], rtol=1e-12)
    assert found.part.tolist() == [0, 1, 2, 3, 4] and found.is_signed.tolist() == [True] * 4 + [False]
    points = np.random.default_rng(6).uniform(-1.0, 1.0, (200, 3))
    points[:40] = np.round(points[:40] * 4.0) / 4.0  # on faces, edges and corners
    assert_as_one_by_one(scene, points)
    assert_as_one_by_one(scene, points, max_distance=0.2)


def test_equally_near_parts_are_in_order_of_their_index():
    """Cubes around a point, at distance 1 each."""
    middles = [(1.5, 0, 0), (0, 1.5, 0), (0, 0, 1.5), (-1.5, 0, 0), (0, -1.5, 0), (0, 0, -1.5)]
    scene = Scene([part_of(shapes.cube(1.0, middle), f"cube {k}") for k, middle in enumerate(middles)])

    for most in (1, 2, 5, 6):
        found = scene.closest_parts(np.zeros((3, 3)), most=most)
        assert found.part.tolist() == [list(range(most))] * 3
        assert (found.signed_distance == 1.0).all()


@pytest.mark.parametrize("most", [1, 3, 30])
def test_batches_and_threads_give_the_answers_of_single_points(most):
    """Large batches are sorted, and each search starts from the parts found last."""
    rng = np.random.default_rng(most)
    scene = Scene(some_parts(24, seed=most))
    scene.move("part 3", some_pose(rng, 3.0))
    points = rng.uniform(-8.0, 8.0, (3000, 3))
    points[7] = np.nan

    batch = scene.closest_parts(points, most=most)

    assert judging.same_bits(batch, scene.closest_parts(points, most=most, workers=3))
    backwards = scene.closest_parts(points[::-1], most=most)
    assert all(judging.same_bits(getattr(backwards, name)[::-1], getattr(batch, name)) for name in FIELDS)
    for row in [*range(0, 3000, 300), 7]:
        one = scene.closest_parts(points[row], most=most)
        for field in FIELDS:
            assert judging.same_bits(getattr(one, field), getattr(batch, field)[row])
    assert np.isnan(batch.signed_distance[7]).all() and (batch.part[7] == NO_PART).all()


def test_first_row_is_the_answer_of_closest():
    scene = Scene(some_parts(12, seed=9))
    points, _ = some_questions(np.random.default_rng(9), 500)
    found, nearest = scene.closest_parts(points, most=1), scene.closest(points)

    for field in FIELDS:
        assert judging.same_bits(getattr(found, field)[:, 0], getattr(nearest, field)), field


def test_distances_are_those_of_brute_force():
    scene = Scene(some_parts(9, seed=2))
    points, _ = some_questions(np.random.default_rng(2), 60, 4.0)
    each = np.empty((len(points), len(scene)))
    for row, part in enumerate(scene.parts):
        mesh, own = part.solid.mesh, part.pose.inverse.point(points)
        each[:, row] = judging.signed_distance(mesh.vertices, mesh.faces, own)

    found = scene.closest_parts(points, most=len(scene))

    np.testing.assert_allclose(found.signed_distance, np.sort(each, axis=1), rtol=1e-12, atol=1e-12)
    for most in (1, 4):
        few = scene.closest_parts(points, most=most).signed_distance
        np.testing.assert_allclose(few, np.sort(each, axis=1)[:, :most], rtol=1e-12, atol=1e-12)


def test_shapes_follow_the_points_and_the_limits():
    scene = Scene(some_parts(5))
    limits = np.array([0.0, 1.0, 2.0, 50.0])

    assert scene.closest_parts([1.0, 2.0, 3.0], most=2).point.shape == (2, 3)
    assert scene.closest_parts(np.zeros((0, 3)), most=2).signed_distance.shape == (0, 2)
    found = scene.closest_parts(np.zeros((3, 1, 3)), most=7, max_distance=limits)
    assert found.signed_distance.shape == (3, 4, 7)
    counts = (found.part[0] != NO_PART).sum(axis=-1)
    assert (np.diff(counts) >= 0).all() and counts[0] == 0 and counts[-1] == 5
    assert (np.abs(found.signed_distance[0, 2, : counts[2]]) <= 2.0).all()


def test_only_part_and_no_part():
    scene = Scene([Solid(*shapes.cube(), name="box")])
    points, _ = some_questions(np.random.default_rng(7), 50, 1.0)

    assert_as_one_by_one(scene, points)
    assert (scene.closest_parts(points, most=2, ignore="box").part == NO_PART).all()
    scene.hide("box")
    assert (scene.closest_parts(points, most=2).signed_distance == np.inf).all()


def test_far_points_and_far_parts():
    parts = [
        Part(f"cube {k}", Solid(*shapes.cube()), Pose(None, [10.0**k, 0, 0]), np.arange(12)) for k in range(6)
    ]
    scene = Scene(parts)
    points = np.array([[-1e3, 2.0, 0.0], [1e9, 0.0, 1.0], [1e5, 3.0, 0.1], [1e30, 0.0, 0.0]])

    assert_as_one_by_one(scene, points)


@pytest.mark.parametrize("most", [0, -1, 1.5, "two", None])
def test_number_of_parts_is_a_whole_number(most):
    with pytest.raises(ArgumentError, match=r"most is .* expected a whole number"):
        Scene(some_parts(2)).closest_parts([0.0, 0.0, 0.0], most=most)


def test_points_in_millimetres_are_noted_at_the_line_of_the_call():
    with pytest.warns(UnitsWarning, match="points are metres") as noted:
        Scene(some_parts(2)).closest_parts([[5000.0, 0.0, 0.0]], most=2)

    assert [each.filename for each in noted] == [__file__]


def test_closed_scene_refuses():
    scene = Scene(some_parts(2))
    scene.close()

    with pytest.raises(SceneError, match="closed"):
        scene.closest_parts([0.0, 0.0, 0.0], most=1)


def test_other_arguments_are_checked_as_for_closest():
    scene = Scene(some_parts(2))
    with pytest.raises(ArgumentError, match="points"):
        scene.closest_parts([0.0, 0.0], most=1)
    with pytest.raises(ArgumentError, match="max_distance is -1"):
        scene.closest_parts([0.0, 0.0, 0.0], most=1, max_distance=-1.0)
    with pytest.raises(ArgumentError, match="workers"):
        scene.closest_parts([0.0, 0.0, 0.0], most=1, workers=0)
    with pytest.raises(SceneError, match="no part is named 'lid'"):
        scene.closest_parts([0.0, 0.0, 0.0], most=1, ignore="lid")
