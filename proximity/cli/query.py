"""``proximity query``: how far points, rays or segments are from the parts of a file."""

import sys
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass
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
from proximity.cli.points import number, read_points
from proximity.collector import collector_paused

if TYPE_CHECKING:
    import numpy as np

HELP = "\n\n".join(
    (
        "Measure from points, rays or segments to the nearest part of FILE.",
        "One point gives a block to read, many give a table; --json and --csv give every digit. Signed "
        "distance is negative inside; it is unsigned, and said to be, where a part has no inside.",
        "Points in a file stand one a line, between commas, semicolons or spaces; a first line may name the "
        "columns, and their unit if it is that of --units; # begins a comment. A point that is not finite "
        "answers nan; the others go on.",
    )
)

EXAMPLES = """
Examples:
  proximity query bracket.stl 30 10 5
  proximity query bracket.stl -1 -2.5 -3e-2 --units in
  proximity query gearbox.step --points points.csv --csv > answers.csv
  proximity query bracket.stl 30 10 50 --ray 0 0 -1
  proximity query bracket.stl 0 0 50  60 0 50 --segment --json
  shuf points.txt | proximity query bracket.stl --points - --workers -1
"""

CHUNK = 20_000  # queries answered at once: a bar moves, Ctrl-C is heard, memory stays bounded

Fields = dict[str, list[Any]]
Ask = Callable[["np.ndarray"], Fields]


@dataclass(frozen=True, slots=True)
class Questions:
    """What is asked, and how."""

    mode: str  # "closest", "ray" or "segment"
    points: "np.ndarray"  # (N, 3) float64, in the unit
    ask: Ask  # rows of points -> answers
    rows_each: int = 1  # points a query takes

    def __len__(self) -> int:
        return len(self.points) // self.rows_each

    def chunks(self, limit: int | None = None) -> Iterator[Fields]:
        """Answer the first *limit* queries, or all, in chunks; at least one chunk, which may be empty."""
        count = len(self) if limit is None else min(limit, len(self))
        for first in range(0, max(count, 1), CHUNK):
            last = min(first + CHUNK, count)
            yield self.ask(self.points[first * self.rows_each : last * self.rows_each])


def command(
    ctx: typer.Context,
    file: FILE,
    coordinates: Annotated[
        list[str] | None,
        typer.Argument(metavar="X Y Z", help="One point or many. Negative numbers are numbers."),
    ] = None,
    points: Annotated[
        str | None,
        typer.Option("--points", metavar="FILE", help="Read the points from a file; - is standard input."),
    ] = None,
    ray: Annotated[
        tuple[float, float, float] | None,
        typer.Option("--ray", metavar="DX DY DZ", help="Cast a ray from each point in this direction."),
    ] = None,
    segment: Annotated[
        bool, typer.Option("--segment", help="Take the points in pairs: start and end of a segment.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Write one JSON document.")] = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Write CSV with a header.")] = False,
    units: UNITS = "mm",
    step_tolerance: STEP_TOLERANCE = STEP_TOLERANCE_MM,
    unpacked_limit: UNPACKED_LIMIT = UNPACKED_LIMIT_GB,
    workers: Annotated[
        int, typer.Option("--workers", metavar="N", help="Threads for many queries; -1 is all cores.")
    ] = 1,
) -> None:
    """Answer the queries on the command line."""
    _refuse_both(ray is not None and segment, "--ray and --segment")
    _refuse_both(as_json and as_csv, "--json and --csv")
    if workers == 0 or workers < -1:
        raise typer.BadParameter(f"{workers} threads: expected 1 or more, or -1", param_hint="--workers")
    options = load_options(step_tolerance, unpacked_limit)
    typed = _typed_points(coordinates, points, units)
    if segment and len(typed) // 3 % 2 == 1:
        count = len(typed) // 3
        raise typer.BadParameter(
            f"points are taken in pairs (start, end), but there are {count}", param_hint="--segment"
        )
    # What imports and kernels leave behind is no garbage: to look at it again and again is 4 % of a query.
    with collector_paused():
        # NumPy, Rich and the library: only now, so that --help and mistakes above answer at once.
        from proximity.cli import waiting
        from proximity.meshio import metres_per_unit

        metres = metres_per_unit(units)
        waiting.prepare_kernels()
        with waiting.spinner(f"reading {file}"):
            scene = proximity.load(str(file), units=units, **options)
    questions = _questions(scene, typed, ray, segment, metres, workers)
    head = {"file": str(file), "units": units, "mode": questions.mode}
    if as_json or as_csv:
        _write_for_programs(questions, head, as_json)
    else:
        _write_for_people(questions, scene, units)


