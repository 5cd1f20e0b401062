"""``proximity query``: distances from points, rays or segments to the parts of a file."""

from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from proximity.cli.options import (
    FILE,
    JSON,
    POINTS_UNITS,
    Reading,
    argument,
    flag,
    option,
    refuse,
    with_option_groups,
)
from proximity.cli.options import within as in_range
from proximity.cli.output import STDOUT, report, text_output
from proximity.cli.parts.points import STANDARD_INPUT, Points, number, read_ahead, read_points
from proximity.errors import ArgumentError
from proximity.system.memory import collector_paused

EXIT_FARTHER = 1
MAX_NEAREST = 10_000  # parts
POINTS_AHEAD = 1_000_000  # read before the first answer, to compare the size of a file with that of the parts
POINTS_PER_CHUNK = 20_000  # bounds the memory and the delay of the bar and of Ctrl-C


@dataclass(frozen=True, slots=True)
class Lines:
    """Options for rays and segments instead of points."""

    ray: Annotated[
        tuple[str, str, str] | None, option("DX DY DZ", "Cast a ray from each point in this direction.")
    ] = None
    cast_all: Annotated[
        bool, flag("--all", "Report every crossing along each ray, not only the first hit.")
    ] = False
    min_distance: Annotated[
        float | None,
        option("LENGTH", "Skip hits of a ray that are nearer than this.", callback=in_range(0.0)),
    ] = None
    segment: Annotated[bool, flag("--segment", "Use the points in pairs: start and end of a segment.")] = (
        False
    )


@dataclass(frozen=True, slots=True)
class Output:
    """Options for the form of the answers, and for a verdict."""

    as_json: JSON = False
    csv: Annotated[Path | None, option("FILE", "Write CSV to this file; - is standard output.")] = None
    within: Annotated[
        float | None,
        option(
            "LENGTH",
            "Exit with code 1 if a point is farther than this from the surface.",
            callback=in_range(0.0),
        ),
    ] = None
    report_page: Annotated[
        Path | None,
        option(
            "FILE", "Write a page (.html) with a verdict by --within, a picture and a histogram.", "--report"
        ),
    ] = None


