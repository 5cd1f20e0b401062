"""Geometry of the contact drum: the angle at which its roller touches the replica's link.

The replica is a straight link of some width that turns about the potentiometer, the origin. The roller is on
the side to which the link turns as the finger bends. Angles count from the same axis: ``replica`` of the
link, ``drum`` of the arm that carries the roller, as it would touch.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from proximity.checks import positive
from proximity.errors import ArgumentError


@dataclass(frozen=True, slots=True)
class ArmDrum:
    """A roller on an arm about the potentiometer's axis: linear; values assumed."""

    arm: float = 0.040  # m, from the axis to the roller's centre
    roller_radius: float = 0.006  # m
    link_width: float = 0.004  # m

    def __post_init__(self) -> None:
        positive("roller_radius", self.roller_radius, "metres")
        positive("link_width", self.link_width, "metres")
        if not positive("arm", self.arm, "metres") > self.clearance:
            raise ArgumentError(
                f"the arm is {1e3 * self.arm:g} mm, expected more than the roller's radius and half of the "
                f"link's width, {1e3 * self.clearance:g} mm"
            )

    @property
    def clearance(self) -> float:
        """Distance of the link's middle from the roller's centre as they touch, m."""
        return self.roller_radius + 0.5 * self.link_width

    @property
    def alpha(self) -> float:
        """Angle between arm and link as they touch, rad."""
        return math.asin(self.clearance / self.arm)

    def drum_angle(self, replica: ArrayLike) -> np.ndarray:
        """Return the angle of the drum as it touches the link, (...), rad."""
        return np.asarray(replica, np.float64) + self.alpha

    def lever(self, replica: ArrayLike) -> np.ndarray:
        """Return the distance of the roller's contact from the potentiometer, (...), m."""
        return np.full(np.shape(replica), self.arm * math.cos(self.alpha))
