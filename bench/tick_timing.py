"""Lines of the table of ticks; how they are timed is the package's: ``proximity.certificate.ticking``."""

from dataclasses import dataclass

import numpy as np
from results import Verdict

from proximity.certificate.ticking import (
    Figures,
    TickLog,
    clock_cost,
    figures_of,
    tick_all,
    time_calls,
    without_collector,
)

__all__ = [
    "REPEATS",
    "Figures",
    "TickLog",
    "TickRow",
    "at_least",
    "at_most",
    "best_of",
    "clock_cost",
    "figures_of",
    "row_of",
    "tick_all",
    "time_calls",
    "without_collector",
]

REPEATS = 3  # of what is timed to find out what the work alone takes


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
