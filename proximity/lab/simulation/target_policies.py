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

from proximity.decaff.drum.servo import DriveMode, DrumCommand
from proximity.lab.simulation import target_kernels
from proximity.lab.simulation.devices import Holding, Sensing
from proximity.lab.simulation.target_kernels import TargetArrays
from proximity.native import packed


class Target(IntEnum):
    """Position that a distance is combined with."""

    NAIVE = target_kernels.POLICY_NAIVE
    """Where the link is now, in contact too: the paper's "proportionate position", taken at its word."""
    LATCHED = target_kernels.POLICY_LATCHED
    """Where the link is now; held from touch to release."""
    FEED_FORWARD = target_kernels.POLICY_FEED_FORWARD
    """Where the link is now, the distance less the way gone since at the old speed; held."""
    TIME_STAMPED = target_kernels.POLICY_TIME_STAMPED
    """Where the link was when the distance was measured; held."""


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
        self._arrays = target_arrays(holding or Holding())
        self._packed = packed(self._arrays)

    def command(self, distance_sample: DistanceSample) -> DrumCommand:
        """Return where the drum shall go."""
        reported, sample = distance_sample.message, distance_sample
        self._arrays.message[0] = (
            (-math.inf, 0.0, 0.0, 0.0)
            if reported is None
            else (reported.at, reported.link, reported.speed, reported.distance)
        )
        pressing = sample.force if self._arrays.holding[0].has_force_sensor else -sample.applied
        position = target_kernels.choose_target(
            self._kind, sample.now, sample.link, sample.drum, pressing, self._packed
        )
        return DrumCommand(DriveMode.POSITION, position)


def target_arrays(holding: Holding, sensing: Sensing | None = None, duration: float = 0.0) -> TargetArrays:
    """Return what makes targets of distances, which a policy may be given from outside."""
    sensing = sensing or Sensing()
    memory, message = np.zeros(1, target_kernels.MEMORY), np.zeros(1, target_kernels.MESSAGE)
    return TargetArrays(sensing.as_array(), sensing.noises(duration), holding.as_array(), memory, message)
