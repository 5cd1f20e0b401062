"""Largest stiffness of a delayed spring under a device that hangs on a finger.

The device is a mass with a damper; behind it come pad, finger and hand. The loop is lost at the least
stiffness for which a spring that is felt late takes away what all these resist with.
"""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from proximity.decaff.arguments import positive
from proximity.studies.simulation.devices import Link
from proximity.studies.simulation.hand import Hand

FASTEST_TURNS = 3.0  # of the delay: beyond, the device's mass alone resists with more
POINTS = 20_000  # between which signs are compared
FREQUENCY_TOLERANCE = 1e-12  # rad/s


def device_resistance(hand: Hand, device: Link, s: ArrayLike) -> np.ndarray:
    """Return the force over the displacement of a device that hangs on a finger, (...) complex, N/m.

    Parameters
    ----------
    hand : Hand
        Behind the pad; its intent stands still.
    device : Link
        Mass and damping; what it touches is not looked at.
    s : (...) complex, rad/s
        Of the swing.
    """
    s = np.asarray(s)
    finger = hand.finger_mass * s**2 + hand.damping * s + hand.stiffness
    pad = hand.pad_damping * s + hand.pad_stiffness
    return device.mass * s**2 + device.damping * s + pad * finger / (pad + finger)


def critical_stiffness(hand: Hand, device: Link, delay: float) -> float:
    """Return the stiffness up to which a device rests on an undamped spring that is felt late, N/m.

    Parameters
    ----------
    hand, device : Hand, Link
        As of `device_resistance`.
    delay : float, s
        Of the spring's force, in all: latency, and half a period of sampling and holding.

    Raises
    ------
    DecaffError
        If the delay is not positive.
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
