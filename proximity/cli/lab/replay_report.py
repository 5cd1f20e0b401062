"""The report of a replay: the same numbers as JSON and as text, lengths in the user's unit."""

import sys
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import proximity
from proximity.cli.lengths import in_unit
from proximity.cli.output import (
    MISSING,
    SHORT_DIGITS,
    Lines,
    block,
    filled,
    number,
    print_block,
    write_document,
)
from proximity.recording import NANOSECONDS, Recording
from proximity.system.time_units import NS_PER_US
from proximity.tracker.replay import VELOCITY_SHARE, ReplaySummary, TickTimes

BAR_WIDTH = 40
CLOCK_DIGITS = 6
"""Of seconds, behind the point: float64 has no more of a calendar's."""
COUNTS = (
    "tick_count", "finger_tick_count", "tracked_count", "exact_count", "bounded_count", "skipped_count",
)  # fmt: skip
TIMES = "p50 {%s.p50:.1f}, p99 {%s.p99:.1f}, p99.9 {%s.p999:.1f}, max {%s.max:.1f} µs a tick"
SCENE = "{file}: {part_count:1/part}, {face_count} faces"
RECORDING = (
    "{recording.file}: {recording.duration_s:s} s, {finger_count:1/finger} of {recording.hand_count:1/hand}, "
    "{recording.sample_count} samples in {recording.frame_count} frames, {recording.gap_count:1/gap}"
)
EPOCH = f"since the recording's first instant, its {{recording.begins_s:.{CLOCK_DIGITS}f}} s"
TURN = "turned by {placement.turn_degrees:s} degrees, "
PLACEMENT = "origin at {placement.position:s} {units}, %sscale {placement.scale:n}; %s"
TICKS = (
    "{ticks.tick_count} at {settings.rate_hz:n} Hz, radius {settings.radius:n} {units}, "
    "latency {settings.latency_ms:n} ms"
)
ANSWERS = "{exact} exact, {bounded} bounded, {skipped} skipped; finger lost in {lost}"
NEAREST = "{finger} at {since} s: {signed_distance:s} {units} from {part}"
NEAREST_OF_UNKNOWN = "{finger} at {since} s: {signed_distance:s} {units} at most, from an unknown part"
TOUCH = "{finger}: {count:1/time}, first at {since} s, {deepest:s} {units} deep"
BOUNDS = "{kept_count} of {checked_count} hold, checked against exact distances"
BROKEN = BOUNDS + ", the worst is off by {worst:s} {units}"
PREDICTIONS = "{share} within their bounds, error p50 {error_p50:s}, p95 {error_p95:s} {units}"
CONTACT_TIMES = (
    "{kept_count} of {checked_count} certified times held (velocity constant within {velocity_percent:.0f} %)"
)

Values = dict[str, Any]


def inputs(scene: "proximity.Scene", file: str, recording: Recording, units: str) -> Values:
    """Return what is reported of a scene and a recording."""
    return {
        "file": file,
        "units": units,
        "part_count": len(scene.parts),
        "face_count": sum(part.solid.mesh.face_count for part in scene.parts),
        "recording": {
            "file": recording.path,
            "begins_s": int(recording.times_ns[0]) / NANOSECONDS,
            "duration_s": recording.duration_s,
            "fingers": [{"hand": hand, "finger": finger} for hand, finger in recording.fingers],
            "hand_count": recording.hand_count,
            "frame_count": len(recording.times_ns),
            "sample_count": recording.sample_count,
            "gap_count": recording.gap_count(),
            "notes": list(recording.notes),
        },
    }


def results(summary: ReplaySummary, metres: float) -> Values:
    """Return what is reported of the ticks, with lengths in the unit."""

    def values(record: Any, *lengths: str) -> Values:
        found = asdict(record)
        found |= {name: in_unit(found[name], metres) for name in lengths}
        return found | ({"first_broken": found["first_broken"] or None} if "first_broken" in found else {})

    nearest = summary.nearest
    return {
        "ticks": {name: getattr(summary, name) for name in COUNTS},
        "compute_us": _times(summary.compute),
        "wall_us": _times(summary.wall),
        "nearest": None if nearest is None else values(nearest, "signed_distance"),
        "touches": [values(touch, "deepest") for touch in summary.touches],
        "bounds": values(summary.bounds, "worst"),
        "predictions": values(summary.predictions, "error_p50", "error_p95"),
        "certified_times": values(summary.certified_times) | {"velocity_share": VELOCITY_SHARE},
    }


