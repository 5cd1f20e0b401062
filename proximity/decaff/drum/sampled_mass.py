"""Stable stiffness and damping of a sampled force on a mass, free or held by a spring and a damper.

The plant is stepped exactly over a period of constant force. The edge of the stable region of a free mass is
known in closed form. For any other it follows from where a root of the characteristic polynomial reaches the
unit circle.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

from proximity.checks import not_negative, positive, whole
from proximity.decaff.drum.unit_circle import crossings, spectral_radius
from proximity.errors import ArgumentError

ROOT_TOLERANCE = 1e-15  # rad, of h
DAMPINGS = 32  # that are tried in each range before the best is refined


@dataclass(frozen=True, slots=True)
class SampledMass:
    """A mass that feels a sampled force, with a damper and a spring of its own if it is not free."""

    mass: float = 0.7  # kg, of Salcudean and Vlaar's device
    period: float = 0.005  # s
    delay_samples: int = 1  # d; one is built into equation (1)
    damping: float = 0.0  # N·s/m, its own
    stiffness: float = 0.0  # N/m, its own

    def __post_init__(self) -> None:
        positive("mass", self.mass, "kilograms")
        positive("period", self.period, "seconds")
        whole("delay_samples", self.delay_samples, 0)
        not_negative("damping", self.damping, "newton seconds a metre")
        not_negative("stiffness", self.stiffness, "newtons a metre")

    @property
    def stiffness_unit(self) -> float:
        """Stiffness at a = 1, N/m."""
        return 2.0 * self.mass / self.period**2

    @property
    def damping_unit(self) -> float:
        """Damping at b = 1, N·s/m."""
        return 2.0 * self.mass / self.period

    @property
    def is_free(self) -> bool:
        """Whether the mass has neither damper nor spring."""
        return self.damping == self.stiffness == 0.0

    @property
    def last_half_angle(self) -> float:
        """The h at which the region of a free mass ends, rad."""
        if not self.is_free:
            raise ArgumentError(
                f"the mass has {self.damping:g} N·s/m and {self.stiffness:g} N/m of its own, expected none"
            )
        return math.pi / (4.0 * (self.delay_samples + 1))

    def transfer(self) -> tuple[np.ndarray, np.ndarray]:
        """Return position over force from sample to sample, (2,) over (3,), powers of z, highest first."""
        if self.is_free:
            return np.full(2, 1.0 / self.stiffness_unit), np.array([1.0, -2.0, 1.0])
        held = np.zeros((3, 3))  # position, speed, force
        held[0, 1] = 1.0
        held[1] = -self.stiffness / self.mass, -self.damping / self.mass, 1.0 / self.mass
        step = expm(held * self.period)
        a, b = step[:2, :2], step[:2, 2]
        numerator = np.array([b[0], a[0, 1] * b[1] - a[1, 1] * b[0]])
        return numerator, np.array([1.0, -np.trace(a), np.linalg.det(a)])


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
    numerator, denominator = device.transfer()
    polynomial = np.zeros((*k.shape, device.delay_samples + 4))
    polynomial[..., :3] = denominator
    for power, weight in zip((-3, -2), numerator, strict=True):
        polynomial[..., power] += weight * (k + b)
        polynomial[..., power + 1] -= weight * b
    return polynomial


def stiffness_limit(device: SampledMass, damping: float) -> float:
    """Return the stiffness up to which every wall of some damping is stable, N/m; 0 where none is."""
    without = characteristic(device, 0.0, not_negative("damping", damping, "newton seconds a metre"))
    return _stiffness_at_loss(without, characteristic(device, 1.0, damping) - without)


def maximum_stiffness(device: SampledMass) -> Gains:
    """Return the largest stiffness up to which all walls of one damping are stable, and that damping.

    Notes
    -----
    Walls of negative damping are not looked at. Of a device with a spring or a damper of its own, dampings
    are tried in every range in which walls with next to no stiffness are stable.
    """
    if device.is_free:
        return gains_at(device, _stiffest_half_angle(device))
    plain = characteristic(device, 0.0, 0.0)
    of_stiffness = characteristic(device, 1.0, 0.0) - plain
    of_damping = characteristic(device, 0.0, 1.0) - plain

    def limit(damping: float) -> float:
        return _stiffness_at_loss(plain + damping * of_damping, of_stiffness)

    # Between two of these, walls with next to no stiffness are either all stable or all not.
    turns = crossings(plain, of_damping)
    edges = np.append(0.0, turns[turns > 0.0])
    best = Gains(0.0, 0.0)
    for low, high in itertools.pairwise(edges.tolist()):
        if limit(0.5 * (low + high)) > 0.0:
            best = max(best, _highest(limit, low, high), key=lambda gains: gains.stiffness)
    return best


def _highest(limit: Callable[[float], float], low: float, high: float) -> Gains:
    """The largest stiffness between two dampings: the best of some, refined."""
    dampings = np.linspace(low, high, DAMPINGS)
    limits = [limit(damping) for damping in dampings]
    best = int(np.argmax(limits))
    found = minimize_scalar(
        lambda damping: -limit(damping),
        bounds=(dampings[max(best - 1, 0)], dampings[min(best + 1, DAMPINGS - 1)]),
        method="bounded",
        options={"xatol": 1e-10 * high},
    )
    if -found.fun > limits[best]:
        return Gains(float(-found.fun), float(found.x))
    return Gains(float(limits[best]), float(dampings[best]))


def _stiffness_at_loss(without: np.ndarray, of_stiffness: np.ndarray) -> float:
    """The first stiffness above zero that puts a root on the unit circle; 0 if walls below are not stable."""
    reached = crossings(without, of_stiffness)
    first = float(min(reached[reached > 0.0], default=0.0))
    return first if first > 0.0 and spectral_radius(without + 0.5 * first * of_stiffness) < 1.0 else 0.0


def damping_window(device: SampledMass, stiffness: float) -> tuple[float, float]:
    """Return the damping from which on and up to which a wall is stable, N·s/m; nan where there is none."""
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
    """a and b where the roots reach the unit circle at twice the angle."""
    half_angle = np.asarray(half_angle)
    turned = 2.0 * (device.delay_samples + 1) * half_angle
    tangent = np.tan(half_angle)
    # At the end the cosine is that of a right angle, but for rounding.
    a = np.where(half_angle < device.last_half_angle, 2.0 * tangent**2 * np.cos(turned), 0.0)
    return a, tangent * np.sin(turned) - 0.5 * a


def gains_at(device: SampledMass, half_angle: float) -> Gains:
    a, b = edge_at(device, half_angle)
    return Gains(float(a) * device.stiffness_unit, float(b) * device.damping_unit)


def _stiffest_half_angle(device: SampledMass) -> float:
    """Angle at which a has its maximum: 2 cos(nh) = n sin h cos h sin(nh), n = 2d + 2."""
    n = 2.0 * (device.delay_samples + 1)

    def slope(h: float) -> float:
        return 2.0 * math.cos(n * h) - 0.5 * n * math.sin(2.0 * h) * math.sin(n * h)

    return root_between(slope, 0.0, device.last_half_angle)


def root_between(function: Callable[[float], Any], low: float, high: float) -> float:
    return float(brentq(function, low, high, xtol=ROOT_TOLERANCE))
