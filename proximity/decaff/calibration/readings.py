"""Readings of a calibration, which are stored in a file after each one and checked for agreement.

The file is next to the calibration that is computed from the readings. The readings alone determine the next
task, so that an interrupted calibration continues at the same task.
"""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from proximity.decaff.calibration.tasks import Bench, Task
from proximity.errors import DecaffError
from proximity.system.regular_file import open_regular
from proximity.system.whole_file import whole_file

FORMAT, FILE_VERSION = "proximity glove readings", 1
MAX_FILE = 50_000_000  # bytes; those of a calibration have some 2 million
MAX_TRIES = 4  # as a multiple of a task's repeats, after which its readings count as inconsistent


@dataclass(frozen=True, slots=True)
class Asked:
    """The next measurement."""

    task: Task
    number: int  # number of present readings
    agreeing: int  # readings of this task that agree
    is_again: bool  # repeated because readings of this task disagree

    @property
    def bend(self) -> float | None:
        """Bend of the finger for this measurement, or None without a finger in the glove."""
        return self.task.bends[self.agreeing % len(self.task.bends)]


class Readings:
    """Readings of one glove with the same instruments, in order of time."""

    def __init__(self, path: str | os.PathLike[str], source: str) -> None:
        self.path, self.source = Path(path), source
        self.began = datetime.now(UTC)
        self.all: list[dict[str, Any]] = []
        if self.path.exists():
            self._read()

    def add(self, task: Task, values: dict[str, Any]) -> None:
        """Add a reading, and write the file."""
        self.all.append({"task": task.key, "made": datetime.now(UTC).isoformat(), **values})
        self.write()

    def write(self, results: dict[str, Any] | None = None) -> None:
        """Write the file atomically."""
        document = {
            "format": FORMAT, "version": FILE_VERSION, "source": self.source, "began": self.began.isoformat(),
            "results": results or {}, "readings": self.all,
        }  # fmt: skip
        with whole_file(self.path) as stream:
            stream.write(json.dumps(document, ensure_ascii=False, allow_nan=False).encode())

    def of(self, task: Task) -> list[dict[str, Any]]:
        """Return all readings of a task."""
        return [reading for reading in self.all if reading["task"] == task.key]

    def agreeing(self, task: Task, bench: Bench) -> list[dict[str, Any]]:
        """Return the largest set of readings of a task that agree within its tolerance."""
        readings = self.of(task)
        rows = _largest_cluster([reading[task.judged] for reading in readings], task.tolerance(bench))
        return [readings[row] for row in rows]

    def next(self, tasks: Sequence[Task], bench: Bench) -> Asked | None:
        """Return the next measurement, or None if all are done.

        Poses are measured in rounds, as a finger closes from the flat hand to the fist. Other tasks are
        completed one after the other.
        """
        counts = {task.key: len(self.agreeing(task, bench)) for task in tasks}
        left = [task for task in tasks if counts[task.key] < task.repeats]
        for task in left:
            if len(self.of(task)) >= MAX_TRIES * task.repeats:
                raise DecaffError(
                    f"{task.key}: of {len(self.of(task))} readings no {task.repeats} agree: {task.advice}; "
                    f"then measure it again with --again {task.key.split()[0]!r}"
                )
        if not left:
            return None
        poses = [task for task in left if task.key.startswith("pose")]
        task = min(poses, key=lambda task: counts[task.key]) if poses else left[0]
        is_again = len(self.of(task)) > counts[task.key] and self.all[-1]["task"] == task.key
        return Asked(task, len(self.all), counts[task.key], is_again)

    def drop(self, start: str) -> int:
        """Remove the readings of tasks whose keys begin with *start*, and return how many were removed."""
        kept = [reading for reading in self.all if not reading["task"].startswith(start)]
        dropped = len(self.all) - len(kept)
        self.all = kept
        if dropped:
            self.write()
        return dropped

    def drop_newest(self) -> bool:
        """Remove the newest reading, and return whether there was one."""
        had = bool(self.all)
        if had:
            self.all.pop()
            self.write()
        return had

    def _read(self) -> None:
        try:
            with open_regular(self.path) as stream:
                document = json.loads(stream.read(MAX_FILE).decode())
            if document["format"] != FORMAT or document["version"] != FILE_VERSION:
                raise ValueError("another format or version")
            source, began = document["source"], datetime.fromisoformat(document["began"])
            self.all = [dict(reading) for reading in document["readings"]]
        except (OSError, ValueError, KeyError, TypeError) as unfit:
            raise DecaffError(
                f"{self.path}: readings cannot be used ({unfit}): remove the file, or name another "
                "calibration"
            ) from unfit
        if source != self.source:
            raise DecaffError(
                f"{self.path}: has readings of {source}, not of {self.source}: name another calibration, or "
                "remove the file"
            )
        self.began = began


def _largest_cluster(values: Sequence[float], tolerance: float) -> list[int]:
    """Return the rows of the largest set of values within *tolerance* of each other.

    Of several sets of that size, it is the one with the newest value.
    """
    order = np.argsort(values, kind="stable")
    ordered = np.asarray(values, np.float64)[order]
    best: list[int] = []
    for i in range(len(ordered)):
        rows = sorted(order[i : np.searchsorted(ordered, ordered[i] + tolerance, side="right")].tolist())
        if (len(rows), rows[-1:]) > (len(best), best[-1:]):
            best = rows
    return best
