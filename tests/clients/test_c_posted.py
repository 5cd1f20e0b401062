"""Poses of parts that another thread posts to the library, applied in the next tick."""

import threading

import numpy as np
import pytest
from project import MESHES

import proximity
from benchmarks.digest.library import LibraryTracker, through_library
from proximity import ArgumentError, Pose, PoseError
from proximity.core import library_in_c
from proximity.native import IS_AHEAD
from proximity.scene.model.scene_state import FARTHEST_MOVE, FASTEST_MOVE

pytestmark = pytest.mark.skipif(
    not (IS_AHEAD and any((library_in_c.NATIVE / name).is_file() for name in library_in_c.LIBRARIES)),
    reason="the library is compiled with the kernels",
)
MS = 1_000_000
START = 1000 * MS
CARRIED_S = 0.1


def turned(axis_times_angle):
    """Return a rotation, computed from its quaternion."""
    angle = np.linalg.norm(axis_times_angle)
    x, y, z = np.sinc(angle / 2 / np.pi) / 2 * np.asarray(axis_times_angle)
    w = np.cos(angle / 2)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def some_pose(rng):
    return Pose(turned(rng.uniform(-2, 2, 3)), rng.uniform(-0.1, 0.1, 3)).matrix


def test_ticks_after_a_post_are_those_after_a_move_in_python():
    rng = np.random.default_rng(8)
    scene, copy = (proximity.load(MESHES / "assembly.glb") for _ in range(2))
    names = [part.name for part in scene.parts]
    posted, moved = LibraryTracker(scene, fingers=3), proximity.Tracker(copy, fingers=3)
    for k in range(30):
        now, tips = START + k * MS, rng.uniform(-0.1, 0.1, (3, 3))
        for name in names[: k % 3]:
            pose = some_pose(rng)
            posted._scene.post(name, some_pose(rng), now)  # replaced by the next post
            posted._scene.post(name, pose, now)
            copy.move(name, pose)
        assert posted.tick(tips, now, now).tobytes() == moved.tick(tips, now, now).tobytes()


def test_part_is_carried_on_to_the_newest_finger_and_stands_after_a_while():
    rng = np.random.default_rng(9)
    scene = proximity.load(MESHES / "assembly.glb")
    tracker, name = LibraryTracker(scene, fingers=2), scene.parts[0].name
    start, speed, turn = some_pose(rng), rng.uniform(-1, 1, 3), rng.uniform(-3, 3, 3)
    tracker._scene.post(name, start, START, speed, turn)
    tips = np.array([[0.2, 0, 0], [np.nan, 0, 0]])  # the second finger is absent
    for ms in (-150, -20, 0, 1, 11, 50, 99, 100, 101, 200):
        if ms == -20:
            tracker._scene.post(name, start, START, speed, turn)
        instants = [START + ms * MS, START + 500 * MS]
        tracker.tick(tips, instants, START + 500 * MS)

        seconds = np.clip(1e-3 * ms, -CARRIED_S, CARRIED_S)
        expected = start.copy()
        expected[:3, :3] = turned(turn * seconds) @ start[:3, :3]
        expected[:3, 3] += speed * seconds
        np.testing.assert_allclose(tracker._scene.pose(name), expected, rtol=0, atol=1e-15)


def test_part_without_fingers_is_where_it_is_now():
    scene = through_library(proximity.load(MESHES / "bracket.stl", units="mm"))
    (name,) = scene.names
    scene.post(name, np.eye(4), START, [1.0, 0, 0])
    scene.take(START + 10 * MS)

    assert scene.pose(name)[0, 3] == pytest.approx(0.01, abs=1e-15)


def test_the_later_of_post_and_move_holds():
    scene = through_library(proximity.load(MESHES / "bracket.stl", units="mm"))
    (name,) = scene.names
    poses = [Pose(translation=(0.01 * k, 0, 0)).matrix for k in range(3)]
    scene.post(name, poses[1], START, [1.0, 0, 0])
    scene.move_many([name], [poses[2]])
    scene.take(START + 10 * MS)
    assert scene.pose(name).tolist() == poses[2].tolist()

    scene.post(name, poses[1], START)
    scene.take(START)
    assert scene.pose(name).tolist() == poses[1].tolist()


def test_part_that_would_leave_the_world_stays_where_it_was_posted():
    scene = through_library(proximity.load(MESHES / "bracket.stl", units="mm"))
    (name,) = scene.names
    scene.post(name, Pose(translation=(FARTHEST_MOVE, 0, 0)).matrix, START, [FASTEST_MOVE / 2, 0, 0])
    scene.take(START + 50 * MS)

    assert scene.pose(name)[0, 3] == FARTHEST_MOVE
    assert np.isfinite(scene.signed_distance([[0.0, 0.0, 0.0]])).all()


@pytest.mark.parametrize(
    ("name", "matrix", "pose_ns", "speed", "error", "words"),
    [
        ("none", np.eye(4), 0, None, ArgumentError, "there is no part -1, expected 0 to 0"),
        ("bracket", np.diag([1.0, 1, -1, 1]), 0, None, PoseError, "part 'bracket': the matrix mirrors"),
        ("bracket", 2 * np.eye(4), 0, None, PoseError, "the last row 0 0 0 2"),
        ("bracket", np.eye(4), 0, [np.nan, 0, 0], PoseError, "a velocity is not finite"),
        ("bracket", np.eye(4), 2**62 + 1, None, ArgumentError, "pose_ns is beyond 2^62 ns"),
        ("bracket", np.eye(4), -(2**63), None, ArgumentError, "pose_ns is beyond 2^62 ns"),
    ],
)
def test_post_that_cannot_be_used_is_told_and_changes_nothing(name, matrix, pose_ns, speed, error, words):
    scene = through_library(proximity.load(MESHES / "bracket.stl", units="mm"))
    before = scene.pose("bracket").tolist()

    with pytest.raises(error, match=words.replace("^", r"\^")):
        scene.post(name, matrix, pose_ns, speed)
    scene.take(START)

    assert scene.pose("bracket").tolist() == before


def test_a_thread_that_posts_never_tears_a_pose():
    scene = proximity.load(MESHES / "assembly.glb")
    tracker, name, count = LibraryTracker(scene, fingers=2), scene.parts[0].name, 5000
    matrix = np.eye(4)

    def post():
        for k in range(1, count + 1):
            matrix[:3, 3] = 1e-6 * k
            tracker._scene.post(name, matrix, START + k * MS)

    thread, seen = threading.Thread(target=post), 0.0
    tracker._scene.post(name, matrix, START)
    thread.start()
    is_last = False
    while not is_last:
        is_last = not thread.is_alive()
        tracker.tick(np.full((2, 3), 0.1), START, START)
        x, y, z = tracker._scene.pose(name)[:3, 3]
        assert x == y == z >= seen
        seen = x

    assert tracker._scene.pose(name)[0, 3] == 1e-6 * count
