"""Times of single ticks, wall and thread apart, and the work that they report.

Nothing is subtracted: what the clocks themselves cost is measured and reported (`clock_cost`). Thread time is
what the processor spent on this thread: others on a shared machine do not count, but what they left in its
caches does.
"""

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from proximity.message import ContactFlag
from proximity.system.garbage_collector import collector_paused
from proximity.system.time_units import NS_PER_US
from proximity.tracker.tracker import Tracker

PERCENTILES = (50.0, 90.0, 99.0, 99.9, 100.0)
LOGGED_FINGERS = 50  # with more, what ticks say is looked at less often
CLOCK_CALLS = 20_000


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


@dataclass(slots=True, eq=False)
class TickLog:
    """Times and work of ticks."""

    thread_ns: list[int] = field(default_factory=list)
    wall_ns: list[int] = field(default_factory=list)
    work: list[np.ndarray] = field(default_factory=list)  # (N,) steps of each finger
    flags: list[np.ndarray] = field(default_factory=list)  # (N,)

    def share(self, flag: ContactFlag) -> float:
        """Return the share of the tracked fingers that have a flag."""
        flags = np.stack(self.flags)
        is_tracked = (flags & ContactFlag.TRACKED) != 0
        return float(((flags & flag) != 0)[is_tracked].mean()) if is_tracked.any() else 0.0

    def is_whole(self) -> np.ndarray:
        """Return which ticks had all their fingers, (T,)."""
        return np.asarray(((np.stack(self.flags) & ContactFlag.TRACKED) != 0).all(axis=1))

    def remark(self) -> str:
        """Return steps a tick, and what was known of the fingers, in words."""
        work = np.stack(self.work).sum(axis=1)
        p50, p99, most = np.percentile(work, (50, 99, 100))
        kinds = (ContactFlag.IN_RANGE, ContactFlag.INSIDE, ContactFlag.SKIPPED, ContactFlag.BOUNDED)
        shares = ", ".join(
            f"{self.share(kind):.1%} {(kind.name or '').lower().replace('_', ' ')}" for kind in kinds
        )
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
    paths_at: Callable[[np.ndarray], np.ndarray] | None = None,
    bends: np.ndarray | None = None,
    move: Callable[[int], object] | None = None,
) -> None:
    """Tick through a motion as the service does, and time each call.

    *positions*: (T, N, 3) m; *velocities*: (T, N, 3) m/s. *before*: of the number of a tick; called before
    it, and not timed. *paths_at*: gives the paths of fingers at positions, not timed; with *bends* (N,), and
    without *velocities*. *move*: of the number of a tick; called before it, and timed with it.
    """
    contacts, thread, wall = tracker.contacts, time.thread_time_ns, time.perf_counter_ns
    work, flags = contacts["work"], contacts["flags"]
    instants, given = np.zeros(len(contacts), np.int64), _arrays_of_ticks(positions, velocities, paths_at)
    every = max(1, len(contacts) // LOGGED_FINGERS)
    for k in range(len(positions)):
        if before is not None:
            before(first + k)
        points, pose_ns = np.ascontiguousarray(positions[k]), start_ns + (first + k) * period_ns
        instants.fill(pose_ns)
        if velocities is not None:
            given["velocities"][...] = velocities[k]
        if paths_at is not None:
            given["paths"][...] = paths_at(points)
        thread_start = thread()
        start = wall()
        if move is not None:
            move(first + k)
        tracker.advance(points, instants, pose_ns + latency_ns, bends=bends, **given)
        end = wall()
        thread_end = thread()
        log.thread_ns.append(thread_end - thread_start)
        log.wall_ns.append(end - start)
        if (first + k) % every == 0:
            log.work.append(work.copy())
            log.flags.append(flags.copy())


def _arrays_of_ticks(
    positions: np.ndarray,
    velocities: np.ndarray | None,
    paths_at: Callable[[np.ndarray], np.ndarray] | None,
) -> dict[str, np.ndarray]:
    """Arrays that a service has beside positions, the same ones at each tick."""
    given = {}
    if velocities is not None:
        given["velocities"] = np.empty(positions.shape[1:])
    if paths_at is not None and len(positions):
        given["paths"] = np.array(paths_at(positions[0]))
    return given


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
    """Return what an empty call seems to take, µs: thread and wall."""
    log = TickLog()
    time_calls([lambda: None] * CLOCK_CALLS, log)
    return figures_of(np.array(log.thread_ns)), figures_of(np.array(log.wall_ns))


@contextmanager
def without_collector() -> Iterator[None]:
    """Have no garbage collected while something is timed, as in a control loop."""
    gc.collect()
    with collector_paused():
        yield
