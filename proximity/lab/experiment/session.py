"""A session: the plan of one participant, step after step, each in the log before the next.

What is next follows from the design, the slot and the answers so far: a visit begins, or goes on where the
log ends.
"""

import platform
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

import numpy as np

import proximity
from proximity.lab.experiment.dataset import Dataset
from proximity.lab.experiment.design import CHOICES, Design, Question
from proximity.lab.experiment.design_file import sha256_of
from proximity.lab.experiment.display import Apparatus, Presentation, Trial, trial_at
from proximity.lab.experiment.plan import (
    METHODS,
    PlannedTrial,
    QuestPlus,
    Stage,
    Staircase,
    Step,
    Text,
    minutes,
    plan,
    trials_of,
)
from proximity.lab.experiment.trial_log import Entry, TrialLog

EMERGENCY = "emergency stop"
WriteFrames = Callable[[int, dict[str, np.ndarray]], str]
"""Given the number of a trial and the frames of its intervals; returns their hash."""


class RefusedError(Exception):
    """The participant does not consent."""


class StoppedError(Exception):
    """The experimenter stopped everything; the session can go on later."""


class Respondent(Protocol):
    """Whoever does the experiment: a person at a terminal or a page, or a simulated observer."""

    def read(self, text: Text) -> bool:
        """Show a text until it is read; whether the participant goes on."""

    def choose(self, question: Question) -> Any:
        """Ask a question until the answer fits."""

    def wait_ready(self, trial: Trial, interval: int) -> None:
        """Wait until the participant is ready for an interval, from 0."""

    def answer(self, trial: Trial, felt: list[Presentation]) -> Any:
        """Ask for the answer to a trial: 1 or 2, a number, or None where nothing is asked."""

    def explain(self, why: str) -> None:
        """Show why a trial ended early."""


class Session:
    """What one participant does; it depends on the design, the slot and the answers alone."""

    def __init__(self, design: Design, slot: int) -> None:
        self.design, self.steps, self._index = design, plan(design, slot), 0
        self._methods: dict[tuple[str, str], Staircase | QuestPlus] = {}

    @property
    def step(self) -> Step | None:
        """The next step, or None at the end of the session."""
        return self.steps[self._index] if self._index < len(self.steps) else None

    @property
    def minutes_left(self) -> float:
        """Time that the rest takes, as planned."""
        return minutes(self.design, self.steps[self._index :])

    def trial(self) -> Trial:
        """Return the trial that is next, with its level."""
        planned = self.step
        assert isinstance(planned, PlannedTrial), "the step is no trial"
        method = self._method(planned)
        level = method.level() if planned.level is None and method is not None else planned.level
        assert level is not None, "levels are left open to methods only"
        return trial_at(self.design, planned, level)

    def advance(self, *, is_right: bool | None = None) -> None:
        """Go on behind the step; None: its answer is not right or wrong, or it was stopped."""
        step = self.step
        if isinstance(step, PlannedTrial) and step.stage is Stage.MAIN and is_right is not None:
            method = self._method(step)
            if method is not None:
                method.update(is_right)
        self._index += 1

    def replay(self, entries: Iterable[Entry]) -> None:
        """Go through what a log has of the steps already done."""
        for entry in entries:
            if entry["event"] in ("text", "question", "trial"):
                self.advance(is_right=entry.get("is_right"))

    def _method(self, planned: PlannedTrial) -> Staircase | QuestPlus | None:
        task, key = self.design.task(planned.task), (planned.task, planned.condition)
        if key not in self._methods and task.kind in CHOICES and task.method in METHODS:
            self._methods[key] = METHODS[task.method](task.levels)
        return self._methods.get(key)


@dataclass(slots=True)
class Monitor:
    """State of a session for the experimenter, who may stop everything; used from several threads."""

    stop: threading.Event = field(default_factory=threading.Event)
    doing: str = ""
    trial: int = 0  # trials done
    trials: int = 0
    minutes_left: float = 0.0
    force: float = 0.0  # N, largest of the last interval
    force_limit: float = 0.0  # N
    changed: Callable[[], None] = lambda: None

    def update(self, session: Session, doing: str) -> None:
        """Show where a session is."""
        self.doing, self.minutes_left = doing, session.minutes_left
        self.force_limit, self.trials = session.design.limits.force, len(trials_of(session.steps))
        self.changed()


def run_visit(
    dataset: Dataset,
    pseudonym: str,
    apparatus: Apparatus,
    respondent: Respondent,
    monitor: Monitor | None = None,
) -> None:
    """Do what is left of a participant's session."""
    design = dataset.design
    session = Session(design, dataset.register(pseudonym, apparatus.name))
    versions = {"proximity": proximity.__version__, "python": platform.python_version()}
    versions["numpy"] = np.__version__
    try:
        with TrialLog(dataset.log_path(pseudonym)) as log:
            session.replay(log.entries)
            if session.step is None:
                return
            log.append("begin", apparatus=apparatus.name, design_sha256=design.sha256, **versions)
            try:
                write = partial(dataset.write_frames, pseudonym)
                run_session(session, log, apparatus, respondent, write, monitor or Monitor())
                dataset.finish(pseudonym, log)
            finally:
                dataset.write_tables(pseudonym)
    except RefusedError:
        dataset.remove(pseudonym, leaves_reports=True)
        raise


def run_session(
    session: Session,
    log: TrialLog,
    apparatus: Apparatus,
    respondent: Respondent,
    write: WriteFrames,
    monitor: Monitor,
) -> None:
    """Go through the rest of a session."""
    started = time.monotonic()
    while (step := session.step) is not None:
        if monitor.stop.is_set():
            raise StoppedError
        is_right = None
        if isinstance(step, Text):
            monitor.update(session, step.name)
            if not respondent.read(step):
                raise RefusedError
            log.append("text", name=step.name, text_sha256=sha256_of(step.text), at=_since(started))
        elif isinstance(step, Question):
            monitor.update(session, step.key)
            log.append("question", key=step.key, answer=respondent.choose(step), at=_since(started))
        else:
            monitor.update(session, f"{step.task}, {step.condition}, {step.stage}")
            entry = _run_trial(session, apparatus, respondent, write, monitor)
            is_right = log.append("trial", **entry, at=_since(started))["is_right"]
            monitor.trial = step.number + 1
        session.advance(is_right=is_right)


def _run_trial(
    session: Session, apparatus: Apparatus, respondent: Respondent, write: WriteFrames, monitor: Monitor
) -> Entry:
    """Display the intervals of a trial and ask for its answer; what the log has of it."""
    trial, limits = session.trial(), session.design.limits
    felt: list[Presentation] = []
    for index, interval in enumerate(trial.intervals):
        respondent.wait_ready(trial, index)
        felt.append(apparatus.present(interval, limits.force, limits.seconds))
        monitor.force = felt[-1].peak
        monitor.changed()
        if felt[-1].stopped or monitor.stop.is_set():
            break
    stopped, answer = EMERGENCY if monitor.stop.is_set() else felt[-1].stopped, None
    asked = time.monotonic()
    if stopped:
        respondent.explain(stopped)
    else:
        answer = respondent.answer(trial, felt)
    frames = {f"interval_{i}": one.frames for i, one in enumerate(felt, start=1)}
    record = trial.record(answer, felt, stopped, _since(asked))
    return record | {"frames_sha256": write(trial.planned.number, frames)}


def _since(instant: float) -> float:
    return round(time.monotonic() - instant, 4)
