"""What the controller is advised to do with the drum, and the force of a deformable part."""

import numpy as np
import pytest
from ticking import MS, RADIUS, line, plate, tick_path

from proximity.message import Mode
from proximity.scene.scene import Scene
from proximity.tracker.tracker import Tracker

STIFFNESS, DAMPING = 400.0, 3.0  # N/m, N s/m


def scene_of(*, deformable):
    scene = Scene([plate()])
    if deformable:
        scene.set_surface("plate", stiffness=STIFFNESS, damping=DAMPING)
    return scene


def coming(heights, *, deformable):
    """The record of a finger above the middle of the plate, a tick each millisecond."""
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
    # Where the finger leaves, the damper pulls: the wall does not hold it.
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
