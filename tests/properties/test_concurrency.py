"""Concurrent queries by threads, queries in a forked process, and memory for a million points."""

import multiprocessing
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import judging
import numpy as np
import psutil
import pytest
import shapes

from proximity.pose import Pose
from proximity.scene.queries import queries
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid

SCENE = Scene(
    [Solid(*shapes.moved(shapes.torus(), (3.0 * row, 0.0, 0.0)), name=f"ring {row}") for row in range(12)]
)
MILLION = 1_000_000


def some_points(count, seed):
    return np.random.default_rng(seed).uniform((-4.0, -4.0, -2.0), (40.0, 4.0, 2.0), (count, 3))


def test_threads_that_ask_one_scene_at_once_get_the_same_answers():
    questions = [some_points(3000, seed) for seed in range(8)]
    alone = [SCENE.closest(points) for points in questions]
    start = threading.Barrier(len(questions))

    def ask(points):
        start.wait()
        return [SCENE.closest(points, workers=workers) for workers in (1, 2, 1)]

    with ThreadPoolExecutor(len(questions)) as pool:
        answers = list(pool.map(ask, questions))

    for expected, found in zip(alone, answers, strict=True):
        assert all(judging.same_bits(each, expected) for each in found)


def test_threads_may_ask_right_after_a_move():
    """The first queries update the scene's dynamic tree; all of them must use the part's new pose."""
    points = some_points(200, 3)
    solids = [part.solid for part in SCENE.parts]
    for turn in range(5):
        scene, moved = Scene(solids), Scene(solids)
        pose = Pose(translation=(0.0, 1.0 + turn, 0.0))
        moved.move("ring 5", pose)
        expected = moved.closest(points)
        scene.move("ring 5", pose)
        start = threading.Barrier(6)

        def ask(_, scene=scene, start=start):
            start.wait()
            return scene.closest(points)

        with ThreadPoolExecutor(6) as pool:
            assert all(judging.same_bits(found, expected) for found in pool.map(ask, range(6)))


@pytest.mark.parametrize(
    "ask",
    ["closest", "signed_distance", "distance", "contains", "cast", "cast_distance", "closest_to_segments"],
)
def test_a_question_is_answered_as_of_one_moment_though_parts_move_meanwhile(monkeypatch, ask):
    """Unreferenced copies are overwritten when parts move: a query must keep a reference to its data."""
    scene = Scene([part.solid for part in SCENE.parts])
    points, turn = some_points(40, 5), np.arange(9.0)
    points[:9] = np.column_stack(
        (15.0 + np.cos(turn), 0.3 + np.sin(turn), np.full(9, 0.1))
    )  # in ring 5, mostly
    count = 2 if ask in ("cast", "cast_distance", "closest_to_segments") else 1
    arguments = [points, points[::-1].copy()][:count]
    for step in range(4):
        scene.move("ring 5", Pose(translation=(0.0, 0.1 * step, 0.0)))
        expected = getattr(scene, ask)(*arguments)
    query = getattr(queries, f"_{ask}")

    def meanwhile(*given):
        for step in range(10):
            for row in range(12):
                scene.move(f"ring {row}", Pose(translation=(0.0, 1.0 + step, 0.3)))
            scene.snapshot()
        return query(*given)

    with monkeypatch.context() as patch:
        patch.setattr(queries, f"_{ask}", meanwhile)
        found = getattr(scene, ask)(*arguments)

    assert judging.same_bits(found, expected)


