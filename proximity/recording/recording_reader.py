"""Read recordings from text with one sample of one finger per line, in columns named by the first line.

Numbers are converted a column at a time. The line of an invalid number is searched only if this fails.
"""

import csv
import io
import os
from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np

from proximity.errors import RecordingError
from proximity.recording.recording import FINGERS, NANOSECONDS, Recording
from proximity.system.regular_file import open_regular

EXPECTED = "time_s, hand, finger, x_m, y_m, z_m"
NANOSECONDS_IN = {"time_s": NANOSECONDS, "time_ms": 1_000_000, "time_us": 1_000, "time_ns": 1}
METRES_IN = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
OF_A_LOG = "`proximity view LOG PARTS` plays it back, `proximity export LOG` makes a table of it"
SEPARATORS = ",;\t"
COMMA_SEPARATORS = ";\t"  # with these separators 0,5 is a number
MIN_FINGERS = 3
"""Minimum number of coinciding fingers that mark a lost hand. Two fingers may be a pinch."""
MAX_HAND_COUNT = 32  # a sensor renumbers a hand after losing it; more are not hands
MAX_HAND = 2**31 - 1
MAX_POSITION = 1e6  # m; beyond the range of any sensor
MAX_TIME_NS = 2.0**62
LINE_ENDS = "\n\r"
MAYBE_CUT = "the last line has no line end: the file may be cut off"
LINES_PER_CHUNK = 4096  # number of lines that are converted together


