"""Turns of a motor, angles of its drum, metres and newtons at the fingertip.

Motor and drum are joined by a gear; drum and fingertip by the lever of `FingerPath`. A force does the same
work at both ends.
"""

import math

from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.motors.motor_address import MotorSettings


class MotorScale:
    """Conversions of one motor; angles are right once `set_home` was called."""

    def __init__(self, path: FingerPath, settings: MotorSettings) -> None:
        self._path = path
        self._ratio, self._direction = settings.ratio, settings.direction
        self._radian = settings.direction * settings.ratio / (2.0 * math.pi)  # turns
        self._zero = 0.0  # turns at the angle 0

    def set_home(self, turns: float, angle: float) -> None:
        """Set that the drum stands at *angle*, rad, while the motor counts *turns*."""
        self._zero = turns - self._radian * angle

    def angle(self, turns: float) -> float:
        """Return the drum's angle, rad."""
        return (turns - self._zero) / self._radian

    def turns(self, angle: float) -> float:
        """Return the motor's turns at a drum's angle, rad."""
        return self._zero + self._radian * angle

    def position(self, angle: float) -> float:
        """Return where the drum at an angle, rad, meets the finger on its path, m."""
        return self._path.drum_position(angle)

    def torque(self, force: float, angle: float) -> float:
        """Return the motor's torque, N m, that presses on the finger with a force, N."""
        return -self._direction * force * self._path.lever(angle) / self._ratio

    def force(self, torque: float, angle: float) -> float:
        """Return the force on the finger, N, of the motor's torque, N m; the inverse of `torque`."""
        return -self._direction * torque * self._ratio / self._path.lever(angle)

    def drum_speed(self, speed: float, angle: float) -> float:
        """Return the drum's speed, rad/s, at a speed of the fingertip, m/s."""
        return speed / self._path.lever(angle)
