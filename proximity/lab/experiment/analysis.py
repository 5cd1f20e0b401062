"""Analysis of an experiment, with exclusions, a score per participant and condition, and planned comparisons.

A score is the log10 of a threshold, or the log-odds of the share of right answers. `shown` converts it to the
reported unit.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import stats
from scipy.special import expit

from proximity.lab.experiment.design import Design, Kind, Task
from proximity.lab.experiment.plan import Stage
from proximity.lab.experiment.psychometric import (
    Psychometric,
    Shape,
    fit,
    shared_shape,
    threshold_means,
)
from proximity.lab.experiment.visit import SIMULATED, Row

MEANING = {Kind.STIFFER: "threshold", Kind.REAL: "share of right answers"}
MIN_PARTICIPANTS = 3  # of a comparison
Key = tuple[str, str, str]
"""Names of task, condition and participant."""


@dataclass(frozen=True, slots=True)
class Interval95:
    """A mean over participants and its 95 % confidence interval, or nan for too few participants."""

    value: float
    lower: float
    upper: float
    participants: int


@dataclass(frozen=True, slots=True)
class Comparison:
    """Result of a planned comparison of two conditions, the mean of the participants' differences."""

    task: str
    pair: tuple[str, str]  # the first against the second
    difference: Interval95
    p: float  # of a paired t test, Holm-adjusted for the comparisons of the task


@dataclass(frozen=True, slots=True)
class Findings:
    """Results of an experiment."""

    design: Design
    participants: tuple[str, ...]
    simulated: int  # simulated participants
    kept: list[Row]
    excluded: list[str]  # sentences
    scores: dict[Key, float]
    functions: dict[Key, Psychometric] = field(default_factory=dict)
    comparisons: list[Comparison] = field(default_factory=list)

    @property
    def simulated_note(self) -> str:
        """Sentence with the number of simulated participants, or an empty string."""
        count, total = self.simulated, len(self.participants)
        who = f"All {count}" if count == total else f"{count} of {total}"
        return f"{who} participants are simulated observers." if count else ""

    def mean(self, task: str, condition: str) -> Interval95:
        """Return the mean score of a condition."""
        return interval_of_mean([v for (t, c, _), v in self.scores.items() if (t, c) == (task, condition)])


def analyse(design: Design, rows: Sequence[Row]) -> Findings:
    """Analyse the rows of visits."""
    kept, excluded = exclude(design, rows)
    scores: dict[Key, float] = {}
    functions: dict[Key, Psychometric] = {}
    for task in design.tasks:
        cells = _cells(task, kept)
        if not cells:
            continue
        right, wrong = _counts(task, list(cells.values()))
        if task.kind is Kind.REAL:
            values = log_odds(right[0], wrong[0])
        else:
            shape = shared_shape(task.levels, right, wrong, design.observers.width)
            values = threshold_means(task.levels, right, wrong, shape)
            functions |= _fitted(task, list(cells), (right, wrong), shape)
        scores |= dict(zip(cells, values.tolist(), strict=True))
    apparatus = {row["participant"]: row["apparatus"] for row in rows}
    simulated = sum(one == SIMULATED for one in apparatus.values())
    compared = [one for task in design.tasks for one in compare(design, task, scores)]
    return Findings(design, tuple(apparatus), simulated, kept, excluded, scores, functions, compared)


def exclude(design: Design, rows: Sequence[Row]) -> tuple[list[Row], list[str]]:
    """Return the trials to analyse, and a sentence for each excluded participant or trial."""
    kept, sentences = [], []
    by_participant: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        by_participant[row["participant"]].append(row)
    for participant, own in by_participant.items():
        if why := _broken_rule(design, own):
            sentences.append(f"{participant} is left out: {why}")
            continue
        for row in (row for row in own if row["stage"] == Stage.MAIN and not row["stopped"]):
            if (row["response_s"] or 0.0) > design.exclusions.longest_response:
                longest = f"more than {design.exclusions.longest_response:g} s"
                sentences.append(
                    f"trial {row['number']} of {participant} is left out: answered after {longest}"
                )
            else:
                kept.append(row)
    return kept, sentences


def _broken_rule(design: Design, own: Sequence[Row]) -> str:
    """Return the rule that excludes a participant, or an empty string."""
    rules, largest = design.exclusions, {task.name: max(task.levels) for task in design.tasks}
    first = _share(row["answer"] == 1 for row in own if row["stage"] == Stage.CATCH and row["answer"])
    same = max(first, 1.0 - first)
    right = _share(row["is_right"] == 1 for row in own if row["level"] == largest[row["task"]] > 0.0
                   and row["stage"] == Stage.MAIN and row["answer"])  # fmt: skip
    stopped = _share(bool(row["stopped"]) for row in own)
    if same > rules.same_answer:
        return f"{same:.0%} of equal pairs have the same answer, the rule is {rules.same_answer:.0%} or fewer"
    if right < rules.largest_correct:
        rule = f"the rule is {rules.largest_correct:.0%} or more"
        return f"{right:.0%} of trials at the largest level are right, {rule}"
    if stopped > rules.stopped_trials:
        return f"limits ended {stopped:.0%} of the trials, the rule is {rules.stopped_trials:.0%} or fewer"
    return ""


