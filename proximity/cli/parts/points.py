"""Read points in chunks from text with three numbers per line, or from the vertices of meshes.

Numbers are separated by commas or spaces. Reading text needs only the standard library, so that an invalid
start is rejected before NumPy and the parts are loaded.
"""

import csv
import math
import re
import sys
from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple, TextIO

from proximity.errors import ArgumentError

STANDARD_INPUT = "-"
BEGINS_A_NUMBER = tuple("+-.0123456789")
NO_LETTER = re.compile(r"[\W\d_]")
BEFORE_COMMENT = re.compile(r'(?:"[^"]*"|[^#]|(?<=\S)#)*')
"""Pattern of the text before a comment. A comment begins with # at the start of a line or after white space;
any other # belongs to a name such as pin#2."""
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
NAME = "name"  # name of a column, in upper or lower case
MAX_LINE = 1_000_000
"""Maximum length of a line, letters. A longer line is not text of points."""

Note = Callable[[str], None]


@dataclass(slots=True)
class Points:
    """Points that were typed or read."""

    coordinates: array = field(default_factory=lambda: array("d"))  # x y z x y z ...
    kept: dict[str, list[str]] = field(default_factory=dict)  # values of the other columns by their names

    def __len__(self) -> int:
        return len(self.coordinates) // 3


class Columns(NamedTuple):
    """Meaning of the fields in a line."""

    axes: tuple[int, ...] = (0, 1, 2)
    kept: tuple[tuple[str, int], ...] = ()  # names and indices of the other fields
    field_count: int = 3
    is_header: bool = False  # whether the first line is a header


NORMALS = Columns(kept=(("nx", 3), ("ny", 4), ("nz", 5)), field_count=6)
"""Columns of lines with six numbers and no header, which are positions and normals."""
MESHES = (".ply", ".stl", ".obj")


def read_points(
    path: str,
    units: str = "mm",
    limit: int = 20_000,
    note: Note = lambda sentence: None,
    points_units: str | None = None,
) -> Iterator[Points]:
    """Yield the points of a text file, or the vertices of a PLY, STL or OBJ file, in chunks.

    Blank lines and comments are skipped. A comment begins with ``#`` at the start of a line or after white
    space. Fields are separated by commas, semicolons or white space. The first line may name the columns: x,
    y and z among others, optionally with their unit, or three other names in this order. A name does not
    begin like a number. Other columns are kept as text.

    *units*: unit of the returned coordinates. Another unit in the header raises an error. *points_units*:
    unit of the file if it is not *units*; the points are converted. *limit*: maximum number of points in a
    chunk. Only the last chunk is shorter; there is at least one, which may be empty. *note*: function called
    with a note if a text has no points.
    """
    if points_units is not None:
        from proximity.formats import metres_per_unit  # slow to import

        factor = metres_per_unit(points_units) / metres_per_unit(units)
        for chunk in read_points(path, points_units, limit, note):
            yield Points(array("d", [factor * value for value in chunk.coordinates]), chunk.kept)
        return
    name = "standard input" if path == STANDARD_INPUT else path
    if path == STANDARD_INPUT and sys.stdin is None:
        raise ArgumentError("standard input is closed, expected lines of three numbers")
    try:
        if path.lower().endswith(MESHES):
            yield from _vertices(path, limit)
        elif path == STANDARD_INPUT:
            if hasattr(sys.stdin, "reconfigure"):
                sys.stdin.reconfigure(encoding="utf-8", errors="surrogateescape")
            yield from parse_points(_lines(sys.stdin), name, units, limit, note)
        else:
            with Path(path).open(encoding="utf-8", errors="surrogateescape") as stream:
                yield from parse_points(_lines(stream), name, units, limit, note)
    except OSError as failure:
        raise ArgumentError(f"{name}: cannot be read ({failure.strerror or failure})") from failure


