"""Tick times in motions from a recorded hand to the worst positions, and in the service's loop.

Each tick is timed separately, by the processor time of the thread and by wall-clock time. Wall-clock time
includes other processes. On a virtual machine processor time includes some of that as well. The cost of the
clocks is not subtracted.
"""

import gc
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from proximity.errors import RecordingError
from proximity.lab.certificate import motions
from proximity.lab.certificate.subject import Subject
from proximity.lab.certificate.work import UNLIMITED, SearchGoal, StartMode
from proximity.lab.certificate.worst_positions import Progress, SearchResult
from proximity.message import ContactFlag
from proximity.recording import Recording
from proximity.service import RealTime, RecordingInput, Report, Service, TrackedContacts
from proximity.system.memory import collector_paused
from proximity.tracker.tracker import Tracker
from proximity.transport import open_publisher

TICKS_PER_UPDATE = 500  # ticks between two progress reports
REHEARSAL = 20  # ticks that are not counted
REPEATS = 3
"""Number of runs of a motion.

Every tick is the same in each run, and its shortest time is its cost without interruptions. The reported
times are those of the first run.
"""
EXACT_STEPS = 30_000_000
"""Maximum number of nodes and leaves visited by all ticks without a budget, which takes some seconds.

Costly scenes therefore have fewer ticks.
"""
MIN_EXACT = 20
PASSING, COLD_START, EXACT = "worst, passing", "worst, cold start", "worst, exact"
ADDRESS = "mailbox:proximity-certificate"
"""Address of the loop's frames, which stay in this process, with a checksum as for other processes."""

Results = Mapping[SearchGoal, SearchResult]
LOGGED_FINGERS = 50  # with more, the contents of ticks are logged less often


