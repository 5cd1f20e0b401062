"""Strict reader of rows of numbers in text.

NumPy's loadtxt is as fast as its lenient fromstring, and refuses what is not a number; on a refusal the
rows are walked once more to name the offender.
"""

from collections.abc import Callable

import numpy as np

from proximity.errors import MeshFormatError

LARGEST_EXACT_INTEGER = 2.0**53
"""Indices are read as float64; up to here that loses nothing."""

MOST_COUNT_DIGITS = 18
"""Of the number of rows that a file declares; that many fit into 64 bits."""


def read_rows(rows: list[str], locate: Callable[[int], str]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Read rows of numbers, grouped by how many numbers they have.

    Parameters
    ----------
    rows : list of str
        Numbers separated by blanks.
    locate : callable
        Row -> where it is in the file, for the message.

    Returns
    -------
    list of (row_ids (n,) int64, table (n, k) float64)
        One pair for each width, rows in order.

    Raises
    ------
    MeshFormatError
        If something is not a number; the message names the place and the word.
    """
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
    """Return a table of whole numbers as int64.

    Parameters
    ----------
    values : (n, k) numbers
        What should be indices or counts.
    locate : callable
        Row of *values* -> where it is in the file.

    Raises
    ------
    MeshFormatError
        If one is not whole, not finite, or too large to be an index.
    """
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
    for row_id, row in enumerate(rows):
        for word in row.split():
            if _uniform_table([word]) is None:
                return MeshFormatError(f"{locate(row_id)} has {shortened(word)}, expected a number")
    return MeshFormatError("something in it is not a number")


def as_count(word: str) -> int | None:
    """Return a number of rows, or None where *word* is none, or of more digits than any file has rows."""
    return int(word) if word.isdecimal() and len(word) <= MOST_COUNT_DIGITS else None


def end_notes(data: bytes) -> list[str]:
    """Return a note if the last line of a text file has no end.

    Parameters
    ----------
    data : bytes
        The whole file. Its last number may have lost digits, which no count can show; but many editors leave
        files like that, so that it is no error.
    """
    return [] if data[-1:] in (b"\n", b"\r") else ["its last line has no end: it may have been cut off"]


def of_rows(locate: Callable[[int], str], row_ids: np.ndarray) -> Callable[[int], str]:
    """Return *locate* for a table that holds only some of the rows.

    Parameters
    ----------
    locate : callable
        Row -> where it is in the file.
    row_ids : (n,) int
        The rows that the table holds.
    """
    return lambda row: locate(int(row_ids[row]))


def shortened(word: str, length: int = 24) -> str:
    """Return *word* quoted, without control characters and no longer than a message can bear.

    Parameters
    ----------
    word : str
        Something out of a file.
    length : int
        Characters to show.
    """
    return repr(word if len(word) <= length else word[:length] + "...")


def in_one_line(reason: Exception) -> str:
    """Return type and message of an exception, shortened."""
    message = " ".join(str(reason).split())
    return f"{type(reason).__name__}: {message[:120]}" if message else type(reason).__name__


def listed(names: list[str], most: int = 3) -> str:
    """Return the first names of many, for a note, and how many there are besides."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
