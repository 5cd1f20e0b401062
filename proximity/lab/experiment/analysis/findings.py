"""Findings of an experiment: what the rules leave, one score a participant, task and condition, comparisons.

What is compared is the score as it is taken: a logarithm of a threshold, the log-odds of a share; `shown`
gives it back in the unit that people read.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from proximity.lab.experiment.analysis.comparison import Comparison, Score, compare
from proximity.lab.experiment.analysis.psychometric import (
    Counts,
    Psychometric,
    Shape,
    fit,
    shared_shape,
    threshold_mean,
)
from proximity.lab.experiment.design import Design, Kind, Procedure
from proximity.lab.experiment.plan import Stage, is_compared
from proximity.lab.experiment.trial_log import Entry

MEANING = {
    Kind.STIFFER: "threshold",
    Kind.REAL: "share of right answers",
    Kind.RATING: "rating",
    Kind.CONTACT: "time from surface to force [ms]",
    Kind.FREE: "peak force [N]",
}
Key = tuple[str, str, str]
"""Participant, task and condition."""


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


@dataclass(frozen=True, slots=True)
class Findings:
    """What was found."""

    design: Design
    participants: tuple[str, ...]  # that have begun
    simulated: tuple[str, ...]  # of them, who are no people
    trials: int  # done, of all stages
    stopped: int  # of them, that a limit ended
    kept: list[Entry]
    exclusions: list[Exclusion]
    shapes: dict[str, Shape]  # by task
    functions: dict[Key, Psychometric]  #
    scores: list[Score]
    missing: list[Missing]  # scores that trials do not give, though no rule leaves them out
    comparisons: dict[str, Comparison | None]  # by task; None: too few participants

    @property
    def simulated_note(self) -> str:
        """A sentence that says which participants are no people; empty: all are."""
        count, all_of_them = len(self.simulated), len(self.participants)
        who = f"All {count}" if count == all_of_them else f"{count} of {all_of_them}"
        return f"{who} participants are simulated observers." if count else ""

    @property
    def excluded(self) -> set[str]:
        """Participants that are left out."""
        return {one.participant for one in self.exclusions if one.trial is None}


def find(design: Design, entries: Sequence[Entry]) -> Findings:
    """Return what is found in trials."""
    kept, exclusions = exclude(design, entries)
    shapes, scores = shapes_of(design, kept), scores_of(design, kept)
    functions = {
        key: fit(counts_of(own), design.task(key[1]).levels, shapes[key[1]])
        for key, own in cells_of(kept).items()
        if key[1] in shapes
    }
    names = [one.name for one in design.conditions]
    return Findings(
        design=design,
        participants=tuple(sorted({entry["participant"] for entry in entries})),
        simulated=tuple(sorted({entry["participant"] for entry in entries if entry["is_simulated"]})),
        trials=len(entries),
        stopped=sum(bool(entry["stopped"]) for entry in entries),
        kept=kept,
        exclusions=exclusions,
        shapes=shapes,
        functions=functions,
        scores=scores,
        missing=_missing_scores(design, entries, scores, exclusions),
        comparisons={task.name: compare(task.name, names, scores) for task in design.tasks},
    )


def exclude(design: Design, entries: Sequence[Entry]) -> tuple[list[Entry], list[Exclusion]]:
    """Return the trials that count, and what was left out; practice and catch trials never count."""
    rules, kept, left_out = design.exclusions, [], []
    by_participant: dict[str, list[Entry]] = defaultdict(list)
    for entry in entries:
        by_participant[entry["participant"]].append(entry)
    for participant, own in by_participant.items():
        catch = [bool(entry["is_right"]) for entry in own if entry["stage"] == Stage.CATCH]
        share = sum(catch) / len(catch) if catch else 1.0
        stopped = sum(bool(entry["stopped"]) for entry in own) / len(own)
        if share < rules.catch_correct:
            why = f"{share:.0%} of the catch trials right, the rule is {rules.catch_correct:.0%} or more"
            left_out.append(Exclusion(participant, None, why))
        elif stopped > rules.stopped_trials:
            why = f"limits ended {stopped:.0%} of the trials, the rule is {rules.stopped_trials:.0%} or fewer"
            left_out.append(Exclusion(participant, None, why))
        else:
            for entry in (entry for entry in own if entry["stage"] == Stage.MAIN):
                if (entry["response_time"] or 0.0) > rules.longest_response:
                    why = f"answered after more than {rules.longest_response:g} s"
                    left_out.append(Exclusion(participant, entry["number"], why))
                elif not entry["stopped"]:
                    kept.append(entry)
    return kept, left_out


def scores_of(design: Design, entries: Sequence[Entry]) -> list[Score]:
    """Return the scores of trials that count."""
    shapes, found = shapes_of(design, entries), []
    for key, own in cells_of(entries).items():
        task = design.task(key[1])
        if task.kind is Kind.STIFFER:
            value = threshold_mean(counts_of(own), task.levels, shapes[task.name])
        else:
            value = _plain_score(task.kind, own)
        if math.isfinite(value):
            found.append(Score(*key, value, len(own)))
    return found


def _missing_scores(
    design: Design, entries: Sequence[Entry], scores: Sequence[Score], exclusions: Sequence[Exclusion]
) -> list[Missing]:
    """What is not analysed although no rule leaves the participant out."""
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


def cells_of(entries: Sequence[Entry]) -> dict[Key, list[Entry]]:
    """Return trials by participant, task and condition."""
    cells: dict[Key, list[Entry]] = defaultdict(list)
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
            is_constant = task.method is Procedure.CONSTANT
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
        return float(expit(value))
    return 1e3 * value if kind is Kind.CONTACT else value


def _plain_score(kind: Kind, own: Sequence[Entry]) -> float:
    if kind is Kind.REAL:
        right = sum(bool(entry["is_right"]) for entry in own)
        return math.log((right + 0.5) / (len(own) - right + 0.5))
    if kind is Kind.RATING:
        numbers = [entry["answer"] for entry in own if isinstance(entry["answer"], int | float)]
        return float(np.mean(np.log10(numbers))) if numbers and min(numbers) > 0 else math.nan
    key = "onset" if kind is Kind.CONTACT else "peak_force"
    measured = [entry[key][0] for entry in own if entry[key] and entry[key][0] is not None]
    return float(np.median(measured)) if measured else math.nan
