"""Answers to queries for people: labelled lines for a single one, a table for several."""

import math
import sys
from collections.abc import Iterator
from itertools import chain
from typing import Any

from proximity.cli.output import number, print_block, report
from proximity.cli.parts.answers import (
    FIELDS,
    GIVEN,
    TEXT_WIDTHS,
    Answers,
    Column,
    Question,
    columns_of,
    count_of,
    counted_answers,
)

TERMINAL_ROWS = 100  # shown on a terminal
SIDE_WORDS = {"surface": "on the surface", "unknown": "which side is unknown"}
ON_FEATURES = {"face": "a face", "edge": "an edge", "vertex": "a corner"}
ENDINGS = {"face": " of the file", "fraction": " of the segment"}
SIGN_WORDS = {
    True: "inside and outside of this part are known",
    False: "this part has no inside: the distance has no sign; see `proximity check`",
}
DISPENSABLE = ("part_name", "point", "point_on_segment", "point_on_solid", "side")
"""Fields omitted, in this order, until a table fits the terminal."""


def write_text(question: Question, chunks: Iterator[Answers], *, is_whole: bool = False) -> None:
    """Write labelled lines for a single answer, a table for several; on a terminal the first rows only.

    *is_whole*: compute also the answers that are not shown.
    """
    first = next(chunks)
    count, more = count_of(first), None
    if count == 1:
        print_block(_lines(question, {name: values[0] for name, values in first.items()}))
        next(chunks, None)  # reports an invalid line after it
        return
    if sys.stdout.isatty():
        more = next(chunks, None)
        if more and is_whole:
            count, more = count + sum(map(count_of, chain([more], chunks))), None
        chunks, first = iter(()), {name: values[:TERMINAL_ROWS] for name, values in first.items()}
    row = 0
    for chunk in counted_answers(chain([first], chunks)):
        columns = _shown(question, chunk, row)
        if sys.stdout.isatty():
            _print_table(columns)
        else:
            _write_rows(columns, has_titles=not row)
        row += count_of(chunk)
        sys.stdout.flush()
    if question.mode == "crossings" and not row:
        report("note: no ray crosses a part")
    if count > row or more:
        known = f"{count} or more" if more else str(count)
        report(f"these are {row} of {known}; --csv FILE or a pipe shows all")


def _shown(question: Question, answers: Answers, first_row: int) -> list[Column]:
    """Return the columns of a table: name or number, points, distance, side, closest points, part."""
    columns = [
        column
        for column in columns_of(answers, question.units, question.decimals, question.width)
        if column.title
    ]
    if "is_signed" in answers:
        signs = zip(answers["signed_distance"], answers["is_signed"], strict=True)
        behind = [column.name for column in columns].index("signed_distance") + 1
        sides = [_side(*pair) for pair in signs]
        columns.insert(behind, Column("side", "side", "", FIELDS["side"], sides, -TEXT_WIDTHS["side"], 0))
    if "name" not in columns[0].name and columns[0].name not in ("ray", "point_number"):
        rows = list(range(first_row, first_row + count_of(answers)))
        columns.insert(0, Column("#", "#", "", GIVEN, rows, 5, 0))
    return columns


def _print_table(columns: list[Column]) -> None:
    """Print the table on a terminal; a narrow one gets fewer columns."""
    from proximity.cli import tables

    shown = [
        tables.Column(each.name, each.title, each.width > 0, list(map(each.cell, each.values)))
        for each in columns
    ]
    tables.print_fitting(tables.results_console(), shown, DISPENSABLE, "--csv FILE or a pipe")


def _write_rows(columns: list[Column], *, has_titles: bool) -> None:
    """Write all columns as lines, which other programs read while more are answered."""
    titles = [[column.title for column in columns]] if has_titles else []
    rows = zip(*(map(column.cell, column.values) for column in columns), strict=True)
    for row in chain(titles, rows):
        aligned = (
            cell.rjust(column.width) if column.width > 0 else cell.ljust(-column.width)
            for cell, column in zip(row, columns, strict=True)
        )
        sys.stdout.write(" ".join(aligned).rstrip() + "\n")


def _lines(question: Question, answer: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield labels and values of one answer, with the names of its points, if any."""
    is_closest, is_found = "signed_distance" in answer, answer["face_id"] is not None
    for name, value in answer.items():
        field = FIELDS.get(name, GIVEN)
        if not field.label or value is None or not (is_found or name.endswith("name")):
            continue
        ending = f" {question.units}" if field.is_length else ENDINGS.get(name, "")
        if name == "signed_distance":
            where = str(_side(value, answer["is_signed"]))
            ending += f", {SIDE_WORDS.get(where, where)}"
        elif name == "distance" and "start" in answer and value == 0.0:
            ending += ", touches the surface"
        words = "  ".join(field.shown(each, question.digits) for each in (value if field.axes else [value]))
        label = "point" if name == "point" and not is_closest else field.label
        yield label, (ON_FEATURES[value] if name == "feature" else words) + ending
    if not is_found:
        yield "distance", _why_nothing(question.mode, answer)
    elif is_closest:
        yield "sign", SIGN_WORDS[answer["is_signed"]]


def _why_nothing(mode: str, answer: dict[str, Any]) -> str:
    is_point = "signed_distance" in answer
    distance = answer["signed_distance" if is_point else "distance"]
    asked = [answer[name] for name in ("query", "origin", "direction", "start", "end") if name in answer]
    if not all(math.isfinite(value) for values in asked for value in values):
        why = "the point is not finite" if is_point else "the numbers given are not finite"
    elif math.isnan(distance):
        why = "too far away to be computed"
    else:
        why = "no part in that direction" if mode == "ray" else "no part"
    return f"{number(distance)} ({why})"


def _side(signed_distance: float, is_signed: bool) -> str | None:
    """Return the side of the surface on which a point is; None without an answer."""
    if math.isnan(signed_distance):
        return None
    if signed_distance == 0.0:
        return "surface"
    if not is_signed:
        return "unknown"
    return "inside" if signed_distance < 0.0 else "outside"