def read_recording(path: str | os.PathLike[str]) -> Recording:
    """Read a recording from a text file.

    The first line names the columns, in any order: ``time_s`` (or ms, us, ns), ``hand`` (0, 1, ...),
    ``finger`` (0 the thumb to 4 the little finger) and ``x_m``, ``y_m``, ``z_m`` (or mm, cm); others are
    ignored. Fields are separated by commas, semicolons or tabs; with the latter two a decimal comma is read
    too. Blank lines and lines that begin with ``#`` are skipped. Times must not decrease. A finger is missing
    at a time without a line for it, or if its position is nan. A last line without a line end may be
    truncated, even in the middle of a number; a note says so. Its sample is used, since many editors omit the
    final line end.
    """
    name = os.fspath(path)
    text = _read_text(name)
    table = _Table(text, name)
    times_ns = table.times()
    hands = table.whole("hand", MAX_HAND, "a whole number from 0")
    fingers = table.whole("finger", len(FINGERS) - 1, "0 (thumb) to 4 (little finger)")
    points = table.points()

    # one row for each instant, one column for each finger
    frame = np.concatenate(([0], np.cumsum(np.diff(times_ns) > 0)))
    labels, column = np.unique(hands * len(FINGERS) + fingers, return_inverse=True)
    hand_count = len(np.unique(labels // len(FINGERS)))
    if hand_count > MAX_HAND_COUNT:
        raise RecordingError(f"{name}: there are {hand_count} hands, expected at most {MAX_HAND_COUNT}")
    table.refuse_repeats(frame * len(labels) + column, hands, fingers)
    positions = np.full((int(frame[-1]) + 1, len(labels), 3), np.nan)
    positions[frame, column] = points
    missing = int(np.isnan(points).any(axis=1).sum())
    lost = _drop_lost_hands(positions, labels // len(FINGERS))
    if missing + lost == len(points):
        raise RecordingError(f"{name}: all positions are nan, expected a number in at least one line")
    notes = [f"{missing} of {len(points)} positions are nan: the finger is missing there"] if missing else []
    if lost:
        notes.append(
            f"{lost} of {len(points)} positions are of a hand with all fingers at one place: it is lost there"
        )
    if table.ignored:
        notes.append(f"ignored columns: {', '.join(table.ignored)}")
    if text[-1] not in LINE_ENDS:
        notes.append(MAYBE_CUT)
    return Recording(
        times_ns[np.concatenate(([True], np.diff(times_ns) > 0))],
        positions,
        tuple(divmod(label, len(FINGERS)) for label in labels.tolist()),
        name,
        tuple(notes),
    )


def _drop_lost_hands(positions: np.ndarray, hands: np.ndarray) -> int:
    """Set hands whose fingers all have one position to nan. Return the number of positions set.

    Sensors report a lost hand like that.
    """
    count = 0
    for hand in np.unique(hands):
        fingers = np.flatnonzero(hands == hand)
        together = positions[:, fingers]
        is_lost = (together == together[:, :1]).all(axis=(1, 2)) & (len(fingers) >= MIN_FINGERS)
        positions[np.ix_(is_lost, fingers)] = np.nan
        count += int(is_lost.sum()) * len(fingers)
    return count


def _read_text(name: str) -> str:
    try:
        with open_regular(name) as file:
            return file.read().decode("utf-8-sig")
    except UnicodeDecodeError as unfit:
        if name.endswith(".frames"):
            raise RecordingError(f"{name}: a log of frames, not of a hand: {OF_A_LOG}") from unfit
        raise RecordingError(f"{name}: not a text file in UTF-8, expected columns {EXPECTED}") from unfit
    except OSError as failure:
        raise RecordingError(f"{name}: cannot be read ({failure.strerror or failure})") from failure


def _without_comments(text: str) -> Iterator[str]:
    """Yield the lines of a text with comments replaced by blank lines.

    Otherwise a quote in a comment would begin a quoted field.
    """
    for line in io.StringIO(text, newline=""):
        yield "\n" if line.lstrip().startswith("#") else line


class _Table:
    """The columns that were read, as numbers, and the line number of each row."""

    def __init__(self, text: str, name: str) -> None:
        self.name = name
        heading = next((line for line in _without_comments(text) if line.strip()), "")
        self.separator = max(SEPARATORS, key=heading.count)
        reader = csv.reader(
            _without_comments(text), delimiter=self.separator, strict=True, skipinitialspace=True
        )
        self.header: list[str] = []
        lines: list[np.ndarray] = [np.empty(0, dtype=np.int64)]
        numbers: list[np.ndarray] = [np.empty((6, 0))]
        for rows, row_lines in self._chunks(reader):
            if not self.header and rows:
                self.header = [field.strip().lower() for field in rows.pop(0)]
                self._choose_columns(row_lines.pop(0))
            if rows:
                numbers.append(self._numbers(rows, row_lines))
                lines.append(np.array(row_lines))
        if not self.header:
            raise RecordingError(f"{name}: the file is empty, expected columns {EXPECTED}")
        self.lines = np.concatenate(lines).tolist()
        if not self.lines:
            raise RecordingError(f"{name}: no line after the names of the columns")
        self.columns = dict(zip(self.titles, np.concatenate(numbers, axis=1), strict=True))

    def _chunks(self, reader: Any) -> Iterator[tuple[list[list[str]], list[int]]]:
        """Yield lists of rows and their line numbers, without blank lines.

        The lists are short to limit the work of the garbage collector.
        """
        while True:
            before = reader.line_num
            try:
                rows = list(islice(reader, LINES_PER_CHUNK))
            except csv.Error as unfit:
                raise self.error(reader.line_num, f"{unfit}, expected columns {EXPECTED}") from unfit
            if not rows:
                return
            if reader.line_num - before != len(rows):
                raise self.error(before + 1, "a field in quotes below goes over several lines")
            lines = [
                (row, line)
                for line, row in enumerate(rows, start=before + 1)
                if row and (len(row) > 1 or row[0].strip())
            ]
            yield [row for row, _ in lines], [line for _, line in lines]

    def _choose_columns(self, line: int) -> None:
        """Find the columns to read and their units."""
        header = self.header
        self.time = next((title for title in NANOSECONDS_IN if title in header), "time_s")
        self.unit = next((unit for unit in METRES_IN if f"x_{unit}" in header), "m")
        self.axes = [f"{axis}_{self.unit}" for axis in "xyz"]
        self.titles = [self.time, "hand", "finger", *self.axes]
        missing = [title for title in self.titles if title not in header]
        if missing and {"session", "sequence"} <= set(header):
            raise self.error(line, f"a table of frames, not of a hand: {OF_A_LOG}")
        if missing:
            raise self.error(
                line,
                f"no column is named {', '.join(missing)}: there are {_shown(', '.join(header))}, "
                f"expected {EXPECTED}",
            )
        twice = [title for title in self.titles if header.count(title) > 1]
        if twice:
            raise self.error(line, f"two columns are named {twice[0]}")
        self.column_ids = [header.index(title) for title in self.titles]
        self.ignored = [title for title in header if title and title not in self.titles]

    def _numbers(self, rows: list[list[str]], lines: list[int]) -> np.ndarray:
        """Return the columns to read as numbers, (6, rows)."""
        for row, line in zip(rows, lines, strict=True):
            if len(row) != len(self.header):
                raise self.error(line, f"{_counted(len(row), 'field')}, expected {len(self.header)}")
        columns = list(zip(*rows, strict=True))
        return np.array(
            [
                self._column(title, columns[index], lines)
                for title, index in zip(self.titles, self.column_ids, strict=True)
            ]
        )

    def _column(self, title: str, fields: tuple[str, ...], lines: list[int]) -> list[float]:
        if self.separator in COMMA_SEPARATORS:
            fields = tuple(field.replace(",", ".") for field in fields)
        try:
            if "_" not in "".join(fields):  # Python would read 1_000
                return list(map(float, fields))
        except ValueError:
            pass
        row = next(row for row, field in enumerate(fields) if not _is_number(field))
        raise self.error(lines[row], f"{title} is {_shown(fields[row])}, expected a number")

    def times(self) -> np.ndarray:
        """Return the instants in whole nanoseconds."""
        values = self.columns[self.time]
        with np.errstate(over="ignore"):
            exact_ns = values * NANOSECONDS_IN[self.time]
        self._check(self.time, values, np.abs(exact_ns) <= MAX_TIME_NS, "a time within 146 years")
        times_ns = np.rint(exact_ns).astype(np.int64)
        backwards = np.flatnonzero(np.diff(times_ns) < 0)
        if backwards.size:
            row = int(backwards[0]) + 1
            raise self.error(
                self.lines[row],
                f"{self.time} is {values[row]:.9g} after {values[row - 1]:.9g} on line "
                f"{self.lines[row - 1]}, expected times that never run backwards",
            )
        return times_ns

    def whole(self, title: str, largest: int, expected: str) -> np.ndarray:
        """Return a column whose values must be whole numbers from 0 to *largest*."""
        values = self.columns[title]
        fits = (values >= 0.0) & (values <= largest) & (values == np.rint(values))
        self._check(title, values, fits, expected)
        return values.astype(np.int64)

    def points(self) -> np.ndarray:
        """Return positions in metres, (rows, 3)."""
        points = np.empty((len(self.lines), 3))
        for axis, title in enumerate(self.axes):
            values = self.columns[title]
            points[:, axis] = values * METRES_IN[self.unit]
            fits = ~(np.abs(points[:, axis]) > MAX_POSITION)
            self._check(title, values, fits, f"a position within {MAX_POSITION:g} m")
        points[np.isnan(points).any(axis=1)] = np.nan
        return points

    def refuse_repeats(self, keys: np.ndarray, hands: np.ndarray, fingers: np.ndarray) -> None:
        """Raise an error if two rows have the same key, which combines instant and finger."""
        order = np.argsort(keys, kind="stable")
        again = np.flatnonzero(np.diff(keys[order]) == 0)
        if again.size:
            # the repeat that is first in the file
            index = again[np.argmin(order[again + 1])]
            earlier, later = int(order[index]), int(order[index + 1])
            raise self.error(
                self.lines[later],
                f"finger {fingers[later]} of hand {hands[later]} has a position at this time already, "
                f"on line {self.lines[earlier]}",
            )

    def _check(self, title: str, values: np.ndarray, fits: np.ndarray, expected: str) -> None:
        if not fits.all():
            row = int(np.argmin(fits))
            raise self.error(self.lines[row], f"{title} is {values[row]:.9g}, expected {expected}")

    def error(self, line: int, message: str) -> RecordingError:
        """Return an error about a line of the file. Its message names the line."""
        return RecordingError(f"{self.name}, line {line}: {message}")


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return "_" not in field


def _counted(count: int, what: str) -> str:
    return f"1 {what}" if count == 1 else f"{count} {what}s"


def _shown(text: str) -> str:
    """Return *text* quoted and shortened, with escapes for unprintable characters, for a message."""
    return repr(text if len(text) <= 40 else text[:37] + "...")
