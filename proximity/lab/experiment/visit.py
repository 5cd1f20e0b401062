"""Visit of a participant, which follows the plan of a session and writes a CSV row after each trial.

A row is on the disk before the next trial begins. The next step depends only on the design, the participant's
slot and the number of rows, so that an interrupted visit continues with its current trial.
"""

import csv
import io
import math
import os
import re
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol, TextIO

from proximity.errors import RecordingError
from proximity.lab.experiment.design import Design
from proximity.lab.experiment.display import Apparatus, Presentation, intervals_of
from proximity.lab.experiment.plan import Step, Text, Trial, plan

try:
    import fcntl
except ImportError:  # not a POSIX system
    fcntl = None  # type: ignore[assignment]

PSEUDONYM = re.compile(r"[a-z]{0,3}[0-9]{1,4}")
SIMULATED = "simulated observer"
"""Apparatus of a simulated participant."""
NUMBERS = {
    "slot": int, "number": int, "run": int, "odd": int, "answer": int, "is_right": int, "level": float,
    "response_s": float, "onset_1_s": float, "onset_2_s": float, "depth_1_m": float, "depth_2_m": float,
    "peak_force_1_N": float, "peak_force_2_N": float, "at_s": float,
}  # fmt: skip
COLUMNS = (
    "participant", "apparatus", "design", "slot", "number", "run", "task", "condition", "stage",
    "level", "odd", "answer", "is_right", "response_s", "stopped", "onset_1_s", "onset_2_s", "depth_1_m",
    "depth_2_m", "peak_force_1_N", "peak_force_2_N", "at_s",
)  # fmt: skip
Row = dict[str, Any]
"""Row of a visit. A number of `NUMBERS` is None if its cell is empty."""


class RefusedError(Exception):
    """Error if the participant does not consent."""


class Respondent(Protocol):
    """Interface of a participant, a person at a terminal or a simulated observer."""

    def consents(self, text: str) -> bool:
        """Show the consent text, and return whether the participant agrees."""

    def read(self, text: Text) -> None:
        """Show a text until it is read."""

    def wait_ready(self, trial: Trial, interval: int) -> None:
        """Wait until the participant is ready for an interval, 0 or 1."""

    def answer(self, trial: Trial, felt: Sequence[Presentation]) -> int:
        """Return the answer to a trial, 1 or 2."""

    def explain(self, why: str) -> None:
        """Show why a trial ended early."""


def run_visit(
    design: Design, folder: Path, pseudonym: str, apparatus: Apparatus, respondent: Respondent
) -> None:
    """Run the remaining steps of a participant's session.

    Its file is created only after the participant has agreed.
    """
    check_pseudonym(pseudonym)
    slot, done = place(design, read_visits(design, folder), pseudonym, apparatus.name, folder)
    path, started = folder / f"{pseudonym}.csv", time.monotonic()
    if not path.is_file() and not respondent.consents(design.consent):
        raise RefusedError
    known = {"participant": pseudonym, "apparatus": apparatus.name, "slot": slot}
    with _opened(path) as stream:
        for step in remaining(plan(design, slot), done):
            if isinstance(step, Text):
                respondent.read(step)
            else:
                row = _run_trial(design, step, apparatus, respondent)
                at_s = time.monotonic() - started
                _append(stream, row | known | {"design": design.digest, "at_s": at_s})


def place(
    design: Design, rows: Sequence[Row], pseudonym: str, apparatus: str, folder: Path
) -> tuple[int, int]:
    """Return the slot of a participant and the number of finished trials.

    A new participant has the first free slot.
    """
    if any((row["apparatus"] == SIMULATED) != (apparatus == SIMULATED) for row in rows):
        there, new = ("people", "simulated observers")[:: 1 if apparatus == SIMULATED else -1]
        raise RecordingError(f"{folder}: has data of {there}, expected another folder for {new}")
    slots = {row["participant"]: row["slot"] for row in rows}
    free = sorted(set(range(design.participants)) - set(slots.values()))
    if pseudonym not in slots and not free:
        raise RecordingError(
            f"{folder}: all {design.participants} places of the design are taken, expected one of: "
            f"{', '.join(slots)}"
        )
    slot = slots.get(pseudonym)
    return free[0] if slot is None else slot, sum(row["participant"] == pseudonym for row in rows)


