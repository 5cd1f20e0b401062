"""Motor addresses, the interface of motor drivers, and the conversion of turns to the drum.

An address is ``SCHEME://PLACE?option=value&...``. All motors have these options: ``ratio`` (turns of the
motor per turn of the drum), ``direction`` (1, or -1 if a motor that counts up presses the drum on the
finger), ``stop`` (rad from the retracted drum to its mechanical stop), ``torque`` (N m at the shaft, at
most), ``speed`` (m/s at the fingertip, at most), ``kt`` (N m/A), ``watchdog`` (ms of silence), and ``driver``
(a Python file with ``open_driver``).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from runpy import run_path
from typing import Protocol
from urllib.parse import parse_qsl, urlsplit

from proximity.decaff.drum.drum_model import GEARS, USUAL_GEAR, Drum, Motor
from proximity.decaff.drum.servo import DriveMode
from proximity.decaff.glove.finger_path import FingerPath
from proximity.errors import MotorError
from proximity.system.extras import installation

DRIVERS = {"odrive-can": "proximity.decaff.motors.odrive_can"}
"""Modules with a function ``open_driver``. The option ``driver=FILE`` of an address names another."""


# --- the driver, in units of the motor's shaft; it never waits, and ignores invalid answers ---


@dataclass(frozen=True, slots=True)
class MotorReading:
    """Newest answers of a motor."""

    answers: int = 0  # number of valid encoder readings; constant while the motor is silent
    turns: float = 0.0  # by the encoder, from the motor's origin
    current: float = 0.0  # A
    torque: float = 0.0  # N m, at the shaft
    is_on: bool = False  # whether the motor reports that it follows commands
    fault: str = ""  # sentence about a fault that the motor reports, or empty


@dataclass(frozen=True, slots=True)
class MotorCommand:
    """Command of a motor until the next one."""

    mode: DriveMode = DriveMode.POSITION  # POSITION, or FORCE: the torque
    turns: float = 0.0  # target, in position mode
    torque: float = 0.0  # N m, in torque mode
    torque_cap: float = 0.0  # N m, either way, in both modes


class MotorDriver(Protocol):
    """Driver of one motor. Every call may raise a `MotorError` if the connection has failed."""

    def read(self) -> MotorReading:
        """Read all arrived messages, request the next answers, and return the newest reading."""

    def switch_on(self, command: MotorCommand) -> None:
        """Request that the motor follow commands, beginning with this one.

        `MotorReading.is_on` confirms that the motor is on.
        """

    def send(self, command: MotorCommand) -> None:
        """Send a command to a motor that is on."""

    def switch_off(self) -> None:
        """Switch the motor off at the end of normal operation."""

    def stop(self) -> None:
        """Switch the motor off immediately, as an emergency stop that is latched if the motor supports it."""

    def close(self) -> None:
        """Close the connection."""


# --- the address ---


@dataclass(slots=True)
class MotorAddress:
    """Parsed address of a motor. `check_options` raises an error for options that were never read."""

    text: str
    scheme: str
    place: str
    options: dict[str, str]
    asked: set[str] = field(default_factory=set)

    @classmethod
    def parse(cls, text: str) -> "MotorAddress":
        """Parse an address."""
        parts = urlsplit(text)
        place = (parts.netloc + parts.path) if parts.netloc else parts.path
        address = cls(text, parts.scheme, place, dict(parse_qsl(parts.query, keep_blank_values=True)))
        if address.scheme not in DRIVERS and "driver" not in address.options:
            known = ", ".join(DRIVERS)
            raise address.refuse(
                f"unknown kind of motor {address.scheme!r} (expected {known}, or driver=FILE)"
            )
        if not place:
            raise address.refuse("it names no bus or port, as in odrive-can://can0")
        return address

    def number(self, name: str, default: float, least: float, most: float) -> float:
        """Return the number of an option. Raise an error if it is out of range."""
        self.asked.add(name)
        try:
            value = float(self.options.get(name, default))
        except ValueError:
            value = float("nan")
        if not least <= value <= most:
            raise self.refuse(f"{name}={self.options[name]}, expected a number from {least:g} to {most:g}")
        return value

    def whole(self, name: str, default: int, least: int, most: int) -> int:
        """Return the whole number of an option. Raise an error if it is out of range."""
        value = self.number(name, default, least, most)
        if value != int(value):
            raise self.refuse(f"{name}={self.options[name]}, expected a whole number")
        return int(value)

    def word(self, name: str, default: str) -> str:
        """Return the text of an option."""
        self.asked.add(name)
        return self.options.get(name, default)

    def check_options(self) -> None:
        """Raise an error for unknown options, as a misspelt one would be a missing limit."""
        unknown = sorted(set(self.options) - self.asked)
        if unknown:
            raise self.refuse(f"unknown option {unknown[0]!r} (expected {', '.join(sorted(self.asked))})")

    def refuse(self, reason: str) -> MotorError:
        """Return the error for an address that cannot be used."""
        return MotorError(f"{self.text}: {reason}")


@dataclass(frozen=True)  # without slots: `of` reads the defaults from the class
class MotorSettings:
    """Settings of a motor and its drum, from its address. The defaults are those of the modelled drum."""

    name: str  # the address, for sentences
    ratio: float = GEARS[USUAL_GEAR].ratio  # turns of the motor to one of the drum
    direction: float = 1.0  # of the motor as the drum leaves the finger
    stop: float = 0.1  # rad, from the retracted drum to its mechanical stop
    torque: float = Motor().torque  # N m at the shaft, at most
    speed: float = 1.0  # m/s at the fingertip, at most
    torque_constant: float = 0.05  # N m/A
    watchdog: float = 0.05  # s of silence after which the motor is switched off

    @classmethod
    def of(cls, address: MotorAddress, drum: Drum | None = None) -> "MotorSettings":
        """Return the settings of an address. Gear ratio and torque default to those of the drum."""
        ratio = cls.ratio if drum is None else drum.gear.ratio
        torque = cls.torque if drum is None else drum.motor.torque
        direction = address.whole("direction", 1, -1, 1)
        if direction == 0:
            raise address.refuse("direction=0, expected 1 or -1")
        return cls(
            address.text,
            address.number("ratio", ratio, 0.01, 1000.0),
            direction,
            address.number("stop", cls.stop, 0.02, 3.0),
            address.number("torque", torque, 1e-4, 10.0),
            address.number("speed", cls.speed, 0.01, 5.0),
            address.number("kt", cls.torque_constant, 1e-4, 10.0),
            1e-3 * address.number("watchdog", 1e3 * cls.watchdog, 10.0, 500.0),
        )


def open_motor(text: str, drum: Drum | None = None) -> tuple[MotorDriver, MotorSettings]:
    """Open the driver of a drum's motor by its address. The motor stays off."""
    address = MotorAddress.parse(text)
    settings = MotorSettings.of(address, drum)
    file = address.word("driver", "")
    try:
        opener = _opener_in(address, file) if file else import_module(DRIVERS[address.scheme]).open_driver
        return opener(address, settings), settings
    except ModuleNotFoundError as missing:
        what = f"pip install {missing.name}" if file else installation("motor")
        raise address.refuse(f"needs {missing.name}: {what}") from missing


