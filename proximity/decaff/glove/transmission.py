"""Transmission from hand to replica: a sheathed cable on two pulleys, and the potentiometer."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from proximity.checks import not_negative, positive, whole
from proximity.errors import ArgumentError


@dataclass(frozen=True, slots=True)
class Cable:
    """A cable that the linkage pulls and the replica follows; the values are assumed."""

    hand_pulley: float = 0.020  # m, radius
    replica_pulley: float = 0.030  # m, radius
    stiffness: float = 20e3  # N/m, sheath included
    backlash: float = 0.0  # m of cable, lost where the motion turns

    def __post_init__(self) -> None:
        positive("hand_pulley", self.hand_pulley, "metres")
        positive("replica_pulley", self.replica_pulley, "metres")
        positive("stiffness", self.stiffness, "newtons a metre", may_be_infinite=True)
        not_negative("backlash", self.backlash, "metres")

    def replica_turn(
        self, hand_turn: ArrayLike, tension: ArrayLike = 0.0, *, is_closing: ArrayLike = True
    ) -> np.ndarray:
        """Return how far the replica has turned since the flat hand, (...), rad."""
        lost = np.asarray(tension, np.float64) / self.stiffness + np.where(is_closing, self.backlash, 0.0)
        return (self.hand_pulley * np.asarray(hand_turn, np.float64) - lost) / self.replica_pulley

    def hand_turn(
        self, replica_turn: ArrayLike, tension: ArrayLike = 0.0, *, is_closing: ArrayLike = True
    ) -> np.ndarray:
        """Return how far the hand's pulley has turned, (...), rad: the inverse of `replica_turn`."""
        lost = np.asarray(tension, np.float64) / self.stiffness + np.where(is_closing, self.backlash, 0.0)
        return (self.replica_pulley * np.asarray(replica_turn, np.float64) + lost) / self.hand_pulley


@dataclass(frozen=True, slots=True)
class Potentiometer:
    """Sensor of the replica's angle: counts, evenly over its span."""

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
        """Number of different readings: 0 to one less."""
        return 1 << self.bits

    @property
    def gain(self) -> float:
        """Counts a radian."""
        return self.count / self.span

    def counts(self, angle: ArrayLike) -> np.ndarray:
        """Return the counts of an angle, (...), float64, neither rounded nor limited."""
        return self.count * self.zero_share + self.gain * np.asarray(angle, np.float64)

    def read(self, angle: ArrayLike) -> np.ndarray:
        """Return what is read at an angle, (...), int64: the nearest counts, within the span."""
        return np.clip(np.rint(self.counts(angle)), 0, self.count - 1).astype(np.int64)

    def angle(self, counts: ArrayLike) -> np.ndarray:
        """Return the angle of counts, (...), rad."""
        return (np.asarray(counts, np.float64) - self.count * self.zero_share) / self.gain
