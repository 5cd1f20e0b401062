"""Power of a design, which is the probability that its analysis finds the expected differences.

A pool of participants is simulated without presses, and experiments are drawn from it.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats
from scipy.special import expit, logit

from proximity.lab.experiment.analysis import holm, log_odds, paired_p
from proximity.lab.experiment.design import Design, Kind, Task
from proximity.lab.experiment.psychometric import Shape, probability, shared_shape, threshold_means

SIGNIFICANT, WANTED = 0.05, 0.8
POOL = 2000  # simulated participants
MAX_EFFECT = 20.0  # standard deviations


@dataclass(frozen=True, slots=True)
class Power:
    """Power of one planned comparison."""

    task: str
    pair: tuple[str, str]  # the first against the second
    kind: Kind
    participants: int
    expected: tuple[float, float]  # expected thresholds or shares of right answers
    share: float  # of experiments that find it
    smallest: float  # value of the first found in 80 % of them, the second as expected


def power(design: Design, participants: int, repetitions: int = 1000) -> list[Power]:
    """Return the power of each planned comparison for a number of participants."""
    rng, found = np.random.default_rng(design.seed), []
    for task in design.tasks:
        names = [one.name for one in design.compared(task)]
        if not (pairs := design.pairs(task)):
            continue
        scores = _scores(design, task, participants, rng)
        columns = [(names.index(first), names.index(second)) for first, second in pairs]
        differences = np.stack([scores[:, i] - scores[:, j] for i, j in columns])
        drawn = differences[:, rng.integers(POOL, size=(repetitions, participants))]
        shares = (holm(paired_p(drawn).T) < SIGNIFICANT).mean(axis=0)
        for pair, own, share in zip(pairs, differences, shares.tolist(), strict=True):
            expected = _expected(design, task, pair)
            effect = float(own.std()) * _smallest_effect(participants, SIGNIFICANT / len(pairs))
            smallest = _changed(task.kind, expected, effect)
            found.append(Power(task.name, pair, task.kind, participants, expected, share, smallest))
    return found


def _scores(design: Design, task: Task, participants: int, rng: np.random.Generator) -> np.ndarray:
    """Return the scores of simulated participants, (POOL, conditions)."""
    expected, conditions = design.observers, design.compared(task)
    size = (POOL, len(conditions))
    if task.kind is Kind.REAL:
        right = rng.binomial(task.trials, [one.correct for one in conditions], size)
        return log_odds(right, task.trials - right)
    true = np.log10([one.threshold for one in conditions]) + expected.interaction * rng.standard_normal(size)
    true += expected.spread * rng.standard_normal((POOL, 1))
    each = task.trials // len(task.levels)
    chance = probability(
        np.log10(task.levels)[:, None] - true.reshape(1, -1), Shape(expected.width, expected.lapse)
    )
    right = rng.binomial(each, chance)
    own = right[:, : participants * len(conditions)]
    shape = shared_shape(task.levels, own, each - own, expected.width)
    return threshold_means(task.levels, right, each - right, shape).reshape(size)


def _smallest_effect(participants: int, significant: float) -> float:
    """Return the mean difference that a paired t test finds in `WANTED` of all experiments, in deviations."""
    freedom = participants - 1
    critical = stats.t.isf(significant / 2.0, freedom)

    def missing(effect: float) -> float:
        return float(stats.nct.sf(critical, freedom, effect * math.sqrt(participants))) - WANTED

    return float(optimize.brentq(missing, 0.0, MAX_EFFECT))


def _expected(design: Design, task: Task, pair: tuple[str, str]) -> tuple[float, float]:
    known = {
        one.name: one.threshold if task.kind is Kind.STIFFER else one.correct for one in design.conditions
    }
    return known[pair[0]], known[pair[1]]


def _changed(kind: Kind, expected: tuple[float, float], effect: float) -> float:
    """Return the value of the first condition that differs from the second's by an effect.

    The difference has the expected sign.
    """
    effect = math.copysign(effect, expected[0] - expected[1])
    if kind is Kind.STIFFER:
        return expected[1] * 10.0**effect
    return float(expit(logit(expected[1]) + effect))
