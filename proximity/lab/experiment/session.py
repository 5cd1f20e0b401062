"""A session: the plan of one participant, the methods, and what is next after the answers so far."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from proximity.lab.experiment.design import CHOICES, Design, Kind
from proximity.lab.experiment.display import Interval, intervals_of
from proximity.lab.experiment.methods import Method, method_for
from proximity.lab.experiment.plan import PlannedTrial, Stage, Step, minutes, plan


@dataclass(frozen=True, slots=True)
class Trial:
    """A trial that is about to be shown."""

    planned: PlannedTrial
    level: float
    intervals: tuple[Interval, ...]
    kind: Kind
    question: str  # empty: the program's own

    def is_right(self, answer: Any) -> bool | None:
        """Whether an answer names the odd interval, from 1; None where nothing is right or wrong."""
        return answer == self.planned.odd + 1 if len(self.intervals) == 2 and answer is not None else None


class Session:
    """What one participant does; it depends on the design, the slot and the answers alone."""

    steps: list[Step]

    def __init__(self, design: Design, slot: int) -> None:
        self.design, self.steps, self._at = design, plan(design, slot), 0
        self._methods: dict[tuple[str, str], Method | None] = {}

    @property
    def step(self) -> Step | None:
        """What is next; None: it is over."""
        return self.steps[self._at] if self._at < len(self.steps) else None

    @property
    def minutes_left(self) -> float:
        """Time that the rest takes, as planned."""
        return minutes(self.design, self.steps[self._at :])

    def trial(self) -> Trial:
        """Return the trial that is next, with its level."""
        planned = self.step
        assert isinstance(planned, PlannedTrial), "the step is no trial"
        level = planned.level
        if level is None:
            method = self._method(planned)
            assert method is not None, "levels are left open to methods only"
            level = method.level()
        task = self.design.task(planned.task)
        return Trial(planned, level, intervals_of(self.design, planned, level), task.kind, task.question)

    def take(self, *, is_right: bool | None = None) -> None:
        """Go on behind the step.

        *is_right*: the answer of a trial; None: it had none that is right or wrong, or was stopped.
        """
        step = self.step
        if isinstance(step, PlannedTrial) and step.stage is Stage.MAIN and is_right is not None:
            method = self._method(step)
            if method is not None:
                method.take(is_right)
        self._at += 1

    def replay(self, entries: Iterable[dict[str, Any]]) -> None:
        """Go through what a log has of the steps already done."""
        for entry in entries:
            if entry["event"] in ("text", "question", "trial"):
                self.take(is_right=entry.get("is_right"))

    def _method(self, planned: PlannedTrial) -> Method | None:
        key = planned.task, planned.condition
        if key not in self._methods:
            task = self.design.task(planned.task)
            self._methods[key] = method_for(task.procedure, task.levels) if task.kind in CHOICES else None
        return self._methods[key]
