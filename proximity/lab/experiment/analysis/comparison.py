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

from proximity.system.extras import needed

CAUCHY_SCALE = math.sqrt(0.5)  # of the prior of an effect's size, in standard deviations
FEWEST = 3  # participants


@dataclass(frozen=True, slots=True)
class Score:
    """How one participant did in a task on a condition."""

    participant: str
    task: str
    condition: str
    value: float
    trials: int


@dataclass(frozen=True, slots=True)
class Effect:
    """A condition, or what it differs by from an earlier one, over the participants who did it, or both."""

    condition: str
    less: str  # the earlier one; empty: none
    value: float
    lower: float  # of the 95 % confidence interval
    upper: float
    t: float  # against 0; nan: of too few, or of values that are all the same
    p: float  # adjusted for the number of conditions, or of pairs (Holm)
    participants: int

    @property
    def bayes_factor_none(self) -> float:
        """How much likelier the data are if the effect is 0."""
        return bayes_factor_none(self.t, self.participants) if math.isfinite(self.t) else math.nan


@dataclass(frozen=True, slots=True)
class Comparison:
    """The conditions of one task."""

    task: str
    f: float
    df: tuple[int, int]
    p: float
    means: tuple[Effect, ...]
    differences: tuple[Effect, ...]


def compare(task: str, conditions: Sequence[str], scores: Sequence[Score]) -> Comparison | None:
    """Return the comparison of conditions; None where there are too few participants."""
    values = {(one.participant, one.condition): one.value for one in scores if one.task == task}
    participants = sorted({participant for participant, _ in values})
    compared = [name for name in conditions if any(name == condition for _, condition in values)]
    if len(participants) < FEWEST:
        return None
    table = np.array([[values.get((one, name), math.nan) for name in compared] for one in participants])
    means = [_effect(name, "", column) for name, column in zip(compared, table.T, strict=True)]
    pairs = combinations(range(len(compared)), 2)
    differences = [_effect(compared[j], compared[i], table[:, j] - table[:, i]) for i, j in pairs]
    f, df, p = mixed_model(table) if len(compared) > 1 else (math.nan, (0, 0), math.nan)
    return Comparison(task, f, df, p, _adjusted(means), _adjusted(differences))


def _effect(condition: str, less: str, values: np.ndarray) -> Effect:
    there = values[np.isfinite(values)]
    count, value, half, t, p = len(there), math.nan, math.nan, math.nan, math.nan
    is_tested = count >= FEWEST and bool(there.std() > 0.0)
    if is_tested or not less:
        value = float(there.mean())
    if is_tested or (not less and count > 1):
        half = float(stats.sem(there) * stats.t.ppf(0.975, count - 1))
    if is_tested:  # not by SciPy's test, which warns of values that are nearly the same
        t = float(value / stats.sem(there))
        p = 2.0 * float(stats.t.sf(abs(t), count - 1))
    return Effect(condition, less, value, value - half, value + half, t, p, count)


def _adjusted(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Effects with Holm's adjustment of p; those that are nan stay so, and do not count."""
    tested = [one for one in effects if not math.isnan(one.p)]
    if not tested:
        return tuple(effects)
    with needed("experiments need", "experiment"):
        adjust = import_module("statsmodels.stats.multitest").multipletests
    ps = iter(adjust([one.p for one in tested], method="holm")[1].tolist())
    return tuple(one if math.isnan(one.p) else replace(one, p=next(ps)) for one in effects)


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
