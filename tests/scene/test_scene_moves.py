"""Parts that move between queries: cheap, atomic, and bitwise equal to a new scene."""

import re

import judging
import numpy as np
import pytest
import shapes
from changing import seen_while
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_parts import (
    anew,
    answers,
    assert_answers_alike,
    assert_right_by_brute_force,
    part_of,
    some_parts,
    some_pose,
    some_questions,
)

from proximity.errors import ArgumentError, PoseError, SceneError
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid

VELOCITY, ANGULAR_VELOCITY = (1.0, -2.0, 0.5), (0.1, 0.2, -0.3)


def matrices_of(rng, count, spread=5.0):
    return np.array([some_pose(rng, spread).matrix for _ in range(count)])


@pytest.mark.parametrize("count", [1, 2, 9, 100])
def test_moved_scene_answers_to_the_bit_as_one_made_anew(count):
    rng = np.random.default_rng(count)
    scene = Scene(some_parts(count))
    points, others = some_questions(rng, 60)
    for _ in range(6):
        chosen = rng.permutation(count)[: rng.integers(1, count + 1)]
        scene.move_many([f"part {row}" for row in chosen], matrices_of(rng, len(chosen)))

        assert_answers_alike(scene, anew(scene), points, others)
        assert np.array_equal(scene.bounds, anew(scene).bounds)
    assert_right_by_brute_force(scene, points)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**31), count=st.integers(1, 12))
def test_any_sequence_of_changes_leaves_a_scene_as_one_made_anew(seed, count):
    rng = np.random.default_rng(seed)
    scene = Scene(some_parts(count, seed=count))
    spare = some_parts(20, seed=99)[12:]
    points, others = some_questions(rng, 30)
    for _ in range(8):
        names = [part.name for part in scene.parts]
        name, what = str(rng.choice(names)), int(rng.integers(7))
        if what <= 1:
            scene.move(name, some_pose(rng, 5.0), velocity=rng.normal(size=3))
        elif what == 2:
            chosen = [str(each) for each in rng.permutation(names)[: rng.integers(1, len(names) + 1)]]
            scene.move_many(chosen, matrices_of(rng, len(chosen)))
        elif what == 3:
            scene.hide(name)
        elif what == 4:
            scene.show(name)
        elif what == 5 and spare:
            scene.add(spare.pop())
        elif what == 6 and len(names) > 1:
            scene.remove(name)
        if rng.integers(2):
            assert_answers_alike(scene, anew(scene), points, others)
    assert_answers_alike(scene, anew(scene), points, others)
    assert_right_by_brute_force(scene, points)


def test_loose_parts_that_stop_where_they_began_answer_as_at_first():
    scene = Scene(some_parts(20))
    points, others = some_questions(np.random.default_rng(1), 100)
    before, poses = answers(scene, points, others), {part.name: part.pose for part in scene.parts}
    for name in poses:
        scene.move(name, Pose(translation=(1.0, 2.0, 3.0)))
        scene.distance(points[0])

    scene.move_many(list(poses), list(poses.values()))

    for found, expected in zip(answers(scene, points, others), before, strict=True):
        assert judging.same_bits(found, expected)


