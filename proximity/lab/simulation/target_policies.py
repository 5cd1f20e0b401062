"""Policies that convert a distance into a drum's target, and an interface for controllers.

A distance is old when it arrives, and its meaning depends on the position that it is combined with
(science/drum.md). With the present position of the link, the result is wrong by the displacement since the
measurement. With the position at the same instant, it is a position in the world.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from proximity.decaff.drum.servo import DriveMode, DrumCommand
from proximity.lab.simulation.devices import Holding


class Target(IntEnum):
    """Policies, which differ in the position that a distance is combined with."""

    NAIVE = 0
    """Present position of the link, also in contact. This is the paper's "proportionate position" literally.
    """
    LATCHED = 1
    """Present position of the link. The target is held from touch to release."""
    FEED_FORWARD = 2
    """Present position of the link, minus the displacement since the measurement at its speed. It is held."""
    TIME_STAMPED = 3
    """Position of the link when the distance was measured. The target is held."""


@dataclass(frozen=True, slots=True)
class Message:
    """A distance, with the state of the link at the same instant."""

    at: float  # s, of the measurement
    link: float  # m
    speed: float  # m/s, of the link
    distance: float  # m, to the wall


@dataclass(frozen=True, slots=True)
class DistanceSample:
    """Input of a controller at a sample of the servo."""

    now: float  # s
    link: float  # m, by the potentiometer
    speed: float  # m/s, of the link
    finger_speed: float  # m/s, behind the pad, as a finger still moves when the link is stopped
    drum: float  # m, its position
    force: float  # N, between link and drum
    applied: float  # N, of the motor during the last sample, positive away from the finger
    message: Message | None  # newest delivered message; None without one, or without a surface in reach


class Controller(Protocol):
    """Interface of drum controllers, which are called at every sample of the servo.

    They are the policies of this module and real controllers.
    """

    def command(self, distance_sample: DistanceSample) -> DrumCommand:
        """Return the drum's command until the next sample."""
        ...


class TargetPolicy:
    """Controller that follows one of the target policies."""

    def __init__(self, target: Target, holding: Holding | None = None) -> None:
        self._target, self._holding = Target(target), holding or Holding()
        self._is_held, self._held = False, self._holding.retracted  # the target while the drum is touched, m
        self._now = self._once = self._twice = 0.0  # s, of the last sample; N, smoothed once and twice

    def command(self, distance_sample: DistanceSample) -> DrumCommand:
        """Return the target of the drum, which is held while the drum is touched.

        Otherwise it is the position of the contact, or the retracted position if no contact is known.
        """
        return DrumCommand(DriveMode.POSITION, self._position(distance_sample))

    def _position(self, sample: DistanceSample) -> float:
        holding, gap = self._holding, sample.drum - sample.link
        was_held = self._is_held
        self._is_held = self._target != Target.NAIVE and gap < (
            holding.release_gap if was_held else holding.touch_gap
        )
        if was_held and self._is_held:
            return self._held - self._stretch(sample)
        self._now, self._once, self._twice = sample.now, 0.0, 0.0
        self._held = holding.retracted
        if sample.message is not None:
            self._held = min(self._held, self._contact(sample, sample.message))
        return self._held

    def _contact(self, sample: DistanceSample, message: Message) -> float:
        """Return the position of the contact, m."""
        if self._target == Target.TIME_STAMPED:
            return message.link + message.distance
        gone = message.speed * (sample.now - message.at) if self._target == Target.FEED_FORWARD else 0.0
        return sample.link + message.distance - gone

    def _stretch(self, sample: DistanceSample) -> float:
        """Return the stretch of the cable by the smoothed force on the drum, m, or 0 without compensation."""
        holding, elapsed, self._now = self._holding, sample.now - self._now, sample.now
        share = -math.expm1(-2.0 * math.pi * holding.smoothing * max(elapsed, 0.0))
        self._once += share * ((sample.force if holding.has_force_sensor else -sample.applied) - self._once)
        self._twice += share * (self._once - self._twice)
        return holding.compliance * max(self._twice, 0.0)
