"""Rows of a study as Parquet files, and the newest rows as one CSV file.

    DIR/rows/20260131T120000-1a2b-00000.parquet   rows of one run, a file every few seconds
    DIR/rows.csv                                  the newest row of each condition

A file is visible only when it is complete. After a killed run, only its unwritten rows are computed again.
"""

import contextlib
import datetime
import secrets
import time
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from proximity.errors import ServiceError
from proximity.lab.study.study_file import Condition
from proximity.system.extras import needed
from proximity.system.whole_file import whole_file

try:
    import fcntl
except ImportError:  # not a POSIX system: two concurrent runs of one study are not detected
    fcntl = None  # type: ignore[assignment]

FLUSH_SECONDS = 2.0


class RowFiles:
    """Folder of a study's results, open for one run."""

    def __init__(self, folder: Path) -> None:
        self._arrow, self._parquet = _load_pyarrow()
        started = datetime.datetime.now(datetime.UTC).strftime("%Y%m%dT%H%M%S")
        self._folder, self._run = folder / "rows", f"{started}-{secrets.token_hex(2)}"
        self._rows: list[dict[str, Any]] = []
        self._count = 0
        self._due = time.monotonic() + FLUSH_SECONDS

    def add(self, row: dict[str, Any]) -> None:
        """Append a row, and write all waiting rows if they are due."""
        self._rows.append(row)
        if time.monotonic() >= self._due:
            self.flush()

    def flush(self) -> None:
        """Write all waiting rows as one file."""
        if self._rows:
            self._folder.mkdir(exist_ok=True)
            names = list(dict.fromkeys(name for row in self._rows for name in row))
            columns = {name: [row.get(name) for row in self._rows] for name in names}
            with whole_file(self._folder / f"{self._run}-{self._count:05d}.parquet") as stream:
                self._parquet.write_table(self._arrow.table(columns), stream, compression="zstd")
            self._count += 1
            self._rows = []
        self._due = time.monotonic() + FLUSH_SECONDS


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a folder against a second run while the block runs."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / ".lock").open("ab")
    except OSError as failed:
        raise ServiceError(f"{folder}: cannot be written ({failed.strerror})") from failed
    with lock:
        if fcntl is not None:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as held:
                raise ServiceError(f"{folder}: another study is running in it") from held
        yield


def row_paths(folder: Path) -> list[Path]:
    """Return the paths of all files of rows, oldest first."""
    return sorted(folder.glob("rows/*.parquet"))


def read_rows(folder: Path, conditions: Sequence[Condition]) -> list[dict[str, Any]]:
    """Return the newest row of each condition that has one, in the order of the conditions."""
    arrow, parquet = _load_pyarrow()
    newest: dict[str, dict[str, Any]] = {}
    for path in row_paths(folder):
        try:
            rows = parquet.read_table(path).to_pylist()
        except (arrow.ArrowException, OSError) as damaged:
            raise ServiceError(f"{path}: cannot be read ({damaged})") from damaged
        newest |= {row["key"]: row for row in rows}
    return [newest[one.key] for one in conditions if one.key in newest]


def write_csv(folder: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows as ``rows.csv``."""
    arrow = _load_pyarrow()[0]
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = arrow.table({name: [row.get(name) for row in rows] for name in names})
    with whole_file(folder / "rows.csv") as stream:
        import_module("pyarrow.csv").write_csv(table, stream)


def _load_pyarrow() -> tuple[Any, Any]:
    with needed("a study needs", "study"):
        return import_module("pyarrow"), import_module("pyarrow.parquet")
