"""The paper's claims, and the stiffest sampled walls of many devices."""

from functools import partial

import numpy as np
import pytest
from pages import PAGES
from sampled_walls import stepped_radius
from scipy.stats import qmc

from proximity.decaff.controller import served_drum
from proximity.decaff.drum import sampled_mass
from proximity.decaff.drum.sampled_mass import SampledMass
from proximity.decaff.drum.servo import SIMULATION_STEP, steps_a_sample
from proximity.lab import claims
from proximity.lab.simulation import closed_loop


@pytest.fixture(scope="module")
def found():
    return claims.claims()


def test_page_has_every_claim_with_its_figures(found):
    """Run ``python -m proximity.lab.claims`` for the new text."""
    assert claims.markdown(found) in PAGES["science/paper.md"]


@pytest.mark.parametrize(
    ("words", "figures"),
    [
        ("stiffest wall", ("4045.1", "59.46", "0.9937")),  # reference value
        ("largest damping", ("116.0",)),  # reference value
        ("Love and Book", ("17.44", "100.00")),  # reference value
        ("too high by k_f x_s", ("0.8 N",)),  # reference value
        ("square of x_s", ("11 mm", "6.000", "6.583")),  # reference value
        ("keeps a force", ("40.00 ms",)),  # reference value
        ("speed times delay", ("4.00", "3.25")),  # reference value
        ("prolongs the force", ("77.2",)),  # reference value
        ("operator who draws back", ("0.0192", "1.905")),  # reference value
        ("soft wall", ("0.5,",)),  # reference value
        ("lightly damped", ("27.4", "20.6")),  # reference value
        ("exactly the force", ("15.3%", "51:1")),  # reference value
        ("with cable", ("1212 N/m",)),  # reference value
    ],
)
def test_claim_has_the_figures_of_the_paper_worked_through(found, words, figures):
    (claim,) = [one for one in found if words in one.paper]
    for figure in figures:
        assert figure in claim.here


def test_every_claim_says_whether_it_holds(found):
    assert len(found) == 17
    assert {one.holds for one in found} <= {claims.YES, claims.PARTLY, claims.NO}
    assert all(one.holds == claims.YES or len(one.here) > 40 for one in found)


def test_digits_of_simulated_claims_are_those_that_a_finer_step_gives(found, monkeypatch):
    """With half the step length all printed figures stay the same."""
    simulated = ("exactly the force", "with cable", "greatly reduces", "too high by k_f x_s", "transparent")
    numbers = [k for k, one in enumerate(found) if any(words in one.paper for words in simulated)]

    def twice_the_steps(rate, step=SIMULATION_STEP):
        return steps_a_sample(rate, 0.5 * step)

    for module in (closed_loop, served_drum):
        monkeypatch.setattr(module, "steps_a_sample", twice_the_steps)
    fine_drum = partial(closed_loop.ideal_drum, step=0.5 * SIMULATION_STEP)
    monkeypatch.setattr(claims, "ideal_drum", fine_drum)
    fine = [claims._CLAIMS[k]() for k in numbers]

    assert len(fine) == 5 and fine == [found[k] for k in numbers]


def test_largest_stiffness_of_256_devices_is_stable_and_no_other_damping_does_better():
    """Against eigenvalues of another discretisation: softer walls are stable, a stiffer one is not."""
    rng = np.random.default_rng(7)
    devices = qmc.scale(qmc.Sobol(3, seed=7).random(256), (-3.0, -3.7, 0.0), (0.0, -2.0, 21.0))
    softer = np.array([0.01, 0.1, 0.25, 0.5, 0.75, 0.9, 0.99, 1.0 - 1e-6])
    for mass_power, period_power, delay_samples in devices.tolist():
        device = SampledMass(10.0**mass_power, 10.0**period_power, int(delay_samples))
        found = sampled_mass.maximum_stiffness(device)
        radius = partial(stepped_radius, device.mass, device.period, device.delay_samples, 0.0, 0.0)

        assert (radius(softer * found.stiffness, found.damping) < 1.0).all(), device
        assert radius((1.0 + 1e-6) * found.stiffness, found.damping) > 1.0, device
        dampings = found.damping * np.concatenate([rng.uniform(0.0, 2.0, 12), 10.0 ** rng.uniform(-2, 2, 4)])
        assert (radius(1.0001 * found.stiffness, dampings) >= 1.0).all(), device
