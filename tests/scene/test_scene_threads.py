"""One thread moves parts while others ask: every answer is that of one moment."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import shapes
from scene_parts import anew, assert_answers_alike, some_parts, some_pose, some_questions

from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid

STEPS = 400


def two_cubes_among_others():
    """Cubes "left" and "right", one above the other as they move; the others are far away."""
    parts = [Solid(*shapes.cube(), name="left"), Solid(*shapes.cube(), name="right")]
    return Scene(
        parts
        + [Solid(*shapes.moved(shapes.torus(), (0.0, 100.0 + 3.0 * k, 0.0)), name=f"{k}") for k in range(20)]
    )


@pytest.mark.parametrize("point_count", [6, 600])
def test_answers_while_parts_move_are_those_of_one_moment(point_count):
    """Both cubes are moved together, so that a point between them is as far from one as from the other."""
    scene = two_cubes_among_others()
    poses = [
        np.array(
            [
                Pose(translation=(-2.0 - 0.01 * k, 0, 0)).matrix,
                Pose(translation=(1.0 + 0.01 * k, 0, 0)).matrix,
            ]
        )
        for k in range(STEPS)
    ]
    scene.move_many(["left", "right"], poses[0])
    expected = np.array([1.0 + 0.01 * k for k in range(STEPS)])
    points = np.tile([[0.0, 0.5, 0.5]], (point_count, 1))
    points[1::2, 1:] = (0.25, 0.75)
    is_done = threading.Event()

    def move():
        try:
            for k in range(STEPS):
                scene.move_many(["left", "right"], poses[k], [[-1.0, k, 0], [1.0, k, 0]])
        finally:
            is_done.set()

    def ask(_):
        seen = []
        while True:
            last = is_done.is_set()
            found = scene.distance(points)
            assert (found == found[0]).all(), "one answer is of one moment"
            velocities = scene.snapshot().frames["velocity"]
            assert velocities[0, 1] == velocities[1, 1], "both velocities are of one move"
            seen.append(found[0])
            if last:
                return seen

    with ThreadPoolExecutor(4) as pool:
        mover = pool.submit(move)
        answers = list(pool.map(ask, range(3)))
        mover.result()

    for seen in answers:
        steps = np.abs(np.array(seen)[:, None] - expected).argmin(axis=1)
        assert np.abs(np.array(seen) - expected[steps]).max() <= 1e-12
        assert (np.diff(steps) >= 0).all(), "time does not run backwards"
        assert steps[-1] == STEPS - 1, "no move is lost"


def test_moves_from_several_threads_are_all_kept():
    scene = Scene(some_parts(12))
    rng = np.random.default_rng(1)
    goals = [[some_pose(rng, 4.0) for _ in range(40)] for _ in range(12)]

    def move(row):
        for pose in goals[row]:
            scene.move(f"part {row}", pose)
            scene.distance((0.0, 0.0, 0.0))

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(move, range(12)))

    for part, poses in zip(scene.parts, goals, strict=True):
        assert np.array_equal(part.pose.matrix, poses[-1].matrix)
    points, others = some_questions(rng, 50)
    assert_answers_alike(scene, anew(scene), points, others)


def test_parts_may_come_go_and_hide_while_threads_ask():
    scene = two_cubes_among_others()
    point = np.array([[0.5, 0.5, 3.0]])
    lid = Solid(*shapes.moved(shapes.cube(), (0.0, 0.0, 2.5)), name="lid")
    is_done = threading.Event()
    scene.add(lid)
    scene.remove("lid")

    def change():
        try:
            for _ in range(10):
                scene.add(lid)
                scene.hide("lid")
                scene.show("lid")
                scene.remove("lid")
        finally:
            is_done.set()

    def ask(_):
        seen = set()
        while not is_done.is_set():
            seen.add(float(scene.signed_distance(point)[0]))
            assert len(scene.parts) in (22, 23)
        return seen

    with ThreadPoolExecutor(3) as pool:
        changer = pool.submit(change)
        answers = list(pool.map(ask, range(2)))
        changer.result()

    assert all(seen <= {2.0, -0.5} for seen in answers)
    assert scene.epoch == 42
