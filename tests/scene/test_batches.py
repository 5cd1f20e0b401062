"""Sliced batches, and scenes queried and moved by several threads."""

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import shapes
from changing import seen_while
from project import SUPPORT
from scene_parts import anew, assert_answers_alike, some_parts, some_pose, some_questions

from proximity.checks import COPIED_AT_ONCE, as_points
from proximity.pose import Pose
from proximity.scene.queries import checked_query
from proximity.scene.queries.checked_query import run_batch
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid


def backwards(rows, *_):
    return np.arange(len(rows))[::-1].copy()


@pytest.mark.parametrize("order_of", [None, backwards], ids=["as they come", "sorted"])
@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize("count", [0, 47, 5000, 2 * 700 + 1])
def test_every_row_is_asked_once(monkeypatch, count, workers, order_of):
    monkeypatch.setattr(checked_query, "BLOCK", 700)
    rows, one, counts = np.arange(float(count)), np.array([7.0]), np.zeros(count, int)

    def ask(order, some, limit, tally):
        assert limit is one
        tally[order if len(order) else slice(None)] += 1
        return some[0] if len(some) else -1.0

    found = run_batch(ask, [rows, one, counts], workers, order_of, 16)

    assert (counts == 1).all()
    assert all(first == answer for first, answer in found if count)


def test_long_arrays_are_converted_in_parts():
    values = np.arange(3 * COPIED_AT_ONCE + 9, dtype=np.float32).reshape(-1, 3)[: COPIED_AT_ONCE + 1]

    points = as_points(values)

    assert points.dtype == np.float64
    assert points.flags.carray
    assert np.array_equal(points, values)


INTERRUPTED = """
import json, os, signal, threading, time
import numpy as np, shapes
from proximity.scene.scene import Scene

scene = Scene.from_mesh(*shapes.sphere(subdivisions=6))
few = 1e-9 * np.random.default_rng(0).normal(size=(48, 3))  # where a search looks at every face
asks = {
    "closest": lambda points, workers=1: scene.closest(points, workers=workers),
    "signed_distance": lambda points, workers=1: scene.signed_distance(points, workers=workers),
    "closest_to_segments": lambda points, workers=1: scene.closest_to_segments(points, points + 1e-9),
}
report = {}
for name, workers in (("closest", 1), ("closest", 2), ("signed_distance", 1), ("closest_to_segments", 1)):
    ask = asks[name]
    ask(few), ask(np.repeat(few, 50, axis=0)[:100], workers=workers)  # kernels are there from then on
    begun = time.perf_counter()
    before = ask(few)
    each = (time.perf_counter() - begun) / len(few)
    whole = 10.0  # s
    points = np.resize(few, (max(2048, int(whole / each)), 3))
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    begun = time.perf_counter()
    try:
        timer.start()
        ask(points, workers=workers)
        is_interrupted = False
    except KeyboardInterrupt:
        is_interrupted = True
    seconds = time.perf_counter() - begun
    timer.join()
    after = ask(few)
    tables = [getattr(answer, "_table", answer) for answer in (before, after)]
    is_same = np.array_equal(*tables, equal_nan=True)
    others = len(threading.enumerate()) - 1
    report[f"{name}, {workers}"] = is_interrupted, seconds, is_same, others
print(json.dumps(report))
"""


@pytest.mark.processes
def test_batch_of_slow_rows_is_interrupted_long_before_its_end():
    """The batch would take ten seconds; afterwards the scene still works, and no thread is left."""
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], cwd=SUPPORT, capture_output=True, text=True, timeout=100
    )

    assert done.returncode == 0, done.stderr
    for name, (is_interrupted, seconds, is_same, others) in json.loads(done.stdout).items():
        assert is_interrupted, name
        assert seconds < 4.0, name
        assert is_same, name
        assert others == 0, name


STEPS = 400


def two_cubes_among_others():
    """Cubes "left" and "right", one above the other while they move; the other parts are far away."""
    parts = [Solid(*shapes.cube(), name="left"), Solid(*shapes.cube(), name="right")]
    return Scene(
        parts
        + [Solid(*shapes.moved(shapes.torus(), (0.0, 100.0 + 3.0 * k, 0.0)), name=f"{k}") for k in range(20)]
    )


@pytest.mark.parametrize("point_count", [6, 600])
def test_answers_while_parts_move_are_those_of_one_moment(point_count):
    """Both cubes move together, so that a point between them stays equally far from both."""
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

    def move():
        for k in range(STEPS):
            scene.move_many(["left", "right"], poses[k], [[-1.0, k, 0], [1.0, k, 0]])

    def ask():
        found = scene.distance(points)
        assert (found == found[0]).all(), "one answer is of one moment"
        velocities = scene.snapshot().frames["velocity"]
        assert velocities[0, 1] == velocities[1, 1], "both velocities are of one move"
        return found[0]

    for seen in seen_while(move, ask, 3):
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
    scene.add(lid)
    scene.remove("lid")

    def change():
        for _ in range(10):
            scene.add(lid)
            scene.hide("lid")
            scene.show("lid")
            scene.remove("lid")

    def ask():
        assert len(scene.parts) in (22, 23)
        return float(scene.signed_distance(point)[0])

    assert all(set(seen) <= {2.0, -0.5} for seen in seen_while(change, ask))
    assert scene.epoch == 42
