"""Certify a scene: search its worst positions, measure ticks, run the loop, compare with a period."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from proximity.errors import ServiceError
from proximity.lab.certificate.deadlines import (
    Period,
    check_tick_count,
    misses,
    misses_of,
    percentiles,
    percentiles_of,
)
from proximity.lab.certificate.measurement import Case, measure, run_loop
from proximity.lab.certificate.period import shown_period
from proximity.lab.certificate.search.worst_positions import Found, search
from proximity.lab.certificate.subject import Subject
from proximity.lab.certificate.wording import microseconds, three
from proximity.service import Histogram, Report

TICKS, SECONDS, SEED = 20_000, 3.0, 0
LONGEST_LOOP = 3600.0
"""s."""
GATED, GATED_LOOP = "p999", "p50"
"""What of every motion, and of the loop, must keep to the period."""
MISSED = 1e-3
"""Share of the deadlines that a machine may miss and still keep a period."""
MEASURE_NAMES = {"p999": "p99.9", "p50": "the median", "max": "the longest"}


@dataclass(frozen=True, slots=True)
class Load:
    """Processor time of ticks in one motion, or in the loop."""

    name: str
    measure: str  # "p999", of the loop "p50"; "max" where so few ticks tell none
    tail_ns: float  # that of the times
    over_count: int  # ticks that took longer than the period
    tick_count: int


@dataclass(frozen=True, slots=True)
class MachineVerdict:
    """Whether this machine kept the deadlines of the loop while it was measured, whatever the reason."""

    period: float  # s, of the loop
    kept: bool
    missed: int
    due: int
    sentence: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a scene fits a period, and why: what it takes to compute, without delays by the machine."""

    period: float  # s
    fits: bool
    worst: Load
    sentence: str


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """Results of search and measurement."""

    subject: Subject
    seed: int
    tick_count: int  # of each motion, as asked for
    seconds: float  # of the loop, as asked for
    found: tuple[Found, ...]
    cases: tuple[Case, ...]
    loop: Report

    def loads(self, period: float) -> tuple[Load, ...]:
        """Return what ticks took, in each motion that a service meets, and in its loop."""
        timed = Period(period, "")
        motions = [load_of_times(case.name, case.best_ns, timed) for case in self.cases if case.counts]
        return (*motions, load_of_histogram("service", self.loop.compute, timed))

    def verdict(self, period: float) -> Verdict:
        """Return whether the scene fits a period."""
        return judge(self.loads(period), period)

    def machine_verdict(self) -> MachineVerdict:
        """Return whether the machine kept the period of the loop: at most 0.1 % of its deadlines missed."""
        period = 1e-9 * self.loop.period_ns
        missed, due = self.loop.missed, self.loop.ticks + self.loop.missed
        kept = missed <= MISSED * due
        return MachineVerdict(
            period,
            kept,
            missed,
            due,
            f"this machine {'kept' if kept else 'did not keep'} {shown_period(period)}: "
            f"{missed} of {due} deadlines missed, at most {100.0 * MISSED:g} % allowed",
        )


def certify(
    subject: Subject,
    *,
    tick_count: int = TICKS,
    seconds: float = SECONDS,
    seed: int = SEED,
    progress: Callable[[str, float], None] = lambda _, __: None,
) -> Certificate:
    """Return the certificate of a scene; it takes some ten seconds.

    *seed*: decides all that is random: the positions found are the same on every run. *progress*: called with
    what is done, and which share of it is.
    """
    check_request(tick_count, seconds, seed)
    if all(part.is_hidden for part in subject.scene.parts):
        raise ServiceError("all parts of the scene are hidden: no tick would find any")
    found = search(subject, seed, progress=progress)
    cases = measure(subject, found, tick_count, seed, progress)
    progress(f"running the loop for {seconds:g} s", 0.0)
    loop = run_loop(subject, found, seconds, seed)
    return Certificate(subject, seed, tick_count, seconds, found, cases, loop)


def check_request(tick_count: int, seconds: float, seed: int) -> None:
    """Refuse what cannot be measured, before it takes time."""
    check_tick_count(tick_count)
    if not 0.0 < seconds <= LONGEST_LOOP:
        raise ServiceError(f"the loop cannot run for {seconds:g} s, expected up to {LONGEST_LOOP:g} s")
    if not 0 <= seed < 2**63:
        raise ServiceError(f"{seed} is not a seed, expected a whole number of 0 or more")


def load_of_times(name: str, times_ns: np.ndarray, period: Period) -> Load:
    """Return the load of ticks that were timed."""
    return Load(name, *_tail(percentiles(times_ns), GATED), misses(times_ns, period).count, len(times_ns))


def load_of_histogram(name: str, histogram: Histogram, period: Period) -> Load:
    """Return the load of ticks that were counted."""
    over = misses_of(histogram, period).count
    return Load(name, *_tail(percentiles_of(histogram), GATED_LOOP), over, histogram.count)


def _tail(times: dict[str, float | None], wanted: str) -> tuple[str, float]:
    value = times[wanted]
    return ("max", float(times["max"] or 0.0)) if value is None else (wanted, value)


def judge(loads: tuple[Load, ...], period: float) -> Verdict:
    """Return whether ticks keep to a period: 99.9 % of each motion, and half of the loop's."""
    worst = max(loads, key=lambda load: load.tail_ns)
    fits = worst.tail_ns <= 1e9 * period
    over, total = sum(load.over_count for load in loads), sum(load.tick_count for load in loads)
    return Verdict(
        period,
        fits,
        worst,
        f"the scene {'fits' if fits else 'does not fit'} {shown_period(period)}: "
        f"{MEASURE_NAMES[worst.measure]} of computing is {microseconds(worst.tail_ns)} µs ({worst.name}), "
        f"{three(1e-7 * worst.tail_ns / period)} % of it; {over} of {total} ticks took longer",
    )
