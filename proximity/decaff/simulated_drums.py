"""Drums for all fingers of a service, with controllers, simulated plants or motors, and potentiometers.

The position of a finger is the service's or, if it reports no bend, that of `with_bend`. The potentiometer
reads that bend, or the bend at which the simulated drum stops the link. A finger with a motor needs a
reported bend. A fault of its controller ends the program, as a person must check it.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from proximity.decaff.controller.controller import (
    IN_CONTACT,
    DrumAction,
    DrumState,
    FingerController,
    FrameMark,
    Observation,
    commanded,
)
from proximity.decaff.controller.served_drum import ServedDrum
from proximity.decaff.controller.settings import CableRule, Limits
from proximity.decaff.drum.drum_model import PAD_STIFFNESS, STOP_GAP, Drum
from proximity.decaff.drum.servo import SERVO_RATE, DriveMode, servo_for
from proximity.decaff.glove.calibrated_glove import CalibratedGlove, as_many
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import CONTACT_BEND, Glove
from proximity.decaff.motors.motor_drum import MotorDrum
from proximity.errors import MotorError
from proximity.message import CONTACT, Mode, State, Surface
from proximity.message.contact import ContactFlag, Contacts
from proximity.system.time_units import S_PER_NS
from proximity.transport import Reading

MAX_STEP = 0.1  # s, maximum duration of one action


class DrumPlant:
    """Simulated drum and the finger's pad on it.

    *drum*: by default that of the path. *cable*: stiffness of the cable at the fingertip, N/m.
    """

    drum: Drum
    force: float  # N, on the finger
    link: float  # m, of the replica's link, which the cable pulls or the drum stops

    def __init__(self, path: FingerPath, drum: Drum | None = None, cable: float = math.inf) -> None:
        drum = drum or path.drum
        stop = path.drum_position(path.drum_angles[1] + STOP_GAP)
        self._path, self.drum = path, drum
        self._served = ServedDrum(drum, servo_for(drum, SERVO_RATE), path.retracted, stop)
        self._positions = np.zeros(self._served.steps)
        self._stiffness = 1.0 / (1.0 / PAD_STIFFNESS + 1.0 / cable)
        self._left = 0.0
        self.force, self.link = 0.0, -math.inf

    @property
    def position(self) -> float:
        """Position of the drum on the finger's path, m."""
        return self._served.position

    @property
    def angle(self) -> float:
        """Angle read by the drum's encoder, rad."""
        return self._path.drum_angle(self.position)

    @property
    def torque(self) -> float:
        """Torque of the motor at its shaft, N m, positive if it presses on the finger."""
        return self.drum.motor_torque(-self._served.applied)

    def advance(self, action: DrumAction, finger: float, seconds: float) -> None:
        """Execute an action for a number of whole samples, at most for a tenth of a second.

        The remaining time is added to the next call.
        """
        served = self._served
        command = commanded(action, action.force if action.mode == DriveMode.FORCE else action.position)
        time = self._left + min(max(seconds, 0.0), MAX_STEP)
        samples = int(time / served.period)
        self._left = time - samples * served.period
        self.force = max(0.0, self._stiffness * (finger - served.arm))
        for _ in range(samples):
            served.serve(command, self.force)
            self.force = served.push(finger, self._stiffness, self._positions)
        self.follow(finger)

    def follow(self, finger: float) -> float:
        """Update the link for a position of the finger, and return its position, m.

        While the finger opens, the link is behind by the play of the cable.
        """
        self.link = min(max(self.link, finger), finger + self._path.play, self.position)
        return self.link


CARRIED_NS = 20_000_000  # extrapolation time of a finger's motion
POWERS = "force", "speed_cap", "force_cap", "torque", "torque_cap", "motor_speed_cap"
NO_POWER: dict[str, Any] = dict.fromkeys(POWERS, 0.0)
SOFTER = 1e-6  # relative reduction of a displayed stiffness from which it is reported
SLOPE_STEP = 1e-3  # m, of a difference
NEAR = (Mode.POSITION, Mode.FORCE)


def with_bend(contact: Any, path: FingerPath) -> Any:
    """Return a record as if the finger bent straight to its nearest point.

    A record without a nearest point is unchanged. This is for simulated drums only; a real drum without a
    bend stays retracted.
    """
    distance, closing = float(contact["signed_distance"]), float(contact["approach_speed"])
    if not math.isfinite(distance):
        return contact
    position = path.position(CONTACT_BEND) - distance
    reported, bend = contact.copy(), path.bend(position)
    reported["bend"] = bend
    reported["bend_rate"] = (path.bend(position + SLOPE_STEP) - bend) / SLOPE_STEP * closing
    if int(contact["mode"]) in NEAR:
        reported["contact_bend"], reported["contact_bend_error"] = CONTACT_BEND, 0.0
    else:
        reported["bend_rate"] = math.nan  # no extrapolation, as no contact is expected
    return reported