def test_two_threads_may_ask_a_solid_for_the_first_time_since_its_part_was_deformed():
    points = some_points(20, 6)
    scene = Scene([Solid(*shapes.torus(n=60, m=40), name="torus"), Solid(*shapes.cube(), name="other")])
    for _ in range(5):
        solid = scene.part("torus").solid
        expected = solid.distance(points)
        scene.deform("torus", 1.1 * solid.mesh.vertices)
        start, found = threading.Barrier(4), []

        def ask(solid=solid, start=start, found=found):
            start.wait()
            found.append(solid.distance(points))

        threads = [threading.Thread(target=ask) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert all(np.array_equal(each, expected) for each in found) and len(found) == 4


def test_the_interpreter_goes_on_while_a_thread_asks():
    """Queries release the GIL: a counter runs concurrently with a long query."""
    points = some_points(MILLION, 4)
    asking = threading.Thread(target=SCENE.signed_distance, args=(points,))
    turns, longest = 0, 0.0

    asking.start()
    while asking.is_alive():
        before = time.perf_counter()
        time.sleep(0.001)
        longest = max(longest, time.perf_counter() - before)
        turns += 1
    asking.join()

    assert turns >= 10
    assert longest < 0.5


FORK = """
import multiprocessing, sys, threading, time
import numpy as np
import shapes
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid

solid = Solid(*shapes.torus())
scene = Scene([solid, Solid(*shapes.cube(), name="cube")])
points = np.random.default_rng(1).uniform(-3.0, 3.0, (5000, 3))
before = scene.signed_distance(points, workers=2)
resting = threading.Event()


def move():
    # Something else, all the time, so that a fork may come at any step of that.
    cubes = [shapes.moved(shapes.cube(), (2.0 * row, 0, 0)) for row in range(40)]
    moved = Scene([Solid(*cube, name=str(row)) for row, cube in enumerate(cubes)])
    pose = np.eye(4)
    while not resting.is_set():
        pose[0, 3] += 1e-3
        moved.move("3", pose)
        moved.distance(points[:5])
        if not others:  # and not before everything is compiled: the compiler has a lock, too
            others.append(moved)


def ask(answers):
    found = [scene.signed_distance(points, workers=workers) for workers in (1, 2, -1)]
    others[0].move("4", np.eye(4))
    others[0].distance(points[:5])
    answers.put(all(np.array_equal(each, before) for each in found))


others = []
mover = threading.Thread(target=move, daemon=True)
mover.start()
while not others:
    time.sleep(0.01)

context = multiprocessing.get_context("fork")
answers = context.Queue()
children = [context.Process(target=ask, args=(answers,)) for _ in range(24)]
for child in children:
    child.start()
right = [answers.get(timeout=60) for _ in children]
for child in children:
    child.join(timeout=60)
resting.set()
after = scene.signed_distance(points, workers=2)
print(right == 24 * [True], [child.exitcode for child in children], np.array_equal(before, after))
"""


@pytest.mark.skipif(
    "fork" not in multiprocessing.get_all_start_methods(), reason="processes are not forked here"
)
def test_forked_processes_go_on_asking():
    """In a separate process, since a fork copies the threads' locks, but not the threads."""
    assert _output_of(FORK) == f"True {24 * [0]} True\n"


def _output_of(program):
    """Run a program in a separate process without output on stderr; return its output."""
    result = subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", "-c", program],
        capture_output=True,
        text=True,
        timeout=120,
        env=_environment(),
    )
    assert result.stderr == ""
    return result.stdout


def _environment():
    return os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}


def peak_growth(ask):
    """Peak growth of the process during a call, in bytes."""
    process = psutil.Process()
    before = process.memory_info().rss
    peak, is_done = [before], threading.Event()

    def watch():
        while not is_done.wait(0.002):
            peak.append(process.memory_info().rss)

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        answer = ask()
        peak.append(process.memory_info().rss)
    finally:
        is_done.set()
        watcher.join()
    del answer
    return max(peak) - before


@pytest.mark.parametrize("workers", [2])
@pytest.mark.parametrize(
    "query, bytes_a_point",
    # The result, 24 bytes for the order of traversal, and a quarter more for temporary data.
    [("signed_distance", 8 + 24), ("closest", 96 + 24)],
)
def test_memory_for_a_million_points_is_bounded(query, bytes_a_point, workers):
    points = some_points(MILLION, 5)
    ask = getattr(SCENE, query)
    ask(points[:5000], workers=workers)

    grown = peak_growth(lambda: ask(points, workers=workers))

    assert grown <= 1.25 * bytes_a_point * MILLION + 4_000_000


def test_asking_again_and_again_keeps_nothing():
    points = some_points(1000, 6)
    process = psutil.Process()
    for _ in range(50):
        SCENE.closest(points)
        SCENE.closest(points[0])
    before = process.memory_info().rss

    for _ in range(500):
        SCENE.closest(points)
        SCENE.closest(points[0])

    assert process.memory_info().rss - before <= 2_000_000


INTERRUPTED_FORK = """
import os, signal, sys, threading, time
import numpy as np
import shapes
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid

scene = Scene([Solid(*shapes.cube(), name="cube"), Solid(*shapes.moved(shapes.cube(), (3, 0, 0)), name="b")])
scene.distance((0, 0, 2.0))
is_held, told = threading.Event(), []


def hold():
    with scene._lock:
        is_held.set()
        time.sleep(0.5)


def handle(number, frame):
    # Makes a scene, and so a lock, while others are waited for; and raises, as Ctrl-C does.
    told.append(Scene([Solid(*shapes.cube())]).distance((0, 0, 2.0)))
    raise KeyboardInterrupt


signal.signal(signal.SIGINT, handle)
threading.Thread(target=hold).start()
is_held.wait()
threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
was_interrupted = False
try:
    child = os.fork()
    if child == 0:
        signal.alarm(30)
        scene.move("b", np.eye(4))
        os._exit(0 if scene.distance((0, 0, 2.0)) == 1.0 else 1)
    time.sleep(0.2)
except KeyboardInterrupt:
    was_interrupted = True
print(was_interrupted, told[0], os.waitpid(child, 0)[1], scene.distance((0, 0, 2.0)))
"""


@pytest.mark.skipif(
    "fork" not in multiprocessing.get_all_start_methods(), reason="processes are not forked here"
)
def test_fork_that_is_interrupted_while_it_waits_is_safe_and_the_interruption_comes_after():
    assert _output_of(INTERRUPTED_FORK) == "True 1.0 0 1.0\n"
