"""Command ``proximity thickness``, which finds the thinnest walls of parts."""

import csv
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from proximity.cli import progress
from proximity.cli.options import (
    FILE_HELP,
    JSON,
    Reading,
    argument,
    option,
    refuse,
    with_option_groups,
    within,
)
from proximity.cli.output import (
    counted,
    in_unit,
    length,
    number,
    print_block,
    printable,
    text_output,
    write_document,
)
from proximity.system.table_text import table_text

if TYPE_CHECKING:
    import proximity

EXIT_THIN, EXIT_UNDECIDED = 1, 3
DIGITS, MAX_SHOWN = 6, 20
Values = dict[str, Any]


@with_option_groups
def thickness(
    words: Annotated[
        list[str], argument("FILE [PART...]", f"{FILE_HELP} Then some of its parts; 'bolt*' names several.")
    ],
    below: Annotated[
        float | None,
        option("LENGTH", "Exit with code 1 if a wall is thinner.", callback=within(0.0, is_open=True)),
    ] = None,
    resolution: Annotated[
        float | None,
        option("LENGTH", "Longest edge of the samples of the surface.", callback=within(0.0, is_open=True)),
    ] = None,
    wall_angle: Annotated[
        float,
        option(
            "DEGREES", "Largest angle between the sides of a wall.", callback=within(0.0, 85.0, "degrees")
        ),
    ] = 45.0,
    csv_path: Annotated[
        Path | None, option("FILE", "Write the thinnest positions to a CSV file, too.", "--csv")
    ] = None,
    report: Annotated[
        Path | None, option("FILE", "With --below: write a page with a picture of the thickness, too.")
    ] = None,
    as_json: JSON = False,
    *,
    reading: Reading,
) -> None:
    """Find the thinnest walls of the parts of FILE, and certify their least thickness.

    The thickness at a point of a face is the length of the line into the material, against the normal,
    up to where it leaves the part. It is that of a wall if the two faces are parallel within --wall-angle:
    a wedge that is sharper is a wall of thickness 0 at its edge, and a blunter one is a corner.

    The least thickness has two bounds, over all points of the surface. Samples give the share of the
    surface below the limit, and the thinnest positions. With --below the exit code is 0 if certainly no
    wall is thinner, 1 if one is, and 3 if the bounds do not decide.

    Examples:
      proximity thickness housing.stl
      proximity thickness housing.stl --below 1.2
      proximity thickness gearbox.step lid 'cover*' --below 2 --csv thin.csv
      proximity thickness housing.stl --below 1.2 --report thickness.html
    """
    file, *names = words
    refuse(
        (report is not None and below is None, "--report", "requires --below"),
        (
            report is not None and report.suffix.lower() != ".html",
            "--report",
            f"{report} does not end in .html",
        ),
    )
    if report is not None:
        from proximity.cli.parts.reports.scan import check_libraries

        check_libraries()
    from proximity.cli.parts.measured_pairs import matching
    from proximity.formats import metres_per_unit

    metres, scene = metres_per_unit(reading.units), reading.load(Path(file))
    chosen = dict.fromkeys(found for name in names for found in matching(scene, name))
    parts = [part for part in scene.parts if part.name in chosen or not names]
    with progress.spinner(f"measuring {file}"):
        walls = [
            part.thin_places(
                below=None if below is None else below * metres,
                resolution=None if resolution is None else resolution * metres,
                wall_angle=math.radians(wall_angle),
                workers=-1,
            )
            for part in parts
        ]
    values = [_values(part, each, metres) for part, each in zip(parts, walls, strict=True)]
    sentence, code = _verdict(values, below, reading.units)
    if csv_path is not None:
        _write_csv(csv_path, values, reading.units)
    if report is not None:
        with progress.spinner(f"drawing {file}"):
            _write_report(report, Path(file).name, scene, walls, values, below or 0.0, reading.units)
    if as_json:
        said = {"below": below, "wall_angle": wall_angle, "verdict": sentence}
        write_document({"file": file, "units": reading.units, **said, "parts": values})
    else:
        _print(values, below, reading.units)
        if sentence:
            typer.echo(sentence)
    if code:
        raise typer.Exit(code)


def _values(part: "proximity.Part", found: "proximity.ThinWalls", metres: float) -> Values:
    """Return the values of a part in the user's unit."""
    rows = zip(found.thickness, found.points, found.opposites, found.face_ids, strict=True)
    return {
        "part": part.name,
        "least": in_unit(found.upper, metres),
        "lower": in_unit(found.lower, metres),
        "point": [in_unit(each, metres) for each in found.point],
        "opposite": [in_unit(each, metres) for each in found.opposite],
        "is_thin": found.is_thin,
        "share": found.share,
        "resolution": in_unit(found.resolution, metres),
        "positions": [
            {
                "thickness": in_unit(thickness, metres),
                "point": [in_unit(each, metres) for each in point],
                "opposite": [in_unit(each, metres) for each in opposite],
                "face": int(part.source_faces[face]),
            }
            for thickness, point, opposite, face in rows
        ],
    }


