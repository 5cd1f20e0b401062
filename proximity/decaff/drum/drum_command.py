"""What a drum's motor serves, and the command of one sample."""

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from proximity.decaff.drum import drum_kernels


class DriveMode(IntEnum):
    """What the drum's motor serves."""

    OFF = drum_kernels.OFF
    POSITION = drum_kernels.POSITION
    FORCE = drum_kernels.FORCE


@dataclass(frozen=True, slots=True)
class DrumCommand:
    """What a controller wants of the drum's servo for a sample."""

    mode: DriveMode = DriveMode.POSITION
    target: float = 0.0  # m, or N to press on the finger with
    speed_cap: float = math.inf  # m/s, of the reference
    force_cap: float = math.inf  # N, of the motor
    start_force: float = (
        math.nan
    )  # N, the force reference at a change to force; nan: from nothing, not bumpless

    force_slew: float = 0.0  # N/s, of the force reference; 0: the servo's own, inf: at once

    def write(self, array: np.ndarray) -> None:
        """Write it as the kernels read it.

        Parameters
        ----------
        array : (COMMAND_SIZE,) float64
            Filled anew.
        """
        array[drum_kernels.MODE] = self.mode
        array[drum_kernels.TARGET] = self.target
        array[drum_kernels.SPEED_CAP] = self.speed_cap
        array[drum_kernels.FORCE_CAP] = self.force_cap
        array[drum_kernels.START_FORCE] = self.start_force
        array[drum_kernels.SLEW] = self.force_slew
