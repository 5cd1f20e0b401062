"""Limits of delayed walls, alone and with a finger, against the reference values."""

import math

import numpy as np
import pytest
from scipy.signal import cont2discrete

from proximity.decaff.drum import sampled_mass, unit_circle
from proximity.decaff.drum.sampled_mass import SampledMass
from proximity.errors import ArgumentError
from proximity.lab.paper.spring_damper import FINGER, SpringDamper
from proximity.lab.stability import delayed_loops

# ------------------------------------------------------------------------------------------- pure delay


def test_pure_delay_limit():
    found = delayed_loops.pure_delay_limit(1.0, 1.0)

    assert (found.stiffness, found.damping) == pytest.approx((0.54977403, 0.94816614), rel=1e-7)
    turn = found.damping / math.sqrt(found.stiffness**2 + found.damping**2 * 1.07687399**2)
    assert turn * 1.07687399 == pytest.approx(math.sin(1.07687399), rel=1e-7)


def test_pure_delay_is_the_limit_of_fast_sampling():
    """As the period goes to zero, d + 1/2 samples for the spring and d + 1 for the damper are one delay."""
    samples = 4000
    sampled = sampled_mass.maximum_stiffness(SampledMass(1.0, 1.0 / samples, samples))
    edge = delayed_loops.pure_delay_boundary(1.0, 1.0, 100_001)
    limit = delayed_loops.pure_delay_limit(1.0, 1.0)

    assert sampled.stiffness == pytest.approx(limit.stiffness, rel=1e-3)
    assert sampled.damping == pytest.approx(limit.damping, rel=1e-3)
    assert edge[0].max() == pytest.approx(limit.stiffness, rel=1e-8)
    assert edge[1][np.argmax(edge[0])] == pytest.approx(limit.damping, rel=1e-4)
    assert (edge[0][0], edge[1][0], edge[0][-1]) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("delay", "stiffness", "tolerance"),
    [
        (1e-3, 6546.12, 1e-4),
        (40e-3, 356.45, 1e-4),
    ],
)
def test_finger_on_a_spring_that_is_felt_late(delay, stiffness, tolerance):
    found = delayed_loops.delayed_spring_limit(FINGER, delay)

    assert found.stiffness == pytest.approx(stiffness, rel=tolerance)
    s = 2j * math.pi * found.frequency_hz
    rest = FINGER.mass * s**2 + FINGER.dynamic_stiffness(s) + found.stiffness * np.exp(-s * delay)
    assert abs(rest) < 1e-6 * found.stiffness
    if delay == 40e-3:
        assert found.frequency_hz == pytest.approx(8.3, abs=0.05)


def test_finger_on_a_late_spring_grows_above_the_limit_only():
    """Against a motion computed in time, not from frequencies."""
    delay, step = 0.040, 1e-4
    limit = delayed_loops.delayed_spring_limit(FINGER, delay).stiffness
    for share, is_growing in ((0.97, False), (1.03, True)):
        position, velocity, past = 1e-3, 0.0, [1e-3] * round(delay / step)
        sizes = []
        for _ in range(round(6.0 / step)):
            push = share * limit * past.pop(0) + FINGER.stiffness * position + FINGER.damping * velocity
            velocity -= push / FINGER.mass * step
            position += velocity * step
            past.append(position)
            sizes.append(abs(position))
        quarter = len(sizes) // 4
        assert (max(sizes[-quarter:]) > max(sizes[quarter : 2 * quarter])) is is_growing


def test_finger_that_resonates_may_be_lost_at_a_later_turn():
    finger = SpringDamper(stiffness=1000.0, damping=0.2, mass=0.010)
    delay = 0.040
    omega = np.linspace(1.0, 3000.0, 2_000_001)
    loop = np.exp(-1j * omega * delay) / (
        finger.stiffness - finger.mass * omega**2 + 1j * finger.damping * omega
    )
    turned = np.flatnonzero((np.diff(np.signbit(loop.imag)) != 0) & (loop.real[:-1] < 0.0))
    expected = 1.0 / np.abs(loop[turned]).max()

    found = delayed_loops.delayed_spring_limit(finger, delay)
    assert found.stiffness == pytest.approx(expected, rel=1e-4)
    assert 2.0 * math.pi * found.frequency_hz * delay > 2.0 * math.pi


def test_massless_finger_has_a_limit_too():
    found = delayed_loops.delayed_spring_limit(SpringDamper(200.0, 6.0), 0.040)

    assert 200.0 < found.stiffness < 1000.0
    with pytest.raises(ArgumentError, match=r"damping is 0\.0, expected a positive number of newton seconds"):
        delayed_loops.delayed_spring_limit(SpringDamper(200.0, 0.0, 0.01), 0.040)
    with pytest.raises(ArgumentError, match=r"delay is 0\.0, expected a positive number of seconds"):
        delayed_loops.delayed_spring_limit(FINGER, 0.0)


def test_handle_of_kazeroonis_kind_needs_about_3_ms():
    """Reference: of the order of the paper's 3 ms; the model is assumed, only its own number is checked."""
    handle = delayed_loops.PositionedHandle()

    assert handle.slowest_period == pytest.approx(3.29e-3, abs=5.1e-6)
    assert delayed_loops.PositionedHandle(bandwidth_hz=20.0).slowest_period < handle.slowest_period
    light = delayed_loops.PositionedHandle(arm=SpringDamper(50.0, 1.0, 0.01), stiffness=1000.0)
    assert light.slowest_period == math.inf
    stiff = delayed_loops.PositionedHandle(arm=SpringDamper(1e5, 1.0, 0.01))
    assert stiff.slowest_period == 0.0
    with pytest.raises(ArgumentError, match=r"bandwidth_hz is 0\.0, expected a positive number of hertz"):
        delayed_loops.PositionedHandle(bandwidth_hz=0.0)


# ------------------------------------------------------------------------------------- finger in parallel


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
