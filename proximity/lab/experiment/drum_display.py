"""Display of surfaces by the drum of a service's finger, simulated or moved by a motor.

A thread steps the drums at a rate, as `proximity drum` does; `DrumDisplay.present` sets what the drum of one
finger displays and waits. Between intervals, after an emergency stop, and beyond a limit the drum retracts.
"""

import math
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from proximity.decaff.controller.controller import (
    DrumAction,
    FingerController,
    Observation,
    SurfaceLaw,
    Trust,
)
from proximity.decaff.controller.settings import ControllerSettings, Limits
from proximity.decaff.drum.servo import DriveMode
from proximity.decaff.glove.calibrated_glove import CalibratedGlove
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.decaff.motors.motor_drum import MotorDrum
from proximity.decaff.simulated_drums import SOFTER, DrumBench, FingerBench, with_bend
from proximity.errors import ArgumentError
from proximity.lab.experiment.design import Design
from proximity.lab.experiment.display import FRAME, Interval, Presentation, interval_of, stopped_by_force
from proximity.lab.simulation.simulated_press import Wall
from proximity.message import Surface
from proximity.message.contact import ContactFlag
from proximity.system.time_units import NS_PER_MS, S_PER_NS
from proximity.transport import Reading

RELEASED_S = 0.4  # after which a touch is over
TOUCHED_N = 0.1
SIMULATED_WATCHDOG_NS = 200 * NS_PER_MS  # a simulated drum that a busy machine steps late is harmless
SILENCE_S = 2.0  # beyond the longest interval, time for the drums to end it


class CoupledController(FingerController):
    """Coupled wall on a contact drum, the reference for DECAFF: delayed forces with separate gains.

    The drum waits at the surface, as for any deformable part; after the touch it presses with a spring and a
    damper on delayed positions, passive or not. A traditional device also has a motor that the finger carries
    in free motion, which is missing here. Frames, faults, limits and the emergency stop are those of the drum
    controller.
    """

    def __init__(self, path: FingerPath, rate: float, limits: Limits, interval: Interval) -> None:
        super().__init__(path, rate, limits=limits)
        self._interval, self._latency_ns = interval, round(interval.latency / S_PER_NS)
        self._depths: deque[tuple[int, float]] = deque()  # ns of the sample, m past the surface
        self._served = 0.0  # N, of the last sample

    def step(self, seen: Observation) -> DrumAction:
        """Return the drum's action, with the wall's force in force mode."""
        action = super().step(seen)
        if action.mode is DriveMode.FORCE:
            force = min(self._wall_force(seen.sample_ns), self._limits.continuous_force, action.force_cap)
            # An uncertain contact does not increase the force.
            self._served = force if self.trust is Trust.FRESH else min(force, self._served)
            action = replace(action, force=self._served, torque=self._drum.motor_torque(self._served))
        known = self.known
        if math.isfinite(known.finger) and math.isfinite(known.target):
            self._depths.append((seen.sample_ns, float(known.finger - known.target)))
        return action

    def _wall_force(self, sample_ns: int) -> float:
        depths, known_ns = self._depths, sample_ns - self._latency_ns
        while len(depths) > 2 and depths[2][0] <= known_ns:
            depths.popleft()
        if len(depths) < 2 or depths[1][0] > known_ns:
            return 0.0
        (before_ns, before), (at_ns, depth) = depths[0], depths[1]
        if not depth > 0.0:
            return 0.0
        speed = (depth - before) / (S_PER_NS * (at_ns - before_ns))
        incidence = float(self.frames.location.incidence) if self.frames.has_location else 1.0
        return max(0.0, incidence**2 * (self._interval.spring * depth + self._interval.damping * speed))


