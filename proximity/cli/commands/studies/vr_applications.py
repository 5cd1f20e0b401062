"""``proximity bench --vr``: VR applications with the parts of a scene, timed from pose to distance."""

import itertools
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from proximity.lab.certificate.vr_application import VrRow

POSE_RATES_HZ = (90.0, 120.0)
FINGER_COUNTS = (5, 10)


def time_applications(
    files: list[str], recording: Path | None, seconds: float, units: str, *, as_json: bool
) -> None:
    """Time each of them, and print a table or a document.

    *as_json*: a document instead of a table; times in s.
    """
    from proximity.cli import progress
    from proximity.cli.commands.service.demo import sample
    from proximity.lab.certificate.vr_application import PATHS, VrCase, measure
    from proximity.recording import read_recording

    progress.prepare_kernels()
    hand = read_recording(sample("hand.csv") if recording is None else recording)
    rows = []
    cases = list(itertools.product(PATHS, POSE_RATES_HZ, FINGER_COUNTS))
    for number, (path, rate, fingers) in enumerate(cases, start=1):
        case = VrCase(path, rate, fingers, seconds=seconds)
        with progress.spinner(f"{path}, {fingers} fingers at {rate:g} Hz, application") as count:
            count(number, len(cases))
            rows.append(measure(files, case, hand, units=units))
    if as_json:
        typer.echo(json.dumps([asdict(row) for row in rows], indent=2))
    else:
        _print(rows)


def _print(rows: "list[VrRow]") -> None:
    from proximity.cli.console import print_fitting, results_console, table
    from proximity.lab.certificate.vr_application import HEADINGS

    def across() -> "Table":
        made = table(HEADINGS[:1], HEADINGS[1:])
        for row in rows:
            made.add_row(*row.cells)
        return made

    def down() -> "Table":
        made = table(HEADINGS[:1], [row.cells[0] for row in rows])
        for heading, *cells in list(zip(HEADINGS, *(row.cells for row in rows), strict=True))[1:]:
            made.add_row(heading, *cells)
        return made

    console = results_console()
    console.print("Ticks at 1 kHz")
    print_fitting(console, [across(), down()])
