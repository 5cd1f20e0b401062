"""``proximity check``: what a file holds, what was repaired, and which sign can be trusted."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

import proximity
from proximity.cli.options import (
    FILE,
    STEP_TOLERANCE,
    STEP_TOLERANCE_MM,
    UNITS,
    UNPACKED_LIMIT,
    UNPACKED_LIMIT_GB,
    load_options,
)

if TYPE_CHECKING:
    from proximity.cli.console import Console

HELP = "\n\n".join(
    (
        "Report what FILE holds, part by part.",
        "For each part: faces, closed shells, whether it is watertight and oriented, its volume, what was "
        "repaired, how the sign of distances is known and why, and what manifold3d says of it.",
        "The exit code is 0 whenever a report can be made; with --strict it is 1 if some part has no inside.",
    )
)

EXAMPLES = """
Examples:
  proximity check bracket.stl
  proximity check gearbox.step --json
  proximity check scan.ply --units m --strict
"""

EXIT_NO_INSIDE = 1
NAMES_SHOWN = 3  # parts named with a remark; the others are counted


def command(
    file: FILE,
    as_json: Annotated[bool, typer.Option("--json", help="Write one JSON document.")] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 if some part has no inside.")] = False,
    units: UNITS = "mm",
    step_tolerance: STEP_TOLERANCE = STEP_TOLERANCE_MM,
    unpacked_limit: UNPACKED_LIMIT = UNPACKED_LIMIT_GB,
) -> None:
    """Print the report of a file."""
    options = load_options(step_tolerance, unpacked_limit)
    # NumPy, Rich and the library: only now, so that --help answers at once.
    from proximity.cli import waiting
    from proximity.cli.console import Console
    from proximity.cli.tables import UNBOUNDED
    from proximity.meshio import metres_per_unit

    metres = metres_per_unit(units)
    waiting.prepare_kernels()
    with waiting.spinner(f"reading {file}"):
        report = _report(proximity.load(str(file), units=units, **options), str(file), units, metres)
    if as_json:
        import json

        from proximity.cli.output import plain

        typer.echo(json.dumps(plain(report), allow_nan=False, indent=1))
    else:
        console = Console()
        _print(console if console.is_terminal else Console(width=UNBOUNDED), report)
    if strict and not all(part["has_inside"] for part in report["parts"]):
        raise typer.Exit(EXIT_NO_INSIDE)


def _report(scene: "proximity.Scene", file: str, units: str, metres: float) -> dict[str, Any]:
    """Return all that is told, as plain values; lengths, areas and volumes in the unit."""
    told = scene.report
    assert told is not None, "a scene read from a file has a report"
    return {
        "file": file,
        "compiled_from": told.path if told.path != file else None,
        "format": told.format,
        "file_units": told.units,
        "file_units_declared": told.units_declared,
        "notes": list(told.notes),
        "units": units,
        "parts": [_part_report(part, metres) for part in scene.parts],
    }


def _part_report(part: "proximity.Part", metres: float) -> dict[str, Any]:
    found = part.solid.diagnosis
    return {
        "name": part.name,
        "face_count": found.face_count,
        "vertex_count": found.vertex_count,
        "shell_count": found.shell_count,
        "boundary_edge_count": found.boundary_edge_count,
        "nonmanifold_edge_count": found.nonmanifold_edge_count,
        "misoriented_edge_count": found.misoriented_edge_count,
        "is_watertight": found.is_watertight,
        "is_oriented": found.is_oriented,
        "volume": float(found.volume) / metres**3,
        "area": float(found.area) / metres**2,
        "lower": [float(value) / metres for value in found.lower],
        "upper": [float(value) / metres for value in found.upper],
        "has_inside": bool(part.solid.has_inside),
        "sign_method": part.solid.sign_method.value,
        "sign_reason": part.solid.sign_reason,
        "repairs": _repairs(part.repairs, metres),
        "repairs_described": part.repairs.describe(),
        "manifold": {"is_solid": found.is_solid_by_manifold, "status": found.manifold_status},
    }


def _repairs(repairs: Any, metres: float) -> dict[str, Any]:
    counts = asdict(repairs)
    return {**counts, "weld_distance": float(counts["weld_distance"]) / metres}


def _print(console: "Console", report: dict[str, Any]) -> None:
    from proximity.cli.blocks import print_block

    parts = report["parts"]
    declared = "declared by the file" if report["file_units_declared"] else "assumed: the file declares none"
    print_block(
        console,
        [
            ("file", report["file"]),
            *([("compiled from", report["compiled_from"])] if report["compiled_from"] else []),
            ("format", report["format"]),
            ("units of file", f"{report['file_units']} ({declared})"),
            ("parts", str(len(parts))),
            *(("note", note) for note in report["notes"]),
        ],
    )
    console.print()
    _print_parts(console, parts, report["units"])
    console.print()
    remarks = [
        *_grouped(parts, "sign", lambda part: f"{part['sign_method']}: {part['sign_reason']}"),
        *_grouped(parts, "repaired", lambda part: part["repairs_described"]),
        *_grouped(parts, "no inside", lambda part: "" if part["has_inside"] else "distances are unsigned"),
    ]
    print_block(console, remarks)


def _print_parts(console: "Console", parts: list[dict[str, Any]], units: str) -> None:
    from rich.table import Table
    from rich.text import Text

    from proximity.cli.wording import number, printable

    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("part", overflow="fold")
    for title in ("faces", "shells"):
        table.add_column(title, justify="right", overflow="fold")
    table.add_column("watertight", overflow="fold")
    table.add_column("oriented", overflow="fold")
    volume = f"volume [{units}\N{SUPERSCRIPT THREE}]".replace("[", "\\[")
    table.add_column(volume, justify="right", overflow="fold")
    table.add_column("sign", overflow="fold")
    table.add_column("manifold3d", overflow="fold")
    for part in parts:
        cells = (
            printable(part["name"]),
            str(part["face_count"]),
            str(part["shell_count"]),
            _yes(part["is_watertight"]),
            _yes(part["is_oriented"]),
            number(part["volume"]),
            part["sign_method"],
            "solid" if part["manifold"]["is_solid"] else f"no: {part['manifold']['status']}",
        )
        table.add_row(*map(Text, cells))
    console.print(table)


def _yes(truth: bool) -> str:
    return "yes" if truth else "no"


def _grouped(parts: list[dict[str, Any]], label: str, sentence_of: Any) -> list[tuple[str, str]]:
    """Say each sentence once, with the parts it is about."""
    names: dict[str, list[str]] = {}
    for part in parts:
        names.setdefault(sentence_of(part), []).append(part["name"])
    names.pop("", None)
    return [(label, f"{sentence} ({_listed(about)})") for sentence, about in names.items()]


def _listed(names: list[str]) -> str:
    shown = ", ".join(names[:NAMES_SHOWN])
    rest = len(names) - NAMES_SHOWN
    return f"{shown} and {rest} more" if rest > 0 else shown
