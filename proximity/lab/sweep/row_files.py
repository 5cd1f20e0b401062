"""Rows of a study as partitioned Parquet: a row a condition, with all that made it.

    DIR/rows/run=20260131T120000-1a2b/00000.parquet   rows of one run, a file every few seconds
    DIR/design.parquet                                keys of all conditions, of the newest run
    DIR/study.toml                                    the file that was run
    DIR/files/KEY.npz                                 what a job wrote for a condition

A file of rows appears when it is whole. What a killed run had not written is done again, and nothing twice.
"""

import contextlib
import datetime
import secrets
import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from proximity.errors import ServiceError
from proximity.lab.sweep.design import Job, Kind
from proximity.system.extras import needed
from proximity.system.whole_file import whole_file

try:
    import fcntl
except ImportError:  # not a POSIX system: nobody notices two runs of one study there
    fcntl = None  # type: ignore[assignment]

FLUSH_SECONDS, FLUSH_ROWS = 2.0, 20_000
KEYS_AT_ONCE = 100_000
SOURCE = b"study"
"""Key under which the file of keys has the path of the study."""
MADE_BY = (
    "proximity", "commit", "kernels", "python", "numpy", "ray", "processor", "system", "node",
)  # fmt: skip
"""Columns that say what computed a row."""


class RowFiles:
    """The folder of a study's results, open for one run."""

    def __init__(self, folder: Path, job: Job) -> None:
        self._arrow, self._parquet = _load_pyarrow()
        self._folder, self._job = folder, job
        self._schema = _schema(self._arrow, job)
        started = datetime.datetime.now(datetime.UTC).strftime("%Y%m%dT%H%M%S")
        self._run = folder / "rows" / f"run={started}-{secrets.token_hex(2)}"
        self._rows: list[dict[str, Any]] = []
        self._count = 0
        self._due = time.monotonic() + FLUSH_SECONDS

    def finished(self, *, with_failed: bool = True) -> set[bytes]:
        """Return the keys of conditions that have a row, of earlier runs too."""
        keys: set[bytes] = set()
        for path in row_paths(self._folder):
            rows = self._parquet.read_table(path, columns=["key", "job", "failure"], partitioning=None)
            if rows.num_rows and (other := rows["job"][0].as_py()) != self._job.name:
                raise ServiceError(
                    f"{self._folder}: holds results of the job {other}, expected another folder for "
                    f"{self._job.name}: say --out"
                )
            for key, failure in zip(rows["key"].to_pylist(), rows["failure"].to_pylist(), strict=True):
                (keys.add if with_failed or failure is None else keys.discard)(bytes.fromhex(key))
        return keys

    def add(self, row: dict[str, Any]) -> None:
        """Take a row, and write those that wait if it is time."""
        self._rows.append(row)
        if len(self._rows) >= FLUSH_ROWS or time.monotonic() >= self._due:
            self.flush()

    def flush(self) -> None:
        """Write all rows that wait, as one file."""
        if self._rows:
            self._run.mkdir(parents=True, exist_ok=True)
            table = self._arrow.Table.from_pylist(self._rows, schema=self._schema)
            with whole_file(self._run / f"{self._count:05d}.parquet") as stream:
                self._parquet.write_table(table, stream, compression="zstd")
            self._count += 1
            self._rows = []
        self._due = time.monotonic() + FLUSH_SECONDS

    def write_design(self, keys: Iterator[str], source: str) -> int:
        """Write the keys of all conditions of the study; return how many there are."""
        schema = self._arrow.schema([("key", self._arrow.string())], metadata={SOURCE: source})
        total = 0
        with (
            whole_file(self._folder / "design.parquet") as stream,
            self._parquet.ParquetWriter(stream, schema) as writer,
        ):
            some: list[str] = []
            for key in keys:
                some.append(key)
                if len(some) >= KEYS_AT_ONCE:
                    writer.write_table(self._arrow.table({"key": some}, schema=schema))
                    total, some = total + len(some), []
            writer.write_table(self._arrow.table({"key": some}, schema=schema))
        return total + len(some)


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep a second run out of a folder while the block runs."""
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
    """Return all files of rows, oldest first."""
    return sorted(folder.glob("rows/run=*/*.parquet"))


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """What a folder of results holds."""

    rows: Any  # pyarrow table, a row a condition
    total: int  # rows when the study is complete
    source: str  # path of the study file


def read_rows(folder: Path) -> Recorded:
    """Return the rows of a study.

    A condition that was done again has its newest row; one that the study no longer has is left out.
    """
    arrow, parquet = _load_pyarrow()
    paths = row_paths(folder)
    if not paths or not (folder / "design.parquet").exists():
        raise ServiceError(f"{folder}: holds no results of a study, expected the folder of proximity study")
    try:
        rows = arrow.concat_tables(
            [parquet.read_table(path, partitioning=None) for path in paths], promote_options="permissive"
        )
        design = parquet.read_table(folder / "design.parquet")
    except (arrow.ArrowException, OSError) as damaged:
        raise ServiceError(f"{folder}: a file of results cannot be read ({damaged})") from damaged
    newest = {key: number for number, key in enumerate(rows["key"].to_pylist())}
    wanted = design["key"].to_pylist()
    chosen = arrow.array([newest[key] for key in wanted if key in newest], arrow.int64())
    found = rows.take(chosen)
    return Recorded(found, len(wanted), design.schema.metadata[SOURCE].decode())


def _load_pyarrow() -> tuple[Any, Any]:
    with needed("a study needs", "study"):
        return import_module("pyarrow"), import_module("pyarrow.parquet")


def _schema(arrow: Any, job: Job) -> Any:
    types = {
        Kind.NUMBER: arrow.float64(),
        Kind.WHOLE: arrow.int64(),
        Kind.WORD: arrow.string(),
        Kind.FILE: arrow.string(),
        Kind.POINT: arrow.list_(arrow.float64()),
    }
    files = [name for name, factor in job.factors.items() if factor.kind == Kind.FILE]
    return arrow.schema(
        [
            ("key", arrow.string()),
            ("job", arrow.string()),
            ("failure", arrow.string()),
            *((name, types[factor.kind]) for name, factor in job.factors.items()),
            *((f"{name}_sha256", arrow.string()) for name in files),
            *((name, arrow.float64()) for name in job.measures),
            *((name, arrow.string()) for name in job.texts),
            ("seconds", arrow.float64()),
            ("attempts", arrow.int64()),
            ("finished", arrow.timestamp("ms", tz="UTC")),
            *((name, arrow.string()) for name in MADE_BY),
        ]
    )
