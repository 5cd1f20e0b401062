"""Simulated experiments without presses, fast: power, and checks of the analysis."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from proximity.lab.experiment.analysis.comparison import Score, compare, within_f
from proximity.lab.experiment.analysis.findings import exclude, find, scores_of
from proximity.lab.experiment.design import CHOICES, Design, Kind
from proximity.lab.experiment.observers import Observer
from proximity.lab.experiment.plan import PlannedTrial
from proximity.lab.experiment.session import Session
from proximity.lab.experiment.trial_log import Entry

SIGNIFICANT = 0.05
Watch = Callable[[int, int], None]
"""Given how many are done, and of how many."""
UNWATCHED: Watch = lambda done, total: None  # noqa: E731
POOL = 200  # simulated participants that samples are drawn from
PARTICIPANTS = (4, 8, 12, 16, 20, 24)


ANSWERED = (*CHOICES, Kind.RATING)


@dataclass(frozen=True, slots=True)
class Power:
    """How often an effect is found."""

    task: str
    comparison: str
    participants: int
    share: float


@dataclass(frozen=True, slots=True)
class Recovery:
    """How well known thresholds are found again."""

    count: int
    covered: int  # that lie in their credible intervals
    bias: float  # of the geometric mean, as a share


def simulated_trials(design: Design, slot: int, seed: int = 0) -> list[Entry]:
    """Return the trials of a simulated participant, as of `Dataset.trials`; nothing is pressed."""
    session, observer = Session(design, slot), Observer(design, slot, seed)
    entries: list[Entry] = []
    while (step := session.step) is not None:
        is_right = None
        if isinstance(step, PlannedTrial):
            trial = session.trial()
            record = trial.record(observer.answer(trial, []) if trial.task.kind in ANSWERED else None, [])
            is_right = record["is_right"]
            entries.append({"participant": f"{slot}", "is_simulated": True} | record)
        session.advance(is_right=is_right)
    return entries


def _scores(design: Design, count: int, seed: int, watch: Watch) -> list[Score]:
    """Scores of simulated participants."""
    entries: list[Entry] = []
    for slot in range(count):
        entries += simulated_trials(design, slot, seed)
        watch(slot + 1, count)
    return scores_of(design, exclude(design, entries)[0])


def with_effect(design: Design, ratio: float) -> Design:
    """Return a design whose observers have thresholds that many times the first condition's on all others.

    What they tell from the real wall differs only if the ratio is not 1: then it stays as the design has it.
    """
    first = design.conditions[0]
    others = [
        replace(
            one, threshold=ratio * first.threshold, correct=first.correct if ratio == 1.0 else one.correct
        )
        for one in design.conditions[1:]
    ]
    return replace(design, conditions=(first, *others))


def power(
    design: Design,
    participants: Sequence[int] = PARTICIPANTS,
    repetitions: int = 1000,
    *,
    pool: int = POOL,
    watch: Watch = UNWATCHED,
) -> list[Power]:
    """Return how often an effect is found with so many participants.

    A pool of participants is simulated, and samples are drawn from it.
    """
    scores = _scores(design, pool, 0, watch)
    rng, found = np.random.default_rng(design.seed), []
    for task in design.tasks:
        own = {(one.participant, one.condition): one.value for one in scores if one.task == task.name}
        compared = [one.name for one in design.conditions if any(name == one.name for _, name in own)]
        table = np.array([[own[one, name] for name in compared] for one in sorted({one for one, _ in own})])
        for count in participants:
            drawn = table[np.array([rng.permutation(len(table))[:count] for _ in range(repetitions)])]
            found.append(Power(task.name, "any difference", count, _share(within_f(drawn))))
            for i, name in enumerate(compared[1:], start=1):
                p = _paired_p(drawn[..., i] - drawn[..., 0])
                found.append(Power(task.name, f"{name} against {compared[0]}", count, _share(p)))
    return found


def false_positives(design: Design, repetitions: int, watch: Watch = UNWATCHED) -> dict[str, float]:
    """Return, for each task, the share of whole experiments that find a difference where there is none.

    Each has its own participants, and goes through the same mixed model as a report.
    """
    equal, names = with_effect(design, 1.0), [one.name for one in design.conditions]
    counts = dict.fromkeys((task.name for task in design.tasks if task.kind in ANSWERED), 0)
    for repetition in range(repetitions):
        scores = _scores(equal, design.participants, 1 + repetition, UNWATCHED)
        for task in counts:
            found = compare(task, names, scores)
            counts[task] += found is not None and found.p < SIGNIFICANT
        watch(repetition + 1, repetitions)
    return {task: count / repetitions for task, count in counts.items()}


def recovery(design: Design, seed: int = 0) -> Recovery:
    """Return how well the thresholds of a whole simulated experiment are found again."""
    entries = [entry for slot in range(design.participants) for entry in simulated_trials(design, slot, seed)]
    functions = find(design, entries).functions
    true = {key: 10.0 ** Observer(design, int(key[0]), seed).thresholds[key[2]] for key in functions}
    return Recovery(
        len(true),
        sum(one.lower <= true[key] <= one.upper for key, one in functions.items()),
        float(np.exp(np.mean([np.log(one.threshold / true[key]) for key, one in functions.items()])) - 1.0),
    )


def _paired_p(differences: np.ndarray) -> np.ndarray:
    """p of t tests of (samples, participants) differences; of those that are all the same, 0, or 1 at 0."""
    count = differences.shape[1]
    mean, error = differences.mean(axis=1), differences.std(axis=1, ddof=1) / math.sqrt(count)
    t = np.divide(mean, error, out=np.where(mean == 0.0, 0.0, math.inf), where=error > 0.0)
    return np.asarray(2.0 * stats.t.sf(np.abs(t), count - 1))


def _share(p: np.ndarray) -> float:
    return float(np.mean(p < SIGNIFICANT))
