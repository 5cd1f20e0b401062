"""Simulated motors that implement real protocols, over a virtual bus and a pseudo-terminal.

They follow the protocols' documents, not the drivers, so that they do not share a driver's errors.
"""

import math
import os
import random
import struct
import threading
import time
import tty

import can
import canopen
from project import ROOT

DRIVERS = ROOT / "examples" / "motors"
OFF, POSITION, TORQUE = "off", "position", "torque"


class Shaft:
    """Rotor with friction, a position loop, a torque limit, and a mechanical stop; turns and N m.

    Below `held_at` it presses on a spring, as on a fixed replica of a finger.
    """

    def __init__(self, turns=0.0, stop=0.2):
        self.turns, self.speed, self.stop = turns, 0.0, stop
        self.mode, self.target, self.torque_target, self.cap = OFF, turns, 0.0, 0.0
        self.torque = 0.0
        self.inertia, self.viscous, self.friction = 6e-5, 2e-3, 0.0  # N m s² and N m s a turn, N m
        self.held_at, self.stiffness = -math.inf, 0.0  # turns, N m a turn
        self.is_stalled = self.is_silent = self.is_wrong = False
        self.loss = 0.0  # fraction of lost replies
        self.has_moved = False
        self._random = random.Random(7)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def answers(self):
        """Test whether the next reply is sent and not lost."""
        return not self.is_silent and self._random.random() >= self.loss

    def advance(self, seconds):
        """Integrate in small steps."""
        for _ in range(max(1, round(seconds / 2e-4))):
            wish = 0.0
            if self.mode == POSITION:
                wish = 0.6 * (self.target - self.turns) - 0.012 * self.speed
            elif self.mode == TORQUE:
                wish = self.torque_target
            self.torque = min(max(wish, -self.cap), self.cap)
            spring = self.stiffness * max(self.held_at - self.turns, 0.0)
            self.speed += (self.torque + spring - self.viscous * self.speed) / self.inertia * 2e-4
            braked = self.friction / self.inertia * 2e-4
            self.speed -= min(max(self.speed, -braked), braked)
            self.speed = 0.0 if self.is_stalled or self.mode == OFF else self.speed
            before = self.turns
            self.turns += self.speed * 2e-4
            if self.turns >= self.stop:
                self.turns, self.speed = self.stop, min(self.speed, 0.0)
            self.has_moved |= self.turns != before

    def serve(self):
        """Handle pending messages of the protocol; overridden by each motor."""

    def _run(self):
        last = time.monotonic()
        while not self._over.wait(0.0005):
            now = time.monotonic()
            self.advance(min(now - last, 0.05))
            last = now
            self.serve()

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *failure):
        self._over.set()
        self._thread.join()
        self.close()


class ODriveMotor(Shaft):
    """An ODrive axis, firmware 0.6, with heartbeats every 20 ms."""

    def __init__(self, channel, node=3, constant=0.05, bus="virtual", **shaft):
        super().__init__(**shaft)
        self._bus = can.Bus(interface=bus, channel=channel)
        self._node, self._constant, self._beat = node, constant, 0.0
        self.error, self._control, self._input = 0, POSITION, self.turns
        self.url = f"odrive-can://{channel}?bus={bus}&node={node}&kt={constant}"

    def serve(self):
        while (message := self._bus.recv(0.0)) is not None:
            if message.arbitration_id >> 5 == self._node:
                self._take(message.arbitration_id & 31, message.is_remote_frame, bytes(message.data))
        if time.monotonic() - self._beat > 0.02:
            self._beat = time.monotonic()
            self._say(0x01, struct.pack("<IBBBB", self.error, 1 if self.mode == OFF else 8, 0, 0, 0))

    def _take(self, command, is_remote, data):
        if is_remote:
            wrong = float("nan") if self.is_wrong else self.turns
            current = self.torque / self._constant
            self._say(
                command, {0x09: struct.pack("<ff", wrong, 0), 0x14: struct.pack("<ff", 0, current)}[command]
            )
        elif command == 0x02:
            self.mode, self.error = OFF, 1 << 25
        elif command == 0x07:
            self.mode = self._control if struct.unpack("<I", data) == (8,) and not self.error else OFF
        elif command == 0x0B:
            self._control = {1: TORQUE, 3: POSITION}[struct.unpack("<II", data)[0]]
            self.mode = OFF if self.mode == OFF else self._control
        elif command == 0x0C:
            self.target = struct.unpack("<fhh", data)[0]
        elif command == 0x0E:
            self.torque_target = struct.unpack("<f", data)[0]
        elif command == 0x0F:
            self.cap = struct.unpack("<ff", data)[1] * self._constant

    def _say(self, command, data):
        if self.answers():
            self._bus.send(
                can.Message(arbitration_id=self._node << 5 | command, data=data, is_extended_id=False)
            )

    def close(self):
        self._bus.shutdown()


