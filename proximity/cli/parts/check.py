"""``proximity check``: the contents of a file, what was repaired, and which sign can be trusted."""

from typing import Annotated

import typer

from proximity.cli.options import FILE, Reading, flag, option, with_option_groups
from proximity.cli.output import write_document

EXIT_NO_INSIDE = 1


@with_option_groups
def check(
    file: FILE,
    as_json: Annotated[bool, flag("--json", "Write one JSON document.")] = False,
    list_all: Annotated[bool, flag("--all", "List all parts, not only the first 20.")] = False,
    strict: Annotated[bool, flag("--strict", "Exit with code 1 if a part has no inside.")] = False,
    time_limit: Annotated[float, option("S", "Longest time for a file of a folder.", min=0.1)] = 60.0,
    *,
    reading: Reading,
) -> None:
    """Report the contents of FILE, part by part.

    For the whole file and for each part: length, width and height along x, y and z (of a part in its
    own frame), faces, closed shells, whether it is watertight and oriented, its volume, how inside and
    outside are decided and why, the verdict of manifold3d, and repairs. An unlikely size is reported
    with the probable unit. A narrow terminal shows fewer columns; --json has all numbers.

    The exit code is 0 if the file can be read. With --strict it is 1 if a part has no inside.

    FILE may be a folder. Then every file below it is read in a process of its own, and a table counts
    those loaded, noted and refused, by kind. The exit code is 1 if one was refused.

    Examples:
      proximity check bracket.stl
      proximity check gearbox.step --all
      proximity check gearbox.step --json
      proximity check scan.ply --units m --strict
      proximity check catalogue --time-limit 20
    """
    if file.is_dir():
        from proximity.cli.parts.folder_report import check_folder

        is_bad = check_folder(file, reading, time_limit, as_json=as_json, is_strict=strict)
    else:
        from proximity.cli import progress
        from proximity.cli.parts.check_report import print_report, report_of

        metres = reading.metres
        scene = reading.load(file)
        with progress.spinner(f"checking {file}"):
            report = report_of(scene, str(file), reading.units, metres)
        if as_json:
            write_document(report)
        else:
            print_report(report, is_whole=list_all)
        is_bad = strict and not all(part["has_inside"] for part in report["parts"])
    if is_bad:
        raise typer.Exit(EXIT_NO_INSIDE)
