"""Controller of one finger's drum, stepped at each sample of the servo (guide/drums.md).

It wraps the C of ``decaff_controller.c``, which also runs on a chip.
"""

import math
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import brentq

from proximity.checks import finite, not_negative, positive, whole
from proximity.decaff.controller.compiled import ACTION, CONTROLLER, OBSERVATION, PATH, in_c, memory
from proximity.decaff.controller.settings import CableRule, ControllerSettings, Limits
from proximity.decaff.drum.drum_model import Drum
from proximity.decaff.drum.servo import SERVO_RATE, DriveMode, DrumCommand
from proximity.decaff.glove.finger_path import MAX_BEND, MIN_BEND, FingerPath
from proximity.message import CONTACT, State


class DrumState(Enum):
    """State of a drum."""

    RETRACTED = "retracted"
    """Out of the finger's path, or on its path there."""
    APPROACH = "approach"
    """At, or moving to, the position where the finger will touch."""
    CONTACT_POSITION = "position"
    """The finger touches; the position is held."""
    CONTACT_FORCE = "force"
    """The finger touches; a force is served."""
    HOLD = "hold"
    """The finger touches, and the data are old: no advance."""
    FREEZE = "freeze"
    """The finger touches, without data: unchanged for a while, then without force."""
    FAULT = "fault"
    """The motor is braked until the controller is reset."""


IN_CONTACT = frozenset(
    (DrumState.CONTACT_POSITION, DrumState.CONTACT_FORCE, DrumState.HOLD, DrumState.FREEZE)
)


class Trust(IntEnum):
    """Trust in a finger's newest frames."""

    FRESH = 0
    """Valid, tracked, and young enough to act on."""
    OLD = 1
    """Valid; older than that."""
    STALE = 2
    """Too old, or unknown to the service."""
    LOST = 3
    """The finger is not tracked, or no frame has arrived."""


class FrameMark(NamedTuple):
    """Identity of a frame, and its instant."""

    session: int
    sequence: int
    start_ns: int  # of its tick, on the clock of the frames

    @classmethod
    def of(cls, header: Any) -> "FrameMark | None":
        """Return the mark of a frame's header; None: no frame yet."""
        if header is None:
            return None
        return cls(int(header["session"]), int(header["sequence"]), int(header["start_ns"]))


@dataclass(frozen=True, slots=True)
class Observation:
    """Observations at a sample of the servo.

    There are two clocks. The clock of the frames may be another machine's, and estimated: it jumps when the
    estimate improves, and serves for the ages of frames only. The drum's time is the clock of the samples.
    """

    now_ns: int  # of the sample, on the clock of the frames
    bend: float  # of the finger, by the potentiometer; nan, or an impossible bend: a fault
    drum_angle: float  # rad, by the encoder; nan, or far off the finger's path: a fault
    state: State = State.STALE  # of the newest reading
    contact: Any = None  # CONTACT, this finger's record of it; None: no frame yet
    force: float = math.nan  # N, between finger and drum; nan: not measured
    has_fault: bool = False  # of motor or current
    motor_force: float = math.nan  # N, of the motor on the finger; nan: not known
    sample_ns: int = field(kw_only=True)  # of the sample, on this machine's monotonic clock
    frame: FrameMark | None = field(default=None, kw_only=True)  # of the record; None: no frame yet


@dataclass(frozen=True, slots=True)
class DrumAction:
    """Action of the drum until the next sample."""

    state: DrumState
    mode: DriveMode
    position: float  # m of the finger's path, target of the drum
    angle: float  # rad, of the drum, there
    force: float  # N to press with, in force mode
    speed_cap: float  # m/s at the fingertip
    force_cap: float  # N at the fingertip
    start_force: float = math.nan  # N, start of a change to force
    torque: float = 0.0  # N m at the motor's shaft for that force, in force mode
    torque_cap: float = 0.0  # N m at the motor's shaft: by the force cap and the limits of motor and gear
    motor_speed_cap: float = 0.0  # rad/s of the motor's shaft, at most
    force_slew: float = 0.0  # N/s at the fingertip, of the force; 0: that of a handover, inf: a step
    heat: float = 0.0  # of the motor, as a share; from 1 on its force is limited to the continuous one
    is_hot: bool = False  # that limit is active, until the motor is cooler
    is_anew: bool = False  # samples were missed: the servo of a chip restarts its mode


