"""Inputs, outputs and states of a drum's controller at each sample of the servo."""

import math
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import Any, NamedTuple

from proximity.decaff.drum.servo import DriveMode, DrumCommand
from proximity.message import State


class DrumState(Enum):
    """State of a drum."""

    RETRACTED = "retracted"
    """Out of the finger's path, or on its path there."""
    APPROACH = "approach"
    """Stands, or goes to, where the finger will touch."""
    CONTACT_POSITION = "position"
    """The finger touches; the position is held."""
    CONTACT_FORCE = "force"
    """The finger touches; a force is served."""
    HOLD = "hold"
    """The finger touches, and what is known is old: nothing advances."""
    FREEZE = "freeze"
    """The finger touches, and nothing is known: a moment as it was, then without force."""
    FAULT = "fault"
    """The motor is off until the controller is reset."""


IN_CONTACT = frozenset(
    (DrumState.CONTACT_POSITION, DrumState.CONTACT_FORCE, DrumState.HOLD, DrumState.FREEZE)
)


class Trust(IntEnum):
    """Trust in a finger's newest frames."""

    FRESH = 0
    """Sound, tracked, and young enough to be acted upon."""
    OLD = 1
    """Sound; older than that."""
    STALE = 2
    """Too old, or the service knows nothing."""
    LOST = 3
    """The finger is not tracked, or there never was a frame."""


class FrameMark(NamedTuple):
    """Identity of a frame, and the instant it was made for."""

    session: int
    sequence: int
    start_ns: int  # of its tick, on the clock of the frames

    @classmethod
    def of(cls, header: Any) -> "FrameMark | None":
        """Take it from a frame's header; None: no frame yet."""
        if header is None:
            return None
        return cls(int(header["session"]), int(header["sequence"]), int(header["start_ns"]))


@dataclass(frozen=True, slots=True)
class Observation:
    """Observations at a sample of the servo.

    There are two clocks. That of the frames may be another machine's, and only be guessed: it jumps when more
    is learnt of it, and only ages of frames are reported by it. How time passes for the drum is reported by
    the sample's own.
    """

    now_ns: int  # of the sample, on the clock of the frames
    bend: float  # of the finger, by the potentiometer; nan, or what no finger has: a fault
    drum_angle: float  # rad, by the encoder; nan, or far off the finger's path: a fault
    state: State = State.STALE  # of the newest reading
    contact: Any = None  # CONTACT, this finger's record of it; None: no frame yet
    force: float = math.nan  # N, between finger and drum; nan: not measured
    has_fault: bool = False  # of motor or current
    motor_force: float = math.nan  # N, by which the motor presses on the finger; nan: not known
    sample_ns: int = field(kw_only=True)  # of the sample, on this machine's monotonic clock
    frame: FrameMark | None = field(default=None, kw_only=True)  # that the record is of; None: no frame yet


@dataclass(frozen=True, slots=True)
class DrumAction:
    """Action of the drum until the next sample."""

    state: DrumState
    mode: DriveMode
    position: float  # m of the finger's path where the drum shall stand
    angle: float  # rad, of the drum, there
    force: float  # N to press with, in force mode
    speed_cap: float  # m/s at the fingertip
    force_cap: float  # N at the fingertip
    start_force: float = math.nan  # N that a change to force starts from
    torque: float = 0.0  # N m at the motor's shaft that presses with that force, in force mode
    torque_cap: float = 0.0  # N m at the motor's shaft, at most: by the force cap and what motor and gear can
    motor_speed_cap: float = 0.0  # rad/s of the motor's shaft, at most
    force_slew: float = 0.0  # N/s at the fingertip, of the force; 0: that of a handover, inf: at once
    heat: float = 0.0  # of the motor, as a share; from 1 on its force is limited to what it holds for ever
    is_hot: bool = False  # the force is limited so, until the motor is cooler


def commanded(action: DrumAction, target: float) -> DrumCommand:
    """Return what a servo is given of a controller's action.

    *target*: its position, as the servo counts it; or its force.
    """
    return DrumCommand(
        action.mode, target, action.speed_cap, action.force_cap, action.start_force, action.force_slew
    )