def remaining(steps: Sequence[Step], done: int) -> Sequence[Step]:
    """Return the steps after *done* trials. Texts directly before the next trial are shown again."""
    numbers = [i for i, step in enumerate(steps) if isinstance(step, Trial)]
    if done >= len(numbers):
        return ()
    return steps[numbers[done - 1] + 1 if done else 0 :]


def read_visits(design: Design, folder: Path) -> list[Row]:
    """Read the rows of all visits in a folder."""
    return [row for path in sorted(folder.glob("*.csv")) for row in read_visit(design, path)]


def read_visit(design: Design, path: Path) -> list[Row]:
    """Read the rows of a visit, except for a last line that a crash left unfinished."""
    lines = _whole(path).decode().splitlines()
    if lines and lines[0] != ",".join(COLUMNS):
        raise RecordingError(f"{path}: its first line is not that of a visit, expected {','.join(COLUMNS)}")
    rows: list[Row] = []
    for number, cells in enumerate(csv.DictReader(lines), start=2):
        try:
            row = cells | {key: read(cells[key]) if cells[key] else None for key, read in NUMBERS.items()}
        except (ValueError, TypeError) as unfit:
            raise RecordingError(f"{path}:{number}: {unfit}, expected a row of a visit") from unfit
        if row["design"] != design.digest:
            raise RecordingError(
                f"{path}:{number}: belongs to another design, expected the one it began with"
            )
        if row["number"] != len(rows):
            raise RecordingError(f"{path}:{number}: trial {len(rows)} is missing, expected all rows in order")
        rows.append(row)
    return rows


def check_pseudonym(pseudonym: str) -> None:
    """Raise an error for a text that may be a name and not a pseudonym."""
    if not PSEUDONYM.fullmatch(pseudonym):
        raise RecordingError(
            f"participant is {pseudonym!r}, expected a pseudonym such as p07: up to three small letters and "
            "up to four digits, no name"
        )


def _run_trial(design: Design, trial: Trial, apparatus: Apparatus, respondent: Respondent) -> Row:
    """Display the intervals of a trial, read its answer, and return its row."""
    felt: list[Presentation] = []
    for index, interval in enumerate(intervals_of(trial)):
        respondent.wait_ready(trial, index)
        felt.append(apparatus.present(interval, design.limits.force, design.limits.seconds))
        if felt[-1].stopped:
            respondent.explain(felt[-1].stopped)
            return row_of(trial, felt, None, math.nan)
    asked = time.monotonic()
    answer = respondent.answer(trial, felt)
    return row_of(trial, felt, answer, time.monotonic() - asked)


def row_of(trial: Trial, felt: Sequence[Presentation], answer: int | None, response_s: float) -> Row:
    """Return the row of a trial. The answer is right if it names the odd interval."""
    row: Row = {name: getattr(trial, name) for name in ("number", "run", "level")}
    row |= {"task": trial.task.name, "condition": trial.condition.name, "stage": str(trial.stage)}
    row |= {"answer": answer, "odd": trial.odd or None, "response_s": response_s}
    row["is_right"] = int(answer == trial.odd) if trial.odd and answer is not None else None
    row["stopped"] = felt[-1].stopped if felt else ""
    for number, one in enumerate(felt, start=1):
        row |= {f"onset_{number}_s": one.onset, f"depth_{number}_m": one.depth}
        row[f"peak_force_{number}_N"] = one.peak
    return row


@contextmanager
def _opened(path: Path) -> Iterator[TextIO]:
    """Open the file of a visit for appending, locked for this program.

    An unfinished last line is removed first.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8", newline="") as stream:
            if fcntl is not None:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.truncate(path, len(_whole(path)))
            if path.stat().st_size == 0:
                _write(stream, COLUMNS)
            yield stream
    except BlockingIOError as taken:
        raise RecordingError(f"{path}: another program runs this participant") from taken
    except OSError as failed:
        raise RecordingError(f"{path}: cannot be written ({failed.strerror})") from failed


def _append(stream: TextIO, row: Row) -> None:
    _write(stream, [_cell(row.get(name)) for name in COLUMNS])


def _write(stream: TextIO, cells: Sequence[str]) -> None:
    """Write a line, which is on the disk when the function returns."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(cells)
    stream.write(line.getvalue())
    stream.flush()
    os.fsync(stream.fileno())


def _cell(value: Any) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _whole(path: Path) -> bytes:
    """Return the finished lines of a file."""
    try:
        content = path.read_bytes()
    except OSError as failed:
        raise RecordingError(f"{path}: cannot be read ({failed.strerror})") from failed
    return content[: content.rfind(b"\n") + 1]
