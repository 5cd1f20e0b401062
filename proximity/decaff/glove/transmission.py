"""Transmission from hand to replica by a linkage, a sheathed cable on two pulleys, and a potentiometer.

The base of the linkage is fixed to the back of the hand, in the finger's frame (see `finger`). The first of
two bars turns about the base. The second bar connects the first to the thimble on the distal phalanx. The
elbow is on the dorsal side.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline

from proximity.checks import finite, not_negative, positive, whole
from proximity.decaff.glove.finger import Finger
from proximity.errors import ArgumentError


@dataclass(frozen=True, slots=True)
class Cable:
    """Cable that is pulled by the linkage and followed by the replica. The default values are assumed."""

    hand_pulley: float = 0.020  # m, radius
    replica_pulley: float = 0.030  # m, radius
    stiffness: float = 20e3  # N/m, sheath included
    backlash: float = 0.0  # m of cable, lost at a reversal

    def __post_init__(self) -> None:
        positive("hand_pulley", self.hand_pulley, "metres")
        positive("replica_pulley", self.replica_pulley, "metres")
        positive("stiffness", self.stiffness, "newtons a metre", may_be_infinite=True)
        not_negative("backlash", self.backlash, "metres")

    def replica_turn(
        self, hand_turn: ArrayLike, tension: ArrayLike = 0.0, *, is_closing: ArrayLike = True
    ) -> np.ndarray:
        """Return the turn of the replica from the flat hand, (...), rad."""
        lost = np.asarray(tension, np.float64) / self.stiffness + np.where(is_closing, self.backlash, 0.0)
        return (self.hand_pulley * np.asarray(hand_turn, np.float64) - lost) / self.replica_pulley

    def hand_turn(
        self, replica_turn: ArrayLike, tension: ArrayLike = 0.0, *, is_closing: ArrayLike = True
    ) -> np.ndarray:
        """Return the turn of the hand's pulley, (...), rad. This is the inverse of `replica_turn`."""
        lost = np.asarray(tension, np.float64) / self.stiffness + np.where(is_closing, self.backlash, 0.0)
        return (self.replica_pulley * np.asarray(replica_turn, np.float64) + lost) / self.hand_pulley


@dataclass(frozen=True, slots=True)
class Potentiometer:
    """Sensor of the replica's angle. Its counts are evenly spaced over its span."""

    bits: int = 16  # 12 are too coarse: 0.14 mm a count
    span: float = math.radians(270.0)  # rad
    zero_share: float = 1.0 / 3.0  # share of the span at angle 0: the middle third is used; assumed

    def __post_init__(self) -> None:
        if whole("bits", self.bits, 1) > 32:
            raise ArgumentError(f"bits is {self.bits!r}, expected 1 to 32")
        positive("span", self.span, "radians")
        if not not_negative("zero_share", self.zero_share, "spans") < 1.0:
            raise ArgumentError(f"zero_share is {self.zero_share!r}, expected less than 1")

    @property
    def count(self) -> int:
        """Number of different readings, which begin at 0."""
        return 1 << self.bits

    @property
    def gain(self) -> float:
        """Counts per radian."""
        return self.count / self.span

    def counts(self, angle: ArrayLike) -> np.ndarray:
        """Return the counts at an angle, (...), float64, neither rounded nor limited."""
        return self.count * self.zero_share + self.gain * np.asarray(angle, np.float64)

    def read(self, angle: ArrayLike) -> np.ndarray:
        """Return the reading at an angle, (...), int64, which is the nearest count within the span."""
        return np.clip(np.rint(self.counts(angle)), 0, self.count - 1).astype(np.int64)

    def angle(self, counts: ArrayLike) -> np.ndarray:
        """Return the angle at which counts are read, (...), rad."""
        return (np.asarray(counts, np.float64) - self.count * self.zero_share) / self.gain


CHECKED_BENDS = np.linspace(0.0, 1.0, 1001)


