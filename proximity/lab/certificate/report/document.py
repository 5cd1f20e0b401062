"""A certificate as numbers, texts and lists: the JSON for machines, and what people's reports are made of.

``schema`` is 1. It grows when a key goes away or means another thing, not when one is added. Times are
nanoseconds, lengths metres, forces newtons, energies joules; null is what so few ticks do not tell.

- ``scene``: ``sha256`` of the content (see `fingerprint`), ``files``, ``parts``, ``faces``, ``bounds``
- ``machine``, ``versions``; ``settings``: how it was ticked, searched and timed; ``path_corners`` of
  the paths that came with poses (null: the scene file lets none in), and whether ``parts_move``
- ``search``: for each goal (manner cold, stays or moves; within the budget or exact) the dearest ``places``,
  with ``work`` (nodes and leaves), ``lower``, ``upper`` and ``width`` of the certified bracket, the climb's
  ``origin``, and ``typical_work`` at random positions
- ``cases``: for each motion ``compute`` (the thread's processor time), ``wall``, ``best`` (of three runs):
  percentiles; and for ``compute`` the ``periods``: shares, and deadlines that it alone would miss
- ``loop``: the service's own loop: ``compute``, ``lateness`` of waking, each as a case's; ``missed``
- ``feeling``: for each period the delay, and for speeds what it means at the finger
- ``verdict``: whether the scene fits the gate, or its own period
- ``machine_verdict``: whether this machine kept the deadlines of the loop
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from proximity.lab.certificate.certification import Certificate
from proximity.lab.certificate.deadlines import (
    PERIODS,
    Misses,
    Period,
    misses,
    misses_of,
    percentiles,
    percentiles_of,
)
from proximity.lab.certificate.fingerprint import fingerprint
from proximity.lab.certificate.measurement import Case
from proximity.lab.certificate.report import finger_effect
from proximity.lab.certificate.search.worst_positions import Found
from proximity.lab.certificate.subject import RADIUS
from proximity.service import Histogram
from proximity.system import machine

SCHEMA = 1
KIND = "proximity latency certificate"
TAIL_POINTS = 120  # of a plot


def document(certificate: Certificate, gate: float | None = None, *, version: str = "") -> dict[str, Any]:
    """Return all that is reported of a certificate.

    *gate*: period that the verdict is on; the scene's own where not given.
    """
    subject = certificate.subject
    lower, upper = subject.scene.bounds
    periods = periods_of(subject.period if gate is None else gate)
    return {
        "kind": KIND,
        "schema": SCHEMA,
        "scene": {
            "sha256": fingerprint(subject.scene),
            "files": [Path(file).name for file in subject.files],
            "parts": len(subject.scene.parts),
            "faces": subject.face_count,
            "bounds": [lower.tolist(), upper.tolist()],
        },
        "machine": machine.describe(),
        "versions": {"proximity": version, **machine.versions()},
        "settings": {
            "seed": certificate.seed,
            "ticks": certificate.tick_count,
            "loop_s": certificate.seconds,
            "fingers": subject.fingers,
            "period_s": subject.period,
            "latency_s": subject.latency,
            "budget": subject.budget,
            "working_range_m": subject.working_range,
            "radius_m": subject.settings.get("radius", RADIUS),
            "path_corners": None if subject.corners is None else subject.corners.shape[1],
            "parts_move": subject.moves,
            "gate_s": gate,
        },
        "search": [_goal(subject.scene, each) for each in certificate.found],
        "cases": [_case(case, periods) for case in certificate.cases],
        "loop": _loop(certificate, periods),
        "feeling": _feeling(certificate, periods),
        **_verdicts(certificate, subject.period if gate is None else gate),
    }


def _verdicts(certificate: Certificate, period: float) -> dict[str, Any]:
    fit, kept = certificate.verdict(period), certificate.machine_verdict()
    return {
        "verdict": {
            "period_s": fit.period,
            "fits": fit.fits,
            "case": fit.worst.name,
            "measure": fit.worst.measure,
            "time_ns": fit.worst.tail_ns,
            "sentence": fit.sentence,
        },
        "machine_verdict": {
            "period_s": kept.period,
            "kept": kept.kept,
            "missed": kept.missed,
            "due": kept.due,
            "sentence": kept.sentence,
        },
    }


def periods_of(asked: float) -> tuple[Period, ...]:
    """Return the periods that all is held against: the known ones, and the one asked for."""
    if any(abs(asked - period.seconds) <= 1e-9 * asked for period in PERIODS):
        return PERIODS
    return tuple(sorted((*PERIODS, Period(asked, "as asked")), key=lambda period: -period.seconds))


def _goal(scene: Any, found: Found) -> dict[str, Any]:
    return {
        "manner": str(found.goal.manner),
        "within_budget": found.goal.has_budget,
        "typical_work": found.typical_work,
        "start_count": found.start_count,
        "is_complete": found.is_complete,
        "places": [
            {
                "position": worst.position.tolist(),
                "work": worst.work,
                "lower": worst.lower,
                "upper": worst.upper,
                "width": worst.upper - worst.lower,
                "origin": worst.origin,
                "start_work": worst.start_work,
            }
            for worst in found.positions
        ],
    }


def _case(case: Case, periods: tuple[Period, ...]) -> dict[str, Any]:
    return {
        "name": case.name,
        "counts": case.counts,
        "fingers": case.fingers,
        "ticks": len(case.thread_ns),
        "most_work": case.most_work,
        "shares": case.shares,
        "compute": percentiles(case.thread_ns),
        "wall": percentiles(case.wall_ns),
        "best": percentiles(case.best_ns),
        "periods": [
            {**_shares(percentiles(case.thread_ns), period), **_missed(misses(case.thread_ns, period))}
            for period in periods
        ],
        "tail": _tail(case.thread_ns),
    }


def _loop(certificate: Certificate, periods: tuple[Period, ...]) -> dict[str, Any]:
    loop = certificate.loop
    return {
        "period_s": 1e-9 * loop.period_ns,
        "ticks": loop.ticks,
        **_missed(Misses(loop.missed, loop.ticks + loop.missed)),
        "compute": _counted(loop.compute, periods),
        "lateness": _counted(loop.lateness, periods),
        "notes": list(loop.notes),
    }


def _counted(histogram: Histogram, periods: tuple[Period, ...]) -> dict[str, Any]:
    """Percentiles and periods of what a histogram holds."""
    found, rows = percentiles_of(histogram), list(histogram.rows())
    left = histogram.count - np.cumsum([0, *(count for _, _, count in rows)])
    return {
        **found,
        "periods": [
            {**_shares(found, period), **_missed(misses_of(histogram, period))} for period in periods
        ],
        "tail": [[lower, int(count)] for (lower, _, _), count in zip(rows, left[:-1], strict=True)],
    }


def _feeling(certificate: Certificate, periods: tuple[Period, ...]) -> list[dict[str, Any]]:
    """For each period what a finger meets: p99.9 of the slowest computing, and of waking."""
    loop = certificate.loop
    times = [percentiles(case.thread_ns) for case in certificate.cases if case.counts]
    slowest = max(map(_tail_of, (*times, percentiles_of(loop.compute))))
    busy = 1e-9 * (slowest + _tail_of(percentiles_of(loop.lateness)))
    rows = [
        (period.seconds, period.source, finger_effect.delay_of(period.seconds, busy)) for period in periods
    ]
    rows.append((0.0, "computing and waking alone", busy))
    return [
        {
            "period_s": seconds or None,
            "source": source,
            "delay_s": delay,
            "speeds": [asdict(finger_effect.felt(delay, speed)) for speed in finger_effect.SPEEDS],
        }
        for seconds, source, delay in rows
    ]


def _tail_of(times: dict[str, float | None]) -> float:
    """The 99.9th percentile, or the longest where so few tell none."""
    return times["p999"] or times["max"] or 0.0


def _shares(times: dict[str, float | None], period: Period) -> dict[str, Any]:
    """Shares of a period that percentiles take."""
    shares = {name: None if value is None else value / period.ns for name, value in times.items()}
    return {"period_s": period.seconds, "source": period.source, "share": shares}


def _missed(missed: Misses) -> dict[str, Any]:
    return {
        "missed": missed.count,
        "missed_per_million": missed.per_million,
        "missed_per_million_upper_95": missed.per_million_upper,
    }


def _tail(times_ns: np.ndarray) -> list[list[float]]:
    """A time, and how many took longer: some hundred points, for a plot."""
    ordered = np.sort(times_ns)
    ranks = np.unique(np.round(len(ordered) * (1.0 - np.geomspace(1.0, 1.0 / len(ordered), TAIL_POINTS))))
    rows = np.minimum(ranks.astype(int), len(ordered) - 1)
    return [[int(ordered[row]), len(ordered) - int(row)] for row in rows]