class Cia402Motor(Shaft):
    """A CiA 402 drive: 4096 increments per turn, 0.5 N m and 10 A rated."""

    def __init__(self, channel, node=5, **shaft):
        super().__init__(**shaft)
        self._network = canopen.Network()
        self._network.connect(interface="virtual", channel=channel)
        # Implements all objects itself: the library's server needs a dictionary.
        self.objects = {(0x608F, 1): 4096, (0x608F, 2): 1, (0x6075, 0): 10_000, (0x6076, 0): 500}
        self._node, self.state, self._heard = node, 0x40, None
        self._network.subscribe(0x600 + node, self._serve_object)
        self._network.subscribe(0x200 + node, self._take_control)
        self._network.subscribe(0x300 + node, self._take_torque)
        self._network.subscribe(0x080, self._sync)
        self._network.subscribe(0x77F, lambda *beat: setattr(self, "_heard", time.monotonic()))
        self.url = f"canopen://{channel}?driver={DRIVERS}/cia402.py&bus=virtual&node={node}"

    def serve(self):
        watched = self.objects.get((0x1016, 1), 0) & 0xFFFF
        if watched and self._heard and time.monotonic() - self._heard > 1e-3 * watched + 0.05:
            self.mode, self.state = OFF, 0x08

    def _serve_object(self, identifier, data, timestamp):
        command, index, subindex = struct.unpack_from("<BHB", data)
        if command == 0x40:
            value = self.objects.get((index, subindex))
            answer = (0x43, value) if value is not None else (0x80, 0x06020000)
        else:
            size = 4 - (command >> 2 & 3)
            self.objects[index, subindex] = int.from_bytes(data[4 : 4 + size], "little")
            answer = (0x60, 0)
        if self.answers():
            self._network.send_message(
                0x580 + self._node, struct.pack("<BHBI", answer[0], index, subindex, answer[1])
            )

    def _take_control(self, identifier, data, timestamp):
        # by the mapping and identifier that the driver wrote
        assert [self.objects[0x1600, i] for i in (1, 2, 3)] == [0x60400010, 0x60600008, 0x607A0020]
        control, mode, position = struct.unpack("<Hbi", data)
        self.target = position / 4096
        if self.state == 0x08:
            return
        steps = {(0x40, 0x06): 0x21, (0x21, 0x07): 0x23, (0x23, 0x0F): 0x27, (0x27, 0x0F): 0x27}
        self.state = steps.get((self.state, control), self.state if control & 2 else 0x40)
        self.mode = {8: POSITION, 10: TORQUE}[mode] if self.state == 0x27 else OFF

    def _take_torque(self, identifier, data, timestamp):
        torque, cap = struct.unpack("<hH", data)
        self.torque_target, self.cap = 5e-4 * torque, 5e-4 * cap

    def _sync(self, identifier, data, timestamp):
        if not self.answers():
            return
        position = struct.pack("<Hbi", self.state, 8, round(4096 * self.turns))
        self._network.send_message(0x180 + self._node, position[:4] if self.is_wrong else position)
        thousandths = round(self.torque / 5e-4)
        self._network.send_message(0x280 + self._node, struct.pack("<hh", thousandths, thousandths))

    def close(self):
        self._network.disconnect()


class SimpleFocMotor(Shaft):
    """A board with a Commander at the other end of a pseudo-terminal; it drops lines of 20 letters."""

    def __init__(self, constant=0.05, **shaft):
        super().__init__(**shaft)
        self._end, port = os.openpty()
        tty.setraw(self._end)
        tty.setraw(port)
        os.set_blocking(self._end, False)
        self._port, self._constant, self._text = port, constant, b""
        self._control, self._is_readable, self.dropped = POSITION, False, 0
        self.url = f"simplefoc://{os.ttyname(port)}?driver={DRIVERS}/simplefoc.py&motor=M&kt={constant}"

    def serve(self):
        try:
            self._text += os.read(self._end, 4096)
        except BlockingIOError:
            return
        *lines, self._text = self._text.split(b"\n")
        for line in lines:
            if len(line) + 1 >= 20:
                self.dropped += 1
            else:
                self._take(line.decode())

    def _take(self, line):
        if line == "@3":
            self._is_readable = True
        elif line == "MMG7":
            current = self.torque / self._constant
            values = (self.target, 0, 0, current, 0, 0, 6.283185307179586 * self.turns)
            text = ";".join(f"{value:.6f}" for value in values)
            self._say("MMG" + (text[:9] if self.is_wrong else text))
        elif line.startswith("ME"):
            if line in ("ME0", "ME1"):
                self.mode = self._control if line == "ME1" else OFF
            self._say(f"ME{int(self.mode != OFF)}")
        elif line == "MT":
            self._say("MTfoc curr")
        elif line.startswith("MC"):
            self._control = {"0": TORQUE, "2": POSITION}[line[2:]]
            self._say("MC" + self._control)
        elif line.startswith("MLC"):
            self.cap = float(line[3:]) * self._constant
            self._say(line)
        elif line[1:2] in "-0123456789":
            value = float(line[1:])
            if self._control == POSITION:
                self.target = value / 6.283185307179586
            else:
                self.torque_target = value * self._constant
            self._say(f"M{value:.6f}")

    def _say(self, text):
        if self.answers():
            os.write(self._end, (text if self._is_readable else f"Verbose: {text}").encode() + b"\r\n")

    def close(self):
        os.close(self._port)
        os.close(self._end)
