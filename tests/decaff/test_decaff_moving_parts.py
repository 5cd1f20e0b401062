"""A part that moves under a resting finger: the drum follows without jumps."""

import math

import numpy as np
import pytest
from moving_parts import RATE, SITUATIONS, STIFFNESS, WALL, Situation, ramp, shown

from proximity.decaff.controller.settings import Limits
from proximity.decaff.drum.drum_model import USUAL_GEAR
from proximity.decaff.glove.glove import DRUMS
from proximity.message import Surface

LIMITS = Limits()
NEAR_SPEED = math.sqrt(2.0 * LIMITS.near_energy / DRUMS[USUAL_GEAR].mass)  # of 1 mJ
STANDING = 120.0 * 4e-3
"""N: hand and pad in series, 4 mm into a part at rest."""


def moving(rows):
    return rows[rows.time > 0.5]


def speed_of(rows):
    """Speed of the drum, m/s, over 5 ms; includes the quantization of its encoder."""
    return np.abs(rows.drum[15:] - rows.drum[:-15]) * RATE / 15.0


@pytest.mark.parametrize("name", SITUATIONS)
def test_drum_goes_with_the_part_that_is_touched(name):
    """Regression: it did not move while the part came 20 mm nearer, and followed a receding one in steps."""
    rows = moving(shown(SITUATIONS[name]))
    part_speed = np.abs(np.diff(rows.part)).max() * RATE

    assert np.abs(rows.drum - rows.part).max() < 0.12e-3 + part_speed * 4e-3  # 3 ms of latency, and a tick
    assert np.abs(rows.drum - rows.part)[-300:].max() < 0.03e-3 + part_speed * 4e-3
    assert speed_of(rows).max() < 1.25 * NEAR_SPEED  # while it catches up
    expected = STANDING + 120.0 * np.maximum(WALL - rows.part, 0.0)  # the hand is at rest, the part moves
    assert np.abs(rows.force - expected).max() < 0.1 + 2.0 * part_speed  # skin and mass of the finger


def test_part_that_stopped_is_where_it_stopped():
    rows = shown(SITUATIONS["comes"], 2.0)

    assert rows.part[-1] == pytest.approx(WALL - 0.020)
    assert rows.drum[-600:] == pytest.approx(rows.part[-1], abs=30e-6)


def test_soft_part_that_comes_presses_by_its_law():
    rows = shown(SITUATIONS["comes"], 2.0, surface=Surface.DEFORMABLE)

    series = 1.0 / (1.0 / 300.0 + 1.0 / 200.0 + 1.0 / 400.0)  # hand, pad and part
    assert rows.force[-1] == pytest.approx(series * 0.024, rel=0.05)
    assert np.abs(np.diff(rows.force)).max() < 0.1


def test_hand_that_holds_against_the_part_meets_the_force_limit_and_no_jump_when_it_gives():
    """The part presses 20 mm into a nearly fixed hand; then the hand yields."""
    limits = Limits(continuous_force=2.0, peak_force=3.0)
    rows = moving(
        shown(
            SITUATIONS["comes"], 2.5, limits=limits, hand=lambda time: 20_000.0 if time < 2.0 else STIFFNESS
        )
    )
    held, given = rows[rows.time < 2.0], rows[rows.time >= 2.0]

    assert held.force.max() <= limits.peak_force + 0.2  # friction of the gear
    assert held.force[-1] == pytest.approx(limits.continuous_force, abs=0.25)
    fastest = np.abs(given.finger[15:] - given.finger[:-15]).max() * RATE / 15.0
    assert speed_of(given).max() < max(NEAR_SPEED, fastest) + 0.05
    assert given.force.max() <= limits.peak_force
    friction = DRUMS[USUAL_GEAR].friction  # N, of the gear: the force at rest may differ by this
    assert given.force[-1] == pytest.approx(limits.continuous_force, abs=friction)  # below the hand's 2.9 N


def test_part_that_is_faster_than_drum_and_finger_may_meet_is_caught_up_with():
    rows = moving(shown(Situation("fast", ramp(-0.020, 0.300)), 1.5))

    assert speed_of(rows).max() < NEAR_SPEED + 0.06  # the finger is pushed ahead of the part
    assert rows.drum[-300:] == pytest.approx(rows.part[-1], abs=0.1e-3)
