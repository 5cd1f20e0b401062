"""Rows of the table of ticks; ticks are timed by ``proximity.lab.certificate.measurement``."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import repeat

import numpy as np

from benchmarks.support.verdicts import Verdict
from benchmarks.ticks.scenes import face_count
from proximity.lab.certificate.measurement import TickLog, tick_all, without_collector
from proximity.message import ContactFlag
from proximity.system.time_units import NS_PER_US

__all__ = [
    "REPEATS",
    "Figures",
    "TickLog",
    "TickRow",
    "best_of",
    "clock_cost",
    "figures_of",
    "has_all_fingers",
    "remark_on",
    "row_of",
    "tick_all",
    "time_calls",
    "without_collector",
]

REPEATS = 3  # runs; the shortest time of each tick counts
PERCENTILES = (50.0, 90.0, 99.0, 99.9, 100.0)
CLOCK_CALLS = 20_000
TRIAL_COUNT = 100_000  # steps of the bare loop, to find the number in a tick


@dataclass(frozen=True, slots=True)
class Figures:
    """Percentiles of times."""

    p50: float
    p90: float
    p99: float
    p999: float
    maximum: float


def figures_of(nanoseconds: np.ndarray) -> Figures:
    """Return percentiles in microseconds."""
    return Figures(*(np.percentile(nanoseconds, PERCENTILES) / NS_PER_US).tolist())


@dataclass(frozen=True, slots=True)
class TickRow:
    """A row of the table: a case, its times, and the requirements on it."""

    case: str
    part_count: int
    face_count: int
    finger_count: int
    tick_count: int
    thread: Figures | None = None  # µs
    wall: Figures | None = None  # µs
    best: Figures | None = None  # µs, thread time, the shortest of several runs for each tick
    bare: Figures | None = None  # µs, thread time of a counting loop, with the duration of the median tick
    verdicts: tuple[Verdict, ...] = ()
    remarks: tuple[str, ...] = ()  # sentences below the table


def has_all_fingers(log: TickLog) -> np.ndarray:
    """Return which ticks had all their fingers, (T,)."""
    return np.asarray(((np.stack(log.flags) & ContactFlag.TRACKED) != 0).all(axis=1))


def remark_on(log: TickLog) -> str:
    """Return steps a tick, and flags of the fingers, as text."""
    work = np.stack(log.work).sum(axis=1)
    p50, p99, most = np.percentile(work, (50, 99, 100))
    kinds = (ContactFlag.IN_RANGE, ContactFlag.INSIDE, ContactFlag.SKIPPED, ContactFlag.BOUNDED)
    shares = ", ".join(
        f"{log.share(kind):.1%} {(kind.name or '').lower().replace('_', ' ')}" for kind in kinds
    )
    return f"steps a tick: p50 {p50:.0f}, p99 {p99:.0f}, most {most:.0f}; fingers: {shares}"


def time_calls(calls: list[Callable[[], object]], log: TickLog) -> None:
    """Time each of some calls once."""
    thread, wall = time.thread_time_ns, time.perf_counter_ns
    for call in calls:
        thread_start = thread()
        start = wall()
        call()
        end = wall()
        thread_end = thread()
        log.thread_ns.append(thread_end - thread_start)
        log.wall_ns.append(end - start)


def clock_cost() -> tuple[Figures, Figures]:
    """Return the apparent duration of an empty call, µs: thread and wall."""
    log = TickLog()
    time_calls([lambda: None] * CLOCK_CALLS, log)
    return figures_of(np.array(log.thread_ns)), figures_of(np.array(log.wall_ns))


def best_of(logs: list[TickLog]) -> np.ndarray:
    """Return the shortest thread time of each tick over equal runs: its cost without interruptions."""
    return np.min([log.thread_ns for log in logs], axis=0)


def _count(steps):
    """Count in compiled code."""
    deque(repeat(None, steps), maxlen=0)


def bare_loop(median_ns: float, count: int) -> np.ndarray:
    """Return thread times, ns, of *count* counting loops of about *median_ns* each.

    They touch no memory: their tail is the machine's.
    """
    trials = TickLog()
    time_calls([partial(_count, TRIAL_COUNT)] * 50, trials)
    empty = TickLog()
    time_calls([partial(_count, 0)] * 50, empty)
    cost, least = (float(np.median(log.thread_ns)) for log in (trials, empty))
    steps = round(max(median_ns - least, 0.0) * TRIAL_COUNT / (cost - least))
    log = TickLog()
    with without_collector():
        time_calls([partial(_count, steps)] * count, log)
    return np.array(log.thread_ns)


def row_of(case, scene, finger_count, log, *, best=None, verdicts=(), remarks=(), chosen=None) -> TickRow:
    """Return a line of the table; *best* from `best_of` (with it comes a bare loop); *chosen*: only those."""
    thread, wall = np.array(log.thread_ns), np.array(log.wall_ns)
    if chosen is not None:
        thread, wall = thread[chosen], wall[chosen]
        best = None if best is None else best[chosen]
    return TickRow(
        case,
        len(scene.parts),
        face_count(scene),
        finger_count,
        len(thread),
        figures_of(thread),
        figures_of(wall),
        None if best is None else figures_of(best),
        None if best is None else figures_of(bare_loop(float(np.median(best)), len(thread))),
        tuple(verdicts),
        tuple(remarks),
    )
