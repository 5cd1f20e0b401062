"""Scores: one number a participant, task and condition, of the trials that the design's rules leave.

What is compared is the score as it is taken: a logarithm of a threshold, the log-odds of a share; `shown`
gives it back in the unit that people read.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from proximity.lab.experiment.analysis.psychometric import Counts, Shape, shared_shape, threshold_mean
from proximity.lab.experiment.design import Design, Kind, Procedure, Task
from proximity.lab.experiment.plan import Stage, is_compared

Entry = dict[str, Any]
MEANING = {
    Kind.STIFFER: "threshold",
    Kind.REAL: "share of right answers",
    Kind.RATING: "rating",
    Kind.CONTACT: "time from surface to force [ms]",
    Kind.FREE: "peak force [N]",
}


@dataclass(frozen=True, slots=True)
class Score:
    """How one participant did in a task on a condition."""

    participant: str
    task: str
    condition: str
    value: float
    trials: int


@dataclass(frozen=True, slots=True)
class Exclusion:
    """What the rules of the design left out."""

    participant: str
    trial: int | None  # None: all of the participant's
    why: str


@dataclass(frozen=True, slots=True)
class Missing:
    """A task on a condition of which some participants, or all, have no score."""

    task: str
    condition: str
    participants: tuple[str, ...]  # empty: all
    why: str

    def __str__(self) -> str:
        whose = f" of {', '.join(self.participants)}" if self.participants else ""
        return f"{self.condition} in {self.task}{whose}; {self.why}"


def exclude(design: Design, entries: Sequence[Entry]) -> tuple[list[Entry], list[Exclusion]]:
    """Return the trials that count, and what was left out; practice and catch trials never count."""
    rules, left_out = design.exclusions, []
    by_participant: dict[str, list[Entry]] = defaultdict(list)
    for entry in entries:
        by_participant[entry["participant"]].append(entry)
    kept: list[Entry] = []
    for participant, own in by_participant.items():
        catch = [entry["is_right"] for entry in own if entry["stage"] == Stage.CATCH]
        share = sum(map(bool, catch)) / len(catch) if catch else 1.0
        stopped = sum(bool(entry["stopped"]) for entry in own) / len(own)
        if share < rules.catch_correct:
            why = f"{share:.0%} of the catch trials right, the rule is {rules.catch_correct:.0%} or more"
            left_out.append(Exclusion(participant, None, why))
            continue
        if stopped > rules.stopped_trials:
            why = f"limits ended {stopped:.0%} of the trials, the rule is {rules.stopped_trials:.0%} or fewer"
            left_out.append(Exclusion(participant, None, why))
            continue
        for entry in own:
            late = (entry["response_time"] or 0.0) > rules.longest_response
            if entry["stage"] != Stage.MAIN:
                continue
            if late:
                why = f"answered after more than {rules.longest_response:g} s"
                left_out.append(Exclusion(participant, entry["number"], why))
            elif not entry["stopped"]:
                kept.append(entry)
    return kept, left_out


def scores_of(design: Design, entries: Sequence[Entry]) -> list[Score]:
    """Return the scores of trials that count."""
    cells, shapes = cells_of(entries), shapes_of(design, entries)
    found = []
    for (participant, name, condition), own in cells.items():
        task = design.task(name)
        if task.kind is Kind.STIFFER:
            value = threshold_mean(counts_of(own), task.levels, shapes[name])
        else:
            value = _plain_score(task, own)
        if math.isfinite(value):
            found.append(Score(participant, name, condition, value, len(own)))
    return found


def missing_scores(
    design: Design, entries: Sequence[Entry], scores: Sequence[Score], exclusions: Sequence[Exclusion]
) -> list[Missing]:
    """Return what is not analysed although no rule leaves the participant out."""
    left_out = {one.participant for one in exclusions if one.trial is None}
    participants = sorted({entry["participant"] for entry in entries} - left_out)
    cells = cells_of([entry for entry in entries if entry["stage"] == Stage.MAIN])
    scored = {(one.participant, one.task, one.condition) for one in scores}
    found: dict[tuple[str, str, str], list[str]] = defaultdict(list)
    for task in design.tasks:
        for name in (one.name for one in design.conditions if is_compared(design, task, one.name)):
            for participant in participants:
                key = participant, task.name, name
                if key not in scored:
                    found[task.name, name, _why_missing(cells.get(key, []))].append(participant)
    return [
        Missing(task, name, () if own == participants else tuple(own), why)
        for (task, name, why), own in found.items()
    ]


def _why_missing(own: Sequence[Entry]) -> str:
    """Why trials of one participant in a task on a condition give no score."""
    stops = [entry["stopped"] for entry in own]
    if not own:
        return "none of its trials was done"
    if all(stops):
        by = "were ended by a limit" if all("limit" in why for why in stops) else "ended early"
        return f"all its trials {by}"
    return "no trial that counts gives a score"


def cells_of(entries: Sequence[Entry]) -> dict[tuple[str, str, str], list[Entry]]:
    """Return trials by participant, task and condition."""
    cells: dict[tuple[str, str, str], list[Entry]] = defaultdict(list)
    for entry in entries:
        cells[entry["participant"], entry["task"], entry["condition"]].append(entry)
    return cells


def shapes_of(design: Design, entries: Sequence[Entry]) -> dict[str, Shape]:
    """Return what the psychometric functions of each task have in common.

    Adaptive methods ask where the answer is least certain, which tells next to nothing of width and lapses:
    there they are as the design expects them.
    """
    expected, shapes = Shape(design.observers.width, design.observers.lapse), {}
    cells = cells_of(entries)
    for task in design.tasks:
        own = [counts_of(trials) for (_, name, _), trials in cells.items() if name == task.name]
        if task.kind is Kind.STIFFER and own:
            is_constant = task.procedure is Procedure.CONSTANT
            shapes[task.name] = shared_shape(own, task.levels, expected.width) if is_constant else expected
    return shapes


def counts_of(entries: Sequence[Entry]) -> Counts:
    """Return right answers and all, by level."""
    counts: dict[float, tuple[int, int]] = {}
    for entry in entries:
        right, count = counts.get(entry["level"], (0, 0))
        counts[entry["level"]] = (right + bool(entry["is_right"]), count + 1)
    return counts


def shown(kind: Kind, value: float) -> float:
    """Return a score in the unit that people read."""
    if kind in (Kind.STIFFER, Kind.RATING):
        return float(10.0**value)
    if kind is Kind.REAL:
        return 1.0 / (1.0 + math.exp(-value))
    return 1e3 * value if kind is Kind.CONTACT else value


def _plain_score(task: Task, own: Sequence[Entry]) -> float:
    if task.kind is Kind.REAL:
        right = sum(bool(entry["is_right"]) for entry in own)
        return math.log((right + 0.5) / (len(own) - right + 0.5))
    if task.kind is Kind.RATING:
        numbers = [entry["answer"] for entry in own if isinstance(entry["answer"], int | float)]
        return float(np.mean(np.log10(numbers))) if numbers and min(numbers) > 0 else math.nan
    key = "onset" if task.kind is Kind.CONTACT else "peak_force"
    measured = [entry[key][0] for entry in own if entry[key] and entry[key][0] is not None]
    return float(np.median(measured)) if measured else math.nan
