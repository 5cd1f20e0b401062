"""Run of a study on Ray: batches of about a second, a bounded number of them at once, rows as they come.

A batch whose worker or node is lost is done again, a condition a batch. A condition that fails three times,
or takes its worker with it, becomes a row that says why.
"""

import atexit
import contextlib
import datetime
import importlib.metadata
import logging
import os
import platform
import secrets
import shutil
import socket
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

import proximity
from proximity.errors import ProximityError, ServiceError
from proximity.lab.sweep.design import Condition, Job
from proximity.lab.sweep.node_files import NodeFiles
from proximity.lab.sweep.row_files import RowFiles, locked, read_rows, row_paths
from proximity.lab.sweep.study_file import Study
from proximity.system import machine
from proximity.system.extras import needed
from proximity.system.table_text import table_text
from proximity.system.whole_file import whole_file

LONGEST_FAILURE = 500  # characters


@dataclass(frozen=True, slots=True)
class Finding:
    """What came of one condition."""

    results: dict[str, Any]  # measures and texts; empty where it failed
    failure: str | None
    seconds: float


def run_batch(
    job: Job, folder: str, out: str, conditions: Sequence[Condition]
) -> tuple[list[Finding], dict[str, str]]:
    """Return what comes of conditions, in their order, and what computed it; see `row_files.MADE_BY`.

    *folder*, *out*: where the study file is, and where its results go.
    """
    return [_find(job, folder, out, condition) for condition in conditions], _made_by()


def _find(job: Job, folder: str, out: str, condition: Condition) -> Finding:
    started = time.perf_counter()
    results, failure = {}, None
    try:
        results = job.run(condition.values, NodeFiles(folder, out, condition.key, condition.digests))
    except Exception as error:  # whatever it is, it belongs in its row: the other conditions go on
        kind = "" if isinstance(error, ProximityError) else f"{type(error).__name__}: "
        failure = f"{kind}{error}"[:LONGEST_FAILURE]
    return Finding(results, failure, time.perf_counter() - started)