class DrumDisplay(DrumBench):
    """Drums of a service, one of which displays surfaces."""

    name = "drum"

    def __init__(
        self,
        rate: float,
        finger: int = 0,
        gloves: Sequence[Glove | CalibratedGlove] | None = None,
        motors: Sequence[MotorDrum] = (),
    ) -> None:
        super().__init__(rate, gloves, motors=motors)
        self.name = "drum with a motor" if finger < len(motors) else "simulated drum"
        self._shown_by = finger
        self._interval: Interval | None = None
        self._limits_of_interval = (0.0, 0.0)
        self._is_over, self._why, self._is_new = threading.Event(), "", False
        self._frames: list[tuple[float, float, float, float]] = []
        self._began_ns = self._touched_ns = self._faults = 0
        self._failure = self._stopped = ""  # why the drums no longer move
        self._readings: deque[tuple[int, Reading]] = deque()  # by the instant of their sample

    def check(self, design: Design) -> None:
        """Raise for a design whose soft surfaces this drum would display softer."""
        law = SurfaceLaw(ControllerSettings(self._rate))
        for task in design.tasks:
            for condition in design.conditions:
                if task.stiffness is None or condition.wall is not Wall.DECAFF:
                    continue
                asked = interval_of(task, condition, max(task.levels))
                stiffness = asked.stiffness or 0.0
                k, b = law.displayed(stiffness, asked.damping)
                if k < (1.0 - SOFTER) * stiffness or b < asked.damping:
                    raise ArgumentError(
                        f"task {task.name}, condition {condition.name}: {stiffness:g} N/m with "
                        f"{asked.damping:g} N s/m are requested, but at {self._rate:g} Hz this drum displays "
                        f"{k:.0f} N/m with {b:g} N s/m: expected a softer surface, or a higher --rate"
                    )

    def present(self, interval: Interval, limit_force: float, limit_seconds: float) -> Presentation:
        """Display an interval, until the finger has touched and left, or a limit is exceeded."""
        self._frames, self._why = [], ""
        self._limits_of_interval = (limit_force, limit_seconds)
        self._is_over.clear()
        self._is_new, self._interval = True, interval
        if self._stopped:  # even if that was a moment ago
            self._end(self._stopped)
        is_over = self._is_over.wait(limit_seconds + SILENCE_S)
        self._interval = None
        if not is_over or self._failure:
            why = self._failure or "no frames come from the service"
            raise ArgumentError(f"the drum of finger {self._shown_by} does not move: {why}")
        return Presentation(np.array(self._frames, FRAME), self._why)

    def stop(self, why: str) -> None:
        """Retract, and display no further surface: the emergency stop. Any thread may call it."""
        self._stopped = why
        self._end(why)

    def _end(self, why: str) -> None:
        """End the interval and retract."""
        self._why, self._interval = why, None
        for finger in self.fingers:
            finger.controller.stop()
        self._is_over.set()

    def switch_off(self, why: str) -> None:
        """Switch off all motors, and end the interval."""
        super().switch_off(why)
        self._failure = why
        self._is_over.set()

    def step(self, reading: Reading, sample_ns: int) -> None:
        """Run a sample of every finger; only the displaying one is taken as present."""
        interval = None if self._stopped else self._interval
        if interval is not None and self.fingers and self._is_new:
            self._begin(interval, sample_ns)
        super().step(self._displayed(reading, sample_ns, interval), sample_ns)
        if interval is not None and self.fingers and not self._is_new:
            self._record(self.fingers[self._shown_by], reading, sample_ns)

    def _begin(self, interval: Interval, sample_ns: int) -> None:
        """Start an interval's controller for the drum."""
        finger = self.fingers[self._shown_by]
        self._is_new, self._began_ns, self._touched_ns, self._faults = False, sample_ns, 0, finger.faults
        force = self._limits_of_interval[0]
        watchdog_ns = Limits().watchdog_ns if finger.has_motor else SIMULATED_WATCHDOG_NS
        limits = Limits(continuous_force=force, peak_force=force, watchdog_ns=watchdog_ns)
        if interval.wall is Wall.COUPLED:
            finger.controller = CoupledController(finger.path, self._rate, limits, interval)
        else:
            finger.controller = FingerController(finger.path, self._rate, limits=limits, cable=self._cable)

    def _displayed(self, reading: Reading, sample_ns: int, interval: Interval | None) -> Reading:
        """Return the drums' reading: delayed, with the surface of the interval, or without one."""
        contacts = reading.contacts.copy()
        header = None if reading.header is None else reading.header.copy()
        self._readings.append((sample_ns, replace(reading, contacts=contacts, header=header)))
        latency_ns = 0
        if interval is not None and interval.wall is Wall.DECAFF:
            latency_ns = round(interval.latency / S_PER_NS)
        while len(self._readings) > 1 and self._readings[1][0] <= sample_ns - latency_ns:
            self._readings.popleft()
        late = self._readings[0][1]
        contacts = late.contacts.copy()
        is_shown = np.arange(len(contacts)) == self._shown_by
        if interval is None or interval.wall is Wall.REAL:
            is_shown[:] = False  # a real surface, or none
        contacts["flags"][~is_shown] &= ~np.uint32(ContactFlag.TRACKED)
        if interval is not None:
            stiffness = interval.spring if interval.wall is Wall.COUPLED else interval.stiffness
            contacts["surface"] = Surface.RIGID if stiffness is None else Surface.DEFORMABLE
            contacts["stiffness"] = math.inf if stiffness is None else stiffness
            contacts["damping"] = interval.damping
        return replace(late, now_ns=reading.now_ns, contacts=contacts)

    def _record(self, finger: FingerBench, reading: Reading, sample_ns: int) -> None:
        """Write a frame, and end the interval when due."""
        seconds, force = S_PER_NS * (sample_ns - self._began_ns), finger.plant.force
        position, wall = math.nan, math.nan
        if self._shown_by < len(reading.contacts):
            contact = reading.contacts[self._shown_by]
            if not math.isfinite(contact["bend"]):
                contact = with_bend(contact, finger.path)
            if math.isfinite(contact["contact_bend"]):
                surface = finger.path.position(float(contact["contact_bend"]))
                position = finger.path.position(float(contact["bend"])) - surface
                wall = finger.plant.position - surface
        self._frames.append((seconds, position, wall, force))
        if force >= TOUCHED_N:
            self._touched_ns = sample_ns
        limit_force, limit_seconds = self._limits_of_interval
        if not force <= limit_force and math.isfinite(force):
            self._end(stopped_by_force(force, limit_force))
        elif finger.faults > self._faults:
            self._end("the drum's controller had a fault")
        elif seconds >= limit_seconds or (
            self._touched_ns and S_PER_NS * (sample_ns - self._touched_ns) >= RELEASED_S
        ):
            self._interval = None
            self._is_over.set()
