"""Driver of a CANopen drive by its profile CiA 402, over `canopen` and any bus of python-can.

``canopen://CHANNEL?driver=examples/motors/cia402.py&bus=socketcan&node=1&bitrate=1000000``; needs the package
canopen. Opening it reads the drive's scales, configures it to monitor our heartbeat, and maps two messages
each way; each reading then sends the targets and a SYNC, which the drive answers. Positions are increments of
the encoder, torques and currents thousandths of the rated ones.

Source: CiA 402 (IEC 61800-7-201): state machine, objects 0x6040 to 0x60FF, modes cyclic synchronous position
(8) and torque (10); CiA 301: mapping (0x1400 to 0x1A01), SYNC, consumer heartbeat (0x1016). The states are
those of `canopen.profiles.p402`. Its path to operation is not used: it waits for the drive and resets faults.
"""

import math
import struct
import time
from contextlib import suppress
from typing import Any

from proximity.decaff.drum.servo import DriveMode
from proximity.decaff.motors.motor_driver import MotorAddress, MotorCommand, MotorReading, MotorSettings
from proximity.errors import MotorError

CONTROL, STATUS, MODE, MODE_SHOWN = 0x6040, 0x6041, 0x6060, 0x6061
TARGET_POSITION, POSITION, TARGET_TORQUE, MAX_TORQUE = 0x607A, 0x6064, 0x6071, 0x6072
TORQUE, CURRENT = 0x6077, 0x6078
RATED_CURRENT, RATED_TORQUE, ENCODER = 0x6075, 0x6076, 0x608F  # mA, mN m, increments a number of turns
CONSUMER_HEARTBEAT, ON_LOST_CONNECTION = 0x1016, 0x6007
SYNC, HEARTBEAT, OPERATIONAL = 0x080, 0x700, b"\x05"
HOST = 127  # our own node's number
HEARTBEAT_S, HEARTBEAT_MS = 0.02, 100  # period of ours; timeout of the drive
MODES = {DriveMode.POSITION: 8, DriveMode.FORCE: 10}
NO_VOLTAGE, SHUT_DOWN, SWITCH_ON, ENABLE = 0x00, 0x06, 0x07, 0x0F
NEXT_CONTROL = {
    "SWITCH ON DISABLED": SHUT_DOWN,
    "READY TO SWITCH ON": SWITCH_ON,
    "SWITCHED ON": ENABLE,
    "OPERATION ENABLED": ENABLE,
}
"""Control word towards operation, by state; all other states are without voltage."""
# Messages: parameters, mapping, identifier, contents (index, bits), transmission type.
RECEIVED = (
    (0x1400, 0x1600, 0x200, ((CONTROL, 16), (MODE, 8), (TARGET_POSITION, 32)), 255),
    (0x1401, 0x1601, 0x300, ((TARGET_TORQUE, 16), (MAX_TORQUE, 16)), 255),
)
SENT = (
    (0x1800, 0x1A00, 0x180, ((STATUS, 16), (MODE_SHOWN, 8), (POSITION, 32)), 1),  # 1: at each SYNC
    (0x1801, 0x1A01, 0x280, ((TORQUE, 16), (CURRENT, 16)), 1),
)
NOT_VALID = 1 << 31  # of a message's identifier, during a change


