"""Search for the worst positions of a scene: where a tick visits the most nodes and leaves.

The same seed gives the same places on every run. It is a search, not a proof: what it finds is a lower bound
of the worst; within the budget, the budget is the upper one.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from proximity.lab.certificate.search.ascent import ascend
from proximity.lab.certificate.search.starting_positions import Starts, starts
from proximity.lab.certificate.search.work import GOALS, NOWHERE, Costs, Goal, Probe
from proximity.lab.certificate.subject import Subject

START_COUNTS = (4000, 4000, 1000)
"""Positions at random, near surfaces, and samples for two medial positions each."""
CLIMBS = 24
"""For each goal."""
FIRST_RADIUS = 0.02
"""Share of the scene's diagonal: where neighbours of a position are looked for first."""
APART = 0.03
"""Share of the diagonal by which starts are apart at least: the costliest are often neighbours."""
MOST_STEPS = 25_000_000
"""Nodes and leaves visited for a goal, a few seconds; then the search for it ends with what it has."""
POSITIONS_PER_CHECK = 100  # places between two looks at how many steps are left


@dataclass(frozen=True, slots=True, eq=False)
class WorstPosition:
    """A position where a tick costs much, and what it costs."""

    position: np.ndarray  # (3,) m, scene's frame
    work: int  # nodes and leaves
    lower: float  # m, of the signed distance of the fingertip
    upper: float  # m
    origin: str  # what the climb began at: "random", "near the surface", "medial", "centre"
    start_work: int  # there


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Result of the search for one goal."""

    goal: Goal
    positions: tuple[WorstPosition, ...]  # the dearest first; at least one
    typical_work: float  # median over the random positions within the working range; nan if there was none
    start_count: int  # places that were looked at before climbing
    is_complete: bool  # False: the steps were spent before all positions were looked at

    @property
    def worst(self) -> WorstPosition:
        """The dearest."""
        return self.positions[0]


def search(
    subject: Subject,
    seed: int,
    *,
    counts: tuple[int, int, int] | None = None,
    most_steps: float = MOST_STEPS,
    progress: Callable[[str, float], None] = lambda _, __: None,
) -> tuple[Found, ...]:
    """Return the worst positions, for each of `GOALS`.

    *counts*: how many places climbs may begin at; `START_COUNTS` where not given. *progress*: called with
    what is done, and which share of the search is.
    """
    begin = starts(subject, START_COUNTS if counts is None else counts, np.random.default_rng([seed, 0]))
    found: list[Found] = []
    for number, goal in enumerate(GOALS):
        rng = np.random.default_rng([seed, 1 + number])
        progress(f"searching: {goal}", number / len(GOALS))
        one = _search_one(subject, goal, begin, rng, most_steps)
        found.append(one)
        # What is dear in one manner may be in another.
        begin = begin.extended(
            np.array([each.position for each in one.positions]), [each.origin for each in one.positions]
        )
    return tuple(found)


def _search_one(
    subject: Subject, goal: Goal, begin: Starts, rng: np.random.Generator, most_steps: float
) -> Found:
    probe = Probe(subject, goal)
    costs, rows = _look(probe, begin, rng, 0.5 * most_steps)
    origins = np.array(begin.origins)[rows]
    typical = costs.work[(origins == "random") & costs.is_in_range]
    lower, upper = subject.scene.bounds
    diagonal = float(np.linalg.norm(upper - lower))
    climbed = []
    for k in _apart(begin.positions[rows], costs.worth, APART * diagonal):
        start = begin.positions[rows[k]]
        climb = ascend(probe, start, FIRST_RADIUS * diagonal, rng, most_steps=most_steps)
        climbed.append(_climbed(probe, climb.position, str(origins[k]), int(costs.work[k])))
    climbed.sort(key=lambda pair: -pair[0])
    return Found(
        goal,
        tuple(each for _, each in climbed),
        float(np.median(typical)) if len(typical) else float("nan"),
        len(rows),
        len(rows) == len(begin.positions),
    )


def _climbed(probe: Probe, position: np.ndarray, origin: str, start_work: int) -> tuple[float, WorstPosition]:
    """The position at which a climb ended, and its worth."""
    at = probe.costs(position[None])
    worst = WorstPosition(
        position, int(at.work[0]), float(at.lower[0]), float(at.upper[0]), origin, start_work
    )
    return float(at.worth[0]), worst


def _look(
    probe: Probe, begin: Starts, rng: np.random.Generator, most_steps: float
) -> tuple[Costs, np.ndarray]:
    """Costs of positions, and which these are: all, or as many as the steps allow, centres first."""
    order = rng.permutation(len(begin.positions))
    is_centre = np.array([begin.origins[row] == "centre" for row in order])
    order = np.concatenate([order[is_centre], order[~is_centre]])
    found: list[Costs] = []
    for first in range(0, len(order), POSITIONS_PER_CHECK):
        if found and probe.steps >= most_steps:
            break
        found.append(probe.costs(begin.positions[order[first : first + POSITIONS_PER_CHECK]]))
    fields = ("work", "lower", "upper", "is_in_range")
    whole = Costs(*(np.concatenate([getattr(each, name) for each in found]) for name in fields))
    return whole, order[: len(whole.work)]


def _apart(positions: np.ndarray, worth: np.ndarray, distance: float) -> Iterator[int]:
    """The dearest of some positions that lie apart, at most `CLIMBS`; at least one."""
    chosen: list[int] = []
    for k in np.argsort(-worth, kind="stable").tolist():
        if len(chosen) == CLIMBS or (chosen and worth[k] == NOWHERE):
            break
        if all(np.linalg.norm(positions[k] - positions[other]) >= distance for other in chosen):
            chosen.append(k)
    yield from chosen
