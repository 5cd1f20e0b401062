"""Answers to queries: JSON and CSV for programs, a table or a block of lines for people.

All four come from `FIELDS`. Answers are streamed, but for the table on a terminal, which Rich draws. JSON and
CSV hold numbers that read back as the same float64. CSV writes nan and inf as NumPy and pandas read them;
what is missing is empty, and no text is a formula. Names of columns that hold lengths end in their unit.
"""

import csv
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TextIO

from rich.console import Console
from rich.table import Table
from rich.text import Text

from proximity.cli.console import Lines, print_fitting, table_of
from proximity.cli.views.json_output import plain
from proximity.cli.wording import FEW_DIGITS, MISSING, length, number, printable, side
from proximity.errors import ProximityError
from proximity.system.table_text import table_text

Fields = dict[str, list[Any]]

TERMINAL_ROWS = 100  # more than a person reads from a screen
NUMBER_WIDTH = 16  # -1.23456789e-100
COUNT_WIDTH = 9
DIRECTION_DECIMALS = 9
DIGITS = 9  # significant, of numbers in a table
TOO_FAR = "too far away to be computed"


@dataclass(frozen=True, slots=True)
class Field:
    """One field of an answer."""

    title: str = ""  # of its column in a table; the axis follows
    axes: str = ""  # of three numbers
    is_length: bool = False  # its columns are named with the unit
    width: int = NUMBER_WIDTH  # of its column where lines are streamed; negative: aligned to the left
    is_float: bool = True

    def number(self, value: float, digits: int = DIGITS) -> str:
        """Return a value for people; components of directions that are rounding errors are zeros."""
        if self.is_length:
            return length(value, digits)
        return number(round(value, DIRECTION_DECIMALS) if self.axes else value, digits)


def _text(title: str, width: int = -len("outside")) -> Field:
    return Field(title, width=width, is_float=False)


FIELDS = {
    "name": _text("name", -12),
    "start_name": _text("start_name", -12),
    "end_name": _text("end_name", -12),
    "query": Field(axes="xyz", is_length=True),
    "origin": Field(axes="xyz", is_length=True),
    "direction": Field(axes="xyz"),
    "start": Field(axes="xyz", is_length=True),
    "end": Field(axes="xyz", is_length=True),
    "signed_distance": Field("distance", is_length=True),
    "distance": Field("distance", is_length=True),
    "side": _text("side"),
    "is_signed": Field(),
    "fraction": Field(),
    "point": Field("point_", axes="xyz", is_length=True),
    "point_on_solid": Field("solid_", axes="xyz", is_length=True),
    "point_on_segment": Field("segment_", axes="xyz", is_length=True),
    "gradient": Field("normal_", axes="xyz"),
    "normal": Field("normal_", axes="xyz"),
    "face": _text("face", COUNT_WIDTH),
    "face_id": Field(),
    "feature": _text("on"),
    "part": Field(),
    "part_name": _text("part"),
    "barycentric": Field(axes="012"),
}
NAMES = ("name", "start_name", "end_name")  # of points; in the answers where the points have names
IN_TABLE = {
    "closest": ("signed_distance", "side", "point", "gradient", "face", "feature", "part_name"),
    "ray": ("distance", "point", "normal", "face", "part_name"),
    "segment": ("distance", "point_on_solid", "point_on_segment", "face", "part_name"),
}
DISPENSABLE = (("gradient", "normal", "point_on_segment"), ("face", "feature"), ("part_name",))
"""Fields to leave out, in this order, until a table is as narrow as the terminal."""
IN_BLOCK = {
    "closest": {
        "signed distance": "signed_distance", "closest point": "point", "normal": "gradient",
        "part": "part_name", "face": "face", "on": "feature",
    },
    "ray": {
        "distance": "distance", "point": "point", "normal": "normal", "part": "part_name", "face": "face",
    },
    "segment": {
        "distance": "distance", "on segment": "point_on_segment", "on solid": "point_on_solid",
        "fraction": "fraction", "part": "part_name", "face": "face",
    },
}  # fmt: skip
ASKED = {"closest": ("query",), "ray": ("origin", "direction"), "segment": ("start", "end")}


def write_json(stream: TextIO, head: dict[str, Any], chunks: Iterable[Fields]) -> None:
    """Write one JSON document: the fields of *head*, then ``answers``, one a line.

    Where *chunks* end in an error behind some answers, these are written, and its sentence as ``error``: the
    document is complete. An error before any answer leaves nothing written.
    """
    opening = json.dumps(plain(head), allow_nan=False)[:-1] + ', "answers": ['
    separator = "\n"
    try:
        for chunk in chunks:
            stream.write(opening)
            opening = ""
            for values in zip(*chunk.values(), strict=True):
                answer = plain(dict(zip(chunk, values, strict=True)))
                stream.write(separator + json.dumps(answer, allow_nan=False))
                separator = ",\n"
            stream.flush()
    except ProximityError as error:
        if not opening:
            stream.write(f'\n], "error": {json.dumps(str(error))}}}\n')
        raise
    stream.write("\n]}\n")


def write_csv(stream: TextIO, units: str, chunks: Iterable[Fields]) -> None:
    """Write a header and a line an answer; three numbers take three columns.

    *chunks*: answers, field by field; at least one chunk, which may be empty.
    """
    writer = csv.writer(stream, lineterminator="\n")
    has_header = False
    for chunk in chunks:
        if not has_header:
            writer.writerow(column.name_in_csv(units) for column in _columns(chunk, chunk))
            has_header = True
        writer.writerows(zip(*(column.values_in_csv() for column in _columns(chunk, chunk)), strict=True))
        stream.flush()


