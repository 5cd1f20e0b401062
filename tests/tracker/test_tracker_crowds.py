"""Thousands of fingers take turns: a tick's work is bounded, bounds hold, and nobody waits for ever."""

import numpy as np
import pytest
import shapes
from ticking import MS, RADIUS

from proximity.kernels.tracking.finger_distance import CROWD
from proximity.kernels.tracking.tick import MOST_TOLERANCE, PREDICTION_BUDGETS, steps_for_all
from proximity.kernels.tracking.track import SETTING_ADAPTIVE_TOLERANCE
from proximity.message import ContactFlag
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.tracker.tracker import DEFAULT_BUDGET, Tracker

STEP = 2e-4  # m a tick
SLACK = 20  # steps that tell side and way of a finger beyond its budget


@pytest.fixture(scope="module")
def ball():
    return Scene([Solid(*shapes.sphere(0.1, 4), name="ball")])


def skin(count, *, seed=3):
    """Points outside a ball of 0.1 m, as far as a hand may be."""
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(count, 3))
    return ways / np.linalg.norm(ways, axis=1)[:, None] * rng.uniform(0.11, 0.16, (count, 1))


def has(contacts, flag):
    return (contacts["flags"] & np.uint32(flag)) != 0


def test_two_hands_never_wait(ball):
    tracker, tips = Tracker(ball, fingers=10), skin(10)

    for k in range(50):
        assert has(tracker.tick(tips + k * STEP, k * MS, k * MS), ContactFlag.EXACT).all()


@pytest.mark.parametrize(("count", "budgets"), [(1, 20), (500, 20), (600, 19), (2000, 8), (10**6, 8)])
def test_very_many_fingers_share_fewer_steps(count, budgets):
    assert steps_for_all(400, count) == 400 * budgets


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
    adaptive_tolerance = tracker._settings[SETTING_ADAPTIVE_TOLERANCE]

    assert 0.0 < adaptive_tolerance < MOST_TOLERANCE
    assert np.percentile(share, 99.0) <= 1.5 * adaptive_tolerance
    near, far = contacts["lower"] < 0.02, contacts["lower"] > 0.04
    assert near.sum() > 100 and far.sum() > 100
    assert np.median((contacts["upper"] - contacts["lower"])[near]) < np.median(
        (contacts["upper"] - contacts["lower"])[far]
    )


def test_patience_is_forgotten_with_the_fingers_and_two_hands_never_have_any(ball):
    count = 600
    tracker, tips = Tracker(ball, fingers=count), skin(count)
    for k in range(40):
        contacts = tracker.tick(tips + k * STEP, k * MS, k * MS)
    assert tracker._settings[SETTING_ADAPTIVE_TOLERANCE] > 0.0
    tracker.reset()
    assert tracker._settings[SETTING_ADAPTIVE_TOLERANCE] == 0.0

    few = Tracker(ball, fingers=CROWD)
    for k in range(40):
        contacts = few.tick(tips[:CROWD] + k * STEP, k * MS, k * MS)
        assert has(contacts, ContactFlag.EXACT).all()
    assert few._settings[SETTING_ADAPTIVE_TOLERANCE] == 0.0


def test_bounds_within_the_tolerance_are_carried_on(ball):
    point = np.array([[0.15, 0.0, 0.0]])
    strict, easy = Tracker(ball, fingers=1), Tracker(ball, fingers=1, tolerance=0.05)
    skipped = 0

    for k in range(40):
        point[0, 1] += 1e-4
        exact, told = strict.tick(point, k * MS, k * MS)[0], easy.tick(point, k * MS, k * MS)[0]
        assert told["lower"] <= exact["signed_distance"] + 1e-14
        assert exact["signed_distance"] - 1e-14 <= told["upper"]
        assert told["upper"] - told["lower"] <= 0.05 * told["lower"] + 1e-14
        skipped += bool(told["flags"] & np.uint32(ContactFlag.SKIPPED))

    assert 25 <= skipped < 40


def test_flags_of_a_record_are_understood_as_they_stand(ball):
    contacts = Tracker(ball, fingers=1).tick([[0.15, 0.0, 0.0]], 0, 0)

    assert ContactFlag(contacts["flags"][0]) == (
        ContactFlag.TRACKED | ContactFlag.EXACT | ContactFlag.SIGNED | ContactFlag.IN_RANGE
    )
