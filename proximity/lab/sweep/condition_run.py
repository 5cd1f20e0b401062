"""Runs of the job for conditions: a batch of them in a process of a node, and one again in this process."""

import importlib.metadata
import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import proximity
from proximity.errors import ProximityError, ServiceError
from proximity.lab.sweep.design import Condition
from proximity.lab.sweep.jobs import Job
from proximity.lab.sweep.node_files import NodeFiles
from proximity.lab.sweep.row_files import read_rows, row_paths
from proximity.lab.sweep.study_file import Study
from proximity.system import machine

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