def _verdict(values: list[Values], below: float | None, units: str) -> tuple[str, int]:
    """Return a sentence about the limit, and the exit code."""
    if below is None:
        return "", 0
    limit = f"{length(below)} {units}"
    thin = [each for each in values if each["is_thin"]]
    undecided = [each for each in values if each["is_thin"] is None]
    if thin:
        least = min(thin, key=lambda each: float(each["least"]))
        found = f"{length(least['least'], DIGITS)} {units} ({printable(least['part'])})"
        of = "" if len(values) == 1 else f" in {len(thin)} of {counted(len(values), 'part')}"
        return f"Walls are thinner than {limit}{of}: the least is {found}.", EXIT_THIN
    if undecided:
        lower = length(min(each["lower"] for each in undecided), DIGITS)
        return (
            f"Undecided: no wall thinner than {limit} was found, but {lower} {units} is possible.",
            EXIT_UNDECIDED,
        )
    return f"No wall is thinner than {limit}.", 0


def _write_report(
    path: Path,
    name: str,
    scene: "proximity.Scene",
    walls: list["proximity.ThinWalls"],
    values: list[Values],
    below: float,
    units: str,
) -> None:
    from proximity.cli.parts.reports.thickness import Page, write_report
    from proximity.formats import metres_per_unit
    from proximity.scene.picture.thickness_map import draw_thickness

    limit, metres = f"{length(below)} {units}", metres_per_unit(units)
    summary = []
    for each in values:
        least, lower = _bounds(each)
        share = f"{_percent(each['share'])} of the surface is below {limit}"
        summary.append(f"{printable(each['part'])}: least {least}, certain {lower} {units}; {share}.")
    sentence, code = _verdict(values, below, units)
    rows = _position_titles(units), _position_rows(values)
    page = Page(f"Thickness of {printable(name)}", sentence, code == 0, summary, limit, *rows)
    write_report(path, page, lambda: draw_thickness(scene, walls, below * metres, unit=units, metres=metres))


def _position_rows(values: list[Values]) -> list[tuple[str, ...]]:
    """Return number, thickness, x, y, z, face and part of the thinnest positions, as text."""
    rows = ((part, position) for part in values for position in part["positions"])
    return [
        (str(row), length(each["thickness"], DIGITS), *(length(axis, DIGITS) for axis in each["point"]),
         str(each["face"]), printable(part["part"]))
        for row, (part, each) in enumerate(rows, 1)
    ]  # fmt: skip


def _position_titles(units: str) -> list[str]:
    """Return the titles of the columns of `_position_rows`."""
    return ["#", f"thickness [{units}]", *(f"{axis} [{units}]" for axis in "xyz"), "face", "part"]


def _print(values: list[Values], below: float | None, units: str) -> None:
    from proximity.cli.tables import results_console, table_of

    is_one = len(values) == 1
    if is_one:
        print_block(_lines(values[0], below, units))
    else:
        titles = [("part", False), (f"least [{units}]", True), (f"certain [{units}]", True)]
        titles += [] if below is None else [(f"below {length(below)} {units}", True)]
        rows = [
            [printable(each["part"]), *_bounds(each), *([] if below is None else [_percent(each["share"])])]
            for each in values
        ]
        results_console().print(table_of(titles, rows))
    listed = _position_rows(values)[:MAX_SHOWN] if is_one or below is not None else []
    if listed:
        shown = 6 if is_one else 7  # without the part
        heads = [(title, title != "part") for title in _position_titles(units)]
        results_console().print(table_of(heads[:shown], [row[:shown] for row in listed]))


def _bounds(part: Values) -> tuple[str, str]:
    least, lower = (part[name] for name in ("least", "lower"))
    return (
        "no wall" if math.isinf(least) else length(least, DIGITS),
        "-" if math.isinf(lower) else length(lower, DIGITS),
    )


def _percent(share: float) -> str:
    """Return a share in per cent, rounded up, so that 0 % means none."""
    return f"{number(math.ceil(1e3 * share) / 10)} %"


def _lines(part: Values, below: float | None, units: str) -> list[tuple[str, str]]:
    if math.isinf(part["lower"]):
        return [("least", "the part has no wall")]
    least, lower = _bounds(part)
    is_found = math.isfinite(part["least"])
    rows = [("least", f"{least} {units}" if is_found else "no wall was found")]
    rows.append(("certain", f"nowhere less than {lower} {units}"))
    for end, point in (("from", part["point"]), ("to", part["opposite"])) if is_found else ():
        rows.append((end, f"{'  '.join(length(axis, DIGITS) for axis in point)} {units}"))
    if below is not None:
        rows.append(("share", f"{_percent(part['share'])} of the surface is below {length(below)} {units}"))
    return rows


def _write_csv(path: Path, values: list[Values], units: str) -> None:
    """Write a CSV file with a line for each of the thinnest positions."""
    with text_output(path) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        ends = [f"{end}{axis}_{units}" for end in ("", "opposite_") for axis in "xyz"]
        writer.writerow(["part", f"thickness_{units}", *ends, "face"])
        for part in values:
            for each in part["positions"]:
                points = *each["point"], *each["opposite"]
                writer.writerow([table_text(part["part"]), each["thickness"], *points, each["face"]])
