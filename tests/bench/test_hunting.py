"""A drum at rest on a wall, which lies anywhere between two encoder counts, is still; and by which cure."""

from dataclasses import replace

import numpy as np
import pytest
from hunting import CURES, cell, rest_of
from pages import PAGES
from paper_drums import PAPER_DRUMS

from proximity.decaff.drum.drum_model import with_random_phases
from proximity.decaff.drum.servo import SERVO_RATE, servo_for
from proximity.decaff.glove.glove import DRUMS
from proximity.lab.simulation.closed_loop import decaff
from proximity.lab.simulation.devices import Decaff
from proximity.lab.simulation.hand import Hand
from proximity.lab.simulation.metrics import FELT_SWING, deviation

HAND = Hand()
COUNT = 24
HOLD = 0.5  # s: a drum that was hit at 1 m/s has come to rest


def swings(drum, speed, **settings):
    """Swings of the force at rest, N, at many phases of the encoder."""
    drums = with_random_phases(drum, COUNT)
    servo = replace(servo_for(drums[0], SERVO_RATE), **settings)
    press = HAND.press(speed, hold=HOLD)
    return np.array([deviation(decaff(HAND, press, Decaff(drum, servo))).swing for drum in drums])


@pytest.mark.parametrize("name", PAPER_DRUMS)
@pytest.mark.parametrize("speed", [0.1, 1.0])
def test_force_at_rest_swings_less_than_is_felt(name, speed):
    """Without the deadband, most phases swing by up to 44 (gear49), 140 (gear12) and 18 mN (gear122)."""
    assert swings(PAPER_DRUMS[name], speed).max() < FELT_SWING
    assert (swings(PAPER_DRUMS[name], speed, deadband=0.0) > FELT_SWING).mean() > 0.5


@pytest.mark.parametrize("name", DRUMS)
def test_drum_behind_a_gear_that_rubs_is_still_as_well(name):
    assert swings(DRUMS[name], 0.1).max() < 1e-4


@pytest.mark.parametrize("name", PAPER_DRUMS)
def test_deadband_is_the_cure_at_rest_and_a_finer_encoder_makes_the_steps_before_smaller(name):
    found = {cure: rest_of(PAPER_DRUMS[name], CURES[cure], phases=4) for cure in CURES}
    hunting = {cure for cure, one in found.items() if one.swing > FELT_SWING}

    assert {"none", "friction", "small dither", "dither"} <= hunting
    assert not hunting & {"deadband", "smooth", "both"}
    assert found["deadband"].swing == pytest.approx(0.0, abs=1e-4)
    assert found["deadband"].step > FELT_SWING
    assert found["both"].step < 0.15 * found["deadband"].step
    assert found["smooth"].step > 0.7 * found["deadband"].step


def test_page_has_the_comparison_of_the_cures():
    """Run ``python bench/hunting.py`` for what belongs there; gear51 is checked."""
    page = PAGES["science/drum.md"].splitlines()
    begin = page.index("| cure | gear14 | gear51 | gear111 |")
    rows = page[begin + 2 : begin + 2 + len(CURES)]

    for row, cure in zip(rows, CURES.values(), strict=True):
        words = [part.strip() for part in row.strip("|").split("|")]
        assert (words[0], words[2]) == (cure.words, cell(rest_of(DRUMS["gear51"], cure)))