def _refuse_both(is_both: bool, names: str) -> None:
    if is_both:
        raise typer.BadParameter("give one of them, not both", param_hint=names)


def _typed_points(coordinates: list[str] | None, path: str | None, units: str) -> array:
    """Return what was typed or read, flat: x y z x y z ..."""
    if coordinates and path is not None:
        raise typer.BadParameter("points are given as arguments already", param_hint="--points")
    if path is not None:
        return read_points(path, units)
    if not coordinates:
        raise typer.BadParameter("give a point, or --points FILE", param_hint="X Y Z")
    if len(coordinates) % 3 != 0:
        raise typer.BadParameter(
            f"a point is three numbers, but {len(coordinates)} were given", param_hint="X Y Z"
        )
    try:
        return array("d", [number(coordinate) for coordinate in coordinates])
    except ValueError as unfit:
        raise typer.BadParameter(str(unfit), param_hint="X Y Z") from unfit


def _questions(
    scene: "proximity.Scene",
    typed: array,
    ray: tuple[float, float, float] | None,
    is_segment: bool,
    metres: float,
    workers: int,
) -> Questions:
    import numpy as np

    from proximity.cli import answers

    points = np.frombuffer(typed, dtype=np.float64).reshape(-1, 3) if typed else np.empty((0, 3))
    if ray is not None:
        direction = np.array(ray)
        return Questions("ray", points, lambda rows: answers.cast(scene, rows, direction, metres, workers))
    if is_segment:
        return Questions(
            "segment", points, lambda rows: answers.closest_to_segments(scene, rows, metres, workers), 2
        )
    return Questions("closest", points, lambda rows: answers.closest(scene, rows, metres, workers))


def _with_bar(questions: Questions, *, is_shown: bool) -> Iterator[Fields]:
    from proximity.cli import waiting

    total = len(questions)
    counts = (min(CHUNK, total - first) for first in range(0, max(total, 1), CHUNK))
    return waiting.with_bar(questions.chunks(), counts, total, is_shown=is_shown)


def _write_for_programs(questions: Questions, head: dict[str, Any], as_json: bool) -> None:
    from proximity.cli import output

    chunks = _with_bar(questions, is_shown=not sys.stdout.isatty())
    if as_json:
        output.write_json(sys.stdout, head, chunks)
    else:
        output.write_csv(sys.stdout, chunks)


def _write_for_people(questions: Questions, scene: "proximity.Scene", units: str) -> None:
    from proximity.cli import blocks, tables
    from proximity.cli.console import Console

    console = Console()
    if len(questions) == 1:
        answer = {field: values[0] for field, values in next(questions.chunks()).items()}
        blocks.print_block(console, blocks.BLOCKS[questions.mode](answer, units, _sign_of(scene, answer)))
    elif console.is_terminal:
        tables.print_table(console, questions.mode, units, next(questions.chunks(tables.TERMINAL_ROWS)))
        if len(questions) > tables.TERMINAL_ROWS:
            typer.echo(
                f"proximity: these are {tables.TERMINAL_ROWS} of {len(questions)}; "
                "--csv, --json or a pipe shows all",
                err=True,
            )
    else:
        tables.write_table(sys.stdout, questions.mode, units, _with_bar(questions, is_shown=True))


def _sign_of(scene: "proximity.Scene", answer: dict[str, Any]) -> str:
    """Return how the sign of the part that was found is known."""
    if answer["part"] is None:
        return ""
    solid = scene.parts[answer["part"]].solid
    return f"{solid.sign_method.value}: {solid.sign_reason}"
