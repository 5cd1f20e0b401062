"""Checks of the arguments of queries besides points: limits, and rows that belong together."""

from typing import Any

import numpy as np
from numpy import inf

from proximity.checks import as_float64, copied, shown
from proximity.errors import ArgumentError

_NO_LIMIT = np.array([inf])


def broadcast_rows(rows: list[np.ndarray], names: tuple[str, ...]) -> list[np.ndarray]:
    """Return one array of rows, or two in one shape, C-ordered.

    *rows*: (..., 3).
    """
    first, second = rows[0], rows[-1]
    if first.shape == second.shape:
        return rows
    try:
        shape = np.broadcast_shapes(first.shape, second.shape)
    except ValueError as unfit:
        raise ArgumentError(
            f"{names[0]} have shape {first.shape} and {names[1]} {second.shape}, "
            "expected shapes that broadcast together"
        ) from unfit
    return [_spread(first, shape), _spread(second, shape)]


def broadcast_limits(
    max_distance: Any, rows: list[np.ndarray], name: str
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return how far to look, m, (1,) for all rows or (N,) for each, and the rows in one shape with that.

    *max_distance*: one length, or lengths whose shape broadcasts against the leading shape of the rows.
    *rows*: (..., 3).
    """
    if max_distance is inf:
        return _NO_LIMIT, rows
    if isinstance(max_distance, (str, bytes)):
        raise ArgumentError(f"max_distance is {shown(max_distance)}, expected a length in metres")
    if np.ndim(max_distance) == 0:
        return np.array([_checked_limit(max_distance)]), rows
    limits = as_float64(max_distance, "values of max_distance", expected="lengths in metres")
    is_unfit = ~(limits >= 0.0)
    if is_unfit.any():
        row = tuple(np.argwhere(is_unfit)[0].tolist())
        where = ", ".join(map(str, row))
        raise ArgumentError(f"max_distance[{where}] is {limits[row]}, expected a length of 0 m or more")
    leading = rows[0].shape[:-1]
    try:
        shape = np.broadcast_shapes(leading, limits.shape)
    except ValueError as unfit:
        raise ArgumentError(
            f"max_distance has shape {limits.shape} and {name} {rows[0].shape}, "
            f"expected a shape that broadcasts against {leading}"
        ) from unfit
    return _spread(limits, shape).reshape(-1), [_spread(array, (*shape, 3)) for array in rows]


def _checked_limit(max_distance: Any) -> float:
    try:
        limit = float(max_distance)
    except (OverflowError, TypeError, ValueError) as unfit:
        raise ArgumentError(f"max_distance is {max_distance!r}, expected a length in metres") from unfit
    if not limit >= 0.0:
        raise ArgumentError(f"max_distance is {limit}, expected a length of 0 m or more")
    return limit


def _spread(array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The array in that shape, C-ordered."""
    return array if array.shape == shape else copied(np.broadcast_to(array, shape))