def read_ahead(chunks: Iterator[Points], limit: int) -> tuple[Iterator[Points], list[float]]:
    """Read the first chunks, up to *limit* points.

    Return an iterator over all chunks, and the sides of the box around the points that were read. At least
    one chunk is read, and errors in it are raised immediately. The sides are empty if no point is finite.
    """
    read, failure = [next(chunks)], None
    try:
        while sum(map(len, read)) < limit and (chunk := next(chunks, None)) is not None:
            read.append(chunk)
    except ArgumentError as reason:
        failure = reason

    def again() -> Iterator[Points]:
        yield from read
        if failure is not None:
            raise failure
        yield from chunks

    rows = (row for chunk in read for row in zip(*(chunk.coordinates[k::3] for k in range(3)), strict=True))
    axes = zip(*(row for row in rows if all(map(math.isfinite, row))), strict=True)
    return again(), [max(values) - min(values) for values in axes]


def _vertices(path: str, limit: int) -> Iterator[Points]:
    """Yield the vertices of a mesh in chunks."""
    from proximity.errors import MeshError
    from proximity.formats.file_reader import read_vertices

    try:
        vertices = read_vertices(path)
    except MeshError as invalid:
        raise ArgumentError(str(invalid)) from invalid
    for first in range(0, len(vertices), limit):
        yield Points(array("d", vertices[first : first + limit].tobytes()))


def parse_points(
    lines: Iterable[str],
    name: str,
    units: str = "mm",
    limit: int = 20_000,
    note: Note = lambda sentence: None,
) -> Iterator[Points]:
    """Yield the points in lines of text as `read_points` does.

    *lines*: the text, with invalid UTF-8 as surrogates.
    """
    columns: Columns | None = None
    points, has_yielded = Points(), False
    try:
        for row, line in enumerate(lines, start=1):
            where = f"{name}, line {row}"
            fields = _fields(line, where)
            if not fields:
                continue
            if not fields[-1] and len(fields) != (columns or Columns()).field_count:
                del fields[-1]  # some programs end every line with a separator
            if columns is None:
                has_normals = len(fields) == NORMALS.field_count and all(map(_is_number, fields))
                columns = _header(fields, where, units) or (NORMALS if has_normals else Columns())
                points = _empty(columns)
                if columns.is_header:
                    continue
            _append(points, columns, fields, line, where)
            if len(points) >= limit:
                yield points
                points, has_yielded = _empty(columns), True
    except (ArgumentError, OSError):
        if len(points):
            yield points
        raise
    if not len(points) and not has_yielded:
        note(f"{name} contains no points")
    if len(points) or not has_yielded:
        yield points


def _lines(stream: TextIO) -> Iterator[str]:
    return iter(partial(stream.readline, MAX_LINE), "")


def _empty(columns: Columns) -> Points:
    return Points(kept={name: [] for name, _ in columns.kept})


def _fields(line: str, where: str) -> list[str]:
    if len(line) >= MAX_LINE:
        raise ArgumentError(f"{where}: has {MAX_LINE} characters or more, expected three numbers")
    if not line.isascii() and any("\udc80" <= letter <= "\udcff" for letter in line):
        raise ArgumentError(
            f"{where}: not text in UTF-8, expected a text file with three numbers on each line"
        )
    if "#" in line and (before := BEFORE_COMMENT.match(line)):
        line = before.group()
    text = line.removeprefix("\ufeff").strip()  # spreadsheets begin their UTF-8 with a mark
    separator = next((letter for letter in ",;" if letter in text), None)
    if '"' not in text or separator is None:
        return [word.strip() for word in text.split(separator)]
    try:
        return [word.strip() for word in next(csv.reader([text], delimiter=separator))]
    except csv.Error as invalid:
        raise ArgumentError(f"{where}: {invalid}, expected three numbers") from invalid


