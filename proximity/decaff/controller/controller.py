"""Controller of one finger's drum: a state machine, stepped at each sample of the servo (guide/drums.md).

It never waits for a frame and knows no clock but the instants it is given: ages of frames are on theirs, all
else, the watchdog first, on the servo's. Where the drum shall stand is a *position* on the finger's path,
greater away from the finger. Where it is uncertain the drum holds or retreats, never advances: whatever the
states decide passes `_allowed` last, which lets a target come nearer to the finger only while a sound and
fresh frame is known.
"""

import math

from proximity.decaff.arguments import positive
from proximity.decaff.controller.cable_stretch import CableRule, CableStretch
from proximity.decaff.controller.contact_location import ContactReading
from proximity.decaff.controller.controller_states import (
    IN_CONTACT,
    DrumAction,
    DrumState,
    Observation,
    Trust,
)
from proximity.decaff.controller.drum_limits import ForceBudget, Limits
from proximity.decaff.controller.frame_trust import FrameTrust
from proximity.decaff.controller.release import Release
from proximity.decaff.controller.steady_force import Handover, SteadyForce
from proximity.decaff.controller.surface_law import SurfaceLaw
from proximity.decaff.drum.drum_command import DriveMode
from proximity.decaff.drum.drum_model import Drum
from proximity.decaff.drum.servo import SERVO_RATE
from proximity.decaff.glove.finger_path import LEAST_BEND, MOST_BEND, FingerPath
from proximity.message import Source, Surface

DRUM_DAMPING = 0.0  # N s/m, of the drum itself: the plant has Coulomb friction only
BRAKING_SHARE = 0.5  # of what the drum can brake with, counted on near the finger; assumed
SERVO_LAG = 2e-3  # s, by which the drum's speed follows a new cap late: six samples of its servo; assumed
STRAY_ANGLE = math.pi  # rad, beyond the finger's path: a drum is not parked farther off; assumed
SPEED_CUTOFF = 50.0  # Hz, of the finger's speed by the potentiometer; assumed


