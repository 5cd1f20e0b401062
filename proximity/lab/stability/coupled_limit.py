"""Stability of a delayed spring, or of a sampled wall, under a device that hangs on a finger.

The device is a mass with a damper; behind it come pad, finger and hand. The loop of a spring is lost at the
least stiffness for which, felt late, it takes away what all these resist with.
"""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm
from scipy.optimize import brentq

from proximity.checks import positive
from proximity.lab.simulation.devices import COUPLED_DEVICE, CoupledWall, Hand, Link

FASTEST_TURNS = 3.0  # of the delay: beyond, the device's mass alone resists with more
POINTS = 20_000  # between which signs are compared
FREQUENCY_TOLERANCE = 1e-12  # rad/s


def device_resistance(hand: Hand, device: Link, s: ArrayLike) -> np.ndarray:
    """Return the force over the displacement of a device that hangs on a finger, (...) complex, N/m.

    *device*: mass and damping; what it touches is not looked at. *s*: (...) complex, rad/s.
    """
    s = np.asarray(s)
    finger = hand.finger_mass * s**2 + hand.damping * s + hand.stiffness
    pad = hand.pad_damping * s + hand.pad_stiffness
    return device.mass * s**2 + device.damping * s + pad * finger / (pad + finger)


def critical_stiffness(hand: Hand, device: Link, delay: float) -> float:
    """Return the stiffness up to which a device rests on an undamped spring that is felt late, N/m.

    *delay*: of the spring's force, in all: latency, and half a period of sampling and holding.
    """
    positive("delay", delay, "seconds")

    def needed(omega: np.ndarray | float) -> np.ndarray:
        """Minus the stiffness, where it is real."""
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

    *wall*: its latency is rounded to whole samples, and the steps of its encoder are not looked at.

    Notes
    -----
    Between two samples the force is held, and the step of hand, pad and device is exact. While the hand
    presses, the wall never has to pull, so that the loop is linear.
    """
    moved, pushed = _sampled(hand, device, 1.0 / wall.rate)
    delay, size = round(wall.latency * wall.rate), len(pushed)
    # The state: of device and finger now, and the device's positions of the samples before.
    loop = np.zeros((size + delay + 1, size + delay + 1))
    position = np.eye(len(loop))[[0, *range(size, len(loop))]]  # now, one sample ago, and so on
    damping = wall.damping * wall.rate
    force = (wall.stiffness + damping) * position[delay] - damping * position[delay + 1]
    loop[:size, :size] = moved
    loop[:size] -= np.outer(pushed, force)
    loop[size:] = position[:-1]
    return bool(np.abs(np.linalg.eigvals(loop)).max() < 1.0)


def _sampled(hand: Hand, device: Link, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Step of device and finger over a period, (4, 4), and what 1 N on the device adds to it, (4,).

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