def _opener_in(address: MotorAddress, file: str) -> Callable[[MotorAddress, MotorSettings], MotorDriver]:
    """Return the function ``open_driver`` of a Python file."""
    try:
        opener: Callable[[MotorAddress, MotorSettings], MotorDriver] = run_path(file)["open_driver"]
    except OSError as failure:
        raise address.refuse(f"driver={file} cannot be read ({failure.strerror})") from failure
    except KeyError as missing:
        raise address.refuse(f"driver={file} has no open_driver(address, settings)") from missing
    return opener


# --- turns of the motor, angles of its drum, metres and newtons at the fingertip ---


class MotorScale:
    """Conversions between a motor and its drum. Angles are valid after `set_home`."""

    def __init__(self, path: FingerPath, settings: MotorSettings) -> None:
        self._path = path
        self._ratio, self._direction = settings.ratio, settings.direction
        self._radian = settings.direction * settings.ratio / (2.0 * math.pi)  # turns
        self._zero = 0.0  # turns at the angle 0

    def set_home(self, turns: float, angle: float) -> None:
        """Set the angle of the drum, rad, that corresponds to the *turns* of the motor."""
        self._zero = turns - self._radian * angle

    def angle(self, turns: float) -> float:
        """Return the angle of the drum at a number of turns of the motor, rad."""
        return (turns - self._zero) / self._radian

    def turns(self, angle: float) -> float:
        """Return the turns of the motor at an angle of the drum, rad."""
        return self._zero + self._radian * angle

    def position(self, angle: float) -> float:
        """Return the position on the path where a drum at an angle, rad, meets the finger, m."""
        return self._path.drum_position(angle)

    def torque(self, force: float, angle: float) -> float:
        """Return the motor's torque, N m, for a force on the finger, N."""
        return -self._direction * force * self._path.lever(angle) / self._ratio

    def force(self, torque: float, angle: float) -> float:
        """Return the force on the finger, N, at a torque of the motor, N m. It is the inverse of `torque`."""
        return -self._direction * torque * self._ratio / self._path.lever(angle)

    def drum_speed(self, speed: float, angle: float) -> float:
        """Return the drum's speed, rad/s, at a speed of the fingertip, m/s."""
        return speed / self._path.lever(angle)
