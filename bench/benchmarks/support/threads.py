"""Limit a process to one thread and one core. Imports no module that starts threads."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "TBB_NUM_THREADS",
    "IGL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)
UNLIMITED = "as the process has them"
"""Describes the threads of a process without limits."""
CORES = frozenset(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else frozenset()
"""Cores that this process may use; empty if the system does not report them."""


def limit_to_one_thread() -> str:
    """Limit this process to one thread and one core; call it before NumPy and the rivals are imported.

    Returns a sentence on the method.
    """
    for variable in THREAD_VARIABLES:
        os.environ[variable] = "1"
    sentence = "one thread each (" + ", ".join(f"{variable}=1" for variable in THREAD_VARIABLES)
    sentence += ", nthreads=1"
    if hasattr(os, "sched_setaffinity"):
        core = max(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {core})
        return f"{sentence}; process held to core {core})"
    return f"{sentence})"


@contextmanager
def on_cores(cores: Iterable[int]) -> Iterator[None]:
    """Use other cores inside the context, if the system supports it; processes started there inherit them."""
    if not cores or not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
