"""The sampled wall of equation (1), held by a mass: which stiffness and damping it may have.

A mass feels a force that is held for a period and was computed from positions some samples old; the damping
is from the difference of two of them. Equation (1) itself has one sample of delay. The same formulas bound
a position servo, as that of the drum: a servo is such a wall.

With a = k T²/2m and b = B T/2m the characteristic polynomial is z^(d+1) (z-1)² + (z+1) ((a+b) z - b). It
has roots at exp(±2jh) for a = 2 tan²h cos((2d+2)h), b = tan h sin((2d+2)h) - a/2; the stable region is what
this curve and a = 0 enclose for h from 0 to pi/(4(d+1)).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from proximity.decaff.arguments import finite, not_negative, positive, whole
from proximity.decaff.unit_circle import spectral_radius

ROOT_TOLERANCE = 1e-15  # rad, of h


@dataclass(frozen=True, slots=True)
class SampledMass:
    """A mass that feels a sampled force."""

    mass: float = 0.7  # kg, of Salcudean and Vlaar's device
    period: float = 0.005  # s
    delay_samples: int = 1  # d; one is built into equation (1)

    def __post_init__(self) -> None:
        positive("mass", self.mass, "kilograms")
        positive("period", self.period, "seconds")
        whole("delay_samples", self.delay_samples, 0)

    @property
    def stiffness_unit(self) -> float:
        """Stiffness at a = 1, N/m."""
        return 2.0 * self.mass / self.period**2

    @property
    def damping_unit(self) -> float:
        """Damping at b = 1, N·s/m."""
        return 2.0 * self.mass / self.period

    @property
    def last_half_angle(self) -> float:
        """The h at which the region ends, rad."""
        return math.pi / (4.0 * (self.delay_samples + 1))


@dataclass(frozen=True, slots=True)
class Gains:
    """What a wall or a servo is told to be."""

    stiffness: float  # N/m
    damping: float  # N·s/m


class Verdict(StrEnum):
    """Why a sampled wall is stable or not: what Love and Book say destabilises it."""

    STABLE = "stable"
    TOO_STIFF = "too stiff for any damping"
    TOO_LITTLE_DAMPING = "too little damping"
    TOO_MUCH_DAMPING = "too much damping"


def characteristic(device: SampledMass, stiffness: ArrayLike, damping: ArrayLike) -> np.ndarray:
    """Return coefficients of the characteristic polynomial, (..., d + 4), highest power first.

    Parameters
    ----------
    device : SampledMass
        Of d samples of delay.
    stiffness : (...) float64, N/m
        Of the wall.
    damping : (...) float64, N·s/m
        Of the wall; broadcast with the stiffness.
    """
    a, b = np.broadcast_arrays(
        np.asarray(stiffness, np.float64) / device.stiffness_unit,
        np.asarray(damping, np.float64) / device.damping_unit,
    )
    polynomial = np.zeros((*a.shape, device.delay_samples + 4))
    polynomial[..., :3] = 1.0, -2.0, 1.0
    polynomial[..., -3] += a + b
    polynomial[..., -2] += a
    polynomial[..., -1] -= b
    return polynomial


def is_stable(device: SampledMass, stiffness: ArrayLike, damping: ArrayLike) -> np.ndarray:
    """Return whether disturbances die out, (...) bool, by the roots.

    Parameters
    ----------
    device, stiffness, damping
        As of `characteristic`.
    """
    return spectral_radius(characteristic(device, stiffness, damping)) < 1.0


def boundary(device: SampledMass, count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Return the edge of the stable region: stiffness (count,), N/m, and damping (count,), N·s/m.

    Parameters
    ----------
    device : SampledMass
        Of d samples of delay.
    count : int
        How many points, from no stiffness and no damping to no stiffness and the largest damping.
    """
    half_angle = np.linspace(0.0, device.last_half_angle, whole("count", count, 2))
    a, b = _edge(device, half_angle)
    return a * device.stiffness_unit, b * device.damping_unit


def maximum_stiffness(device: SampledMass) -> Gains:
    """Return the largest stiffness of a stable wall, and the one damping at which it is reached.

    Parameters
    ----------
    device : SampledMass
        Of d samples of delay.
    """
    return _gains(device, _stiffest_half_angle(device))


def largest_damping(device: SampledMass) -> float:
    """Return the largest damping of a stable wall, of a stiffness near zero, N·s/m.

    Parameters
    ----------
    device : SampledMass
        Of d samples of delay.
    """
    return math.tan(device.last_half_angle) * device.damping_unit


