"""Fingers that ignore parts: bounds of the distance to the others, from the next tick on."""

import numpy as np
import pytest
import shapes
from given_meshes import NAMED
from scene_parts import part_of, some_parts, some_pose
from ticking import MS, RADIUS, block, flags_of, near, plate

from proximity.errors import ArgumentError, SceneError
from proximity.kernels.layout import NO_PART
from proximity.message import ContactFlag
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.tracker.tracker import Tracker

START = 1000 * MS
EQUAL_FIELDS = (
    "signed_distance", "lower", "upper", "part", "face", "normal", "point_on_part", "part_velocity",
    "approach_speed", "predicted_lower", "predicted_upper",
)  # fmt: skip
LOOK_AHEAD = 0.25
"""How far a path is certified to be free depends on what the trees tell of it; relative."""


def wall_and_tool():
    """A finger 5 mm from a tool, in front of a wall that is 30 mm away."""
    return Scene([plate("wall"), block("tool", (0.0, 0.0, 0.09))])


def at(height):
    return [[0.0, 0.0, height]]


def test_finger_that_holds_a_part_measures_the_others():
    scene = wall_and_tool()
    tracker = Tracker(scene, fingers=2, radius=RADIUS)
    here = at(0.035) * 2
    assert tracker.tick(here, START, START)["signed_distance"] == near([0.005 - RADIUS] * 2)

    tracker.ignore(0, "tool")
    contacts = tracker.tick(here, START + MS, START + MS)

    assert contacts["signed_distance"] == near([0.035 - RADIUS, 0.005 - RADIUS])
    assert contacts["part"].tolist() == [0, 1]
    assert flags_of(contacts, 0) & ContactFlag.PART_CHANGED
    assert scene.signed_distance(here[0]) == near(0.005)

    tracker.ignore(0, 1, False)
    contacts = tracker.tick(here, START + 2 * MS, START + 2 * MS)
    assert contacts["signed_distance"] == near([0.005 - RADIUS] * 2)


def test_finger_that_ignores_all_parts_is_free():
    tracker = Tracker(wall_and_tool(), fingers=1)
    for part in ("wall", "tool"):
        tracker.ignore(0, part)
    for k in range(3):
        contact = tracker.tick(at(0.035), START + k * MS, START + k * MS)[0]
        assert contact["lower"] == np.inf and contact["part"] == NO_PART


def test_finger_inside_a_part_that_it_ignores_is_outside():
    tracker = Tracker(wall_and_tool(), fingers=1, radius=0.0)
    tracker.ignore(0, "tool")
    contact = tracker.tick(at(0.08), START, START)[0]

    assert contact["signed_distance"] == near(0.08)
    assert not flags_of(contact) & ContactFlag.INSIDE


def test_what_is_ignored_follows_parts_that_come_and_go_and_outlasts_a_reset():
    scene = Scene([block("a", (1.0, 0, 0)), *wall_and_tool().parts])
    tracker = Tracker(scene, fingers=1, radius=0.0)
    tracker.ignore(0, "tool")
    now = START

    def distance():
        nonlocal now
        now += MS
        return tracker.tick(at(0.035), now, now)["signed_distance"][0]

    assert distance() == near(0.035)
    scene.remove("a")  # "tool" gets another number
    assert distance() == near(0.035)
    scene.add(block("b", (1.0, 0, 0)))
    tracker.reset()
    assert distance() == near(0.035)
    scene.move("tool", Pose(translation=(0.0, 0.0, 0.01)))
    scene.hide("tool")
    scene.show("tool")
    assert distance() == near(0.035)
    scene.remove("tool")
    assert distance() == near(0.035)
    scene.add(wall_and_tool().parts[1])  # another one of that name
    assert distance() == near(0.005)


def test_part_may_be_ignored_that_came_after_the_last_tick():
    scene = Scene([plate("wall")])
    tracker = Tracker(scene, fingers=1, radius=0.0)
    tracker.tick(at(0.035), START, START)
    scene.add(block("tool", (0.0, 0.0, 0.09)))

    tracker.ignore(0, "tool")

    assert tracker.tick(at(0.035), START + MS, START + MS)["signed_distance"][0] == near(0.035)


def test_what_is_not_there_cannot_be_ignored():
    tracker = Tracker(wall_and_tool(), fingers=2)
    with pytest.raises(SceneError, match="no part is named 'tol'; did you mean 'tool'"):
        tracker.ignore(0, "tol")
    for finger in (2, -1, True, "0", 0.0):
        with pytest.raises(ArgumentError, match="expected 0 to 1"):
            tracker.ignore(finger, "tool")


