"""Preparation of all kernels before their first call, for kernels that numba compiles.

Kernels compiled ahead of time are always ready. See `proximity.native.mode`.
"""

from contextlib import suppress
from pathlib import Path

from proximity.native import ENTRIES, IS_JIT, import_entries


def _mark() -> Path:
    """Return the path of the file whose existence shows that all kernels are compiled.

    It is valid for these sources and this type of processor.
    """
    from llvmlite import binding

    from proximity.native.jit import cache_folder

    return cache_folder() / f"complete-{binding.get_host_cpu_name()}"


def kernels_are_cached() -> bool:
    """Return whether all kernels are compiled, so that no call waits for a compiler."""
    if not IS_JIT:
        return True
    try:
        return _mark().exists()
    except OSError:
        return False


def warm_up() -> None:
    """Prepare every kernel.

    Kernels compiled ahead of time are ready immediately. If numba compiles them, that takes some minutes the
    first time on a machine, and less than a second later.
    """
    if not IS_JIT:
        return
    from proximity.native.jit import argument_types

    import_entries()
    for entry in ENTRIES.values():
        entry.compiled.compile(argument_types(entry.signature))
    with suppress(OSError):  # without a cache the next process compiles again
        _mark().touch()
