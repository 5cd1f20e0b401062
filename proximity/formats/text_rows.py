"""Read rows of numbers in text strictly.

NumPy's loadtxt is as fast as its lenient fromstring and refuses words that are not numbers. If it fails, the
rows are read again to name the invalid word.
"""

from collections.abc import Callable

import numpy as np

from proximity.errors import MeshFormatError

MAX_EXACT_INTEGER = 2.0**53
"""Largest integer up to which float64 is exact. Indices are read as float64."""

PADDING = b"\0\x1a \t\r\n"
"""Bytes that may follow the end of a file, which are blanks, the end-of-file mark of CP/M and DOS, and
zeros."""

MAX_COUNT_DIGITS = 18
"""Maximum number of digits of a row count, so that it fits into 64 bits."""


def read_rows(rows: list[str], locate: Callable[[int], str]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return rows of numbers grouped by their width, as row ids (n,) and table (n, k) of each group."""
    if not rows:
        return []
    table = _uniform_table(rows)
    if table is not None:
        return [(np.arange(len(rows)), table)]
    widths = np.fromiter((len(row.split()) for row in rows), dtype=np.int64, count=len(rows))
    groups = []
    for width in np.unique(widths):
        row_ids = np.flatnonzero(widths == width)
        table = np.empty((len(row_ids), 0)) if width == 0 else _uniform_table([rows[i] for i in row_ids])
        if table is None:
            raise _not_a_number(rows, locate)
        groups.append((row_ids, table))
    return groups


def as_integers(values: np.ndarray, locate: Callable[[int], str]) -> np.ndarray:
    """Return a table of whole numbers (n, k) as int64.

    *locate*: function that returns the place of a row in the file.
    """
    if values.dtype.kind in "iu" and values.dtype.itemsize < 8:
        return values.astype(np.int64)
    is_good = np.abs(values.astype(np.float64)) <= MAX_EXACT_INTEGER
    if values.dtype.kind == "f":
        is_good &= values == np.rint(values)
    if not is_good.all():
        row, column = np.argwhere(~is_good)[0]
        raise MeshFormatError(
            f"{locate(int(row))} refers to vertex {values[row, column]}, expected a whole number"
        )
    return values.astype(np.int64)


def _uniform_table(rows: list[str]) -> np.ndarray | None:
    """Return all rows as one (n, k) table, or None if they are not numbers or differ in width."""
    try:
        table = np.loadtxt(rows, dtype=np.float64, comments=None, ndmin=2)
    except (ValueError, UserWarning):
        return None
    # loadtxt ignores blank rows.
    return table if len(table) == len(rows) else None


def _not_a_number(rows: list[str], locate: Callable[[int], str]) -> MeshFormatError:
    """Return an error about the first word that is not a number, which is found by bisection."""
    words = [(row_id, word) for row_id, row in enumerate(rows) for word in row.split()]
    while len(words) > 1:
        half = len(words) // 2
        is_good = _uniform_table([word for _, word in words[:half]]) is not None
        words = words[half:] if is_good else words[:half]
    for row_id, word in words:
        if _uniform_table([word]) is None:
            return MeshFormatError(f"{locate(row_id)} has {shortened(word)}, expected a number")
    return MeshFormatError("it contains a word that is not a number")


def as_count(word: str) -> int | None:
    """Return a number of rows, or None if *word* is not a number or has too many digits."""
    return int(word) if word.isdecimal() and len(word) <= MAX_COUNT_DIGITS else None


def as_text(data: bytes) -> str:
    """Return the text of a file, one letter for each byte.

    It has no byte order mark and no padding, and its lines end with \\n.
    """
    text = data.rstrip(PADDING).decode("latin-1").removeprefix("\xef\xbb\xbf")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def numbered_lines(text: str, first: int = 1) -> list[tuple[int, str]]:
    """Return the lines that are not blank, with their numbers in the file."""
    return [
        (line_id, row) for line_id, row in enumerate(text.split("\n"), first) if row and not row.isspace()
    ]


def regrouped(
    lines: list[tuple[int, str]], tables: list[tuple[int, list[bool]]]
) -> list[tuple[int, str]] | None:
    """Return the rows of tables as one line each, from tables whose rows span several lines.

    Return None if the numbers do not fit. A table is given by its number of rows, and for each column whether
    it is a list preceded by its length.
    """
    words = [(line_id, word) for line_id, line in lines for word in line.split()]
    rows: list[tuple[int, str]] = []
    end = 0
    for count, columns in tables:
        for _ in range(count):
            start = end
            for is_list in columns:
                entries = as_count(words[end][1]) if is_list and end < len(words) else 0
                if entries is None or end >= len(words):
                    return None
                end += 1 + entries
            rows.append((words[start][0], " ".join(word for _, word in words[start:end])))
    return rows if end == len(words) else None


def end_notes(data: bytes) -> list[str]:
    """Return a note if the last line of a text file has no line end.

    Its last number may be truncated. It is not an error, since many editors leave files like that.
    """
    has_end = data.rstrip(b"\0\x1a")[-1:] in (b"\n", b"\r")
    return [] if has_end else ["its last line has no end: it may have been cut off"]


def located_in(locate: Callable[[int], str], row_ids: np.ndarray) -> Callable[[int], str]:
    """Return a *locate* function for a table that contains only some of the rows."""
    return lambda row: locate(int(row_ids[row]))


def shortened(word: str, length: int = 24) -> str:
    """Return a word of a file for a message, quoted, shortened and without control characters."""
    return repr(word if len(word) <= length else word[:length] + "...")


def in_one_line(reason: Exception) -> str:
    """Return the type and the message of an exception in one line, shortened."""
    message = " ".join(str(reason).split())
    return f"{type(reason).__name__}: {message[:120]}" if message else type(reason).__name__


def listed(names: list[str], most: int = 3) -> str:
    """Return the first names of a list and the number of the others, for a note."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
