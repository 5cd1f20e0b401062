"""Interface of a motor's driver: its readings and its commands, at the motor's own shaft.

A driver only speaks a protocol. It never waits for an answer, and it leaves out answers that are not sound:
whoever uses it notices the silence. Drivers count turns and newton metres as the motor does; what they mean
for the drum is in `motor_scale`.
"""

from dataclasses import dataclass
from typing import Protocol

from proximity.decaff.drum.drum_command import DriveMode


@dataclass(frozen=True, slots=True)
class MotorReading:
    """Newest answers of a motor."""

    answers: int = 0  # sound encoder readings so far; it grows, or the motor is silent
    turns: float = 0.0  # by the encoder, since wherever the motor counts from
    current: float = 0.0  # A
    torque: float = 0.0  # N m, at the shaft
    is_on: bool = False  # the motor says that it follows commands
    fault: str = ""  # a sentence, where the motor reports one


@dataclass(frozen=True, slots=True)
class MotorCommand:
    """Command of a motor until the next one."""

    mode: DriveMode = DriveMode.POSITION  # POSITION, or FORCE: the torque
    turns: float = 0.0  # to stand at, in position mode
    torque: float = 0.0  # N m, in torque mode
    torque_cap: float = 0.0  # N m, either way, in both modes


class MotorDriver(Protocol):
    """Driver of one motor; every call may raise a `MotorError` where the connection has failed."""

    def read(self) -> MotorReading:
        """Take in what has come, ask for the next answers, and return the newest reading."""

    def switch_on(self, command: MotorCommand) -> None:
        """Ask the motor to follow commands, beginning with this one; `MotorReading.is_on` confirms it."""

    def send(self, command: MotorCommand) -> None:
        """Send a command to a motor that is on."""

    def switch_off(self) -> None:
        """Take the power off the motor, as at the end of work."""

    def stop(self) -> None:
        """Take the power off at once: the emergency stop, which the motor remembers where it can."""

    def close(self) -> None:
        """Close the connection."""
