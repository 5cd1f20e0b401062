"""Psychometric functions of two-interval answers, with separate thresholds, and shared width and lapse rate.

psi(x) = 1/2 + (1/2 - lapse) Phi((x - threshold) / sigma), where x is the log10 of a level. The answers of one
participant on one condition are too few to distinguish a wide function from lapses, and either mistake shifts
the threshold. Width and lapse rate are therefore fitted to all answers to a task together. Thresholds and
their credible intervals are those of psignifit. `threshold_means` computes the same mean of the posterior for
thousands of simulated participants.
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
    """Width and lapse rate that the psychometric functions of a task share."""

    width: float  # log10 units, from 5 to 95 %
    lapse: float


@dataclass(frozen=True, slots=True)
class Psychometric:
    """A fitted psychometric function, in units of the level."""

    threshold: float  # mean of the posterior, of the logarithm
    lower: float  # of the 95 % credible interval
    upper: float
    shape: Shape

    def at(self, levels: np.ndarray) -> np.ndarray:
        """Return the probability of a right answer at levels, with the same shape as *levels*."""
        return probability(np.log10(levels) - np.log10(self.threshold), self.shape)


def probability(above: np.ndarray, shape: Shape) -> np.ndarray:
    """Return the probability of a right answer at a distance from the threshold, log10 units."""
    return np.asarray(0.5 + (0.5 - shape.lapse) * ndtr(above * SIGMAS_OF_WIDTH / shape.width))


def shared_shape(levels: Sequence[float], right: np.ndarray, wrong: np.ndarray, expected: float) -> Shape:
    """Return the maximum-likelihood width and lapse rate of all answers together.

    *right*, *wrong*: counts, (levels, cells). Each cell has its own threshold, which is integrated out.
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
    """Return the posterior means of the thresholds, (cells,), log10."""
    thresholds, prior = _thresholds(levels)
    logs = _log_likelihood(levels, thresholds, shape, right, wrong)
    posterior = prior[:, None] * np.exp(logs - logs.max(axis=0))
    return np.asarray(thresholds @ posterior / posterior.sum(axis=0))


def fit(levels: Sequence[float], right: np.ndarray, wrong: np.ndarray, shape: Shape) -> Psychometric:
    """Fit a psychometric function to answers, (levels,), by psignifit."""
    with needed("experiments need", "experiment"):
        fit = import_module("psignifit").psignifit
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a posterior as wide as the prior, which its interval shows
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
    """Return the log-likelihood, (thresholds, cells), of right and wrong answers, (levels, cells)."""
    chance = probability(np.log10(levels) - thresholds[:, None], shape)
    return np.asarray(np.log(chance) @ right + np.log(np.maximum(1.0 - chance, 1e-12)) @ wrong)


def _thresholds(levels: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the thresholds of the grid, log10, and the prior of each.

    Source: Schütt et al. 2016, "Painfree and accurate Bayesian estimation of psychometric functions". The
    prior is uniform among the levels, and falls to 0 at half of their range beyond them.
    """
    low, high = np.log10(min(levels)), np.log10(max(levels))
    spread = high - low
    thresholds = np.linspace(low - spread / 2, high + spread / 2, THRESHOLD_COUNT)
    outside = np.maximum(np.maximum(low - thresholds, thresholds - high), 0.0)
    return thresholds, 1.0 + np.cos(2.0 * np.pi * outside / spread)
