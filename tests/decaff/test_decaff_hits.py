"""Impacts of the controller in C on fingers, with play, friction, stop, brake and voltage in the plant.

``python bench/drum_hits.py`` simulates 10 000 presses.
"""

import math

import numpy as np
import pytest
from drum_in_plant import POWERED, UNPOWERED, built, hazards, hits, said

from proximity.decaff.drum.drum_model import GEARS, Motor
from proximity.decaff.drum.servo import DriveMode

SEEDS, PRESSES = (1, 6, 11), 23
BY_HAND, _, _, DONE, WRONG_SIGN, STUCK, NO_ANGLE = range(7)  # enum decaff_start_state
FLAT = -2.0  # rad: the link of an empty glove


@pytest.fixture(scope="module", params=GEARS)
def plant(request, tmp_path_factory):
    return built(tmp_path_factory.mktemp(request.param), request.param)


def test_no_finger_is_hit_hard(plant):
    """From any bend and speed, with faults during the motion and fingers of 300 to 3000 N/m."""
    found = [hits(plant, seed, PRESSES) for seed in SEEDS]
    with_power, without = map(np.concatenate, zip(*found, strict=True))

    assert len(with_power) > len(SEEDS) * PRESSES / 2 and len(without)
    assert with_power.max() < POWERED and without.max() < UNPOWERED


def test_known_hazards_are_none(plant):
    """Regressions: parked 10.8 mm beyond its path; 0.5 J after a late sample; 27 mJ to an unyielding finger.

    Released 100 ms after a fault, a drum sprang back from its stop with up to 0.4 J.
    """
    found = hazards(plant)

    assert abs(found["parked"]) < 1.5  # mm: the play of the gear
    assert found["heat"] == pytest.approx(1.0, abs=1e-3)
    assert max(found["approach"], found["unyielding"]) < POWERED and found["late"] < UNPOWERED
    assert found["sprung"] < UNPOWERED


@pytest.mark.parametrize(
    ("turns", "counts", "angle", "index", "link", "stop", "state"),
    [
        (1, 1, 1.0, math.nan, 0.7, 1.9, DONE),  # by touching the stop
        (1, 1, 1.0, 1.5, 0.7, 1.9, DONE),  # by the index
        (1, 1, 1.9, math.nan, 1.7, 1.9, DONE),  # started at the stop
        (-1, 1, 1.0, math.nan, 0.7, 1.9, WRONG_SIGN),  # motor wires reversed
        (-1, 1, 1.0, 1.5, FLAT, 1.9, WRONG_SIGN),
        (1, -1, 1.0, math.nan, 0.7, 1.9, WRONG_SIGN),  # encoder reversed: seen when turned by hand
        (1, -1, 1.0, 1.5, FLAT, 1.9, WRONG_SIGN),
        (-1, -1, 1.0, math.nan, 0.7, 1.9, WRONG_SIGN),  # both: by hand
        (-1, -1, 1.0, 1.5, 0.7, 1.9, WRONG_SIGN),  # both: when the drum pushes the link
        (-1, -1, 1.0, 1.5, FLAT, 1.9, STUCK),  # no link to push: the motion exceeds the length of the path
        (0, 1, 1.0, math.nan, 0.7, 1.9, STUCK),
        (1, 1, 1.0, math.nan, 0.7, 1e9, STUCK),  # without a stop
        (1, 1, math.nan, math.nan, 0.7, 1.9, NO_ANGLE),
        (1, 1, 1.0, math.nan, FLAT, 1.9, BY_HAND),  # without a link, a hand turns the drum
    ],
)
def test_drum_starts_where_its_stop_or_index_is_or_is_braked(
    plant, turns, counts, angle, index, link, stop, state
):
    """Regression: with both reversed it reported success, 125 mm nearer to the finger."""
    ((found, off, nearer, mode, most),) = said(plant, "start", turns, counts, angle, index, link, stop)

    assert int(found) == state
    assert int(mode) == {DONE: DriveMode.FORCE, BY_HAND: DriveMode.FREE}.get(state, DriveMode.BRAKED)
    assert abs(float(off)) < 0.012 or state != DONE  # rad: half of the play, and a count
    assert float(nearer) < 3e-3 or turns * counts > 0
    assert float(most) <= (0.1 * Motor().torque + 1e-4 if state != BY_HAND else 0.0)
