"""Strict reader of rows of numbers in text.

NumPy's loadtxt is as fast as its lenient fromstring, and refuses what is not a number; on a refusal the
rows are walked once more to name the offender.
"""

from collections.abc import Callable

import numpy as np

from proximity.errors import MeshFormatError

LARGEST_EXACT_INTEGER = 2.0**53
"""Indices are read as float64; up to here that loses nothing."""

PADDING = b"\0\x1a \t\r\n"
"""What may stand behind the end of a file: blanks, the end-of-file mark of CP/M and DOS, full blocks."""

MOST_COUNT_DIGITS = 18
"""Of the number of rows that a file declares; that many fit into 64 bits."""


def read_rows(rows: list[str], locate: Callable[[int], str]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rows of numbers, grouped by how many they have: row ids (n,) and table (n, k) of each width."""
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
    """A table of whole numbers (n, k) as int64; *locate* says where a row is in the file."""
    if values.dtype.kind in "iu" and values.dtype.itemsize < 8:
        return values.astype(np.int64)
    is_good = np.abs(values.astype(np.float64)) <= LARGEST_EXACT_INTEGER
    if values.dtype.kind == "f":
        is_good &= values == np.rint(values)
    if not is_good.all():
        row, column = np.argwhere(~is_good)[0]
        raise MeshFormatError(
            f"{locate(int(row))} refers to vertex {values[row, column]}, expected a whole number"
        )
    return values.astype(np.int64)


def _uniform_table(rows: list[str]) -> np.ndarray | None:
    """All rows as one (n, k) table, or None where that is not possible."""
    try:
        table = np.loadtxt(rows, dtype=np.float64, comments=None, ndmin=2)
    except (ValueError, UserWarning):
        return None
    # loadtxt passes over blank rows.
    return table if len(table) == len(rows) else None


def _not_a_number(rows: list[str], locate: Callable[[int], str]) -> MeshFormatError:
    """Return the error for the first word that is not a number, by bisection."""
    words = [(row_id, word) for row_id, row in enumerate(rows) for word in row.split()]
    while len(words) > 1:
        half = len(words) // 2
        is_good = _uniform_table([word for _, word in words[:half]]) is not None
        words = words[half:] if is_good else words[:half]
    for row_id, word in words:
        if _uniform_table([word]) is None:
            return MeshFormatError(f"{locate(row_id)} has {shortened(word)}, expected a number")
    return MeshFormatError("something in it is not a number")


def as_count(word: str) -> int | None:
    """A number of rows, or None where *word* is none, or of more digits than any file has rows."""
    return int(word) if word.isdecimal() and len(word) <= MOST_COUNT_DIGITS else None


def as_text(data: bytes) -> str:
    """The text of a file, byte by byte; byte order mark and padding are taken off, and lines end with \\n."""
    text = data.rstrip(PADDING).decode("latin-1").removeprefix("\xef\xbb\xbf")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def numbered_lines(text: str, first: int = 1) -> list[tuple[int, str]]:
    """Lines that are not blank, with their numbers in the file."""
    return [
        (line_id, row) for line_id, row in enumerate(text.split("\n"), first) if row and not row.isspace()
    ]


def regrouped(
    lines: list[tuple[int, str]], tables: list[tuple[int, list[bool]]]
) -> list[tuple[int, str]] | None:
    """One row a line, of tables whose rows run over lines; None where the numbers do not come out even.

    A table is its number of rows, and for each column whether it is a list with its length in front.
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
    """A note if the last line of a text file has no end: its last number may have lost digits.

    Many editors leave files like that, so that it is no error.
    """
    has_end = data.rstrip(b"\0\x1a")[-1:] in (b"\n", b"\r")
    return [] if has_end else ["its last line has no end: it may have been cut off"]


def located_in(locate: Callable[[int], str], row_ids: np.ndarray) -> Callable[[int], str]:
    """*locate* for a table that holds only some of the rows."""
    return lambda row: locate(int(row_ids[row]))


def shortened(word: str, length: int = 24) -> str:
    """A word of a file, quoted, without control characters, no longer than a message can bear."""
    return repr(word if len(word) <= length else word[:length] + "...")


def in_one_line(reason: Exception) -> str:
    """Return type and message of an exception, shortened."""
    message = " ".join(str(reason).split())
    return f"{type(reason).__name__}: {message[:120]}" if message else type(reason).__name__


def listed(names: list[str], most: int = 3) -> str:
    """Return the first names of many, for a note, and how many there are besides."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
