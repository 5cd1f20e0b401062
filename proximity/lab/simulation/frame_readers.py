"""Readers that move the drum of the closed loop, either its controller or a simple use of a distance.

The wall of the loop is at 0, and at the position of contact on the finger's path. A reader converts between
the two. It receives frames of a service, or makes them from the distances of the loop.
"""

import math
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np

from proximity.decaff.controller.controller import (
    DrumAction,
    FingerController,
    FrameMark,
    Observation,
    Trust,
    commanded,
)
from proximity.decaff.drum.servo import DriveMode, DrumCommand
from proximity.decaff.glove.finger_path import FingerPath
from proximity.lab.simulation.devices import Holding
from proximity.lab.simulation.target_policies import DistanceSample, Message, TargetPolicy
from proximity.message import CONTACT, Mode, State, Surface
from proximity.message.contact import ContactFlag
from proximity.system.time_units import S_PER_NS

START_NS = 1_000_000_000_000  # time 0 of the loop on the clock of frames; loop times may be negative
ADVANCE = 1e-9  # m, below which the advance of a target is ignored


class ControllerReader:
    """Reader with the drum's controller. *wall*: position of the wall on the finger's path, m."""

    action: DrumAction | None  # of the last sample

    def __init__(
        self, controller: FingerController, path: FingerPath, wall: float, *, has_force_sensor: bool = True
    ) -> None:
        self.controller, self._path, self._wall = controller, path, wall
        self._has_force_sensor = has_force_sensor
        self._target, self.action = path.retracted, None
        self.states: Counter[str] = Counter()  # samples of the servo, by state
        self.switched_at = math.nan  # s, of the first served force; nan: never
        self.advances = 0  # samples at which the drum moved nearer without fresh data

    def read(
        self, sample: DistanceSample, now_ns: int, state: State, contact: Any, frame: FrameMark | None
    ) -> DrumCommand:
        """Return the controller's command for the drum until the next sample."""
        path, wall = self._path, self._wall
        action = self.controller.step(
            Observation(
                now_ns,
                path.bend(wall + sample.link),
                path.drum_angle(wall + sample.drum),
                state,
                contact,
                sample.force if self._has_force_sensor else math.nan,
                motor_force=-sample.applied,
                sample_ns=now_ns,
                frame=frame,
            )
        )
        self.action = action
        self.states[action.state.value] += 1
        is_force = action.mode is DriveMode.FORCE
        if is_force and math.isnan(self.switched_at):
            self.switched_at = sample.now
        if self.controller.trust is not Trust.FRESH and action.position < self._target - ADVANCE:
            self.advances += 1
        self._target = action.position
        return commanded(action, action.force if is_force else action.position - wall)


class ControllerInLoop(ControllerReader):
    """Controller for `closed_loop.decaff`, which converts distances of the loop into frames.

    The drum of the loop waits at a distance from its wall. The finger's path is placed so that the
    controller's drum is retracted at this distance.
    """

    def __init__(
        self,
        controller: FingerController,
        path: FingerPath,
        surface: tuple[float, float] | None = None,
        *,
        has_force_sensor: bool = True,
    ) -> None:
        wall = path.retracted - Holding().retracted
        super().__init__(controller, path, wall, has_force_sensor=has_force_sensor)
        self._frame: FrameMark | None = None
        self._contact = np.zeros(1, CONTACT)[0]
        self._contact["flags"] = ContactFlag.TRACKED | ContactFlag.EXACT | ContactFlag.SIGNED
        self._contact["normal"] = math.nan
        self._contact["mode"], self._contact["surface"] = Mode.POSITION, Surface.RIGID
        if surface is not None:
            self._contact["surface"] = Surface.DEFORMABLE
            self._contact["stiffness"], self._contact["damping"] = surface

    def command(self, distance_sample: DistanceSample) -> DrumCommand:
        """Return the command for the drum until the next sample."""
        now_ns, message = START_NS + round(1e9 * distance_sample.now), distance_sample.message
        if message is None:
            return self.read(distance_sample, now_ns, State.STALE, None, self._frame)
        self._write(message)
        return self.read(distance_sample, now_ns, State.OK, self._contact, self._frame)

    def _write(self, message: Message) -> None:
        """Write a distance in the form of a frame, with the position of contact on the finger's path."""
        reported, path = self._contact, self._path
        pose_ns = START_NS + round(1e9 * message.at)
        if self._frame is None or pose_ns != self._frame.start_ns:
            self._frame = FrameMark(0, 0 if self._frame is None else self._frame.sequence + 1, pose_ns)
        reported["pose_ns"] = pose_ns
        reported["bend"] = path.bend(self._wall + message.link)
        reported["contact_bend"] = path.bend(self._wall + message.link + message.distance)
        for name in ("signed_distance", "lower", "upper"):
            reported[name] = message.distance


class PolicyReader:
    """Reader with a target policy, which uses the distances of frames along the path."""

    switched_at, advances = math.nan, 0  # no force is served, and no data are fresh or stale

    def __init__(self, policy: TargetPolicy, path: FingerPath, wall: float) -> None:
        self.states: Counter[str] = Counter()
        self._policy, self._path, self._wall = policy, path, wall
        self._last = (0, 0.0)  # ns, m: of the previous frame
        self._speed = 0.0
        self._message: Message | None = None

    def read(
        self, sample: DistanceSample, now_ns: int, state: State, contact: Any, frame: FrameMark | None
    ) -> DrumCommand:
        """Return the drum's target until the next sample."""
        del now_ns, state, frame
        if contact is not None:
            self._take(contact)
        self.states["plain"] += 1
        return self._policy.command(replace(sample, message=self._message))

    def _take(self, contact: Any) -> None:
        pose_ns, bend = int(contact["pose_ns"]), float(contact["bend"])
        if pose_ns == self._last[0] or not math.isfinite(bend):
            return
        position, to = self._path.position(bend), float(contact["contact_bend"])
        if self._last[0]:
            self._speed = (position - self._last[1]) / (S_PER_NS * (pose_ns - self._last[0]))
        self._last, self._message = (pose_ns, position), None
        if math.isfinite(to):
            at, distance = S_PER_NS * (pose_ns - START_NS), self._path.position(to) - position
            self._message = Message(at, position - self._wall, self._speed, distance)
