"""Psychometric functions of answers in two intervals: a threshold each, width and lapse rate in common.

psi(x) = 1/2 + (1/2 - lapse) Phi((x - threshold) / sigma), x the log10 of a level. The answers of one
participant on one condition are too few to tell a wide function from lapses, and either mistake moves the
threshold (by 0.17 in log10, with 40 trials of a staircase): width and lapse rate are those of all answers to
a task together. Thresholds and their credible intervals are psignifit's. `threshold_mean` is the same mean of
the posterior without psignifit, for thousands of simulated participants.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module

import numpy as np
from scipy.special import ndtr

from proximity.lab.experiment.plan import SIGMAS_OF_WIDTH
from proximity.system.extras import needed

WIDTHS = np.geomspace(0.25, 4.0, 49)  # looked at, in expected widths
WIDTH_DEVIATION = 0.15  # log10 units, of the prior about the expected width
LAPSES = np.linspace(0.0, 0.12, 13)
LAPSE_POWER = 9  # prior Beta(1, 10)
THRESHOLD_COUNT = 201

Counts = dict[float, tuple[int, int]]
"""By level: right answers, and all."""


@dataclass(frozen=True, slots=True)
class Shape:
    """What psychometric functions of a task have in common."""

    width: float  # log10 units, from 5 to 95 %
    lapse: float


@dataclass(frozen=True, slots=True)
class Psychometric:
    """A fitted function, in levels."""

    threshold: float  # mean of the posterior, of the logarithm
    lower: float  # of the 95 % credible interval
    upper: float
    shape: Shape
    trials: int

    def at(self, levels: np.ndarray) -> np.ndarray:
        """Return the probability of a right answer at levels, of any shape."""
        return _probability(np.log10(levels) - np.log10(self.threshold), self.shape.width, self.shape.lapse)


def shared_shape(cells: Sequence[Counts], levels: Sequence[float], expected: float) -> Shape:
    """Return the width and the lapse rate that are likeliest by the answers of all together.

    *cells*: of each participant and condition; each has its own threshold, which is integrated out. *levels*:
    that the design allows: thresholds are expected in their range.
    """
    thresholds, prior = _thresholds(levels)
    asked, right, wrong = _matrices(cells)
    best = -np.inf, Shape(expected, 0.0)
    for width in expected * WIDTHS:
        deviation = np.log10(width / expected) / WIDTH_DEVIATION
        for lapse in LAPSES:
            log_likelihood = _log_likelihood(asked - thresholds[:, None], width, lapse, right, wrong)
            largest = log_likelihood.max(axis=0)
            each = largest + np.log(prior @ np.exp(log_likelihood - largest))
            total = float(each.sum()) + LAPSE_POWER * float(np.log1p(-lapse)) - 0.5 * float(deviation) ** 2
            best = max(best, (total, Shape(float(width), float(lapse))), key=lambda found: found[0])
    return best[1]


def threshold_mean(counts: Counts, levels: Sequence[float], shape: Shape) -> float:
    """Return the mean of the posterior of the log10 of the threshold, as `fit` has it."""
    thresholds, prior = _thresholds(levels)
    asked, right, wrong = _matrices([counts])
    logs = _log_likelihood(asked - thresholds[:, None], shape.width, shape.lapse, right, wrong)[:, 0]
    posterior = prior * np.exp(logs - logs.max())
    return float(posterior @ thresholds / posterior.sum())


def fit(counts: Counts, levels: Sequence[float], shape: Shape) -> Psychometric:
    """Return the psychometric function of answers."""
    # psignifit refuses answers at one level, which an adaptive method may have asked alone; with
    # levels that were not asked they tell the same, since the shape is given.
    unasked = {level: (0, 0) for level in levels if level not in counts} if len(counts) == 1 else {}
    data = np.array(
        [[np.log10(level), right, count] for level, (right, count) in sorted((counts | unasked).items())]
    )
    with needed("experiments need", "experiment"):
        fit = import_module("psignifit").psignifit
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a posterior as wide as the prior: its interval says so
        found = fit(
            data,
            experiment_type="2AFC",
            sigmoid="norm",
            estimate_type="mean",
            stimulus_range=_range(levels),
            fixed_parameters={"eta": 0.0, "width": shape.width, "lambda": shape.lapse},
            grid_steps={"threshold": THRESHOLD_COUNT},
            steps_moving_bounds={"threshold": THRESHOLD_COUNT},
            verbose=False,
        )
    lower, upper = found.confidence_intervals["threshold"]["0.95"]
    mean = found.get_parameter_estimate("mean")["threshold"]
    threshold, low, high = (float(10.0**x) for x in (mean, lower, upper))
    return Psychometric(threshold, low, high, shape, int(data[:, 2].sum()))


def _probability(above: np.ndarray, width: float, lapse: float) -> np.ndarray:
    """Probability of a right answer so far above the threshold, log10 units."""
    return np.asarray(0.5 + (0.5 - lapse) * ndtr(above * SIGMAS_OF_WIDTH / width))


def _log_likelihood(
    above: np.ndarray, width: float, lapse: float, right: np.ndarray, wrong: np.ndarray
) -> np.ndarray:
    """(thresholds, cells) of (thresholds, levels) and (levels, cells) right and wrong answers."""
    probability = _probability(above, width, lapse)
    return np.asarray(np.log(probability) @ right + np.log(np.maximum(1.0 - probability, 1e-12)) @ wrong)


def _thresholds(levels: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Thresholds that are looked at, log10, and how likely each is beforehand.

    Source: Schütt et al. 2016, "Painfree and accurate Bayesian estimation of psychometric functions": the
    same anywhere among the levels, falling to nothing half their range beyond.
    """
    low, high = _range(levels)
    spread = high - low
    thresholds = np.linspace(low - spread / 2, high + spread / 2, THRESHOLD_COUNT)
    outside = np.maximum(np.maximum(low - thresholds, thresholds - high), 0.0)
    return thresholds, 1.0 + np.cos(2.0 * np.pi * outside / spread)


def _matrices(cells: Sequence[Counts]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Levels, log10, and right and wrong answers at each, (levels, cells)."""
    levels = sorted({level for counts in cells for level in counts})
    answers = np.array([[counts.get(level, (0, 0)) for counts in cells] for level in levels], np.float64)
    return np.log10(levels), answers[..., 0], answers[..., 1] - answers[..., 0]


def _range(levels: Sequence[float]) -> tuple[float, float]:
    return float(np.log10(min(levels))), float(np.log10(max(levels)))
