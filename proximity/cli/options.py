"""Options that several commands share."""

import math
from pathlib import Path
from typing import Annotated

import typer

LONGEST_S = 1e9


def _complete_units(incomplete: str) -> list[str]:
    from proximity.formats import UNITS as known  # slow, and only for the one who presses Tab here

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

STEP_TOLERANCE = Annotated[
    float,
    typer.Option(
        "--step-tolerance",
        metavar="MM",
        help="How far triangles may leave the curved faces of a STEP file; distances are exact to these.",
    ),
]
STEP_TOLERANCE_MM = 0.01

UNPACKED_LIMIT = Annotated[
    float,
    typer.Option(
        "--unpacked-limit", metavar="GB", help="What a 3MF file, which is an archive, may unpack to."
    ),
]
UNPACKED_LIMIT_GB = 2.0

ADDRESS = Annotated[
    str,
    typer.Argument(
        metavar="ADDRESS", help="iox2://NAME on this machine, udp://HOST:PORT to listen at, zenoh://KEY."
    ),
]

LIMIT = Annotated[
    float | None, typer.Option("--limit", metavar="SECONDS", help="End after that; else when told to.")
]


def check_limit(limit: float | None) -> None:
    """Refuse what is no time to go on for, nan included.

    Parameters
    ----------
    limit : float, s
        None: until told to stop.
    """
    if limit is not None and not 0.0 < limit <= LONGEST_S:
        raise typer.BadParameter(
            f"{limit:g} seconds: expected more than 0, up to {LONGEST_S:g}", param_hint="--limit"
        )


def load_options(step_tolerance: float, unpacked_limit: float) -> dict[str, float]:
    """Return what `proximity.load` calls these options, in its units.

    Parameters
    ----------
    step_tolerance : float, mm
        Above 0.
    unpacked_limit : float, GB
        Above 0.
    """
    for name, value in (("--step-tolerance", step_tolerance), ("--unpacked-limit", unpacked_limit)):
        if not 0.0 < value < math.inf:
            raise typer.BadParameter(f"{value:g}: expected more than 0", param_hint=name)
    return {"step_tolerance": step_tolerance / 1e3, "unpacked_limit": unpacked_limit * 1e9}
