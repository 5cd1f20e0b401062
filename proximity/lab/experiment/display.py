"""What a trial displays: intervals, the frames of what was felt, who displays them, and its record."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from proximity.lab.experiment.design import CHOICES, Condition, Design, Kind, Task, Varied
from proximity.lab.experiment.plan import PlannedTrial
from proximity.lab.simulation.metrics import ONSET_FORCE
from proximity.lab.simulation.simulated_press import Wall

FRAME = np.dtype([("time", "<f4"), ("finger", "<f4"), ("wall", "<f4"), ("force", "<f4")])
"""s; m past the surface that is displayed, of the finger and of what stops it; N on the finger."""
TRIAL_FIELDS = {
    "number": "Number of the trial in the session, from 0.",
    "condition": "Wall of the trial.",
    "stage": "practice, main or catch.",
    "level": "Level of the stimulus.",
    "odd": "Interval that differs from the other, 1 or 2.",
    "answer": "What the participant answered.",
    "is_right": "1 if the answer names the odd interval.",
    "response_time": "s, from the end of the last interval to the answer.",
    "stopped": "Why the trial ended early; n/a: it did not.",
    "onset": "s from the surface to the force, of each interval, separated by blanks.",
    "depth": "m past the surface, of each interval.",
    "peak_force": "N, of each interval.",
    "at": "s since the begin of the visit.",
}
"""Fields of `Trial.record` and of the log, and what they hold: columns of a run's table."""


class Interval(NamedTuple):
    """One surface, displayed once."""

    wall: Wall
    stiffness: float | None  # N/m; None: rigid
    damping: float  # N s/m
    latency: float  # s
    gain: float  # N/m, by which a coupled wall displays a rigid surface
    speed: float  # m/s, of the approach that is asked for

    @property
    def spring(self) -> float:
        """Stiffness by which a coupled wall displays the surface, N/m."""
        return self.gain if self.stiffness is None else self.stiffness


@dataclass(frozen=True, slots=True, eq=False)
class Presentation:
    """What was displayed and felt in one interval."""

    frames: np.ndarray  # (N,) FRAME
    stopped: str = ""  # why it ended early; empty: it did not

    @property
    def peak(self) -> float:
        """Largest force, N."""
        return float(self.frames["force"].max(initial=0.0))

    @property
    def onset(self) -> float:
        """Time from the surface until the force is felt, s; nan: it was not."""
        felt, there = self.frames["force"] >= ONSET_FORCE, self.frames["finger"] >= 0.0
        if not (felt.any() and there.any()):
            return float("nan")
        times = self.frames["time"]
        return float(times[np.argmax(felt)] - times[np.argmax(there)])

    @property
    def depth(self) -> float:
        """How far what stops the finger went past the surface, m."""
        touched = (self.frames["force"] > 0.0) & np.isfinite(self.frames["wall"])
        return float(self.frames["wall"][touched].max(initial=0.0))


class Apparatus(Protocol):
    """Whatever displays surfaces: a drum, real or simulated, or a simulated hand."""

    name: str

    def present(self, interval: Interval, limit_force: float, limit_seconds: float) -> Presentation:
        """Display an interval; it ends at once beyond either limit."""


@dataclass(frozen=True, slots=True)
class Trial:
    """A trial that is about to be shown."""

    planned: PlannedTrial
    task: Task
    level: float
    intervals: tuple[Interval, ...]

    def record(
        self, answer: Any, felt: Sequence[Presentation], stopped: str = "", response_time: float = 0.0
    ) -> dict[str, Any]:
        """Return what the log has of the trial; an answer that names the odd interval, from 1, is right."""
        planned, is_choice = self.planned, len(self.intervals) == 2 and answer is not None
        return {
            "number": planned.number,
            "run": planned.run,
            "task": planned.task,
            "condition": planned.condition,
            "stage": str(planned.stage),
            "odd": planned.odd + 1,
            "level": self.level,
            "answer": answer,
            "is_right": answer == planned.odd + 1 if is_choice else None,
            "response_time": response_time,
            "stopped": stopped,
            "onset": [one.onset for one in felt],
            "depth": [one.depth for one in felt],
            "peak_force": [one.peak for one in felt],
        }


def trial_at(design: Design, planned: PlannedTrial, level: float) -> Trial:
    """Return a planned trial with what it displays, in order, at a level."""
    task, condition = design.task(planned.task), design.condition(planned.condition)
    odd = other = interval_of(task, condition, level)
    if task.kind is Kind.REAL:
        odd = other._replace(wall=Wall.REAL)
    elif task.varied is not Varied.SPEED:
        other = interval_of(task, condition, 0.0)
    pair = (other, odd) if planned.odd else (odd, other)
    return Trial(planned, task, level, pair if task.kind in CHOICES else (odd,))


def interval_of(task: Task, condition: Condition, level: float) -> Interval:
    """Return a condition's surface at a level of the task's stimulus; 0: without it."""
    stiffness, latency, speed = task.stiffness, condition.latency, task.speed
    damping = condition.damping if task.damping is None else task.damping
    if task.varied is Varied.SPEED:
        speed = level or task.speed
    elif task.varied is Varied.LATENCY:
        latency += level
    elif task.varied is Varied.DAMPING:
        damping *= 1.0 + level
    elif stiffness is not None:
        stiffness *= 1.0 + level
    return Interval(condition.wall, stiffness, damping, latency, condition.stiffness, speed)


def stopped_by_force(force: float, limit: float) -> str:
    """Return the sentence for an interval that a force ended, N."""
    return f"{force:.1f} N are beyond the limit of {limit:g} N"
