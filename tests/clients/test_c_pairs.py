"""Pairs of parts and tracked parts by the library in C: the answers of Python to the bit."""

import numpy as np
import pytest
import shapes

from benchmarks.digest.library import LibraryPartTracker, through_library
from proximity import ArgumentError, ConnectionFlag, PartTracker, Pose, PoseError, Relation, Scene, Solid
from proximity.core import library_in_c
from proximity.native import IS_AHEAD, mode

pytestmark = pytest.mark.skipif(
    not (IS_AHEAD and any((library_in_c.NATIVE / name).is_file() for name in library_in_c.LIBRARIES)),
    reason="the library is compiled with the kernels",
)
SETS = mode.extension().usable_instructions() if IS_AHEAD else []
START, MS = 10**12, 10**6


def some_parts():
    """Parts of all kinds, some of which are large enough for others to be inside."""
    return Scene(
        [
            Solid(*shapes.torus(0.05, 0.02), name="torus"),
            Solid(*shapes.sphere(0.03, 2), name="sphere"),
            Solid(*shapes.cube(0.4, (0.0, 0.0, 0.0)), name="around"),
            Solid(*shapes.cube(0.01, (0.0, 0.0, 0.0)), name="cube"),
            Solid(*shapes.hollow_cube(0.2, 0.1), name="hollow"),
        ]
    )


def placed(scene, asked, rng, reach=0.1):
    """Move all parts of both scenes alike."""
    names = [part.name for part in scene.parts]
    poses = [Pose(shapes.rotation(rng.integers(100)), rng.normal(size=3) * reach) for _ in names]
    scene.move_many(names, poses)
    asked.move_many(names, [pose.matrix for pose in poses])
    return poses


def bits_of(answer):
    return [np.asarray(each).tobytes() if not isinstance(each, str) else each for each in answer]


@pytest.mark.parametrize("instructions", SETS)
def test_nearest_pairs_are_those_of_python(instructions):
    rng, scene, seen = np.random.default_rng(3), some_parts(), set()
    asked = through_library(scene, instructions)
    for turn in range(12):
        placed(scene, asked, rng, reach=0.2)
        for hidden in ("cube", "torus"):
            for each in (scene, asked):
                each.hide(hidden) if turn % 3 == 0 else each.show(hidden)
        for limits in ({}, {"most": 3}, {"max_distance": 0.05}, {"of": "cube"}, {"of": "torus", "most": 1}):
            found, expected = asked.closest_pairs(**limits), scene.closest_pairs(**limits)
            assert list(map(bits_of, found)) == list(map(bits_of, expected)), limits
            seen.update(pair.relation for pair in found)
    assert seen >= {Relation.APART, Relation.CROSSING, Relation.FIRST_INSIDE, Relation.SECOND_INSIDE}
    assert asked.closest_pairs(most=0) == []


@pytest.mark.parametrize("instructions", SETS)
def test_depths_are_those_of_python(instructions):
    rng, scene, deepest = np.random.default_rng(5), some_parts(), 0.0
    asked = through_library(scene, instructions)
    for _ in range(4):
        placed(scene, asked, rng, reach=0.03)
        for pair in scene.closest_pairs():
            for options in ({}, {"direction": [1.0, 2.0, -0.5]}, {"tolerance": 0.2}):
                found = asked.penetration(*pair[:2], **options)
                expected = scene.penetration(*pair[:2], **options)
                assert bits_of(found) == bits_of(expected), options
                deepest = max(deepest, found.deepest)
    assert deepest > 0.01


def test_pairs_that_cannot_be_asked_are_named():
    asked = through_library(some_parts())
    with pytest.raises(ArgumentError, match="expected"):
        asked.closest_pairs(max_distance=-1.0)
    for names, options in (
        (("cube", "cube"), {}),
        (("cube", "torus"), {"tolerance": -1.0}),
        (("cube", "torus"), {"direction": np.zeros(3)}),
    ):
        with pytest.raises(ArgumentError, match="expected"):
            asked.penetration(*names, **options)


# --- tracked parts ---------------------------------------------------------------------------------------


def motion(rng, count, speed):
    """Poses of a part that drifts and turns among others."""
    place, turn = rng.normal(size=3) * 0.05, shapes.rotation(rng.integers(100))
    for _ in range(count):
        place = np.clip(place + rng.normal(size=3) * speed, -0.15, 0.15)
        angle = rng.normal() * speed
        step = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        turn = step @ turn
        yield Pose(turn, place)


