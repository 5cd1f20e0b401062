"""Simulated drum of one finger, driven by a controller's actions in real time; all holds at the fingertip."""

import math

import numpy as np

from proximity.decaff.controller.controller_states import DrumAction, commanded
from proximity.decaff.drum import drum_kernels
from proximity.decaff.drum.drum_model import PAD_STIFFNESS, Drum
from proximity.decaff.drum.servo import SERVO_RATE, servo_for, steps_a_sample
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.simulated_drums.simulated_drum_kernels import serve_against

LONGEST_STEP = 0.1  # s that one action is served for


class DrumPlant:
    """The drum of a path, or another, and the pad of a finger that leans on it; *cable* in N/m there."""

    drum: Drum
    force: float  # N, on the finger
    link: float  # m, of the replica's link: where the cable pulls it, or where the drum stops it

    def __init__(self, path: FingerPath, drum: Drum | None = None, cable: float = math.inf) -> None:
        drum = drum or path.drum
        servo = servo_for(drum, SERVO_RATE)
        self._path, self._period = path, servo.period
        self.drum = drum
        self._drum, self._servo = drum.as_array(), servo.as_array()
        self._steps = steps_a_sample(SERVO_RATE)
        self._stiffness = 1.0 / (1.0 / PAD_STIFFNESS + 1.0 / cable)
        self._drive = drum.drive(self._period / self._steps)
        self._command = np.zeros(drum_kernels.COMMAND_SIZE)
        self._left = 0.0
        self.force, self.link = 0.0, -math.inf
        drum_kernels.rest_drum(self._drum, self._drive, path.retracted)

    @property
    def position(self) -> float:
        """Position of the drum on the finger's path, m."""
        return float(self._drive[drum_kernels.DRIVE_POSITION])

    @property
    def angle(self) -> float:
        """Angle that the drum's encoder reads, rad."""
        return self._path.drum_angle(self.position)

    @property
    def torque(self) -> float:
        """Torque of the motor at its shaft, N m; pressing on the finger is positive."""
        return self.drum.motor_torque(-float(self._drive[drum_kernels.DRIVE_APPLIED]))

    def advance(self, action: DrumAction, finger: float, seconds: float) -> None:
        """Serve an action in whole samples, at most for a tenth of a second; what is left over comes next."""
        target = action.force if action.mode == drum_kernels.MODE_FORCE else action.position
        commanded(action, target).write(self._command)
        time = self._left + min(max(seconds, 0.0), LONGEST_STEP)
        samples = int(time / self._period)
        self._left = time - samples * self._period
        self.force = serve_against(
            self._drum, self._servo, self._drive, self._command, finger, self._stiffness,
            samples, self._steps, self._period / self._steps,
        )  # fmt: skip
        self.follow(finger)

    def follow(self, finger: float) -> float:
        """Return where the link is with the finger at a position, m: as it opens, the cable's play behind."""
        self.link = min(max(self.link, finger), finger + self._path.play, self.position)
        return self.link
