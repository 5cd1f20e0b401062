"""A period as text (1ms, 200us, 1kHz), and in seconds.

A scene fits a period if the computing of 99.9 % of the ticks in every motion takes no longer: the processor's
time for the thread, of each tick the shortest of three runs that are the same. So does a half of the ticks of
the service's own loop at that period, where caches are colder, and a frame is made. All else is not the
scene's but the machine's, and is reported beside it: interruptions, and how late it wakes the loop. A gate
that failed because of them would fail good scenes on a noisy machine.
"""

import math
import re

from proximity.errors import ServiceError
from proximity.service.loop import LONGEST_PERIOD, SHORTEST_PERIOD

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6}
RATES = {"hz": 1.0, "khz": 1e3}
WRITTEN = re.compile(r"\s*([0-9.eE+-]+)\s*([a-zA-Zµμ]+)\s*")


def parse_period(text: str) -> float:
    """Return a period, s.

    *text*: a number with s, ms, us, Hz or kHz: ``1ms``, ``200us``, ``1kHz``.
    """
    limits = f"{SHORTEST_PERIOD * 1e6:g}us to {LONGEST_PERIOD:g}s"
    expected = f"expected a time or a rate such as 1ms, 200us or 1kHz, {limits}"
    found = WRITTEN.fullmatch(text)
    try:
        number = math.nan if found is None else float(found[1])
    except ValueError:
        number = math.nan
    unit = "" if found is None else found[2]
    if unit in UNITS:
        seconds = number * UNITS[unit]
    elif unit.lower() in RATES and number > 0.0:
        seconds = 1.0 / (number * RATES[unit.lower()])
    else:
        seconds = math.nan
    # Room for what a period loses on its way through a rate.
    if not SHORTEST_PERIOD * (1.0 - 1e-9) <= seconds <= LONGEST_PERIOD * (1.0 + 1e-9):
        raise ServiceError(f"{text!r} is not a period, {expected}")
    return seconds


def shown_period(seconds: float) -> str:
    """Return a period as people write it."""
    return f"{1e3 * seconds:g} ms" if seconds < 1.0 else f"{seconds:g} s"
