"""Force laws of a sampled wall: equation (1), the slope predictor, and the braking pulse.

Forces are pushes out of the wall, never pulls; positions are positive into it.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from proximity.checks import not_negative, positive
from proximity.decaff.drum.sampled_mass import Gains


def sampled_force(last: ArrayLike, before: ArrayLike, gains: Gains, period: float) -> np.ndarray:
    """Return the push of equation (1), (...), N: from the last sample and the one before, so one period late.

    *last*, *before*: (...) m.
    """
    last, before = np.asarray(last, np.float64), np.asarray(before, np.float64)
    rate = gains.damping / positive("period", period, "seconds")
    force = gains.stiffness * last + rate * (last - before)
    return np.where(last > 0.0, np.maximum(force, 0.0), 0.0)


def predicted_force(force: ArrayLike, last: ArrayLike) -> np.ndarray:
    """Return the push for the coming period from the slope of the last two, (...), N, after Ellis.

    It is that of the middle of the period if the slope goes on, and takes the hold's half sample away.

    *force*, *last*: (...) N.
    """
    force = np.asarray(force, np.float64)
    return np.maximum(force + 0.5 * (force - np.asarray(last, np.float64)), 0.0)


def braking_pulse(mass: float, speed: ArrayLike, period: float, force_limit: float = math.inf) -> np.ndarray:
    """Return the push that stops a mass within one period of its entry, (...), N, after Salcudean and Vlaar.

    *speed*: (...) m/s; into the wall; one that leaves is not braked.
    """
    limit = not_negative("force_limit", force_limit, "newtons", may_be_infinite=True)
    pulse = positive("mass", mass, "kilograms") * np.asarray(speed, np.float64)
    return np.clip(pulse / positive("period", period, "seconds"), 0.0, limit)
