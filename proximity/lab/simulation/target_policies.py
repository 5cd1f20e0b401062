"""Policies that make a drum's target of a distance: four readings, and an interface for a controller.

A distance is old when it arrives. What it is combined with decides everything (science/drum.md): with the
link's present position it is wrong by the distance moved since; with the position at the same instant it is a
position in the world.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np

from proximity.checks import not_negative, positive
from proximity.decaff.controller.drum_limits import RELEASE_GAP, TOUCH_GAP
from proximity.decaff.drum.drum_command import DriveMode, DrumCommand
from proximity.lab.simulation import loop_kernels


class Target(IntEnum):
    """Position that a distance is combined with."""

    NAIVE = loop_kernels.POLICY_NAIVE
    """Where the link is now, in contact too: the paper's "proportionate position", taken at its word."""
    LATCHED = loop_kernels.POLICY_LATCHED
    """Where the link is now; held from touch to release."""
    FEED_FORWARD = loop_kernels.POLICY_FEED_FORWARD
    """Where the link is now, the distance less the way gone since at the old speed; held."""
    TIME_STAMPED = loop_kernels.POLICY_TIME_STAMPED
    """Where the link was when the distance was measured; held."""


@dataclass(frozen=True, slots=True)
class Holding:
    """Distances at which a target is held, and the position where the drum waits otherwise."""

    retracted: float = 0.030  # m; assumed
    touch_gap: float = TOUCH_GAP  # m, of link and drum: nearer is touching
    release_gap: float = RELEASE_GAP  # m, farther is released
    compliance: float = (
        0.0  # m/N, of a cable whose stretch is made up for while a target is held; 0: it is not
    )
    smoothing: float = (
        2.0  # Hz, of the force that stretches it; from 10 Hz on, the motor's makes the drum swing
    )
    has_force_sensor: bool = False  # between link and drum; without one the motor's force is taken

    def __post_init__(self) -> None:
        positive("retracted", self.retracted, "metres")
        positive("touch_gap", self.touch_gap, "metres")
        positive("release_gap", self.release_gap, "metres")
        not_negative("compliance", self.compliance, "metres a newton")
        positive("smoothing", self.smoothing, "hertz")

    def as_array(self) -> np.ndarray:
        """Return its numbers as the kernels read them."""
        array = np.zeros(loop_kernels.HOLDING_SIZE)
        array[loop_kernels.HOLDING_RETRACTED] = self.retracted
        array[loop_kernels.HOLDING_TOUCH_GAP] = self.touch_gap
        array[loop_kernels.HOLDING_RELEASE_GAP] = self.release_gap
        array[loop_kernels.HOLDING_COMPLIANCE] = self.compliance
        array[loop_kernels.HOLDING_SMOOTHING] = self.smoothing
        array[loop_kernels.HOLDING_HAS_SENSOR] = self.has_force_sensor
        return array


@dataclass(frozen=True, slots=True)
class Message:
    """A distance, with what was known of the link at the same instant."""

    at: float  # s, of the measurement
    link: float  # m
    speed: float  # m/s, of the link
    distance: float  # m, to the wall


@dataclass(frozen=True, slots=True)
class DistanceSample:
    """State that a controller knows at a sample of the servo."""

    now: float  # s
    link: float  # m, by the potentiometer
    speed: float  # m/s, of the link
    finger_speed: float  # m/s, behind the pad: where the link is stopped, the finger still goes on
    drum: float  # m, where it is
    force: float  # N, between link and drum
    motor_force: float  # N, positive away from the finger
    applied: float  # N, of the motor during the last sample, positive away from the finger
    message: Message | None  # the newest delivered; None: none, or nothing within reach


class Controller(Protocol):
    """Whatever decides, every sample, what the drum does: a policy here, or a real controller."""

    def command(self, distance_sample: DistanceSample) -> DrumCommand:
        """Return what the drum shall do until the next sample."""
        ...


class TargetPolicy:
    """One of the four readings of a distance, as a controller: the compiled loop, sample by sample."""

    def __init__(self, target: Target, holding: Holding | None = None) -> None:
        self._kind = int(Target(target))
        self._holding = (holding or Holding()).as_array()
        self._memory = np.zeros(loop_kernels.MEMORY_SIZE)
        self._message = np.zeros(loop_kernels.MESSAGE_SIZE)

    def command(self, distance_sample: DistanceSample) -> DrumCommand:
        """Return where the drum shall go."""
        message = self._message
        message[loop_kernels.MESSAGE_AT] = -math.inf
        if distance_sample.message is not None:
            reported = distance_sample.message
            message[:] = reported.at, reported.link, reported.speed, reported.distance
        position = loop_kernels.choose_target(
            self._kind,
            distance_sample.now,
            distance_sample.link,
            distance_sample.drum,
            distance_sample.force
            if self._holding[loop_kernels.HOLDING_HAS_SENSOR]
            else -distance_sample.applied,
            message,
            self._holding,
            self._memory,
        )
        return DrumCommand(DriveMode.POSITION, position)
