"""Geometry of the contact drum: the angle at which its roller touches the replica's link, and its inverse.

The replica is a straight link of some width that turns about the potentiometer, the origin. The roller
stands on the side that the link turns to as the finger bends. Angles count from the same axis: ``replica``
of the link, ``drum`` of the arm or crank that carries the roller, as it would touch.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from proximity.checks import finite, positive
from proximity.errors import ArgumentError


@dataclass(frozen=True, slots=True)
class ArmDrum:
    """A roller on an arm about the potentiometer's axis: linear; values assumed."""

    arm: float = 0.040  # m, from the axis to the roller's centre
    roller_radius: float = 0.006  # m
    link_width: float = 0.004  # m

    def __post_init__(self) -> None:
        _check_roller(self.roller_radius, self.link_width)
        if not positive("arm", self.arm, "metres") > self.clearance:
            raise ArgumentError(
                f"the arm is {1e3 * self.arm:g} mm, expected more than the roller's radius and half of the "
                f"link's width, {1e3 * self.clearance:g} mm"
            )

    @property
    def clearance(self) -> float:
        """Between the link's middle and the roller's centre as they touch, m."""
        return self.roller_radius + 0.5 * self.link_width

    @property
    def alpha(self) -> float:
        """Angle between arm and link as they touch, rad."""
        return math.asin(self.clearance / self.arm)

    def drum_angle(self, replica: ArrayLike) -> np.ndarray:
        """Return where the drum stands as it touches the link, (...), rad."""
        return np.asarray(replica, np.float64) + self.alpha

    def drum_rate(self, replica: ArrayLike) -> np.ndarray:
        """Return how far the drum turns a radian of the replica, (...): 1."""
        return np.ones(np.shape(replica))

    def lever(self, replica: ArrayLike) -> np.ndarray:
        """Return how far from the potentiometer the roller touches, (...), m."""
        return np.full(np.shape(replica), self.arm * math.cos(self.alpha))

    def motor_lever(self, replica: ArrayLike) -> np.ndarray:
        """Return the torque of the motor a newton of contact force, (...), m."""
        return self.lever(replica)


@dataclass(frozen=True, slots=True)
class EccentricDrum:
    """A roller on a crank about a motor beside the replica; the values are assumed.

    Near a right angle between crank and link the drum locks itself: it holds with little torque, but must
    turn far to arrive.
    """

    motor: tuple[float, float] = (0.025, 0.022)  # m, the crank's axis
    crank: float = 0.026  # m, from there to the roller's centre
    roller_radius: float = 0.006  # m
    link_width: float = 0.004  # m

    def __post_init__(self) -> None:
        _check_roller(self.roller_radius, self.link_width)
        positive("crank", self.crank, "metres")
        if len(self.motor) != 2:
            raise ArgumentError(f"motor is {self.motor!r}, expected two numbers of metres")
        for value in self.motor:
            finite("one of motor", value, "metres")

    @property
    def clearance(self) -> float:
        """Between the link's middle and the roller's centre as they touch, m."""
        return self.roller_radius + 0.5 * self.link_width

    def drum_angle(self, replica: ArrayLike) -> np.ndarray:
        """Return where the drum stands as it touches the link, (...), rad; nan where it cannot."""
        phi = np.asarray(replica, np.float64)
        with np.errstate(invalid="ignore"):
            return phi + np.arcsin(self._sine(phi))

    def drum_rate(self, replica: ArrayLike) -> np.ndarray:
        """Return how far the drum turns a radian of the replica, (...); infinite where it locks."""
        with np.errstate(divide="ignore"):
            return self.lever(replica) / self.motor_lever(replica)

    def lever(self, replica: ArrayLike) -> np.ndarray:
        """Return how far from the potentiometer the roller touches, (...), m; nan where it cannot."""
        phi = np.asarray(replica, np.float64)
        return self.motor[0] * np.cos(phi) + self.motor[1] * np.sin(phi) + self.motor_lever(phi)

    def motor_lever(self, replica: ArrayLike) -> np.ndarray:
        """Return the torque of the motor a newton of contact force, (...), m; 0 where it locks."""
        sine = self._sine(np.asarray(replica, np.float64))
        with np.errstate(invalid="ignore"):
            return self.crank * np.sqrt((1.0 - sine) * (1.0 + sine))

    def _sine(self, phi: np.ndarray) -> np.ndarray:
        """Sine of the angle between crank and link."""
        return (self.clearance + self.motor[0] * np.sin(phi) - self.motor[1] * np.cos(phi)) / self.crank


DrumGeometry = ArmDrum | EccentricDrum


def _check_roller(radius: float, width: float) -> None:
    positive("roller_radius", radius, "metres")
    positive("link_width", width, "metres")
