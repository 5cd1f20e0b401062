"""Simulated drum, driven sample by sample by the C servo of the chip."""

import math

import numpy as np

from proximity.checks import positive
from proximity.decaff.controller.compiled import ACTION, PATH, SERVO, SETTINGS, in_c, memory
from proximity.decaff.controller.settings import Limits, servo_numbers
from proximity.decaff.drum import drum_kernels as kernels
from proximity.decaff.drum.drum_model import Drum
from proximity.decaff.drum.servo import DriveMode, DrumCommand, Servo, steps_a_sample
from proximity.errors import ArgumentError


class ServedDrum:
    """Simulated drum and its servo, initially at rest at *position*, m.

    *stop*: position of a mechanical stop farther from the finger, m.
    """

    plant: np.ndarray
    drive: np.ndarray  # both as in `drum_kernels`, which step them between two samples
    reported: float  # m, of the drum by its encoder at the last sample
    servo: np.ndarray  # the one row of state of the servo in C

    def __init__(self, drum: Drum, servo: Servo, position: float, stop: float = math.inf) -> None:
        self.drum, self.period, self.steps = drum, servo.period, steps_a_sample(servo.rate)
        self.step = self.period / self.steps  # s, of the plant
        self.plant, self.drive = drum.as_array(stop), drum.drive(self.step, position)
        self.reported = drum.reading(position)
        # C keeps the address of the settings, which must outlive it.
        _, settings, self._settings = memory(SETTINGS)
        for name, number in servo_numbers(drum, servo, Limits().continuous_force).items():
            settings[name] = number
        _, path, place = memory(PATH)
        path.settings = self._settings.ctypes.data
        self.servo, _, content = memory(SERVO)
        self._action, _, action = memory(ACTION)
        self._memory = content[0], action[0]
        self._serve = in_c("servo_step")
        in_c("servo_begin")(content[0], place[0], self.reported)
        if self.plant["play"][0] > 0.0:  # steady state, in which the integral balances the spring
            self.servo["integrated"] = -self.plant["spring"]

    @property
    def position(self) -> float:
        """Position of the drum by its rotor, m."""
        return float(self.drive[kernels.DRIVE_ROTOR])

    @property
    def arm(self) -> float:
        """Position where the drum's arm meets the link, m, including play and elasticity of the gear."""
        return float(self.drive[kernels.DRIVE_POSITION])

    @property
    def applied(self) -> float:
        """Force demanded by the servo until the next sample, N, positive away from the finger."""
        return float(self.drive[kernels.DRIVE_APPLIED])

    def serve(self, command: DrumCommand, measured: float) -> None:
        """Compute the servo's force for one sample. *measured*: force between link and drum, N, or nan."""
        self.reported = self.drum.reading(self.position)
        target, force_step = command.target, self.drum.force_step
        self._action[0] = (
            0, command.mode, target, 0.0, target, command.speed_cap, command.force_cap, command.start_force,
            0.0, 0.0, 0.0, command.force_slew, 0.0, False, False,
        )  # fmt: skip
        force = self._serve(*self._memory, self.reported, measured)
        self.drive[kernels.DRIVE_APPLIED] = round(force / force_step) * force_step if force_step else force
        self.drive[kernels.DRIVE_MODE] = command.mode

    def push(self, finger: float, stiffness: float, positions: np.ndarray) -> float:
        """Step the drum against a finger's pad, and return the final force of the pad, N.

        *positions*: filled with the position after each step.
        """
        return float(kernels.push_against(self.plant, self.drive, finger, stiffness, self.step, positions))


def move(drum: Drum, servo: Servo, distance: float, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Compute the motion of a drum from rest to a position, with a free path.

    Return times, s, and positions, m.
    """
    served, command = ServedDrum(drum, servo, 0.0), DrumCommand(DriveMode.POSITION, float(distance))
    samples = math.ceil(positive("duration", duration, "seconds") * servo.rate)
    positions = np.zeros((samples, served.steps))
    for row in positions:
        served.serve(command, math.nan)
        served.push(0.0, 0.0, row)
    return served.step * np.arange(1, positions.size + 1), positions.ravel()


def settling_time(
    drum: Drum, servo: Servo, distance: float, *, within: float = 1e-4, longest: float = 0.5
) -> float:
    """Return the time after which a drum stays near its target, s, or inf if it never does."""
    if not math.isfinite(distance) or abs(distance) <= within:
        raise ArgumentError(
            f"distance is {distance!r}, expected metres, farther than {within:g} from the start"
        )
    times, positions = move(drum, servo, distance, longest)
    is_away = np.abs(positions - distance) > within
    last = int(np.flatnonzero(is_away)[-1])
    return float(times[last + 1]) if last + 1 < len(times) else math.inf
