"""Search for the worst positions of a scene, where a tick visits the largest number of nodes and leaves.

A random local search climbs from the costliest of many starting positions, as work is a sum of steps and has
no gradient. The same seed gives the same positions on every run. The result is a lower bound of the worst
case, not a proof. The budget of the ticks, if there is one, is the upper bound.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from proximity.lab.certificate.starting_positions import starting_positions
from proximity.lab.certificate.subject import Subject
from proximity.lab.certificate.work import GOALS, NOWHERE, Probe, SearchGoal, in_range, worth

START_COUNTS = (4000, 4000, 1000)
"""Number of random positions, of positions near surfaces, and of samples for two medial positions each."""
CLIMBS = 24  # for each goal
FIRST_RADIUS = 0.02  # share of the scene's diagonal, initial radius of the search for neighbours
APART = 0.03  # share of the diagonal, minimum distance of starts, as the costliest are often close
MAX_STEPS = 25_000_000
"""Maximum number of nodes and leaves visited for a goal, which takes a few seconds.

A search that reaches it returns its best results.
"""
POSITIONS_PER_CHECK = 100  # between two checks of the remaining steps
NEIGHBOURS = 20  # in one round of a climb
SHRINK = 0.5  # factor of the ball of neighbours after a round without a costlier one
ROUNDS = 60
SMALLEST = 1e-7  # m, less than any motion of a hand

Progress = Callable[[str, float], None]
"""Function that is called with the current activity and the finished share."""


@dataclass(frozen=True, slots=True, eq=False)
class WorstPosition:
    """A costly position and its cost."""

    position: np.ndarray  # (3,) m, scene's frame
    work: int  # nodes and leaves
    lower: float  # m, of the signed distance of the fingertip
    upper: float  # m
    origin: str  # start of the climb: "random", "near the surface", "medial", "centre"
    start_work: int  # work at the start of the climb


@dataclass(frozen=True, slots=True, eq=False)
class SearchResult:
    """Result of the search for one goal."""

    goal: SearchGoal
    positions: tuple[WorstPosition, ...]  # the costliest first; at least one
    typical_work: float  # median over the random positions within the working range; nan if there are none
    start_count: int  # positions evaluated before climbing
    is_complete: bool  # False if the steps were exhausted before all positions were evaluated


def search(
    subject: Subject,
    seed: int,
    *,
    counts: tuple[int, int, int] | None = None,
    max_steps: float = MAX_STEPS,
    progress: Progress = lambda _, __: None,
) -> dict[SearchGoal, SearchResult]:
    """Search for the worst positions for each of `GOALS`.

    *counts*: numbers of starting positions, by default `START_COUNTS`.
    """
    rng = np.random.default_rng([seed, 0])
    positions, origins = starting_positions(subject, START_COUNTS if counts is None else counts, rng)
    found: dict[SearchGoal, SearchResult] = {}
    for number, goal in enumerate(GOALS):
        progress(f"searching: {goal}", number / len(GOALS))
        rng = np.random.default_rng([seed, 1 + number])
        found[goal] = _search_one(subject, goal, positions, origins, rng, max_steps)
        # A costly position in one mode may be costly in another.
        worst = found[goal].positions
        positions = np.concatenate([positions, [each.position for each in worst]])
        origins = np.concatenate([origins, [each.origin for each in worst]])
    return found


def _search_one(
    subject: Subject,
    goal: SearchGoal,
    positions: np.ndarray,
    origins: np.ndarray,
    rng: np.random.Generator,
    max_steps: float,
) -> SearchResult:
    probe = Probe(subject, goal)
    contacts, rows = _look(probe, positions, origins == "centre", rng, 0.5 * max_steps)
    work, begun = contacts["work"], origins[rows]
    typical = work[(begun == "random") & in_range(contacts)]
    diagonal = float(np.linalg.norm(np.diff(subject.scene.bounds, axis=0)))
    climbed = []
    for k in _apart(positions[rows], worth(contacts), APART * diagonal):
        start, radius = positions[rows[k]], FIRST_RADIUS * diagonal
        position, gained = ascend(probe, start, radius, rng, max_steps=max_steps)
        (at,) = probe.contacts(position[None])
        bounds = int(at["work"]), float(at["lower"]), float(at["upper"])
        climbed.append((gained[-1], WorstPosition(position, *bounds, str(begun[k]), int(work[k]))))
    climbed.sort(key=lambda pair: -pair[0])
    return SearchResult(
        goal,
        tuple(each for _, each in climbed),
        float(np.median(typical)) if len(typical) else float("nan"),
        len(rows),
        len(rows) == len(positions),
    )


def ascend(
    probe: Probe, start: np.ndarray, radius: float, rng: np.random.Generator, *, max_steps: float
) -> tuple[np.ndarray, list[float]]:
    """Climb from a position (3,), m, to a costlier one.

    Return it and the worth at the start and after each round.

    Neighbours are drawn in a ball that shrinks when none of them costs more, until the probe has made
    *max_steps*.
    """
    position = np.asarray(start, np.float64)
    gained = [float(worth(probe.contacts(position[None]))[0])]
    for _ in range(ROUNDS):
        if radius < SMALLEST or probe.steps >= max_steps:
            break
        around = position + radius * _in_ball(NEIGHBOURS, rng)
        found = worth(probe.contacts(around))
        best = int(np.argmax(found))
        if found[best] > gained[-1]:
            position = around[best]
        else:
            radius *= SHRINK
        gained.append(max(float(found[best]), gained[-1]))
    return position, gained


def _in_ball(count: int, rng: np.random.Generator) -> np.ndarray:
    """Return random points in the unit ball. They are denser toward its centre, to include small steps."""
    directions = rng.normal(size=(count, 3))
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    return np.asarray(directions / lengths * rng.uniform(0.0, 1.0, (count, 1)))


def _look(
    probe: Probe, positions: np.ndarray, is_centre: np.ndarray, rng: np.random.Generator, max_steps: float
) -> tuple[np.ndarray, np.ndarray]:
    """Evaluate positions until the steps are exhausted, centres first. Return contacts and their rows."""
    order = rng.permutation(len(positions))
    order = np.concatenate([order[is_centre[order]], order[~is_centre[order]]])
    found: list[np.ndarray] = []
    for first in range(0, len(order), POSITIONS_PER_CHECK):
        if found and probe.steps >= max_steps:
            break
        found.append(probe.contacts(positions[order[first : first + POSITIONS_PER_CHECK]]))
    contacts = np.concatenate(found)
    return contacts, order[: len(contacts)]


def _apart(positions: np.ndarray, worths: np.ndarray, distance: float) -> Iterator[int]:
    """Yield the rows of the costliest positions that are a distance apart, at least one of them.

    There are at most `CLIMBS`.
    """
    chosen: list[int] = []
    for k in np.argsort(-worths, kind="stable").tolist():
        if len(chosen) == CLIMBS or (chosen and worths[k] == NOWHERE):
            break
        if all(np.linalg.norm(positions[k] - positions[other]) >= distance for other in chosen):
            chosen.append(k)
    yield from chosen
