"""Driver of an ODrive by its "CAN simple" protocol, over any bus of python-can.

``odrive-can://CHANNEL?bus=socketcan&node=0&bitrate=1000000&kt=0.05``; an identifier is the node's number
shifted by 5 bits and the number of the message, numbers are little-endian, turns and newton metres are those
of the motor. The ODrive's own watchdog (``axis.config.enable_watchdog``) must be set by its tool: commands
feed it, and it ends the motion if this program fails to.

Source: ODrive documentation, "CAN Protocol": table of messages (can-protocol.csv, firmware 0.5; in 0.6 the
ones used here are the same, with the heartbeat's bytes beyond the state left unread).
"""

import math
import struct
import time
from contextlib import suppress
from typing import Any

from proximity.decaff.drum.servo import DriveMode
from proximity.decaff.motors.motor_driver import MotorAddress, MotorCommand, MotorReading, MotorSettings
from proximity.errors import MotorError

HEARTBEAT, ESTOP, SET_STATE, ESTIMATES = 0x01, 0x02, 0x07, 0x09
SET_MODE, INPUT_POSITION, INPUT_TORQUE, SET_LIMITS, GET_CURRENT = 0x0B, 0x0C, 0x0E, 0x0F, 0x14
STATE_IDLE, STATE_CLOSED_LOOP = 1, 8
CONTROL_TORQUE, CONTROL_POSITION, INPUT_PASSTHROUGH = 1, 3, 1
MAX_WAITING = 200  # messages of one reading: a flooded bus must not block the controller
HEARTBEAT_AGE = 0.5  # s; an ODrive sends one each 0.1 s
SPEED_LIMIT = 160.0  # turns/s: beyond, the ODrive switches itself off


class ODriveCan:
    """An axis of an ODrive.

    *torque_constant*: of the motor, as set in the ODrive.
    """

    def __init__(self, bus: Any, node: int, torque_constant: float) -> None:
        self._bus, self._node, self._constant = bus, node, torque_constant
        self._answers, self._turns, self._current = 0, 0.0, 0.0
        self._error, self._state, self._beat = 0, 0, time.monotonic()
        self._mode: DriveMode | None = None
        self._cap = math.nan

    def read(self) -> MotorReading:
        """Read all arrived messages, and request encoder and current."""
        for _ in range(MAX_WAITING):
            message = self._received()
            if message is None:
                break
            if message.arbitration_id >> 5 == self._node and not message.is_remote_frame:
                self._take(message.arbitration_id & 0x1F, bytes(message.data))
        self._ask(ESTIMATES)
        self._ask(GET_CURRENT)
        fault = f"reports axis error 0x{self._error:x}" if self._error else ""
        if not fault and time.monotonic() - self._beat > HEARTBEAT_AGE:
            fault = f"has sent no heartbeat for {HEARTBEAT_AGE:g} s"
        is_on = self._state == STATE_CLOSED_LOOP
        torque = self._constant * self._current
        return MotorReading(self._answers, self._turns, self._current, torque, is_on, fault)

    def switch_on(self, command: MotorCommand) -> None:
        """Request closed-loop control; latched errors of the axis are for a person to clear."""
        self._mode, self._cap = None, math.nan
        self.send(command)
        self._send(SET_STATE, struct.pack("<I", STATE_CLOSED_LOOP))

    def send(self, command: MotorCommand) -> None:
        """Send limits, target and mode; the target goes before the mode that will use it."""
        if command.torque_cap != self._cap:
            self._cap = command.torque_cap
            self._send(SET_LIMITS, struct.pack("<ff", SPEED_LIMIT, self._cap / self._constant))
        if command.mode is DriveMode.POSITION:
            self._send(INPUT_POSITION, struct.pack("<fhh", command.turns, 0, 0))
        else:
            self._send(INPUT_TORQUE, struct.pack("<f", command.torque))
        if command.mode is not self._mode:
            self._mode = command.mode
            control = CONTROL_POSITION if self._mode is DriveMode.POSITION else CONTROL_TORQUE
            self._send(SET_MODE, struct.pack("<II", control, INPUT_PASSTHROUGH))

    def switch_off(self) -> None:
        """Request the idle state."""
        self._send(SET_STATE, struct.pack("<I", STATE_IDLE))

    def stop(self) -> None:
        """Send the emergency stop; the axis then has an error until a person clears it."""
        self._send(ESTOP, b"")

    def close(self) -> None:
        """Close the bus."""
        self._bus.shutdown()

    def _take(self, message: int, data: bytes) -> None:
        with suppress(struct.error):  # too short: no answer
            if message == HEARTBEAT:
                self._error, self._state = struct.unpack_from("<IB", data)
                self._beat = time.monotonic()
            elif message == ESTIMATES:
                turns, _ = struct.unpack("<ff", data)
                if math.isfinite(turns):
                    self._turns = turns
                    self._answers += 1
            elif message == GET_CURRENT:
                _, current = struct.unpack("<ff", data)
                if math.isfinite(current):
                    self._current = current

    def _received(self) -> Any:
        from can import CanError

        try:
            return self._bus.recv(timeout=0.0)
        except (CanError, OSError) as failure:
            raise MotorError(f"the bus of node {self._node} failed ({failure})") from failure

    def _ask(self, message: int) -> None:
        self._send(message, b"", is_remote=True)

    def _send(self, message: int, data: bytes, *, is_remote: bool = False) -> None:
        from can import CanError, Message

        identifier = self._node << 5 | message
        frame = Message(arbitration_id=identifier, data=data, is_extended_id=False, is_remote_frame=is_remote)
        try:
            self._bus.send(frame)
        except (CanError, OSError) as failure:
            raise MotorError(f"the bus of node {self._node} failed ({failure})") from failure


def open_driver(address: MotorAddress, settings: MotorSettings) -> ODriveCan:
    """Open the bus of an address."""
    import can

    node = address.whole("node", 0, 0, 63)
    options: dict[str, Any] = {"interface": address.word("bus", "socketcan"), "channel": address.place}
    bitrate = address.whole("bitrate", 0, 0, 8_000_000)
    address.check_options()
    if bitrate:
        options |= {"bitrate": bitrate}
    try:
        bus = can.Bus(**options)
    except (can.CanError, OSError, ValueError, ImportError) as failure:
        raise address.refuse(f"the bus cannot be opened ({failure})") from failure
    return ODriveCan(bus, node, settings.torque_constant)
