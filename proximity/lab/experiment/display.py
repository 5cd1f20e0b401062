"""What a trial displays: intervals, the frames of what was felt, and who displays them."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from proximity.lab.experiment.design import CHOICES, Condition, Design, Kind, Task, Varied
from proximity.lab.experiment.plan import PlannedTrial
from proximity.lab.simulation.metrics import ONSET_FORCE
from proximity.lab.simulation.simulated_press import Wall

FRAME = np.dtype([("time", "<f4"), ("finger", "<f4"), ("wall", "<f4"), ("force", "<f4")])
"""s; m past the surface that is displayed, of the finger and of what stops it; N on the finger."""


class Interval(NamedTuple):
    """One surface, displayed once."""

    wall: Wall
    stiffness: float | None  # N/m; None: rigid
    damping: float  # N s/m
    latency: float  # s
    gain: float  # N/m, by which a coupled wall displays a rigid surface
    speed: float  # m/s, of the approach that is asked for


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
        ...


def intervals_of(design: Design, planned: PlannedTrial, level: float) -> tuple[Interval, ...]:
    """Return what a trial displays, in order."""
    task, condition = design.task(planned.task), design.condition(planned.condition)
    if task.kind not in CHOICES:
        return (interval_of(task, condition, level),)
    if task.kind is Kind.REAL:
        odd = interval_of(task, condition, level)._replace(wall=Wall.REAL)
        other = interval_of(task, condition, level)
    else:
        odd, other = interval_of(task, condition, level), interval_of(task, condition, 0.0)
        if task.varied is Varied.SPEED:
            other = odd
    return (other, odd) if planned.odd else (odd, other)


def cut_at_limits(frames: np.ndarray, limit_force: float, limit_seconds: float) -> Presentation:
    """Return frames until a limit is passed.

    *frames*: (N,) FRAME.
    """
    above = np.flatnonzero(~(frames["force"] <= limit_force))
    if len(above):
        return Presentation(
            frames[: above[0]], stopped_by_force(float(frames["force"][above[0]]), limit_force)
        )
    return Presentation(frames[frames["time"] - frames["time"][0] <= limit_seconds])


def stopped_by_force(force: float, limit: float) -> str:
    """Return the sentence for an interval that a force ended, N."""
    return f"{force:.1f} N are beyond the limit of {limit:g} N"


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