def _share(values: Iterable[bool]) -> float:
    listed = list(values)
    return sum(listed) / len(listed) if listed else math.nan


def log_odds(right: np.ndarray, wrong: np.ndarray) -> np.ndarray:
    """Return the log-odds of shares of right answers, which are finite even if all answers are right."""
    return np.asarray(np.log((right + 0.5) / (wrong + 0.5)))


def compare(design: Design, task: Task, scores: dict[Key, float]) -> list[Comparison]:
    """Return the planned comparisons of a task with enough participants in both conditions."""
    found = []
    for first, second in design.pairs(task):
        values = {
            name: {who: v for (t, c, who), v in scores.items() if (t, c) == (task.name, name)}
            for name in (first, second)
        }
        both = sorted(values[first].keys() & values[second].keys())
        if len(both) >= MIN_PARTICIPANTS:
            found.append(((first, second), np.array([values[first][w] - values[second][w] for w in both])))
    adjusted = holm(np.array([float(paired_p(differences)) for _, differences in found]))
    return [
        Comparison(task.name, pair, interval_of_mean(differences), float(p))
        for (pair, differences), p in zip(found, adjusted, strict=True)
    ]


def paired_p(differences: np.ndarray) -> np.ndarray:
    """Return the p values of paired t tests on differences, (..., participants).

    If all differences are equal, p is 1 for zeros and 0 otherwise.
    """
    count = differences.shape[-1]
    mean, error = differences.mean(axis=-1), differences.std(axis=-1, ddof=1) / math.sqrt(count)
    t = np.divide(mean, error, out=np.where(mean == 0.0, 0.0, math.inf), where=error > 0.0)
    return np.asarray(2.0 * stats.t.sf(np.abs(t), count - 1))


def holm(p: np.ndarray) -> np.ndarray:
    """Return p values, (..., tests), adjusted by Holm's method."""
    order = np.argsort(p, axis=-1)
    factors = np.arange(p.shape[-1], 0, -1)
    rising = np.maximum.accumulate(np.take_along_axis(p, order, -1) * factors, axis=-1)
    adjusted = np.empty_like(p)
    np.put_along_axis(adjusted, order, np.minimum(rising, 1.0), -1)
    return adjusted


def interval_of_mean(values: Sequence[float] | np.ndarray) -> Interval95:
    """Return the mean of values with its 95 % confidence interval."""
    listed = np.asarray(values, np.float64)
    count, value = len(listed), float(listed.mean()) if len(listed) else math.nan
    half = float(stats.sem(listed) * stats.t.ppf(0.975, count - 1)) if count > 1 else math.nan
    return Interval95(value, value - half, value + half, count)


def shown(kind: Kind, value: float) -> float:
    """Return a score in the reported unit."""
    return float(10.0**value) if kind is Kind.STIFFER else float(expit(value))


def _cells(task: Task, rows: Sequence[Row]) -> dict[Key, list[Row]]:
    """Return the trials of a task by task, condition and participant."""
    cells: dict[Key, list[Row]] = defaultdict(list)
    for row in rows:
        if row["task"] == task.name:
            cells[task.name, row["condition"], row["participant"]].append(row)
    return cells


def _counts(task: Task, cells: Sequence[Sequence[Row]]) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of right and wrong answers, each (levels, cells)."""
    counts = np.zeros((2, len(task.levels), len(cells)))
    for index, own in enumerate(cells):
        for row in own:
            counts[1 - row["is_right"], task.levels.index(row["level"]), index] += 1
    return counts[0], counts[1]


def _fitted(
    task: Task, keys: Sequence[Key], counts: tuple[np.ndarray, np.ndarray], shape: Shape
) -> dict[Key, Psychometric]:
    right, wrong = counts
    return {key: fit(task.levels, right[:, i], wrong[:, i], shape) for i, key in enumerate(keys)}


def pooled(task: Task, rows: Sequence[Row], condition: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of right and wrong answers of all participants on a condition, each (levels,)."""
    own = [row for (_, name, _), cell in _cells(task, rows).items() if name == condition for row in cell]
    right, wrong = _counts(task, [own])
    return right[:, 0], wrong[:, 0]
