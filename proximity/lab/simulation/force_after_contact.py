"""Controller for teleoperation that changes from position to force once the first contact is steady.

In teleoperation the drum first stands where the wall is; when the force is steady, it serves the force that
the slave measures. The force reference starts at the force that is felt, and the integrator takes up what
else the motor does.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from proximity.decaff.controller.steady_force import Handover, SteadyForce
from proximity.decaff.drum.drum_command import DriveMode, DrumCommand
from proximity.lab.simulation.response import Response
from proximity.lab.simulation.target_policies import Controller, DistanceSample

BUMP_TIME = 0.3  # s after a change of mode, in which a bump is looked for


@dataclass(frozen=True, slots=True)
class Slave:
    """Measurements at the far end."""

    force: float  # N, measured
    distance: float = 0.0  # m, from its object


class ForceAfterContact:
    """A controller for teleoperation: position at first contact, the slave's force once it is steady."""

    switched_at: float  # s; nan while the position is served

    def __init__(
        self,
        before_contact: Controller,
        slave: Callable[[float], Slave],
        rate: float,
        handover: Handover | None = None,
    ) -> None:
        self._before_contact, self._slave, self._rate = before_contact, slave, rate
        self._handover = handover or Handover()
        self._steady = SteadyForce(rate, self._handover.rule)
        self._lost_for = 0.0
        self.switched_at = math.nan

    def command(self, distance_sample: DistanceSample) -> DrumCommand:
        """Return where the drum shall go, or with what force it shall press."""
        command = self._before_contact.command(distance_sample)
        slave = self._slave(distance_sample.now)
        is_steady = self._steady.take(distance_sample.force, distance_sample.finger_speed)
        if math.isnan(self.switched_at):
            if is_steady and not slave.distance > self._handover.lost_distance:
                self.switched_at, self._lost_for = distance_sample.now, 0.0
        elif self._is_lost(distance_sample.force, slave.distance):
            self.switched_at = math.nan
        if math.isnan(self.switched_at):
            return command
        start = self._steady.filtered if self._handover.is_bumpless else math.nan
        return DrumCommand(DriveMode.FORCE, slave.force, start_force=start)

    def _is_lost(self, force: float, distance: float) -> bool:
        """No force for a while, or the slave is off its object."""
        is_weak = force < self._handover.lost_force
        self._lost_for = self._lost_for + 1.0 / self._rate if is_weak else 0.0
        return distance > self._handover.lost_distance or self._lost_for >= self._handover.lost_time


def bump(response: Response, at: float) -> float:
    """Return by how much the force on the finger departs from what it was at a change of mode, at most, N."""
    row = response.zero + round(at / response.step)
    after = response.force[row : row + round(BUMP_TIME / response.step)]
    return float(np.abs(after - response.force[row]).max())
