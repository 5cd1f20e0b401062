"""Points from text: three numbers a line, as CSV or between spaces.

Only the standard library: bad text is refused before NumPy and the file are loaded.
"""

import csv
import re
import sys
from array import array
from collections.abc import Iterable
from pathlib import Path

from proximity.errors import QueryError

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


def read_points(path: str, units: str = "mm") -> array:
    """Return the points of a text file as a flat array of float64, x y z x y z ...

    Blank lines and what follows ``#`` are skipped. Fields stand between commas, semicolons or white space.
    The first line may name the columns: x, y and z among others, with their unit behind them or not, or
    three other names in this order. No name begins like a number.

    Parameters
    ----------
    path : str
        The file; ``-`` is standard input.
    units : str
        Of the coordinates; a header that names another unit contradicts it.

    Raises
    ------
    QueryError
        If the file cannot be read or a line is not a point; the message names file and line.
    """
    name = "standard input" if path == STANDARD_INPUT else path
    try:
        if path == STANDARD_INPUT:
            if sys.stdin is None:
                raise QueryError("standard input is closed, expected lines of three numbers")
            return parse_points(sys.stdin, name, units)
        with Path(path).open(encoding="utf-8") as lines:
            return parse_points(lines, name, units)
    except UnicodeDecodeError as unfit:
        raise QueryError(f"{name}: not a text file in UTF-8, expected lines of three numbers") from unfit
    except OSError as failure:
        raise QueryError(f"{name}: cannot be read ({failure.strerror or failure})") from failure


def parse_points(lines: Iterable[str], name: str, units: str = "mm") -> array:
    """Return the points of *lines* as `read_points` does.

    Parameters
    ----------
    lines : iterable of str
        The text.
    name : str
        Where it comes from, for messages.
    units : str
        As of `read_points`.

    Raises
    ------
    QueryError
        If a line is not a point, or the header names another unit.
    """
    coordinates = array("d")
    columns: tuple[int, ...] | None = None  # which fields are x, y, z; None until the first line is seen
    field_count = 3
    for row, line in enumerate(lines, start=1):
        where = f"{name}, line {row}"
        try:
            fields = _fields(line.removeprefix(BYTE_ORDER_MARK) if row == 1 else line)
        except csv.Error as unfit:
            raise QueryError(f"{where}: {unfit}, expected three numbers") from unfit
        if not fields:
            continue
        if not fields[-1] and len(fields) != field_count:
            del fields[-1]  # some programs end every line with a separator
        if columns is None:
            columns = _columns_of_header(fields, where)
            if columns is not None:
                _check_units([fields[column] for column in columns], units, where)
                field_count = len(fields)
                continue
            columns = (0, 1, 2)
        if len(fields) != field_count:
            raise QueryError(f"{where}: {_counted(len(fields))}, expected {field_count}")
        try:
            coordinates.extend([number(fields[column]) for column in columns])
        except ValueError as unfit:
            raise QueryError(f"{where}: {unfit}") from unfit
    return coordinates


def _fields(line: str) -> list[str]:
    text = line.partition("#")[0].strip()
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
    raise QueryError(
        f"{where}: {_shown(' '.join(fields))} is neither a point nor a header, "
        "expected three numbers or columns named x, y and z"
    )


def _check_units(names: list[str], units: str, where: str) -> None:
    """Refuse columns that say of themselves to be in another unit: answers would be wrong by a factor."""
    for name in names:
        behind = [word for word in NO_LETTER.split(name.casefold()) if word][1:]
        if behind and behind[-1] != units:
            from proximity.meshio import UNITS  # slow, and only for who says more than x

            told = [unit for word in behind if (unit := WORDS_FOR_UNITS.get(word.rstrip("s"), word)) in UNITS]
            if told and units not in told:
                raise QueryError(
                    f"{where}: {_shown(name)} is in {told[-1]}, expected {units}, as --units says"
                )


def number(text: str) -> float:
    """Return the number that *text* spells, nan and inf included.

    Parameters
    ----------
    text : str
        One field.

    Raises
    ------
    ValueError
        If it spells none.
    """
    try:
        if "_" not in text:  # Python would read 1_000
            return float(text)
    except ValueError:
        pass
    raise ValueError(f"{_shown(text.strip())} is not a number")


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
    return repr(text if len(text) <= 40 else text[:37] + "...")