class FingerController:
    """Decides, sample by sample, where the drum of one finger stands, or with what force it presses.

    Parameters
    ----------
    path : FingerPath
        Of the finger.
    rate : float, Hz
        Of the servo.
    drum : Drum
        What is driven; its mass bounds how fast it comes near the finger.
    limits : Limits
        Of ages, speeds and forces.
    handover : Handover
        When position gives way to force in teleoperation.
    cable : CableRule
        Whose stretch is made up for while a position is held; none where not given.

    Raises
    ------
    DecaffError
        If the rate cannot be used.
    """

    state: DrumState
    trust: Trust
    frames: FrameTrust
    fault: str  # why the motor is off; empty: it is not
    law: SurfaceLaw  # of deformable surfaces, as far as they are displayed
    _steady: SteadyForce
    _serves_force: bool
    _weak_for: float  # s

    def __init__(
        self,
        path: FingerPath,
        rate: float = SERVO_RATE,
        drum: Drum | None = None,
        limits: Limits | None = None,
        handover: Handover | None = None,
        cable: CableRule | None = None,
    ) -> None:
        self._path, self._rate, self._limits = path, positive("rate", rate, "hertz"), limits or Limits()
        self._handover, drum = handover or Handover(), drum or path.drum
        self._near_speed = self._limits.near_speed(drum.mass)
        self._drum, self._braking = drum, BRAKING_SHARE * drum.acceleration
        self._stretch = CableStretch(cable or CableRule(), self._limits.continuous_force)
        self.law = SurfaceLaw(rate, DRUM_DAMPING)
        self.frames = FrameTrust(path, self._limits)
        self.reset()

    def reset(self) -> None:
        """Start anew after a fault or an emergency stop, retracted, with nothing believed."""
        self.state, self.trust, self.fault = DrumState.RETRACTED, Trust.LOST, ""
        self.frames.forget()
        self._is_stopped = False
        self._target = self._path.retracted
        self._force = math.inf  # N, of the last sample; inf: no force was served
        self._is_late = False
        self._sample_ns: int | None = None
        self._finger = self._speed = math.nan
        self._leave_contact()
        self._stretch.forget()
        self._release = Release(self._limits)
        self._budget = ForceBudget(self._limits)

    def stop(self) -> None:
        """Retract and stay there until `reset`: the emergency stop."""
        self._is_stopped = True

    def step(self, seen: Observation) -> DrumAction:
        """Return what the drum shall do until the next sample."""
        if not self.fault:
            self.fault = self._fault_of(seen)
        elapsed = 0.0 if self._sample_ns is None else 1e-9 * (seen.sample_ns - self._sample_ns)
        self._sample_ns = seen.sample_ns
        if self.fault:
            self.state = DrumState.FAULT
            return self._action(DriveMode.OFF, 0.0, 0.0)
        self._follow_finger(seen, elapsed)
        self.trust = self.frames.take(seen)
        cap = self._budget.cap(seen.force, elapsed)
        drum = self._path.drum_position(seen.drum_angle)
        if self._is_stopped:
            self.state = DrumState.RETRACTED
            return self._free_action(self._path.retracted, drum, cap)
        if self.state in IN_CONTACT and not self._is_released(seen, drum):
            return self._contact(seen, drum, cap, elapsed)
        if self.state in IN_CONTACT:
            self._leave_contact()
        return self._free(seen, drum, cap, elapsed)

    # --- what is measured ---

    def _fault_of(self, seen: Observation) -> str:
        late_ns = 0 if self._sample_ns is None else seen.sample_ns - self._sample_ns
        if not 0 <= late_ns <= self._limits.watchdog_ns:
            return f"the servo was {1e-6 * late_ns:.1f} ms from its last sample"
        if not math.isfinite(seen.bend):
            return "the potentiometer gives no bend"
        if not LEAST_BEND <= seen.bend <= MOST_BEND:
            return (
                f"the potentiometer reads a bend of {seen.bend:g}, expected {LEAST_BEND:g} to {MOST_BEND:g}"
            )
        if not math.isfinite(seen.drum_angle):
            return "the encoder gives no drum angle"
        least, most = self._path.drum_angles
        if not least - STRAY_ANGLE <= seen.drum_angle <= most + STRAY_ANGLE:
            return (
                f"the encoder reads a drum angle of {seen.drum_angle:g} rad, but the finger's path goes from "
                f"{least:.3g} to {most:.3g} rad"
            )
        return "the motor reports a fault" if seen.has_fault else ""

    def _follow_finger(self, seen: Observation, elapsed: float) -> None:
        before, self._finger = self._finger, self._path.position(seen.bend)
        if not elapsed > 0.0 or math.isnan(before):
            self._speed = 0.0 if math.isnan(before) else self._speed
            return
        share = -math.expm1(-2.0 * math.pi * SPEED_CUTOFF * elapsed)
        self._speed += ((self._finger - before) / elapsed - self._speed) * share

    # --- out of contact ---

    def _free(self, seen: Observation, drum: float, cap: float, elapsed: float) -> DrumAction:
        position = self._wanted(seen)
        if position < self._path.retracted:
            self.state = DrumState.APPROACH
            self._target = self._allowed(position)
            if self._touches(seen, drum) and not self._is_clear(seen):
                return self._contact(seen, drum, cap, elapsed)
        else:
            self.state = DrumState.RETRACTED
        return self._free_action(position, drum, cap)

    def _wanted(self, seen: Observation) -> float:
        """Target of the drum while the finger does not touch."""
        if self.trust > Trust.OLD:
            return self._path.retracted
        position = min(self.frames.position(seen.now_ns), self._path.retracted)
        if not self.frames.was_outside:
            # From inside no side of the surface can be known: no nearer than it is, and off the finger.
            return min(max(self._target, self._finger + self._limits.standoff), self._path.retracted)
        if self.trust is Trust.OLD and self.frames.location is not None:
            age = self.frames.age_ns(seen.now_ns)
            position += self._limits.widening(self.frames.location.finger_speed, age)
        return min(position, self._path.retracted)

    def _touches(self, seen: Observation, drum: float) -> bool:
        gap = drum - self._finger
        has_force = seen.force > self._limits.touch_force and gap < self._limits.release_gap
        return gap < self._limits.touch_gap or has_force

    def _free_action(self, position: float, drum: float, cap: float) -> DrumAction:
        self._force = math.inf
        self._stretch.forget()
        self._target = self._allowed(position)
        self._mark_late(drum, may_begin=self.state is DrumState.APPROACH)
        if self._sent >= drum or drum - self._finger > self._limits.near_gap:
            cap = math.inf  # nothing is pressed there but the drum's own mass
        return self._at_position(drum, cap)

    # --- in contact ---

    def _contact(self, seen: Observation, drum: float, cap: float, elapsed: float) -> DrumAction:
        """Hold the position, or serve a force; what is old changes neither, and in the end the force goes."""
        has_waned = self._release.share < 1.0
        share = self._release.take(self.trust, seen.sample_ns)
        self._is_late = self._is_late or (has_waned and share == 1.0)
        if self._release.is_over(seen.force, self._limits.gone_force):
            self._leave_contact()
            self.state = DrumState.RETRACTED
            return self._free_action(self._path.retracted, drum, cap)
        self._mark_late(drum, may_begin=self.state not in IN_CONTACT)
        self._stretch.take(seen.pressing_force, elapsed, may_grow=self.trust is Trust.FRESH)
        force = self._force_wanted(seen, drum, elapsed)
        if self.trust is Trust.FRESH:
            self.state = DrumState.CONTACT_POSITION if math.isnan(force) else DrumState.CONTACT_FORCE
        else:
            self.state = DrumState.HOLD if self.trust is Trust.OLD else DrumState.FREEZE
        if math.isnan(force):
            if self._force < math.inf:  # back from force: the finger may have gone on meanwhile
                self._mark_late(drum, may_begin=True)
            self._force = math.inf
            return self._at_position(drum, share * cap)
        if self.trust is not Trust.FRESH:
            force = min(force, self._force)
        self._force = min(force, self._limits.continuous_force, share * cap)
        return self._action(DriveMode.FORCE, math.inf, share * cap)

    def _force_wanted(self, seen: Observation, drum: float, elapsed: float) -> float:
        """The force to serve, N; nan: the position is held."""
        reading = self.frames.reading
        is_steady = self._steady.take(seen.force if math.isfinite(seen.force) else 0.0, self._speed)
        if reading is None or (self.trust is not Trust.FRESH and self._force == math.inf):
            return math.nan  # where it is uncertain no force begins
        if self._follows_law:
            if drum < self._sent - self._limits.late_gap:
                # It came too near: what a surface serves that is not reached would not hold it.
                return math.nan
            self._serves_force = True
            return self.law.force(
                reading.stiffness, reading.damping, self._finger - self._target,
                self._speed, 1.0 if self.frames.location is None else self.frames.location.incidence,
            )  # fmt: skip
        if reading.source != Source.TELEOPERATION:
            self._serves_force = False  # a rigid part of the scene
            return math.nan
        return self._slave_force(reading, seen, elapsed, is_steady=is_steady)

    @property
    def _follows_law(self) -> bool:
        """Whether the force is a surface's. It must not be slewed: late, it would swing with the drum."""
        reading = self.frames.reading
        return reading is not None and reading.surface == Surface.DEFORMABLE

    def _slave_force(
        self, reading: ContactReading, seen: Observation, elapsed: float, *, is_steady: bool
    ) -> float:
        """Force measured at the far end, from when the first contact is steady until it is lost."""
        is_known = math.isfinite(reading.force)
        is_off = reading.distance > self._handover.lost_distance
        if self._serves_force:
            is_weak = not seen.force >= self._handover.lost_force  # nor is one felt that nobody measures
            self._weak_for = self._weak_for + elapsed if is_weak else 0.0
            self._serves_force = not (is_off or self._weak_for >= self._handover.lost_time)
        elif (
            is_steady and is_known and not is_off and self.trust is Trust.FRESH and math.isfinite(seen.force)
        ):
            self._serves_force, self._weak_for = True, 0.0
        if not self._serves_force:
            return math.nan
        return max(0.0, reading.force) if is_known else self._force

    def _is_released(self, seen: Observation, drum: float) -> bool:
        """Whether finger and drum are apart, or, for certain, finger and object."""
        return drum - self._finger > self._limits.release_gap or self._is_clear(seen)

    def _is_clear(self, seen: Observation) -> bool:
        """Whether finger and object are apart for certain: a drum that is touched then is in the way."""
        reading = self.frames.reading
        if reading is None or self.trust is not Trust.FRESH or seen.contact is None:
            return False
        return reading.lower > self._limits.release_gap

    def _leave_contact(self) -> None:
        self._serves_force, self._weak_for = False, 0.0
        self._steady = SteadyForce(self._rate, self._handover.rule)
        self._release = Release(self._limits)

    # --- what is sent ---

    @property
    def _sent(self) -> float:
        """The target, nearer by the stretch of the cable."""
        return self._target - self._stretch.metres

    def _allowed(self, position: float) -> float:
        """The target that may be set: nearer to the finger only while a fresh frame is known."""
        if not math.isfinite(position):
            return self._target
        return position if self.trust is Trust.FRESH else max(position, self._target)

    def _mark_late(self, drum: float, *, may_begin: bool) -> None:
        """A drum is late from when the finger passes the drum's target first until the drum is there."""
        tolerance = self._limits.late_gap
        if drum <= self._target + tolerance:
            self._is_late = False
        elif may_begin:
            self._is_late = self._finger > self._target + tolerance

    def _at_position(self, drum: float, cap: float) -> DrumAction:
        speed = math.inf
        if self._sent < drum:
            speed = self._closing_cap(drum - self._finger)
            if self._is_late:
                speed = min(speed, self._limits.late_speed)
                # Farther off nothing is pressed, and so weak a motor could not brake what goes away.
                if drum - self._finger <= self._limits.near_gap:
                    cap = min(cap, self._limits.late_force)
        return self._action(DriveMode.POSITION, speed, cap)

    def _closing_cap(self, gap: float) -> float:
        """How fast the drum may come towards the finger: near it, with little energy; farther, so that it
        can brake until there."""
        coming = max(0.0, self._speed)  # while the drum brakes, the finger goes on
        slowest = coming + max(0.0, self._near_speed - self._speed)
        free_gap = max(0.0, gap - self._limits.near_gap)
        # The next cap is a sample away, and the servo follows it late: so long nothing brakes.
        unbraked = self._braking * (1.0 / self._rate + SERVO_LAG)
        return (
            max(slowest, math.sqrt(slowest**2 + unbraked**2 + 2.0 * self._braking * free_gap) - unbraked)
            - coming
        )

    def _action(self, mode: DriveMode, speed: float, cap: float) -> DrumAction:
        is_force = mode is DriveMode.FORCE
        force = self._force if is_force else 0.0
        return DrumAction(
            self.state,
            mode,
            self._sent,
            self._path.drum_angle(self._sent),
            force,
            speed,
            cap,
            self._steady.filtered if is_force else math.nan,
            self._drum.motor_torque(min(force, cap)),
            self._drum.motor_torque(cap),
            self._drum.motor_speed(speed),
            math.inf if is_force and self._follows_law else 0.0,
        )
