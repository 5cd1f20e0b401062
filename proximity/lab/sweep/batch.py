"""A batch of conditions, done one after the other in one process of a node."""

import importlib.metadata
import platform
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import proximity
from proximity.errors import ProximityError
from proximity.lab.sweep.design import Condition
from proximity.lab.sweep.jobs import Job
from proximity.lab.sweep.node_files import NodeFiles
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
