"""Adapter that runs the drum's controller in the closed loop: distances become frames, actions commands.

The loop's wall is at 0 and its drum waits at some distance from it; the finger's path is laid so that this is
where the controller's drum is retracted.
"""

import math

import numpy as np

from proximity.decaff.controller.controller import FingerController
from proximity.decaff.controller.controller_states import DrumAction, FrameMark, Observation, commanded
from proximity.decaff.drum.drum_command import DriveMode, DrumCommand
from proximity.decaff.glove.finger_path import FingerPath
from proximity.lab.simulation.target_policies import DistanceSample, Holding, Message
from proximity.message import CONTACT, Mode, State, Surface
from proximity.message.contact import ContactFlag

START_NS = 1_000_000_000_000  # the loop's 0 on the clock of frames: its times are negative before the contact


class ControllerInLoop:
    """A `FingerController` as `closed_loop.decaff` asks one."""

    action: DrumAction | None  # of the last sample

    def __init__(
        self,
        controller: FingerController,
        path: FingerPath,
        surface: tuple[float, float] | None = None,
        *,
        has_force_sensor: bool = True,
    ) -> None:
        self._has_force_sensor = has_force_sensor
        self.controller, self._path, self.action = controller, path, None
        self._frame: FrameMark | None = None
        self._wall = path.retracted - Holding().retracted
        self._contact = np.zeros(1, CONTACT)[0]
        self._contact["flags"] = ContactFlag.TRACKED | ContactFlag.EXACT | ContactFlag.SIGNED
        self._contact["normal"] = math.nan
        self._contact["mode"], self._contact["surface"] = Mode.POSITION, Surface.RIGID
        if surface is not None:
            self._contact["surface"] = Surface.DEFORMABLE
            self._contact["stiffness"], self._contact["damping"] = surface

    def command(self, distance_sample: DistanceSample) -> DrumCommand:
        """Return what the drum shall do."""
        if distance_sample.message is not None:
            self._write(distance_sample.message)
        path, now_ns = self._path, START_NS + round(1e9 * distance_sample.now)
        action = self.controller.step(
            Observation(
                now_ns,
                path.bend(self._wall + distance_sample.link),
                path.drum_angle(self._wall + distance_sample.drum),
                State.STALE if distance_sample.message is None else State.OK,
                None if distance_sample.message is None else self._contact,
                distance_sample.force if self._has_force_sensor else math.nan,
                motor_force=-distance_sample.applied,
                sample_ns=now_ns,
                frame=self._frame,
            )
        )
        self.action = action
        target = action.force if action.mode is DriveMode.FORCE else action.position - self._wall
        return commanded(action, target)

    def _write(self, message: Message) -> None:
        """Write a distance as a frame would have it: with the position of contact on the finger's path."""
        reported, path = self._contact, self._path
        pose_ns = START_NS + round(1e9 * message.at)
        if self._frame is None or pose_ns != self._frame.start_ns:
            self._frame = FrameMark(0, 0 if self._frame is None else self._frame.sequence + 1, pose_ns)
        reported["pose_ns"] = pose_ns
        reported["bend"] = path.bend(self._wall + message.link)
        reported["contact_bend"] = path.bend(self._wall + message.link + message.distance)
        for name in ("signed_distance", "lower", "upper"):
            reported[name] = message.distance
