"""Percentiles of tick times, their share of a period, and texts of periods.

A percentile is reported if at least one tick is beyond it.
"""

import math
import re

import numpy as np

from proximity.errors import ServiceError
from proximity.service import Histogram
from proximity.service.loop_memory import MAX_PERIOD, SHORTEST_PERIOD

UNKNOWN = "–"
SHARES = {"p50": 50.0, "p99": 99.0, "p999": 99.9, "max": 100.0}
MIN_TICKS = 1000  # required for p99.9
TAIL_POINTS = 120  # of a plot
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6}
RATES = {"hz": 1.0, "khz": 1e3}
WRITTEN = re.compile(r"\s*([0-9.eE+-]+)\s*([a-zA-Zµμ]+)\s*")

Times = np.ndarray | Histogram
"""Durations in nanoseconds, as an array or as a histogram."""


def count_of(times: Times) -> int:
    """Return the number of durations."""
    return times.count if isinstance(times, Histogram) else len(times)


def percentiles(times: Times) -> dict[str, float | None]:
    """Return p50, p99, p999 and max, ns, or None for percentiles of too few ticks.

    The values of a histogram are exact to within a 32nd, and never too low.
    """
    count, found = count_of(times), {}
    for name, share in SHARES.items():
        is_supported = share >= 100.0 or round(count * (100.0 - share), 6) >= 100.0
        counted = times.percentile(share) if isinstance(times, Histogram) else np.percentile(times, share)
        found[name] = float(counted) if is_supported else None
    return found


def tail(times: dict[str, float | None]) -> tuple[str, float]:
    """Return "p999" and its value, or "max" and its value for too few times."""
    value = times["p999"]
    return ("max", times["max"] or 0.0) if value is None else ("p999", value)


def over_count(times: Times, period: float) -> int:
    """Return the number of durations longer than a period, s.

    For a histogram it is exact to within the width of a bin.
    """
    if isinstance(times, Histogram):
        rows = times.rows()
        return sum(count for _, upper_ns, count in rows if min(upper_ns, times.max_ns) > 1e9 * period)
    return int((times > 1e9 * period).sum())


def curve(times: Times) -> list[list[int]]:
    """Return times, ns, and the number of longer ones at about a hundred points, for a plot."""
    if isinstance(times, Histogram):
        rows = list(times.rows())
        left = times.count - np.cumsum([0, *(count for _, _, count in rows)])
        return [[lower, int(count)] for (lower, _, _), count in zip(rows, left[:-1], strict=True)]
    ordered, count = np.sort(times), len(times)
    ranks = np.unique(np.round(count * (1.0 - np.geomspace(1.0, 1.0 / count, TAIL_POINTS))))
    return [[int(ordered[row]), count - row] for row in np.minimum(ranks.astype(int), count - 1).tolist()]


def parse_period(text: str) -> float:
    """Parse a period, s, from a number with s, ms, us, Hz or kHz, such as ``1ms``, ``200us`` or ``1kHz``."""
    found, seconds = WRITTEN.fullmatch(text), math.nan
    try:
        number = math.nan if found is None else float(found[1])
    except ValueError:
        number = math.nan
    unit = "" if found is None else found[2]
    if unit in UNITS:
        seconds = number * UNITS[unit]
    elif unit.lower() in RATES and number > 0.0:
        seconds = 1.0 / (number * RATES[unit.lower()])
    # Tolerance for the rounding of a period given as a rate.
    if not SHORTEST_PERIOD * (1.0 - 1e-9) <= seconds <= MAX_PERIOD * (1.0 + 1e-9):
        raise ServiceError(
            f"{text!r} is not a period, expected a time or a rate such as 1ms, 200us or 1kHz, "
            f"{SHORTEST_PERIOD * 1e6:g}us to {MAX_PERIOD:g}s"
        )
    return seconds


def shown_period(seconds: float) -> str:
    """Return a period as text with its unit."""
    return f"{1e3 * seconds:g} ms" if seconds < 1.0 else f"{seconds:g} s"


def microseconds(nanoseconds: float | None) -> str:
    """Return the text of a time in µs with three digits, or a dash if it is unknown."""
    if nanoseconds is None:
        return UNKNOWN
    value = nanoseconds / 1e3
    return f"{value:.0f}" if value >= 100.0 else f"{value:.1f}" if value >= 10.0 else f"{value:.2f}"


def percent(share: float | None) -> str:
    """Return the text of a share in percent with two digits, or a dash if it is unknown."""
    if share is None:
        return UNKNOWN
    value = 100.0 * share
    return f"{value:.0f}" if value >= 10.0 else f"{value:.1f}" if value >= 1.0 else f"{value:.1g}"
