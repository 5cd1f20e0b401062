"""Limits of late walls that a finger carries, against the reference values and another discretisation."""

import numpy as np
import pytest
from scipy.signal import cont2discrete

from proximity.decaff.drum import sampled_mass, unit_circle
from proximity.decaff.drum.sampled_mass import SampledMass
from proximity.lab.paper.walls import FINGER


def held_by_finger(period, delay_samples, finger=FINGER):
    return SampledMass(finger.mass, period, delay_samples, finger.damping, finger.stiffness)


@pytest.mark.parametrize(
    ("rate_hz", "delay_samples", "expected"),
    [(25, 1, 268), (3000, 1, 23_196), (1000, 40, 364)],
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


def test_largest_stiffness_of_1000_devices_is_stable_and_no_other_damping_does_better():
    """Against eigenvalues of another discretisation: every softer wall is stable, a stiffer one is not."""
    rng = np.random.default_rng(7)
    softer = np.array([0.01, 0.1, 0.25, 0.5, 0.75, 0.9, 0.99, 1.0 - 1e-6])
    for _ in range(1000):
        mass, omega, ratio = 10.0 ** rng.uniform((-3.0, 0.0, -2.0), (0.0, 2.5, 1.0))
        period, delay_samples = 10.0 ** rng.uniform(-3.7, -2.0), int(rng.integers(0, 21))
        device = SampledMass(mass, period, delay_samples, 2.0 * ratio * mass * omega, mass * omega**2)
        found = sampled_mass.maximum_stiffness(device)

        assert (radii(device, softer * found.stiffness, found.damping) < 1.0).all(), device
        assert radii(device, (1.0 + 1e-6) * found.stiffness, found.damping) > 1.0, device
        dampings = found.damping * np.concatenate([rng.uniform(0.0, 2.0, 12), 10.0 ** rng.uniform(-2, 2, 4)])
        lost = radii(device, 1.0001 * found.stiffness * np.append(softer, 1.0)[:, None], dampings) >= 1.0
        assert lost.any(axis=0).all(), device
