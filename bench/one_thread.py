"""Keep a process to one thread and one core. Imports nothing that would start threads of its own."""

import os

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "TBB_NUM_THREADS",
    "IGL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


def hold_to_one_thread() -> str:
    """Keep this process to one thread and one core; call it before NumPy and the rivals are imported.

    Returns a sentence that says how it was done.
    """
    for variable in THREAD_VARIABLES:
        os.environ[variable] = "1"
    how = "one thread each (" + ", ".join(f"{variable}=1" for variable in THREAD_VARIABLES) + ", nthreads=1"
    if hasattr(os, "sched_setaffinity"):
        core = max(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {core})
        return f"{how}; process held to core {core})"
    return f"{how})"
