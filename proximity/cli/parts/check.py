"""Commands ``proximity check`` and ``compile``, which report on a file or save it as a compiled scene."""

from pathlib import Path
from typing import Annotated

import typer

from proximity.cli import progress
from proximity.cli.options import FILES, JSON, Reading, flag, option, refuse, with_option_groups
from proximity.cli.output import counted, printable, write_document

EXIT_NO_INSIDE = 1


@with_option_groups
def check(
    files: FILES,
    as_json: JSON = False,
    list_all: Annotated[bool, flag("--all", "List all parts, not only the first 20.")] = False,
    strict: Annotated[bool, flag("--strict", "Exit with code 1 if a part has no inside.")] = False,
    limit: Annotated[float, option("S", "Longest time for a file of a folder.", min=0.1)] = 60.0,
    *,
    reading: Reading,
) -> None:
    """Report the contents of FILE, part by part; of several as one scene.

    For the whole file and for each part: length, width and height along x, y and z (of a part in its
    own frame), faces, closed shells, whether it is watertight and oriented, its volume, the method of the
    sign and its reason, the verdict of manifold3d, and repairs. An unlikely size is reported with the
    probable unit. A narrow terminal shows fewer columns; --json has all numbers.

    The exit code is 0 if the file can be read. With --strict it is 1 if a part has no inside.

    FILE may be a folder. Then every file below it is read in a separate process, and a table counts
    those loaded, noted and rejected, by kind. The exit code is 1 if one was rejected.

    Examples:
      proximity check bracket.stl
      proximity check gearbox.step --all
      proximity check gearbox.step --json
      proximity check scan.ply --units m --strict
      proximity check knob.stl plate.stl
      proximity check catalogue --limit 20
    """
    folders = [file for file in files if file.is_dir()]
    alone = f"{', '.join(map(str, folders))} is a folder, which must be the only argument"
    refuse((folders and len(files) > 1, "FILE", alone))
    if folders:
        from proximity.cli.parts.reports.folder import check_folder

        is_bad = check_folder(folders[0], reading, limit, as_json=as_json, is_strict=strict)
    else:
        from proximity.cli.parts.reports.check import print_report, report_of
        from proximity.formats import metres_per_unit

        metres, name = metres_per_unit(reading.units), " + ".join(map(str, files))
        scene = reading.load(*files)
        with progress.spinner(f"checking {name}"):
            report = report_of(scene, name, reading.units, metres)
        if as_json:
            write_document(report)
        else:
            print_report(report, is_whole=list_all)
        is_bad = strict and not all(part["has_inside"] for part in report["parts"])
    if is_bad:
        raise typer.Exit(EXIT_NO_INSIDE)


@with_option_groups
def compile(
    files: FILES,
    reading: Reading,
    out: Annotated[
        Path | None,
        option("FILE", "File to write (.prox). Default: next to FILE. Required for several files."),
    ] = None,
) -> None:
    """Write FILE as a compiled scene (.prox), which opens in milliseconds and gives the same answers.

    The parts of several files become one scene, in their positions; equal names are numbered.

    A compiled scene can be used as any FILE. Another version of proximity may reject it; compile FILE
    again then. An existing compiled scene is replaced only when the new one is complete.

    Examples:
      proximity compile gearbox.step
      proximity compile scan.ply --units m --out fast/scan.prox
      proximity compile knob.stl plate.stl --out panel.prox
      proximity compile cell.toml
      proximity query gearbox.prox 30 10 5
    """
    refuse((out is None and len(files) > 1, "--out", "several files are given, expected the file to write"))
    out = files[0].with_suffix(".prox") if out is None else out
    for file in files:
        if out.exists() and file.exists() and out.samefile(file):
            raise typer.BadParameter(f"{out} is {file} itself, expected another file", param_hint="--out")
    from proximity.scene.saved.archive import check_extension

    check_extension(out)
    scene = reading.load(*files, doing="compiling")
    scene.save(out)
    faces = sum(part.solid.mesh.face_count for part in scene.parts)
    size = out.stat().st_size
    typer.echo(printable(f"{out}: {counted(len(scene.parts), 'part')}, {faces} faces, {size} bytes"))
