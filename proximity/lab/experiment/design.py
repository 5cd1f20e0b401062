"""Design of an experiment: walls, tasks of two intervals with their levels, limits and exclusions.

A field is a key of the design's file and declares its reader; `design_file` reads the whole file.
``decaff_against_coupled.toml`` explains every key.
"""

# ruff: noqa: RUF009 -- the calls make fields

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from proximity.lab.simulation.simulated_press import (
    LONGEST_LATENCY,
    MAX_DAMPED,
    SPEEDS_ALLOWED,
    STIFFEST,
    Wall,
)
from proximity.service.config.record_fields import key, number, text, texts, whole
from proximity.service.config.table_fields import REQUIRED, Range, Table

NAME = re.compile(r"[a-zA-Z][a-zA-Z0-9]*")
COUNT = Range("", 1, 1000)
NONE_OR_MORE = Range("", 0, 1000)
LATENCY = Range("s", 0.0, LONGEST_LATENCY)
STIFFNESS = Range("N/m", 0.0, STIFFEST, is_above=True)
DAMPING = Range("N s/m", 0.0, MAX_DAMPED)
LEVEL = Range("", 0.0, 1e3, is_above=True)
SHARE = Range("", 0.0, 1.0)
FORCE = Range("N", 0.0, 20.0, is_above=True)  # no drum gives more, for any design
DURATION = Range("s", 0.1, 600.0)
DEVIATION = Range("", 0.0, 2.0)
AGAINST = " against "
"""Separator of the two conditions of a comparison."""


class Kind(StrEnum):
    """Kinds of tasks, each of two intervals."""

    STIFFER = "stiffer"
    """Which surface was stiffer?"""
    REAL = "real"
    """One surface is a real wall: which?"""


class Varied(StrEnum):
    """Stimulus that the levels of a task vary."""

    STIFFNESS = "stiffness"
    """Increase as a share of the task's stiffness."""
    DAMPING = "damping"
    """Increase as a share of the damping."""
    LATENCY = "latency"
    """Increase of the condition's latency, s."""


def _word(words: type[StrEnum], default: Any = REQUIRED) -> Any:
    def read(table: Table, name: str, default: Any) -> Any:
        word = table.one_of(name, default, tuple(words))
        return next(iter(words)) if word is REQUIRED else words(word)

    return key(read, default)


def _read_name(table: Table, key: str, default: Any) -> str:
    name = table.text(key, default, meaning="a name")
    if isinstance(name, str) and not NAME.fullmatch(name):
        table.complain(key, f"is {name!r}, expected letters and digits")
    return str(name)


def _read_levels(table: Table, key: str, default: Any) -> tuple[float, ...]:
    levels = table.number_or_numbers(key, 0.0, None, LEVEL)
    return tuple(sorted(levels)) if isinstance(levels, tuple) else (levels,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """A wall to compare with others, and the expected answers of simulated observers."""

    name: str = key(_read_name, REQUIRED)
    wall: Wall = _word(Wall)
    latency: float = number(LATENCY, 0.001)  # s, of forces or of distances
    stiffness: float = number(STIFFNESS, 1500.0)  # N/m, gain of a coupled wall for a rigid surface
    damping: float = number(DAMPING, 2.0)  # gain of a coupled wall; of a surface whose task gives none
    threshold: float = number(LEVEL, 0.2)  # expected: level half-way between chance and always right
    correct: float = number(SHARE, 0.5)  # expected: probability of telling the wall from the real one


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A task of two intervals, done on every condition, by constant stimuli."""

    name: str = key(_read_name, REQUIRED)
    kind: Kind = _word(Kind)
    varied: Varied = _word(Varied, Varied.STIFFNESS)
    levels: tuple[float, ...] = key(_read_levels, (0.0,))
    stiffness: float | None = number(STIFFNESS, None)  # of the displayed surface; None: rigid
    damping: float | None = number(DAMPING, None)  # of that surface; None: that of the condition
    trials: int = whole(COUNT)  # a condition, without practice and catch trials
    speed: float = number(Range("m/s", *SPEEDS_ALLOWED), 0.2)  # of the approach
    practice: int = whole(NONE_OR_MORE, 0)
    catch: int = whole(NONE_OR_MORE, 0)  # pairs of two equal surfaces, a condition
    blocks: int = whole(COUNT, 1)
    comparisons: tuple[str, ...] = texts('"A against B"', ())
    question: str = text("the question", "")
    instructions: str = text("the instructions", "")


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Bounds of every interval, which override the rest of the design."""

    force: float = number(FORCE, 5.0)  # N at the fingertip; beyond, the trial ends
    seconds: float = number(DURATION, 10.0)  # longest interval


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """Planned times of a session, and its breaks."""

    trial_seconds: float = number(DURATION, 8.0)
    break_minutes: float = number(Range("min", 0.0, 60.0), 1.0)
    break_every: int = whole(COUNT, 4)  # blocks


@dataclass(frozen=True, slots=True, kw_only=True)
class Exclusions:
    """Rules for excluding data, written before the data."""

    same_answer: float = number(SHARE, 1.0)  # largest share of one answer to equal pairs, else all is out
    largest_correct: float = number(SHARE, 0.0)  # smallest share right at the largest level, else all is out
    longest_response: float = number(Range("s", 0.0, 1e9, is_above=True), 1e9)  # else the trial is out
    stopped_trials: float = number(SHARE, 1.0)  # that limits may end, else all is out


@dataclass(frozen=True, slots=True, kw_only=True)
class Observers:
    """Simulated participants: spread among them, their psychometric function, and their hand."""

    spread: float = number(DEVIATION, 0.1)  # standard deviation of a participant's log10 threshold
    interaction: float = number(DEVIATION, 0.0)  # the same, of each condition of a participant
    # Deviation of the logarithm of the felt force, which answers follow; 0: they follow the thresholds.
    felt_noise: float = number(DEVIATION, 0.0)
    width: float = number(Range("", 0.01, 5.0), 0.6)  # log10 units, 5 to 95 % of the psychometric function
    lapse: float = number(Range("", 0.0, 0.2), 0.02)
    speed_noise: float = number(SHARE, 0.2)  # of the approach, as a share


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """An experiment, as in its file."""

    title: str = text("a title")
    seed: int = whole(Range("", 0, 2**31 - 1))
    participants: int = whole(Range("", 1, 10_000))
    consent: str = text("the consent text")
    welcome: str = text("a text", "")
    pause: str = text("a text", "")
    goodbye: str = text("a text", "")
    limits: Limits
    schedule: Schedule
    exclusions: Exclusions
    observers: Observers
    conditions: tuple[Condition, ...]
    tasks: tuple[Task, ...]
    digest: str  # first digits of the SHA-256 of the file

    def pairs(self, task: Task) -> list[tuple[str, str]]:
        """Return the planned comparisons of a task; all with the first condition if the file names none."""
        if task.comparisons:
            return [(one.partition(AGAINST)[0], one.partition(AGAINST)[2]) for one in task.comparisons]
        first, *others = self.compared(task)
        return [(one.name, first.name) for one in others]

    def compared(self, task: Task) -> list[Condition]:
        """Return the conditions of a task: the real wall is not compared with itself."""
        return [one for one in self.conditions if task.kind is not Kind.REAL or one.wall is not Wall.REAL]