def stiffness_limit(device: SampledMass, damping: float) -> float:
    """Return the stiffness up to which a wall of some damping is stable, N/m; 0 where there is none.

    Parameters
    ----------
    device : SampledMass
        Of d samples of delay.
    damping : float, N·s/m
        Of the wall.

    Raises
    ------
    DecaffError
        If the damping is negative or not finite.
    """
    b = not_negative("damping", damping, "newton seconds a metre") / device.damping_unit
    if not 0.0 < b < math.tan(device.last_half_angle):
        return 0.0
    half_angle = _root(lambda h: _edge(device, h)[1] - b, 0.0, device.last_half_angle)
    return _gains(device, half_angle).stiffness


def damping_window(device: SampledMass, stiffness: float) -> tuple[float, float]:
    """Return the damping from which on and up to which a wall is stable, N·s/m; nan where there is none.

    Parameters
    ----------
    device : SampledMass
        Of d samples of delay.
    stiffness : float, N/m
        Of the wall.

    Raises
    ------
    DecaffError
        If the stiffness is not positive and finite.
    """
    a = positive("stiffness", stiffness, "newtons a metre") / device.stiffness_unit
    stiffest = _stiffest_half_angle(device)
    if a > _edge(device, stiffest)[0]:
        return math.nan, math.nan
    ends = (
        _root(lambda h: _edge(device, h)[0] - a, *bracket)
        for bracket in ((0.0, stiffest), (stiffest, device.last_half_angle))
    )
    low, high = (_gains(device, half_angle).damping for half_angle in ends)
    return low, high


def verdict(device: SampledMass, gains: Gains) -> Verdict:
    """Return whether a wall is stable, and if not, what is wrong with it.

    Parameters
    ----------
    device : SampledMass
        Of d samples of delay.
    gains : Gains
        Of the wall.

    Raises
    ------
    DecaffError
        If the stiffness is not positive and finite, or the damping not finite.
    """
    low, high = damping_window(device, gains.stiffness)
    damping = finite("damping", gains.damping, "newton seconds a metre")
    if math.isnan(low):
        return Verdict.TOO_STIFF
    if damping <= low:
        return Verdict.TOO_LITTLE_DAMPING
    return Verdict.TOO_MUCH_DAMPING if damping >= high else Verdict.STABLE


def slowest_period(mass: float, gains: Gains, delay_samples: int = 1) -> float:
    """Return the period up to which a wall is stable, s: with any damping, sampling faster restores it.

    Parameters
    ----------
    mass : float, kg
        Of the device.
    gains : Gains
        Of the wall.
    delay_samples : int
        d.

    Raises
    ------
    DecaffError
        If the stiffness or the damping is not positive and finite.
    """
    stiffness = positive("stiffness", gains.stiffness, "newtons a metre")
    damping = positive("damping", gains.damping, "newton seconds a metre")
    device = SampledMass(mass, 1.0, delay_samples)
    # a/b² does not depend on the period; along the edge it falls from infinity to zero.
    ratio = 2.0 * mass * stiffness / damping**2

    # From near its start, where a = 2h² and b = (2d+1)h².
    start = min(0.1 * math.sqrt(2.0 / ratio) / (2 * delay_samples + 1), 0.1 * device.last_half_angle)

    def left(half_angle: float) -> float:
        a, b = _edge(device, half_angle)
        return float(a - ratio * b**2)

    b = _edge(device, _root(left, start, device.last_half_angle))[1]
    return float(b) * 2.0 * mass / damping


def _edge(device: SampledMass, half_angle: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """a and b where the roots reach the unit circle at twice the angle."""
    half_angle = np.asarray(half_angle)
    turned = 2.0 * (device.delay_samples + 1) * half_angle
    tangent = np.tan(half_angle)
    # At the end the cosine is that of a right angle, but for rounding.
    a = np.where(half_angle < device.last_half_angle, 2.0 * tangent**2 * np.cos(turned), 0.0)
    return a, tangent * np.sin(turned) - 0.5 * a


def _gains(device: SampledMass, half_angle: float) -> Gains:
    a, b = _edge(device, half_angle)
    return Gains(float(a) * device.stiffness_unit, float(b) * device.damping_unit)


def _stiffest_half_angle(device: SampledMass) -> float:
    """Where a has its maximum: 2 cos(nh) = n sin h cos h sin(nh), n = 2d + 2."""
    n = 2.0 * (device.delay_samples + 1)

    def slope(h: float) -> float:
        return 2.0 * math.cos(n * h) - 0.5 * n * math.sin(2.0 * h) * math.sin(n * h)

    return _root(slope, 0.0, device.last_half_angle)


def _root(function: Callable[[float], Any], low: float, high: float) -> float:
    return float(brentq(function, low, high, xtol=ROOT_TOLERANCE))
