"""Plan of a session, which is the sequence of all its texts and trials.

The conditions follow the rows of a Latin square in which each condition follows each other equally often
(Williams 1949). The tasks follow those of a second one. Passes through the conditions alternate in direction.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from proximity.lab.experiment.design import Condition, Design, Task


class Stage(StrEnum):
    """Purpose of a trial."""

    PRACTICE = "practice"
    MAIN = "main"
    CATCH = "catch"
    """The surfaces are equal and no answer is right, so that a constant answer shows a bias."""


@dataclass(frozen=True, slots=True)
class Text:
    """Text to be read before the next step."""

    name: str  # "welcome", "instructions", "break" or "goodbye"
    text: str
    seconds: float = 0.0  # to wait


@dataclass(frozen=True, slots=True)
class Trial:
    """Two intervals and a question."""

    number: int  # in the session, from 0
    run: int  # pass of the task through the conditions, from 1
    task: Task
    condition: Condition
    stage: Stage
    odd: int  # interval that differs from the other, 1 or 2, or 0 for equal ones
    level: float  # of the task's stimulus

    @property
    def name(self) -> str:
        """Task, condition and stage."""
        return f"{self.task.name}, {self.condition.name}, {self.stage}"


Step = Text | Trial


def latin_square(count: int) -> list[list[int]]:
    """Return a Latin square of range(count) in which each number follows each other equally often.

    It has *count* rows, or twice as many if *count* is odd.
    """
    first = [(i + 1) // 2 if i % 2 else (count - i // 2) % count for i in range(count)]
    rows = [[(number + row) % count for number in first] for row in range(count)]
    return rows if count % 2 == 0 or count == 1 else rows + [row[::-1] for row in rows]


def plan(design: Design, slot: int) -> list[Step]:
    """Return the steps of a participant's session in order.

    *slot*: rank among the participants, from 0, which determines the orders and the random numbers.
    """
    rng = np.random.default_rng([design.seed, slot])
    conditions, tasks = latin_square(len(design.conditions)), latin_square(len(design.tasks))
    row = [design.conditions[i] for i in conditions[slot % len(conditions)]]
    numbers, blocks = itertools.count(), itertools.count()
    steps: list[Step] = [Text("welcome", design.welcome)] if design.welcome else []
    for index in tasks[slot // len(conditions) % len(tasks)]:
        task = design.tasks[index]
        own = [one for one in row if one in design.compared(task)]
        steps += _task_steps(design, task, own, rng, (numbers, blocks))
    return steps + ([Text("goodbye", design.goodbye)] if design.goodbye else [])


def trials_of(steps: list[Step]) -> list[Trial]:
    """Return the trials among the steps of a plan."""
    return [step for step in steps if isinstance(step, Trial)]


def minutes(design: Design, steps: list[Step]) -> float:
    """Return the duration of steps by the design's schedule, min."""
    trial = design.schedule.trial_seconds
    return sum(step.seconds if isinstance(step, Text) else trial for step in steps) / 60.0


def _task_steps(
    design: Design,
    task: Task,
    row: list[Condition],
    rng: np.random.Generator,
    counters: tuple[Iterator[int], Iterator[int]],
) -> Iterator[Step]:
    """Yield instructions, practice, trials and breaks of a task."""
    numbers, blocks = counters
    if task.instructions:
        yield Text("instructions", task.instructions)
    repeated = np.repeat(task.levels, task.trials // len(task.levels))
    levels = {one.name: iter(rng.permutation(repeated).tolist()) for one in row}
    for i in range(task.practice):
        odd = int(rng.integers(2)) + 1
        yield Trial(next(numbers), 1, task, row[i % len(row)], Stage.PRACTICE, odd, max(task.levels))
    for turn in range(task.blocks):
        for one in row if turn % 2 == 0 else row[::-1]:
            block = next(blocks)
            if block and block % design.schedule.break_every == 0:
                yield Text("break", design.pause, 60.0 * design.schedule.break_minutes)
            for odd in _odd_intervals(task, turn, rng):
                stage, level = (Stage.MAIN, next(levels[one.name])) if odd else (Stage.CATCH, 0.0)
                yield Trial(next(numbers), turn + 1, task, one, stage, odd, level)


def _odd_intervals(task: Task, turn: int, rng: np.random.Generator) -> list[int]:
    """Return the odd interval of each trial in a pass on one condition, shuffled, or 0 for equal surfaces."""
    catch = task.catch // task.blocks + (turn < task.catch % task.blocks)
    count = task.trials // task.blocks
    odds: list[int] = rng.permutation([0] * catch + [1 + i % 2 for i in range(count)]).tolist()
    return odds
