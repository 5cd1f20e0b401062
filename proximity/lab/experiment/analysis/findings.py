"""Findings of an experiment: everything that a report shows, from the trials."""

from collections.abc import Sequence
from dataclasses import dataclass

from proximity.lab.experiment.analysis.comparison import Comparison, compare
from proximity.lab.experiment.analysis.psychometric import Psychometric, Shape, fit
from proximity.lab.experiment.analysis.scores import (
    Entry,
    Exclusion,
    Missing,
    Score,
    cells_of,
    counts_of,
    exclude,
    missing_scores,
    scores_of,
    shapes_of,
)
from proximity.lab.experiment.design import Design, Kind


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
    functions: dict[tuple[str, str, str], Psychometric]  # by participant, task and condition
    scores: list[Score]
    missing: list[Missing]  # scores that trials do not give, though no rule leaves them out
    comparisons: dict[str, Comparison | None]  # by task; None: too few participants

    @property
    def said_of_simulated(self) -> str:
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
    shapes = shapes_of(design, kept)
    cells = {key: own for key, own in cells_of(kept).items() if design.task(key[1]).kind is Kind.STIFFER}
    functions = {
        key: fit(counts_of(own), design.task(key[1]).levels, shapes[key[1]]) for key, own in cells.items()
    }
    scores, names = scores_of(design, kept), [one.name for one in design.conditions]
    return Findings(
        design,
        tuple(sorted({entry["participant"] for entry in entries})),
        tuple(sorted({entry["participant"] for entry in entries if entry["is_simulated"]})),
        len(entries),
        sum(bool(entry["stopped"]) for entry in entries),
        kept,
        exclusions,
        shapes,
        functions,
        scores,
        missing_scores(design, entries, scores, exclusions),
        {task.name: compare(task.name, names, scores) for task in design.tasks},
    )
