"""Visits of a participant: a session begins, or goes on where its log ends, step after step.

Each step is in the log before the next.
"""

import platform
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

import numpy as np

import proximity
from proximity.lab.experiment.dataset import Dataset
from proximity.lab.experiment.design import Question
from proximity.lab.experiment.design_file import sha256_of
from proximity.lab.experiment.display import Apparatus, Presentation
from proximity.lab.experiment.plan import PlannedTrial, Text
from proximity.lab.experiment.session import Session, Trial
from proximity.lab.experiment.trial_log import TrialLog

EMERGENCY = "emergency stop"
Frames = dict[str, np.ndarray]


class RefusedError(Exception):
    """The participant does not consent."""


class StoppedError(Exception):
    """The experimenter stopped everything; the session can go on later."""


class Respondent(Protocol):
    """Whoever does the experiment: a person at a terminal or a page, or a simulated observer."""

    def read(self, text: Text) -> bool:
        """Show a text until it is read; whether the participant goes on."""
        ...

    def choose(self, question: Question) -> Any:
        """Ask a question until the answer fits."""
        ...

    def begin(self, trial: Trial, interval: int) -> None:
        """Wait until the participant is ready for an interval, from 0."""
        ...

    def answer(self, trial: Trial, felt: list[Presentation]) -> Any:
        """Ask for the answer to a trial: 1 or 2, a number, or None where nothing is asked."""
        ...

    def explain(self, why: str) -> None:
        """Say that a trial ended early."""
        ...


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

    def show(self, session: Session, doing: str) -> None:
        """Take over where a session is."""
        self.doing, self.minutes_left = doing, session.minutes_left
        self.force_limit = session.design.limits.force
        self.trials = sum(isinstance(step, PlannedTrial) for step in session.steps)
        self.changed()


def run_visit(
    dataset: Dataset,
    pseudonym: str,
    apparatus: Apparatus,
    respondent: Respondent,
    monitor: Monitor | None = None,
) -> None:
    """Do what is left of a participant's session."""
    session = Session(dataset.design, dataset.admit(pseudonym, apparatus.name))
    try:
        with TrialLog(dataset.log_path(pseudonym)) as log:
            session.replay(log.entries)
            if session.step is None:
                return
            log.append("begin", apparatus=apparatus.name, design_sha256=dataset.design.sha256, **versions())
            try:
                keep = partial(dataset.keep_frames, pseudonym)
                run_session(session, log, apparatus, respondent, keep, monitor)
                dataset.finish(pseudonym, log)
            finally:
                dataset.write_tables(pseudonym)
    except RefusedError:
        dataset.forget(pseudonym, keeps_reports=True)
        raise


def versions() -> dict[str, str]:
    """Return the versions that a session was done with."""
    return {
        "proximity": proximity.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def run_session(
    session: Session,
    log: TrialLog,
    apparatus: Apparatus,
    respondent: Respondent,
    keep: Callable[[int, Frames], str],
    monitor: Monitor | None = None,
) -> None:
    """Go through the rest of a session."""
    monitor, started = monitor or Monitor(), time.monotonic()
    while (step := session.step) is not None:
        if monitor.stop.is_set():
            raise StoppedError
        is_right = None
        if isinstance(step, Text):
            monitor.show(session, step.name)
            if not respondent.read(step):
                raise RefusedError
            log.append("text", name=step.name, text_sha256=sha256_of(step.text), at=_since(started))
        elif isinstance(step, Question):
            monitor.show(session, step.key)
            log.append("question", key=step.key, answer=respondent.choose(step), at=_since(started))
        else:
            monitor.show(session, f"{step.task}, {step.condition}, {step.stage}")
            entry = _do_trial(session, apparatus, respondent, keep, monitor)
            is_right = log.append("trial", **entry, at=_since(started))["is_right"]
            monitor.trial = step.number + 1
        session.take(is_right=is_right)


def _do_trial(
    session: Session,
    apparatus: Apparatus,
    respondent: Respondent,
    keep: Callable[[int, Frames], str],
    monitor: Monitor,
) -> dict[str, Any]:
    """Display the intervals of a trial and ask for its answer; what the log has of it."""
    trial, limits = session.trial(), session.design.limits
    felt: list[Presentation] = []
    for index, interval in enumerate(trial.intervals):
        respondent.begin(trial, index)
        felt.append(apparatus.present(interval, limits.force, limits.seconds))
        monitor.force = felt[-1].peak
        monitor.changed()
        if felt[-1].stopped or monitor.stop.is_set():
            break
    stopped = EMERGENCY if monitor.stop.is_set() else felt[-1].stopped
    asked = time.monotonic()
    answer = None if stopped else respondent.answer(trial, felt)
    if stopped:
        respondent.explain(stopped)
    planned = trial.planned
    return {
        "number": planned.number,
        "run": planned.run,
        "task": planned.task,
        "condition": planned.condition,
        "stage": str(planned.stage),
        "odd": planned.odd + 1,
        "level": trial.level,
        "answer": answer,
        "is_right": trial.is_right(answer),
        "response_time": _since(asked),
        "stopped": stopped,
        "onset": [one.onset for one in felt],
        "depth": [one.depth for one in felt],
        "peak_force": [one.peak for one in felt],
        "frames_sha256": keep(
            planned.number, {f"interval_{i}": one.frames for i, one in enumerate(felt, start=1)}
        ),
    }


def _since(instant: float) -> float:
    return round(time.monotonic() - instant, 4)
