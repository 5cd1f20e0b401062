"""Tick times against sample periods: percentiles, missed deadlines, and their confidence.

A percentile is reported where the ticks support it: beyond it must lie at least one of them.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import beta

from proximity.errors import ServiceError
from proximity.service import Histogram

SURE = 0.95
MILLION = 1_000_000
SHARES = {"p50": 50.0, "p99": 99.0, "p999": 99.9, "max": 100.0}
FEWEST_TICKS = 1000
"""That p99.9 asks for."""


@dataclass(frozen=True, slots=True)
class Period:
    """A haptic sample period, and who asks for it."""

    seconds: float
    source: str

    @property
    def ns(self) -> float:
        """The same in nanoseconds."""
        return 1e9 * self.seconds


PERIODS = (
    Period(0.040, "the paper's delay, 25 Hz"),
    Period(0.005, "the paper's wall, 200 Hz"),
    Period(0.003, "Kazerooni's bound"),
    Period(0.001, "1 kHz"),
    Period(0.0002, "5 kHz"),
)


@dataclass(frozen=True, slots=True)
class Misses:
    """Number of ticks that took longer than a period."""

    count: int
    tick_count: int

    @property
    def per_million(self) -> float:
        """Misses per million of the ticks measured."""
        return MILLION * self.count / self.tick_count

    @property
    def per_million_upper(self) -> float:
        """Not more than that, with 95 % certainty, if ticks are independent: see `upper_share`."""
        return MILLION * upper_share(self.count, self.tick_count)


def upper_share(count: int, total: int) -> float:
    """Return a share that the true one does not exceed, with 95 % certainty.

    Notes
    -----
    Source: Clopper & Pearson 1934, one-sided. For a count of zero it is the rule of three, 3 / total.
    """
    return 1.0 if count >= total else float(beta.ppf(SURE, count + 1, total - count))


def misses(times_ns: np.ndarray, period: Period) -> Misses:
    """Return how many ticks alone took longer than a period."""
    return Misses(int((times_ns > period.ns).sum()), len(times_ns))


def percentiles(times_ns: np.ndarray) -> dict[str, float | None]:
    """Return p50, p99, p999 and max, ns; None for what so few ticks do not tell."""
    return {
        name: float(np.percentile(times_ns, share)) if is_supported(share, len(times_ns)) else None
        for name, share in SHARES.items()
    }


def misses_of(histogram: Histogram, period: Period) -> Misses:
    """Return how many durations of a histogram are longer than a period, to within the width of a bin."""
    over = sum(
        count for _, upper_ns, count in histogram.rows() if min(upper_ns, histogram.max_ns) > period.ns
    )
    return Misses(over, histogram.count)


def percentiles_of(histogram: Histogram) -> dict[str, float | None]:
    """Return what `percentiles` does, of a histogram: to within a 32nd, never less."""
    return {
        name: float(histogram.percentile(share)) if is_supported(share, histogram.count) else None
        for name, share in SHARES.items()
    }


def is_supported(share: float, tick_count: int) -> bool:
    """Return whether at least one tick is expected beyond a percentile; of the longest it is always
    reported.
    """
    return share >= 100.0 or round(tick_count * (100.0 - share), 6) >= 100.0


def check_tick_count(tick_count: int) -> None:
    """Refuse fewer ticks than the certificate needs."""
    if tick_count < FEWEST_TICKS:
        raise ServiceError(f"{tick_count} ticks are too few for p99.9, expected {FEWEST_TICKS} or more")
