"""Memory for the arrays of one part, laid out as a model of that part alone has them.

So a solid's arrays are written once, where they stay: neither its sign nor a scene of it alone copies them.

An array starts at a cache line and, where it is large, uses huge pages: a walk goes from one end of a model
to the other, and the processor keeps in mind where some two thousand pages are: 8 MB of ordinary ones, all of
a model of a million faces in huge ones. The usual source gives huge pages to most of a large array, to all or
to none, by where it happens to begin. Near 304 k faces points and rays take 0.95 to 0.99 of the time, and the
same in every process.
"""

import mmap
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from proximity.kernels.layout import BLOCK_STRIDE, LANES, MOMENT_STRIDE, NODE_STRIDE, ORIENTED_STRIDE

ALIGNMENT = 64
"""Bytes; a cache line, and the widest vector register."""
HUGE_PAGE = 2**21
"""Bytes, on the processors that matter. Less than one is taken from the usual source."""
EMPTY_NODES = 1
"""Of the trees over parts, a scene of one has an empty node; see `part_trees`."""


@dataclass(frozen=True, slots=True, eq=False)
class PartMemory:
    """Arrays of a model of one part, and where in them the part's own begin."""

    reals: np.ndarray  # float64
    words: np.ndarray  # float32
    real_starts: list[int]  # of blocks, corners, normals
    word_starts: list[int]  # of nodes, and so on; see `WORD_NOTES`

    @classmethod
    def of_size(
        cls, node_count: int, block_count: int, corner_count: int, face_count: int, grid_words: int
    ) -> "PartMemory":
        """Return memory in which nothing is written yet but zeros between the arrays, and for a grid."""
        reals, real_starts = _spaced(
            [BLOCK_STRIDE * block_count, 3 * corner_count, 3 * corner_count], np.float64
        )
        word_counts = [
            NODE_STRIDE * node_count, LANES * block_count, MOMENT_STRIDE * node_count,
            ORIENTED_STRIDE * block_count, 3 * face_count, 3 * face_count, 0, block_count, 0,
        ]  # fmt: skip
        space = [NODE_STRIDE * EMPTY_NODES, 0, 0, 0, 0, 0, grid_words, 0, 0]
        words, word_starts = _spaced(word_counts, np.float32, space)
        return cls(reals, words, real_starts, word_starts)

    def real(self, number: int, count: int) -> np.ndarray:
        """Return so many numbers of one of the arrays in *reals*, to read and to write."""
        return self.reals[self.real_starts[number] :][:count]

    def word(self, number: int, count: int, dtype: type = np.float32) -> np.ndarray:
        """Return so many of one of the arrays in *words*, likewise."""
        return self.words[self.word_starts[number] :][:count].view(dtype)


WORD_SLOT_FACES, WORD_MOMENTS, WORD_BOXES, WORD_FACES, WORD_NEIGHBORS, WORD_GRID, WORD_NOTES = range(1, 8)
"""Numbers of the arrays in `PartMemory.word_starts`; that of the nodes is 0, and that of the end is last."""
REAL_CORNERS, REAL_NORMALS = 1, 2
"""Numbers of the arrays in `PartMemory.real_starts`; that of the blocks is 0."""


def joined(groups: Sequence[Sequence[np.ndarray]], dtype: type) -> tuple[np.ndarray, list[int]]:
    """Return groups of arrays in one array, each on a cache line, and where each begins; bits are kept.

    *groups*: of types as wide as *dtype*; those of a group are put end to end.
    """
    whole, starts = _spaced([sum(piece.size for piece in group) for group in groups], dtype)
    for start, group in zip(starts, groups, strict=True):
        end = start
        for piece in group:
            whole[end : end + piece.size] = np.ascontiguousarray(piece).reshape(-1).view(dtype)
            end += piece.size
    return whole, starts


def _spaced(counts: list[int], dtype: type, space: list[int] | None = None) -> tuple[np.ndarray, list[int]]:
    """Memory for arrays of so many numbers, each on a cache line; where each begins. *space*: behind each."""
    step = ALIGNMENT // np.dtype(dtype).itemsize
    starts, end = [], 0
    spaces = space or [0] * len(counts)
    for count, more in zip(counts, spaces, strict=True):
        starts.append(end)
        end += -(-(count + more) // step) * step
    whole = aligned_empty(max(end, step), dtype)
    filled = 0
    for start, count in zip([*starts, len(whole)], [*counts, 0], strict=True):
        whole[filled:start] = 0
        filled = start + count
    return whole, starts


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
