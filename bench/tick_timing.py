"""Times of single ticks, wall and thread apart, and what the ticks said of their work.

Nothing is subtracted: what the clocks themselves cost is measured and told (`clock_cost`). Thread time is
what the processor spent on this thread: others on a shared machine do not count, but what they left in its
caches does.
"""

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from results import Verdict

from proximity import Tracker
from proximity.message import ContactFlag

PERCENTILES = (50.0, 90.0, 99.0, 99.9, 100.0)
NS_PER_US = 1e3
REPEATS = 3  # of what is timed to find out what the work alone takes
LOGGED_FINGERS = 50  # with more, what ticks say is looked at less often


@dataclass(frozen=True, slots=True)
class Figures:
    """Percentiles of times."""

    p50: float
    p90: float
    p99: float
    p999: float
    maximum: float


def figures_of(nanoseconds: np.ndarray) -> Figures:
    """Percentiles in microseconds."""
    return Figures(*(np.percentile(nanoseconds, PERCENTILES) / NS_PER_US).tolist())


@dataclass(frozen=True, slots=True)
class TickRow:
    """A line of the table: a case, and what was asked of it."""

    case: str
    part_count: int
    face_count: int
    finger_count: int
    tick_count: int
    thread: Figures | None = None  # µs
    wall: Figures | None = None  # µs
    best: Figures | None = None  # µs, thread time, of each tick the shortest of several runs
    verdicts: tuple[Verdict, ...] = ()
    remarks: tuple[str, ...] = ()  # sentences below the table


@dataclass(slots=True, eq=False)
class TickLog:
    """What ticks took and said."""

    thread_ns: list[int] = field(default_factory=list)
    wall_ns: list[int] = field(default_factory=list)
    work: list[np.ndarray] = field(default_factory=list)  # (N,) steps of each finger
    flags: list[np.ndarray] = field(default_factory=list)  # (N,)

    def share(self, flag: ContactFlag) -> float:
        """Share of the tracked fingers that have a flag."""
        flags = np.stack(self.flags)
        is_tracked = (flags & ContactFlag.TRACKED) != 0
        return float(((flags & flag) != 0)[is_tracked].mean()) if is_tracked.any() else 0.0

    def is_whole(self) -> np.ndarray:
        """Which ticks had all their fingers, (T,)."""
        return ((np.stack(self.flags) & ContactFlag.TRACKED) != 0).all(axis=1)

    def remark(self) -> str:
        """Steps a tick, and what was known of the fingers."""
        work = np.stack(self.work).sum(axis=1)
        p50, p99, most = np.percentile(work, (50, 99, 100))
        kinds = (ContactFlag.IN_RANGE, ContactFlag.INSIDE, ContactFlag.SKIPPED, ContactFlag.BOUNDED)
        shares = ", ".join(f"{self.share(kind):.1%} {kind.name.lower().replace('_', ' ')}" for kind in kinds)
        return f"steps a tick: p50 {p50:.0f}, p99 {p99:.0f}, most {most:.0f}; fingers: {shares}"


def tick_all(
    tracker: Tracker,
    positions: np.ndarray,
    log: TickLog,
    *,
    start_ns: int = 0,
    first: int = 0,
    latency_ns: int = 1_000_000,
    period_ns: int = 1_000_000,
    velocities: np.ndarray | None = None,
    before: Callable[[int], object] | None = None,
) -> None:
    """Tick through (T, N, 3) *positions*; each call is timed into *log*, *before* is not timed.

    *first* is the number of the first of them, *start_ns* the instant of number 0.
    """
    tick, contacts = tracker.tick, tracker.contacts
    work, flags = contacts["work"], contacts["flags"]
    thread, wall = time.thread_time_ns, time.perf_counter_ns
    every = max(1, len(contacts) // LOGGED_FINGERS)
    for k in range(len(positions)):
        if before is not None:
            before(first + k)
        points, pose_ns = positions[k], start_ns + (first + k) * period_ns
        if velocities is None:
            thread_start = thread()
            start = wall()
            tick(points, pose_ns, pose_ns + latency_ns)
            end = wall()
            thread_end = thread()
        else:
            own = velocities[k]
            thread_start = thread()
            start = wall()
            tick(points, pose_ns, pose_ns + latency_ns, velocities=own)
            end = wall()
            thread_end = thread()
        log.thread_ns.append(thread_end - thread_start)
        log.wall_ns.append(end - start)
        if (first + k) % every == 0:
            log.work.append(work.copy())
            log.flags.append(flags.copy())


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
    """What an empty call seems to take, µs: thread and wall."""
    log = TickLog()
    time_calls([lambda: None] * 20_000, log)
    return figures_of(np.array(log.thread_ns)), figures_of(np.array(log.wall_ns))


@contextmanager
def without_collector() -> Iterator[None]:
    """No collection of garbage while something is timed, as in a control loop."""
    was_enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def best_of(logs: list[TickLog]) -> np.ndarray:
    """Shortest thread time of each tick over runs that are the same: what its work takes when undisturbed."""
    return np.min([log.thread_ns for log in logs], axis=0)


def row_of(case, scene, finger_count, log, *, best=None, verdicts=(), remarks=(), chosen=None) -> TickRow:
    """A line of the table; *best* as `best_of` gives it; *chosen*: only those ticks."""
    thread, wall = np.array(log.thread_ns), np.array(log.wall_ns)
    if chosen is not None:
        thread, wall = thread[chosen], wall[chosen]
        best = None if best is None else best[chosen]
    return TickRow(
        case,
        len(scene.parts),
        sum(part.solid.mesh.face_count for part in scene.parts),
        finger_count,
        len(thread),
        figures_of(thread),
        figures_of(wall),
        None if best is None else figures_of(best),
        tuple(verdicts),
        tuple(remarks),
    )


def at_most(what: str, limit: float, measured: float, unit: str = "µs") -> Verdict:
    """A requirement that a figure is no larger than that."""
    return Verdict(f"{what} at most {limit:g} {unit}", f"{measured:.4g} {unit}", bool(measured <= limit))


def at_least(what: str, limit: float, measured: float, spread: str = "") -> Verdict:
    """A requirement that something is so many times as fast."""
    return Verdict(
        f"{what}: at least {limit:g} times as fast", f"{measured:.2f}{spread}", bool(measured >= limit)
    )