def test_parts_of_one_frame_are_walked_right_after_some_of_them_left_it():
    """Bodies of one mesh share the scene's frame: leaves of its tree are nodes and blocks of parts."""
    bodies = [shapes.moved(shapes.torus(n=16, m=8), (4.0 * (k % 4), 4.0 * (k // 4), 0.0)) for k in range(16)]
    bodies += [shapes.moved(shapes.tetrahedron(), (2.0 + 4.0 * k, 2.0, 0.0)) for k in range(3)]
    scene = Scene.from_mesh(*shapes.join(*bodies))
    rng = np.random.default_rng(3)
    points, others = rng.uniform(-3.0, 15.0, (2, 100, 3))
    assert scene.snapshot().parts["is_fused"][:-1].all()
    for name in [part.name for part in scene.parts][::3]:
        scene.move(name, some_pose(rng, 5.0))
        assert_answers_alike(scene, anew(scene), points, others)
    hidden = scene.parts[1].name
    scene.hide(hidden)
    assert_answers_alike(scene, anew(scene), points, others)

    scene.show(hidden)

    assert_answers_alike(scene, anew(scene), points, others)
    assert_right_by_brute_force(scene, points)


def test_bounds_are_those_of_the_vertices_however_parts_are_turned():
    # Regression: the box of a rotated box, 179.3 mm for a ball of 153.6 mm.
    rng = np.random.default_rng(5)
    vertices, faces = shapes.sphere(0.01)
    unused = np.vstack([vertices, [[9.0, 9.0, 9.0]]])
    scene = Scene([Solid(unused, faces, name="ball"), Solid(*shapes.cube(0.02), name="cube")])
    for matrices in (None, *(matrices_of(rng, 2, 0.1) for _ in range(3)), np.array([np.eye(4)] * 2)):
        if matrices is not None:
            scene.move_many(["ball", "cube"], matrices)
        corners = [part.pose.point(part.solid.mesh.vertices[part.solid.mesh.faces]) for part in scene.parts]
        corners = np.concatenate([corner.reshape(-1, 3) for corner in corners])
        for _ in range(2):
            lower, upper = scene.bounds
            assert np.allclose(lower, corners.min(axis=0), rtol=0, atol=1e-15)
            assert np.allclose(upper, corners.max(axis=0), rtol=0, atol=1e-15)
            lower[:] = upper[:] = 7.0  # the caller's own copy


def test_bounds_follow_parts_that_other_threads_move_and_remove():
    scene = Scene(some_parts(4))
    largest = np.abs(scene.bounds).max() + 20.0
    last = scene.parts[-1]

    def change():
        for matrix in matrices_of(np.random.default_rng(3), 100):
            scene.move(scene.parts[0].name, matrix)
            scene.remove(last.name)
            scene.add(last)

    for lower, upper in np.concatenate(seen_while(change, lambda: scene.bounds)):
        assert (lower < upper).all() and np.abs([lower, upper]).max() <= largest


def test_velocities_are_those_of_the_last_move():
    scene = Scene(some_parts(3))
    scene.move("part 1", Pose(), velocity=VELOCITY, angular_velocity=ANGULAR_VELOCITY)
    assert scene.part("part 1").velocity.tolist() == list(VELOCITY)
    assert scene.part("part 1").angular_velocity.tolist() == list(ANGULAR_VELOCITY)

    scene.move_many(["part 2", "part 1"], [np.eye(4)] * 2, [VELOCITY, (0, 0, 7)], np.ones((2, 3)))

    assert [part.velocity.tolist() for part in scene.parts] == [[0, 0, 0], [0, 0, 7], list(VELOCITY)]
    assert scene.parts[2].angular_velocity.tolist() == [1, 1, 1]
    scene.move_many(["part 1"], [np.eye(4)])
    assert not scene.part("part 1").velocity.any()
    frame = scene.snapshot().frames[1]
    assert not frame["velocity"].any() and not frame["angular_velocity"].any()


def test_moving_does_not_change_the_epoch():
    scene = Scene(some_parts(3))

    scene.move("part 1", Pose(translation=(3.0, 0.0, 0.0)), velocity=VELOCITY)
    scene.set_surface("part 1", stiffness=1.0)

    assert scene.epoch == scene.snapshot().epoch == 0


def test_parts_that_did_not_move_are_the_same_objects():
    scene = Scene(some_parts(5))
    before = scene.parts

    scene.move("part 2", Pose(translation=(3.0, 0.0, 0.0)))

    after = scene.parts
    assert [one is two for one, two in zip(before, after, strict=True)] == [True, True, False, True, True]
    assert scene.parts[2] is after[2] is scene.part("part 2")
    assert after[2].pose.translation.tolist() == [3.0, 0.0, 0.0]
    with pytest.raises(ValueError, match="read-only"):
        after[2].pose.translation[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        after[2].velocity[0] = 1.0


def test_part_that_leaves_the_scene_is_found():
    scene, rng = Scene(some_parts(9)), np.random.default_rng(4)
    for step in range(200):
        scene.move("part 3", Pose(shapes.rotation(step), (10.0 * step, 0.0, 0.0)))
        if step % 20 == 0:
            points, others = some_questions(rng, 20)
            points[::2] += (10.0 * step, 0.0, 0.0)
            assert_answers_alike(scene, anew(scene), points, others)
        scene.distance((0.0, 0.0, 0.0))


@pytest.mark.parametrize("far", [1e4, 1e9])
def test_whole_scene_may_move_far(far):
    parts = some_parts(9)
    scene = Scene(parts)
    shift = np.array([far, -far, far])
    points, others = some_questions(np.random.default_rng(6), 50)

    scene.move_many(
        [part.name for part in parts], [Pose(p.pose.rotation, p.pose.translation + shift) for p in parts]
    )

    assert_answers_alike(scene, anew(scene), points + shift, others + shift)


def test_turn_that_is_off_by_rounding_is_mended():
    """Products of many rotations accumulate error; within a pose's tolerance the nearest rotation is used."""
    scene = Scene(some_parts(3))
    matrix = np.eye(4)
    matrix[:3, :3] = shapes.rotation(3) @ (np.eye(3) + 2e-10 * np.arange(9).reshape(3, 3) / 8.0)

    scene.move_many(["part 1"], [matrix])

    rotation = scene.part("part 1").pose.rotation
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() <= 4 * 2.0**-52
    assert np.abs(rotation - Pose.from_matrix(matrix).rotation).max() <= 4 * 2.0**-52
    assert np.abs(rotation - matrix[:3, :3]).max() > 1e-11
    scene.move("part 2", matrix)
    assert judging.same_bits(scene.part("part 2").pose.rotation, rotation)


def test_poses_may_be_poses_matrices_lists_or_integers():
    scene = Scene(some_parts(3))
    pose = Pose(translation=(1.0, 2.0, 3.0))
    names = ["part 0", "part 1", "part 2"]

    scene.move_many(iter(names), [pose, pose.matrix, pose.matrix.tolist()])
    assert [part.pose.translation.tolist() for part in scene.parts] == [[1, 2, 3]] * 3
    scene.move_many(names, np.tile(np.eye(4, dtype=np.int32), (3, 1, 1)))
    assert all(part.pose.is_identity for part in scene.parts)
    scene.move_many([], [])
    scene.move_many([], np.zeros((0, 4, 4)), np.zeros((0, 3)))
    scene.move("part 0", pose.matrix.astype(np.float32).tolist())
    assert scene.parts[0].pose.translation.tolist() == [1, 2, 3]


def test_moves_in_single_precision_are_those_of_the_nearest_rotations():
    """Regression: matrices of game engines, with errors of 1e-6, were refused as shears."""
    scene, rng = Scene(some_parts(3)), np.random.default_rng(8)
    matrices = matrices_of(rng, 3).astype(np.float32)
    names = ["part 0", "part 1", "part 2"]

    scene.move_many(names, matrices)
    rotations = [part.pose.rotation for part in scene.parts]
    np.testing.assert_allclose(rotations, matrices[:, :3, :3], atol=1e-6)
    for name, matrix, rotation in zip(names, matrices, rotations, strict=True):
        assert np.abs(rotation @ rotation.T - np.eye(3)).max() <= 4 * 2.0**-52
        scene.move(name, matrix)
        assert judging.same_bits(scene.part(name).pose.rotation, rotation)


def test_names_may_come_from_somebody_who_asks_the_scene():
    scene = Scene(some_parts(3))
    scene.hide("part 1")

    scene.move_many(
        (part.name for part in scene.parts if not scene.part(part.name).is_hidden),
        [Pose(translation=(7, 0, 0)), Pose(translation=(8, 0, 0))],
    )

    assert [part.pose.translation[0] for part in scene.parts][::2] == [7.0, 8.0]


def test_names_of_the_last_move_are_looked_up_anew_once_parts_are_others():
    scene, names = Scene(some_parts(4)), ["part 1", "part 3"]
    near, far = [Pose(translation=(x, 0.0, 0.0)) for x in (1.0, 2.0)], [Pose(translation=(9.0, 0.0, 0.0))] * 2

    def stands(name):
        return scene.part(name).pose.translation[0]

    scene.move_many(names, near)
    scene.move_many(names, far)
    assert (stands("part 1"), stands("part 3")) == (9.0, 9.0)
    scene.remove("part 0")
    scene.move_many(names, near)
    assert (stands("part 1"), stands("part 3")) == (1.0, 2.0)
    names.reverse()
    scene.move_many(names, near)
    assert (stands("part 1"), stands("part 3")) == (2.0, 1.0)
    scene.remove("part 3")
    with pytest.raises(SceneError, match="no part is named 'part 3'"):
        scene.move_many(names, far)


SCALED, MIRRORED, SHEARED = np.diag([2.0, 2, 2, 1]), np.diag([1.0, 1, -1, 1]), np.eye(4)
SHEARED[3, 0] = 0.5
FAR, NAN = np.eye(4), np.eye(4)
FAR[1, 3], NAN[2, 3] = 1e200, np.nan


@pytest.mark.parametrize(
    "matrix, message",
    [
        (SCALED, "part 'part 2': a pose's rotation is not orthonormal"),
        (MIRRORED, "part 'part 2': a pose's rotation mirrors (determinant -1), expected +1"),
        (SHEARED,
         "part 'part 2': the last row of a pose's matrix is [0.5, 0.0, 0.0, 1.0], expected [0, 0, 0, 1]"),
        (NAN, "part 'part 2': a pose's translation is [0.0, 0.0, nan], expected finite numbers"),
        (FAR, "part 'part 2' would be moved by 1e+200 m, which is farther than can be computed with"),
    ],
)  # fmt: skip
def test_pose_that_is_not_rigid_is_named_and_nothing_moves(matrix, message):
    scene = Scene(some_parts(3))
    points, others = some_questions(np.random.default_rng(10), 20)
    before = answers(scene, points, others)
    good = Pose(translation=(1.0, 0.0, 0.0)).matrix
    moves = [
        lambda: scene.move_many(["part 1", "part 2"], np.array([good, matrix])),
        lambda: scene.move_many(["part 1", "part 2"], [Pose.from_matrix(good), matrix]),
        lambda: scene.move("part 2", matrix),
        lambda: scene.move("part 2", matrix.tolist()),
    ]

    for move in moves:
        with pytest.raises(PoseError, match=f"^{re.escape(message)}"):
            move()

    for found, expected in zip(answers(scene, points, others), before, strict=True):
        assert judging.same_bits(found, expected)
    assert not scene.snapshot().parts["is_dynamic"].any()


TWO = [np.eye(4), np.eye(4)]


@pytest.mark.parametrize(
    "given, error, message",
    [
        ((["part 0", "lid"], TWO), SceneError, "no part is named 'lid'; the scene has 'part 0', 'part 1'"),
        ((["part 0", "part 0"], TWO), SceneError, "part 'part 0' is named twice, expected names that differ"),
        (("part 0", TWO), SceneError, "names are 'part 0', expected a list of names"),
        ((["part 0"], TWO), PoseError,
         "poses have shape (2, 4, 4), expected (1, 4, 4): one for each part named"),
        ((["part 0"], [Pose(), Pose()]), PoseError,
         "there are 2 poses for 1 parts, expected one for each part"),
        ((["part 0", "part 1"], TWO, np.zeros(3)), ArgumentError,
         "velocities have shape (3,), expected (2, 3): one for each part named"),
        ((["part 0", "part 1"], TWO, [[0, 0, 0], [0, np.inf, 0]]), ArgumentError,
         "velocity of part 'part 1' is [0.0, inf, 0.0], expected 3 finite numbers, m/s"),
        ((["part 0", "part 1"], TWO, [[1e9, 0, 0], [0, 1e300, 0]]), ArgumentError,
         "velocity of part 'part 1' is [0.0, 1e+300, 0.0], expected at most 1e+09 m/s along each axis"),
    ],
)  # fmt: skip
def test_moves_of_several_parts_that_do_not_fit_are_refused(given, error, message):
    scene = Scene(some_parts(2))

    with pytest.raises(error, match=f"^{re.escape(message)}$"):
        scene.move_many(*given)


@pytest.mark.parametrize(
    "values, message",
    [
        ({"velocity": (0, np.nan, 0)},
         "velocity of part 'part 0' is [0.0, nan, 0.0], expected 3 finite numbers, m/s"),
        (
            {"angular_velocity": (0, 0, -2e9)},
            "angular_velocity of part 'part 0' is [0.0, 0.0, -2000000000.0], "
            "expected at most 1e+09 rad/s along each axis",
        ),
        ({"velocity": (0, 1)}, "velocity of part 'part 0' has shape (2,), expected 3 finite numbers, m/s"),
        ({"angular_velocity": "abc"},
         "entries of angular_velocity of part 'part 0' have dtype <U3, expected 3 finite numbers, rad/s"),
    ],
)  # fmt: skip
def test_velocity_that_is_none_is_refused(values, message):
    scene = Scene(some_parts(2))

    with pytest.raises(ArgumentError, match=f"^{re.escape(message)}$"):
        scene.move("part 0", Pose(), **values)
    with pytest.raises(ArgumentError, match=f"^{re.escape(message)}$"):
        Scene([part_of(shapes.cube(), "part 0", **values)])


def test_matrix_in_fortran_order_moves_a_part_as_well():
    scene = Scene([Solid(*shapes.cube(), name="cube")])
    pose = np.eye(4)
    pose[:3, 3] = 1.0, 2.0, 3.0

    scene.move("cube", np.asfortranarray(pose))

    assert scene.part("cube").pose.translation.tolist() == [1.0, 2.0, 3.0]