def broken(report: Values) -> list[str]:
    """Return a sentence on the bounds that do not hold, and one on the certified times; none if all hold."""
    return [
        filled(
            f"{{broken_count}} of {{checked_count}} {key.replace('_', ' ')} that were checked do not hold, "
            "the first: {first_broken}",
            report[key],
        )
        for key in ("bounds", "certified_times")
        if report[key]["broken_count"]
    ]


def write(report: Values, *, as_json: bool) -> None:
    """Write the report to stdout."""
    if as_json:
        write_document(report)
        return
    print_block(_head(report))
    most = max(count for _, _, count in report["compute_us"]["histogram"])
    for low, high, count in report["compute_us"]["histogram"]:
        bar = "#" * -(-BAR_WIDTH * count // most)  # at least one mark where the count is not zero
        print_block([(f"{number(low):>6} to {number(high)}", f"µs {count:8d}  {bar}".rstrip())])
    print_block([*_approaches(report), *_checks(report)])
    sys.stdout.flush()


def _head(report: Values) -> Lines:
    placement = report["placement"]
    fitted = "fitted to the parts" if placement["is_fitted"] else "as given"
    templates = [
        ("scene", SCENE),
        ("recording", RECORDING),
        *([("times", EPOCH)] if report["recording"]["begins_s"] else []),
        *(("note", note.replace("{", "{{").replace("}", "}}")) for note in report["recording"]["notes"]),
        ("placement", PLACEMENT % (TURN if any(placement["turn_degrees"]) else "", fitted)),
        ("ticks", TICKS),
        ("compute", TIMES.replace("%s", "compute_us")),
        ("wall clock", TIMES.replace("%s", "wall_us")),
    ]
    return block(templates, report | {"finger_count": len(report["recording"]["fingers"])})


def _approaches(report: Values) -> Iterator[tuple[str, str]]:
    ticks, nearest = report["ticks"], report["nearest"]
    tracked, total = ticks["tracked_count"], ticks["finger_tick_count"]
    shares = {key: _share(ticks[f"{key}_count"], tracked) for key in ("exact", "bounded", "skipped")}
    yield "answers", filled(ANSWERS, shares | {"lost": _share(total - tracked, total)})
    begins, units = report["recording"]["begins_s"], {"units": report["units"]}
    if nearest is None:
        yield "nearest", "no finger came within the working range"
    else:
        # Where the budget was spent before any face was met, the distance is a bound only.
        template = NEAREST if nearest["part"] else NEAREST_OF_UNKNOWN
        yield "nearest", filled(template, nearest | units | {"since": _since(begins, nearest["time_s"])})
    for touch in report["touches"]:
        yield "touch", filled(TOUCH, touch | units | {"since": _since(begins, touch["first_s"])})
    if not report["touches"]:
        yield "touch", "none"


def _checks(report: Values) -> Iterator[tuple[str, str]]:
    units = {"units": report["units"]}
    bounds, predictions, times = (report[key] | units for key in ("bounds", "predictions", "certified_times"))
    for each in (bounds, times):
        each["kept_count"] = each["checked_count"] - each["broken_count"]
    yield "bounds", filled(BROKEN if bounds["broken_count"] else BOUNDS, bounds)
    if predictions["checked_count"]:
        share = _share(predictions["kept_count"], predictions["checked_count"])
        yield "predictions", filled(PREDICTIONS, predictions | {"share": share})
    times["velocity_percent"] = 100.0 * times["velocity_share"]
    if times["checked_count"]:
        yield ("contact times", filled(CONTACT_TIMES, times))


def _times(times: TickTimes) -> Values:
    rows = [[low / NS_PER_US, high / NS_PER_US, count] for low, high, count in times.histogram]
    figures = {key: getattr(times, key) / NS_PER_US for key in ("p50", "p99", "p999", "max")}
    return figures | {"histogram": rows}


def _share(count: int, total: int) -> str:
    return f"{100.0 * count / total:.1f} %" if total else MISSING


def _since(begins: float, instant: float) -> str:
    """Seconds from a recording's first instant to another; both are off by a fraction of a microsecond."""
    return number(round(instant - begins, CLOCK_DIGITS), SHORT_DIGITS)
