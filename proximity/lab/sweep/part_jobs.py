"""The jobs ``check``, which diagnoses the parts of a file, and ``replay``, which runs a hand through them."""

from dataclasses import fields
from types import MappingProxyType
from typing import Any

import numpy as np

from proximity.errors import ServiceError
from proximity.lab.sweep.design import Factor, Job, Kind, Measure, Values
from proximity.lab.sweep.node_files import NodeFiles
from proximity.mesh.body_split import Repairs
from proximity.pose import Pose
from proximity.recording import NANOSECONDS, Recording
from proximity.scene.scene import Scene
from proximity.scene.sign import SignMethod
from proximity.service.config.table_fields import Range
from proximity.tracker.replay import fitted_pose, replay, summarise, turn_about_axes
from proximity.tracker.replay.motions import FINGERS_PER_HAND, wandering_hands
from proximity.tracker.tracker import Tracker
from proximity.tracker.tracker_arguments import DEFAULT_BUDGET, LARGEST_RADIUS, LARGEST_WORKING_RANGE

WANDERING = "wandering"
"""Instead of a recording: a hand that wanders through the box of the parts, as its seed says."""
SEEDS = Range("", 0, 2**32 - 1)
UNITS = ("mm", "m", "cm", "um", "in", "ft")

SCENE_FACTORS = MappingProxyType({"scene": Factor(Kind.FILE), "units": Factor(Kind.WORD, "mm", words=UNITS)})
RECORDING_FACTORS = MappingProxyType(
    {
        "recording": Factor(Kind.FILE, WANDERING, words=(WANDERING,)),
        "seconds": Factor(Kind.NUMBER, 10.0, Range("s", 0.01, 1e4)),
        "position": Factor(Kind.POINT, None, Range("m"), absent="fitted"),
        "turn_degrees": Factor(Kind.POINT, (0.0, 0.0, 0.0), Range("degrees")),
        "scale": Factor(Kind.NUMBER, 1.0, Range("times the size", 1e-6, 1e6)),
        "seed": Factor(Kind.WHOLE, 5, SEEDS),
    }
)
TRACKER_FACTORS = MappingProxyType(
    {
        "rate": Factor(Kind.NUMBER, 1000.0, Range("Hz", 1.0, 1e5)),
        "latency": Factor(Kind.NUMBER, 0.001, Range("s", 0.0, 1.0)),
        "radius": Factor(Kind.NUMBER, 0.007, Range("m", 0.0, LARGEST_RADIUS, is_above=True)),
        "budget": Factor(Kind.WHOLE, DEFAULT_BUDGET, Range("nodes and leaves", 1, 2**31 - 1)),
        "working_range": Factor(Kind.NUMBER, 0.12, Range("m", 0.0, LARGEST_WORKING_RANGE, is_above=True)),
    }
)
CHECK_MEASURES = {
    "without_inside": Measure("parts"),
    "parts": Measure(),
    "faces": Measure(),
    "shells": Measure(),
    "not_watertight": Measure("parts"),
    "not_oriented": Measure("parts"),
    "by_winding_number": Measure("parts"),
    "not_solid_by_manifold3d": Measure("parts"),
    "repairs": Measure("vertices and faces"),
    "weld_distance": Measure("m"),
    "size": Measure("m"),
    "volume": Measure("m³", is_worse_high=False),
    "notes": Measure(),
}
REPLAY_MEASURES = {
    "broken_bounds": Measure(),
    "worst_bound": Measure("m"),
    "predictions_kept": Measure("share", is_worse_high=False),
    "certified_times_kept": Measure("share", is_worse_high=False),
    "exact": Measure("share", is_worse_high=False),
    "touches": Measure(),
    "deepest": Measure("m"),
    "nearest": Measure("m", is_worse_high=False),
    "tick_p50": Measure("s"),
    "tick_p999": Measure("s"),
    "tick_max": Measure("s"),
    "ticks": Measure(),
}


