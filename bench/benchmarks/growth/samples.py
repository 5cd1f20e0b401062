"""Samples of growth: timed calls, the points of curves, and sizes left out for lack of memory or time."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import psutil

from benchmarks.ticks.timing import (
    REPEATS,
    TickLog,
    best_of,
    has_all_fingers,
    tick_all,
    time_calls,
    without_collector,
)
from proximity import Scene, Tracker

PEAK_BYTES_PER_FACE = 900
"""While a part is made, its mesh included: 580 were measured on 3 M faces (2026-11-21)."""
MAX_BUILD_S = 300.0
MIN_FOR_P99 = 100
NS_PER_US, NS_PER_S = 1e3, 1e9
BUILD_ROUNDS, BUILD_S = 7, 3.0
TIME, WORK = "time", "nodes and leaves"


@dataclass(frozen=True, slots=True)
class GrowthRow:
    """One point of one curve."""

    axis: str  # quantity that grows: "faces", "parts", …
    series: str  # subject: "tick of five fingers", …
    quantity: str  # measured quantity: one panel of the plot
    unit: str
    x: float
    median: float
    p99: float | None  # None for too few samples
    count: int  # samples


@dataclass(slots=True)
class Curve:
    """Rows of one axis, and sentences on omitted sizes."""

    axis: str
    rows: list[GrowthRow] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def add(self, series: str, quantity: str, unit: str, x: float, values: np.ndarray) -> None:
        """Add the samples of one point."""
        count = int(np.size(values))
        p99 = float(np.percentile(values, 99.0)) if count >= MIN_FOR_P99 else None
        row = GrowthRow(self.axis, series, quantity, unit, float(x), float(np.median(values)), p99, count)
        self.rows.append(row)

    def add_time(self, series: str, x: float, nanoseconds: np.ndarray) -> None:
        """Add times of calls."""
        self.add(series, TIME, "µs", x, nanoseconds / NS_PER_US)

    def add_work(self, series: str, x: float, work: np.ndarray) -> None:
        """Add nodes and leaves of calls."""
        self.add(series, WORK, "a call", x, work)


def time_each(calls: list[Callable[[], object]]) -> np.ndarray:
    """Return the thread time of each call in the fastest of three rounds, ns."""
    logs = [TickLog() for _ in range(REPEATS)]
    with without_collector():
        calls[0]()
        for log in logs:
            time_calls(calls, log)
    return best_of(logs)


def time_ticks(
    scene: Scene, positions: np.ndarray, before: Callable[[int], object] | None = None, **settings: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the thread time (ns) of each tick in the fastest of three runs, and nodes and leaves of its
    fingers.

    (T, N, 3) *positions*; ticks in which a finger is missing do not count.
    """
    logs = []
    with without_collector():
        for _ in range(REPEATS):
            tracker, log = Tracker(scene, fingers=positions.shape[1], **settings), TickLog()
            if before is not None:
                before(0)
            tick_all(tracker, positions[:3], TickLog(), first=-3)
            tick_all(tracker, positions, log, before=before)
            logs.append(log)
    is_whole = has_all_fingers(logs[0])
    return best_of(logs)[is_whole], np.stack(logs[0].work).sum(axis=1)[is_whole]


def time_builds(make: Callable[[], Scene]) -> tuple[Scene, np.ndarray]:
    """Return the result of *make* and its durations, ns: once at least, for some seconds at most."""
    taken: list[int] = []
    while not taken or (len(taken) < BUILD_ROUNDS and sum(taken) < BUILD_S * NS_PER_S):
        scene = None  # frees the previous one, so that there is one at a time
        start = time.thread_time_ns()
        scene = make()
        taken.append(time.thread_time_ns() - start)
    assert scene is not None
    return scene, np.array(taken)


def sizes_that_fit(curve: Curve, sizes: tuple[int, ...]) -> Iterator[int]:
    """Yield numbers of faces that fit the free memory and take at most `MAX_BUILD_S` to build.

    The time of a size is estimated from the time that the previous one took.
    """
    taken, last = 0.0, 0
    for size in sizes:
        needed, free = size * PEAK_BYTES_PER_FACE, psutil.virtual_memory().available
        expected = taken * size / last if last else 0.0
        if needed > free:
            reason = f"making them takes about {needed / 1e9:.1f} GB, and {free / 1e9:.1f} GB are free"
        elif expected > MAX_BUILD_S:
            reason = f"they would take about {expected:.0f} s, more than {MAX_BUILD_S:g} s"
        else:
            start = time.monotonic()
            yield size
            taken, last = time.monotonic() - start, size
            continue
        curve.left_out.append(f"{size:,} faces are left out: {reason}.")
