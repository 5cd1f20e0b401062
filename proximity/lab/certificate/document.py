"""A certificate as numbers, texts and lists: the JSON for machines, and what people's reports are made of.

``schema`` is 1. It grows when a key goes away or means another thing, not when one is added. Times are
nanoseconds, lengths metres, forces newtons, energies joules; null is what so few ticks do not tell.

- ``scene``: ``sha256`` of the content (see `fingerprint`), ``files``, ``parts``, ``faces``, ``bounds``
- ``machine``, ``versions``; ``settings``: how it was ticked, searched and timed; ``path_corners`` of
  the paths that came with poses (null: the scene file lets none in), and whether ``parts_move``
- ``search``: for each goal (manner cold, stays or moves; within the budget or exact) the costliest
  ``places``, with ``work`` (nodes and leaves), ``lower``, ``upper`` and ``width`` of the certified bracket,
  the climb's ``origin``, and ``typical_work`` at random positions
- ``cases``: for each motion ``compute`` (the thread's processor time), ``wall``, ``best`` (of three runs):
  percentiles; and for ``compute`` the ``periods``: shares, and deadlines that it alone would miss
- ``loop``: the service's own loop: ``compute``, ``lateness`` of waking, each as a case's; ``missed``
- ``feeling``: for each period the delay, and for speeds what it means at the finger
- ``verdict``: whether the scene fits the gate, or its own period
- ``machine_verdict``: whether this machine kept the deadlines of the loop
"""

import math
from pathlib import Path
from typing import Any

from proximity.lab.certificate.certification import Certificate
from proximity.lab.certificate.deadlines import Times, against, curve, missed, percentiles, periods_of, tail
from proximity.lab.certificate.measurement import MotionTiming
from proximity.lab.certificate.subject import RADIUS, fingerprint
from proximity.lab.certificate.worst_positions import SearchResult
from proximity.lab.paper.trajectories import Press
from proximity.lab.paper.walls import FINGER, energy_excess, steady_excess, total_delay
from proximity.service import Histogram
from proximity.system import machine

SCHEMA = 1
KIND = "proximity latency certificate"
SPEEDS = (0.1, 0.5, 1.0)
"""m/s, of fingers that meet a wall."""


def document(certificate: Certificate, gate: float | None = None, *, version: str = "") -> dict[str, Any]:
    """Return all that is reported of a certificate; its verdict is on *gate*, s, or the scene's period."""
    subject, loop = certificate.subject, certificate.loop
    period = subject.period if gate is None else gate
    periods = periods_of(period)
    lower, upper = subject.scene.bounds
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
        "search": [_goal(each) for each in certificate.found.values()],
        "cases": [_case(each, periods) for each in certificate.timings],
        "loop": {
            "period_s": 1e-9 * loop.period_ns,
            "ticks": loop.ticks,
            **missed(loop.missed, loop.ticks + loop.missed),
            "compute": _counted(loop.compute, periods),
            "lateness": _counted(loop.lateness, periods),
            "notes": list(loop.notes),
        },
        "feeling": _feeling(certificate, periods),
        "verdict": certificate.verdict(period),
        "machine_verdict": certificate.machine_verdict(),
    }


def _goal(found: SearchResult) -> dict[str, Any]:
    return {
        "manner": str(found.goal.mode),
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


def _case(timing: MotionTiming, periods: dict[float, str]) -> dict[str, Any]:
    return {
        "name": timing.name,
        "counts": timing.counts,
        "fingers": timing.fingers,
        "ticks": len(timing.thread_ns),
        "most_work": timing.most_work,
        "shares": timing.shares,
        "compute": percentiles(timing.thread_ns),
        "wall": percentiles(timing.wall_ns),
        "best": percentiles(timing.best_ns),
        "periods": against(timing.thread_ns, periods),
        "tail": curve(timing.thread_ns),
    }


def _counted(times: Histogram, periods: dict[float, str]) -> dict[str, Any]:
    return {**percentiles(times), "periods": against(times, periods), "tail": curve(times)}


def _feeling(certificate: Certificate, periods: dict[float, str]) -> list[dict[str, Any]]:
    """For each period what a finger meets: p99.9 of the slowest computing, and of waking."""
    loop = certificate.loop
    times: list[Times] = [loop.compute, *(each.thread_ns for each in certificate.timings if each.counts)]
    slowest = max(tail(percentiles(each))[1] for each in times)
    busy = 1e-9 * (slowest + tail(percentiles(loop.lateness))[1])
    rows = [(period, source, delay_of(period, busy)) for period, source in periods.items()]
    rows.append((0.0, "computing and waking alone", busy))
    return [
        {
            "period_s": seconds or None,
            "source": source,
            "delay_s": delay,
            "speeds": [felt(delay, speed) for speed in SPEEDS],
        }
        for seconds, source, delay in rows
    ]


def delay_of(period: float, busy: float) -> float:
    """Return the delay, at worst, of a force that is computed every period, s: equation (11).

    A finger that touches just after a tick is noticed a period later, and answered when that is computed;
    where computing takes longer than a period, ticks are left out.
    """
    return total_delay(period * max(1, math.ceil(busy / period)), busy)


def felt(delay: float, speed: float) -> dict[str, float]:
    """Return what a delay means for a finger of that speed: penetration, m, force error, N, energy error, J.

    A simulated wall is entered by speed times delay before it answers. Where the finger's motion is
    prescribed, the force at rest is then too high, equation (10), and the operator's work too large,
    equation (15). The finger is the paper's, the press assumed.
    """
    penetration, press = speed * delay, Press(speed=speed)
    return {
        "speed": speed,
        "penetration": penetration,
        "force_error": steady_excess(press.depth, penetration, FINGER, FINGER),
        "energy_error": energy_excess(press, penetration, FINGER),
    }
