"""Memory: freed pages given back, and pauses of Python's garbage collector."""

import ctypes
import gc
from collections.abc import Iterator
from contextlib import contextmanager, suppress


def return_free_memory() -> None:
    """Give freed pages back to the system, where the C library can; 20 ms for 150 MB.

    What reading a part takes for a while lies between what stays; glibc would keep 120 bytes a face of it.
    """
    with suppress(AttributeError, OSError, TypeError):  # another library than glibc
        ctypes.CDLL(None).malloc_trim(0)


@contextmanager
def collector_paused() -> Iterator[None]:
    """Look for no garbage in the block, which is timed or makes no cycles; afterwards as before."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