def check(values: Values, files: NodeFiles) -> dict[str, Any]:
    """Return the diagnosis of all parts of a scene together: repairs, sign, and size."""
    scene = files.scene(values["scene"], values["units"])
    found = [part.solid.diagnosis for part in scene.parts]
    solids = [part.solid for part in scene.parts]
    lower, upper = scene.bounds
    notes = () if scene.report is None else scene.report.notes
    return {
        "without_inside": sum(not solid.has_inside for solid in solids),
        "parts": len(found),
        "faces": sum(each.face_count for each in found),
        "shells": sum(each.shell_count for each in found),
        "not_watertight": sum(not each.is_watertight for each in found),
        "not_oriented": sum(not each.is_oriented for each in found),
        "by_winding_number": sum(solid.sign_method == SignMethod.WINDING_NUMBER for solid in solids),
        "not_solid_by_manifold3d": sum(not each.is_solid_by_manifold for each in found),
        "repairs": sum(_repair_count(part.repairs) for part in scene.parts),
        "weld_distance": max(part.repairs.weld_distance for part in scene.parts),
        "size": float((upper - lower).max()),
        "volume": float(sum(each.volume for each in found)),
        "notes": len(notes),
        "remarks": " ".join([*(part.repairs.describe() for part in scene.parts), *notes]).strip(),
    }


def _repair_count(repairs: Repairs) -> int:
    """Vertices and faces that were changed; those merged at equal positions are no repair."""
    counts = (each.name for each in fields(repairs) if each.name.endswith("_count"))
    return sum(getattr(repairs, name) for name in counts if name != "merged_vertex_count")


def run_replay(values: Values, files: NodeFiles) -> dict[str, Any]:
    """Return what `proximity replay` reports of a hand in a scene."""
    scene = files.scene(values["scene"], values["units"])
    ticked = _placed(values, files, scene)

    def tracker() -> Tracker:
        return Tracker(
            scene,
            fingers=len(ticked.fingers),
            radius=values["radius"],
            period=1.0 / values["rate"],
            latency=values["latency"],
            budget=values["budget"],
            working_range=values["working_range"],
        )

    found = summarise(scene, replay(tracker, ticked, latency=values["latency"]), values["radius"])
    if not found.tracked_count:
        raise ServiceError(f"{values['recording']}: no finger is there at any tick")
    predictions, times = found.predictions, found.certified_times
    return {
        "broken_bounds": found.bounds.broken_count,
        "worst_bound": found.bounds.worst,
        "predictions_kept": _share(predictions.kept_count, predictions.checked_count),
        "certified_times_kept": _share(times.checked_count - times.broken_count, times.checked_count),
        "exact": _share(found.exact_count, found.tracked_count),
        "touches": sum(finger.count for finger in found.touches),
        "deepest": max((finger.deepest for finger in found.touches), default=0.0),
        "nearest": None if found.nearest is None else found.nearest.signed_distance,
        "tick_p50": found.compute.p50 / NANOSECONDS,
        "tick_p999": found.compute.p999 / NANOSECONDS,
        "tick_max": found.compute.max / NANOSECONDS,
        "ticks": found.tick_count,
    }


def _placed(values: Values, files: NodeFiles, scene: Scene) -> Recording:
    """The hand in the frame of the scene, at the rate of the ticks."""
    rate, count = values["rate"], round(values["seconds"] * values["rate"])
    if values["recording"] == WANDERING:
        times_ns = np.arange(count) * round(NANOSECONDS / rate)
        positions = wandering_hands(scene, count, 1, seed=values["seed"], rate=rate)
        fingers = tuple((0, finger) for finger in range(FINGERS_PER_HAND))
        return Recording(times_ns, positions, fingers, WANDERING)
    hand = files.recording(values["recording"]).first(values["seconds"])
    rotation, scale = turn_about_axes(values["turn_degrees"]), values["scale"]
    if values["position"] is None:
        pose = fitted_pose(scene, hand, values["radius"], rotation=rotation, scale=scale)
    else:
        pose = Pose(rotation, values["position"])
    return hand.placed(pose, scale).resampled(1.0 / rate)


def _share(count: int, total: int) -> float | None:
    return count / total if total else None


CHECK = Job("check", SCENE_FACTORS, CHECK_MEASURES, check, texts=("remarks",))
REPLAY = Job("replay", {**SCENE_FACTORS, **RECORDING_FACTORS, **TRACKER_FACTORS}, REPLAY_MEASURES, run_replay)
