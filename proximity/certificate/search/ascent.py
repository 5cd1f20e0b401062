"""Climbing on work: from a place to dearer ones beside it, until there are none.

Work is a sum of steps and has no slope: neighbours are drawn at random in a ball, which shrinks when none is
dearer. It never goes down.
"""

from dataclasses import dataclass

import numpy as np

from proximity.certificate.search.work import Probe

NEIGHBOURS = 20  # that are looked at in a round
SHRINK = 0.5  # of the ball, after a round without a dearer one
ROUNDS = 60
SMALLEST = 1e-7  # m: nothing that a hand does is smaller


@dataclass(frozen=True, slots=True, eq=False)
class Climb:
    """A way upwards."""

    place: np.ndarray  # (3,) m, where it ended
    worth: tuple[float, ...]  # at the start and after each round: see `Costs.worth`


def ascend(
    probe: Probe, start: np.ndarray, radius: float, rng: np.random.Generator, *, most_steps: float
) -> Climb:
    """Return the way from a place to the dearest that is found.

    Parameters
    ----------
    probe : Probe
        Tells what places cost.
    start : (3,) float64, m
        Where it begins.
    radius : float, m
        Of the ball in which the first neighbours lie.
    rng : Generator
        Decides which.
    most_steps : float
        Nodes and leaves that the probe may have visited before another round begins.
    """
    place = np.asarray(start, np.float64)
    worth = [float(probe.costs(place[None]).worth[0])]
    for _ in range(ROUNDS):
        if radius < SMALLEST or probe.steps >= most_steps:
            break
        around = place + radius * _in_ball(NEIGHBOURS, rng)
        found = probe.costs(around).worth
        best = int(np.argmax(found))
        if found[best] > worth[-1]:
            place = around[best]
            worth.append(float(found[best]))
        else:
            radius *= SHRINK
            worth.append(worth[-1])
    return Climb(place, tuple(worth))


def _in_ball(count: int, rng: np.random.Generator) -> np.ndarray:
    """Points in the unit ball, denser toward its centre: small steps are tried as well."""
    ways = rng.normal(size=(count, 3))
    return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True) * rng.uniform(0.0, 1.0, (count, 1)))
