"""Interleaved timing, A B C A B C: a busy machine slows all contenders alike."""

import gc
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from proximity.system.memory import collector_paused

ROUND_NS = 20_000_000  # duration of the repetitions of a short call in every round
MAX_CALL_COUNT = 200
SLOW_NS = 250_000_000  # a longer call takes part in every fifth round only
SLOW_ROUND = 5


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Times of one contender, in nanoseconds; nan in rounds without it."""

    rounds: np.ndarray  # (R,) median of the calls of each round
    calls: np.ndarray  # (C,) every single call

    @property
    def median(self) -> float:
        """Median over the rounds."""
        return float(np.nanmedian(self.rounds))

    def divided_by(self, divisor: float) -> "Samples":
        """Return the same in another unit, or for one query of a batch."""
        return Samples(self.rounds / divisor, self.calls / divisor)

    def relative_to(self, other: "Samples") -> float:
        """Median over common rounds of this time divided by the other's."""
        return float(np.nanmedian(self.rounds / other.rounds))


def interleave(runs: dict[str, Callable[[], Any]], round_count: int) -> dict[str, Samples]:
    """Time all *runs* in turn, *round_count* times; a first turn warms up and is not counted."""
    call_counts, is_slow = {}, {}
    for name, run in runs.items():
        run()
        first_ns = _time_ns(run)
        call_counts[name] = min(MAX_CALL_COUNT, max(1, ROUND_NS // max(1, first_ns)))
        is_slow[name] = first_ns > SLOW_NS
    rounds = {name: np.full(round_count, np.nan) for name in runs}
    calls: dict[str, list[int]] = {name: [] for name in runs}
    with collector_paused():
        for number in range(round_count):
            for name, run in runs.items():
                if is_slow[name] and number % SLOW_ROUND:
                    continue
                times = [_time_ns(run) for _ in range(call_counts[name])]
                rounds[name][number] = statistics.median(times)
                calls[name] += times
            gc.collect()
    return {name: Samples(rounds[name], np.array(calls[name])) for name in runs}


def _time_ns(run):
    start = time.perf_counter_ns()
    run()
    return time.perf_counter_ns() - start
