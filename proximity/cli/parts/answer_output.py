"""Answers to queries as JSON and CSV for programs, and as labelled lines or a table for people.

All come from `FIELDS`. Answers are streamed, but for the table on a terminal, which Rich draws. JSON and CSV
hold numbers that read back as the same float64. CSV writes nan and inf as NumPy and pandas read them; what is
missing is empty, and no text is a formula. Names of columns that hold lengths end in their unit.
"""

import csv
import json
import math
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any

from proximity.cli import progress
from proximity.cli.output import (
    FEW_DIGITS,
    MISSING,
    length,
    number,
    plain,
    print_block,
    printable,
    report,
    side,
)
from proximity.cli.parts.answers import Answers, Question
from proximity.cli.parts.points import Points
from proximity.errors import ProximityError
from proximity.system.table_text import table_text

TERMINAL_ROWS = 100  # more than a person reads from a screen
COUNT_WIDTH = 9
DIRECTION_DECIMALS = 9
DIGITS = 9  # significant, of numbers in a table
SIDE_WORDS = {"surface": "on the surface", "unknown": "which side is unknown"}
ON_FEATURES = {"face": "a face", "edge": "an edge", "vertex": "a corner"}
ENDINGS = {"face": " of the file", "fraction": " of the segment"}
LABELS_OF_A_RAY = {"closest point": "point"}


@dataclass(frozen=True, slots=True)
class Field:
    """One field of an answer; it is in JSON and CSV, in a table if it has a title, in lines with a label."""

    title: str = ""  # of its column in a table; the axis follows
    label: str = ""  # of its line
    axes: str = ""  # of three numbers
    is_length: bool = False  # in the user's unit
    width: int = 16  # of its column where lines are streamed, as -1.23456789e-100; negative: to the left
    is_text: bool = False

    def shown(self, value: Any, digits: int = DIGITS) -> str:
        """Return a value for people; components of directions that are rounding errors are zeros."""
        if self.is_text:
            return MISSING if value is None else printable(str(value))
        if self.is_length:
            return length(value, digits)
        return number(round(value, DIRECTION_DECIMALS) if self.axes else value, digits)


_text = partial(Field, width=-len("outside"), is_text=True)
FIELDS = {
    "name": _text("name", "name", width=-12),
    "start_name": _text("start_name", "start name", width=-12),
    "end_name": _text("end_name", "end name", width=-12),
    "query": Field(axes="xyz", is_length=True),
    "origin": Field(axes="xyz", is_length=True),
    "direction": Field(axes="xyz"),
    "start": Field(axes="xyz", is_length=True),
    "end": Field(axes="xyz", is_length=True),
    "signed_distance": Field("distance", "signed distance", is_length=True),
    "distance": Field("distance", "distance", is_length=True),
    "side": _text("side"),
    "is_signed": Field(),
    "fraction": Field(label="fraction"),
    "point": Field("point_", "closest point", axes="xyz", is_length=True),
    "point_on_segment": Field("segment_", "on segment", axes="xyz", is_length=True),
    "point_on_solid": Field("solid_", "on solid", axes="xyz", is_length=True),
    "gradient": Field("normal_", "normal", axes="xyz"),
    "normal": Field("normal_", "normal", axes="xyz"),
    "part": Field(),
    "part_name": _text("part", "part"),
    "face": _text("face", "face", width=COUNT_WIDTH),
    "face_id": Field(),
    "feature": _text("on", "on"),
    "barycentric": Field(axes="012"),
}
DISPENSABLE = (("gradient", "normal", "point_on_segment"), ("face", "feature"), ("part_name",))
"""Fields to leave out, in this order, until a table is as narrow as the terminal."""


def write_answers(
    question: Question, file: str, points: Iterable[Points], *, as_json: bool, as_csv: bool
) -> None:
    """Ask, and write the answers to stdout."""
    answers = question.answers(points)
    if as_json:
        _write_json(question, file, answers)
    elif as_csv:
        _write_csv(question, answers)
    else:
        _write_text(question, answers)


