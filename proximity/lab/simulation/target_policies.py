"""Policies that turn a distance into a drum's target: four readings, and an interface for a controller.

A distance is old when it arrives, and its reference decides its meaning (science/drum.md): with the link's
present position it is wrong by the displacement since; with the position at the same instant it is a position
in the world.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from proximity.decaff.drum.servo import DriveMode, DrumCommand
from proximity.lab.simulation.devices import Holding


class Target(IntEnum):
    """Position that a distance is combined with."""

    NAIVE = 0
    """The link's present position, also in contact: the paper's "proportionate position", taken literally."""
    LATCHED = 1
    """The link's present position; held from touch to release."""
    FEED_FORWARD = 2
    """The link's present position, the distance less the displacement since at the old speed; held."""
    TIME_STAMPED = 3
    """The link's position when the distance was measured; held."""


@dataclass(frozen=True, slots=True)
class Message:
    """A distance, with the state of the link at the same instant."""

    at: float  # s, of the measurement
    link: float  # m
    speed: float  # m/s, of the link
    distance: float  # m, to the wall


@dataclass(frozen=True, slots=True)
class DistanceSample:
    """State known to a controller at a sample of the servo."""

    now: float  # s
    link: float  # m, by the potentiometer
    speed: float  # m/s, of the link
    finger_speed: float  # m/s, behind the pad: when the link is stopped, the finger still moves
    drum: float  # m, its position
    force: float  # N, between link and drum
    applied: float  # N, of the motor during the last sample, positive away from the finger
    message: Message | None  # the newest delivered; None: no message, or no surface within reach


class Controller(Protocol):
    """Interface of drum controllers, called at every sample: a policy here, or a real controller."""

    def command(self, distance_sample: DistanceSample) -> DrumCommand:
        """Return the drum's command until the next sample."""
        ...


class TargetPolicy:
    """One of the four readings of a distance, as a controller."""

    def __init__(self, target: Target, holding: Holding | None = None) -> None:
        self._target, self._holding = Target(target), holding or Holding()
        self._is_held, self._held = False, self._holding.retracted  # the target while the drum is touched, m
        self._now = self._once = self._twice = 0.0  # s, of the last sample; N, smoothed once and twice

    def command(self, distance_sample: DistanceSample) -> DrumCommand:
        """Return the drum's target: retracted, or the contact; while it is touched, the held one."""
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
        """Return the stretch of the cable, m, by the smoothed force on the drum; 0 without compensation."""
        holding, elapsed, self._now = self._holding, sample.now - self._now, sample.now
        share = -math.expm1(-2.0 * math.pi * holding.smoothing * max(elapsed, 0.0))
        self._once += share * ((sample.force if holding.has_force_sensor else -sample.applied) - self._once)
        self._twice += share * (self._once - self._twice)
        return holding.compliance * max(self._twice, 0.0)
