"""The job ``certificate``, which returns the latency certificate of a scene in a few numbers."""

from functools import lru_cache
from pathlib import Path
from typing import Any

from proximity.lab.certificate.certification import certify
from proximity.lab.certificate.subject import Subject
from proximity.scene.loader import load
from proximity.scene.scene import Scene
from proximity.tracker.tracker_arguments import DEFAULT_BUDGET


def certificate(
    *,
    scene: Path,
    units: str = "mm",
    rate: float = 1000.0,
    latency: float = 0.001,
    radius: float = 0.007,
    budget: int = DEFAULT_BUDGET,
    working_range: float = 0.12,
    fingers: int = 5,
    ticks: int = 2000,
    loop_seconds: float = 0.2,
    seed: int = 0,
) -> dict[str, Any]:
    """Return whether the ticks in a scene keep their period, and the worst position.

    ``slowest`` is the largest 99.9th percentile of a tick's computing time, s. ``worst_work`` is that of an
    exact search, and ``bounds_width`` is the width of the bounds at the worst position within the budget.
    """
    settings = {"radius": radius, "budget": budget, "working_range": working_range}
    loaded, period = _loaded(scene, units), 1.0 / rate
    subject = Subject(loaded, fingers, period, latency, settings, real_time=False)
    found = certify(subject, tick_count=ticks, seconds=loop_seconds, seed=seed)
    loads, results, verdict = found.loads(period), found.found.values(), found.verdict(period)
    costliest = max(
        (one for one in results if not one.goal.has_budget), key=lambda one: one.positions[0].work
    )
    worst = costliest.positions[0]
    bounded = [one.positions[0] for one in results if one.goal.has_budget]
    return {
        "slowest": 1e-9 * max(load.tail_ns for load in loads if load.measure == "p999"),
        "misses": sum(load.over_count for load in loads) / sum(load.tick_count for load in loads),
        "fits": float(verdict["fits"]),
        "worst_work": worst.work,
        "typical_work": costliest.typical_work,
        "bounds_width": max(one.upper - one.lower for one in bounded),
        **dict(zip(("worst_x", "worst_y", "worst_z"), worst.position.tolist(), strict=True)),
        "faces": subject.face_count,
        "parts": len(loaded.parts),
        "verdict": verdict["sentence"],
    }


@lru_cache(maxsize=2)
def _loaded(path: Path, units: str) -> Scene:
    """Read a scene, which successive conditions share."""
    return load(path, units=units)
