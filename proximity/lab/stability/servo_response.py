"""Frequency response of a sampled servo within its limits.

Linear: no friction, no integral, no limits, no rounding. The drum is a free mass under a held force; the
servo acts one sample late, as eq (1) of the paper does. With the speed of the reference in its damping it
follows faster.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from proximity.checks import positive
from proximity.decaff.drum.drum_model import Drum
from proximity.decaff.drum.servo import Servo
from proximity.errors import ArgumentError

FINEST = 2000  # points from nothing to half the sampling rate, between which edges are looked for


def servo_response(
    drum: Drum, servo: Servo, frequencies: ArrayLike, *, with_reference_speed: bool = True
) -> np.ndarray:
    """Return position over reference, (...) complex.

    *frequencies*: (...) Hz. *with_reference_speed*: whether the damping is against the speed of the
    reference, or against all speed.
    """
    z = np.exp(2j * math.pi * np.asarray(frequencies, np.float64) / servo.rate)
    held = servo.period**2 / (2.0 * drum.mass) * (z + 1.0) / (z - 1.0) ** 2
    damper = servo.damping / servo.period * (1.0 - 1.0 / z)
    against = held / z * (servo.stiffness + damper)
    towards = against if with_reference_speed else held / z * servo.stiffness
    return towards / (1.0 + against)


def bandwidth(drum: Drum, servo: Servo, *, with_reference_speed: bool = True) -> float:
    """Return the frequency from which on a swing is followed by less than 3 dB, Hz."""

    def left(frequency: float) -> float:
        return float(abs(servo_response(drum, servo, frequency, with_reference_speed=with_reference_speed)))

    return _first_fall(lambda frequency: left(frequency) - math.sqrt(0.5), servo.rate)


def phase_bandwidth(drum: Drum, servo: Servo, lag: float = math.pi / 4.0) -> float:
    """Return the frequency from which on a swing is followed late, Hz, with the reference's speed."""
    most = positive("lag", lag, "radians")
    return _first_fall(
        lambda frequency: float(np.angle(servo_response(drum, servo, frequency))) + most, servo.rate
    )


def _first_fall(above: Callable[[float], float], rate: float) -> float:
    """Frequency at which a function first falls through zero."""
    frequencies = rate * np.linspace(1e-4, 0.4999, FINEST)
    signs = np.array([above(float(frequency)) > 0.0 for frequency in frequencies])
    falls = np.flatnonzero(signs[:-1] & ~signs[1:])
    if not len(falls):
        raise ArgumentError(
            "the servo follows every frequency, expected an edge below half its sampling rate"
        )
    return float(brentq(above, frequencies[falls[0]], frequencies[falls[0] + 1], xtol=1e-9 * rate))
