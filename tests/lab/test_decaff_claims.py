"""The paper's claims, and the limits of late walls that a finger carries, beside reference values."""

from functools import partial

import claims
import numpy as np
import pytest
from pages import PAGES
from scipy.signal import cont2discrete
from scipy.stats import qmc

from proximity.decaff.drum import sampled_mass, unit_circle
from proximity.decaff.drum.sampled_mass import SampledMass
from proximity.decaff.drum.servo import SIMULATION_STEP, steps_a_sample
from proximity.lab.paper.walls import FINGER
from proximity.lab.simulation import closed_loop


@pytest.fixture(scope="module")
def found():
    return claims.claims()


def test_page_has_every_claim_with_its_figures(found):
    """Run ``python bench/claims.py`` for what belongs there."""
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
    """With steps of half the length every figure is printed as it was."""
    simulated = ("exactly the force", "with cable", "greatly reduces", "too high by k_f x_s", "transparent")
    before = [one.here for one in found if any(words in one.paper for words in simulated)]

    def twice_the_steps(rate, step=SIMULATION_STEP):
        return steps_a_sample(rate, 0.5 * step)

    monkeypatch.setattr(closed_loop, "steps_a_sample", twice_the_steps)
    fine_drum = partial(closed_loop.ideal_drum, step=0.5 * SIMULATION_STEP)
    monkeypatch.setattr(claims, "ideal_drum", fine_drum)
    after = [one.here for one in claims.claims() if any(words in one.paper for words in simulated)]

    assert len(before) == 5 and after == before


def held_by_finger(period, delay_samples, finger=FINGER):
    return SampledMass(finger.mass, period, delay_samples, finger.damping, finger.stiffness)


@pytest.mark.parametrize(
    ("rate_hz", "delay_samples", "expected"), [(25, 1, 268), (3000, 1, 23_196), (1000, 40, 364)]
)
def test_finger_carries_a_light_device(rate_hz, delay_samples, expected):
    """The reference's values are up to 0.05 % low, as of a coarse grid: by the roots ours are stable."""
    plant = held_by_finger(1.0 / rate_hz, delay_samples)
    found = sampled_mass.maximum_stiffness(plant)

    def is_stable(stiffness, damping):
        polynomial = sampled_mass.characteristic(plant, stiffness, damping)
        return unit_circle.spectral_radius(polynomial) < 1.0

    assert expected - 0.51 < found.stiffness < 1.0005 * expected + 0.51
    assert is_stable((1.0 - 1e-6) * found.stiffness, found.damping)
    # and that no damping does better.
    dampings = np.linspace(0.0, 3.0 * found.damping + 1.0, 400)
    assert not is_stable((1.0 + 1e-6) * found.stiffness, dampings).any()


def test_wall_between_two_points_of_a_grid_is_found():
    """1 kHz, 10 g and 11 samples: 3257 N/m was returned, with a spectral radius of 1.089."""
    found = sampled_mass.maximum_stiffness(held_by_finger(0.001, 11))

    assert found.stiffness == pytest.approx(887.0, abs=1.0)
    assert found.damping == pytest.approx(1.95, abs=0.01)


def stepped(mass, period, delay_samples, damping, stiffness, wall_stiffness, wall_damping):
    """Matrices of the loop from sample to sample, by SciPy's own discretisation; stacked over the walls."""
    motion = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
    a, b = cont2discrete((motion, np.array([[0.0], [1.0 / mass]]), np.eye(2), np.zeros((2, 1))), period)[:2]
    # Position, speed, and the last positions: force from those d and d + 1 samples ago.
    loop = np.zeros((*np.shape(wall_stiffness), delay_samples + 3, delay_samples + 3))
    loop[..., :2, :2] = a
    loop[..., 2, 0] = 1.0
    loop[..., range(3, delay_samples + 3), range(2, delay_samples + 2)] = 1.0
    now = 0 if delay_samples == 0 else delay_samples + 1
    difference = np.asarray(wall_damping) / period
    for column, gain in ((now, wall_stiffness + difference), (delay_samples + 2, -difference)):
        loop[..., :2, column] -= np.asarray(gain)[..., None] * b[:, 0]
    return loop


def radii(device, stiffness, damping):
    stiffness, damping = np.broadcast_arrays(stiffness, damping)
    own = (device.mass, device.period, device.delay_samples, device.damping, device.stiffness)
    return np.abs(np.linalg.eigvals(stepped(*own, stiffness, damping))).max(axis=-1)


def test_largest_stiffness_of_256_devices_is_stable_and_no_other_damping_does_better():
    """Against eigenvalues of another discretisation: every softer wall is stable, a stiffer one is not.

    The devices are spread evenly over masses, frequencies, dampings, periods and delays.
    """
    rng = np.random.default_rng(7)
    least, most = (-3.0, 0.0, -2.0, -3.7, 0.0), (0.0, 2.5, 1.0, -2.0, 21.0)
    devices = qmc.scale(qmc.Sobol(5, seed=7).random(256), least, most)
    softer = np.array([0.01, 0.1, 0.25, 0.5, 0.75, 0.9, 0.99, 1.0 - 1e-6])
    for *powers, delay_samples in devices.tolist():
        mass, omega, ratio, period = (10.0 ** np.array(powers)).tolist()
        device = SampledMass(mass, period, int(delay_samples), 2.0 * ratio * mass * omega, mass * omega**2)
        found = sampled_mass.maximum_stiffness(device)

        assert (radii(device, softer * found.stiffness, found.damping) < 1.0).all(), device
        assert radii(device, (1.0 + 1e-6) * found.stiffness, found.damping) > 1.0, device
        dampings = found.damping * np.concatenate([rng.uniform(0.0, 2.0, 12), 10.0 ** rng.uniform(-2, 2, 4)])
        # Nearly all of them lose it at that stiffness already; few do at a smaller one, and hold it again.
        kept = dampings[radii(device, 1.0001 * found.stiffness, dampings) < 1.0]
        lost = radii(device, 1.0001 * found.stiffness * softer[:, None], kept) >= 1.0
        assert lost.any(axis=0).all(), device