@pytest.mark.parametrize("instructions", SETS)
@pytest.mark.parametrize(
    ("parts", "settings"),
    [
        (["sphere"], {}),
        (["sphere"], {"tolerance": 0.1, "latency": 0.02}),
        (["torus"], {"budget": 40, "working_range": 0.08}),
        (["cube", "sphere", "torus"], {"horizon": 1.0}),
    ],
)
def test_ticks_are_those_of_python(parts, settings, instructions):
    rng, scene, flags = np.random.default_rng(len(parts)), some_parts(), 0
    asked = through_library(scene, instructions)
    placed(scene, asked, rng)
    settings = settings | {"connections": 3}
    tracker, same = PartTracker(scene, parts, **settings), LibraryPartTracker(asked, *parts, **settings)
    rest = [part.name for part in scene.parts if part.name not in parts]
    for tick, pose in enumerate(motion(rng, 250, 0.004)):
        now, given = START + tick * MS, {}
        if tick % 7 == 3:
            given["velocity"] = rng.normal(size=3)
        if tick % 14 == 3:
            given["angular_velocity"] = rng.normal(size=3)
        if tick % 10 == 5:
            name, other = rest[tick % len(rest)], Pose(shapes.rotation(tick), rng.normal(size=3) * 0.1)
            scene.move(name, other)
            asked.move_many([name], [other.matrix])
        if tick % 50 == 20:
            for each in (scene, asked):
                each.hide(rest[0]) if tick % 100 == 20 else each.show(rest[0])
        if tick == 130:
            tracker.reset()
            same.reset()
        is_still = tick % 11 == 6
        expected = tracker.tick(None if is_still else pose, now, now + 300, **({} if is_still else given))
        found = same.tick(None if is_still else pose.matrix, now, now + 300, **({} if is_still else given))
        assert found.tobytes() == expected.tobytes(), tick
        flags |= int(np.bitwise_or.reduce(found["flags"]))
    wanted = ConnectionFlag.INSIDE | ConnectionFlag.CROSSING | ConnectionFlag.PREDICTED
    assert flags & wanted == wanted


def test_tracker_keeps_its_part_when_others_come_and_go_and_its_scene_when_that_is_closed():
    scene = some_parts()
    asked = through_library(scene)
    same = LibraryPartTracker(asked, "cube", connections=4)
    same.tick(np.eye(4), START, START)
    for name in ("torus", "sphere"):
        scene.remove(name)
        asked.remove(name)
    tracker = PartTracker(scene, "cube", connections=4)
    same.reset()
    pose = Pose(shapes.rotation(3), [0.02, 0.01, 0.0])
    asked.close()

    assert same.tick(pose.matrix, START, START).tobytes() == tracker.tick(pose, START, START).tobytes()


def test_posted_poses_of_other_parts_are_applied_by_the_tick():
    asked = through_library(some_parts())
    tracker = LibraryPartTracker(asked, "cube", connections=4)
    before = tracker.tick(np.eye(4), START, START).copy()
    pose = np.eye(4)
    pose[0, 3] = 1.0
    asked.post("hollow", pose, START)
    row = list(before["part"]).index(asked.names.index("hollow"))

    after = tracker.tick(np.eye(4), START + MS, START + MS)

    assert after["distance"].max() > 0.8 and before["distance"][row] < 0.2


def test_arguments_that_cannot_be_used_are_named():
    asked = through_library(some_parts())
    for parts, settings, word in (
        ((), {}, "number"),
        (("cube", "cube"), {}, "differ"),
        (("cube",), {"connections": 17}, "1 to 16"),
        (("cube",), {"working_range": 0.0}, "working_range"),
        (("cube",), {"latency": 2.0}, "latency"),
        (("cube",), {"horizon": 0.0}, "horizon"),
        (("cube",), {"budget": -1}, "budget"),
    ):
        with pytest.raises(ArgumentError, match=word):
            LibraryPartTracker(asked, *parts, **settings)
    tracker = LibraryPartTracker(asked, "cube")
    with pytest.raises(PoseError, match="'cube'"):
        tracker.tick(2.0 * np.eye(4), START, START)
    with pytest.raises(ArgumentError, match="velocities"):
        tracker.tick(None, START, START, velocity=[0.0, 0.0, 0.0])
    with pytest.raises(ArgumentError, match="instant"):
        tracker.tick(None, 2**63 - 1, START)
    asked.remove("cube")
    with pytest.raises(ArgumentError, match="not in the scene"):
        tracker.tick(None, START, START)
