"""The report of a service: at its start on stderr, at its end on stdout; or both as JSON."""

import os
import sys

import typer

from proximity.cli.console import Lines, print_block, results_console
from proximity.cli.views.json_output import write_document
from proximity.cli.wording import counted, number, printable
from proximity.service import Histogram, Report
from proximity.service.hosting import Beginning
from proximity.system.time_units import NS_PER_US

ORDINARY = "ordinary priority, memory not locked, any core; --realtime asks for more"
SHOWN_PERCENTILES = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9}


def write_beginning(beginning: Beginning, *, as_json: bool) -> None:
    """Report the start of a service: scene, addresses, rate, and what the system granted and refused.

    *as_json*: a document on stdout instead of lines on stderr.
    """
    settings = beginning.settings
    service, rate = settings.service, number(settings.service.rate_hz)
    if as_json:
        write_document(
            {
                "event": "begun",
                "pid": os.getpid(),
                "scene": settings.path,
                "publish": list(service.publish),
                "rate_hz": service.rate_hz,
                "log": service.log,
                "real_time": service.real_time,
                "finger_count": beginning.finger_count,
                "part_count": beginning.part_count,
                "face_count": beginning.face_count,
                "notes": list(beginning.notes),
            },
            indent=None,
        )
        return
    fingers = counted(beginning.finger_count, "finger")
    where = "measured by a sensor"
    if beginning.part_count:
        where = f"at {counted(beginning.part_count, 'part')}, {counted(beginning.face_count, 'face')}"
    _say(f"serving {settings.path}: {fingers} {where}")
    _say(f"{rate} Hz to {', '.join(service.publish)}{f', logged in {service.log}' if service.log else ''}")
    if not service.real_time:
        _say(ORDINARY)
    for note in beginning.notes:
        _say(note)


def write(report: Report, *, as_json: bool) -> None:
    """Write the report to stdout."""
    if as_json:
        write_document({"event": "ended", **report.as_dict()}, indent=None)
        return
    print_block(results_console(), _lines(report))
    sys.stdout.flush()


def _lines(report: Report) -> Lines:
    rate = number(1e9 / report.period_ns)
    states = ", ".join(f"{count} {state.name.lower()}" for state, count in report.states.items() if count)
    dropped = {
        "from the future": report.future,
        "backwards in time": report.backwards,
        "too old": report.too_old,
    }
    poses = ", ".join(f"{count} {why}" for why, count in dropped.items() if count)
    logged = report.log_written or report.log_lost
    return [
        ("ticks", f"{report.ticks} at {rate} Hz, {report.missed} missed"),
        ("states", states or "none"),
        ("compute", _times(report.compute)),
        ("lateness", _times(report.lateness)),
        *(
            ("published", f"{address}: {_failures(count)}")
            for address, count in report.publish_failures.items()
        ),
        *([("log", f"{report.log_written} frames, {report.log_lost} lost")] if logged else []),
        *([("poses", f"of fingers and parts, not used: {poses}")] if poses else []),
        *(("note", note) for note in report.notes),
    ]


def _times(histogram: Histogram) -> str:
    shown = [
        f"{title} {histogram.percentile(share) / NS_PER_US:.1f}" for title, share in SHOWN_PERCENTILES.items()
    ]
    return ", ".join([*shown, f"max {histogram.max_ns / NS_PER_US:.1f}"]) + " µs"


def _failures(count: int) -> str:
    return f"{counted(count, 'frame')} not taken" if count else "all frames"


def _say(sentence: str) -> None:
    typer.echo(f"proximity: {printable(sentence)}", err=True)
