"""Many answers for people, as a table.

On a terminal Rich draws it. Elsewhere lines of fixed width are streamed, never cut and without colours.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TextIO

from rich.console import Console
from rich.table import Table
from rich.text import Text

from proximity.cli.views.wording import MISSING, number, printable, side

Fields = dict[str, list[Any]]

TERMINAL_ROWS = 100  # more than a person reads from a screen
NUMBER_WIDTH = 16  # -1.23456789e-100
COUNT_WIDTH = 9
NAME_WIDTH = 12
NAMES = ("name", "start_name", "end_name")  # of points; in the answers where the points have names
UNBOUNDED = 10_000  # columns: wider than any table


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table."""

    title: str
    field: str
    axis: int | None = None  # of a field of three numbers
    is_length: bool = False  # the title gets the unit
    is_dispensable: bool = False  # left out first where the terminal is narrow

    @property
    def is_number(self) -> bool:
        """Whether its entries are floats, aligned to the right."""
        return self.field not in ("part_name", "feature", "side", "face", *NAMES)


def _vector(title: str, field: str, *, is_length: bool = True, is_dispensable: bool = False) -> list[Column]:
    return [
        Column(f"{title}{axis}", field, index, is_length=is_length, is_dispensable=is_dispensable)
        for index, axis in enumerate("xyz")
    ]


COLUMNS = {
    "closest": [
        Column("distance", "signed_distance", is_length=True),
        Column("side", "side"),
        *_vector("", "point"),
        *_vector("normal_", "gradient", is_length=False, is_dispensable=True),
        Column("face", "face"),
        Column("on", "feature"),
        Column("part", "part_name"),
    ],
    "ray": [
        Column("distance", "distance", is_length=True),
        *_vector("", "point"),
        *_vector("normal_", "normal", is_length=False, is_dispensable=True),
        Column("face", "face"),
        Column("part", "part_name"),
    ],
    "segment": [
        Column("distance", "distance", is_length=True),
        *_vector("", "point_on_solid"),
        *_vector("segment_", "point_on_segment", is_dispensable=True),
        Column("face", "face"),
        Column("part", "part_name"),
    ],
}


def write_table(stream: TextIO, mode: str, units: str, chunks: Iterable[Fields]) -> None:
    """Write a header and a line of fixed width an answer, as they come.

    Parameters
    ----------
    stream : text file
        Where to write.
    mode : str
        A key of `COLUMNS`.
    units : str
        What lengths are in.
    chunks : iterable of dict
        Answers, field by field; at least one chunk, which may be empty.
    """
    columns: list[Column] = []
    count = 0
    for chunk in chunks:
        if not columns:
            columns = _columns(mode, chunk)
            titles = [_aligned(column, _title(column, units)) for column in columns]
            stream.write(_line(["#".rjust(COUNT_WIDTH), *titles]))
        for cells in _rows(chunk, columns):
            aligned = [_aligned(column, cell) for column, cell in zip(columns, cells, strict=True)]
            stream.write(_line([str(count).rjust(COUNT_WIDTH), *aligned]))
            count += 1
        stream.flush()


def print_table(console: Console, mode: str, units: str, answers: Fields) -> None:
    """Draw the table of a few answers on a terminal.

    Parameters
    ----------
    console : Console
        The terminal.
    mode : str
        A key of `COLUMNS`.
    units : str
        What lengths are in.
    answers : dict
        Answers, field by field.
    """
    columns = _columns(mode, answers)
    table = _drawn(columns, units, answers)
    unbounded = console.options.update(width=UNBOUNDED)
    if console.measure(table, options=unbounded).maximum > console.width:
        table = _drawn([column for column in columns if not column.is_dispensable], units, answers)
    console.print(table)


def _columns(mode: str, answers: Fields) -> list[Column]:
    return [*(Column(name, name) for name in NAMES if name in answers), *COLUMNS[mode]]


def _drawn(columns: list[Column], units: str, answers: Fields) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("#", justify="right", overflow="fold")
    for column in columns:
        is_right = column.is_number or column.field == "face"
        table.add_column(_title(column, units), justify="right" if is_right else "left", overflow="fold")
    for count, cells in enumerate(_rows(answers, columns)):
        table.add_row(str(count), *map(Text, cells))
    return table


def _title(column: Column, units: str) -> str:
    return f"{column.title}_{units}" if column.is_length else column.title


def _aligned(column: Column, cell: str) -> str:
    if column.is_number:
        return cell.rjust(NUMBER_WIDTH)
    if column.field == "face":
        return cell.rjust(COUNT_WIDTH)
    return cell.ljust(NAME_WIDTH if column.field in NAMES else len("outside"))


def _line(cells: list[str]) -> str:
    return " ".join(cells).rstrip() + "\n"


def _rows(answers: Fields, columns: list[Column]) -> Iterable[tuple[str, ...]]:
    if "signed_distance" in answers:
        answers = {**answers, "side": _sides(answers)}
    return zip(*(_cells(column, answers[column.field]) for column in columns), strict=True)


def _cells(column: Column, values: list[Any]) -> list[str]:
    if column.axis is not None:
        return [number(value[column.axis]) for value in values]
    if column.is_number:
        return [number(value) for value in values]
    return [MISSING if value is None else printable(str(value)) for value in values]


def _sides(answers: Fields) -> list[str | None]:
    return [side(*pair) for pair in zip(answers["signed_distance"], answers["is_signed"], strict=True)]