class Cia402:
    """A drive of the profile."""

    def __init__(self, network: Any, node: int) -> None:
        from canopen import ObjectDictionary, SdoAbortedError, SdoCommunicationError
        from canopen.profiles.p402 import BaseNode402

        self._network, self._node = network, node
        self._drive = network.add_node(BaseNode402(node, ObjectDictionary()))
        self._drive.tpdo_values[STATUS] = 0
        self._answers, self._increments, self._mode_shown, self._torque, self._current = 0, 0, 0, 0, 0
        self._is_wanted, self._command, self._beat = False, MotorCommand(), -math.inf
        try:
            self._increments_a_turn = self._uploaded(ENCODER, "<I", 1) / self._uploaded(ENCODER, "<I", 2)
            self._rated_torque = 1e-3 * self._uploaded(RATED_TORQUE, "<I")
            self._rated_current = 1e-3 * self._uploaded(RATED_CURRENT, "<I")
            self._download(CONSUMER_HEARTBEAT, "<I", HOST << 16 | HEARTBEAT_MS, 1)
            with suppress(SdoAbortedError):  # optional; without it a lost heartbeat is a fault, too
                self._download(ON_LOST_CONNECTION, "<h", 1)
            for message in (*RECEIVED, *SENT):
                self._map(*message)
        except (SdoAbortedError, SdoCommunicationError, struct.error, ZeroDivisionError) as failure:
            raise MotorError(f"node {node} cannot be set up ({failure})") from failure
        if not min(self._increments_a_turn, self._rated_torque, self._rated_current) > 0.0:
            raise MotorError(f"node {node} has no encoder resolution, rated torque or rated current")
        network.subscribe(SENT[0][2] + node, self._take_position)
        network.subscribe(SENT[1][2] + node, self._take_torque)
        self._drive.nmt.state = "OPERATIONAL"

    def read(self) -> MotorReading:
        """Send the targets, and request the next answers by a SYNC."""
        state = str(self._drive.state)
        self._send_targets(state)
        if time.monotonic() - self._beat >= HEARTBEAT_S:
            self._beat = time.monotonic()
            self._send(HEARTBEAT + HOST, OPERATIONAL)
        self._send(SYNC, b"")
        fault = f"is in the state {state}" if "FAULT" in state else ""
        return MotorReading(
            self._answers,
            self._increments / self._increments_a_turn,
            1e-3 * self._current * self._rated_current,
            1e-3 * self._torque * self._rated_torque,
            state == "OPERATION ENABLED",
            fault,
        )

    def switch_on(self, command: MotorCommand) -> None:
        """Start the transition to operation, which the readings continue; faults are reset by hand."""
        self._command, self._is_wanted = command, True

    def send(self, command: MotorCommand) -> None:
        """Store the command, which the next reading sends."""
        self._command = command

    def switch_off(self) -> None:
        """Disable the voltage."""
        self._is_wanted = False
        self._send_targets("")

    def stop(self) -> None:
        """Disable the voltage; a quick stop would brake the drum and hold its position."""
        self.switch_off()

    def close(self) -> None:
        """Disconnect."""
        self._network.disconnect()

    def _send_targets(self, state: str) -> None:
        command = self._command
        control = NEXT_CONTROL.get(state, NO_VOLTAGE) if self._is_wanted else NO_VOLTAGE
        cap = max(0, min(round(1e3 * command.torque_cap / self._rated_torque), 0xFFFF))
        torque = max(-0x8000, min(round(1e3 * command.torque / self._rated_torque), 0x7FFF))
        position = round(command.turns * self._increments_a_turn)
        self._send(RECEIVED[1][2] + self._node, struct.pack("<hH", torque, cap))
        self._send(
            RECEIVED[0][2] + self._node,
            struct.pack("<HbI", control, MODES[command.mode], position & 0xFFFFFFFF),
        )

    def _take_position(self, identifier: int, data: bytes, timestamp: float) -> None:
        with suppress(struct.error):  # another length: no answer
            self._drive.tpdo_values[STATUS], self._mode_shown, self._increments = struct.unpack("<Hbi", data)
            self._answers += 1

    def _take_torque(self, identifier: int, data: bytes, timestamp: float) -> None:
        with suppress(struct.error):
            self._torque, self._current = struct.unpack("<hh", data)

    def _send(self, identifier: int, data: bytes) -> None:
        from can import CanError

        try:
            self._network.send_message(identifier, data)
        except (CanError, OSError) as failure:
            raise MotorError(f"the bus of node {self._node} failed ({failure})") from failure

    def _uploaded(self, index: int, form: str, subindex: int = 0) -> int:
        return int(struct.unpack(form, self._drive.sdo.upload(index, subindex))[0])

    def _download(self, index: int, form: str, value: int, subindex: int = 0) -> None:
        self._drive.sdo.download(index, subindex, struct.pack(form, value))

    def _map(self, settings: int, mapping: int, base: int, objects: tuple[Any, ...], kind: int) -> None:
        """Map objects into a message by CiA 301; the message is invalid during the change."""
        self._download(settings, "<I", NOT_VALID | base + self._node, 1)
        self._download(settings, "<B", kind, 2)
        self._download(mapping, "<B", 0)
        for place, (index, bits) in enumerate(objects, 1):
            self._download(mapping, "<I", index << 16 | bits, place)
        self._download(mapping, "<B", len(objects))
        self._download(settings, "<I", base + self._node, 1)


def open_driver(address: MotorAddress, settings: MotorSettings) -> Cia402:
    """Connect to the bus of an address, and configure its drive, which stays without voltage.

    *settings*: of the motor; the scales are read from the drive.
    """
    import can
    import canopen

    node = address.whole("node", 1, 1, HOST - 1)
    options: dict[str, Any] = {"interface": address.word("bus", "socketcan"), "channel": address.place}
    bitrate = address.whole("bitrate", 0, 0, 8_000_000)
    address.check_options()
    if bitrate:
        options |= {"bitrate": bitrate}
    network = canopen.Network()
    try:
        network.connect(**options)
    except (can.CanError, OSError, ValueError, ImportError) as failure:
        raise address.refuse(f"the bus cannot be opened ({failure})") from failure
    try:
        return Cia402(network, node)
    except MotorError as failure:
        network.disconnect()
        raise address.refuse(str(failure)) from failure
