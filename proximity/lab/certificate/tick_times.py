"""Times of single ticks, wall and thread apart, and the work that they report.

Nothing is subtracted of what the clocks themselves cost. Thread time is what the processor spent on this
thread: others on a shared machine do not count, but what they left in its caches does.
"""

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from proximity.message import ContactFlag
from proximity.system.memory import collector_paused
from proximity.tracker.tracker import Tracker

LOGGED_FINGERS = 50  # with more, what ticks say is looked at less often


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
    """Tick through positions, and velocities, (T, N, 3), as the service does, and time each call.

    *before* and *move* are called with the number of each tick before it; *move* is timed with it. *paths_at*
    gives the paths of fingers at positions, not timed; with *bends* (N,), and without *velocities*.
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


@contextmanager
def without_collector() -> Iterator[None]:
    """Have no garbage collected while something is timed, as in a control loop."""
    gc.collect()
    with collector_paused():
        yield
