"""Comparison of conditions: a mixed model of the scores, differences in pairs, and Bayes factors for none.

The model has a mean a condition and a random intercept a participant. Its Wald statistic is compared with F
of the degrees of freedom within participants: with so few participants chi-squared finds differences where
there are none (8 instead of 5 % with 12 participants and 4 conditions).
"""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import combinations

import numpy as np
from scipy import integrate, stats

from proximity.lab.experiment.analysis.scores import Score
from proximity.system.extras import needed

CAUCHY_SCALE = math.sqrt(0.5)  # of the prior of an effect's size, in standard deviations
FEWEST = 3  # participants


@dataclass(frozen=True, slots=True)
class Mean:
    """A condition, over participants."""

    condition: str
    value: float
    lower: float  # of the 95 % confidence interval
    upper: float
    p_zero: float  # of a t test against 0, adjusted for the number of conditions (Holm)
    participants: int


@dataclass(frozen=True, slots=True)
class Difference:
    """Two conditions, by the participants who did both."""

    first: str
    second: str
    value: float  # second less first
    lower: float  # of the 95 % confidence interval
    upper: float
    p: float  # adjusted for the number of pairs (Holm)
    bayes_factor_none: float  # how much likelier the data are if there is no difference
    participants: int


@dataclass(frozen=True, slots=True)
class Comparison:
    """The conditions of one task."""

    task: str
    f: float
    df: tuple[int, int]
    p: float
    means: tuple[Mean, ...]
    differences: tuple[Difference, ...]


def compare(task: str, conditions: Sequence[str], scores: Sequence[Score]) -> Comparison | None:
    """Return the comparison of conditions; None where there are too few participants."""
    own = [score for score in scores if score.task == task]
    participants = sorted({score.participant for score in own})
    compared = [name for name in conditions if any(score.condition == name for score in own)]
    if len(participants) < FEWEST:
        return None
    table = np.full((len(participants), len(compared)), np.nan)
    for score in own:
        table[participants.index(score.participant), compared.index(score.condition)] = score.value
    means = [_mean(name, table[:, i]) for i, name in enumerate(compared)]
    pairs = [
        _difference(compared[i], compared[j], table[:, j] - table[:, i])
        for i, j in combinations(range(len(compared)), 2)
    ]
    f, df, p = mixed_model(table) if len(compared) > 1 else (math.nan, (0, 0), math.nan)
    adjusted = _holm([one.p_zero for one in means])
    tested = tuple(replace(one, p_zero=own) for one, own in zip(means, adjusted, strict=True))
    adjusted = _holm([one.p for one in pairs])
    return Comparison(
        task, f, df, p, tested, tuple(replace(one, p=own) for one, own in zip(pairs, adjusted, strict=True))
    )


def mixed_model(table: np.ndarray) -> tuple[float, tuple[int, int], float]:
    """Return F, its degrees of freedom and p of a difference among conditions."""
    with needed("experiments need", "experiment"):
        model = import_module("statsmodels.regression.mixed_linear_model").MixedLM
    participant, condition = np.nonzero(np.isfinite(table))
    count, groups = table.shape[1], len(set(participant.tolist()))
    design = np.eye(count)[condition]
    design[:, 0] = 1.0  # the first condition, and the others' differences from it
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of participants who do not differ: their variance is 0
        fitted = model(table[participant, condition], design, participant).fit(reml=True)
    effects = fitted.fe_params[1:]
    covariance = np.asarray(fitted.cov_params())[1:count, 1:count]
    f = float(effects @ np.linalg.solve(covariance, effects)) / (count - 1)
    df = (count - 1, len(participant) - groups - (count - 1))
    return f, df, float(stats.f.sf(f, *df))


def within_f(tables: np.ndarray) -> np.ndarray:
    """Return p of a difference among conditions for many complete tables: what `mixed_model` finds for each.

    *tables*: (..., participants, conditions).
    """
    rows, columns = tables.shape[-2:]
    grand = tables.mean(axis=(-2, -1), keepdims=True)
    condition = tables.mean(axis=-2, keepdims=True) - grand
    participant = tables.mean(axis=-1, keepdims=True) - grand
    rest = np.square(tables - grand - condition - participant).sum(axis=(-2, -1))
    between = np.square(participant).sum(axis=(-2, -1)) * columns
    # Where participants differ less than chance has them differ, the model finds no variance among them.
    pooled = (rest + between) / ((rows - 1) * columns)
    noise = np.minimum(rest / ((rows - 1) * (columns - 1)), pooled)
    f = rows * np.square(condition).sum(axis=(-2, -1)) / (columns - 1) / noise
    return np.asarray(stats.f.sf(f, columns - 1, (rows - 1) * (columns - 1)))


def bayes_factor_none(t: float, count: int) -> float:
    """Return how much likelier *t* of *count* differences is if there is no effect than if there is one.

    Source: Rouder et al. 2009, "Bayesian t tests for accepting and rejecting the null hypothesis", eq. 1,
    with a Cauchy prior of scale 0.707 on the size of the effect.
    """
    df = count - 1

    def weight(g: float) -> float:
        wide = 1.0 + count * g * CAUCHY_SCALE**2
        likelihood = wide**-0.5 * (1.0 + t * t / (wide * df)) ** (-0.5 * count)
        return likelihood * (2.0 * math.pi) ** -0.5 * g**-1.5 * math.exp(-0.5 / g)

    some = integrate.quad(weight, 0.0, 1.0)[0] + integrate.quad(weight, 1.0, math.inf)[0]
    return float((1.0 + t * t / df) ** (-0.5 * count) / some)


def _mean(condition: str, values: np.ndarray) -> Mean:
    there = values[np.isfinite(values)]
    tested, interval = _tested(there)
    return Mean(condition, float(there.mean()), *interval, tested[1], len(there))


def _difference(first: str, second: str, values: np.ndarray) -> Difference:
    there = values[np.isfinite(values)]
    (t, p), interval = _tested(there)
    if math.isnan(t):
        return Difference(first, second, math.nan, math.nan, math.nan, math.nan, math.nan, len(there))
    factor = bayes_factor_none(t, len(there))
    return Difference(first, second, float(there.mean()), *interval, p, factor, len(there))


def _tested(values: np.ndarray) -> tuple[tuple[float, float], tuple[float, float]]:
    """t and p of values against 0, nan of too few or of equal ones; the 95 % interval of their mean."""
    if len(values) < 2:
        return (math.nan, math.nan), (math.nan, math.nan)
    if not values.std() > 0.0:
        return (math.nan, math.nan), (float(values.mean()), float(values.mean()))
    found = stats.ttest_1samp(values, 0.0)
    low, high = found.confidence_interval()
    test = (float(found.statistic), float(found.pvalue)) if len(values) >= FEWEST else (math.nan, math.nan)
    return test, (float(low), float(high))


def _holm(ps: Sequence[float]) -> list[float]:
    """p with Holm's adjustment; those that are nan stay so, and do not count."""
    adjusted = np.array(ps, np.float64)
    is_known = np.isfinite(adjusted)
    if is_known.any():
        with needed("experiments need", "experiment"):
            multipletests = import_module("statsmodels.stats.multitest").multipletests
        adjusted[is_known] = multipletests(adjusted[is_known], method="holm")[1]
    return adjusted.tolist()