def _write_json(question: Question, file: str, chunks: Iterable[Answers]) -> None:
    """Write one JSON document: what was asked, then ``answers``, one a line.

    Where *chunks* end in an error behind some answers, these are written, and its sentence as ``error``: the
    document is complete. An error before any answer leaves nothing written.
    """
    head = {"file": file, "units": question.units, "mode": question.mode}
    opening, separator, write = json.dumps(head)[:-1] + ', "answers": [', "\n", sys.stdout.write
    try:
        for chunk in _with_bar(chunks):
            write(opening)
            opening = ""
            for values in zip(*chunk.values(), strict=True):
                answer = plain(dict(zip(chunk, values, strict=True)))
                write(separator + json.dumps(answer, allow_nan=False))
                separator = ",\n"
            sys.stdout.flush()
    except ProximityError as error:
        if not opening:
            write(f'\n], "error": {json.dumps(str(error))}}}\n')
        raise
    write("\n]}\n")


def _write_csv(question: Question, chunks: Iterable[Answers]) -> None:
    """Write a header and a line an answer; three numbers take three columns."""
    writer, has_header = csv.writer(sys.stdout, lineterminator="\n"), False
    for chunk in _with_bar(chunks):
        columns = list(_columns(chunk, question.units))
        if not has_header:
            writer.writerow(column.name_in_csv for column in columns)
            has_header = True
        cells = (map(table_text, each.values) if each.field.is_text else each.values for each in columns)
        writer.writerows(zip(*cells, strict=True))
        sys.stdout.flush()


def _write_text(question: Question, chunks: Iterator[Answers]) -> None:
    """Write labelled lines for a single answer; for several a table, on a terminal its start."""
    first = next(chunks)
    count = _count(first)
    if count == 1:
        print_block(_lines(question, {name: values[0] for name, values in first.items()}))
        next(chunks, None)  # a line behind it may be none
    elif sys.stdout.isatty():
        _draw({name: values[:TERMINAL_ROWS] for name, values in first.items()}, question.units)
        more = next(chunks, None)
        if count > TERMINAL_ROWS or more:
            known = f"{count} or more" if more else str(count)
            report(f"these are {TERMINAL_ROWS} of {known}; --csv, --json or a pipe shows all")
    else:
        number = 0
        for chunk in _with_bar(chain([first], chunks), is_piped=True):
            columns = _shown(chunk, question.units)
            if not number:
                _write_row("#", columns, [column.title for column in columns])
            for cells in zip(*(column.cells() for column in columns), strict=True):
                _write_row(str(number), columns, cells)
                number += 1
            sys.stdout.flush()


@dataclass(frozen=True, slots=True)
class _Column:
    name: str
    field: Field
    axis: str
    ending: str
    values: list[Any]

    @property
    def title(self) -> str:
        return f"{self.field.title}{self.axis}{self.ending}"

    @property
    def name_in_csv(self) -> str:
        # Plain x, y, z of the points asked from: what is written can be read again as points.
        words = (self.axis,) if self.name == "query" else (self.name, self.axis)
        return "_".join(filter(None, words)) + self.ending

    def cells(self, digits: int = DIGITS) -> list[str]:
        return [self.field.shown(value, digits) for value in self.values]


def _with_bar(chunks: Iterable[Answers], *, is_piped: bool = False) -> Iterable[Answers]:
    return progress.with_bar(chunks, _count, None, is_shown=is_piped or not sys.stdout.isatty())


def _count(answers: Answers) -> int:
    return len(next(iter(answers.values())))


def _columns(answers: Answers, units: str) -> Iterator[_Column]:
    for name, values in answers.items():
        field = FIELDS[name]
        ending = f"_{units}" if field.is_length else ""
        if not field.axes:
            yield _Column(name, field, "", ending, values)
        for axis, letter in enumerate(field.axes):
            yield _Column(name, field, letter, ending, [vector[axis] for vector in values])


