"""``proximity compile``: write a file as a scene that opens in milliseconds."""

import os
from pathlib import Path
from typing import Annotated

import typer

from proximity.cli.options import FILE, Reading, argument, with_option_groups
from proximity.cli.output import counted, printable


@with_option_groups
def compile(
    file: FILE,
    out: Annotated[Path, argument("OUT", "File to write; its name ends in .prox.")],
    reading: Reading,
) -> None:
    """Prepare FILE for fast loading, and write it to OUT.

    OUT can be given wherever a FILE is expected. It opens in milliseconds and gives exactly the same
    answers. Another version of proximity may refuse it; compile FILE again then. An existing OUT is
    replaced only when the new one is complete.

    Examples:
      proximity compile gearbox.step gearbox.prox
      proximity compile scan.ply scan.prox --units m
      proximity query gearbox.prox 30 10 5
    """
    if _is_one_file(file, out):
        raise typer.BadParameter(f"{out} is {file} itself, expected another file", param_hint="OUT")
    from proximity.scene.saved.archive import check_extension

    check_extension(out)
    scene = reading.load(file, "compiling")
    scene.save(out)
    faces = sum(part.solid.mesh.face_count for part in scene.parts)
    size = out.stat().st_size
    typer.echo(printable(f"{out}: {counted(len(scene.parts), 'part')}, {faces} faces, {size} bytes"))


def _is_one_file(file: Path, out: Path) -> bool:
    """Whether both names lead to one file, through links of any kind."""
    try:
        return os.path.samefile(file, out)
    except (OSError, ValueError):  # one is not there, which is reported later
        return False