@dataclass(frozen=True, slots=True)
class Linkage:
    """Anchor and bars of the linkage. The default values are assumed."""

    base: tuple[float, float] = (0.025, 0.015)  # m
    first_bar: float = 0.085  # m
    second_bar: float = 0.065  # m
    thimble_along: float = 0.5  # share of the distal phalanx
    thimble_dorsal: float = 0.010  # m off the phalanx

    def __post_init__(self) -> None:
        positive("first_bar", self.first_bar, "metres")
        positive("second_bar", self.second_bar, "metres")
        if len(self.base) != 2:
            raise ArgumentError(f"base is {self.base!r}, expected two numbers of metres")
        for value in (*self.base, self.thimble_along, self.thimble_dorsal):
            finite("one of base and thimble", value, "metres")

    def reach(self, finger: Finger, bend: ArrayLike) -> np.ndarray:
        """Return the distance of the thimble from the base, (...), m."""
        offset = self._offset(finger, bend)
        return np.hypot(offset[..., 0], offset[..., 1])

    def angle(self, finger: Finger, bend: ArrayLike) -> np.ndarray:
        """Return the angle of the first bar, (...), rad, or nan if the bars are too short."""
        offset = self._offset(finger, bend)
        reach = np.hypot(offset[..., 0], offset[..., 1])
        with np.errstate(invalid="ignore"):
            elbow = np.arccos(self._elbow_cosine(reach))
        return np.arctan2(offset[..., 1], offset[..., 0]) + elbow

    def angle_rate(self, finger: Finger, bend: ArrayLike) -> np.ndarray:
        """Return the derivative of `angle` with respect to the bend, (...), rad."""
        offset = self._offset(finger, bend)
        rate = finger.point_rate(bend, self.thimble_along, self.thimble_dorsal)
        reach = np.hypot(offset[..., 0], offset[..., 1])
        reach_rate = (offset * rate).sum(axis=-1) / reach
        turn = (offset[..., 0] * rate[..., 1] - offset[..., 1] * rate[..., 0]) / reach**2
        cosine = self._elbow_cosine(reach)
        cosine_rate = 1.0 / self.first_bar - cosine / reach
        with np.errstate(invalid="ignore", divide="ignore"):
            return turn - cosine_rate * reach_rate / np.sqrt(1.0 - cosine**2)

    def turn(self, finger: Finger, bend: ArrayLike) -> np.ndarray:
        """Return the turn of the first bar from the flat hand, (...), rad, positive for a bending finger.

        Outside of bends from 0 to 1 it is extrapolated linearly, as linkages may not reach there, and a hand
        may bend a little farther than when it was measured.
        """
        position = np.asarray(bend, np.float64)
        inside = np.clip(position, 0.0, 1.0)
        turned = np.abs(self.angle(finger, inside) - _measured(self, finger).flat_angle)
        beyond = position - inside
        return turned + beyond * self.turn_rate(finger, inside) if beyond.any() else turned

    def turn_rate(self, finger: Finger, bend: ArrayLike) -> np.ndarray:
        """Return the derivative of `turn` with respect to the bend, (...), rad."""
        return np.abs(self.angle_rate(finger, np.clip(bend, 0.0, 1.0)))

    def bend(self, finger: Finger, turn: ArrayLike) -> np.ndarray:
        """Return the bend at a turn of the first bar, (...). This is the inverse of `turn`."""
        inverse = _measured(self, finger).bend_of_turn
        wanted = np.asarray(turn, np.float64)
        inside = np.clip(wanted, inverse.x[0], inverse.x[-1])
        position = inverse(inside)
        beyond = wanted - inside
        return position + beyond / self.turn_rate(finger, position) if beyond.any() else position

    def check(self, finger: Finger) -> None:
        """Raise an error if the linkage does not follow the finger over its whole bend."""
        reach = self.reach(finger, CHECKED_BENDS)
        least, most = abs(self.first_bar - self.second_bar), self.first_bar + self.second_bar
        is_out = ~((least < reach) & (reach < most))
        if is_out.any():
            row = int(np.argmax(is_out))
            raise ArgumentError(
                f"the linkage does not reach the thimble at bend {CHECKED_BENDS[row]:.3f}: it is "
                f"{1e3 * reach[row]:.1f} mm from the base, expected {1e3 * least:.1f} to {1e3 * most:.1f} mm"
            )
        rate = self.angle_rate(finger, CHECKED_BENDS)
        is_back = ~(rate * rate[0] > 0.0)
        if is_back.any():
            raise ArgumentError(
                f"the linkage folds back at bend {CHECKED_BENDS[np.argmax(is_back)]:.3f}: expected an angle "
                "that only grows or only shrinks from flat hand to fist"
            )

    def _offset(self, finger: Finger, bend: ArrayLike) -> np.ndarray:
        """Return the vector from the base to the thimble."""
        return finger.point(bend, self.thimble_along, self.thimble_dorsal) - np.array(self.base)

    def _elbow_cosine(self, reach: np.ndarray) -> np.ndarray:
        """Return the cosine of the angle at the base between the first bar and the line to the thimble."""
        return (self.first_bar**2 + reach**2 - self.second_bar**2) / (2.0 * self.first_bar * reach)


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """Quantities that are computed once for a linkage on a finger."""

    flat_angle: float  # rad
    bend_of_turn: CubicHermiteSpline  # through the checked bends, with their true slopes: exact to 1e-13


@lru_cache(maxsize=16)
def _measured(linkage: Linkage, finger: Finger) -> _Measured:
    angles = linkage.angle(finger, CHECKED_BENDS)
    slopes = 1.0 / np.abs(linkage.angle_rate(finger, CHECKED_BENDS))
    return _Measured(float(angles[0]), CubicHermiteSpline(np.abs(angles - angles[0]), CHECKED_BENDS, slopes))
