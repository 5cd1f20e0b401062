"""The report of a replay: the same numbers as JSON and as text, lengths in the user's unit."""

import sys
from typing import Any

import proximity
from proximity.cli.console import Lines, print_block, results_console
from proximity.cli.lengths import in_unit
from proximity.cli.views.json_output import write_document
from proximity.cli.wording import counted, number
from proximity.recording import NANOSECONDS, Recording
from proximity.system.time_units import NS_PER_US
from proximity.tracker.replay import VELOCITY_SHARE, ReplaySummary, TickTimes

BAR_WIDTH = 40
SHOWN_DIGITS = 4
CLOCK_DIGITS = 6
"""Of seconds, behind the point: float64 has no more of a calendar's."""


def inputs(scene: "proximity.Scene", file: str, recording: Recording, units: str) -> dict[str, Any]:
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


def results(summary: ReplaySummary, metres: float) -> dict[str, Any]:
    """Return what is reported of the ticks, with lengths in the unit."""
    nearest, bounds, predictions = summary.nearest, summary.bounds, summary.predictions
    certified = summary.certified_times
    return {
        "ticks": {
            "tick_count": summary.tick_count,
            "finger_tick_count": summary.finger_tick_count,
            "tracked_count": summary.tracked_count,
            "exact_count": summary.exact_count,
            "bounded_count": summary.bounded_count,
            "skipped_count": summary.skipped_count,
        },
        "compute_us": _times(summary.compute),
        "wall_us": _times(summary.wall),
        "nearest": None
        if nearest is None
        else {
            "finger": nearest.finger,
            "time_s": nearest.time_s,
            "signed_distance": in_unit(nearest.signed_distance, metres),
            "part": nearest.part,
        },
        "touches": [
            {
                "finger": touch.finger,
                "count": touch.count,
                "first_s": touch.first_s,
                "deepest": in_unit(touch.deepest, metres),
            }
            for touch in summary.touches
        ],
        "bounds": {
            "checked_count": bounds.checked_count,
            "broken_count": bounds.broken_count,
            "worst": in_unit(bounds.worst, metres),
            "first_broken": bounds.first_broken or None,
        },
        "predictions": {
            "checked_count": predictions.checked_count,
            "kept_count": predictions.kept_count,
            "error_p50": in_unit(predictions.error_p50, metres),
            "error_p95": in_unit(predictions.error_p95, metres),
        },
        "certified_times": {
            "checked_count": certified.checked_count,
            "broken_count": certified.broken_count,
            "first_broken": certified.first_broken or None,
            "velocity_share": VELOCITY_SHARE,
        },
    }


def broken(summary: ReplaySummary) -> list[str]:
    """Return a sentence on the bounds that do not hold, and one on the certified times; none if all hold."""
    bounds, times = summary.bounds, summary.certified_times
    checks = (("bounds", bounds), ("certified times", times))
    return [
        f"{check.broken_count} of {check.checked_count} {what} that were checked do not hold, "
        f"the first: {check.first_broken}"
        for what, check in checks
        if check.broken_count
    ]


def write(report: dict[str, Any], *, as_json: bool) -> None:
    """Write the report to stdout."""
    if as_json:
        write_document(report)
        return
    console = results_console()
    units = report["units"]
    print_block(console, [*_settings_lines(report, units), *_measured(report)])
    print_block(console, _histogram(report["compute_us"]["histogram"]))
    print_block(console, [*_found(report, units), *_kept(report, units)])
    sys.stdout.flush()


def _settings_lines(report: dict[str, Any], units: str) -> Lines:
    reported, placement, settings = report["recording"], report["placement"], report["settings"]
    fingers, hands = len(reported["fingers"]), reported["hand_count"]
    fitted = "fitted to the parts" if placement["is_fitted"] else "as given"
    turn = placement["turn_degrees"]
    turned = f"turned by {_numbers(turn)} degrees, " if any(turn) else ""
    ticks = report["ticks"]
    return [
        (
            "scene",
            f"{report['file']}: {counted(report['part_count'], 'part')}, {report['face_count']} faces",
        ),
        (
            "recording",
            f"{reported['file']}: {_short(reported['duration_s'])} s, {counted(fingers, 'finger')} of "
            f"{counted(hands, 'hand')}, {reported['sample_count']} samples in "
            f"{reported['frame_count']} frames, "
            f"{counted(reported['gap_count'], 'gap')}",
        ),
        *_epoch(reported["begins_s"]),
        *(("note", note) for note in reported["notes"]),
        (
            "placement",
            f"origin at {_numbers(placement['position'])} {units}, {turned}"
            f"scale {number(placement['scale'])}; {fitted}",
        ),
        (
            "ticks",
            f"{ticks['tick_count']} at {number(settings['rate_hz'])} Hz, radius {number(settings['radius'])} "
            f"{units}, latency {number(settings['latency_ms'])} ms",
        ),
    ]


