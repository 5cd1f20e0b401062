"""Certification of a scene by a search for its worst positions, timed ticks, and a run of the loop.

A scene fits a period if 99.9 % of the ticks in every motion are computed within it. The time of a tick is the
thread's processor time, and the shortest of three identical runs. The same must hold for half of the ticks of
the service's loop at that period, where caches are colder and frames are made. Interruptions and the lateness
of the loop's wake-ups depend on the machine, and are reported separately. A verdict that included them would
reject good scenes on a noisy machine.
"""

from dataclasses import dataclass
from typing import Any

from proximity.errors import ServiceError
from proximity.lab.certificate.measurement import MotionTiming, measure, run_loop
from proximity.lab.certificate.subject import Subject
from proximity.lab.certificate.times import (
    MIN_TICKS,
    Times,
    count_of,
    microseconds,
    over_count,
    percent,
    percentiles,
    shown_period,
    tail,
)
from proximity.lab.certificate.work import SearchGoal
from proximity.lab.certificate.worst_positions import Progress, SearchResult, search
from proximity.service import Report

TICKS, SECONDS, SEED = 20_000, 3.0, 0
MAX_LOOP = 3600.0  # s
MISSED = 1e-3  # maximum share of missed deadlines for a machine to keep a period
TICKS_JUDGED = {"p999": "99.9 %", "p50": "half", "max": "all"}


@dataclass(frozen=True, slots=True)
class Load:
    """Processor time of ticks in one motion, or in the loop."""

    name: str
    measure: str  # "p999", "p50" for the loop, or "max" for too few ticks
    tail_ns: float  # value of this measure
    over_count: int  # ticks that took longer than the period
    tick_count: int


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """Results of search and measurement."""

    subject: Subject
    seed: int
    tick_count: int  # of each motion, as requested
    seconds: float  # of the loop, as requested
    found: dict[SearchGoal, SearchResult]
    timings: tuple[MotionTiming, ...]
    loop: Report

    def loads(self, period: float) -> list[Load]:
        """Return the tick times in each motion of a service and in its loop, compared with a period, s."""
        motions = [load(each.name, each.best_ns, period) for each in self.timings if each.counts]
        return [*motions, load("service", self.loop.compute, period, measure="p50")]

    def verdict(self, period: float) -> dict[str, Any]:
        """Return whether the computing time of ticks in the scene fits a period, s, and the reason."""
        *motions, loop = loads = self.loads(period)
        slowest, worst = (max(some, key=lambda each: each.tail_ns) for some in (motions, loads))
        fits = worst.tail_ns <= 1e9 * period
        over, total = sum(each.over_count for each in loads), sum(each.tick_count for each in loads)
        return {
            "period_s": period,
            "fits": fits,
            "case": worst.name,
            "measure": worst.measure,
            "time_ns": worst.tail_ns,
            "sentence": f"the scene {'fits' if fits else 'does not fit'} {shown_period(period)}: "
            f"{TICKS_JUDGED[slowest.measure]} of the ticks of every motion, in the best of three runs, took "
            f"at most {microseconds(slowest.tail_ns)} µs ({slowest.name}: "
            f"{percent(1e-9 * slowest.tail_ns / period)} % of it), half of the loop's "
            f"{microseconds(loop.tail_ns)} µs; {over} of {total} took longer",
        }

    def machine_verdict(self) -> dict[str, Any]:
        """Return whether the machine met the loop's deadlines. A deadline may be missed for any reason."""
        period = 1e-9 * self.loop.period_ns
        missed, due = self.loop.missed, self.loop.ticks + self.loop.missed
        kept = missed <= MISSED * due
        return {
            "period_s": period,
            "kept": kept,
            "missed": missed,
            "due": due,
            "sentence": f"this machine {'kept' if kept else 'did not keep'} {shown_period(period)}: "
            f"{missed} of {due} deadlines missed, at most {100.0 * MISSED:g} % allowed",
        }


def load(name: str, times: Times, period: float, measure: str = "p999") -> Load:
    """Return the load of tick times or their histogram, compared with a period, s."""
    found = percentiles(times)
    value = found[measure]
    measure, value = tail(found) if value is None else (measure, value)
    return Load(name, measure, value, over_count(times, period), count_of(times))


def certify(
    subject: Subject,
    *,
    tick_count: int = TICKS,
    seconds: float = SECONDS,
    seed: int = SEED,
    progress: Progress = lambda _, __: None,
) -> Certificate:
    """Certify a scene, which takes about ten seconds.

    *seed*: of all random numbers. The positions found are the same on every run.
    """
    check_request(tick_count, seconds, seed)
    if all(part.is_hidden for part in subject.scene.parts):
        raise ServiceError("all parts of the scene are hidden: no tick would find any")
    found = search(subject, seed, progress=progress)
    timings = measure(subject, found, tick_count, seed, progress)
    progress(f"running the loop for {seconds:g} s", 0.0)
    loop = run_loop(subject, found, seconds, seed)
    return Certificate(subject, seed, tick_count, seconds, found, timings, loop)


def check_request(tick_count: int, seconds: float, seed: int) -> None:
    """Raise an error for an invalid request before any time is spent on it."""
    if tick_count < MIN_TICKS:
        raise ServiceError(f"{tick_count} ticks are too few for p99.9, expected {MIN_TICKS} or more")
    if not 0.0 < seconds <= MAX_LOOP:
        raise ServiceError(f"the loop cannot run for {seconds:g} s, expected up to {MAX_LOOP:g} s")
    if not 0 <= seed < 2**63:
        raise ServiceError(f"{seed} is not a seed, expected a whole number of 0 or more")
