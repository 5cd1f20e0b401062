"""Points from text: three numbers a line, as CSV or between spaces, read in chunks.

Only the standard library: text that begins badly is refused before NumPy and the file are loaded.
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
from typing import TextIO

from proximity.errors import ArgumentError

STANDARD_INPUT = "-"
BYTE_ORDER_MARK = "\ufeff"  # spreadsheets begin their UTF-8 with it
BEGINS_A_NUMBER = tuple("+-.0123456789")
WORDS_FOR_UNITS = {
    "metre": "m", "millimetre": "mm", "centimetre": "cm", "decimetre": "dm", "micrometre": "um",
    "nanometre": "nm", "kilometre": "km", "meter": "m", "millimeter": "mm", "centimeter": "cm",
    "decimeter": "dm", "micrometer": "um", "nanometer": "nm", "kilometer": "km", "micron": "um",
    "\N{GREEK SMALL LETTER MU}m": "um", "inch": "in", "inche": "in", "foot": "ft", "feet": "ft", "yard": "yd",
    "mile": "mi", "thou": "mil",
}  # fmt: skip
"""Other words for units than `meshio.UNITS` has, without an s at the end."""
NO_LETTER = re.compile(r"[\W\d_]")
BEFORE_COMMENT = re.compile(r'(?:"[^"]*"|[^#]|(?<=\S)#)*')
"""What stands before a # at the start of a line or after white space; others belong to names, as in pin#2."""
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
BETWEEN_NUMBERS = re.compile(r"[,;\s]+")
NAME = "name"
"""The column that goes through to the answers."""
NAMES_NOTED = 3
LONGEST_LINE = 1_000_000
"""Characters: what never ends is no text of points."""

Note = Callable[[str], None]


@dataclass(slots=True)
class Points:
    """Points as they were typed or read."""

    coordinates: array = field(default_factory=lambda: array("d"))  # flat: x y z x y z ...
    names: list[str] | None = None  # one a point; None where there is no such column

    def __len__(self) -> int:
        return len(self.coordinates) // 3


def read_points(
    path: str, units: str = "mm", limit: int = 20_000, note: Note = lambda sentence: None
) -> Iterator[Points]:
    """Yield the points of a text file in chunks.

    Blank lines and comments are skipped; a comment begins with ``#`` at the start of a line or behind white
    space. Fields stand between commas, semicolons or white space. The first line may name the columns: x, y
    and z among others, with their unit behind them or not, or three other names in this order. No name begins
    like a number. A column called ``name`` is kept.

    *units*: of the coordinates; a header that names another unit contradicts it. *limit*: points in a chunk.
    A shorter chunk is the last; there is at least one, perhaps empty. *note*: is given a sentence about
    columns that are not used, and about text without a point.
    """
    name = "standard input" if path == STANDARD_INPUT else path
    try:
        if path == STANDARD_INPUT:
            if sys.stdin is None:
                raise ArgumentError("standard input is closed, expected lines of three numbers")
            if hasattr(sys.stdin, "reconfigure"):
                sys.stdin.reconfigure(encoding="utf-8", errors="surrogateescape")
            yield from parse_points(_lines(sys.stdin), name, units, limit, note)
        else:
            with Path(path).open(encoding="utf-8", errors="surrogateescape") as stream:
                yield from parse_points(_lines(stream), name, units, limit, note)
    except OSError as failure:
        raise ArgumentError(f"{name}: cannot be read ({failure.strerror or failure})") from failure


def parse_points(
    lines: Iterable[str],
    name: str,
    units: str = "mm",
    limit: int = 20_000,
    note: Note = lambda sentence: None,
) -> Iterator[Points]:
    """Yield the points of *lines* as `read_points` does.

    *lines*: the text; bytes that are no UTF-8 stand in it as surrogates.
    """
    reader = _Reader(name, units, note)
    has_yielded = False
    try:
        for row, line in enumerate(lines, start=1):
            reader.read(row, line)
            if len(reader.points) >= limit:
                yield reader.taken()
                has_yielded = True
    except (ArgumentError, OSError):
        if len(reader.points):
            yield reader.taken()
        raise
    if not len(reader.points) and not has_yielded:
        note(f"{name} holds no points")
    if len(reader.points) or not has_yielded:
        yield reader.taken()


