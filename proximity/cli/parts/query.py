"""``proximity query``: distances from points, rays or segments to the parts of a file."""

from array import array
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Annotated

import typer

from proximity.cli.options import FILE, Reading, with_option_groups
from proximity.cli.output import report
from proximity.cli.parts.points import Points, finite_number, read_points
from proximity.system.memory import collector_paused

POINTS_PER_CHUNK = 20_000  # queries answered at once: a bar moves, Ctrl-C is heard, memory stays bounded


@with_option_groups
def query(
    file: FILE,
    coordinates: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="X Y Z", help="Coordinates of one or more points. Negative numbers are allowed."
        ),
    ] = None,
    points: Annotated[
        str | None, typer.Option(metavar="FILE", help="Read the points from a file; - is standard input.")
    ] = None,
    ray: Annotated[
        tuple[str, str, str] | None,
        typer.Option(metavar="DX DY DZ", help="Cast a ray from each point in this direction."),
    ] = None,
    segment: Annotated[
        bool, typer.Option("--segment", help="Take the points in pairs: start and end of a segment.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Write one JSON document.")] = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Write CSV with a header.")] = False,
    workers: Annotated[
        int, typer.Option(metavar="N", help="Number of threads for many queries; -1 uses all cores.")
    ] = 1,
    *,
    reading: Reading,
) -> None:
    """Measure from points, rays or segments to the nearest part of FILE.

    A single point is answered with labelled lines, several points with a table. --json and --csv write
    lengths with 15 digits. Signed distance is negative inside. A part without an inside has unsigned
    distances, which are marked.

    A file of points has one point per line, separated by commas, semicolons or spaces. The first line may
    name the columns and their unit, which must be that of --units. A column called name is copied to the
    answers. # at the start of a line or after a space begins a comment. A point that is not finite is
    answered with nan.

    Answers are written while points are read. If a line is not a point, the answers before it are written,
    the error names the line, and the exit code is 2; a JSON document then ends with the key error. CSV
    columns of lengths end in their unit.

    Examples:
      proximity query bracket.stl 30 10 5
      proximity query bracket.stl -1 -2.5 -3e-2 --units in
      proximity query gearbox.step --points points.csv --csv > query_answers.csv
      proximity query bracket.stl 30 10 50 --ray 0 0 -1
      proximity query bracket.stl 0 0 50  60 0 50 --segment --json
      shuf points.txt | proximity query bracket.stl --points - --workers -1
    """
    for is_both, names in (
        (ray and segment, "--ray and --segment"),
        (as_json and as_csv, "--json and --csv"),
    ):
        if is_both:
            raise typer.BadParameter("give one of them, not both", param_hint=names)
    if workers == 0 or workers < -1:
        raise typer.BadParameter(f"{workers} threads: expected 1 or more, or -1", param_hint="--workers")
    reading.check()
    direction = None if ray is None else _numbers(ray, "--ray")
    asked = _points(coordinates, points, reading.units, is_segment=segment)
    asked = chain([next(asked)], asked)  # what begins badly is refused before the file is loaded
    # What imports and kernels leave behind is no garbage: to look at it again and again is 4 % of a query.
    with collector_paused():
        from proximity.cli.parts.answer_output import write_answers
        from proximity.cli.parts.answers import Question

        metres, scene = reading.metres, reading.load(file)
        question = Question(scene, reading.units, metres, direction, workers, is_segment=segment)
    question.write_notes_on_sizes()
    try:
        write_answers(question, str(file), asked, as_json=as_json, as_csv=as_csv)
    finally:
        question.write_note_on_far_points()


def _points(
    coordinates: list[str] | None, path: str | None, units: str, *, is_segment: bool
) -> Iterator[Points]:
    """Yield what was typed, at once, or what is read from a file."""
    length = POINTS_PER_CHUNK * (2 if is_segment else 1)
    if coordinates and path is not None:
        raise typer.BadParameter("points are given as arguments already", param_hint="--points")
    if path is not None:
        yield from read_points(path, units, length, lambda sentence: report(f"note: {sentence}"))
        return
    if not coordinates:
        raise typer.BadParameter("give a point, or --points FILE", param_hint="X Y Z")
    numbers = _numbers(coordinates, "X Y Z")
    if len(numbers) % 3 != 0:
        raise typer.BadParameter(
            f"a point is three numbers, but {len(numbers)} were given", param_hint="X Y Z"
        )
    if is_segment and len(numbers) % 6 != 0:
        raise typer.BadParameter(
            f"points are taken in pairs (start, end), but there are {len(numbers) // 3}",
            param_hint="--segment",
        )
    for first in range(0, len(numbers), 3 * length):
        yield Points(array("d", numbers[first : first + 3 * length]))


def _numbers(texts: Iterable[str], hint: str) -> list[float]:
    try:
        return list(map(finite_number, texts))
    except ValueError as unfit:
        is_file = any(Path(text).is_file() for text in texts)
        order = "; FILE comes first, before X Y Z" if is_file else ""
        raise typer.BadParameter(f"{unfit}{order}", param_hint=hint) from unfit
