"""Validated queries: rows of any shape, limits, slices, threads.

Batches are cut into slices so that Ctrl-C takes effect soon, since compiled code cannot be interrupted. The
slices do not change the answers.

A query takes a model, one or two arrays of rows, the largest distance, and a number of workers; it returns
the table of its answers. A small batch of plain rows is answered by compiled code alone, see `native.query`.
"""

import os
import sys
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Event
from time import perf_counter
from typing import Any

import numpy as np
from numpy import inf

from proximity import native
from proximity.checks import as_float64, as_points, copied, is_whole, shown
from proximity.errors import ArgumentError, ProximityError, UnitsWarning
from proximity.kernels.entries import morton_order
from proximity.kernels.layout import IN_MILLIMETRES, NO_ROW
from proximity.kernels.thresholds import MILLIMETRES_FROM, MILLIMETRES_TO, SORT_FROM
from proximity.scene.model.assembly import Model

CHUNKS_PER_WORKER = 4
SMALLEST_CHUNK = 1024
BLOCK = 1 << 20
"""Rows that are sorted together, about 30 ms; a larger batch can be interrupted between blocks."""
SLICE_SECONDS = 0.04
"""Duration of a slice, about. At its end it waits for the interpreter lock: 5 ms if others are busy."""
MAX_SLICE = 1 << 16
"""Rows; bounds the duration of a slice whose searches suddenly take a hundred times longer."""
SMALLEST_FIRST = 16
GROWTH = 4
"""Largest ratio between the lengths of a slice and the one before."""
FIRST_BYTES = 1 << 30
"""Bytes of a model times rows of the first slice: at the centre of a sphere, where a search tests every face,
some 100 bytes in 15 ns, that slice takes 0.2 s."""

IN_ORDER = np.empty(0, np.int64)
"""The order of rows that are answered in the order given."""

Ask = Callable[..., Any]
OrderOf = Callable[..., np.ndarray]

_NO_LIMIT = np.array([inf])


def _order_of_points(model: Model, _: int) -> tuple[OrderOf | None, int]:
    """Return the function that orders points or segments, and the number of rows in the first slice."""
    return morton_order_of, first_slice(model.reals.nbytes)


@dataclass(frozen=True, slots=True)
class CheckedQuery:
    """A query of one kind."""

    name: str  # of the entry point
    entry: Any  # the entry point itself
    names: tuple[str, ...]  # names of the arrays of rows in the public signature
    subject: str  # name of the rows in messages about limits
    width: int  # columns of an answer; with one column the table has no axis of columns
    refusal: Callable[[int], ProximityError]  # the error for a row that the entry point rejects
    order_of: Callable[[Model, int], tuple[OrderOf | None, int]] = _order_of_points
    dtype: type = np.float64

    def ask(self, model: Model, *arguments: Any) -> Any:
        """Return the table of answers, in the shape of the rows.

        *arguments*: arrays of rows, the largest distance, and a number of workers, as the caller gave them.
        """
        *given, max_distance, workers = arguments
        rows = [as_points(each, name) for each, name in zip(given, self.names, strict=True)]
        limits = _NO_LIMIT
        if len(rows) > 1 and rows[0].shape != rows[1].shape:
            rows = broadcast_rows(rows, self.names)
        if max_distance is not inf:
            limits, rows = broadcast_limits(max_distance, rows, self.subject)
        flat = [each.reshape(-1, 3) for each in rows]
        answers: np.ndarray = np.empty((len(flat[0]), self.width), self.dtype)
        if len(answers) < SORT_FROM:
            if type(workers) is not int or workers != 1:
                worker_count(workers)
            refused = self.entry(model.packed, *flat, IN_ORDER, limits, answers)
            refused = NO_ROW if refused == IN_MILLIMETRES else refused
        else:
            refused = self._ask_batch(model, [*flat, limits, answers], workers)
        if refused != NO_ROW:
            raise self.refusal(int(refused))
        if self.names == ("points",) and self.dtype is np.float64:
            _warn_of_millimetres(model, answers[:, 0])
        shape = rows[0].shape[:-1]
        return answers.reshape((*shape, self.width) if self.width > 1 else shape)[()]

    def _ask_batch(self, model: Model, arrays: list[np.ndarray], workers: Any) -> int:
        """Fill the last of *arrays* in slices; return the first row that is rejected, or `NO_ROW`."""
        order_of, size = self.order_of(model, len(arrays[0]))

        def ask_slice(order: np.ndarray, *arrays: np.ndarray) -> int:
            *rows, limits, answers = arrays
            return int(self.entry(model.packed, *rows, order, limits, answers))

        found = run_batch(ask_slice, arrays, workers, order_of, size)
        answered = (NO_ROW, IN_MILLIMETRES)
        return min((first + row for first, row in found if row not in answered), default=NO_ROW)

    def quick(self) -> Any:
        """Return the query as a function with a fast path for a small batch of plain rows."""
        return native.query(self.name, self.width, SORT_FROM, self.ask)