@dataclass(slots=True)
class FingerBench:
    """One finger with its controller, its plant and statistics."""

    path: FingerPath
    controller: FingerController
    plant: DrumPlant | MotorDrum
    action: DrumAction | None = None
    bend: float = 0.0  # as last reported by the service
    has_bend: bool = False  # whether the service reports the finger's position on its path
    is_seen: bool = False  # whether the service has reported the finger
    touches: int = 0
    faults: int = 0
    peak_force: float = 0.0  # N
    peak_torque: float = 0.0  # N m, of the motor, either way
    samples: Counter[str] = field(default_factory=Counter)  # by state
    reasons: Counter[str] = field(default_factory=Counter)  # of faults

    def step(
        self, reading: Reading, sample_ns: int, elapsed: float, contact: Any, frame: FrameMark | None
    ) -> None:
        """Run one sample of plant and controller."""
        now_ns = reading.now_ns
        contact = self._follow(contact, now_ns)
        before = self.controller.state
        if self.action is not None:
            self.plant.advance(self.action, self.path.position(self.bend), elapsed)
        elif isinstance(self.plant, MotorDrum):
            self.plant.hold()
        link = self.bend
        if isinstance(self.plant, DrumPlant):
            link = self.path.bend(self.plant.follow(self.path.position(self.bend)))
        angle, force = self.plant.angle, self.plant.force
        self.action = self.controller.step(
            Observation(now_ns, link, angle, reading.state, contact, force, sample_ns=sample_ns, frame=frame)
        )
        after = self.action.state
        self.touches += after in IN_CONTACT and before not in IN_CONTACT
        self.peak_force = max(self.peak_force, self.plant.force)
        self.peak_torque = max(self.peak_torque, abs(self.plant.torque))
        self.samples[after.value] += 1
        if self.controller.fault:
            self.faults += 1
            self.reasons[self.controller.fault] += 1
            if isinstance(self.plant, MotorDrum):
                raise self.plant.failed(self.controller.fault)
            self.controller.reset()  # no person is there to press a button

    @property
    def has_motor(self) -> bool:
        """Whether a real motor moves the drum."""
        return isinstance(self.plant, MotorDrum)

    def switch_off(self, why: str) -> None:
        """Switch the power of the motor off without another step of the controller."""
        self.controller.fault = why
        self.faults += 1
        if isinstance(self.plant, MotorDrum):
            self.plant.switch_off()
        if self.action is not None:
            self.action = replace(self.action, state=DrumState.FAULT, mode=DriveMode.BRAKED, **NO_POWER)

    def _follow(self, contact: Any, now_ns: int) -> Any:
        """Update the position of the finger, and return the record for the controller."""
        if contact is None or not int(contact["flags"]) & ContactFlag.TRACKED:
            return contact
        self.is_seen, self.has_bend = True, math.isfinite(contact["bend"])
        if not self.has_bend and not self.has_motor:
            contact = with_bend(contact, self.path)
        bend, rate = float(contact["bend"]), float(contact["bend_rate"])
        if math.isfinite(bend):
            age = min(max(now_ns - int(contact["pose_ns"]), 0), CARRIED_NS)
            self.bend = min(max(bend + (rate * S_PER_NS * age if math.isfinite(rate) else 0.0), 0.0), 1.0)
        return contact