@dataclass(slots=True, eq=False)
class TickLog:
    """Times and work of ticks."""

    thread_ns: list[int] = field(default_factory=list)
    wall_ns: list[int] = field(default_factory=list)
    work: list[np.ndarray] = field(default_factory=list)  # (N,) steps of each finger
    flags: list[np.ndarray] = field(default_factory=list)  # (N,)

    def share(self, flag: ContactFlag) -> float:
        """Return the share of the tracked fingers whose contact has a flag."""
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
) -> None:
    """Tick a tracker through positions, (T, N, 3), as the service does, and time each call.

    *velocities*: of the fingers, (T, N, 3). *before*: called before each tick with its number.
    """
    contacts, thread, wall = tracker.contacts, time.thread_time_ns, time.perf_counter_ns
    work, flags = contacts["work"], contacts["flags"]
    instants, given = np.zeros(len(contacts), np.int64), dict[str, np.ndarray]()
    if velocities is not None:
        given["velocities"] = np.empty(positions.shape[1:])
    every = max(1, len(contacts) // LOGGED_FINGERS)
    for k in range(len(positions)):
        if before is not None:
            before(first + k)
        points, pose_ns = np.ascontiguousarray(positions[k]), start_ns + (first + k) * period_ns
        instants.fill(pose_ns)
        if velocities is not None:
            given["velocities"][...] = velocities[k]
        thread_start = thread()
        start = wall()
        tracker.advance(points, instants, pose_ns + latency_ns, **given)
        end = wall()
        thread_end = thread()
        log.thread_ns.append(thread_end - thread_start)
        log.wall_ns.append(end - start)
        if (first + k) % every == 0:
            log.work.append(work.copy())
            log.flags.append(flags.copy())


@contextmanager
def without_collector() -> Iterator[None]:
    """Disable the garbage collector during a measurement, as in a control loop."""
    gc.collect()
    with collector_paused():
        yield


@dataclass(frozen=True, slots=True, eq=False)
class MotionTiming:
    """A motion and its tick times."""

    name: str
    fingers: int
    thread_ns: np.ndarray  # (T,) int64, of the processor for this thread
    wall_ns: np.ndarray  # (T,) int64, from call to answer
    best_ns: np.ndarray  # (T,) int64, as `thread_ns`: the shortest of several runs for each tick
    max_work: int  # nodes and leaves of all fingers in the costliest tick
    shares: dict[str, float]  # of all ticks of all fingers that are exact, bounded or skipped
    counts: bool = True  # False if only for comparison, as a service never does so


def measure(
    subject: Subject,
    found: Results,
    tick_count: int,
    seed: int,
    progress: Progress = lambda _, __: None,
) -> tuple[MotionTiming, ...]:
    """Return tick times in each motion."""
    rows = motion_rows(subject, found, tick_count, seed)
    total, done, timings = sum(map(len, rows.values())), 0, []
    for name, positions in rows.items():

        def show(ticks: int, name: str = name, done: int = done) -> None:
            progress(f"timing: {name}", (done + ticks) / total)

        timings.append(_timing(subject, name, positions, show))
        done += len(positions)
    return tuple(timings)


def motion_rows(subject: Subject, found: Results, tick_count: int, seed: int) -> dict[str, np.ndarray]:
    """Return the positions of the fingers in each motion, (T, N, 3), m."""
    fingers, rows = subject.fingers, {}
    if subject.recording is not None:
        if not subject.recording.is_present.any():
            raise RecordingError(
                f"{subject.recording.path}: no finger is tracked at any tick, expected at least one"
            )
        rows["recording"] = motions.repeated(subject.recording.positions, tick_count)
    hands = -(-fingers // motions.FINGERS_PER_HAND)
    wandering = motions.wandering_hands(
        subject.scene, tick_count, hands, seed=seed, rate=1.0 / subject.period
    )
    rows["random"] = np.ascontiguousarray(wandering[:, :fingers])
    stays, cold, exact = (
        SearchGoal(mode, has_budget)
        for mode, has_budget in ((StartMode.STAYS, True), (StartMode.COLD, True), (StartMode.COLD, False))
    )
    rows["worst, at rest"] = motions.resting(_positions(found, stays), fingers, tick_count)
    rows[PASSING] = worst_passing(subject, found, tick_count, seed)
    rows[COLD_START] = motions.resting(_positions(found, cold), fingers, tick_count)
    costliest = max(1, fingers * found[exact].positions[0].work)
    exact_count = int(np.clip(EXACT_STEPS // costliest, MIN_EXACT, tick_count))
    rows[EXACT] = motions.resting(_positions(found, exact), fingers, exact_count)
    return rows


def worst_passing(subject: Subject, found: Results, tick_count: int, seed: int) -> np.ndarray:
    """Return positions of fingers that pass through the worst positions of moving fingers, (T, N, 3), m."""
    positions = _positions(found, SearchGoal(StartMode.MOVES, True))
    rng = np.random.default_rng([seed, 100])
    return motions.passing(positions, subject.fingers, tick_count, rng, rate=1.0 / subject.period)


def _positions(found: Results, goal: SearchGoal) -> np.ndarray:
    return np.array([worst.position for worst in found[goal].positions])


def _timing(
    subject: Subject, name: str, positions: np.ndarray, progress: Callable[[int], None]
) -> MotionTiming:
    is_exact, fingers = name == EXACT, positions.shape[1]
    repeats, settings = (1, {"budget": UNLIMITED}) if is_exact else (REPEATS, {})
    given: dict[str, Any] = {"period_ns": round(1e9 * subject.period)}
    logs = []
    for repeat in range(repeats):
        tracker, begun = subject.tracker(fingers=fingers, **settings), repeat * len(positions)
        if name in (EXACT, COLD_START):
            given["before"] = lambda _, tracker=tracker: tracker.reset()

        def show(done: int, begun: int = begun) -> None:
            progress((begun + done) // repeats)

        logs.append(_run(partial(tick_all, tracker, **given), positions, show))
    # A tick without a finger costs nothing, and would distort the others' percentiles.
    counted = ~np.isnan(positions).any(axis=2).all(axis=1)
    kinds = (ContactFlag.EXACT, ContactFlag.BOUNDED, ContactFlag.SKIPPED)
    return MotionTiming(
        name,
        fingers,
        np.array(logs[0].thread_ns)[counted],
        np.array(logs[0].wall_ns)[counted],
        np.min([log.thread_ns for log in logs], axis=0)[counted],
        int(max(each.sum() for each in logs[0].work)),
        {str(kind.name).lower(): logs[0].share(kind) for kind in kinds},
        counts=not is_exact,
    )


def _run(
    tick_through: Callable[..., None], positions: np.ndarray, progress: Callable[[int], None]
) -> TickLog:
    """Time all ticks of a motion, after a few ticks that are not counted."""
    log, rehearsal = TickLog(), positions[: min(REHEARSAL, len(positions) // 10)]
    progress(0)
    with without_collector():
        tick_through(rehearsal, TickLog(), first=-REHEARSAL)
        for first in range(0, len(positions), TICKS_PER_UPDATE):
            chunk = positions[first : first + TICKS_PER_UPDATE]
            tick_through(chunk, log, first=first)
            progress(first + len(chunk))
    return log


def run_loop(subject: Subject, found: Results, seconds: float, seed: int) -> Report:
    """Return the report of the service's loop for fingers that pass through the worst positions."""
    ticks, period_ns = max(1, round(seconds / subject.period)), round(1e9 * subject.period)
    positions = worst_passing(subject, found, ticks + 1, seed)
    times_ns = np.arange(len(positions), dtype=np.int64) * period_ns
    fingers = tuple(divmod(k, motions.FINGERS_PER_HAND) for k in range(subject.fingers))
    hand = RecordingInput(Recording(times_ns, positions, fingers, "worst positions"), repeat=True)
    service = Service(
        TrackedContacts(subject.tracker(), None),
        hand,
        [open_publisher(ADDRESS)],
        period=subject.period,
        counts_processor=True,
        real_time=RealTime(core=subject.core) if subject.real_time else None,
    )
    return service.run(tick_count=ticks)
