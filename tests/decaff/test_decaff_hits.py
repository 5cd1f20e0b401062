"""The controller in C around a plant with play, friction, stop, brake and voltage: how hard a finger is hit.

``python bench/drum_hits.py`` goes through 10 000 presses.
"""

import math

import pytest
from drum_in_plant import POWERED, UNPOWERED, built, hazards, hits, said

from proximity.decaff.drum.drum_model import GEARS

PRESSES = 67
DONE, WRONG_SIGN, STUCK = 3, 4, 5  # enum decaff_start_state


@pytest.fixture(scope="module", params=GEARS)
def plant(request, tmp_path_factory):
    return built(tmp_path_factory.mktemp(request.param), request.param)


def test_no_finger_is_hit_hard(plant):
    """From any bend and speed, with faults in mid-flight and fingers of 300 to 3000 N/m."""
    with_power, without = hits(plant, 1, PRESSES)

    assert len(with_power) > PRESSES / 2 and len(without)
    assert with_power.max() < POWERED and without.max() < UNPOWERED


def test_known_hazards_are_none(plant):
    """Parked 10.8 mm beyond its path; 0.5 J after a late sample; 27 mJ to a finger that does not yield."""
    found = hazards(plant)

    assert abs(found["parked"]) < 1.5  # mm: the play of the gear
    assert found["heat"] == pytest.approx(1.0, abs=1e-3)
    assert max(found["approach"], found["unyielding"]) < POWERED and found["late"] < UNPOWERED


@pytest.mark.parametrize(
    ("turns", "counts", "index", "link", "state"),
    [
        (1, 1, math.nan, 0.7, DONE),
        (1, 1, 1.5, 0.7, DONE),
        (-1, 1, math.nan, 0.7, WRONG_SIGN),
        (1, -1, math.nan, 0.7, WRONG_SIGN),
        (-1, -1, math.nan, 0.7, WRONG_SIGN),
        (-1, -1, 1.5, 0.7, WRONG_SIGN),
        (-1, -1, 1.5, -2.0, STUCK),
    ],
)
def test_start_knows_its_signs(plant, turns, counts, index, link, state):
    """With both reversed it said that it was homed, 125 mm nearer to the finger."""
    ((found, _, nearer, _),) = said(plant, "start", turns, counts, 1.0, index, link)

    assert int(found) == state
    assert float(nearer) < 3e-3 or turns * counts > 0
