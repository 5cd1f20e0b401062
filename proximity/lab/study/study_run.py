"""Run of a study on Ray, with a task per condition and a limited number of tasks in parallel.

Rows are written as tasks finish. A condition that fails, or whose worker crashes, becomes a row with the
reason, and the next run tries it again.
"""

import atexit
import contextlib
import datetime
import logging
import os
import secrets
import shutil
import socket
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import proximity
from proximity.errors import ProximityError, ServiceError
from proximity.lab.study.row_files import RowFiles, locked, read_rows, write_csv
from proximity.lab.study.study_file import Condition, Job, Study
from proximity.system import machine
from proximity.system.extras import needed
from proximity.system.table_text import table_text

MAX_FAILURE = 500  # characters
TASKS_A_CORE = 8
"""Number of tasks in flight per core, which is large as short jobs would otherwise wait for the next one."""
RETRIES = 2
"""Number of retries of a task whose worker or node was lost."""
WAIT_SECONDS = 0.5
NO_CLUSTER = "no Ray cluster at"
CONNECT_SECONDS = 5.0
OBJECT_STORE_BYTES = 128 << 20
"""Memory of Ray on this machine. Little is needed, as rows are small and scenes are files."""


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a study."""

    total: int
    earlier: int  # of them done by earlier runs
    done: int  # of them done by this one
    failed: int
    seconds: float  # since the first task was sent

    @property
    def rate(self) -> float:
        """Number of conditions per second in this run."""
        return self.done / self.seconds if self.seconds else 0.0

    @property
    def seconds_left(self) -> float:
        """Time until the end at the present rate, s, or inf before the first condition is done."""
        return (self.total - self.earlier - self.done) / self.rate if self.done else float("inf")


def run_condition(job: Job, values: Mapping[str, Any]) -> dict[str, Any]:
    """Run a job, and return the cells of the condition's row after its factors.

    They are the measures, failure, duration and versions.
    """
    started = time.perf_counter()
    results: dict[str, Any] = {"failure": None}
    try:
        results |= {name: table_text(value) for name, value in job(**values).items()}
    except Exception as error:  # of any kind, so that the other conditions continue
        kind = "" if isinstance(error, ProximityError) else f"{type(error).__name__}: "
        results["failure"] = table_text(f"{kind}{error}"[:MAX_FAILURE])
    results["seconds"] = time.perf_counter() - started
    made_by = {"proximity": proximity.__version__, "commit": machine.commit(), **machine.versions()}
    return results | made_by | {"processor": machine.processor_name()}


def run_study(
    study: Study,
    out: Path,
    *,
    address: str | None = None,
    cores: int | None = None,
    watch: Callable[[Progress], None] = lambda _: None,
) -> Progress:
    """Run the job for every condition without a row or with a failed one. Return the final progress.

    *address*: of a Ray cluster. Without it, a Ray that already runs in this process is used, or else this
    machine. *watch*: function that is called with the progress regularly and at the end, also after Ctrl-C.
    """
    with locked(out):
        kept = {row["key"] for row in read_rows(out, study.conditions) if row["failure"] is None}
        pending = [one for one in study.conditions if one.key not in kept]
        progress = Progress(len(study.conditions), len(kept), 0, 0, 0.0)
        if pending:
            with _ray(address, cores) as ray:
                progress = _run(ray, study, RowFiles(out), pending, progress, watch)
        write_csv(out, read_rows(out, study.conditions))
    return progress


def _run(
    ray: Any,
    study: Study,
    files: RowFiles,
    pending: list[Condition],
    progress: Progress,
    watch: Callable[[Progress], None],
) -> Progress:
    """Run all conditions, and write finished rows however the run ends."""
    task = ray.remote(run_condition).options(num_cpus=1, max_retries=RETRIES, retry_exceptions=False)
    limit = TASKS_A_CORE * max(1, int(ray.cluster_resources().get("CPU", 1)))
    waiting, flying = iter(pending), dict[Any, Condition]()
    started = time.monotonic()
    try:
        while True:
            while len(flying) < limit and (condition := next(waiting, None)) is not None:
                flying[task.remote(study.job, condition.values)] = condition
            if not flying:
                return progress
            ready, _ = ray.wait(list(flying), num_returns=1, timeout=WAIT_SECONDS)
            for landed in ready:
                row = _row(ray, flying.pop(landed), landed)
                files.add(row)
                progress = Progress(
                    progress.total,
                    progress.earlier,
                    progress.done + 1,
                    progress.failed + (row["failure"] is not None),
                    time.monotonic() - started,
                )
            watch(progress)
    finally:
        files.flush()
        watch(progress)


def _row(ray: Any, condition: Condition, landed: Any) -> dict[str, Any]:
    try:
        results = ray.get(landed)
    except ray.exceptions.RayError as lost:
        reason = str(lost).strip().partition("\n")[0]
        results = {"failure": table_text(f"its worker was lost: {reason}")}
    values = {name: str(one) if isinstance(one, Path) else one for name, one in condition.values.items()}
    finished = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    return {"key": condition.key, **values, **results, "finished": finished}


def _check_reachable(address: str) -> None:
    """Raise an error for an address without a listener, for which Ray itself would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not (host and port.isdecimal()):
        raise ServiceError(f"{NO_CLUSTER} {address!r}, expected HOST:PORT as ray start --head prints it")
    try:
        socket.create_connection((host, int(port)), CONNECT_SECONDS).close()
    except (OSError, OverflowError) as failed:
        raise ServiceError(f"{NO_CLUSTER} {address} ({failed})") from failed


@cache
def _own_ray_folder() -> str:
    """Return the folder of the Ray that this process starts. It listens on loopback only, and needs a token.

    This function must be called before `ray` is imported, which reads the environment once.
    """
    folder = tempfile.mkdtemp(prefix="proximity-ray-")  # mode 0700; Ray opens its folder to all users
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    token = Path(folder, "token")
    token.touch(0o600)
    token.write_text(secrets.token_hex(32))
    for name in ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN"):  # without a mode, Ray requires a token at its start
        os.environ.pop(name, None)
    os.environ["RAY_AUTH_TOKEN_PATH"] = str(token)
    os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"  # also on Linux, so that only 127.0.0.1 is bound
    return folder


@contextlib.contextmanager
def _ray(address: str | None, cores: int | None) -> Iterator[Any]:
    """Yield the module `ray` with a running Ray. If Ray was started here, it is stopped at the end."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"  # no usage statistics
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
    except Exception as failed:  # of any kind, as Ray starts other programs
        where = f"{NO_CLUSTER} {address}" if address else "Ray cannot be started here"
        raise ServiceError(f"{where} ({str(failed).strip().partition(chr(10))[0]})") from failed
    try:
        yield ray
    finally:
        ray.shutdown()
