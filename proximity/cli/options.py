"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer


def _complete_units(incomplete: str) -> list[str]:
    from proximity.meshio import UNITS as known  # slow, and only for the one who presses Tab here

    return [name for name in known if name.startswith(incomplete)]


FILE = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="STL, OBJ, PLY, OFF, glTF/GLB, 3MF or STEP, or a compiled scene."),
]

UNITS = Annotated[
    str,
    typer.Option(
        "--units",
        metavar="UNIT",
        autocompletion=_complete_units,
        help="Of coordinates and of answers, and of a file that declares none: m, cm, mm, um, in, ft ...",
    ),
]
