"""Plan of a session: everything that is shown, in order, known before it begins.

Conditions go by the rows of a Latin square in which each follows each other equally often (Williams 1949);
passes through the conditions go forth and back in turn. Only the levels of adaptive methods are left open.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from proximity.lab.experiment.design import CHOICES, Design, Kind, Procedure, Question, Task
from proximity.lab.simulation.simulated_press import Wall


class Stage(StrEnum):
    """Purpose of a trial."""

    PRACTICE = "practice"
    MAIN = "main"
    CATCH = "catch"


@dataclass(frozen=True, slots=True)
class Text:
    """Something to read, and to go on from."""

    name: str  # "consent", "welcome", "instructions", "break" or "goodbye"
    text: str
    seconds: float = 0.0  # to be waited


@dataclass(frozen=True, slots=True)
class PlannedTrial:
    """A trial, as far as it is known in advance."""

    number: int  # in the session, from 0
    run: int  # pass of the task through the conditions, from 1
    task: str
    condition: str
    stage: Stage
    odd: int  # interval, 0 or 1, that differs from the other; 0 where there is one only
    level: float | None  # None: a method chooses it


Step = Text | Question | PlannedTrial


def latin_square(count: int) -> list[list[int]]:
    """Return rows of the numbers below *count*, each follows each equally often; twice as many if odd."""
    first = [(i + 1) // 2 if i % 2 else (count - i // 2) % count for i in range(count)]
    rows = [[(number + row) % count for number in first] for row in range(count)]
    return rows if count % 2 == 0 or count == 1 else rows + [row[::-1] for row in rows]


def plan(design: Design, slot: int) -> list[Step]:
    """Return what a participant is shown, in order.

    *slot*: place among the participants, from 0: it chooses the row of the Latin square and random numbers.
    """
    before, after = ([one for one in design.questions if one.when == when] for when in ("before", "after"))
    return [
        Text("consent", design.consent),
        *before,
        *([Text("welcome", design.welcome)] if design.welcome else []),
        *_trials(design, slot),
        *after,
        *([Text("goodbye", design.goodbye)] if design.goodbye else []),
    ]


def trials_of(steps: list[Step]) -> list[PlannedTrial]:
    """Return the trials among the steps of a plan."""
    return [step for step in steps if isinstance(step, PlannedTrial)]


def minutes(design: Design, steps: list[Step]) -> float:
    """Return how long steps take, as the design's schedule has it."""
    seconds = {PlannedTrial: design.schedule.trial_seconds, Question: design.schedule.question_seconds}
    return sum(step.seconds if isinstance(step, Text) else seconds[type(step)] for step in steps) / 60.0


def is_compared(design: Design, task: Task, name: str) -> bool:
    """Whether a task is done on a condition: the real wall is not compared with itself."""
    return task.kind is not Kind.REAL or design.condition(name).wall is not Wall.REAL


def _trials(design: Design, slot: int) -> Iterator[Step]:
    """Instructions, practice, trials and breaks of all tasks."""
    rng, square = np.random.default_rng([design.seed, slot]), latin_square(len(design.conditions))
    row = [design.conditions[i].name for i in square[slot % len(square)]]
    numbers, block_numbers = itertools.count(), itertools.count()
    for task in design.tasks:
        forth = [name for name in row if is_compared(design, task, name)]
        if task.instructions:
            yield Text("instructions", task.instructions)
        levels = {name: _levels(task, rng) for name in sorted(forth)}
        for i in range(task.practice):
            odd, name = int(rng.integers(2)) if task.kind in CHOICES else 0, forth[i % len(forth)]
            yield PlannedTrial(next(numbers), 1, task.name, name, Stage.PRACTICE, odd, task.catch_level)
        for turn in range(task.blocks):
            for name in forth if turn % 2 == 0 else forth[::-1]:
                block_number = next(block_numbers)
                if block_number and block_number % design.schedule.break_every == 0:
                    yield Text("break", design.pause, 60.0 * design.schedule.break_minutes)
                for stage, odd, level in _block(task, turn, levels[name], rng):
                    yield PlannedTrial(next(numbers), turn + 1, task.name, name, stage, odd, level)


def _levels(task: Task, rng: np.random.Generator) -> Iterator[float | None]:
    """Levels of all trials of a task on one condition, shuffled; None where a method chooses them."""
    if task.method is not Procedure.CONSTANT:
        return itertools.repeat(None)
    repeated: list[float] = np.repeat(task.levels, task.trials // len(task.levels)).tolist()
    return iter([repeated[i] for i in rng.permutation(task.trials)])


def _block(
    task: Task, turn: int, levels: Iterator[float | None], rng: np.random.Generator
) -> Iterator[tuple[Stage, int, float | None]]:
    """Stage, odd interval and level of each trial of a pass on one condition."""
    catch = task.catch // task.blocks + (turn < task.catch % task.blocks)
    total = task.trials // task.blocks + catch
    caught = set(rng.permutation(total)[:catch].tolist())
    odds = rng.permutation(np.arange(total) % 2) if task.kind in CHOICES else np.zeros(total, np.int64)
    for i, odd in enumerate(odds.tolist()):
        yield (Stage.CATCH, odd, task.catch_level) if i in caught else (Stage.MAIN, odd, next(levels))
