"""``proximity picture``: a PNG of the parts of a file, of points, and of a slice of the signed distance."""

import re
import time
from array import array
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
from proximity.cli.points import finite_number, read_points
from proximity.system.extras import installation

HELP = "\n\n".join(
    (
        "Draw the parts of FILE as a PNG file, without a screen.",
        "--points draws points and the shortest connections from them to the parts. Colours show signed "
        "distances; if there are few points, numbers do as well. --slice adds a map of the signed distance "
        "in a plane. Requires PyVista and matplotlib: "
        f"{installation('picture')}.",
    )
)

EXAMPLES = """
Examples:
  proximity picture bracket.stl -o bracket.png
  proximity picture gearbox.step --points points.csv --slice z=3 -o gearbox.png
  proximity picture bracket.stl --view front --size 800x600 -o front.png
"""

POINTS = Annotated[
    str | None,
    typer.Option("--points", metavar="FILE", help="Draw the points of a file; - is standard input."),
]
SLICE = Annotated[
    str | None,
    typer.Option(
        "--slice", metavar="AXIS=POSITION", help="Show the signed distance in a plane, for example z=3."
    ),
]
VIEW = Annotated[
    str,
    typer.Option(
        "--view", metavar="VIEW", help="View: iso, front, back, left, right, top or bottom. z is up."
    ),
]
SIZE = Annotated[str, typer.Option("--size", metavar="WxH", help="Width and height in pixels.")]
OUT = Annotated[
    Path, typer.Option("-o", "--out", metavar="FILE", help="PNG file to write. An existing file is replaced.")
]


def command(
    file: FILE,
    out: OUT,
    points: POINTS = None,
    cut: SLICE = None,
    view: VIEW = "iso",
    size: SIZE = "1400x800",
    units: UNITS = "mm",
    step_tolerance: STEP_TOLERANCE = STEP_TOLERANCE_MM,
    unpacked_limit: UNPACKED_LIMIT = UNPACKED_LIMIT_GB,
) -> None:
    """Draw a file's parts."""
    started = time.monotonic()
    if out.suffix.lower() != ".png":
        raise typer.BadParameter(f"{out} does not end in .png", param_hint="--out")
    pixels, plane = _size(size), None if cut is None else _plane(cut)
    options = load_options(step_tolerance, unpacked_limit)
    coordinates = None if points is None else _coordinates(points, units)
    # NumPy, Rich and the library: only now, so that --help and mistakes above answer at once.
    import numpy as np

    from proximity.cli import progress
    from proximity.formats import metres_per_unit
    from proximity.scene.picture import Picture, load_renderer, write_picture

    load_renderer()
    metres = metres_per_unit(units)
    progress.prepare_kernels()
    with progress.spinner(f"reading {file}") as count:
        scene = proximity.load(str(file), units=units, progress=count, **options)
    drawn = Picture(
        scene,
        file.name,
        points=None if coordinates is None else np.array(coordinates).reshape(-1, 3) * metres,
        cut=None if plane is None else (plane[0], plane[1] * metres),
        unit=units,
        metres=metres,
        view=view,
        size=pixels,
    )
    with progress.spinner(f"drawing {file}"):
        write_picture(drawn, out)
    if coordinates is not None or plane is not None:
        _note_unsigned(scene)
    typer.echo(f"{out}: {pixels[0]} x {pixels[1]} pixels, {time.monotonic() - started:.1f} s")


def _note_unsigned(scene: "proximity.Scene") -> None:
    """Say on stderr that distances have no sign, where that is so."""
    count = sum(not part.solid.has_inside for part in scene.parts)
    if count:
        typer.echo(
            f"proximity: note: parts without an inside: {count} of {len(scene.parts)}; "
            "distances from them have no sign, and `proximity check` says why",
            err=True,
        )


def _size(text: str) -> tuple[int, int]:
    sides = re.fullmatch(r"(\d{1,6})\s*[xX×]\s*(\d{1,6})", text)
    if sides is None:
        raise typer.BadParameter(
            f"{text!r}: expected width and height, for example 1400x800", param_hint="--size"
        )
    return int(sides[1]), int(sides[2])


def _plane(text: str) -> tuple[str, float]:
    axis, equals, position = text.partition("=")
    axis = axis.strip().lower()
    if axis not in ("x", "y", "z") or not equals:
        raise typer.BadParameter(
            f"{text!r}: expected an axis and a position, for example z=3", param_hint="--slice"
        )
    try:
        return axis, finite_number(position)
    except ValueError as unfit:
        raise typer.BadParameter(str(unfit), param_hint="--slice") from unfit


def _coordinates(path: str, units: str) -> array:
    coordinates = array("d")
    for chunk in read_points(path, units):
        coordinates.extend(chunk.coordinates)
    return coordinates
