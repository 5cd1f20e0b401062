"""Passivity and energy of sampled walls, compared with reference values."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sampled_walls import stepped_radius

from proximity.decaff.controller.controller import largest_passive_stiffness, required_damping
from proximity.errors import ArgumentError


@pytest.mark.parametrize(
    ("stiffness", "damping", "rate_hz", "delay_samples", "expected"),
    [
        (1000.0, 5.0, 1000, 0, 5.500),
        (1000.0, 5.0, 1000, 1, 5.525),
        (3900.0, 60.0, 200, 1, 70.54219),
        (1000.0, 0.0, 1000, 40, 40.5),
        (3000.0, 0.5, 1000, 1, 4.0),  # K T > 4 B: 3 K T/2 - B
    ],
)
def test_damping_that_a_sampled_wall_needs(stiffness, damping, rate_hz, delay_samples, expected):
    found = required_damping(stiffness, damping, 1.0 / rate_hz, delay_samples)

    assert found == pytest.approx(expected, abs=1e-4 if stiffness == 3900.0 else 1e-9)


@given(st.floats(0.0, 1e5), st.floats(-100.0, 100.0), st.sampled_from([0, 1, 2, 5, 40]))
def test_required_damping_is_the_supremum_over_frequencies(stiffness, damping, delay_samples):
    """Colgate's criterion itself, on a grid of the unit circle."""
    period = 0.001
    turn = np.linspace(1e-4, math.pi, 20_001)
    z = np.exp(1j * turn)
    wall = (stiffness + damping / period * (1.0 - 1.0 / z)) * z**-delay_samples
    on_grid = (0.5 * period * ((1.0 - 1.0 / z) * wall).real / (1.0 - np.cos(turn))).max()

    found = required_damping(stiffness, damping, period, delay_samples)
    scale = stiffness * period * (delay_samples + 0.5) + abs(damping) + 1e-300
    assert on_grid <= found + 1e-6 * scale
    assert found == pytest.approx(on_grid, abs=1e-4 * scale)
    enough = stiffness * period * (0.5 + delay_samples) + abs(damping)
    assert found <= enough * (1.0 + 1e-12) + 1e-300


@pytest.mark.parametrize(("delay_samples", "turn"), [(0, math.pi), (0, 0.01), (1, 1.5), (5, 0.01), (5, 1.0)])
def test_bound_is_the_energy_of_a_motion(delay_samples, turn):
    """A hand that moves in straight lines between sampled sines: work of the wall against a damper's."""
    stiffness, damping, period, count = 1000.0, 5.0, 0.001, 20_000
    turn = 2.0 * math.pi * round(turn * count / (2.0 * math.pi)) / count  # whole rounds
    positions = np.cos(turn * np.arange(count) + 0.3)
    force = stiffness * positions + damping / period * (positions - np.roll(positions, 1))
    steps = np.roll(positions, -1) - positions
    given_energy = -(np.roll(force, delay_samples) * steps).sum()
    taken_energy = (steps**2).sum() / period  # of a unit damper

    z = np.exp(1j * turn)
    wall = (stiffness + damping / period * (1.0 - 1.0 / z)) * z**-delay_samples
    at_this_turn = 0.5 * period * ((1.0 - 1.0 / z) * wall).real / (1.0 - math.cos(turn))
    assert given_energy / taken_energy == pytest.approx(at_this_turn, rel=1e-8)
    bound = required_damping(stiffness, damping, period, delay_samples)
    assert given_energy / taken_energy <= bound * (1.0 + 1e-9)


@pytest.mark.parametrize("delay_samples", [0, 1, 5])
def test_passive_wall_shakes_with_no_hand(delay_samples):
    """Hands of any mass and spring; just below the bound there is an unstable one."""
    stiffness, damping, period = 1000.0, 2.0, 0.001
    bound = required_damping(stiffness, damping, period, delay_samples)
    rng = np.random.default_rng(7)
    for _ in range(60):
        mass, hand = 10.0 ** rng.uniform(-3, 2), 10.0 ** rng.uniform(0, 6)
        found = stepped_radius(mass, period, delay_samples, 1.0001 * bound, hand, stiffness, damping)
        assert found < 1.0 + 1e-9

    own = 0.99 * required_damping(stiffness, 0.0, period, delay_samples)
    # A heavy hand is slow: 1 Hz.
    assert stepped_radius(20.0, period, delay_samples, own, 1.0, stiffness, 0.0) > 1.0


@given(st.floats(0.01, 50.0), st.floats(-10.0, 10.0), st.sampled_from([0, 1, 3]))
def test_largest_passive_stiffness_needs_just_the_damping(own, damping, delay_samples):
    found = largest_passive_stiffness(own, damping, 0.001, delay_samples)

    if found == 0.0:
        assert own <= abs(damping) * (1.0 + 1e-9)
    else:
        needed = required_damping(found, damping, 0.001, delay_samples)
        assert needed == pytest.approx(own, rel=1e-9)


def test_walls_that_are_none_are_refused():
    with pytest.raises(ArgumentError, match="damping is nan, expected a number of newton seconds a metre"):
        required_damping(1.0, math.nan, 0.001)
    with pytest.raises(
        ArgumentError, match=r"stiffness is -1\.0, expected a number of newtons a metre of 0 or more"
    ):
        required_damping(-1.0, 1.0, 0.001)


def bounce_energy_ratios(phase_step, delay_samples):
    """Ratio of energies after and before a bounce off a held spring, for entries spread over a period."""
    position, velocity = (np.arange(10) + 0.5) / 10, np.ones(10)  # in periods, masses and speeds before
    waiting = [np.zeros(10)] * delay_samples
    while (position > 0.0).any() or np.any(waiting):
        waiting.append(phase_step**2 * np.maximum(position, 0.0))
        force = waiting.pop(0)
        position, velocity = position + velocity - 0.5 * force, velocity - force
    return velocity**2


@pytest.mark.parametrize("delay_samples", [0, 1, 3])
def test_late_wall_is_a_negative_damper(delay_samples):
    """A bounce gains the work of the apparent damper over half a period of the oscillation."""
    stiffness, mass, period = 1000.0, 0.1, 1e-5
    omega = math.sqrt(stiffness / mass)

    damper = -stiffness * (delay_samples + 0.5) * period
    found = bounce_energy_ratios(omega * period, delay_samples)
    assert found.mean() == pytest.approx(math.exp(-damper / mass * math.pi / omega), rel=1e-4)
