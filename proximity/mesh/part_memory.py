"""Memory for the arrays of one part, laid out as in a model of that part alone.

A solid's arrays are written once: neither its sign nor a scene of it alone copies them.

An array starts at a cache line and, if it is large, uses huge pages: a traversal touches a whole model, and
the TLB has about two thousand entries, 8 MB of ordinary pages, but all of a model of a million faces in huge
ones. malloc gives huge pages to most of a large array, to all or to none, depending on its address. Near 304
k faces point and ray queries take 0.95 to 0.99 of the time, and the same in every process.
"""

import mmap
from contextlib import suppress

import numpy as np

ALIGNMENT = 64
"""Bytes; a cache line, and the widest vector register."""
HUGE_PAGE = 2**21
"""Bytes, on common processors. Smaller arrays come from NumPy's allocator."""


def aligned_empty(count: int, dtype: type) -> np.ndarray:
    """Return (count,) uninitialised numbers, aligned to a cache line; on huge pages from 2 MB."""
    size = count * np.dtype(dtype).itemsize
    if size >= HUGE_PAGE and hasattr(mmap, "MADV_HUGEPAGE"):
        with suppress(OSError):  # out of memory: NumPy's allocator raises its own error
            return _on_huge_pages(size).view(dtype)
    return _from(np.empty(size + ALIGNMENT, np.uint8), ALIGNMENT, size).view(dtype)


def _on_huge_pages(size: int) -> np.ndarray:
    """Return *size* bytes. The rest of the last page is not requested: it would waste 1 MB on average."""
    memory = mmap.mmap(-1, size + HUGE_PAGE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    raw = np.frombuffer(memory, np.uint8)
    with suppress(OSError):  # the system has no huge pages
        memory.madvise(mmap.MADV_HUGEPAGE, -raw.ctypes.data % HUGE_PAGE, size // HUGE_PAGE * HUGE_PAGE)
    return _from(raw, HUGE_PAGE, size)


def _from(raw: np.ndarray, step: int, size: int) -> np.ndarray:
    """Return *size* bytes of *raw* from its first address that is a multiple of *step*."""
    start = -raw.ctypes.data % step
    return raw[start : start + size]
