"""Thousands of fingers take turns: a tick's work is bounded, bounds hold, and nobody waits for ever."""

import numpy as np
import pytest
import shapes
from ticking import MS, RADIUS, steps_for_all

from proximity.kernels.tracking.tick import MOST_TOLERANCE, PREDICTION_BUDGETS
from proximity.message import ContactFlag
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.tracker.tracker import Tracker
from proximity.tracker.tracker_arguments import DEFAULT_BUDGET

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

    assert 0.0 < adaptive_tolerance < MOST_TOLERANCE
    assert np.percentile(share, 99.0) <= 1.5 * adaptive_tolerance
    near, far = contacts["lower"] < 0.02, contacts["lower"] > 0.04
    assert near.sum() > 100 and far.sum() > 100
    assert np.median((contacts["upper"] - contacts["lower"])[near]) < np.median(
        (contacts["upper"] - contacts["lower"])[far]
    )