def write_table(stream: TextIO, mode: str, units: str, chunks: Iterable[Fields]) -> None:
    """Write a header and a line of fixed width an answer, as they come.

    *chunks*: answers, field by field; at least one chunk, which may be empty.
    """
    count = -1
    for chunk in chunks:
        columns = _shown(mode, chunk)
        if count < 0:
            titles = [_aligned(column.title(units), column.field.width) for column in columns]
            stream.write(_line(["#".rjust(COUNT_WIDTH), *titles]))
            count = 0
        aligned = ([_aligned(cell, column.field.width) for cell in column.cells()] for column in columns)
        for cells in zip(*aligned, strict=True):
            stream.write(_line([str(count).rjust(COUNT_WIDTH), *cells]))
            count += 1
        stream.flush()


def print_table(console: Console, mode: str, units: str, answers: Fields) -> str | None:
    """Draw the table of a few answers on a terminal; return a note on what it is too narrow for, if
    anything.
    """
    columns = _shown(mode, answers)
    left_out = [sum(DISPENSABLE[:count], ()) for count in range(len(DISPENSABLE) + 1)]
    choices = [
        ([column for column in columns if column.name not in names], digits)
        for names in left_out
        for digits in (DIGITS, FEW_DIGITS)
    ]
    kept, digits = choices[print_fitting(console, [_drawn(*choice, units) for choice in choices])]
    missing = [column.title(units) for column in columns if column not in kept]
    if not missing and digits == DIGITS:
        return None
    what = [f"columns are left out ({', '.join(missing)})"] if missing else []
    what += [f"numbers have {digits} digits"] if digits < DIGITS else []
    return f"the terminal is narrow: {' and '.join(what)}; --csv, --json or a pipe shows all"


def block(mode: str, answer: dict[str, Any], units: str, sign: str) -> Lines:
    """Return the lines that tell one answer, with the names of its points where they have some."""
    lines = [(FIELDS[name].title.replace("_", " "), answer[name]) for name in NAMES if name in answer]
    if answer["face"] is None:
        return [*lines, ("distance", _why_nothing(mode, answer))]
    lines += [(label, _reported(name, answer, units)) for label, name in IN_BLOCK[mode].items()]
    return [*lines, ("sign", sign)] if mode == "closest" else lines


@dataclass(frozen=True, slots=True)
class _Column:
    name: str
    field: Field
    axis: str
    values: list[Any]

    def title(self, units: str) -> str:
        return f"{self.field.title}{self.axis}{self._ending(units)}"

    def name_in_csv(self, units: str) -> str:
        # Plain x, y, z of the points asked from: what is written can be read again as points.
        words = (self.axis,) if self.name == "query" else (self.name, self.axis)
        return "_".join(filter(None, words)) + self._ending(units)

    def values_in_csv(self) -> Iterable[Any]:
        return self.values if self.field.is_float else map(table_text, self.values)

    def cells(self, digits: int = DIGITS) -> list[str]:
        if self.field.is_float:
            return [self.field.number(value, digits) for value in self.values]
        return [MISSING if value is None else printable(str(value)) for value in self.values]

    def _ending(self, units: str) -> str:
        return f"_{units}" if self.field.is_length else ""


def _columns(answers: Fields, names: Iterable[str]) -> Iterable[_Column]:
    for name in names:
        field, values = FIELDS[name], answers[name]
        if not field.axes:
            yield _Column(name, field, "", values)
        for axis, letter in enumerate(field.axes):
            yield _Column(name, field, letter, [vector[axis] for vector in values])


def _shown(mode: str, answers: Fields) -> list[_Column]:
    if mode == "closest":
        signs = zip(answers["signed_distance"], answers["is_signed"], strict=True)
        answers = {**answers, "side": [side(*pair) for pair in signs]}
    return list(_columns(answers, [*(name for name in NAMES if name in answers), *IN_TABLE[mode]]))


def _drawn(columns: list[_Column], digits: int, units: str) -> Table:
    table = table_of([("#", True), *((column.title(units), column.field.width > 0) for column in columns)])
    for count, cells in enumerate(zip(*(column.cells(digits) for column in columns), strict=True)):
        table.add_row(str(count), *map(Text, cells))
    return table


def _aligned(cell: str, width: int) -> str:
    return cell.rjust(width) if width > 0 else cell.ljust(-width)


def _line(cells: list[str]) -> str:
    return " ".join(cells).rstrip() + "\n"


def _reported(name: str, answer: dict[str, Any], units: str) -> str:
    """One field of an answer in words."""
    value, field = answer[name], FIELDS[name]
    ending = f" {units}" if field.is_length else ""
    if name == "face":
        return f"{value} of the file"
    if name == "feature":
        return {"face": "a face", "edge": "an edge", "vertex": "a corner"}.get(value, MISSING)
    if name == "fraction":
        return f"{number(value)} of the segment"
    if name == "signed_distance":
        where = str(side(value, answer["is_signed"]))
        words = {"surface": "on the surface", "unknown": "which side is unknown"}
        ending += f", {words.get(where, where)}"
    elif name == "distance" and "start" in answer and value == 0.0:
        ending += ", touches the surface"
    if not field.is_float:
        return str(value)
    return "  ".join(map(field.number, value if field.axes else [value])) + ending


def _why_nothing(mode: str, answer: dict[str, Any]) -> str:
    distance = answer["signed_distance" if mode == "closest" else "distance"]
    if not all(math.isfinite(value) for name in ASKED[mode] for value in answer[name]):
        why = "the point is not finite" if mode == "closest" else "the numbers given are not finite"
    elif math.isnan(distance):
        why = TOO_FAR
    else:
        why = "nothing in that direction" if mode == "ray" else "nothing"
    return f"{number(distance)} ({why})"