def commanded(action: DrumAction, target: float) -> DrumCommand:
    """Return the command of the servo for a controller's action.

    *target*: its position, in the servo's coordinate; or its force.
    """
    return DrumCommand(
        action.mode, target, action.speed_cap, action.force_cap, action.start_force, action.force_slew
    )


def required_damping(stiffness: float, damping: float, period: float, delay_samples: int = 0) -> float:
    """Return the damping of the device above which the sampled wall is passive, N·s/m.

    Notes
    -----
    Source: Colgate & Schenkel 1997, b > T/2 Re((1 - 1/z) H(z)) / (1 - cos) on the unit circle. For this
    wall the right side is K T/2 sin((2d+1)w/2) / sin(w/2) - B cos((d+1)w), a polynomial in the cosine of w,
    whose largest value is found exactly.
    """
    stiffness = not_negative("stiffness", stiffness, "newtons a metre")
    period = positive("period", period, "seconds")
    delay_samples = whole("delay_samples", delay_samples, 0)
    series = np.zeros(delay_samples + 2)  # of Chebyshev polynomials in the cosine
    series[0] = 0.5 * stiffness * period
    series[1:-1] = stiffness * period
    series[-1] = -finite("damping", damping, "newton seconds a metre")
    return _largest(series)


def largest_passive_stiffness(
    device_damping: float, damping: float, period: float, delay_samples: int = 0
) -> float:
    """Return the stiffness up to which a wall is passive, N/m; 0 if its damping alone is too large."""
    own = not_negative("device_damping", device_damping, "newton seconds a metre")
    if own <= required_damping(0.0, damping, period, delay_samples):
        return 0.0
    # At the slowest hand the bound is K T (2d+1)/2 - B, its minimum.
    most = 2.0 * (own + abs(damping)) / (period * (2 * delay_samples + 1))

    def lack(stiffness: float) -> float:
        return required_damping(stiffness, damping, period, delay_samples) - own

    return float(brentq(lack, 0.0, most * (1.0 + 1e-9), xtol=1e-12 * most))


def _largest(series: np.ndarray) -> float:
    """Return the maximum of a Chebyshev series between -1 and 1."""
    negligible = np.finfo(np.float64).eps * np.abs(series).max()
    turns = chebyshev.chebroots(chebyshev.chebder(chebyshev.chebtrim(series, negligible)))
    # Candidates that are not extrema do no harm: their value is not above the maximum.
    positions = np.clip(turns.real, -1.0, 1.0)
    return float(chebyshev.chebval(np.array([-1.0, 1.0, *positions]), series).max())


STATES, MODES = tuple(DrumState), tuple(DriveMode)
NO_FAULT, WATCHDOG, NO_BEND, BEND, NO_ANGLE, ANGLE, MOTOR = range(7)  # enum decaff_fault
DELAY_SAMPLES = 1  # the servo's output acts a sample later, plus the motor's latency


class SurfaceLaw:
    """``F = k delta + b delta'``, never pulling, within the bound of passivity of drum and pad together.

    Only physical damping counts: that of the drum, and of the pad of the finger on it. The servo's is sampled
    and delayed, like the surface, and does not reliably dissipate energy.
    """

    def __init__(self, settings: ControllerSettings, drum_damping: float = 0.0) -> None:
        self._period, self._drum = 1.0 / settings.rate, drum_damping  # N s/m, the drum's own
        self._delay = DELAY_SAMPLES + math.ceil(settings.drum.motor.latency / self._period - 1e-9)
        self._settings = settings.record()[1][0]

    def displayed(self, stiffness: float, damping: float) -> tuple[float, float]:
        """Return the displayed stiffness, N/m, and damping, N s/m, of a surface."""
        displayed = in_c("displayed")(self._settings, stiffness, damping)
        return displayed[0], displayed[1]

    def lacking(self, stiffness: float, damping: float) -> float:
        """Return the damping that the drum alone lacks to display a surface passively, N s/m; 0: none."""
        k, b = self.displayed(stiffness, damping)
        return max(0.0, required_damping(k, b, self._period, self._delay) - self._drum)


