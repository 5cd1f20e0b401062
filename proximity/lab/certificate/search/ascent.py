"""Random local search: from a position to neighbours where a tick does more work, until there are none.

Work is a sum of steps and has no slope. Neighbours are drawn at random in a ball, which shrinks when none of
them costs more. The work never decreases.
"""

from dataclasses import dataclass

import numpy as np

from proximity.lab.certificate.search.work import Probe

NEIGHBOURS = 20  # that are looked at in a round
SHRINK = 0.5  # of the ball, after a round without a dearer one
ROUNDS = 60
SMALLEST = 1e-7  # m: nothing that a hand does is smaller


@dataclass(frozen=True, slots=True, eq=False)
class Climb:
    """One run of the search from one start."""

    position: np.ndarray  # (3,) m, where it ended
    worth: tuple[float, ...]  # at the start and after each round: see `Costs.worth`


def ascend(
    probe: Probe, start: np.ndarray, radius: float, rng: np.random.Generator, *, most_steps: float
) -> Climb:
    """Search from a position for one where a tick costs most.

    *start*: (3,) m. *radius*: of the ball in which the first neighbours lie. *most_steps*: nodes and leaves
    that the probe may have visited before another round begins.
    """
    position = np.asarray(start, np.float64)
    worth = [float(probe.costs(position[None]).worth[0])]
    for _ in range(ROUNDS):
        if radius < SMALLEST or probe.steps >= most_steps:
            break
        around = position + radius * _in_ball(NEIGHBOURS, rng)
        found = probe.costs(around).worth
        best = int(np.argmax(found))
        if found[best] > worth[-1]:
            position = around[best]
            worth.append(float(found[best]))
        else:
            radius *= SHRINK
            worth.append(worth[-1])
    return Climb(position, tuple(worth))


def _in_ball(count: int, rng: np.random.Generator) -> np.ndarray:
    """Points in the unit ball, denser toward its centre: small steps are tried as well."""
    directions = rng.normal(size=(count, 3))
    return np.asarray(
        directions / np.linalg.norm(directions, axis=1, keepdims=True) * rng.uniform(0.0, 1.0, (count, 1))
    )