def _epoch(begins: float) -> Lines:
    """Instant that the instants below count from, where the recording's own do not begin at zero."""
    return (
        [("times", f"since the recording's first instant, its {begins:.{CLOCK_DIGITS}f} s")] if begins else []
    )


def _measured(report: dict[str, Any]) -> Lines:
    def line(times: dict[str, Any]) -> str:
        shown = (f"{title} {times[key]:.1f}" for title, key in TIME_KEYS.items())
        return ", ".join(shown) + " µs a tick"

    return [("compute", line(report["compute_us"])), ("wall clock", line(report["wall_us"]))]


TIME_KEYS = {"p50": "p50", "p99": "p99", "p99.9": "p999", "max": "max"}


def _histogram(rows: list[Any]) -> Lines:
    most = max(count for _, _, count in rows)
    return [
        (
            f"{number(low):>6} to {number(high)}".ljust(15),
            f"µs {count:8d}  {_bar(count, most)}".rstrip(),
        )
        for low, high, count in rows
    ]


def _bar(count: int, most: int) -> str:
    """A bar for a count, of at least one mark where it is not zero."""
    return "#" * -(-BAR_WIDTH * count // most)


def _found(report: dict[str, Any], units: str) -> Lines:
    ticks, nearest, begins = report["ticks"], report["nearest"], report["recording"]["begins_s"]
    tracked = ticks["tracked_count"]
    shares = (f"{_share(ticks[f'{name}_count'], tracked)} {name}" for name in ("exact", "bounded", "skipped"))
    lost = ticks["finger_tick_count"] - tracked
    approach = "no finger came within the working range"
    if nearest is not None:
        length = f"{_short(nearest['signed_distance'])} {units}"
        # Where the budget was spent before any face was met, the distance is a bound only.
        location = (
            f"{length} from {nearest['part']}"
            if nearest["part"]
            else f"{length} at most, from an unknown part"
        )
        approach = f"{nearest['finger']} at {_since(begins, nearest['time_s'])} s: {location}"
    touches = [
        (
            "touch",
            f"{touch['finger']}: {counted(touch['count'], 'time')}, first at "
            f"{_since(begins, touch['first_s'])} s, {_short(touch['deepest'])} {units} deep",
        )
        for touch in report["touches"]
    ]
    return [
        ("answers", f"{', '.join(shares)}; finger lost in {_share(lost, ticks['finger_tick_count'])}"),
        ("nearest", approach),
        *(touches or [("touch", "none")]),
    ]


def _kept(report: dict[str, Any], units: str) -> Lines:
    bounds, predictions, times = report["bounds"], report["predictions"], report["certified_times"]
    kept = bounds["checked_count"] - bounds["broken_count"]
    worst = f", the worst is off by {_short(bounds['worst'])} {units}" if bounds["broken_count"] else ""
    median, most = _short(predictions["error_p50"]), _short(predictions["error_p95"])
    of_predictions = _share(predictions["kept_count"], predictions["checked_count"])
    held = times["checked_count"] - times["broken_count"]
    lines = [("bounds", f"{kept} of {bounds['checked_count']} hold, checked against exact distances{worst}")]
    if predictions["checked_count"]:
        lines.append(
            (
                "predictions",
                f"{of_predictions} within their bounds, error p50 {median}, p95 {most} {units}",
            )
        )
    if times["checked_count"]:
        lines.append(
            (
                "contact times",
                f"{held} of {times['checked_count']} certified times held "
                f"(velocity constant within {100.0 * times['velocity_share']:.0f} %)",
            )
        )
    return lines


def _times(times: TickTimes) -> dict[str, Any]:
    return {
        "p50": times.p50 / NS_PER_US,
        "p99": times.p99 / NS_PER_US,
        "p999": times.p999 / NS_PER_US,
        "max": times.max / NS_PER_US,
        "histogram": [[low / NS_PER_US, high / NS_PER_US, count] for low, high, count in times.histogram],
    }


def _share(count: int, total: int) -> str:
    return f"{100.0 * count / total:.1f} %" if total else "-"


def _since(begins: float, instant: float) -> str:
    """Seconds from a recording's first instant to another; both are off by a fraction of a microsecond."""
    return _short(round(instant - begins, CLOCK_DIGITS))


def _short(value: float) -> str:
    return f"{value + 0.0:.{SHOWN_DIGITS}g}"


def _numbers(values: list[float]) -> str:
    return "  ".join(_short(value) for value in values)