def _shown(answers: Answers, units: str) -> list[_Column]:
    """Columns of a table: those with a title, the side behind the distance, and names of parts at the end."""
    columns = [column for column in _columns(answers, units) if column.field.title]
    if "is_signed" in answers:
        signs = zip(answers["signed_distance"], answers["is_signed"], strict=True)
        behind = [column.name for column in columns].index("signed_distance") + 1
        columns.insert(behind, _Column("side", FIELDS["side"], "", "", [side(*pair) for pair in signs]))
    return sorted(columns, key=lambda column: column.name == "part_name")


def _write_row(first: str, columns: list[_Column], cells: Iterable[str]) -> None:
    widths = (column.field.width for column in columns)
    aligned = (
        cell.rjust(width) if width > 0 else cell.ljust(-width)
        for cell, width in zip(cells, widths, strict=True)
    )
    sys.stdout.write(" ".join([first.rjust(COUNT_WIDTH), *aligned]).rstrip() + "\n")


def _draw(answers: Answers, units: str) -> None:
    """Draw the table of a few answers on a terminal, and say what that is too narrow for, if anything."""
    from proximity.cli import tables

    columns = _shown(answers, units)
    choices, drawn = [], []
    for count in range(len(DISPENSABLE) + 1):
        left_out = sum(DISPENSABLE[:count], ())
        kept = [column for column in columns if column.name not in left_out]
        for digits in (DIGITS, FEW_DIGITS):
            choices.append((kept, digits))
            titles = [("#", True), *((column.title, column.field.width > 0) for column in kept)]
            cells = zip(*(column.cells(digits) for column in kept), strict=True)
            drawn.append(tables.table_of(titles, ((str(row), *each) for row, each in enumerate(cells))))
    kept, digits = choices[tables.print_fitting(tables.Console(), drawn)]
    missing = ", ".join(column.title for column in columns if column not in kept)
    what = [f"columns are left out ({missing})"] if missing else []
    what += [f"numbers have {digits} digits"] if digits < DIGITS else []
    if what:
        report(f"note: the terminal is narrow: {' and '.join(what)}; --csv, --json or a pipe shows all")


def _lines(question: Question, answer: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Labels and values of one answer, with the names of its points where they have some."""
    is_closest = question.mode == "closest"
    for name, value in answer.items():
        field = FIELDS[name]
        if answer["face"] is None and not name.endswith("name"):
            continue
        if field.label and value is not None:
            label = field.label if is_closest else LABELS_OF_A_RAY.get(field.label, field.label)
            yield label, _reported(name, answer, question.units)
    if answer["face"] is None:
        yield "distance", _why_nothing(question.mode, answer)
    elif is_closest:
        solid = question.scene.parts[answer["part"]].solid
        yield "sign", f"{solid.sign_method.value}: {solid.sign_reason}"


def _reported(name: str, answer: dict[str, Any], units: str) -> str:
    """One field of an answer in words."""
    value, field = answer[name], FIELDS[name]
    if name == "feature":
        return ON_FEATURES.get(value, MISSING)
    ending = f" {units}" if field.is_length else ENDINGS.get(name, "")
    if name == "signed_distance":
        where = str(side(value, answer["is_signed"]))
        ending += f", {SIDE_WORDS.get(where, where)}"
    elif name == "distance" and "start" in answer and value == 0.0:
        ending += ", touches the surface"
    return "  ".join(map(field.shown, value if field.axes else [value])) + ending


def _why_nothing(mode: str, answer: dict[str, Any]) -> str:
    distance = answer["signed_distance" if mode == "closest" else "distance"]
    asked = [answer[name] for name in ("query", "origin", "direction", "start", "end") if name in answer]
    if not all(math.isfinite(value) for values in asked for value in values):
        why = "the point is not finite" if mode == "closest" else "the numbers given are not finite"
    elif math.isnan(distance):
        why = "too far away to be computed"
    else:
        why = "nothing in that direction" if mode == "ray" else "nothing"
    return f"{number(distance)} ({why})"