@lru_cache(maxsize=1)
def _made_by() -> dict[str, str]:
    import ray

    return {
        **machine.versions(),
        "proximity": proximity.__version__,
        "commit": machine.commit(),
        "ray": importlib.metadata.version("ray"),
        "processor": machine.processor_name(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "node": ray.get_runtime_context().get_node_id()[:12] if ray.is_initialized() else "this process",
    }


@dataclass(frozen=True, slots=True)
class Repetition:
    """One condition, done again."""

    condition: Condition
    results: Mapping[str, Any]
    recorded: Mapping[str, Any] | None  # its row; None where it has none


def repeat(study: Study, out: Path, key: str) -> Repetition:
    """Do the job for one condition, and return what comes of it; nothing is recorded."""
    found = [condition for condition in study.conditions if condition.key.startswith(key.lower())]
    if len(found) != 1:
        reason = "no condition has" if not found else f"{len(found)} conditions have"
        raise ServiceError(
            f"{study.path}: {reason} a key that begins with {key!r}, expected the key of a row"
        )
    (condition,) = found
    files = NodeFiles(study.folder, str(out.absolute()), condition.key, condition.digests)
    return Repetition(condition, study.job.run(condition.values, files), _recorded(out, condition.key))


def _recorded(out: Path, key: str) -> dict[str, Any] | None:
    if not row_paths(out):
        return None
    rows = read_rows(out).rows
    keys = rows["key"].to_pylist()
    row: dict[str, Any] | None = rows.slice(keys.index(key), 1).to_pylist()[0] if key in keys else None
    return row


BATCH_SECONDS = 1.0
BATCHES_A_SECOND = 500
"""That this process sends and collects at most; with more cores than that, batches are longer."""
LARGEST_BATCH = 5000
GROWTH = 8
"""Times as large as the last batch size the next may be: the first conditions say little."""
BATCHES_A_CORE = 2
"""In flight: one that runs and one that waits."""
SHARE_OF_REST = 0.5
"""Of an even share of what is left, that one batch may take: else cores would idle at the end."""
MOST_ATTEMPTS = 3
WEIGHT_OF_LAST = 0.3
"""Of the last batch in the mean duration of a condition."""
WAIT_SECONDS = 0.5
NO_CLUSTER = "no Ray cluster at"
CONNECT_SECONDS = 5.0
OBJECT_STORE_BYTES = 128 << 20
"""Of Ray on this machine: rows are small, and scenes are files."""


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a study is."""

    total: int
    earlier: int  # of them done by earlier runs
    done: int  # of them done by this one
    failed: int
    seconds: float  # since the first batch was sent

    @property
    def rate(self) -> float:
        """Conditions a second, of this run."""
        return self.done / self.seconds if self.seconds else 0.0

    @property
    def seconds_left(self) -> float:
        """Time until the end at that rate, s; inf before anything is done."""
        return (self.total - self.earlier - self.done) / self.rate if self.done else float("inf")


def run_study(
    study: Study,
    out: Path,
    *,
    address: str | None = None,
    cores: int | None = None,
    is_resumed: bool = True,
    with_failed: bool = False,
    watch: Callable[[Progress], None] = lambda _: None,
) -> Progress:
    """Do the job for every condition that has no row yet, and return how it went.

    *address*: of a Ray cluster; without it, and where Ray is not running in this process, this machine is
    used. *is_resumed*: whether rows of earlier runs are kept; else the folder is emptied first. *watch*:
    given the progress now and then, and at the end, also if that is Ctrl-C.
    """
    with locked(out):
        if not is_resumed:
            for name in ("rows", "files"):
                shutil.rmtree(out / name, ignore_errors=True)
        files = RowFiles(out, study.job)
        finished = files.finished(with_failed=not with_failed)
        with whole_file(out / "study.toml") as stream:
            stream.write(Path(study.path).read_bytes())
        earlier = 0

        def keys() -> Iterator[str]:
            nonlocal earlier
            for condition in study.conditions:
                earlier += bytes.fromhex(condition.key) in finished
                yield condition.key

        total = files.write_design(keys(), os.path.abspath(study.path))
        if earlier == total:
            return Progress(total, earlier, 0, 0, 0.0)
        pending = (one for one in study.conditions if bytes.fromhex(one.key) not in finished)
        with _ray(address, cores) as ray:
            return _Run(ray, study, out, files, Progress(total, earlier, 0, 0, 0.0)).finish(pending, watch)


class _Run:
    """The batches of one run: what is in flight, what has to be done again, and how far it is."""

    def __init__(self, ray: Any, study: Study, out: Path, files: RowFiles, progress: Progress) -> None:
        self._ray, self._files, self._progress = ray, files, progress
        self._job_name = study.job.name
        # A lost worker must not have Ray repeat what may have killed it: that is counted here.
        remote = ray.remote(run_batch).options(num_cpus=1, max_retries=0, retry_exceptions=False)
        job, folder = ray.put(study.job), os.fspath(study.folder)
        self._send = lambda conditions: remote.remote(job, folder, os.path.abspath(out), conditions)
        self._flying: dict[Any, list[Condition]] = {}
        self._again: deque[Condition] = deque()
        self._attempts: dict[str, int] = {}  # of those that failed, until they have a row
        self._mean = BATCH_SECONDS  # s a condition
        self._size = 1
        self._sent = 0
        self._started = time.monotonic()

    def finish(self, pending: Iterator[Condition], watch: Callable[[Progress], None]) -> Progress:
        """Send batches until all conditions have a row; those that are in are written whatever happens."""
        try:
            while True:
                limit = BATCHES_A_CORE * max(1, int(self._ray.cluster_resources().get("CPU", 1)))
                while len(self._flying) < limit and (conditions := self._batch(pending, limit)):
                    self._flying[self._send(conditions)] = conditions
                if not self._flying:
                    return self._progress
                for batch in self._landed():
                    self._collect(batch)
                watch(self._progress)
        finally:
            self._files.flush()
            watch(self._progress)

    def _batch(self, pending: Iterator[Condition], limit: int) -> list[Condition]:
        if self._again:
            return [self._again.popleft()]
        left = self._progress.total - self._progress.earlier - self._sent
        share = max(1, int(SHARE_OF_REST * left / limit))
        duration = max(BATCH_SECONDS, limit / BATCHES_A_CORE / BATCHES_A_SECOND)
        wanted = min(int(duration / max(self._mean, 1e-9)), GROWTH * self._size, LARGEST_BATCH)
        conditions = list(islice(pending, max(1, min(wanted, share))))
        self._sent += len(conditions)
        return conditions

    def _landed(self) -> list[Any]:
        ready, rest = self._ray.wait(list(self._flying), num_returns=1, timeout=WAIT_SECONDS)
        if ready and rest:
            more, _ = self._ray.wait(rest, num_returns=len(rest), timeout=0)
            ready += more
        return ready

    def _collect(self, batch: Any) -> None:
        conditions = self._flying.pop(batch)
        try:
            findings, made_by = self._ray.get(batch)
        except self._ray.exceptions.RayError as lost:
            reason = str(lost).strip().partition("\n")[0]
            for condition in conditions:
                # Who of several took the worker along is not known: each is tried on its own.
                self._take(condition, Finding({}, f"its worker was lost: {reason}", 0.0), {})
            return
        for condition, finding in zip(conditions, findings, strict=True):
            self._take(condition, finding, made_by)
        self._size = max(self._size, len(conditions))
        mean = sum(finding.seconds for finding in findings) / len(findings)
        self._mean += WEIGHT_OF_LAST * (mean - self._mean)

    def _take(self, condition: Condition, finding: Finding, made_by: dict[str, str]) -> None:
        attempts = self._attempts.pop(condition.key, 0) + 1
        if finding.failure is not None and attempts < MOST_ATTEMPTS:
            self._attempts[condition.key] = attempts
            self._again.append(condition)
            return
        self._files.add(
            {
                "key": condition.key,
                "job": self._job_name,
                "failure": table_text(finding.failure),
                **condition.values,
                **{f"{name}_sha256": digest for name, digest in condition.digests.items()},
                **{name: table_text(value) for name, value in finding.results.items()},
                "seconds": finding.seconds,
                "attempts": attempts,
                "finished": datetime.datetime.now(datetime.UTC),
                **made_by,
            }
        )
        before = self._progress
        self._progress = Progress(
            before.total,
            before.earlier,
            before.done + 1,
            before.failed + (finding.failure is not None),
            time.monotonic() - self._started,
        )


def _check_reachable(address: str) -> None:
    """Refuse an address where nobody listens: Ray itself would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not (host and port.isdecimal()):
        raise ServiceError(f"{NO_CLUSTER} {address!r}, expected HOST:PORT as ray start --head prints it")
    try:
        socket.create_connection((host, int(port)), CONNECT_SECONDS).close()
    except (OSError, OverflowError) as failed:
        raise ServiceError(f"{NO_CLUSTER} {address} ({failed})") from failed


@cache
def _own_ray_folder() -> str:
    """Folder of the Ray that this process starts; what starts it then listens on loopback, with a token.

    Call it before `ray` is imported, which reads the environment once.
    """
    folder = tempfile.mkdtemp(prefix="proximity-ray-")  # mode 0700; Ray opens its own folder to everybody
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    token = Path(folder, "token")
    token.touch(0o600)
    token.write_text(secrets.token_hex(32))
    for name in ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN"):  # without a mode, Ray asks for a token where it starts
        os.environ.pop(name, None)
    os.environ["RAY_AUTH_TOKEN_PATH"] = str(token)
    os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"  # on Linux, too: only 127.0.0.1 is bound
    return folder


@contextlib.contextmanager
def _ray(address: str | None, cores: int | None) -> Iterator[Any]:
    """Ray, begun where it is not running in this process, and then ended again."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"  # nothing is sent to its makers
    folder = "" if address else _own_ray_folder()
    with needed("a study needs", "study"):
        import ray
    logging.getLogger("ray").setLevel(logging.ERROR)
    if ray.is_initialized():
        yield ray
        return
    started: dict[str, Any] = {"address": address}
    if address:
        _check_reachable(address)
    else:
        started = {"address": "local", "num_cpus": cores, "object_store_memory": OBJECT_STORE_BYTES}
        started |= {"include_dashboard": False, "_temp_dir": os.path.join(folder, "ray")}
    try:
        ray.init(**started, log_to_driver=False, logging_level=logging.ERROR, configure_logging=False)
    except Exception as failed:  # of any kind: Ray starts programs of its own
        where = f"{NO_CLUSTER} {address}" if address else "Ray cannot be started here"
        raise ServiceError(f"{where} ({str(failed).strip().partition(chr(10))[0]})") from failed
    try:
        yield ray
    finally:
        ray.shutdown()
