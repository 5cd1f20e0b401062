"""Readers of frames in the closed loop with the engine: they move the drum.

The loop's wall is at 0; on the finger's path it is at the position of contact. A reader converts between the
two.
"""

import math
from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import replace
from typing import Any

from proximity.decaff.controller.controller import FingerController
from proximity.decaff.controller.controller_states import FrameMark, Observation, Trust, commanded
from proximity.decaff.drum.drum_command import DriveMode, DrumCommand
from proximity.decaff.glove.finger_path import FingerPath
from proximity.lab.simulation.controller_in_loop import START_NS
from proximity.lab.simulation.target_policies import DistanceSample, Message, TargetPolicy
from proximity.message import State
from proximity.system.time_units import S_PER_NS

ADVANCE = 1e-9  # m: a target that comes nearer by less than that stays


class Reader(ABC):
    """A reader of frames that moves the drum."""

    def __init__(self) -> None:
        self.states: Counter[str] = Counter()  # samples of the servo, by state
        self.switched_at = math.nan  # s, when a force was served first; nan: never
        self.advances = 0  # samples at which the drum was sent nearer although nothing fresh was known

    @abstractmethod
    def command(
        self,
        distance_sample: DistanceSample,
        now_ns: int,
        state: State,
        contact: Any,
        frame: FrameMark | None,
    ) -> DrumCommand:
        """Return what the drum shall do until the next sample."""


class ControllerReader(Reader):
    """The drum's controller."""

    def __init__(
        self, controller: FingerController, path: FingerPath, wall: float, *, has_force_sensor: bool = True
    ) -> None:
        super().__init__()
        self.controller, self._path, self._wall = controller, path, wall
        self._has_force_sensor = has_force_sensor
        self._target = path.retracted

    def command(
        self,
        distance_sample: DistanceSample,
        now_ns: int,
        state: State,
        contact: Any,
        frame: FrameMark | None,
    ) -> DrumCommand:
        """Return what the controller wants."""
        path, wall = self._path, self._wall
        bend, angle = path.bend(wall + distance_sample.link), path.drum_angle(wall + distance_sample.drum)
        force = distance_sample.force if self._has_force_sensor else math.nan
        action = self.controller.step(
            Observation(
                now_ns,
                bend,
                angle,
                state,
                contact,
                force,
                motor_force=-distance_sample.applied,
                sample_ns=now_ns,
                frame=frame,
            )
        )
        self.states[action.state.value] += 1
        is_force = action.mode is DriveMode.FORCE
        if is_force and math.isnan(self.switched_at):
            self.switched_at = distance_sample.now
        if self.controller.trust is not Trust.FRESH and action.position < self._target - ADVANCE:
            self.advances += 1
        self._target = action.position
        target = action.force if is_force else action.position - wall
        return commanded(action, target)


class PolicyReader(Reader):
    """One of the plain readings of a distance, with the engine's distances along the way."""

    def __init__(self, policy: TargetPolicy, path: FingerPath, wall: float) -> None:
        super().__init__()
        self._policy, self._path, self._wall = policy, path, wall
        self._last = (0, 0.0)  # ns, m: of the frame before
        self._speed = 0.0
        self._message: Message | None = None

    def command(
        self,
        distance_sample: DistanceSample,
        now_ns: int,
        state: State,
        contact: Any,
        frame: FrameMark | None,
    ) -> DrumCommand:
        """Return where the drum shall go."""
        if contact is not None:
            self._take(contact)
        self.states["plain"] += 1
        return self._policy.command(replace(distance_sample, message=self._message))

    def _take(self, contact: Any) -> None:
        pose_ns, bend = int(contact["pose_ns"]), float(contact["bend"])
        if pose_ns == self._last[0] or not math.isfinite(bend):
            return
        position, to = self._path.position(bend), float(contact["contact_bend"])
        if self._last[0]:
            self._speed = (position - self._last[1]) / (S_PER_NS * (pose_ns - self._last[0]))
        self._last = (pose_ns, position)
        self._message = None
        if math.isfinite(to):
            at = S_PER_NS * (pose_ns - START_NS)
            self._message = Message(
                at, position - self._wall, self._speed, self._path.position(to) - position
            )
