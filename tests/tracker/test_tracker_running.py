"""A running tracker: no allocation, no lock, reproducible bytes, concurrent threads."""

import threading
import time

import numpy as np
import pytest
import shapes
from growing import traced_growth
from ticking import MS, RADIUS, block, line, plate, solid

import proximity
from proximity.kernels.layout import REGION_COPIES
from proximity.message import ContactFlag
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.tracker.tracker import Tracker


def some_scene():
    return Scene([solid(shapes.sphere(0.06, 3), "ball"), plate(top=-0.1), block("block", (0.2, 0, 0))])


def some_way(count, seed=1):
    """Return positions of five fingers that oscillate among the parts, (count, 5, 3)."""
    rng = np.random.default_rng(seed)
    phase, rate = rng.uniform(0, 2 * np.pi, (2, 5, 3))
    steps = np.arange(count)[:, None, None]
    return 0.15 * np.sin(phase + 0.004 * rate * steps) + (0.05, 0, 0.1)


def run(tracker, way):
    return [tracker.tick(tips, k * MS, k * MS + MS // 2).tobytes() for k, tips in enumerate(way)]


def test_the_array_is_the_same_each_time_and_nothing_grows():
    tracker, tips = Tracker(some_scene()), some_way(1000)
    paths = np.stack([line(tip, (0, 0, 0), 20) for tip in tips[0]])
    velocities, bends = np.zeros((5, 3)), np.zeros(5)
    first = tracker.tick(tips[0], 0, 0, velocities=velocities, paths=paths, bends=bends)
    for k in range(20):
        tracker.tick(tips[k], k * MS, k * MS, paths=paths)

    def thousand_ticks():
        for k in range(1000):
            assert tracker.tick(tips[k], k * MS, k * MS) is first
            tracker.tick(tips[k], k * MS, k * MS, velocities=velocities, paths=paths, bends=bends)

    assert traced_growth(thousand_ticks) < 2000
    assert first is tracker.contacts


def test_the_same_way_gives_the_same_bytes():
    way = some_way(300)

    assert run(Tracker(some_scene()), way) == run(Tracker(some_scene()), way)


def test_exact_answers_do_not_depend_on_what_was_before():
    scene, way = some_scene(), some_way(400)
    warm, exact = Tracker(scene), 0
    for k, tips in enumerate(way):
        found = warm.tick(tips, k * MS, k * MS)
        fresh = Tracker(scene).tick(tips, k * MS, k * MS)
        both = (found["flags"] & fresh["flags"] & ContactFlag.EXACT) != 0
        exact += int(both.sum())
        for name in ("signed_distance", "lower", "upper", "point_on_part", "normal", "part"):
            assert np.array_equal(found[name][both], fresh[name][both]), name

    assert exact > 1000


def test_fingers_do_not_depend_on_each_other():
    scene, way = some_scene(), some_way(200)
    together, alone = Tracker(scene), [Tracker(scene, fingers=1) for _ in range(5)]
    for k, tips in enumerate(way):
        found = together.tick(tips, k * MS, k * MS)
        for finger, tracker in enumerate(alone):
            single = tracker.tick(tips[finger : finger + 1], k * MS, k * MS)
            for name in found.dtype.names[1:]:
                assert single[name].tobytes() == found[name][finger : finger + 1].tobytes(), name


def test_two_trackers_on_one_scene_that_moves_do_not_disturb_each_other():
    """Each notices moved parts, also the one with fewer ticks."""
    scene, way = some_scene(), some_way(200)
    often, seldom = Tracker(scene), Tracker(scene, working_range=0.01)
    for k, tips in enumerate(way):
        scene.move("ball", Pose(translation=(0, 0, 0.1 * np.sin(0.05 * k))), velocity=(0, 0, 0.1))
        true = scene.signed_distance(tips) - RADIUS
        trackers = (often, seldom) if k % 7 == 0 else (often,)
        for tracker in trackers:
            found = tracker.tick(tips, k * MS, k * MS)
            assert (found["lower"] <= true + 1e-13).all() and (true <= found["upper"] + 1e-13).all()


def test_face_told_stays_though_another_scene_has_deformed_a_solid_that_both_share():
    """The first scene rebuilds that solid when it moves to new memory, with its faces in another order."""
    scene = Scene(
        [solid(shapes.sphere(0.5, 3), "ball"), block("block", (3, 0, 0)), block("mover", (9, 0, 0))]
    )
    vertices = scene.part("ball").solid.mesh.vertices
    scene.deform("ball", vertices * (4.0, 0.5, 1.0))
    far = np.array([[0.1, 0.2, 0.9], [3.0, 0.02, 0.5]])
    tracker = Tracker(scene, fingers=2, working_range=0.01)
    before = tracker.tick(far, 0, 0).copy()

    Scene([scene.part("ball").solid]).deform("ball", vertices)
    held = []
    for step in range(REGION_COPIES + 1):
        scene.move("mover", Pose(translation=(0, 0, 1e-3 * step)))
        held.append(scene.snapshot())
    after = tracker.tick(far, MS, MS)

    assert held[-1].words is not held[0].words
    assert [scene.parts[part].name for part in after["part"]] == ["ball", "block"]
    assert after["face"].tolist() == before["face"].tolist()
    assert np.abs(after["point_on_part"] - before["point_on_part"]).max() < 1e-12


def test_a_loaded_compiled_scene_is_tracked_as_the_one_that_was_saved(tmp_path):
    scene, way = some_scene(), some_way(100)
    scene.move("ball", Pose(shapes.rotation(2), (0.01, 0, 0)), velocity=(0.1, 0, 0))
    scene.set_surface("ball", stiffness=300.0)
    scene.save(tmp_path / "cell.prox")
    loaded = proximity.load(tmp_path / "cell.prox")
    assert run(Tracker(loaded), way) == run(Tracker(scene), way)

    for each in (scene, loaded):
        each.move("ball", Pose(translation=(0.02, 0, 0)))
    assert run(Tracker(loaded), way) == run(Tracker(scene), way)


def test_other_threads_run_while_a_tick_takes_long():
    """At the centre of a fine ball 2000 fingers use their full budget, which takes a while."""
    scene = Scene([solid(shapes.sphere(0.1, 5), "ball")])
    tracker = Tracker(scene, fingers=2000, budget=10**6)
    points = np.random.default_rng(3).normal(size=(2000, 3)) * 1e-4
    tracker.tick(points, 0, 0)
    counted, is_done = [0], threading.Event()

    def count():
        while not is_done.is_set():
            counted[0] += 1
            time.sleep(0)

    thread = threading.Thread(target=count)
    thread.start()
    try:
        before = counted[0]
        tracker.tick(points, MS, MS)
        during = counted[0] - before
    finally:
        is_done.set()
        thread.join()

    assert during > 10


def test_parts_may_be_moved_by_another_thread_while_fingers_tick():
    """The ball is at one of two positions: each answer is between the two."""
    scene = Scene([solid(shapes.sphere(0.05, 3), "ball"), plate(top=-0.5)])
    tips = np.array([(0.0, 0.0, 0.2), (0.0, 0.1, 0.0)])
    poses = [Pose(translation=(0, 0, height)) for height in (0.0, 0.06)]
    expected = []
    for pose in poses:
        scene.move("ball", pose)
        expected.append(scene.signed_distance(tips) - RADIUS)
    low, high = np.min(expected, axis=0), np.max(expected, axis=0)
    is_done, moves = threading.Event(), [0]

    def move():
        while not is_done.is_set():
            scene.move("ball", poses[moves[0] % 2], velocity=(0, 0, 0.1 * (moves[0] % 3)))
            moves[0] += 1

    thread = threading.Thread(target=move)
    thread.start()
    tracker = Tracker(scene, fingers=2)
    try:
        for k in range(3000):
            found = tracker.tick(tips, k * MS, k * MS)
            is_one = [
                np.abs(found["signed_distance"] - each).max() < 1e-12
                for each in expected
                if (found["flags"] & ContactFlag.EXACT).all()
            ]
            assert any(is_one) or not (found["flags"] & ContactFlag.EXACT).all()
            assert (found["lower"] <= high + 1e-12).all() and (found["upper"] >= low - 1e-12).all()
    finally:
        is_done.set()
        thread.join()

    assert moves[0] > 10


def assert_counted(scene, tracker, tip, name, ticks):
    """Check the bounds while a part approaches from afar."""
    for k in ticks:
        scene.move(name, Pose(translation=(0.0, 0.0, -0.5 * (k - ticks[0]))))
        found = tracker.tick(tip, k * MS, k * MS)[0]
        true = float(scene.signed_distance(tip[0])) - RADIUS
        assert found["lower"] <= true + 1e-12 and true - 1e-12 <= found["upper"], k


def interrupt(monkeypatch, owner, name):
    """Make a method raise KeyboardInterrupt once."""
    with monkeypatch.context() as patch:

        def raising(*_):
            raise KeyboardInterrupt

        patch.setattr(owner, name, raising)
        yield


@pytest.mark.parametrize("name", ["_renumber_parts", "_pack"])
def test_parts_are_counted_though_taking_them_over_was_interrupted(monkeypatch, name):
    scene = Scene([block("near", (0.0, 0.0, -0.06))])
    tracker, tip = Tracker(scene, fingers=1), np.array([[0.0, 0.0, 2.0]])
    tracker.tick(tip, 0, 0)
    for row in range(40):
        scene.add(block(f"far {row}", (0.3 * row, 3.0, 4.0)))
    scene.add(block("comes", (0.0, 0.0, 4.0)))
    for _ in interrupt(monkeypatch, Tracker, name):
        with pytest.raises(KeyboardInterrupt):
            tracker.tick(tip, MS, MS)

    assert_counted(scene, tracker, tip, "comes", range(2, 6))


def test_velocities_of_a_refused_tick_do_not_stay():
    scene, tips = Scene([plate()]), np.array([(0.0, 0.0, 0.05)])
    tracker = Tracker(scene, fingers=1)
    tracker.tick(tips, 0, 0, velocities=[(0.0, 0.0, -1.0)])
    with pytest.raises(proximity.ArgumentError):
        tracker.tick(tips, MS, MS, velocities="fast")
    found = tracker.tick(tips, 2 * MS, 2 * MS)[0]

    assert not found["velocity"].any()


def test_parts_may_come_and_go_in_another_thread_while_fingers_tick():
    scene = Scene([block("near", (0.0, 0.0, -0.06)), block("first", (0.5, 0.0, 0.0))])
    tips, is_done = np.array([(0.0, 0.0, 0.05), (0.0, 0.02, 0.06)]), threading.Event()
    expected = scene.signed_distance(tips) - RADIUS
    names = [f"part {row}" for row in range(6)]

    def change():
        while not is_done.is_set():
            for name in names:
                scene.add(block(name, (0.4, 0.4, 0.4)))
            scene.remove("first")
            for name in names:
                scene.remove(name)
            scene.add(block("first", (0.5, 0.0, 0.0)))

    thread = threading.Thread(target=change)
    thread.start()
    tracker = Tracker(scene, fingers=2)
    try:
        for k in range(2000):
            found = tracker.tick(tips, k * MS, k * MS)
            np.testing.assert_allclose(found["signed_distance"], expected, rtol=0.0, atol=1e-12)
            assert not (found["flags"] & ContactFlag.PART_CHANGED).any()
    finally:
        is_done.set()
        thread.join()
