"""Stability of the sampled wall of equation (1) on a device with damping and stiffness of its own.

The finger is stepped exactly over a period of constant force. Where the roots reach the unit circle,
stiffness and damping of the wall follow from the angle, as they do for a free mass.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

from proximity.decaff.arguments import not_negative, positive, whole
from proximity.decaff.drum.sampled_mass import Gains
from proximity.decaff.drum.unit_circle import spectral_radius
from proximity.studies.paper.spring_damper import FINGER, SpringDamper

ANGLES_PER_SAMPLE = 256  # of the edge, for each sample of memory
DAMPINGS = 128  # that are tried before the best is refined


@dataclass(frozen=True, slots=True)
class SampledFinger:
    """A finger and the device on it, which feel a sampled force together."""

    finger: SpringDamper = FINGER  # the mass that of both
    period: float = 0.001  # s
    delay_samples: int = 1  # d; one is built into equation (1)

    def __post_init__(self) -> None:
        positive("mass", self.finger.mass, "kilograms")
        positive("period", self.period, "seconds")
        whole("delay_samples", self.delay_samples, 0)

    def transfer(self) -> tuple[np.ndarray, np.ndarray]:
        """Return position over force from sample to sample, (2,) over (3,), powers of z, highest first."""
        mass, period = self.finger.mass, self.period
        held = np.zeros((3, 3))  # position, speed, force
        held[0, 1] = 1.0
        held[1] = -self.finger.stiffness / mass, -self.finger.damping / mass, 1.0 / mass
        step = expm(held * period)
        a, b = step[:2, :2], step[:2, 2]
        numerator = np.array([b[0], a[0, 1] * b[1] - a[1, 1] * b[0]])
        return numerator, np.array([1.0, -np.trace(a), np.linalg.det(a)])


def characteristic(plant: SampledFinger, stiffness: ArrayLike, damping: ArrayLike) -> np.ndarray:
    """Return coefficients of the characteristic polynomial, (..., d + 4), highest power first.

    Parameters
    ----------
    plant : SampledFinger
        Of d samples of delay.
    stiffness : (...) float64, N/m
        Of the wall.
    damping : (...) float64, N·s/m
        Of the wall; broadcast with the stiffness.
    """
    k, b = np.broadcast_arrays(
        np.asarray(stiffness, np.float64), np.asarray(damping, np.float64) / plant.period
    )
    numerator, denominator = plant.transfer()
    polynomial = np.zeros((*k.shape, plant.delay_samples + 4))
    polynomial[..., :3] = denominator
    for power, weight in zip((-3, -2), numerator, strict=True):
        polynomial[..., power] += weight * (k + b)
        polynomial[..., power + 1] -= weight * b
    return polynomial


def stiffness_limit(plant: SampledFinger, damping: float) -> float:
    """Return the stiffness up to which a wall of some damping is stable, N/m; 0 where there is none.

    Parameters
    ----------
    plant : SampledFinger
        What feels it.
    damping : float, N·s/m
        Of the wall; may be zero.

    Raises
    ------
    DecaffError
        If the damping is negative or not finite.
    """
    return _Edge(plant).stiffness_limit(not_negative("damping", damping, "newton seconds a metre"))


def maximum_stiffness(plant: SampledFinger) -> Gains:
    """Return the largest stiffness of a stable wall, and the damping at which it is reached.

    Notes
    -----
    Walls of negative damping are not looked at.
    """
    edge = _Edge(plant)
    dampings = np.linspace(0.0, edge.largest_damping(), DAMPINGS)
    limits = [edge.stiffness_limit(damping) for damping in dampings]
    best = int(np.argmax(limits))
    found = minimize_scalar(
        lambda damping: -edge.stiffness_limit(damping),
        bounds=(dampings[max(best - 1, 0)], dampings[min(best + 1, DAMPINGS - 1)]),
        method="bounded",
        options={"xatol": 1e-10 * dampings[-1]},
    )
    if -found.fun > limits[best]:
        return Gains(float(-found.fun), float(found.x))
    return Gains(limits[best], float(dampings[best]))


class _Edge:
    """Edge of the stable region: roots on the unit circle, at an angle to either side or at -1."""

    def __init__(self, plant: SampledFinger) -> None:
        self._plant = plant
        self._numerator, self._denominator = plant.transfer()
        count = ANGLES_PER_SAMPLE * (plant.delay_samples + 3)
        self._angles = np.linspace(0.0, math.pi, count + 1)[1:-1]
        self._stiffness, self._damping = self._at(self._angles)
        # At -1: stiffness + 2 damping / period
        self._alternating = -self._needed(-1.0 + 0.0j).real

    def _needed(self, z: np.ndarray | complex) -> np.ndarray:
        """The negative of what stiffness and damping must make together at z."""
        delayed = np.power(z, self._plant.delay_samples)
        return delayed * np.polyval(self._denominator, z) / np.polyval(self._numerator, z)

    def _at(self, angles: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        needed = self._needed(np.exp(1j * np.asarray(angles)))
        difference = -needed.imag / np.sin(angles)  # damping over period
        return -needed.real - difference * (1.0 - np.cos(angles)), difference * self._plant.period

    def stiffness_limit(self, damping: float) -> float:
        """The first stiffness above zero at which a root is on the circle; 0 if one is without stiffness."""
        if not spectral_radius(characteristic(self._plant, 0.0, damping)) < 1.0:
            return 0.0
        crossed = self._first(0, self._damping - damping, lambda angle: self._at(angle)[1] - damping)
        alternating = self._alternating - 2.0 * damping / self._plant.period
        return float(min((each for each in (crossed, alternating) if 0.0 < each < math.inf), default=0.0))

    def largest_damping(self) -> float:
        """The first damping at which a wall without stiffness has a root on the circle."""
        crossed = self._first(1, self._stiffness, lambda angle: self._at(angle)[0])
        alternating = 0.5 * self._alternating * self._plant.period
        return float(min(each for each in (crossed, alternating) if each > 0.0))

    def _first(self, which: int, values: np.ndarray, function: Callable[[float], Any]) -> float:
        """The least stiffness (0) or damping (1) above zero where a function is zero; inf if nowhere.

        *values* are the function's along the edge. Its zeros are guessed from them, and the first one found.
        """
        edges = np.flatnonzero(np.signbit(values[:-1]) != np.signbit(values[1:]))
        sought = (self._stiffness, self._damping)[which]
        weight = values[edges] / (values[edges] - values[edges + 1])
        guesses = (1.0 - weight) * sought[edges] + weight * sought[edges + 1]
        edges, guesses = edges[guesses > 0.0], guesses[guesses > 0.0]
        if len(edges) == 0:
            return math.inf
        edge = edges[np.argmin(guesses)]
        angle = brentq(function, self._angles[edge], self._angles[edge + 1])
        return float(self._at(angle)[which])
