"""Advice for the controller, and sharing of a tick's work by thousands of fingers."""

import numpy as np
import pytest
import shapes
from ticking import MS, RADIUS, line, plate, steps_for_all, tick_path

from proximity.kernels.tracking.tick import MAX_TOLERANCE, PREDICTION_BUDGETS
from proximity.message import ContactFlag, Mode
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.tracker.tracker import Tracker
from proximity.tracker.tracker_arguments import DEFAULT_BUDGET

STIFFNESS, DAMPING = 400.0, 3.0  # N/m, N s/m


def scene_of(*, deformable):
    scene = Scene([plate()])
    if deformable:
        scene.set_surface("plate", stiffness=STIFFNESS, damping=DAMPING)
    return scene


def coming(heights, *, deformable):
    """Return the last record of a finger above the plate's middle, at one height each millisecond."""
    tracker = Tracker(scene_of(deformable=deformable), fingers=1)
    for k, height in enumerate(heights):
        found = tracker.tick(np.array([[0.0, 0.0, height]]), k * MS, k * MS)[0].copy()
    return found


@pytest.mark.parametrize(("deformable", "near"), [(False, Mode.POSITION), (True, Mode.FORCE)])
def test_drum_comes_when_a_contact_is_expected_and_stays_away_otherwise(deformable, near):
    coming_down = coming([0.040, 0.0395, 0.039], deformable=deformable)
    going_up = coming([0.040, 0.0405, 0.041], deformable=deformable)
    touching = coming([RADIUS - 0.001] * 3, deformable=deformable)

    assert coming_down["time_to_contact"] < np.inf
    assert coming_down["mode"] == touching["mode"] == near
    assert going_up["mode"] == Mode.RETRACT


def test_contact_on_the_path_is_a_contact_expected():
    still = tick_path([plate()], line((0, 0, 0.05), (0, 0, -0.05)), (0, 0, 0.05))

    assert 0.0 < still["contact_bend"] < 1.0
    assert still["mode"] == Mode.POSITION


def test_drum_holds_while_the_finger_is_lost():
    tracker = Tracker(scene_of(deformable=False), fingers=2)
    lost, seen = tracker.tick(np.array([[np.nan, 0.0, 0.0], [0.0, 0.0, 0.5]]), 0, 0)

    assert (lost["mode"], seen["mode"]) == (Mode.HOLD, Mode.RETRACT)


def test_deformable_part_answers_with_spring_and_damper():
    depth, speed = 0.002, 0.1  # m, m/s
    heights = [RADIUS - depth + speed * 1e-3 * k for k in (2, 1, 0)]
    pressing, leaving = coming(heights, deformable=True), coming(heights[::-1], deformable=True)

    assert pressing["force_is_valid"] == leaving["force_is_valid"] == 1
    assert pressing["force"] == pytest.approx(STIFFNESS * depth + DAMPING * speed, rel=1e-6)
    # At a receding finger the damper pulls: the wall must not hold it.
    shallow = depth - 2e-3 * speed
    assert leaving["force"] == pytest.approx(STIFFNESS * shallow - DAMPING * speed, rel=1e-6)


def test_part_never_pulls():
    fast = coming([RADIUS - 0.004, RADIUS - 0.002, RADIUS - 0.0001], deformable=True)

    assert fast["signed_distance"] < 0.0
    assert STIFFNESS * -fast["signed_distance"] < DAMPING * -fast["approach_speed"]
    assert (fast["force"], fast["force_is_valid"]) == (0.0, 1)


@pytest.mark.parametrize(("height", "deformable"), [(RADIUS - 0.001, False), (RADIUS + 0.001, True)])
def test_force_means_nothing_on_a_rigid_part_or_off_the_part(height, deformable):
    found = coming([height] * 3, deformable=deformable)

    assert (found["force"], found["force_is_valid"]) == (0.0, 0)


STEP = 2e-4  # m per tick
SLACK = 20  # steps that determine side and path of a finger beyond its budget


@pytest.fixture(scope="module")
def ball():
    return Scene([Solid(*shapes.sphere(0.1, 4), name="ball")])


def skin(count, *, seed=3):
    """Return points outside a ball of 0.1 m, within reach of a hand."""
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(count, 3))
    return ways / np.linalg.norm(ways, axis=1)[:, None] * rng.uniform(0.11, 0.16, (count, 1))


def has(contacts, flag):
    return (contacts["flags"] & np.uint32(flag)) != 0


def test_two_hands_never_wait(ball):
    tracker, tips = Tracker(ball, fingers=10), skin(10)

    for k in range(50):
        assert has(tracker.tick(tips + k * STEP, k * MS, k * MS), ContactFlag.EXACT).all()


def test_a_crowd_takes_turns_within_its_steps_and_within_bounds(ball):
    count = 2000
    tracker, tips = Tracker(ball, fingers=count), skin(count)
    was_sought = np.zeros(count, bool)

    for k in range(48):
        points = tips + k * STEP
        contacts = tracker.tick(points, k * MS, k * MS)
        true = ball.signed_distance(points) - RADIUS
        assert (contacts["lower"] <= true + 1e-14).all()
        assert (true - 1e-14 <= contacts["upper"]).all()
        steps = steps_for_all(DEFAULT_BUDGET, count)
        assert contacts["work"].sum() <= steps + (PREDICTION_BUDGETS + 2) * DEFAULT_BUDGET + SLACK * count
        was_sought |= ~has(contacts, ContactFlag.SKIPPED)
        if k > 2:
            waiting = has(contacts, ContactFlag.SKIPPED)
            assert waiting.any() and not waiting.all()

    assert was_sought.all()


def test_in_a_crowd_bounds_are_as_wide_for_all_for_how_far_they_are(ball):
    count = 2000
    tracker, tips = Tracker(ball, fingers=count), skin(count)
    for k in range(200):
        contacts = tracker.tick(tips + k * 1e-5, k * MS, k * MS)
    share = (contacts["upper"] - contacts["lower"]) / contacts["lower"]
    adaptive_tolerance = tracker._settings["adaptive_tolerance"].item()

    assert 0.0 < adaptive_tolerance < MAX_TOLERANCE
    assert np.percentile(share, 99.0) <= 1.5 * adaptive_tolerance
    near, far = contacts["lower"] < 0.02, contacts["lower"] > 0.04
    assert near.sum() > 100 and far.sum() > 100
    assert np.median((contacts["upper"] - contacts["lower"])[near]) < np.median(
        (contacts["upper"] - contacts["lower"])[far]
    )