class _Reader:
    """Reads line by line, and collects points until they are taken."""

    def __init__(self, name: str, units: str, note: Note) -> None:
        self._name, self._units, self._note = name, units, note
        self._columns: tuple[int, ...] | None = None  # which fields are x, y, z; None before the first line
        self._name_column: int | None = None
        self._field_count = 3
        self._has_header = False
        self.points = Points()

    def taken(self) -> Points:
        """Return what was collected, and begin anew."""
        points = self.points
        self.points = Points(names=None if points.names is None else [])
        return points

    def read(self, row: int, line: str) -> None:
        """Read a line: a point, a header, or nothing."""
        where = f"{self._name}, line {row}"
        _check_text(line, where)
        try:
            fields = _fields(line.removeprefix(BYTE_ORDER_MARK) if row == 1 else line)
        except csv.Error as unfit:
            raise ArgumentError(f"{where}: {unfit}, expected three numbers") from unfit
        if not fields:
            return
        if not fields[-1] and len(fields) != self._field_count:
            del fields[-1]  # some programs end every line with a separator
        if self._columns is None and self._is_header(fields, where):
            return
        if len(fields) != self._field_count:
            _refuse_decimal_commas(line, where)
            hint = (
                "; a first line such as x,y,z,name allows names"
                if len(fields) > 3 and not self._has_header
                else ""
            )
            raise ArgumentError(f"{where}: {_counted(len(fields))}, expected {self._field_count}{hint}")
        try:
            self.points.coordinates.extend([number(fields[column]) for column in self._columns or (0, 1, 2)])
        except ValueError as unfit:
            _refuse_decimal_commas(line, where)
            raise ArgumentError(f"{where}: {unfit}") from unfit
        if self._name_column is not None and self.points.names is not None:
            self.points.names.append(fields[self._name_column])

    def _is_header(self, fields: list[str], where: str) -> bool:
        """Whether the first line names the columns; which are which is known from then on."""
        columns = _columns_of_header(fields, where)
        self._columns = columns or (0, 1, 2)
        if columns is None:
            return False
        _check_units([fields[column] for column in columns], self._units, where)
        self._field_count = len(fields)
        names = [name.lower() for name in fields]
        if NAME in names and names.index(NAME) not in columns:
            self._name_column, self.points.names = names.index(NAME), []
        self._has_header = True
        self._note_unused([name for at, name in enumerate(fields) if at not in (*columns, self._name_column)])
        return True

    def _note_unused(self, names: list[str]) -> None:
        if names:
            more = f" and {len(names) - NAMES_NOTED} more" if len(names) > NAMES_NOTED else ""
            shown = ", ".join(map(_shown, names[:NAMES_NOTED]))
            self._note(
                f"{self._name}: only a column called {NAME} is copied to the answers, not {shown}{more}"
            )


def _lines(stream: TextIO) -> Iterator[str]:
    return iter(partial(stream.readline, LONGEST_LINE), "")


def _check_text(line: str, where: str) -> None:
    if len(line) >= LONGEST_LINE:
        raise ArgumentError(f"{where}: has {LONGEST_LINE} characters or more, expected three numbers")
    if not line.isascii() and any("\udc80" <= letter <= "\udcff" for letter in line):
        raise ArgumentError(
            f"{where}: not text in UTF-8, expected a text file with three numbers on each line"
        )


def _fields(line: str) -> list[str]:
    if "#" in line:
        before = BEFORE_COMMENT.match(line)
        line = before.group() if before else line
    text = line.strip()
    for separator in ",;":
        if separator in text:
            quoted = '"' in text
            fields = next(csv.reader([text], delimiter=separator)) if quoted else text.split(separator)
            return [field.strip() for field in fields]
    return text.split()


