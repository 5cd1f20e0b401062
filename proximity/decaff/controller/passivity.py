"""Colgate's bound: the damping with which a sampled wall is passive, whatever hand holds the device.

The wall is a spring and a damper by differences, d samples late. The bound is on the device's own damping,
not on the finger's, and it holds for every hand that is passive itself.
"""

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import brentq

from proximity.checks import finite, not_negative, positive, whole


def required_damping(stiffness: float, damping: float, period: float, delay_samples: int = 0) -> float:
    """Return the damping of the device above which the sampled wall is passive, N·s/m.

    Notes
    -----
    Source: Colgate & Schenkel 1997, b > T/2 Re((1 - 1/z) H(z)) / (1 - cos) on the unit circle. For this
    wall the right side is K T/2 sin((2d+1)w/2) / sin(w/2) - B cos((d+1)w), a polynomial in the cosine of w,
    whose largest value is found exactly.
    """
    stiffness = not_negative("stiffness", stiffness, "newtons a metre")
    period = positive("period", period, "seconds")
    delay_samples = whole("delay_samples", delay_samples, 0)
    series = np.zeros(delay_samples + 2)  # of Chebyshev polynomials in the cosine
    series[0] = 0.5 * stiffness * period
    series[1:-1] = stiffness * period
    series[-1] = -finite("damping", damping, "newton seconds a metre")
    return _largest(series)


def largest_passive_stiffness(
    device_damping: float, damping: float, period: float, delay_samples: int = 0
) -> float:
    """Return the stiffness up to which a wall is passive, N/m; 0 where its damping alone is too much."""
    own = not_negative("device_damping", device_damping, "newton seconds a metre")
    if own <= required_damping(0.0, damping, period, delay_samples):
        return 0.0
    # At the slowest hand the bound is K T (2d+1)/2 - B, and never less.
    most = 2.0 * (own + abs(damping)) / (period * (2 * delay_samples + 1))

    def lack(stiffness: float) -> float:
        return required_damping(stiffness, damping, period, delay_samples) - own

    return float(brentq(lack, 0.0, most * (1.0 + 1e-9), xtol=1e-12 * most))


def _largest(series: np.ndarray) -> float:
    """The largest value of a Chebyshev series between -1 and 1."""
    negligible = np.finfo(np.float64).eps * np.abs(series).max()
    turns = chebyshev.chebroots(chebyshev.chebder(chebyshev.chebtrim(series, negligible)))
    # A position that is no turn does no harm: its value is not above the largest.
    positions = np.clip(turns.real, -1.0, 1.0)
    return float(chebyshev.chebval(np.array([-1.0, 1.0, *positions]), series).max())
