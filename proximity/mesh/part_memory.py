"""Memory for the arrays of one part, with the layout of a model that contains only that part.

A solid's arrays are written once: neither the choice of its sign nor a scene of this solid alone copies them.

Each array starts at a cache line. Large arrays use huge pages, because a traversal touches a whole model: the
TLB has about two thousand entries, enough for 8 MB in ordinary pages but for a million faces in huge ones.
malloc uses huge pages for most of a large array, for all of it or for none, depending on its address. Near
304 k faces, point and ray queries take 0.95 to 0.99 of the time, and the same time in every process.
"""

import mmap
from contextlib import suppress

import numpy as np

ALIGNMENT = 64
"""Bytes. The size of a cache line and of the widest vector register."""
HUGE_PAGE = 2**21
"""Bytes, on common processors. Smaller arrays come from NumPy's allocator."""


def aligned_empty(count: int, dtype: type) -> np.ndarray:
    """Return an uninitialised array of *count* numbers that starts at a cache line.

    An array of 2 MB or more is on huge pages.
    """
    size = count * np.dtype(dtype).itemsize
    if size >= HUGE_PAGE and hasattr(mmap, "MADV_HUGEPAGE"):
        with suppress(OSError):  # out of memory: NumPy's allocator raises its own error
            return _on_huge_pages(size).view(dtype)
    return _from(np.empty(size + ALIGNMENT, np.uint8), ALIGNMENT, size).view(dtype)


def _on_huge_pages(size: int) -> np.ndarray:
    """Return *size* bytes on huge pages.

    The rest of the last page stays on ordinary pages: as a huge page it would waste 1 MB on average.
    """
    memory = mmap.mmap(-1, size + HUGE_PAGE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    raw = np.frombuffer(memory, np.uint8)
    with suppress(OSError):  # the system has no huge pages
        memory.madvise(mmap.MADV_HUGEPAGE, -raw.ctypes.data % HUGE_PAGE, size // HUGE_PAGE * HUGE_PAGE)
    return _from(raw, HUGE_PAGE, size)


def _from(raw: np.ndarray, step: int, size: int) -> np.ndarray:
    """Return *size* bytes of *raw* from its first address that is a multiple of *step*."""
    start = -raw.ctypes.data % step
    return raw[start : start + size]