def _columns_of_header(fields: list[str], where: str) -> tuple[int, ...] | None:
    """Return which columns hold x, y and z, or None where *fields* are numbers, perhaps misspelt ones."""
    if any(_is_number(field) or field.startswith(BEGINS_A_NUMBER) for field in fields):
        return None
    names = [field.lower() for field in fields]
    words = [NO_LETTER.split(name, maxsplit=1)[0] for name in names]
    for spelt in (names, words):  # "x" before "x [mm]"
        if all(spelt.count(axis) == 1 for axis in "xyz"):
            return spelt.index("x"), spelt.index("y"), spelt.index("z")
    if len(fields) == 3 and all(names) and not {"x", "y", "z"} & set(words):
        return 0, 1, 2
    raise ArgumentError(
        f"{where}: {_shown(' '.join(fields))} is neither a point nor a header, "
        "expected three numbers or columns named x, y and z"
    )


def _check_units(names: list[str], units: str, where: str) -> None:
    """Refuse columns that say of themselves to be in another unit: answers would be wrong by a factor."""
    for name in names:
        behind = [word for word in NO_LETTER.split(name.casefold()) if word][1:]
        if behind and behind[-1] != units:
            from proximity.formats import UNITS  # slow, and only for who says more than x

            reported = [
                unit for word in behind if (unit := WORDS_FOR_UNITS.get(word.rstrip("s"), word)) in UNITS
            ]
            if reported and units not in reported:
                unit = reported[-1]
                raise ArgumentError(
                    f"{where}: column {_shown(name)} is in {'inches' if unit == 'in' else unit}, expected "
                    f"{units}; add --units {unit}"
                )


def number(text: str) -> float:
    """Return the number that *text* spells, nan and inf included."""
    try:
        value = None if "_" in text else float(text)  # Python would read 1_000
    except ValueError:
        value = None
    if value is None:
        raise ValueError(_why_no_number(text.strip()))
    if math.isinf(value) and any(letter.isdigit() for letter in text):
        raise ValueError(f"{_shown(text.strip())} is beyond {sys.float_info.max:.2g}, the largest number")
    return value


def finite_number(text: str) -> float:
    """Return the number that *text* spells."""
    value = number(text)
    if not math.isfinite(value):
        raise ValueError(f"{_shown(text.strip())} is not finite, expected a number")
    return value


def _why_no_number(text: str) -> str:
    if DECIMAL_COMMA.fullmatch(text):
        return f"{_shown(text)} has a decimal comma, expected a decimal point: {text.replace(',', '.')}"
    numbers = [word for word in BETWEEN_NUMBERS.split(text) if word]
    if ("," in text or ";" in text) and numbers and all(map(_is_number, numbers)):
        return f"{_shown(text)} is not a number; separate numbers by spaces only: {_cut(' '.join(numbers))}"
    return f"{_shown(text)} is not a number"


def _refuse_decimal_commas(line: str, where: str) -> None:
    """Say so where a line that cannot be read has them: between semicolons or white space."""
    words = re.split(r"[;\s]+", line.strip("; \t\r\n"))
    with_comma = [word for word in words if DECIMAL_COMMA.fullmatch(word)]
    are_numbers = all(word in with_comma or _is_number(word) for word in words)
    if len(words) >= 3 and with_comma and (are_numbers or ";" in line):
        raise ArgumentError(f"{where}: {_why_no_number(with_comma[0])}")


def _is_number(field: str) -> bool:
    try:
        number(field)
    except ValueError:
        return False
    return True


def _counted(count: int) -> str:
    return "1 value" if count == 1 else f"{count} values"


def _shown(text: str) -> str:
    """Quote *text* for a message: printable and not too long."""
    return repr(_cut(text))


def _cut(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."
