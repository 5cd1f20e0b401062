"""All crossings of rays, and first hits beyond a distance: arguments, and tables that grow."""

from typing import Any

import numpy as np

from proximity.checks import as_points
from proximity.errors import ArgumentError
from proximity.kernels.answers import CROSSING_WIDTH, RAY_ANSWER_WIDTH
from proximity.kernels.entries import crossings_batch
from proximity.scene.model.assembly import Model
from proximity.scene.queries.checked_query import broadcast_limits, broadcast_rows, run_batch, spread
from proximity.scene.queries.results import RayCrossings

CROSSINGS_PER_RAY = 4
"""Rows of the first table, a ray; a table that is full is followed by one of twice as many."""
MIN_ROWS = 64
NAMES = ("origins", "directions")
NO_COUNTS = np.empty(0, np.int64)


def crossings_of(model: Model, origins: Any, directions: Any, limits: tuple[Any, Any], workers: Any) -> Any:
    """Return the crossings of rays; *limits*: least and greatest distance, as given."""
    rays, shape = _checked_rays(origins, directions, limits)
    slices = run_batch(lambda _, *arrays: _cross(model, *arrays), rays, workers, None)
    counts = np.concatenate([counts for _, (counts, _) in slices])
    tables = [table for _, (_, tables) in slices for table in tables]
    record = RayCrossings()
    record._table = np.concatenate([np.empty((0, CROSSING_WIDTH)), *tables])
    record._shape, record._is_valid = shape, counts >= 0
    record._offsets = np.concatenate([[0], np.cumsum(np.maximum(counts, 0))])
    return record


def _cross(model: Model, *arrays: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the number of crossings of each ray of a slice, and their tables."""
    counts, tables, done = np.empty(len(arrays[0]), np.int64), [], 0
    rows = max(MIN_ROWS, CROSSINGS_PER_RAY * len(counts))
    while done < len(counts):
        rest = [array[done:] if len(array) > 1 else array for array in arrays]
        table: np.ndarray = np.empty((rows, CROSSING_WIDTH))
        here = counts[done:]
        fitted = int(crossings_batch(model.packed, *rest, here, table))
        tables.append(table[: np.maximum(here[:fitted], 0).sum()])
        done, rows = done + fitted, 2 * rows
    return counts, tables


def first_hits_beyond(
    model: Model, origins: Any, directions: Any, limits: tuple[Any, Any], workers: Any
) -> np.ndarray:
    """Return the table of first hits that are not nearer than the least distance; as `crossings_of`."""
    rays, shape = _checked_rays(origins, directions, limits)
    answers: np.ndarray = np.empty((len(rays[0]), RAY_ANSWER_WIDTH))

    def ask(_: np.ndarray, *arrays: np.ndarray) -> int:
        *rest, table = arrays
        return int(crossings_batch(model.packed, *rest, NO_COUNTS, table))

    run_batch(ask, [*rays, answers], workers, None)
    return answers.reshape((*shape, RAY_ANSWER_WIDTH))


def _checked_rays(
    origins: Any, directions: Any, limits: tuple[Any, Any]
) -> tuple[list[np.ndarray], tuple[int, ...]]:
    """Return origins and directions, greatest and least distances as rows, and the leading shape."""
    rows = [as_points(each, name) for each, name in zip((origins, directions), NAMES, strict=True)]
    rows = broadcast_rows(rows, NAMES) if rows[0].shape != rows[1].shape else rows
    nearest, farthest = limits
    most, rows = broadcast_limits(farthest, rows, "rays")
    shape = rows[0].shape[:-1]
    least, rows = broadcast_limits(nearest, rows, "rays", "min_distance")
    if len(most) > 1 and rows[0].shape[:-1] != shape:
        most = spread(most.reshape(shape), rows[0].shape[:-1]).reshape(-1)
    shape = rows[0].shape[:-1]
    flat = [each.reshape(-1, 3) for each in rows]
    zero = np.flatnonzero(~flat[1].any(axis=1))
    if len(zero):
        raise zero_direction(int(zero[0]))
    return [*flat, most, least], shape


def zero_direction(row: int) -> ArgumentError:
    """Return the error for a ray without a direction."""
    return ArgumentError(f"direction {row} is zero, expected a vector with a length")
