"""``proximity query``: distances from points, rays or segments to the parts of a file."""

import sys
from array import array
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
from proximity.cli.points import Points, finite_number, read_points
from proximity.errors import ProximityError
from proximity.system.memory import collector_paused

if TYPE_CHECKING:
    from proximity.cli.questions import Fields, Questions

HELP = "\n\n".join(
    (
        "Measure from points, rays or segments to the nearest part of FILE.",
        "A single point is answered with labelled lines, several points with a table. --json and --csv "
        "write lengths with 15 digits. Signed distance is negative inside. A part without an inside has "
        "unsigned distances, which are marked.",
        "A file of points has one point per line, separated by commas, semicolons or spaces. The first line "
        "may name the columns and their unit, which must be that of --units. A column called name is copied "
        "to the answers. # at the start of a line or after a space begins a comment. A point that is not "
        "finite is answered with nan.",
        "Answers are written while points are read. If a line is not a point, the answers before it are "
        "written, the error names the line, and the exit code is 2; a JSON document then ends with the key "
        "error. CSV columns of lengths end in their unit.",
    )
)

EXAMPLES = """
Examples:
  proximity query bracket.stl 30 10 5
  proximity query bracket.stl -1 -2.5 -3e-2 --units in
  proximity query gearbox.step --points points.csv --csv > query_answers.csv
  proximity query bracket.stl 30 10 50 --ray 0 0 -1
  proximity query bracket.stl 0 0 50  60 0 50 --segment --json
  shuf points.txt | proximity query bracket.stl --points - --workers -1
"""

POINTS_PER_CHUNK = 20_000  # queries answered at once: a bar moves, Ctrl-C is heard, memory stays bounded


COORDINATES = Annotated[
    list[str] | None,
    typer.Argument(metavar="X Y Z", help="Coordinates of one or more points. Negative numbers are allowed."),
]
POINTS = Annotated[
    str | None,
    typer.Option("--points", metavar="FILE", help="Read the points from a file; - is standard input."),
]
RAY = Annotated[
    tuple[str, str, str] | None,
    typer.Option("--ray", metavar="DX DY DZ", help="Cast a ray from each point in this direction."),
]
SEGMENT = Annotated[
    bool, typer.Option("--segment", help="Take the points in pairs: start and end of a segment.")
]
AS_JSON = Annotated[bool, typer.Option("--json", help="Write one JSON document.")]
AS_CSV = Annotated[bool, typer.Option("--csv", help="Write CSV with a header.")]
WORKERS = Annotated[
    int, typer.Option("--workers", metavar="N", help="Number of threads for many queries; -1 uses all cores.")
]


def command(
    ctx: typer.Context,
    file: FILE,
    coordinates: COORDINATES = None,
    points: POINTS = None,
    ray: RAY = None,
    segment: SEGMENT = False,
    as_json: AS_JSON = False,
    as_csv: AS_CSV = False,
    units: UNITS = "mm",
    step_tolerance: STEP_TOLERANCE = STEP_TOLERANCE_MM,
    unpacked_limit: UNPACKED_LIMIT = UNPACKED_LIMIT_GB,
    workers: WORKERS = 1,
) -> None:
    """Answer the queries on the command line."""
    _refuse_both(ray is not None and segment, "--ray and --segment")
    _refuse_both(as_json and as_csv, "--json and --csv")
    if workers == 0 or workers < -1:
        raise typer.BadParameter(f"{workers} threads: expected 1 or more, or -1", param_hint="--workers")
    options = load_options(step_tolerance, unpacked_limit)
    direction = None if ray is None else tuple(_numbers(ray, "--ray"))
    mode = "closest" if direction is None else "ray"
    mode = "segment" if segment else mode
    chunks = _with_begun(_points(coordinates, points, units, mode))
    # What imports and kernels leave behind is no garbage: to look at it again and again is 4 % of a query.
    with collector_paused():
        # NumPy, Rich and the library: only now, so that --help and mistakes above answer at once.
        from proximity.cli import progress
        from proximity.formats import metres_per_unit

        metres = metres_per_unit(units)
        progress.prepare_kernels()
        with progress.spinner(f"reading {file}") as count:
            scene = proximity.load(str(file), units=units, progress=count, **options)
    from proximity.cli.questions import FarPoints, Questions, asker
    from proximity.scene.loader import notes_on_sizes

    _show_notes(notes_on_sizes(scene))
    far = FarPoints(scene, units, metres)
    questions = Questions(mode, chunks, asker(scene, mode, direction, metres, workers), far)
    head = {"file": str(file), "units": units, "mode": mode}
    try:
        if as_json or as_csv:
            _write_for_programs(questions, head, as_json)
        else:
            _write_for_people(questions, scene, units)
    except ProximityError:
        _show_notes([far.note()])
        raise
    _show_notes([far.note()])


