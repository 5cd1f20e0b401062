"""Memory: return of freed pages, and pauses of Python's garbage collector."""

import ctypes
import gc
from collections.abc import Iterator
from contextlib import contextmanager, suppress


def return_free_memory() -> None:
    """Return freed pages to the system, if the C library supports it; 20 ms for 150 MB.

    Temporary data of reading a part are interleaved with its permanent data; glibc would keep 120 bytes a
    face.
    """
    with suppress(AttributeError, OSError, TypeError):  # another library than glibc
        ctypes.CDLL(None).malloc_trim(0)


@contextmanager
def collector_paused() -> Iterator[None]:
    """Pause the garbage collector in the block, which is timed or makes no cycles."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
