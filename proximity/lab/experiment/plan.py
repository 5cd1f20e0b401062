"""Plan of a session: everything that is shown, in order, known before it begins.

Conditions go by the rows of a Latin square in which each follows each other equally often (Williams 1949);
passes through the conditions go forth and back in turn. Only the levels of adaptive methods are left open.
"""

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

    *slot*: place among the participants, from 0: it chooses the row of the Latin square and the random
    numbers.
    """
    square = latin_square(len(design.conditions))
    row = square[slot % len(square)]
    steps: list[Step] = [Text("consent", design.consent)]
    steps += [question for question in design.questions if not question.is_after]
    if design.welcome:
        steps.append(Text("welcome", design.welcome))
    blocks = [
        _Block(task, [design.conditions[i].name for i in (row if turn % 2 == 0 else row[::-1])], turn)
        for task in design.tasks
        for turn in range(task.blocks)
    ]
    steps += _trials(design, blocks, np.random.default_rng([design.seed, slot]))
    steps += [question for question in design.questions if question.is_after]
    if design.goodbye:
        steps.append(Text("goodbye", design.goodbye))
    return steps


def trials_of(steps: list[Step]) -> list[PlannedTrial]:
    """Return the trials among the steps of a plan."""
    return [step for step in steps if isinstance(step, PlannedTrial)]


def minutes(design: Design, steps: list[Step]) -> float:
    """Return how long steps take, as the design's schedule has it."""
    schedule = design.schedule
    seconds = {PlannedTrial: schedule.trial_seconds, Question: schedule.question_seconds}
    return sum(step.seconds if isinstance(step, Text) else seconds[type(step)] for step in steps) / 60.0


@dataclass(frozen=True, slots=True)
class _Block:
    """One pass of a task through the conditions."""

    task: Task
    conditions: list[str]
    turn: int


def _trials(design: Design, blocks: list[_Block], rng: np.random.Generator) -> list[Step]:
    """Instructions, practice, trials and breaks of all tasks."""
    steps: list[Step] = []
    number = block_number = 0
    levels: dict[str, list[float | None]] = {}  # of the task at hand, by condition
    for block in blocks:
        task = block.task
        compared = [name for name in block.conditions if is_compared(design, task, name)]
        if block.turn == 0:
            if task.instructions:
                steps.append(Text("instructions", task.instructions))
            levels = {name: _levels(task, rng) for name in sorted(compared)}
            for i in range(task.practice):
                name = compared[i % len(compared)]
                odd = int(rng.integers(2)) if task.kind in CHOICES else 0
                level = task.catch_level
                steps.append(
                    PlannedTrial(number, block.turn + 1, task.name, name, Stage.PRACTICE, odd, level)
                )
                number += 1
        for name in compared:
            if block_number and block_number % design.schedule.break_every == 0:
                steps.append(Text("break", design.pause, 60.0 * design.schedule.break_minutes))
            for stage, odd, chosen in _block_trials(block, levels[name], rng):
                steps.append(PlannedTrial(number, block.turn + 1, task.name, name, stage, odd, chosen))
                number += 1
            block_number += 1
    return steps


def is_compared(design: Design, task: Task, name: str) -> bool:
    """Whether a task is done on a condition: the real wall is not compared with itself."""
    return task.kind is not Kind.REAL or design.condition(name).wall is not Wall.REAL


def _levels(task: Task, rng: np.random.Generator) -> list[float | None]:
    """Levels of all trials of a task on one condition, shuffled; None where a method chooses them."""
    if task.procedure is not Procedure.CONSTANT:
        return [None] * task.trials
    repeated: list[float] = np.repeat(task.levels, task.trials // len(task.levels)).tolist()
    return [repeated[i] for i in rng.permutation(task.trials)]


def _block_trials(
    block: _Block, levels: list[float | None], rng: np.random.Generator
) -> list[tuple[Stage, int, float | None]]:
    """Stage, odd interval and level of each trial of a block on one condition."""
    task, count = block.task, block.task.trials // block.task.blocks
    catch = task.catch // task.blocks + (block.turn < task.catch % task.blocks)
    total = count + catch
    caught = set(rng.permutation(total)[:catch].tolist())
    odds = rng.permutation(np.arange(total) % 2) if task.kind in CHOICES else np.zeros(total, np.int64)
    left = iter(levels[block.turn * count :])
    return [
        (Stage.CATCH, int(odds[i]), task.catch_level)
        if i in caught
        else (Stage.MAIN, int(odds[i]), next(left))
        for i in range(total)
    ]