class FingerController:
    """Computes the drum's position or force for one finger, sample by sample.

    *drum*: the driven drum; its mass bounds its speed near the finger. *cable*: its stretch is compensated
    while a position is held; by default it is not.
    """

    fault: str  # why the motor has no power; "": it has
    law: SurfaceLaw  # of deformable surfaces, as displayed

    def __init__(
        self,
        path: FingerPath,
        rate: float = SERVO_RATE,
        drum: Drum | None = None,
        limits: Limits | None = None,
        cable: CableRule | None = None,
    ) -> None:
        settings = ControllerSettings(rate, drum or path.drum, limits or Limits(), cable=cable or CableRule())
        self._path, self._drum, self._limits = path, settings.drum, settings.limits
        # C keeps addresses of these arrays, which must outlive it.
        _, self._settings = settings.record()
        self._tables = [np.array(table, np.float64) for table in path.tables()]
        self._place, _, place_content = memory(PATH)
        addresses = [table.ctypes.data for table in self._tables]
        self._place[0] = (len(self._tables[0]), *addresses, self._settings.ctypes.data)
        _, self.known, self._known = memory(CONTROLLER)
        self._sample, _, self._seen = memory(OBSERVATION)
        self._answer, _, self._action = memory(ACTION)
        self._contact = np.zeros(1, CONTACT)
        self._contact_address = self._contact.ctypes.data
        self._step, self._reset = in_c("step"), in_c("reset")
        in_c("begin")(self._known[0], place_content[0])
        self.law = SurfaceLaw(settings)
        self.fault, self._sample_ns = "", 0

    @property
    def state(self) -> DrumState:
        """State of the drum."""
        return STATES[self.known.state]

    @property
    def trust(self) -> Trust:
        """Trust in the newest frames."""
        return Trust(self.known.trust)

    @property
    def frames(self) -> np.record:
        """Trusted frames, with the header's fields: reading, location, counts."""
        return self.known.frames

    def reset(self) -> None:
        """Restart after a fault or an emergency stop, retracted, with no trusted frame."""
        self._reset(self._known[0])
        self.fault = ""

    def stop(self) -> None:
        """Retract and stay there until `reset`: the emergency stop."""
        self.known.is_stopped = True

    def step(self, seen: Observation) -> DrumAction:
        """Return the drum's action until the next sample."""
        if self.fault and not self.known.fault:  # set externally, by a power-off
            self.known.fault = MOTOR
        address, frame = 0, seen.frame
        if seen.contact is not None and frame is not None:
            self._contact[0], address = seen.contact, self._contact_address
        self._sample[0] = (
            seen.sample_ns, seen.now_ns, seen.state, address, *(frame or (0, 0, 0)),
            seen.bend, seen.drum_angle, seen.force, seen.has_fault, seen.motor_force,
        )  # fmt: skip
        self._step(self._known, self._seen, self._action)
        if self.known.fault and not self.fault:
            self.fault = self._sentence(seen)
        self._sample_ns = seen.sample_ns
        state, mode, *numbers = self._answer[0].item()
        return DrumAction(STATES[state], MODES[mode], *numbers)

    def _sentence(self, seen: Observation) -> str:
        """Return the reason why the motor is off, from the sample that showed it."""
        late_ns, (least, most) = seen.sample_ns - self._sample_ns, self._path.drum_angles
        bends = f"expected {MIN_BEND:g} to {MAX_BEND:g}"
        return {
            WATCHDOG: f"the servo was {1e-6 * late_ns:.1f} ms from its last sample",
            NO_BEND: "the potentiometer gives no bend",
            BEND: f"the potentiometer reads a bend of {seen.bend:g}, {bends}",
            NO_ANGLE: "the encoder gives no drum angle",
            ANGLE: f"the encoder reads a drum angle of {seen.drum_angle:g} rad, but the finger's path goes "
            f"from {least:.3g} to {most:.3g} rad",
            MOTOR: "the motor reports a fault",
        }[int(self.known.fault)]
