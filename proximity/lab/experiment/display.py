"""Surfaces of a trial, the recorded frames, and the interface of the apparatus that displays them."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from proximity.lab.experiment.design import Condition, Kind, Task, Varied
from proximity.lab.experiment.plan import Trial
from proximity.lab.simulation.metrics import ONSET_FORCE
from proximity.lab.simulation.simulated_press import Wall

FRAME = np.dtype([("time", "<f4"), ("finger", "<f4"), ("wall", "<f4"), ("force", "<f4")])
"""Fields of a frame: s, m past the displayed surface of the finger and of the wall, and N on the finger."""


class Interval(NamedTuple):
    """One interval of a trial, in which a surface is displayed once."""

    wall: Wall
    stiffness: float | None  # N/m; None: rigid
    damping: float  # N s/m
    latency: float  # s
    gain: float  # N/m, of a coupled wall that displays a rigid surface
    speed: float  # m/s, of the approach

    @property
    def spring(self) -> float:
        """Stiffness of a coupled wall that displays the surface, N/m."""
        return self.gain if self.stiffness is None else self.stiffness


@dataclass(frozen=True, slots=True, eq=False)
class Presentation:
    """Recorded frames of one interval."""

    frames: np.ndarray  # (N,) FRAME
    stopped: str = ""  # reason of an early end, or ""

    @property
    def peak(self) -> float:
        """Largest force, N."""
        return float(self.frames["force"].max(initial=0.0))

    @property
    def onset(self) -> float:
        """Time from the finger's arrival at the surface until a force is felt, s, or nan if none is."""
        felt, there = self.frames["force"] >= ONSET_FORCE, self.frames["finger"] >= 0.0
        if not (felt.any() and there.any()):
            return float("nan")
        times = self.frames["time"]
        return float(times[np.argmax(felt)] - times[np.argmax(there)])

    @property
    def depth(self) -> float:
        """Largest distance of the wall past the surface during contact, m."""
        touched = (self.frames["force"] > 0.0) & np.isfinite(self.frames["wall"])
        return float(self.frames["wall"][touched].max(initial=0.0))


class Apparatus(Protocol):
    """Display of surfaces, such as a real or simulated drum, or a simulated hand."""

    name: str

    def present(self, interval: Interval, limit_force: float, limit_seconds: float) -> Presentation:
        """Display an interval, which ends immediately if either limit is exceeded."""


def intervals_of(trial: Trial) -> tuple[Interval, Interval]:
    """Return the two intervals of a trial, in order."""
    other = interval_of(trial.task, trial.condition, 0.0)
    odd = interval_of(trial.task, trial.condition, trial.level)
    if trial.task.kind is Kind.REAL:
        other, odd = odd, odd._replace(wall=Wall.REAL)
    return odd if trial.odd == 1 else other, odd if trial.odd == 2 else other


def interval_of(task: Task, condition: Condition, level: float) -> Interval:
    """Return the interval for a condition and a level of the task's stimulus.

    At level 0 the stimulus is absent.
    """
    stiffness, latency = task.stiffness, condition.latency
    damping = condition.damping if task.damping is None else task.damping
    if task.varied is Varied.LATENCY:
        latency += level
    elif task.varied is Varied.DAMPING:
        damping *= 1.0 + level
    elif stiffness is not None:
        stiffness *= 1.0 + level
    return Interval(condition.wall, stiffness, damping, latency, condition.stiffness, task.speed)


def stopped_by_force(force: float, limit: float) -> str:
    """Return the message for an interval that was ended by a force, N."""
    return f"{force:.1f} N are beyond the limit of {limit:g} N"
