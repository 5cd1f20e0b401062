"""Command ``proximity picture``, which draws parts, points and a slice of the signed distance as a PNG."""

import re
import sys
import time
from array import array
from pathlib import Path
from typing import Annotated

import typer

from proximity.cli import progress
from proximity.cli.options import FILE, POINTS_UNITS, Reading, option, with_option_groups
from proximity.cli.output import report
from proximity.cli.parts.points import number, read_ahead, read_points


@with_option_groups
def picture(
    file: FILE,
    out: Annotated[Path, option("FILE", "PNG file to write. An existing file is replaced.", "-o", "--out")],
    points: Annotated[str | None, option("FILE", "Draw the points of a file; - is standard input.")] = None,
    points_units: POINTS_UNITS = None,
    cut: Annotated[
        str | None,
        option("AXIS=POSITION", "Show the signed distance in a plane, for example z=3.", "--slice"),
    ] = None,
    reach: Annotated[
        str | None,
        option(
            "LENGTH",
            "Distance at both ends of the colour bar of the points, in --units; or two, as in -0.05,0.2.",
            "--range",
        ),
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
    distances, and so do numbers if there are few points. --slice adds a map of the signed distance in
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
    ends = None if reach is None else _ends(reach, has_points=points is not None)
    pixels, plane = _size(size), None if cut is None else _plane(cut)
    rows: list[array[float]] | None = None
    sides: list[float] = []
    if points is not None:
        chunks, sides = read_ahead(read_points(points, reading.units, points_units=points_units), sys.maxsize)
        rows = [chunk.coordinates for chunk in chunks]
    import numpy as np

    from proximity.cli.parts.deviations import check_unit
    from proximity.formats import metres_per_unit
    from proximity.scene.picture import Picture, load_renderer, write_picture

    load_renderer()
    metres, scene = metres_per_unit(reading.units), reading.load(file)
    if points_units is None:
        check_unit(sides, scene, reading.units, is_gate=False)
    drawn = Picture(
        scene,
        file.name,
        points=None if rows is None else np.concatenate(rows).reshape(-1, 3) * metres,
        cut=None if plane is None else (plane[0], plane[1] * metres),
        unit=reading.units,
        metres=metres,
        view=view,
        size=pixels,
        reach=None if ends is None else (ends[0] * metres, ends[1] * metres),
    )
    with progress.spinner(f"drawing {file}"):
        write_picture(drawn, out)
    without = sum(not part.solid.has_inside for part in scene.parts)
    if without and (points is not None or plane is not None):
        report(
            f"note: parts without an inside: {without} of {len(scene.parts)}; "
            "distances from them have no sign, and `proximity check` gives the reason"
        )
    typer.echo(f"{out}: {pixels[0]} x {pixels[1]} pixels, {time.monotonic() - started:.1f} s")


def _ends(text: str, *, has_points: bool) -> tuple[float, float]:
    """Return the ends of the colour bar.

    The text has one length for both sides of zero, or a negative and a positive number.
    """
    try:
        first, *more = (number(word, is_finite=True) for word in text.split(","))
        low, high = (-first, first) if not more else (first, *more)
    except ValueError:
        low = high = 0.0
    if not (has_points and low < 0.0 < high):
        expected = "a length above 0, or two as in -0.05,0.2, with --points"
        raise typer.BadParameter(f"{text}: expected {expected}", param_hint="--range")
    return low, high


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
    except ValueError as invalid:
        raise typer.BadParameter(str(invalid), param_hint="--slice") from invalid
