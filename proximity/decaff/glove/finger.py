"""Model of a finger that bends in one plane with one degree of freedom.

The origin of its frame is the knuckle. The x axis points along the flat finger, y out of the back of the
hand, and z completes them. The finger stays in z = 0 and bends towards -y. Bend is 0 for the flat hand and 1
for the fist; all joints bend in proportion (docs/guide/drums.md). The formulas also hold outside of 0 to 1.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from proximity.checks import not_negative, positive
from proximity.errors import ArgumentError
from proximity.message import PATH_CORNERS
from proximity.pose import Pose

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(16)
"""Quadrature of lengths along the path. Sixteen nodes are exact to all digits over a whole bend."""


@dataclass(frozen=True, slots=True)
class Finger:
    """Three phalanges, their joints, and a round pad. The default values are assumed."""

    phalanges: tuple[float, float, float] = (0.045, 0.026, 0.020)  # m, from the knuckle
    # rad, of each joint at bend 1; the last joint bends two thirds of the middle one
    flexions: tuple[float, float, float] = (
        math.radians(80.0),
        math.radians(100.0),
        math.radians(200.0 / 3.0),
    )
    pad_radius: float = 0.007  # m, of the sphere about the fingertip that touches

    def __post_init__(self) -> None:
        _check_three("phalanges", self.phalanges, "metres")
        _check_three("flexions", self.flexions, "radians")
        not_negative("pad_radius", self.pad_radius, "metres")

    def point(self, bend: ArrayLike, along: float = 1.0, dorsal: float = 0.0) -> np.ndarray:
        """Return a point that moves with the distal phalanx, (..., 2), m. The default is the fingertip."""
        angles, lengths = self._link_angles(bend), self._lengths(along)
        c, s = np.cos(angles), np.sin(angles)
        x = (lengths * c).sum(axis=-1) - dorsal * s[..., 2]
        y = (lengths * s).sum(axis=-1) + dorsal * c[..., 2]
        return np.stack([x, y], axis=-1)

    def point_rate(self, bend: ArrayLike, along: float = 1.0, dorsal: float = 0.0) -> np.ndarray:
        """Return the derivative of `point` with respect to the bend, (..., 2), m."""
        angles, lengths = self._link_angles(bend), self._lengths(along)
        turns = -np.cumsum(self.flexions)  # of the link angles, per bend
        c, s = np.cos(angles), np.sin(angles)
        x = -(lengths * turns * s).sum(axis=-1) - dorsal * turns[2] * c[..., 2]
        y = (lengths * turns * c).sum(axis=-1) - dorsal * turns[2] * s[..., 2]
        return np.stack([x, y], axis=-1)

    def speed(self, bend: ArrayLike) -> np.ndarray:
        """Return the displacement of the fingertip per bend, (...), m."""
        rate = self.point_rate(bend)
        return np.hypot(rate[..., 0], rate[..., 1])

    def path_length(self, start: ArrayLike, end: ArrayLike) -> np.ndarray:
        """Return the fingertip's path length between two bends, (...), m, which is negative when opening."""
        first, last = np.asarray(start, np.float64)[..., None], np.asarray(end, np.float64)[..., None]
        half = 0.5 * (last - first)
        speeds = self.speed(0.5 * (first + last) + half * GAUSS_NODES)
        return (half * speeds * GAUSS_WEIGHTS).sum(axis=-1)

    def path_world(self, world_from_hand: Pose, corner_count: int = PATH_CORNERS) -> np.ndarray:
        """Return the fingertip's path from flat hand to fist at evenly spaced bends as a polyline, (K, 3), m.

        This is the path of `Tracker.tick` and of a ``path_poses`` message.
        """
        if corner_count < 2:
            raise ArgumentError(f"a path of {corner_count} corners, expected 2 or more")
        return world_from_hand.point(self.point_hand(np.linspace(0.0, 1.0, corner_count)))

    def point_hand(self, bend: ArrayLike) -> np.ndarray:
        """Return the fingertip in three dimensions, (..., 3), m, hand frame."""
        points = self.point(bend)
        return np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)

    def contact_bend(self, bend: ArrayLike, distance: ArrayLike, normal: ArrayLike) -> np.ndarray:
        """Return the bend at which the pad touches, ``b + d / (-n . p')``, (...), from a single distance.

        The distance is divided by the cosine of incidence, as the raw distance is wrong at first order. The
        remaining error grows with the square of the distance along the path. The result is nan if bending
        moves the fingertip away from the surface or along it.
        """
        position = np.asarray(bend, np.float64)
        closing = -(np.asarray(normal, np.float64)[..., :2] * self.point_rate(position)).sum(axis=-1)
        away = ~(closing > 0.0)
        step = np.asarray(distance, np.float64) / np.where(away, np.nan, closing)
        return np.asarray(position + step)

    def _link_angles(self, bend: ArrayLike) -> np.ndarray:
        """Return the angles of the phalanges from the x axis, (..., 3), rad."""
        return -np.asarray(bend, np.float64)[..., None] * np.cumsum(self.flexions)

    def _lengths(self, along: float) -> np.ndarray:
        return np.array([self.phalanges[0], self.phalanges[1], along * self.phalanges[2]])


def _check_three(name: str, values: tuple[float, float, float], unit: str) -> None:
    if len(values) != 3:
        raise ArgumentError(f"{name} are {values!r}, expected three numbers of {unit}")
    for value in values:
        positive(f"one of {name}", value, unit)
