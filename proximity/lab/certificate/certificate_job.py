"""The job ``certificate`` of a study: whether the ticks of a scene hold their period, and the worst place."""

from typing import Any

from proximity.lab.certificate.certification import certify
from proximity.lab.certificate.subject import Subject
from proximity.lab.sweep.jobs import Factor, Job, Kind, Measure, Values
from proximity.lab.sweep.node_files import NodeFiles
from proximity.lab.sweep.part_jobs import SCENE_FACTORS, SEEDS, TRACKER_FACTORS
from proximity.message import MAX_RECORDS
from proximity.service.config.table_fields import Range

FACTORS = {
    **SCENE_FACTORS,
    **TRACKER_FACTORS,
    "fingers": Factor(Kind.WHOLE, 5, Range("", 1, MAX_RECORDS)),
    "ticks": Factor(Kind.WHOLE, 2000, Range("of each motion", 1000, 10**7)),
    "loop_seconds": Factor(Kind.NUMBER, 0.2, Range("s", 0.01, 3600.0)),
    "seed": Factor(Kind.WHOLE, 0, SEEDS),
}
MEASURES = {
    "slowest": Measure("s"),
    "misses": Measure("share"),
    "fits": Measure("1 or 0", is_worse_high=False),
    "worst_work": Measure("nodes and leaves"),
    "typical_work": Measure("nodes and leaves"),
    "bounds_width": Measure("m"),
    "worst_x": Measure("m"),
    "worst_y": Measure("m"),
    "worst_z": Measure("m"),
    "faces": Measure(),
    "parts": Measure(),
}
"""`slowest`: of all motions the largest 99.9th percentile of a tick's computing. `worst_work` of an exact
search, and where; `bounds_width` of what the budget leaves open at the worst place within the budget."""


def run(values: Values, files: NodeFiles) -> dict[str, Any]:
    """Return the certificate of one scene in a few numbers."""
    scene = files.scene(values["scene"], values["units"])
    settings = {name: values[name] for name in ("radius", "budget", "working_range")}
    period = 1.0 / values["rate"]
    subject = Subject(scene, values["fingers"], period, values["latency"], settings, real_time=False)
    found = certify(subject, tick_count=values["ticks"], seconds=values["loop_seconds"], seed=values["seed"])
    loads = found.loads(period)
    results = found.found.values()
    exact = [each for each in results if not each.goal.has_budget]
    costliest = max(exact, key=lambda each: each.positions[0].work)
    worst = costliest.positions[0]
    bounded = [each.positions[0] for each in results if each.goal.has_budget]
    verdict = found.verdict(period)
    return {
        "slowest": 1e-9 * max(load.tail_ns for load in loads if load.measure == "p999"),
        "misses": sum(load.over_count for load in loads) / sum(load.tick_count for load in loads),
        "fits": float(verdict["fits"]),
        "worst_work": worst.work,
        "typical_work": costliest.typical_work,
        "bounds_width": max(each.upper - each.lower for each in bounded),
        **dict(zip(("worst_x", "worst_y", "worst_z"), worst.position.tolist(), strict=True)),
        "faces": subject.face_count,
        "parts": len(scene.parts),
        "verdict": verdict["sentence"],
    }


CERTIFICATE = Job("certificate", FACTORS, MEASURES, run, texts=("verdict",))
