"""Command of a drum's servo for one sample, and its drive modes."""

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from proximity.decaff.drum import drum_kernels


class DriveMode(IntEnum):
    """Quantity that the drum's motor controls."""

    OFF = drum_kernels.MODE_OFF
    POSITION = drum_kernels.MODE_POSITION
    FORCE = drum_kernels.MODE_FORCE


@dataclass(frozen=True, slots=True)
class DrumCommand:
    """Command of a controller to the drum's servo for one sample."""

    mode: DriveMode = DriveMode.POSITION
    target: float = 0.0  # m, or N to press on the finger with
    speed_cap: float = math.inf  # m/s, of the reference
    force_cap: float = math.inf  # N, of the motor
    start_force: float = (
        math.nan
    )  # N, the force reference at a change to force; nan: from nothing, not bumpless

    force_slew: float = 0.0  # N/s, of the force reference; 0: the servo's own, inf: at once

    def write(self, array: np.ndarray) -> None:
        """Write it as the kernels read it."""
        array[drum_kernels.COMMAND_MODE] = self.mode
        array[drum_kernels.COMMAND_TARGET] = self.target
        array[drum_kernels.COMMAND_SPEED_CAP] = self.speed_cap
        array[drum_kernels.COMMAND_FORCE_CAP] = self.force_cap
        array[drum_kernels.COMMAND_START_FORCE] = self.start_force
        array[drum_kernels.COMMAND_SLEW] = self.force_slew
