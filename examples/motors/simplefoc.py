"""Driver of a SimpleFOC motor by text commands of its Commander, over a serial port.

``simplefoc:///dev/ttyACM0?driver=examples/motors/simplefoc.py&motor=M&baud=115200&kt=0.05``; needs the
package pyserial. The firmware adds the motor by ``commander.motor(&motor, cmd)`` under the letter *motor*,
and controls its current. Angles are radians of the shaft, currents amperes. Commander drops lines of 20
characters and more, so each limit has a separate line. The motor stays in angle mode: a torque is the
limit of its current. Commander has no watchdog: the firmware must switch the motor off without commands,
which this driver cannot verify.

Source: SimpleFOC documentation, "Full motor configuration using the Commander", and the library's
Commander.cpp: machine-readable answers (``@3``) repeat the letters of the question before the value.
"""

import math
import time
from contextlib import suppress
from typing import Any

from proximity.decaff.drum.servo import DriveMode
from proximity.decaff.motors.motor_driver import MotorAddress, MotorCommand, MotorReading, MotorSettings
from proximity.errors import MotorError

TURN = 2.0 * math.pi
STATES = 7  # target, voltages q and d, currents q and d, velocity, angle
CURRENT_PLACE, ANGLE_PLACE = 3, 6
ASK_AGAIN = 0.01  # s without an answer
TORQUE_LEAD = 0.5  # turns, by which the target of a torque is ahead of the shaft
MAX_LINE = 256  # characters of an answer


class SimpleFoc:
    """A motor behind a Commander."""

    def __init__(self, port: Any, letter: str, torque_constant: float) -> None:
        self._port, self._letter, self._constant = port, letter, torque_constant
        self._text, self._asked = b"", -math.inf
        self._answers, self._turns, self._current = 0, 0.0, 0.0
        self._is_on, self._fault = False, ""
        self._cap = 0.0  # N m

    def read(self) -> MotorReading:
        """Read answers, and request all states and whether the motor is on."""
        self._text += self._received()
        *lines, self._text = self._text[-(1 << 16) :].split(b"\n")
        if len(self._text) > MAX_LINE:
            self._text = b""
        for line in lines:
            self._take(line.decode("ascii", "replace").strip())
        if time.monotonic() - self._asked > ASK_AGAIN:
            self._ask()
        torque = self._constant * self._current
        return MotorReading(self._answers, self._turns, self._current, torque, self._is_on, self._fault)

    def switch_on(self, command: MotorCommand) -> None:
        """Set mode, limit and target of a motor that is off, then switch it on."""
        self._cap = 0.0
        self._write(*(self._letter + line for line in ("E0", "C2", "LC0")))
        self.send(command)
        self._write(f"{self._letter}E1")

    def send(self, command: MotorCommand) -> None:
        """Send limit and target, in the order in which no target is used with a larger limit.

        A torque is that limit, with a target ahead of the shaft. Torque mode would interpret the old target
        as a current, 3 rad as 3 A, unless the motor is off during the change.
        """
        turns, cap = command.turns, command.torque_cap
        if command.mode is DriveMode.FORCE:
            turns = self._turns + math.copysign(TORQUE_LEAD, command.torque)
            cap = min(abs(command.torque), cap)
        lines, limit = [f"{TURN * turns:.4f}"], [f"LC{cap / self._constant:.4f}"]
        if cap != self._cap:
            lines = limit + lines if cap < self._cap else lines + limit
        self._cap = cap
        self._write(*(self._letter + line for line in lines))

    def switch_off(self) -> None:
        """Disable the motor."""
        self._write(f"{self._letter}E0", f"{self._letter}E")

    def stop(self) -> None:
        """Disable the motor, the only stop of Commander."""
        self.switch_off()

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def _take(self, line: str) -> None:
        """Parse an answer; ignore other lines, such as truncated ones."""
        states, status, control = f"{self._letter}MG", f"{self._letter}E", f"{self._letter}T"
        if line.startswith(states):
            with suppress(ValueError):
                values = [float(value) for value in line.removeprefix(states).split(";")]
                if len(values) == STATES and all(math.isfinite(value) for value in values):
                    self._turns, self._current = values[ANGLE_PLACE] / TURN, values[CURRENT_PLACE]
                    self._answers += 1
                    self._ask()
        elif line in (f"{status}0", f"{status}1"):
            self._is_on = line.endswith("1")
        elif line.startswith(control):
            is_voltage = line.removeprefix(control).startswith("volt")
            self._fault = (
                "controls its voltage, expected its current (torque type 1 or 2)" if is_voltage else ""
            )

    def _ask(self) -> None:
        self._asked = time.monotonic()
        if not self._answers:  # a board that restarts when its port opens loses the first lines
            self._write("@3", "#6", f"{self._letter}T")
        self._write(f"{self._letter}MG7", f"{self._letter}E")

    def _received(self) -> bytes:
        try:
            return bytes(self._port.read(4096))
        except OSError as failure:  # pyserial's errors are of this kind
            raise MotorError(f"the port {self._port.name} failed ({failure})") from failure

    def _write(self, *lines: str) -> None:
        try:
            self._port.write("".join(f"{line}\n" for line in lines).encode("ascii"))
        except OSError as failure:
            raise MotorError(f"the port {self._port.name} failed ({failure})") from failure


def open_driver(address: MotorAddress, settings: MotorSettings) -> SimpleFoc:
    """Open the serial port of an address."""
    import serial

    baud = address.whole("baud", 115200, 1200, 12_000_000)
    letter = address.word("motor", "M")
    address.check_options()
    if len(letter) != 1 or not (letter.isascii() and letter.isalpha()):
        raise address.refuse(f"motor={letter}, expected one letter")
    try:
        port = serial.Serial(address.place, baud, timeout=0, write_timeout=0.05)
    except (OSError, ValueError) as failure:
        raise address.refuse(f"the port cannot be opened ({failure})") from failure
    return SimpleFoc(port, letter, settings.torque_constant)
