"""Batches of rows, queried in slices so that Ctrl-C is answered soon.

Compiled code cannot be interrupted. How a batch is cut changes no answer.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from time import perf_counter
from typing import Any

import numpy as np

from proximity.checks import is_whole
from proximity.errors import ArgumentError
from proximity.kernels.entries import morton_order

CHUNKS_PER_WORKER = 4
SMALLEST_CHUNK = 1024
BLOCK = 1 << 20
"""Rows that are sorted together, which takes some 30 ms: more can be interrupted in between."""
SLICE_SECONDS = 0.04
"""Duration of a slice, about. At its end it waits for the interpreter lock: 5 ms where others are busy."""
LARGEST_SLICE = 1 << 16
"""Rows; where searches suddenly take a hundred times as long, so does one slice."""
SMALLEST_FIRST = 16
GROWTH = 4
"""Most times by which a slice is longer than the one before."""
FIRST_BYTES = 1 << 30
"""Bytes of a model times rows of the first slice: at the centre of a sphere, where a search looks at every
face, some 100 bytes in 15 ns, that slice takes 0.2 s."""

IN_ORDER = np.empty(0, np.int64)
"""The order of rows that are asked as they come."""

Ask = Callable[..., Any]
OrderOf = Callable[..., np.ndarray]


def morton_order_of(rows: np.ndarray, *_: np.ndarray) -> np.ndarray:
    """Return the order of the first array's rows along a space-filling curve, (N,) int64.

    *rows*: (N, 3).
    """
    order: np.ndarray = morton_order(rows)
    return order


def worker_count(workers: Any, kind: str = "threads") -> int:
    """Return how many workers of that kind are meant."""
    if not is_whole(workers, -1) or workers == 0:
        raise ArgumentError(f"workers is {workers!r}, expected a number of {kind}, or -1 for all cores")
    return (os.cpu_count() or 1) if workers == -1 else int(workers)


def first_slice(model_bytes: int) -> int:
    """Return how many rows to ask at first, of points or segments, which may be anywhere."""
    return min(max(SMALLEST_FIRST, FIRST_BYTES // model_bytes), LARGEST_SLICE)


def run_batch(
    ask: Ask,
    arrays: list[np.ndarray],
    workers: Any,
    order_of: OrderOf | None,
    size: int = LARGEST_SLICE,
) -> list[tuple[int, Any]]:
    """Ask for all rows, sorted if there are many, on as many threads as wanted.

    *ask*: given an order and the arrays, or a slice of each, asks for the rows of that number, or for all as
    they come where the order is empty. *arrays*: what *ask* takes, N rows each; one that has a single row
    stands for all. *order_of*: given the arrays, or a slice of each, the order to take their rows in; None:
    as they come. Returned: for each slice, the first row that it was cut from, and what *ask* has returned.
    """
    thread_count = worker_count(workers)
    count = len(arrays[0])
    if thread_count > 1 and count >= 2 * SMALLEST_CHUNK:
        return _run_on_threads(ask, arrays, thread_count, order_of, size)
    if count <= size:
        return [(0, ask(order_of(*arrays) if order_of else IN_ORDER, *arrays))]
    answers = []
    for first in range(0, count, BLOCK):
        block = Block(first, _cut(arrays, first, first + BLOCK), order_of)
        answers += block.ask(ask, 0, block.count, size)
    return answers


def _run_on_threads(
    ask: Ask, arrays: list[np.ndarray], thread_count: int, order_of: OrderOf | None, size: int
) -> list[tuple[int, Any]]:
    answers = []
    is_over = Event()
    with ThreadPoolExecutor(thread_count) as pool:
        try:
            for first in range(0, len(arrays[0]), BLOCK):
                block = Block(first, _cut(arrays, first, first + BLOCK), order_of)
                step = max(SMALLEST_CHUNK, -(-block.count // (thread_count * CHUNKS_PER_WORKER)))
                chunks = [
                    pool.submit(block.ask, ask, at, min(at + step, block.count), size, is_over)
                    for at in range(0, block.count, step)
                ]
                for chunk in chunks:
                    answers += chunk.result()
        finally:
            is_over.set()  # whoever is interrupted here has the threads stop, and waits for that
    return answers


def _cut(arrays: list[np.ndarray], first: int, last: int) -> list[np.ndarray]:
    return [array[first:last] if len(array) > 1 else array for array in arrays]


class Block:
    """Rows that are sorted together."""

    def __init__(self, first: int, arrays: list[np.ndarray], order_of: OrderOf | None) -> None:
        self._first, self._arrays = first, arrays
        self._order = order_of(*arrays) if order_of else None
        self.count = len(arrays[0])

    def ask(
        self, ask: Ask, at: int, last: int, size: int, is_over: Event | None = None
    ) -> list[tuple[int, Any]]:
        """Ask for rows *at* to *last*, in slices.

        *at*, *last*: of the order, or of the rows where there is none.
        """
        answers = []
        while at < last and not (is_over and is_over.is_set()):
            count = min(size, last - at)
            begun = perf_counter()
            if self._order is None:
                answer = ask(IN_ORDER, *_cut(self._arrays, at, at + count))
                answers.append((self._first + at, answer))
            else:
                answers.append((self._first, ask(self._order[at : at + count], *self._arrays)))
            seconds = max(perf_counter() - begun, 1e-9)
            size = max(1, min(GROWTH * count, int(count * SLICE_SECONDS / seconds), LARGEST_SLICE))
            at += count
        return answers