class DrumBench:
    """Drums of all fingers.

    *gloves*: one for all fingers, or one for each; by default one with default dimensions. *motors*: homed
    motors of the first fingers; the drums of the other fingers are simulated.
    """

    fingers: list[FingerBench]

    def __init__(
        self,
        rate: float,
        gloves: Sequence[Glove | CalibratedGlove] | None = None,
        limits: Limits | None = None,
        motors: Sequence[MotorDrum] = (),
        cable: CableRule | None = None,
    ) -> None:
        self._rate, self._limits, self._motors = rate, limits, motors
        self._cable = cable or CableRule()
        self._paths = [FingerPath(glove) for glove in gloves or [Glove()]]
        self._sample_ns: int | None = None
        self._announced: set[str] = set()  # matters
        self._is_stale = False  # the newest frame, after the first
        self._silent: list[int] = []  # fingers without a bend, at the last whole sample
        self.fingers = []

    def step(self, reading: Reading, sample_ns: int) -> None:
        """Run one sample of every finger.

        *sample_ns*: present time on this machine's monotonic clock. The reading may use another clock, which
        may jump.
        """
        count, frame = len(reading.contacts), FrameMark.of(reading.header)
        if count and len(self.fingers) != count:
            self.fingers = self._all_fingers(count)
        elapsed = 0.0 if self._sample_ns is None else S_PER_NS * (sample_ns - self._sample_ns)
        self._sample_ns = sample_ns
        if not self.fingers:
            for motor in self._motors:
                motor.hold()
        for i, finger in enumerate(self.fingers):
            contact = reading.contacts[i] if i < count else None
            finger.step(reading, sample_ns, elapsed, contact, frame)
        self._silent = [i for i, finger in enumerate(self.fingers) if finger.is_seen and not finger.has_bend]
        self._is_stale = bool(self.fingers) and reading.state == State.STALE

    def switch_off(self, why: str) -> None:
        """Switch off the power of all motors when their controllers are no longer stepped."""
        for motor in self._motors:
            motor.switch_off()
        for finger in self.fingers:
            finger.switch_off(why)

    def warm_up(self) -> None:
        """Compile the code of a step, on a temporary finger."""
        finger = self._finger(self._paths[0], self._plant(self._paths[0]))
        nothing = Reading(State.STALE, False, 0, -1, None, np.zeros(0, CONTACT).view(Contacts))
        finger.step(nothing, 0, 0.0, None, None)
        finger.step(nothing, 1_000_000, 1e-3, None, None)

    def warnings(self) -> list[str]:
        """Return messages about limitations of the drums with this service. Each message is returned once.

        This method may be called from any thread.
        """
        silent, reported = self._silent, []
        bendless = [i for i in silent if i < len(self._motors)]
        if bendless and "motors" not in self._announced:
            self._announced.add("motors")
            reported.append(
                f"the service reports no bend for finger {', '.join(map(str, bendless))}: its motor keeps "
                "the drum retracted, since a bend comes from a path or a glove"
            )
        silent = silent[len(bendless) :]
        if self._motors and self._is_stale and "stale" not in self._announced:
            self._announced.add("stale")
            reported.append("all frames are too old to be used: the drums release and retract")
        if silent and "bends" not in self._announced:
            self._announced.add("bends")
            reported.append(
                f"the service reports no bend for finger {', '.join(map(str, silent))}: shown as if it bent "
                "straight towards the nearest surface; a real drum stays retracted without a bend, "
                "which comes from a path or a glove"
            )
        for i, finger in enumerate(self.fingers):
            if finger.action is not None and finger.action.is_hot and f"heat {i}" not in self._announced:
                self._announced.add(f"heat {i}")
                reported.append(f"the motor of finger {i} is hot: its force is limited until it has cooled")
            surface = finger.controller.frames.reading
            if not surface.is_known or surface.surface != Surface.DEFORMABLE:
                continue
            law, asked = finger.controller.law, (surface.stiffness, surface.damping)
            shown, _ = law.displayed(*asked)
            matter = f"{surface.stiffness:g} N/m"
            if matter in self._announced or not shown > 0.0:
                continue
            self._announced.add(matter)
            if shown < (1.0 - SOFTER) * surface.stiffness:
                reported.append(
                    f"the part before finger {i} has {matter}, more than this drum can render at "
                    f"{self._rate:g} Hz without adding energy: it is rendered as {shown:.0f} N/m"
                )
            if law.lacking(*asked) > 0.0:
                reported.append(
                    f"at {shown:.0f} N/m the drum itself lacks {law.lacking(*asked):.2g} N s/m of damping "
                    "to be passive on its own: it relies on the damping of a fingertip"
                )
        return reported

    def _all_fingers(self, count: int) -> list[FingerBench]:
        if len(self._motors) > count:
            raise MotorError(f"{len(self._motors)} motors are given, but the service has {count} fingers")
        paths = as_many(self._paths, count)
        plants: list[DrumPlant | MotorDrum] = [*self._motors]
        plants += [self._plant(path) for path in paths[len(plants) :]]
        return [self._finger(path, plant) for path, plant in zip(paths, plants, strict=True)]

    def _finger(self, path: FingerPath, plant: DrumPlant | MotorDrum) -> FingerBench:
        controller = FingerController(path, self._rate, None, self._limits, cable=self._cable)
        return FingerBench(path, controller, plant)

    def _plant(self, path: FingerPath) -> DrumPlant:
        return DrumPlant(path, None, self._cable.stiffness)
