"""``proximity compile``: write a file as a scene that opens in milliseconds."""

import os
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
        "Prepare FILE for fast loading, and write it to OUT.",
        "OUT can be given wherever a FILE is expected. It opens in milliseconds and gives exactly the same "
        "answers. Another version of proximity may refuse it; compile FILE again then. An existing OUT is "
        "replaced only when the new one is complete.",
    )
)

EXAMPLES = """
Examples:
  proximity compile gearbox.step gearbox.prox
  proximity compile scan.ply scan.prox --units m
  proximity query gearbox.prox 30 10 5
"""


def command(
    file: FILE,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="File to write; its name ends in .prox.")],
    units: UNITS = "mm",
    step_tolerance: STEP_TOLERANCE = STEP_TOLERANCE_MM,
    unpacked_limit: UNPACKED_LIMIT = UNPACKED_LIMIT_GB,
) -> None:
    """Write the scene in a file as a compiled one."""
    options = load_options(step_tolerance, unpacked_limit)
    if _is_one_file(file, out):
        raise typer.BadParameter(f"{out} is {file} itself, expected another file", param_hint="OUT")
    # Rich and the library: only now, so that --help and mistakes above answer at once.
    from proximity.cli import progress
    from proximity.cli.wording import printable
    from proximity.scene.saved.archive import check_extension

    check_extension(out)
    progress.prepare_kernels()
    with progress.spinner(f"compiling {file}") as count:
        scene = proximity.load(str(file), units=units, progress=count, **options)
        scene.save(out)
    face_count = sum(part.solid.mesh.face_count for part in scene.parts)
    parts = "1 part" if len(scene.parts) == 1 else f"{len(scene.parts)} parts"
    typer.echo(printable(f"{out}: {parts}, {face_count} faces, {out.stat().st_size} bytes"))


def _is_one_file(file: Path, out: Path) -> bool:
    """Whether both names lead to one file, through links of any kind."""
    try:
        return os.path.samefile(file, out)
    except (OSError, ValueError):  # one is not there, which is reported later
        return False
