"""Psychometric functions of answers in two intervals: a threshold each, width and lapse rate in common.

psi(x) = 1/2 + (1/2 - lapse) Phi((x - threshold) / sigma), x the log10 of a level. The answers of one
participant on one condition are too few to separate a wide function from lapses, and either mistake shifts
the threshold: width and lapse rate are fitted to all answers to a task together. Thresholds and their
credible intervals are psignifit's. `threshold_means` is the same mean of the posterior for thousands of
simulated participants.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module

import numpy as np
from scipy.special import ndtr

from proximity.system.extras import needed

SIGMAS_OF_WIDTH = 2.0 * 1.6448536269514722  # from 5 to 95 % of a normal distribution
WIDTHS = np.geomspace(0.25, 4.0, 49)  # in expected widths
WIDTH_DEVIATION = 0.15  # log10 units, of the prior about the expected width
LAPSES = np.linspace(0.0, 0.12, 13)
LAPSE_POWER = 9  # prior Beta(1, 10)
THRESHOLD_COUNT = 201


@dataclass(frozen=True, slots=True)
class Shape:
    """Width and lapse rate, shared by the psychometric functions of a task."""

    width: float  # log10 units, from 5 to 95 %
    lapse: float


@dataclass(frozen=True, slots=True)
class Psychometric:
    """A fitted function, in levels."""

    threshold: float  # mean of the posterior, of the logarithm
    lower: float  # of the 95 % credible interval
    upper: float
    shape: Shape

    def at(self, levels: np.ndarray) -> np.ndarray:
        """Return the probability of a right answer at levels, of any shape."""
        return probability(np.log10(levels) - np.log10(self.threshold), self.shape)


def probability(above: np.ndarray, shape: Shape) -> np.ndarray:
    """Return the probability of a right answer at log10 units above the threshold."""
    return np.asarray(0.5 + (0.5 - shape.lapse) * ndtr(above * SIGMAS_OF_WIDTH / shape.width))


def shared_shape(levels: Sequence[float], right: np.ndarray, wrong: np.ndarray, expected: float) -> Shape:
    """Return the maximum-likelihood width and lapse rate of all answers together.

    *right*, *wrong*: (levels, cells) counts; each cell has its own threshold, which is integrated out.
    """
    thresholds, prior = _thresholds(levels)
    best = -np.inf, Shape(expected, 0.0)
    for width in expected * WIDTHS:
        deviation = np.log10(width / expected) / WIDTH_DEVIATION
        for lapse in LAPSES:
            shape = Shape(float(width), float(lapse))
            logs = _log_likelihood(levels, thresholds, shape, right, wrong)
            largest = logs.max(axis=0)
            each = largest + np.log(prior @ np.exp(logs - largest))
            total = float(each.sum()) + LAPSE_POWER * float(np.log1p(-lapse)) - 0.5 * float(deviation) ** 2
            best = max(best, (total, shape), key=lambda found: found[0])
    return best[1]


def threshold_means(
    levels: Sequence[float], right: np.ndarray, wrong: np.ndarray, shape: Shape
) -> np.ndarray:
    """Return (cells,) posterior means of the log10 of the thresholds."""
    thresholds, prior = _thresholds(levels)
    logs = _log_likelihood(levels, thresholds, shape, right, wrong)
    posterior = prior[:, None] * np.exp(logs - logs.max(axis=0))
    return np.asarray(thresholds @ posterior / posterior.sum(axis=0))


def fit(levels: Sequence[float], right: np.ndarray, wrong: np.ndarray, shape: Shape) -> Psychometric:
    """Return the psychometric function of (levels,) answers, by psignifit."""
    with needed("experiments need", "experiment"):
        fit = import_module("psignifit").psignifit
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a posterior as wide as the prior: its interval shows that
        found = fit(
            np.stack([np.log10(levels), right, right + wrong], axis=1),
            experiment_type="2AFC",
            sigmoid="norm",
            estimate_type="mean",
            stimulus_range=(float(np.log10(min(levels))), float(np.log10(max(levels)))),
            fixed_parameters={"eta": 0.0, "width": shape.width, "lambda": shape.lapse},
            grid_steps={"threshold": THRESHOLD_COUNT},
            steps_moving_bounds={"threshold": THRESHOLD_COUNT},
            verbose=False,
        )
    lower, upper = found.confidence_intervals["threshold"]["0.95"]
    mean = found.get_parameter_estimate("mean")["threshold"]
    return Psychometric(float(10.0**mean), float(10.0**lower), float(10.0**upper), shape)


def _log_likelihood(
    levels: Sequence[float], thresholds: np.ndarray, shape: Shape, right: np.ndarray, wrong: np.ndarray
) -> np.ndarray:
    """Return (thresholds, cells) of (levels, cells) right and wrong answers."""
    chance = probability(np.log10(levels) - thresholds[:, None], shape)
    return np.asarray(np.log(chance) @ right + np.log(np.maximum(1.0 - chance, 1e-12)) @ wrong)


def _thresholds(levels: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the thresholds of the grid, log10, and the prior of each.

    Source: Schütt et al. 2016, "Painfree and accurate Bayesian estimation of psychometric functions": uniform
    among the levels, falling to 0 half their range beyond.
    """
    low, high = np.log10(min(levels)), np.log10(max(levels))
    spread = high - low
    thresholds = np.linspace(low - spread / 2, high + spread / 2, THRESHOLD_COUNT)
    outside = np.maximum(np.maximum(low - thresholds, thresholds - high), 0.0)
    return thresholds, 1.0 + np.cos(2.0 * np.pi * outside / spread)