def _append(points: Points, columns: Columns, fields: list[str], line: str, where: str) -> None:
    """Append the point of a line, or raise an error that names the line."""
    try:
        if len(fields) != columns.field_count:
            hint = "; a first line such as x,y,z,name allows names"
            hint = hint if len(fields) > 3 and not columns.is_header else ""
            values = "1 value" if len(fields) == 1 else f"{len(fields)} values"
            raise ValueError(f"{values}, expected {columns.field_count}{hint}")
        points.coordinates.extend([number(fields[column]) for column in columns.axes])
    except ValueError as invalid:
        words = re.split(r"[;\s]+", line.strip("; \t\r\n"))  # a comma within a word is a decimal comma
        with_comma = [word for word in words if DECIMAL_COMMA.fullmatch(word)]
        are_numbers = all(word in with_comma or _is_number(word) for word in words)
        is_comma = len(words) >= 3 and with_comma and (are_numbers or ";" in line)
        raise ArgumentError(f"{where}: {_why_no_number(with_comma[0]) if is_comma else invalid}") from invalid
    for name, column in columns.kept:
        points.kept[name].append(fields[column])


def _header(fields: list[str], where: str, units: str) -> Columns | None:
    """Return the columns that a header names, or None if *fields* are numbers, which may be misspelt."""
    if any(_is_number(word) or word.startswith(BEGINS_A_NUMBER) for word in fields):
        return None
    names = [word.lower() for word in fields]
    words = [NO_LETTER.split(name, maxsplit=1)[0] for name in names]
    axes = (0, 1, 2) if len(fields) == 3 and all(names) and not {*"xyz"} & {*words} else None
    for spelt in (words, names):  # first the words before a unit, such as "x" of "x [mm]"
        if all(spelt.count(axis) == 1 for axis in "xyz"):
            axes = spelt.index("x"), spelt.index("y"), spelt.index("z")
    if axes is None:
        raise ArgumentError(
            f"{where}: {_shown(' '.join(fields))} is neither a point nor a header, "
            "expected three numbers or columns named x, y and z"
        )
    for axis in axes:
        _check_unit(fields[axis], units, where)
    others = {
        NAME if name.lower() == NAME else name: column
        for column, name in enumerate(fields)
        if name and column not in axes
    }
    return Columns(axes, tuple(others.items()), len(fields), is_header=True)


def _check_unit(name: str, units: str, where: str) -> None:
    """Raise an error for a column whose name has another unit.

    Otherwise answers would be wrong by a factor.
    """
    behind = [word for word in NO_LETTER.split(name.casefold()) if word][1:]
    if not behind or behind[-1] == units:
        return
    from proximity.formats import SYNONYMS, UNITS  # slow to import, and only needed for names with a unit

    known = [unit for word in behind if (unit := SYNONYMS.get(word.removesuffix("s"), word)) in UNITS]
    if known and units not in known:
        spelt = "inches" if known[-1] == "in" else known[-1]
        raise ArgumentError(
            f"{where}: column {_shown(name)} is in {spelt}, expected {units}; add --points-units {known[-1]}"
        )


def number(text: str, *, is_finite: bool = False) -> float:
    """Return the number in *text*. Unless *is_finite*, it may be nan or infinite."""
    try:
        value = float("" if "_" in text else text)  # Python would read 1_000
    except ValueError:
        raise ValueError(_why_no_number(text.strip())) from None
    if math.isinf(value) and any(letter.isdigit() for letter in text):
        raise ValueError(f"{_shown(text.strip())} is beyond {sys.float_info.max:.2g}, the largest number")
    if is_finite and not math.isfinite(value):
        raise ValueError(f"{_shown(text.strip())} is not finite, expected a number")
    return value


def _why_no_number(text: str) -> str:
    if DECIMAL_COMMA.fullmatch(text):
        return f"{_shown(text)} has a decimal comma, expected a decimal point: {text.replace(',', '.')}"
    numbers = [word for word in re.split(r"[,;\s]+", text) if word]
    if ("," in text or ";" in text) and numbers and all(map(_is_number, numbers)):
        return f"{_shown(text)} is not a number; separate numbers by spaces only: {_cut(' '.join(numbers))}"
    return f"{_shown(text)} is not a number"


def _is_number(text: str) -> bool:
    try:
        number(text)
    except ValueError:
        return False
    return True


def _shown(text: str) -> str:
    """Return *text* quoted and shortened, with escapes for unprintable characters, for a message."""
    return repr(_cut(text))


def _cut(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."
