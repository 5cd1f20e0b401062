"""``proximity bench --vr``: VR applications with the parts of a scene, timed from pose to distance."""

import itertools
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from proximity.certificate.vr_application import VrRow

POSE_RATES_HZ = (90.0, 120.0)
FINGER_COUNTS = (5, 10)


def time_applications(
    files: list[str], recording: Path | None, seconds: float, units: str, *, as_json: bool
) -> None:
    """Time each of them, and print a table or a document.

    Parameters
    ----------
    files : list of str
        Of parts.
    recording : Path
        Of a hand; None: the sample.
    seconds : float, s
        That each runs.
    units : str
        Of files that declare none.
    as_json : bool
        A document instead of a table; times in s.
    """
    from proximity.certificate.vr_application import PATHS, VrCase, measure
    from proximity.cli import progress
    from proximity.cli.commands.service.demo import sample
    from proximity.recording import read_recording

    progress.prepare_kernels()
    hand = read_recording(sample("hand.csv") if recording is None else recording)
    rows = []
    for path, rate, count in itertools.product(PATHS, POSE_RATES_HZ, FINGER_COUNTS):
        case = VrCase(path, rate, count, seconds=seconds)
        with progress.spinner(f"{path}, {count} fingers at {rate:g} Hz"):
            rows.append(measure(files, case, hand, units=units))
    if as_json:
        typer.echo(json.dumps([asdict(row) for row in rows], indent=2))
    else:
        _print(rows)


def _print(rows: "list[VrRow]") -> None:
    from rich.table import Table

    from proximity.cli.console import Console

    table = Table(box=None, title=f"{rows[0].face_count:,} faces, ticks at 1 kHz", title_justify="left")
    for name in (
        "application", "poses", "fingers", "to distance p50", "p99", "p99.9, ms", "of a frame",
        "tick p50", "p99, µs", "of 1 ms", "service", "bridge, cores",
    ):  # fmt: skip
        table.add_column(name, justify="left" if name == "application" else "right")
    for row in rows:
        times = (row.motion_to_distance_p50, row.motion_to_distance_p99, row.motion_to_distance_p999)
        table.add_row(
            row.case.path,
            f"{row.case.pose_rate_hz:g} Hz",
            f"{row.case.finger_count}",
            *(f"{1e3 * each:.2f}" for each in times),
            f"{row.frame_share:.0%}",
            f"{1e6 * row.tick_p50:.0f}",
            f"{1e6 * row.tick_p99:.0f}",
            f"{row.sample_share:.1%}",
            *("" if each != each else f"{each:.2f}" for each in (row.service_share, row.bridge_share)),
        )
    Console().print(table)
