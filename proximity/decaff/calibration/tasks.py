"""Tasks of a calibration, in order: instructions, measurements, and tolerances of repeats.

A task is repeated until enough of its readings agree. This module neither waits nor prints: the user
interface passes `Ready`, which returns once the person has done a part of the task.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from proximity.decaff.calibration import fit
from proximity.decaff.calibration.drum_chirp import (
    HELD_BEND,
    HELD_FORCE,
    Chirp,
    drum_stiffness,
    encoder_step,
    free_chirp,
    held_chirp,
    identify_free,
    identify_held,
    inertia,
)
from proximity.decaff.calibration.instruments import DrumRecord, Instruments
from proximity.decaff.drum.drum_model import Drum
from proximity.decaff.glove.calibrated_glove import TOUCH_TOLERANCE
from proximity.decaff.glove.calibration import TABLE_SIZE
from proximity.decaff.glove.glove import Glove
from proximity.errors import DecaffError

POSES = tuple(i / (TABLE_SIZE - 1) for i in range(TABLE_SIZE))
POSE_NAMES = ("flat hand", "one sixth", "one third", "half bent", "two thirds", "five sixths", "fist")
TOUCHED = (1 / 6, 1 / 2, 5 / 6)
TENSION = 2.0  # N, of the pulled cable
STEADY_SHARE = 0.004  # of the design's range of counts, maximum variation while the hand is still
POSE_SHARE = 0.03  # of the same, maximum difference of repeats of a pose: 4 mm of the fingertip
PULL_TOLERANCE = 15e-6  # m/N
BACKLASH_TOLERANCE = 60e-6  # m of cable
LATENCY_TOLERANCE = 3e-3  # s
INERTIA_TOLERANCE, STIFFNESS_TOLERANCE = 0.15, 0.2  # shares of the model's

Values = dict[str, Any]
Ready = Callable[[int], None]
"""Called with the number of a part of the task; returns when the person is ready."""


@dataclass(frozen=True, slots=True)
class Bench:
    """The designed glove to calibrate, and its instruments."""

    instruments: Instruments
    glove: Glove
    viscous: float = 0.0  # N m s, of the free drum, once known

    @property
    def drum(self) -> Drum:
        """Drum of the glove, at the bend of the clamp."""
        return self.glove.tip_drum(HELD_BEND)


@dataclass(frozen=True, slots=True)
class Task:
    """Instructions for a person, and a measurement."""

    key: str
    parts: tuple[str, ...]  # the person's actions before each reading; a sentence each
    bends: tuple[
        float | None, ...
    ]  # of the finger, in turn over the repeats; None: without a finger in the glove
    measure: Callable[[Bench, float, Ready], Values]
    judged: str  # the value whose repeats must agree
    tolerance: Callable[[Bench], float]  # maximum difference of repeats
    advice: str  # if they disagree
    repeats: int = 3
    is_automatic: bool = False  # repeats need no action of the person


def tasks_for(bench: Bench) -> tuple[Task, ...]:
    """Return the tasks that these instruments support, in order."""
    chirps = (FREE, HELD) if bench.instruments.drum.rate else ()
    return (*POSE_TASKS, BACKLASH, PULL, TOUCH, LATENCY, *chirps)


# --- measurements ---


def _steady_counts(bench: Bench) -> float:
    """Return the mean of a reading; raise if the hand moved."""
    read = bench.instruments.hand.counts()
    wandered = float(read.max() - read.min())
    if not wandered <= STEADY_SHARE * _count_range(bench):
        raise DecaffError(f"the potentiometer wandered by {wandered:.0f} counts: hold the hand still")
    return float(read.mean())


def _pose(bench: Bench, bend: float, ready: Ready) -> Values:
    ready(0)
    return {"counts": _steady_counts(bench)}


def _backlash(bench: Bench, bend: float, ready: Ready) -> Values:
    ready(0)
    closing = _steady_counts(bench)
    ready(1)
    opening = _steady_counts(bench)
    lost = fit.backlash(bench.glove, closing, opening)
    return {"closing": closing, "opening": opening, "backlash": lost}


def _pull(bench: Bench, bend: float, ready: Ready) -> Values:
    ready(0)
    slack = _steady_counts(bench)
    ready(1)
    taut = _steady_counts(bench)
    compliance = fit.cable_compliance(bench.glove, (slack, taut), (0.0, TENSION))
    return {"slack": slack, "taut": taut, "compliance": compliance}


def _touch(bench: Bench, bend: float, ready: Ready) -> Values:
    ready(0)
    counts, angle = _steady_counts(bench), bench.instruments.drum.angle()
    glove = bench.glove
    replica = glove.potentiometer.angle(counts)
    return {"counts": counts, "angle": angle, "offset": angle - float(glove.drum.drum_angle(replica))}


def _latency(bench: Bench, bend: float, ready: Ready) -> Values:
    ready(0)
    latency, sampled = bench.instruments.hand.latency()
    return {"latency": latency, "sampled": sampled}


def _free(bench: Bench, bend: float, ready: Ready) -> Values:
    ready(0)
    record = _swung(bench, free_chirp(bench.drum))
    found = identify_free(record, bench.drum)
    step, step_error = encoder_step(record.angles)
    if math.isfinite(step):  # the encoder is finer than its transmitted resolution
        found |= {"step": step, "step_error": step_error}
    return {**found, "record": _as_lists(record)}


def _held(bench: Bench, bend: float, ready: Ready) -> Values:
    ready(0)
    record = _swung(bench, held_chirp(bench.glove, bench.drum))
    found = identify_held(record, bench.drum, bench.glove, bench.viscous)
    return {**found, "record": _as_lists(record)}


def _swung(bench: Bench, chirp: Chirp) -> DrumRecord:
    drum = bench.instruments.drum
    return drum.swing(chirp.torques(drum.rate))


def _as_lists(record: DrumRecord) -> dict[str, list[float]]:
    return {
        "times": np.round(record.times, 7).tolist(),
        "commanded": np.round(record.commanded, 7).tolist(),
        "angles": np.round(record.angles, 9).tolist(),
    }


def _count_range(bench: Bench) -> float:
    return float(np.ptp(bench.glove.counts([0.0, 1.0])))


# --- tasks ---

POSE_TASKS = tuple(
    Task(
        f"pose {i + 1}",
        (f"Close the finger, from a flatter hand, to pose {i + 1}: {name}. Leave the cable slack.",),
        (POSES[i],),
        _pose,
        "counts",
        lambda bench: POSE_SHARE * _count_range(bench),
        "use the same gauge each time, come from the flat hand, and check the straps",
    )
    for i, name in enumerate(POSE_NAMES)
)
_BLOCK = "rest it on a fixed block at half bend"
BACKLASH = Task(
    "both directions",
    (f"Close the finger from the flat hand, and {_BLOCK}.", f"Open the finger from the fist, and {_BLOCK}."),
    (0.5,),
    _backlash,
    "backlash",
    lambda bench: BACKLASH_TOLERANCE,
    "check that the block does not move, and that the sheath is fixed at both ends",
)
PULL = Task(
    "cable pull",
    (
        f"Close the finger, and {_BLOCK}. Leave the cable slack.",
        f"Stay there. Pull the replica back with a spring scale, so that the cable has {TENSION:g} N.",
    ),
    (0.5,),
    _pull,
    "compliance",
    lambda bench: PULL_TOLERANCE,
    "hold the finger to the block, and pull along the cable",
)
TOUCH = Task(
    "touches",
    (
        "Close the finger to the bend that is shown and hold it there, the cable slack. Turn the drum by "
        "hand, motor off, until it just touches the replica.",
    ),
    TOUCHED,
    _touch,
    "offset",
    lambda bench: TOUCH_TOLERANCE / float(bench.glove.lever(TOUCHED).max()),
    "turn the drum gently: the replica must not move; check that the encoder is firm on its shaft",
    repeats=9,
)
LATENCY = Task(
    "step",
    ("Rest the finger on the block, and let the step test run: do not move until it is over.",),
    (0.5,),
    _latency,
    "latency",
    lambda bench: LATENCY_TOLERANCE,
    "stop other programs on the computer",
    is_automatic=True,
)
FREE = Task(
    "free drum",
    ("Take the finger out of the glove, and turn the drum to the middle of its path. The motor swings it.",),
    (None,),
    _free,
    "inertia",
    lambda bench: INERTIA_TOLERANCE * inertia(bench.drum),
    "check that the drum turns freely, and that its gear has no play",
    repeats=5,
    is_automatic=True,
)
HELD = Task(
    "held drum",
    (
        "Clamp the linkage at half bend; a hand would give way. Turn the drum until it just touches the "
        f"replica. The motor presses with {HELD_FORCE:g} N at the fingertip, and swings the drum.",
    ),
    (HELD_BEND,),
    _held,
    "stiffness",
    lambda bench: STIFFNESS_TOLERANCE * drum_stiffness(bench.glove, bench.glove.cable.stiffness),
    "check the clamp, and that the drum touches the replica as the chirp begins",
    repeats=5,
    is_automatic=True,
)
