"""Memory for the arrays of one part, laid out as a model of that part alone has them.

So a solid's arrays are written once, where they stay: neither its sign nor a scene of it alone copies them.

An array starts at a cache line and, where it is large, uses huge pages: a walk goes from one end of a model
to the other, and the processor keeps in mind where some two thousand pages are: 8 MB of ordinary ones, all of
a model of a million faces in huge ones. The usual source gives huge pages to most of a large array, to all or
to none, by where it happens to begin. Near 304 k faces points and rays take 0.95 to 0.99 of the time, and the
same in every process.
"""

import mmap
from contextlib import suppress

import numpy as np

ALIGNMENT = 64
"""Bytes; a cache line, and the widest vector register."""
HUGE_PAGE = 2**21
"""Bytes, on the processors that matter. Less than one is taken from the usual source."""


def aligned_empty(count: int, dtype: type) -> np.ndarray:
    """Return (count,) uninitialised numbers that begin on a cache line; 2 MB and more on huge pages."""
    size = count * np.dtype(dtype).itemsize
    if size >= HUGE_PAGE and hasattr(mmap, "MADV_HUGEPAGE"):
        with suppress(OSError):  # no memory left, which the usual source tells in its own words
            return _on_huge_pages(size).view(dtype)
    return _from(np.empty(size + ALIGNMENT, np.uint8), ALIGNMENT, size).view(dtype)


def _on_huge_pages(size: int) -> np.ndarray:
    """So many bytes; what is left over of the last page is not asked for: 1 MB would be wasted on average."""
    memory = mmap.mmap(-1, size + HUGE_PAGE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    raw = np.frombuffer(memory, np.uint8)
    with suppress(OSError):  # a system without them
        memory.madvise(mmap.MADV_HUGEPAGE, -raw.ctypes.data % HUGE_PAGE, size // HUGE_PAGE * HUGE_PAGE)
    return _from(raw, HUGE_PAGE, size)


def _from(raw: np.ndarray, step: int, size: int) -> np.ndarray:
    """So many bytes of *raw* from the first address on that is a multiple of *step*."""
    start = -raw.ctypes.data % step
    return raw[start : start + size]
