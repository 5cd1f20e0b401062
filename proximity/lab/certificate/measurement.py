"""Measurement of tick times in motions from a recorded hand to the worst positions.

Each tick is timed on its own: by the processor's time of the thread, and by the clock on the wall, which
others on the machine share in. Where processors are lent by a host, the first has some of that as well.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from proximity.errors import RecordingError
from proximity.lab.certificate.search.work import UNLIMITED, Goal, Manner
from proximity.lab.certificate.search.worst_positions import Found
from proximity.lab.certificate.service_inputs import Paths, SwayingParts, fed_service_input, with_own_scene
from proximity.lab.certificate.subject import Subject
from proximity.lab.certificate.tick_times import TickLog, tick_all, without_collector
from proximity.message import ContactFlag
from proximity.recording import Recording
from proximity.service import MonotonicClock, RealTime, RecordingInput, Report, Service
from proximity.tracker.replay import motions
from proximity.tracker.tracker import Tracker
from proximity.transport import open_publisher

TICKS_PER_UPDATE = 500  # ticks between two looks of who waits
REHEARSAL = 20  # ticks that are not counted
REPEATS = 3
"""Runs of a motion: every tick is the same in each, and its shortest time is what its work takes when nobody
interrupts. The times that are reported are those of the first."""
EXACT_STEPS = 30_000_000
"""Nodes and leaves that ticks without a budget may visit: some seconds, and fewer ticks of dear scenes."""
FEWEST_EXACT = 20
ON_PATHS, MOVING = "worst, on paths", "worst, parts moving"
ADDRESS = "mailbox:proximity-certificate"
"""Where the loop publishes: inside this process, sealed as for others."""


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A motion, and what its ticks took."""

    name: str
    fingers: int
    thread_ns: np.ndarray  # (T,) int64, of the processor for this thread
    wall_ns: np.ndarray  # (T,) int64, from call to answer
    best_ns: np.ndarray  # (T,) int64, as `thread_ns`, of each tick the shortest of several runs
    most_work: int  # nodes and leaves of the dearest tick, all fingers
    shares: dict[str, float]  # of finger-ticks: exact, bounded, skipped
    counts: bool = True  # False: to compare with; a service never does so


