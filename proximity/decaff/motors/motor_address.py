"""Address of a motor, ``SCHEME://PLACE?option=value&...``, and the driver that it opens.

Options of all motors: ``ratio`` (turns of the motor to one of the drum), ``direction`` (1, or -1 where a
motor that counts up presses the drum on the finger), ``stop`` (rad from the retracted drum to its mechanical
stop), ``torque`` (N m at the shaft, at most), ``speed`` (m/s at the fingertip, at most), ``kt`` (N m/A),
``watchdog`` (ms of silence).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from urllib.parse import parse_qsl, urlsplit

from proximity.decaff.drum.drum_model import GEARS, USUAL_GEAR, Drum, Motor
from proximity.decaff.motors.motor_driver import MotorDriver
from proximity.errors import MotorError
from proximity.system.extras import installation

DRIVERS = {
    "odrive-can": "proximity.decaff.motors.odrive_can",
    "canopen": "proximity.decaff.motors.cia402",
    "simplefoc": "proximity.decaff.motors.simplefoc",
}


@dataclass(slots=True)
class MotorAddress:
    """A motor's address, taken apart; options that nobody asks for are refused by `check_options`."""

    text: str
    scheme: str
    place: str
    options: dict[str, str]
    asked: set[str] = field(default_factory=set)

    @classmethod
    def parse(cls, text: str) -> "MotorAddress":
        """Take an address apart."""
        parts = urlsplit(text)
        place = (parts.netloc + parts.path) if parts.netloc else parts.path
        address = cls(text, parts.scheme, place, dict(parse_qsl(parts.query, keep_blank_values=True)))
        if address.scheme not in DRIVERS:
            raise address.refuse(
                f"there is no kind of motor {address.scheme!r} (expected {', '.join(DRIVERS)})"
            )
        if not place:
            raise address.refuse(
                "it names no bus or port, as in odrive-can://can0 or simplefoc:///dev/ttyACM0"
            )
        return address

    def number(self, name: str, default: float, least: float, most: float) -> float:
        """Return an option's number, within a range."""
        self.asked.add(name)
        try:
            value = float(self.options.get(name, default))
        except ValueError:
            value = float("nan")
        if not least <= value <= most:
            raise self.refuse(f"{name}={self.options[name]}, expected a number from {least:g} to {most:g}")
        return value

    def whole(self, name: str, default: int, least: int, most: int) -> int:
        """Return an option's whole number, within a range."""
        value = self.number(name, default, least, most)
        if value != int(value):
            raise self.refuse(f"{name}={self.options[name]}, expected a whole number")
        return int(value)

    def word(self, name: str, default: str) -> str:
        """Return an option's text."""
        self.asked.add(name)
        return self.options.get(name, default)

    def check_options(self) -> None:
        """Refuse options that this motor does not have: one that is misspelt would be a limit that is not."""
        unknown = sorted(set(self.options) - self.asked)
        if unknown:
            raise self.refuse(f"there is no option {unknown[0]!r} (expected {', '.join(sorted(self.asked))})")

    def refuse(self, reason: str) -> MotorError:
        """Return the error that says why this address cannot be used."""
        return MotorError(f"{self.text}: {reason}")


@dataclass(frozen=True)  # without slots: `of` reads the defaults from the class
class MotorSettings:
    """What a person says of a motor and its drum; defaults are those of the modelled drum."""

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
        """Take the settings from an address; gear and torque are those of the drum where it gives none."""
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
    """Open the driver of a drum's motor by its address; the motor stays off."""
    address = MotorAddress.parse(text)
    settings = MotorSettings.of(address, drum)
    module = import_module(DRIVERS[address.scheme])
    opener: Callable[[MotorAddress, MotorSettings], MotorDriver] = module.open_driver
    try:
        return opener(address, settings), settings
    except ModuleNotFoundError as missing:
        raise address.refuse(f"needs {missing.name}: {installation('motor')}") from missing
