"""``proximity picture``: a PNG of the parts of a file, of points, and of a slice of the signed distance."""

import math
import re
import time
from pathlib import Path
from typing import Annotated

import typer

from proximity.cli import progress
from proximity.cli.options import FILE, Reading, option, with_option_groups
from proximity.cli.output import report
from proximity.cli.parts.points import number, read_points


@with_option_groups
def picture(
    file: FILE,
    out: Annotated[Path, option("FILE", "PNG file to write. An existing file is replaced.", "-o", "--out")],
    points: Annotated[str | None, option("FILE", "Draw the points of a file; - is standard input.")] = None,
    cut: Annotated[
        str | None,
        option("AXIS=POSITION", "Show the signed distance in a plane, for example z=3.", "--slice"),
    ] = None,
    reach: Annotated[
        float | None,
        option("LENGTH", "Distance at the ends of the colour bar of the points, in --units.", "--range"),
    ] = None,
    view: Annotated[
        str, option("VIEW", "View: iso, front, back, left, right, top or bottom. z is up.")
    ] = "iso",
    size: Annotated[str, option("WxH", "Width and height in pixels.")] = "1400x800",
    *,
    reading: Reading,
) -> None:
    """Draw the parts of FILE as a PNG file, without a screen.

    --points draws points and the shortest connections from them to the parts. Colours show signed
    distances; if there are few points, numbers do as well. --slice adds a map of the signed distance in
    a plane. Requires PyVista and matplotlib: pip install "cad-proximity[picture]", or in a checkout
    pip install -e ".[picture]".

    Examples:
      proximity picture bracket.stl -o bracket.png
      proximity picture gearbox.step --points points.csv --slice z=3 -o gearbox.png
      proximity picture bracket.stl --view front --size 800x600 -o front.png
    """
    started = time.monotonic()
    if out.suffix.lower() != ".png":
        raise typer.BadParameter(f"{out} does not end in .png", param_hint="--out")
    if reach is not None and not (points is not None and 0.0 < reach < math.inf):
        raise typer.BadParameter(f"{reach}: expected a length above 0, with --points", param_hint="--range")
    pixels, plane = _size(size), None if cut is None else _plane(cut)
    rows = None if points is None else [chunk.coordinates for chunk in read_points(points, reading.units)]
    import numpy as np

    from proximity.formats import metres_per_unit
    from proximity.scene.picture import Picture, load_renderer, write_picture

    load_renderer()
    metres, scene = metres_per_unit(reading.units), reading.load(file)
    drawn = Picture(
        scene,
        file.name,
        points=None if rows is None else np.concatenate(rows).reshape(-1, 3) * metres,
        cut=None if plane is None else (plane[0], plane[1] * metres),
        unit=reading.units,
        metres=metres,
        view=view,
        size=pixels,
        reach=None if reach is None else reach * metres,
    )
    with progress.spinner(f"drawing {file}"):
        write_picture(drawn, out)
    without = sum(not part.solid.has_inside for part in scene.parts)
    if without and (points is not None or plane is not None):
        report(
            f"note: parts without an inside: {without} of {len(scene.parts)}; "
            "distances from them have no sign, and `proximity check` says why"
        )
    typer.echo(f"{out}: {pixels[0]} x {pixels[1]} pixels, {time.monotonic() - started:.1f} s")


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
        return axis, number(position, is_finite=True)
    except ValueError as unfit:
        raise typer.BadParameter(str(unfit), param_hint="--slice") from unfit
