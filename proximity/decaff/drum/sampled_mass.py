"""Stable stiffness and damping of a sampled force on a mass, such as a displayed wall or a position servo.

The plant is stepped exactly over a period of constant force. The edge of the stable region is known in closed
form (docs/science/stability.md).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from proximity.checks import positive, whole

ROOT_TOLERANCE = 1e-15  # rad, of h


@dataclass(frozen=True, slots=True)
class SampledMass:
    """A mass under a sampled force alone."""

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
        """Half angle h at which the stable region ends, rad."""
        return math.pi / (4.0 * (self.delay_samples + 1))


@dataclass(frozen=True, slots=True)
class Gains:
    """Stiffness and damping of a wall or a servo."""

    stiffness: float  # N/m
    damping: float  # N·s/m


def characteristic(device: SampledMass, stiffness: ArrayLike, damping: ArrayLike) -> np.ndarray:
    """Return coefficients of the characteristic polynomial, (..., d + 4), highest power first."""
    k, b = np.broadcast_arrays(
        np.asarray(stiffness, np.float64), np.asarray(damping, np.float64) / device.period
    )
    weight = 1.0 / device.stiffness_unit
    polynomial = np.zeros((*k.shape, device.delay_samples + 4))
    polynomial[..., :3] = 1.0, -2.0, 1.0
    for power in (-3, -2):
        polynomial[..., power] += weight * (k + b)
        polynomial[..., power + 1] -= weight * b
    return polynomial


def spectral_radius(polynomials: np.ndarray) -> np.ndarray:
    """Return the largest modulus of the roots of real polynomials, (...). Below one, disturbances die out."""
    power = polynomials.shape[-1] - 1
    companion = np.zeros((*polynomials.shape[:-1], power, power))
    companion[..., np.arange(1, power), np.arange(power - 1)] = 1.0
    companion[..., 0, :] = -polynomials[..., 1:] / polynomials[..., :1]
    return np.abs(np.linalg.eigvals(companion)).max(axis=-1)


def maximum_stiffness(device: SampledMass) -> Gains:
    """Return the largest stable stiffness, and the damping that makes all smaller ones stable too."""
    return gains_at(device, _stiffest_half_angle(device))


def damping_window(device: SampledMass, stiffness: float) -> tuple[float, float]:
    """Return the minimum and maximum damping of a stable wall, N·s/m, or nan if no damping is stable."""
    a = positive("stiffness", stiffness, "newtons a metre") / device.stiffness_unit
    stiffest = _stiffest_half_angle(device)
    if a > edge_at(device, stiffest)[0]:
        return math.nan, math.nan
    ends = (
        root_between(lambda h: edge_at(device, h)[0] - a, *bracket)
        for bracket in ((0.0, stiffest), (stiffest, device.last_half_angle))
    )
    low, high = (gains_at(device, half_angle).damping for half_angle in ends)
    return low, high


def edge_at(device: SampledMass, half_angle: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return a and b for which the polynomial has roots on the unit circle, at twice *half_angle*."""
    half_angle = np.asarray(half_angle)
    turned = 2.0 * (device.delay_samples + 1) * half_angle
    tangent = np.tan(half_angle)
    # At the end the cosine is that of a right angle, within rounding.
    a = np.where(half_angle < device.last_half_angle, 2.0 * tangent**2 * np.cos(turned), 0.0)
    return a, tangent * np.sin(turned) - 0.5 * a


def gains_at(device: SampledMass, half_angle: float) -> Gains:
    a, b = edge_at(device, half_angle)
    return Gains(float(a) * device.stiffness_unit, float(b) * device.damping_unit)


def _stiffest_half_angle(device: SampledMass) -> float:
    """Return the half angle h of maximum a, where 2 cos(nh) = n sin h cos h sin(nh) with n = 2d + 2."""
    n = 2.0 * (device.delay_samples + 1)

    def slope(h: float) -> float:
        return 2.0 * math.cos(n * h) - 0.5 * n * math.sin(2.0 * h) * math.sin(n * h)

    return root_between(slope, 0.0, device.last_half_angle)


def root_between(function: Callable[[float], Any], low: float, high: float) -> float:
    return float(brentq(function, low, high, xtol=ROOT_TOLERANCE))