def measure(
    subject: Subject,
    found: tuple[Found, ...],
    tick_count: int,
    seed: int,
    progress: Callable[[str, float], None] = lambda _, __: None,
) -> tuple[Case, ...]:
    """Return what ticks take in each motion.

    *progress*: called with what is done, and which share of all is.
    """
    rng, rate, fingers = np.random.default_rng([seed, 100]), 1.0 / subject.period, subject.fingers
    worst = {each.goal: np.array([worst.position for worst in each.positions]) for each in found}
    cold, stays = (worst[Goal(manner, True)] for manner in (Manner.COLD, Manner.STAYS))
    hands = -(-fingers // motions.FINGERS_PER_HAND)
    wandering = motions.wandering_hands(subject.scene, tick_count, hands, seed=seed, rate=rate)
    motion_rows: dict[str, np.ndarray] = {"random": np.ascontiguousarray(wandering[:, :fingers])}
    if subject.recording is not None:
        if not subject.recording.is_present.any():
            raise RecordingError(
                f"{subject.recording.path}: no finger is tracked at any tick, expected at least one"
            )
        motion_rows = {
            "recording": motions.repeated(subject.recording.positions, tick_count),
            **motion_rows,
        }
    motion_rows["worst, at rest"] = motions.resting(stays, fingers, tick_count)
    motion_rows["worst, passing"] = worst_passing(subject, found, tick_count, rng)
    if subject.corners is not None:
        motion_rows[ON_PATHS] = motion_rows["worst, passing"]
    if subject.moves:
        motion_rows[MOVING] = motion_rows["worst, passing"]
    motion_rows["worst, anew"] = motions.resting(cold, fingers, tick_count)
    exact = worst[Goal(Manner.COLD, False)]
    costliest = next(each for each in found if each.goal == Goal(Manner.COLD, False)).worst.work
    exact_count = int(np.clip(EXACT_STEPS // max(1, fingers * costliest), FEWEST_EXACT, tick_count))
    motion_rows["worst, exact"] = motions.resting(exact, fingers, exact_count)
    total, done, cases = sum(map(len, motion_rows.values())), 0, []
    for name, positions in motion_rows.items():
        ticked = with_own_scene(subject) if name == MOVING else subject
        cases.append(_case(ticked, name, positions, partial(_progress_of, progress, name, done, total), seed))
        done += len(positions)
    return tuple(cases)


def worst_passing(
    subject: Subject, found: tuple[Found, ...], tick_count: int, rng: np.random.Generator
) -> np.ndarray:
    """Return fingers that pass through the worst positions of moving fingers, (T, N, 3).

    *subject*: how many fingers there are, and how often they are ticked.
    """
    (moves,) = (each for each in found if each.goal == Goal(Manner.MOVES, True))
    positions = np.array([worst.position for worst in moves.positions])
    return motions.passing(positions, subject.fingers, tick_count, rng, rate=1.0 / subject.period)


def _progress_of(
    progress: Callable[[str, float], None], name: str, before: int, total: int, done: int
) -> None:
    progress(f"timing: {name}", (before + done) / total)


def _case(
    subject: Subject, name: str, positions: np.ndarray, progress: Callable[[int], None], seed: int
) -> Case:
    is_exact, forgets = name == "worst, exact", name in ("worst, exact", "worst, anew")
    settings = {"budget": UNLIMITED} if is_exact else {}
    repeats = 1 if is_exact else REPEATS
    paths, parts = _reported(subject, name, positions.shape[1], seed)
    logs = []
    for repeat in range(repeats):
        tracker = subject.tracker(fingers=positions.shape[1], **settings)
        before = partial(_forget, tracker) if forgets else None
        begun = repeat * len(positions)
        reported = partial(_report_share, progress, begun, repeats)
        logs.append(_run(subject, tracker, positions, before, reported, paths, parts))
    # A tick without a finger costs nothing, and would make the others look better.
    counted = ~np.isnan(positions).any(axis=2).all(axis=1)
    kinds = (ContactFlag.EXACT, ContactFlag.BOUNDED, ContactFlag.SKIPPED)
    return Case(
        name,
        positions.shape[1],
        np.array(logs[0].thread_ns)[counted],
        np.array(logs[0].wall_ns)[counted],
        np.min([log.thread_ns for log in logs], axis=0)[counted],
        int(max(each.sum() for each in logs[0].work)),
        {str(kind.name).lower(): logs[0].share(kind) for kind in kinds},
        counts=not is_exact,
    )


def _reported(
    subject: Subject, name: str, fingers: int, seed: int
) -> tuple[Paths | None, SwayingParts | None]:
    """Inputs of a motion's ticks besides poses: paths wherever they may come, if parts move as well."""
    paths = parts = None
    if subject.corners is not None and name in (ON_PATHS, MOVING):
        paths = Paths(subject.corners, fingers, np.random.default_rng([seed, 101]))
    if name == MOVING:
        parts = SwayingParts(subject.scene, round(1e9 * subject.period))
    return paths, parts


def _run(
    subject: Subject,
    tracker: Tracker,
    positions: np.ndarray,
    before: Callable[[int], object] | None,
    progress: Callable[[int], None],
    paths: Paths | None,
    parts: SwayingParts | None,
) -> TickLog:
    """All ticks of a motion once, and before them a few that are not counted."""
    log, period_ns = TickLog(), round(1e9 * subject.period)
    reported: dict[str, Any] = {"period_ns": period_ns, "before": before}
    if paths is not None:
        reported |= {"paths_at": paths.at, "bends": paths.bends}
    if parts is not None:
        reported |= {"before": parts.report_due, "move": parts.move}
    rehearsal = positions[: min(REHEARSAL, len(positions) // 10)]
    progress(0)
    with without_collector():
        tick_all(tracker, rehearsal, TickLog(), first=-REHEARSAL, **reported)
        for first in range(0, len(positions), TICKS_PER_UPDATE):
            chunk = positions[first : first + TICKS_PER_UPDATE]
            tick_all(tracker, chunk, log, first=first, **reported)
            progress(first + len(chunk))
    return log


def _report_share(progress: Callable[[int], None], before: int, repeats: int, done: int) -> None:
    progress((before + done) // repeats)


def _forget(tracker: Tracker, _: int) -> None:
    tracker.reset()


class ProcessorClock(MonotonicClock):
    """A clock whose stopwatch runs only while the processor works for this thread."""

    def __init__(self) -> None:
        super().__init__()
        self.stopwatch_ns = time.thread_time_ns


def run_loop(subject: Subject, found: tuple[Found, ...], seconds: float, seed: int) -> Report:
    """Return what the service's own loop did with fingers that pass through the worst positions.

    Where the subject may be given paths, or moves of parts, it is.

    *subject*: what is served, how often, and whether the system is asked for priority.
    """
    ticks, period_ns = max(1, round(seconds / subject.period)), round(1e9 * subject.period)
    positions = worst_passing(subject, found, ticks + 1, np.random.default_rng([seed, 100]))
    times_ns = np.arange(len(positions), dtype=np.int64) * period_ns
    hand = Recording(times_ns, positions, _fingers(subject.fingers), "worst positions")
    answers, pose_input = fed_service_input(
        with_own_scene(subject), RecordingInput(hand, repeat=True), np.random.default_rng([seed, 101])
    )
    service = Service(
        answers,
        pose_input,
        [open_publisher(ADDRESS)],
        period=subject.period,
        clock=ProcessorClock(),
        real_time=RealTime(core=subject.core) if subject.real_time else None,
    )
    return service.run(tick_count=ticks)


def _fingers(count: int) -> tuple[tuple[int, int], ...]:
    return tuple(divmod(k, motions.FINGERS_PER_HAND) for k in range(count))
