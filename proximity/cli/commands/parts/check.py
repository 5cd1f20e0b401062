"""``proximity check``: the contents of a file, what was repaired, and which sign can be trusted."""

from pathlib import Path
from typing import Annotated

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

HELP = "\n\n".join(
    (
        "Report the contents of FILE, part by part.",
        "For the whole file and for each part: length, width and height along x, y and z (of a part in its "
        "own frame), faces, closed shells, whether it is watertight and oriented, its volume, how inside "
        "and outside are decided and why, the verdict of manifold3d, and repairs. An unlikely size is "
        "reported with the probable unit. A narrow terminal shows fewer columns; --json has all numbers.",
        "The exit code is 0 if the file can be read. With --strict it is 1 if a part has no inside.",
        "FILE may be a folder. Then every file below it is read in a process of its own, and a table counts "
        "those loaded, noted and refused, by kind. The exit code is 1 if one was refused.",
    )
)

EXAMPLES = """
Examples:
  proximity check bracket.stl
  proximity check gearbox.step --all
  proximity check gearbox.step --json
  proximity check scan.ply --units m --strict
  proximity check catalogue --time-limit 20
"""

EXIT_NO_INSIDE = 1


def command(
    file: FILE,
    as_json: Annotated[bool, typer.Option("--json", help="Write one JSON document.")] = False,
    list_all: Annotated[bool, typer.Option("--all", help="List all parts, not only the first 20.")] = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit with code 1 if a part has no inside.")
    ] = False,
    time_limit: Annotated[
        float, typer.Option("--time-limit", metavar="S", min=0.1, help="Longest time for a file of a folder.")
    ] = 60.0,
    units: UNITS = "mm",
    step_tolerance: STEP_TOLERANCE = STEP_TOLERANCE_MM,
    unpacked_limit: UNPACKED_LIMIT = UNPACKED_LIMIT_GB,
) -> None:
    """Print the report of a file."""
    options = load_options(step_tolerance, unpacked_limit)
    if file.is_dir():
        words = ["--units", units, "--step-tolerance", str(step_tolerance), *["--strict"] * strict]
        _check_folder(file, [*words, "--unpacked-limit", str(unpacked_limit)], time_limit, as_json, strict)
        return
    # NumPy, Rich and the library: only now, so that --help answers at once.
    from proximity.cli import progress
    from proximity.cli.console import results_console
    from proximity.cli.views import check_report
    from proximity.formats import metres_per_unit

    metres = metres_per_unit(units)
    progress.prepare_kernels()
    with progress.spinner(f"reading {file}") as count:
        scene = proximity.load(str(file), units=units, progress=count, **options)
        report = check_report.report_of(scene, str(file), units, metres)
    if as_json:
        from proximity.cli.views.json_output import write_document

        write_document(report)
    else:
        check_report.print_report(results_console(), report, is_whole=list_all)
    if strict and not all(part["has_inside"] for part in report["parts"]):
        raise typer.Exit(EXIT_NO_INSIDE)


def _check_folder(folder: Path, words: list[str], limit: float, as_json: bool, strict: bool) -> None:
    from proximity.cli import progress
    from proximity.cli.console import results_console
    from proximity.cli.views import folder_report

    results = []
    with progress.spinner(f"reading {folder}, files") as count:
        for result in folder_report.check_files(folder, words, limit):
            results.append(result)
            count(len(results), None)
    if not results:
        raise typer.BadParameter(f"{folder} holds no file of parts", param_hint="FILE")
    if as_json:
        from proximity.cli.views.json_output import write_document

        counts = folder_report.counts_by_kind(results)
        write_document({"folder": str(folder), "counts": counts, "files": results})
    else:
        folder_report.print_folder(results_console(), results)
    parts = [part for result in results if result["report"] for part in result["report"]["parts"]]
    if any(result["reason"] for result in results) or (strict and not all(p["has_inside"] for p in parts)):
        raise typer.Exit(EXIT_NO_INSIDE)