def _refuse_both(is_both: bool, names: str) -> None:
    if is_both:
        raise typer.BadParameter("give one of them, not both", param_hint=names)


def _points(coordinates: list[str] | None, path: str | None, units: str, mode: str) -> Iterator[Points]:
    """Yield what was typed, at once, or what is read from a file."""
    if coordinates and path is not None:
        raise typer.BadParameter("points are given as arguments already", param_hint="--points")
    if path is not None:
        yield from read_points(path, units, _chunk_length(mode), lambda sentence: _show_notes([sentence]))
        return
    if not coordinates:
        raise typer.BadParameter("give a point, or --points FILE", param_hint="X Y Z")
    numbers = _numbers(coordinates, "X Y Z")
    if len(numbers) % 3 != 0:
        raise typer.BadParameter(
            f"a point is three numbers, but {len(numbers)} were given", param_hint="X Y Z"
        )
    count = len(numbers) // 3
    if mode == "segment" and count % 2 == 1:
        raise typer.BadParameter(
            f"points are taken in pairs (start, end), but there are {count}", param_hint="--segment"
        )
    length = 3 * _chunk_length(mode)
    for first in range(0, len(numbers), length):
        yield Points(array("d", numbers[first : first + length]))


def _chunk_length(mode: str) -> int:
    return POINTS_PER_CHUNK * (2 if mode == "segment" else 1)


def _numbers(texts: Iterable[str], hint: str) -> list[float]:
    try:
        return [finite_number(text) for text in texts]
    except ValueError as unfit:
        is_file = any(Path(text).is_file() for text in texts)
        order = "; FILE comes first, before X Y Z" if is_file else ""
        raise typer.BadParameter(f"{unfit}{order}", param_hint=hint) from unfit


def _with_begun(chunks: Iterator[Points]) -> Iterator[Points]:
    """Read the first chunk now, so that what begins badly is refused before the file is loaded."""
    return chain([next(chunks)], chunks)


def _show_notes(notes: Iterable[str | None]) -> None:
    from proximity.cli.wording import printable

    for note in notes:
        if note is not None:
            typer.echo(f"proximity: note: {printable(note)}", err=True)


def _write_for_programs(questions: "Questions", head: dict[str, Any], as_json: bool) -> None:
    from proximity.cli import progress
    from proximity.cli.questions import count_of
    from proximity.cli.views import query_answers

    chunks = progress.with_bar(questions.chunks(), count_of, None, is_shown=not sys.stdout.isatty())
    if as_json:
        query_answers.write_json(sys.stdout, head, chunks)
    else:
        query_answers.write_csv(sys.stdout, head["units"], chunks)


def _write_for_people(questions: "Questions", scene: "proximity.Scene", units: str) -> None:
    from proximity.cli import progress
    from proximity.cli.console import Console, print_block
    from proximity.cli.questions import count_of
    from proximity.cli.views import query_answers

    console = Console()
    chunks = questions.chunks()
    first = next(chunks)
    count = count_of(first)
    if count == 1:
        answer = {field: values[0] for field, values in first.items()}
        print_block(console, query_answers.block(questions.mode, answer, units, _sign_of(scene, answer)))
        next(chunks, None)  # a line behind it may be none
    elif console.is_terminal:
        rows = _first(first, query_answers.TERMINAL_ROWS)
        _show_notes([query_answers.print_table(console, questions.mode, units, rows)])
        if count > query_answers.TERMINAL_ROWS:
            known = str(count) if count < POINTS_PER_CHUNK else f"{count} or more"
            typer.echo(
                f"proximity: these are {query_answers.TERMINAL_ROWS} of {known}; "
                "--csv, --json or a pipe shows all",
                err=True,
            )
        if count < POINTS_PER_CHUNK:
            next(chunks, None)
    else:
        everything = progress.with_bar(chain([first], chunks), count_of, None, is_shown=True)
        query_answers.write_table(sys.stdout, questions.mode, units, everything)


def _first(fields: "Fields", count: int) -> "Fields":
    return {field: values[:count] for field, values in fields.items()}


def _sign_of(scene: "proximity.Scene", answer: dict[str, Any]) -> str:
    """Return how the sign of the part that was found is known."""
    if answer["part"] is None:
        return ""
    solid = scene.parts[answer["part"]].solid
    return f"{solid.sign_method.value}: {solid.sign_reason}"
