"""Plan of a session: everything that is shown, in order, and the methods that choose levels meanwhile.

Conditions go by the rows of a Latin square in which each follows each other equally often (Williams 1949);
passes through the conditions go forth and back in turn. Only the levels of adaptive methods are left open.
Those are deterministic: given the same answers they choose the same levels, so that a session goes on after a
crash.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from importlib import import_module
from typing import Any

import numpy as np

from proximity.lab.experiment.design import CHOICES, Design, Kind, Procedure, Question, Task
from proximity.lab.simulation.simulated_press import Wall
from proximity.system.extras import needed


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


DOWN, UP = 3, 1  # answers in a row until the level falls, and until it rises: 79.4 % right (Levitt 1971)
THRESHOLD_COUNT, WIDTHS, LAPSES = 30, (0.3, 0.6, 1.2), (0.0, 0.03, 0.06)
SIGMAS_OF_WIDTH = 2.0 * 1.6448536269514722  # from 5 to 95 % of a normal distribution


class Staircase:
    """Three right answers in a row make it harder, one that is wrong makes it easier."""

    def __init__(self, levels: Sequence[float]) -> None:
        self._levels, self._index, self._right, self._wrong = tuple(levels), len(levels) - 1, 0, 0

    def level(self) -> float:
        """Return the level of the next trial."""
        return self._levels[self._index]

    def update(self, is_right: bool) -> None:
        """Go on from the answer at that level."""
        self._right, self._wrong = (self._right + 1, 0) if is_right else (0, self._wrong + 1)
        step = (self._wrong == UP) - (self._right == DOWN)
        if step:
            self._index = min(max(self._index + step, 0), len(self._levels) - 1)
            self._right = self._wrong = 0


class QuestPlus:
    """The level that is expected to say most of threshold, width and lapses (Watson 2017), by `questplus`.

    *levels*: from which it chooses; thresholds are looked for in their range, in logarithms.
    """

    def __init__(self, levels: Sequence[float]) -> None:
        logs = np.log10(levels)
        self._levels = tuple(levels), logs
        with needed("experiments need", "experiment"):
            make = import_module("questplus").QuestPlus
        self._quest = make(
            stim_domain={"intensity": logs},
            param_domain={
                "mean": np.linspace(logs[0], logs[-1], THRESHOLD_COUNT),
                "sd": np.array(WIDTHS) / SIGMAS_OF_WIDTH,
                "lower_asymptote": [0.5],
                "lapse_rate": LAPSES,
            },
            outcome_domain={"response": ["right", "wrong"]},
            func="norm_cdf",
            stim_scale="linear",
        )
        self._chosen: dict[str, Any] = {}

    def level(self) -> float:
        """Return the level of the next trial."""
        self._chosen = self._chosen or self._quest.next_stim
        levels, logs = self._levels
        return levels[int(np.argmin(np.abs(logs - self._chosen["intensity"])))]

    def update(self, is_right: bool) -> None:
        """Go on from the answer at that level."""
        self.level()
        self._quest.update(stim=self._chosen, outcome={"response": "right" if is_right else "wrong"})
        self._chosen = {}


METHODS: dict[Procedure, Callable[[Sequence[float]], Staircase | QuestPlus]] = {
    Procedure.STAIRCASE: Staircase,
    Procedure.QUEST: QuestPlus,
}
"""What chooses levels, where the plan has not chosen them."""