@with_option_groups
def query(
    file: FILE,
    coordinates: Annotated[
        list[str] | None,
        argument("X Y Z", "Coordinates of one or more points. Negative numbers are allowed."),
    ] = None,
    points: Annotated[
        str | None, option("FILE", "Read the points from a text, PLY, STL or OBJ file; - is standard input.")
    ] = None,
    points_units: POINTS_UNITS = None,
    nearest: Annotated[
        int | None,
        option(
            "K",
            "Report the K nearest parts of each point, the nearest first.",
            callback=in_range(1, MAX_NEAREST),
        ),
    ] = None,
    cad: Annotated[
        bool, flag("--cad", "Report bounds of the distance to the CAD surfaces of STEP files, too.")
    ] = False,
    *,
    along: Lines,
    output: Output,
    workers: Annotated[int, option("N", "Number of threads for many queries; -1 uses all cores.")] = 1,
    reading: Reading,
) -> None:
    """Measure from points, rays or segments to the nearest part of FILE.

    A single point is answered with labelled lines, several points with a table. --csv and --json give all
    fields, and lengths with 15 digits. Signed distance is negative inside. A part without an inside has
    unsigned distances, which are marked.

    With --nearest a point has a line for each of its K nearest parts, with the nearest point of that part.
    Parts that contain the point come first, the deepest of them at the beginning.

    With --cad a point has two bounds, between which its signed distance to the CAD surfaces is: the triangles
    of a STEP file deviate from them.

    With --all a ray has a line for each crossing: its distance, and whether the ray enters or leaves the
    part there. A ray that only touches an edge or a corner does not cross there.

    A file of points is a mesh or point cloud (.ply, .stl, .obj), or has one point per line, separated by
    commas, semicolons or spaces, optionally followed by a normal. The first line may name the columns and
    their unit, which must be that of --points-units or --units. All other columns are copied to CSV and
    JSON, as given_NAME if the answers have a column of that name; a column called name is shown in the
    table as well. # at the start of a line or after a space begins a comment. A point that is not finite is
    answered with nan. After the answers to a file of points follow their minimum, maximum, mean, root mean
    square and 95th percentile, and the worst point.

    With --within the exit code is 1 if a point is farther from the surface, inside or outside, and 2 if a
    file has no point, or is in an unlikely unit. --report writes all of this as a page.

    Answers are written while points are read. If a line is not a point, the error names it and the exit
    code is 2. Standard output then has the answers before that line (a JSON document ends with the key
    error); a CSV file is not written.

    Examples:
      proximity query bracket.stl 30 10 5
      proximity query bracket.stl -1 -2.5 -3e-2 --units in
      proximity query gearbox.step --points scan.csv --csv answers.csv --within 0.1
      proximity query gearbox.step --points scan.stl --within 0.1 --report report.html
      proximity query gearbox.step 30 10 5 --nearest 3
      proximity query bracket.stl 30 10 50 --ray 0 0 -1
      proximity query bracket.stl 30 10 50 --ray 0 0 -1 --all
      proximity query bracket.stl 0 0 50  60 0 50 --segment --json
      shuf points.txt | proximity query bracket.stl --points - --workers -1
    """
    refuse(
        (along.ray and along.segment, "--ray and --segment", "give one of them, not both"),
        (output.as_json and output.csv, "--json and --csv", "give one of them, not both"),
        (workers == 0 or workers < -1, "--workers", f"{workers} threads: expected 1 or more, or -1"),
        (
            output.within is not None and (along.ray or along.segment),
            "--within",
            "is for points, not for rays or segments",
        ),
        (nearest and (along.ray or along.segment), "--nearest", "is for points, not for rays or segments"),
        (cad and (along.ray or along.segment or nearest), "--cad", "is for points, without --nearest"),
        (cad and output.within is not None, "--cad and --within", "give one of them, not both"),
        (nearest and output.within is not None, "--nearest and --within", "give one of them, not both"),
        (along.cast_all and not along.ray, "--all", "is for --ray"),
        (along.min_distance is not None and not along.ray, "--min-distance", "is for --ray"),
        (points_units and points is None, "--points-units", "is for --points"),
        (
            output.report_page and (points is None or output.within is None),
            "--report",
            "requires --points and --within",
        ),
    )
    if output.report_page is not None:
        from proximity.cli.parts.reports.scan import check_libraries, write_report

        check_libraries()
    direction = None if along.ray is None else _numbers(along.ray, "--ray")
    asked = _points(coordinates, points, reading.units, points_units, is_segment=along.segment)
    asked, sides = read_ahead(asked, 1 if points in (None, STANDARD_INPUT) else POINTS_AHEAD)
    if points is not None and output.within is not None and not sides:
        raise ArgumentError(f"{points} contains no finite point to compare with --within")
    # Objects of imports and kernels are permanent: scanning them repeatedly takes 4 % of a query.
    with collector_paused():
        from proximity.cli.parts import answer_text, answers
        from proximity.formats import metres_per_unit
        from proximity.scene.loader import notes_on_sizes

        metres, scene = metres_per_unit(reading.units), reading.load(file)
        question = answers.Question(
            scene,
            reading.units,
            metres,
            direction,
            workers,
            is_segment=along.segment,
            is_all=along.cast_all,
            min_distance=along.min_distance or 0.0,
            nearest=nearest,
            is_cad=cad,
        )
    for note in notes_on_sizes(scene):
        report(f"note: {note}")
    collected = summary = None
    if points is not None or output.within is not None:
        from proximity.cli.parts.deviations import Deviations, check_unit

        if points is not None and points_units is None:
            check_unit(sides, scene, reading.units, is_gate=output.within is not None)
        collected = Deviations(reading.units, metres, output.within) if question.mode == "closest" else None
        summary = None if points is None else collected
    try:
        answered = question.answers(asked)
        if collected is not None:
            answered = collected.collected(answered)
        if output.as_json:
            answers.write_json(question, str(file), answered, None if summary is None else summary.values)
        elif output.csv is not None:
            with text_output(output.csv) as stream:
                answers.write_csv(question, stream, answered)
        else:
            answer_text.write_text(question, answered, is_whole=summary is not None)
        if summary is not None and summary.count > 1 and not output.as_json and output.csv != STDOUT:
            typer.echo(summary.sentence())
    finally:
        question.note_far_points()
    if output.report_page is not None and collected is not None:
        write_report(output.report_page, scene, file.name, Path(points or "").name, collected)
    if collected is not None and collected.farther_count:
        raise typer.Exit(EXIT_FARTHER)


def _points(
    coordinates: list[str] | None, path: str | None, units: str, points_units: str | None, *, is_segment: bool
) -> Iterator[Points]:
    """Yield the typed points in one chunk, or those of a file."""
    length = POINTS_PER_CHUNK * (2 if is_segment else 1)
    refuse((coordinates and path is not None, "--points", "points are given as arguments already"))
    if path is not None:
        yield from read_points(
            path, units, length, lambda sentence: report(f"note: {sentence}"), points_units
        )
        return
    refuse((not coordinates, "X Y Z", "give a point, or --points FILE"))
    numbers = _numbers(coordinates or (), "X Y Z")
    count = len(numbers)
    pairs = f"points are taken in pairs (start, end), but there are {count // 3}"
    refuse(
        (count % 3 != 0, "X Y Z", f"a point is three numbers, but {count} were given"),
        (is_segment and count % 6 != 0, "--segment", pairs),
    )
    for first in range(0, len(numbers), 3 * length):
        yield Points(array("d", numbers[first : first + 3 * length]))


def _numbers(texts: Iterable[str], hint: str) -> list[float]:
    try:
        return [number(text, is_finite=True) for text in texts]
    except ValueError as invalid:
        is_file = any(Path(text).is_file() for text in texts)
        order = "; FILE comes first, before X Y Z" if is_file else ""
        raise typer.BadParameter(f"{invalid}{order}", param_hint=hint) from invalid
