"""Stability of sampled and delayed walls: on a free mass, and under a device carried by a finger.

A mass feels a force that is held for a period and was computed from positions some samples old; the damping
is from the difference of two of them. Equation (1) itself has one sample of delay. With a = k T²/2m and
b = B T/2m the characteristic polynomial is z^(d+1) (z-1)² + (z+1) ((a+b) z - b). It has roots at exp(±2jh)
for a = 2 tan²h cos((2d+2)h), b = tan h sin((2d+2)h) - a/2; the stable region is what this curve and a = 0
enclose for h from 0 to pi/(4(d+1)).

A device carried by a finger is a mass with a damper, connected to pad, finger and hand. The loop of a spring
becomes unstable at the smallest stiffness whose delayed force cancels their resistance.
"""

import math
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm
from scipy.optimize import brentq

from proximity.checks import finite, positive, whole
from proximity.decaff.drum.sampled_mass import (
    Gains,
    SampledMass,
    damping_window,
    edge_at,
    root_between,
)
from proximity.lab.simulation.devices import COUPLED_DEVICE, CoupledWall, Hand, Link


class Verdict(StrEnum):
    """Reason why a sampled wall is stable or not: the causes of instability of Love and Book."""

    STABLE = "stable"
    TOO_STIFF = "too stiff for any damping"
    TOO_LITTLE_DAMPING = "too little damping"
    TOO_MUCH_DAMPING = "too much damping"


def boundary(device: SampledMass, count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Return the edge of the stable region: stiffness (count,), N/m, and damping (count,), N·s/m.

    *count*: number of points, from no stiffness and no damping to no stiffness and the largest damping.
    """
    half_angle = np.linspace(0.0, device.last_half_angle, whole("count", count, 2))
    a, b = edge_at(device, half_angle)
    return a * device.stiffness_unit, b * device.damping_unit


def largest_damping(device: SampledMass) -> float:
    """Return the largest damping of a stable wall, of a stiffness near zero, N·s/m."""
    return math.tan(device.last_half_angle) * device.damping_unit


def verdict(device: SampledMass, gains: Gains) -> Verdict:
    """Return whether a wall is stable, and if not, the cause."""
    low, high = damping_window(device, gains.stiffness)
    damping = finite("damping", gains.damping, "newton seconds a metre")
    if math.isnan(low):
        return Verdict.TOO_STIFF
    if damping <= low:
        return Verdict.TOO_LITTLE_DAMPING
    return Verdict.TOO_MUCH_DAMPING if damping >= high else Verdict.STABLE


def slowest_period(mass: float, gains: Gains, delay_samples: int = 1) -> float:
    """Return the period up to which a wall is stable, s: with any damping, sampling faster restores it."""
    stiffness = positive("stiffness", gains.stiffness, "newtons a metre")
    damping = positive("damping", gains.damping, "newton seconds a metre")
    device = SampledMass(mass, 1.0, delay_samples)
    # a/b² does not depend on the period; along the edge it falls from infinity to zero.
    ratio = 2.0 * mass * stiffness / damping**2

    # From near its start, where a = 2h² and b = (2d+1)h².
    start = min(0.1 * math.sqrt(2.0 / ratio) / (2 * delay_samples + 1), 0.1 * device.last_half_angle)

    def left(half_angle: float) -> float:
        a, b = edge_at(device, half_angle)
        return float(a - ratio * b**2)

    b = edge_at(device, root_between(left, start, device.last_half_angle))[1]
    return float(b) * 2.0 * mass / damping


FASTEST_TURNS = 3.0  # of the delay: beyond, the device's mass alone resists with more
POINTS = 20_000  # between which signs are compared
FREQUENCY_TOLERANCE = 1e-12  # rad/s


def device_resistance(hand: Hand, device: Link, s: ArrayLike) -> np.ndarray:
    """Return the force over the displacement of a device carried by a finger, (...) complex, N/m.

    *device*: mass and damping; its contact is ignored. *s*: (...) complex, rad/s.
    """
    s = np.asarray(s)
    finger = hand.finger_mass * s**2 + hand.damping * s + hand.stiffness
    pad = hand.pad_damping * s + hand.pad_stiffness
    return device.mass * s**2 + device.damping * s + pad * finger / (pad + finger)


def critical_stiffness(hand: Hand, device: Link, delay: float) -> float:
    """Return the stiffness up to which a device rests on an undamped spring with a delay, N/m.

    *delay*: total, of the spring's force: latency, and half a period of sampling and holding.
    """
    positive("delay", delay, "seconds")

    def needed(omega: np.ndarray | float) -> np.ndarray:
        """Return minus the stiffness where it is real."""
        return device_resistance(hand, device, 1j * np.asarray(omega)) * np.exp(
            1j * np.asarray(omega) * delay
        )

    omegas = np.linspace(1e-6, 2.0 * math.pi * FASTEST_TURNS / delay, POINTS)
    turned = needed(omegas).imag > 0.0
    roots = [
        brentq(lambda omega: float(needed(omega).imag), omegas[i], omegas[i + 1], xtol=FREQUENCY_TOLERANCE)
        for i in np.flatnonzero(turned[:-1] != turned[1:])
    ]
    return min((-float(needed(root).real) for root in roots if needed(root).real < 0.0), default=math.inf)


def rests_on(hand: Hand, wall: CoupledWall, device: Link = COUPLED_DEVICE) -> bool:
    """Return whether a finger comes to rest on a sampled wall, by the eigenvalues of the loop.

    *wall*: its latency is rounded to whole samples, and the steps of its encoder are ignored.

    Notes
    -----
    Between two samples the force is held, and the step of hand, pad and device is exact. While the hand
    presses, the wall never has to pull, so that the loop is linear.
    """
    moved, pushed = _sampled(hand, device, 1.0 / wall.rate)
    delay, size = round(wall.latency * wall.rate), len(pushed)
    # The state: of device and finger now, and the device's positions at earlier samples.
    loop = np.zeros((size + delay + 1, size + delay + 1))
    position = np.eye(len(loop))[[0, *range(size, len(loop))]]  # now, one sample ago, and so on
    damping = wall.damping * wall.rate
    force = (wall.stiffness + damping) * position[delay] - damping * position[delay + 1]
    loop[:size, :size] = moved
    loop[:size] -= np.outer(pushed, force)
    loop[size:] = position[:-1]
    return bool(np.abs(np.linalg.eigvals(loop)).max() < 1.0)


def _sampled(hand: Hand, device: Link, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the step of device and finger over a period, (4, 4), and the effect of 1 N on the device, (4,).

    The state is position and speed of the device, then those of the finger: m, m/s.
    """
    stiffness, damping = hand.pad_stiffness, hand.pad_damping
    pad = np.array([-stiffness, -damping, stiffness, damping])  # N on the device
    rates = np.zeros((5, 5))
    rates[0, 1] = rates[2, 3] = 1.0
    rates[1, :4] = (pad - [0.0, device.damping, 0.0, 0.0]) / device.mass
    rates[3, :4] = -np.add(pad, [0.0, 0.0, hand.stiffness, hand.damping]) / hand.finger_mass
    rates[1, 4] = 1.0 / device.mass
    step = expm(rates * period)
    return step[:4, :4], step[:4, 4]