def _warn_of_millimetres(model: Model, distances: np.ndarray) -> None:
    """Warn if the distances suggest points in millimetres; called by `CheckedQuery.ask`.

    Not for calls from the package: its commands and replays report far points themselves.
    """
    caller = sys._getframe(3)  # of the query method
    if caller.f_globals.get("__name__", "").startswith("proximity."):
        return
    nearest = float(distances.min(initial=np.inf))
    size = size_of(model)
    if MILLIMETRES_FROM * size < nearest < MILLIMETRES_TO * size:
        words = in_millimetres("the nearest point", nearest, size, "points")
        warnings.warn(words, UnitsWarning, stacklevel=4)


def size_of(model: Model) -> float:
    """Return the diagonal of the box of all parts, m."""
    box = model.frames[-1]
    return float(np.linalg.norm(box["box_upper"] - box["box_lower"]))


def in_millimetres(what: str, distance: float, size: float, names: str) -> str:
    """Return a message that *what* is far enough away for *names* to be in millimetres."""
    return (
        f"{what} is {distance:.3g} m from the nearest part, {distance / size:.0f} times the size of the "
        f"scene: {names} are metres"
    )


def broadcast_rows(rows: list[np.ndarray], names: tuple[str, ...]) -> list[np.ndarray]:
    """Return two arrays of rows, (..., 3), in one shape, C-ordered."""
    first, second = rows
    try:
        shape = np.broadcast_shapes(first.shape, second.shape)
    except ValueError as unfit:
        raise ArgumentError(
            f"{names[0]} have shape {first.shape} and {names[1]} {second.shape}, "
            "expected shapes that broadcast together"
        ) from unfit
    return [spread(first, shape), spread(second, shape)]


def broadcast_limits(
    max_distance: Any, rows: list[np.ndarray], subject: str, name: str = "max_distance"
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the largest distance, m, (1,) for all rows or (N,) for each, and the rows in the same shape.

    *max_distance*: one length, or lengths whose shape broadcasts against the leading shape of the rows.
    *rows*: (..., 3).
    """
    if isinstance(max_distance, (str, bytes)):
        raise ArgumentError(f"{name} is {shown(max_distance)}, expected a length in metres")
    if np.ndim(max_distance) == 0:
        return np.array([_checked_limit(max_distance, name)]), rows
    limits = as_float64(max_distance, f"values of {name}", expected="lengths in metres")
    is_unfit = ~(limits >= 0.0)
    if is_unfit.any():
        row = tuple(np.argwhere(is_unfit)[0].tolist())
        where = ", ".join(map(str, row))
        raise ArgumentError(f"{name}[{where}] is {limits[row]}, expected a length of 0 m or more")
    leading = rows[0].shape[:-1]
    try:
        shape = np.broadcast_shapes(leading, limits.shape)
    except ValueError as unfit:
        raise ArgumentError(
            f"{name} has shape {limits.shape} and {subject} {rows[0].shape}, "
            f"expected a shape that broadcasts against {leading}"
        ) from unfit
    return spread(limits, shape).reshape(-1), [spread(array, (*shape, 3)) for array in rows]


def _checked_limit(max_distance: Any, name: str) -> float:
    try:
        limit = float(max_distance)
    except (OverflowError, TypeError, ValueError) as unfit:
        raise ArgumentError(f"{name} is {max_distance!r}, expected a length in metres") from unfit
    if not limit >= 0.0:
        raise ArgumentError(f"{name} is {limit}, expected a length of 0 m or more")
    return limit


def spread(array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return the array broadcast to that shape, C-ordered."""
    return array if array.shape == shape else copied(np.broadcast_to(array, shape))


# --- batches: slices and threads ---


def morton_order_of(rows: np.ndarray, *_: np.ndarray) -> np.ndarray:
    """Return the order of the first array's rows along a space-filling curve, (N,) int64.

    *rows*: (N, 3).
    """
    order: np.ndarray = morton_order(rows)
    return order


def worker_count(workers: Any, kind: str = "threads") -> int:
    """Return the number of workers, with -1 resolved to the number of cores."""
    if not is_whole(workers, -1) or workers == 0:
        raise ArgumentError(f"workers is {workers!r}, expected a number of {kind}, or -1 for all cores")
    return (os.cpu_count() or 1) if workers == -1 else int(workers)


def first_slice(model_bytes: int) -> int:
    """Return the number of rows in the first slice of points or segments, which may be anywhere."""
    return min(max(SMALLEST_FIRST, FIRST_BYTES // model_bytes), MAX_SLICE)


def run_batch(
    ask: Ask,
    arrays: list[np.ndarray],
    workers: Any,
    order_of: OrderOf | None,
    size: int = MAX_SLICE,
) -> list[tuple[int, Any]]:
    """Run a query for all rows, sorted if there are many, on the given number of threads.

    *ask*: takes an order and the arrays, or a slice of each; it answers the rows in that order, or all rows
    as they are if the order is empty. *arrays*: the arguments of *ask*, N rows each; an array with a single
    row applies to all. *order_of*: takes the arrays, or a slice of each, and returns the order of their rows;
    None keeps the order given. Returns, for each slice, the first row of its arrays and the result of *ask*.
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
            is_over.set()  # after an interrupt, the pool's exit waits until the threads have stopped
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
        """Run a query for rows *at* to *last*, in slices.

        *at*, *last*: positions in the order, or row numbers if there is none.
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
            size = max(1, min(GROWTH * count, int(count * SLICE_SECONDS / seconds), MAX_SLICE))
            at += count
        return answers
