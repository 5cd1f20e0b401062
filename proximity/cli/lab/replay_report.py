"""The report of a replay: the same numbers as JSON and as text, lengths in the user's unit."""

import sys
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import proximity
from proximity.cli.output import MISSING, counted, in_unit, number, print_block, short, write_document
from proximity.formats import metres_per_unit
from proximity.recording import NANOSECONDS, Recording
from proximity.system.time_units import NS_PER_US
from proximity.tracker.replay import VELOCITY_SHARE, ReplaySummary, TickTimes
from proximity.tracker.tracker import MAX_ACCELERATION

UM_PER_M = 1e6
BAR_WIDTH = 40
CLOCK_DIGITS = 6
"""Of seconds, behind the point: float64 has no more of a calendar's."""
COUNTS = (
    "tick_count", "finger_tick_count", "tracked_count", "exact_count", "bounded_count", "skipped_count",
)  # fmt: skip

Values = dict[str, Any]
Lines = Iterator[tuple[str, str]]


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
        f"{report[key]['broken_count']} of {report[key]['checked_count']} {key.replace('_', ' ')} that were "
        f"checked do not hold, the first: {report[key]['first_broken']}"
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
    recorded, placement, settings = report["recording"], report["placement"], report["settings"]
    units, turn = report["units"], placement["turn_degrees"]
    yield "scene", f"{report['file']}: {counted(report['part_count'], 'part')}, {report['face_count']} faces"
    fingers, hands = counted(len(recorded["fingers"]), "finger"), counted(recorded["hand_count"], "hand")
    yield (
        "recording",
        f"{recorded['file']}: {short(recorded['duration_s'])} s, {fingers} of {hands}, "
        f"{recorded['sample_count']} samples in "
        f"{recorded['frame_count']} frames, {counted(recorded['gap_count'], 'gap')}",
    )
    if begins := recorded["begins_s"]:
        yield "times", f"since the recording's first instant, its {begins:.{CLOCK_DIGITS}f} s"
    for note in recorded["notes"]:
        yield "note", note
    turned = f"turned by {short(*turn)} degrees, " if any(turn) else ""
    fitted = "fitted to the parts" if placement["is_fitted"] else "as given"
    position, scale = short(*placement["position"]), number(placement["scale"])
    yield "placement", f"origin at {position} {units}, {turned}scale {scale}; {fitted}"
    yield (
        "ticks",
        f"{report['ticks']['tick_count']} at {number(settings['rate_hz'])} Hz, "
        f"radius {number(settings['radius'])} {units}, latency {number(settings['latency_ms'])} ms",
    )
    for label, key in (("compute", "compute_us"), ("wall clock", "wall_us")):
        p50, p99, p999, largest = (f"{report[key][name]:.1f}" for name in ("p50", "p99", "p999", "max"))
        yield label, f"p50 {p50}, p99 {p99}, p99.9 {p999}, max {largest} µs a tick"


def _approaches(report: Values) -> Lines:
    ticks, nearest, units = report["ticks"], report["nearest"], report["units"]
    tracked, total, begins = (
        ticks["tracked_count"],
        ticks["finger_tick_count"],
        report["recording"]["begins_s"],
    )
    shares = ", ".join(
        f"{_share(ticks[f'{key}_count'], tracked)} {key}" for key in ("exact", "bounded", "skipped")
    )
    shares += " (bounds from the last search)"
    yield "answers", f"{shares}; finger lost in {_share(total - tracked, total)}"
    if nearest is None:
        yield "nearest", "no finger came within the working range"
    else:
        # Where the budget was spent before any face was met, the distance is a bound only.
        where = f"from {nearest['part']}" if nearest["part"] else "at most, from an unknown part"
        since, distance = _since(begins, nearest["time_s"]), short(nearest["signed_distance"])
        yield "nearest", f"{nearest['finger']} at {since} s: {distance} {units} {where}"
    for touch in report["touches"]:
        times, since = counted(touch["count"], "time"), _since(begins, touch["first_s"])
        yield (
            "touch",
            f"{touch['finger']}: {times}, first at {since} s, {short(touch['deepest'])} {units} deep",
        )
    if not report["touches"]:
        yield "touch", "none"


def _checks(report: Values) -> Lines:
    units = report["units"]
    bounds, predictions, times = (report[key] for key in ("bounds", "predictions", "certified_times"))
    worst = f", the worst is off by {short(bounds['worst'])} {units}" if bounds["broken_count"] else ""
    tracked = report["ticks"]["tracked_count"]
    sample = "" if bounds["checked_count"] == tracked else f" (a sample of the {tracked} of all fingers)"
    yield "bounds", f"{_kept(bounds)} hold, checked against exact distances{sample}{worst}"
    if checked := predictions["checked_count"]:
        p50, p95 = (
            UM_PER_M * metres_per_unit(units) * predictions[key] for key in ("error_p50", "error_p95")
        )
        share = _share(predictions["kept_count"], checked)
        yield "predictions", f"{share} within their bounds; median error {p50:.2g} µm, p95 {p95:.2g} µm"
        if predictions["kept_count"] < checked:
            yield "", f"a prediction's bounds assume at most {MAX_ACCELERATION:g} m/s² of acceleration"
    if times["checked_count"]:
        steady = f"velocity constant within {100.0 * times['velocity_share']:.0f} %"
        yield "contact times", f"{_kept(times)} certified times held ({steady})"


def _kept(counts: Values) -> str:
    return f"{counts['checked_count'] - counts['broken_count']} of {counts['checked_count']}"


def _times(times: TickTimes) -> Values:
    rows = [[low / NS_PER_US, high / NS_PER_US, count] for low, high, count in times.histogram]
    figures = {key: getattr(times, key) / NS_PER_US for key in ("p50", "p99", "p999", "max")}
    return figures | {"histogram": rows}


def _share(count: int, total: int) -> str:
    return f"{100.0 * count / total:.1f} %" if total else MISSING


def _since(begins: float, instant: float) -> str:
    """Seconds from a recording's first instant to another; both are off by a fraction of a microsecond."""
    return short(round(instant - begins, CLOCK_DIGITS))