def fused():
    """Bodies in one frame, of which the scene's tree has nodes and blocks."""
    bodies = [shapes.moved(shapes.torus(n=16, m=8), (3.0 * (k % 3), 3.0 * (k // 3), 0.0)) for k in range(9)]
    return Scene.from_mesh(*shapes.join(*bodies))


def with_holes():
    """Parts that one gets into through no surface."""
    torn = [NAMED[name] for name in ("open", "touching soup", "Moebius")]
    return Scene([part_of(mesh, f"torn {k}") for k, mesh in enumerate(torn)] + some_parts(4)[1:])


@pytest.mark.parametrize("make", [lambda: Scene(some_parts(9)), fused], ids=["parts", "bodies"])
def test_first_tick_is_that_of_a_scene_in_which_they_are_hidden(make):
    """Predictions too: a part that is ignored is not taken to come either."""
    rng = np.random.default_rng(3)
    for seed in range(40):
        scene, other = make(), make()
        names = [part.name for part in scene.parts]
        for name in rng.permutation(names)[:4].tolist():
            pose, speed = some_pose(rng, 4.0), rng.normal(size=3)
            for each in (scene, other):
                each.move(name, pose, velocity=speed, angular_velocity=0.1 * speed)
        hidden = rng.permutation(names)[: rng.integers(len(names))].tolist()
        trackers = [Tracker(each, fingers=6, working_range=10.0, max_speed=100.0) for each in (scene, other)]
        for name in hidden:
            other.hide(name)
            for finger in range(0, 6, 2):
                trackers[0].ignore(finger, name)
        where, velocities = rng.uniform(-4.0, 6.0, (6, 3)), rng.normal(size=(6, 3))
        found, expected = (each.tick(where, START, START, velocities=velocities) for each in trackers)
        for name in EQUAL_FIELDS:
            assert found[name][::2].tobytes() == expected[name][::2].tobytes(), (seed, name)
        whole = Tracker(scene, fingers=6, working_range=10.0, max_speed=100.0)
        expected = whole.tick(where, START, START, velocities=velocities)
        for name in EQUAL_FIELDS:
            assert found[name][1::2].tobytes() == expected[name][1::2].tobytes(), (seed, name)
        for later in (START + k * MS for k in range(1, 5)):  # a path is followed over several ticks
            found, expected = (each.tick(where, later, later, velocities=velocities) for each in trackers)
        free = [each["time_to_contact_lower"][::2] for each in (found, expected)]
        assert np.allclose(*free, rtol=LOOK_AHEAD), seed


@pytest.mark.parametrize(
    ("make", "how"),
    [
        (lambda: Scene(some_parts(12)), {}),
        (lambda: Scene(some_parts(5)), {"budget": 10, "working_range": 2.0}),
        (lambda: Scene(some_parts(12)), {"tolerance": 0.2, "working_range": 0.3}),
        (fused, {}),
        (with_holes, {}),
    ],
    ids=["parts", "budget", "tolerance", "bodies", "holes"],
)
def test_bounds_hold_while_fingers_ignore_and_heed_parts_at_random(make, how):
    """Over ten thousand ticks of fingers, against the distance to the parts that each heeds."""
    rng = np.random.default_rng(4)
    scene = make()
    fingers, ignored = 10, [set() for _ in range(10)]
    tracker = Tracker(scene, fingers=fingers, **{"radius": 0.01, "working_range": 10.0} | how)
    where, spare = rng.uniform(-3.0, 3.0, (fingers, 3)), some_parts(30, seed=8)[15:]
    exact = 0
    for k in range(250):
        names = [part.name for part in scene.parts]
        for _ in range(rng.integers(4)):
            finger, name = int(rng.integers(fingers)), str(rng.choice(names))
            is_ignored = bool(rng.integers(2))
            tracker.ignore(finger, name, is_ignored)
            (ignored[finger].add if is_ignored else ignored[finger].discard)(name)
        name, what = str(rng.choice(names)), int(rng.integers(30))
        if what < 6:
            scene.move(
                name, some_pose(rng, 3.0) if what < 3 else scene[name].pose, velocity=rng.normal(size=3)
            )
        elif what == 6:
            scene.show(name) if scene[name].is_hidden else scene.hide(name)
        elif what == 7 and len(names) > 3:
            scene.remove(name)
            for known in ignored:
                known.discard(name)
        elif what == 8 and spare:
            scene.add(spare.pop())
        where += rng.normal(size=(fingers, 3)) * rng.choice([1e-4, 1e-2, 0.5], p=[0.6, 0.3, 0.1])
        now = START + k * MS
        contacts = tracker.tick(where, now, now)
        names = [part.name for part in scene.parts]
        for finger, contact in enumerate(contacts):
            true = scene.signed_distance(where[finger], ignore=ignored[finger]) - 0.01
            slack = 1e-12 * 10.0
            assert contact["lower"] - slack <= true <= contact["upper"] + slack, (k, finger)
            assert contact["part"] == NO_PART or names[contact["part"]] not in ignored[finger]
            if flags_of(contact) & ContactFlag.EXACT:
                exact += 1
                assert contact["signed_distance"] == true or abs(contact["signed_distance"] - true) <= slack
    assert exact > (200 if how else 1000)
