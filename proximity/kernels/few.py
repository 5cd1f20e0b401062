"""Few rows as they come from Python: looked at by compiled code, and answered one after the other.

Here calls of five points spend least on being calls. Arrays may have any strides and addresses; what is not
(N, 3) in C order is left to those who have more time.
"""

import numpy as np

from proximity.kernels.cast import cast_batch
from proximity.kernels.compiling import kernel
from proximity.kernels.memory import are_rows, arrays_at, as_column, as_rows, longs_here
from proximity.kernels.query import (
    closest_batch,
    contains_batch,
    distance_batch,
    has_inside,
    signed_alone,
    signed_batch,
)
from proximity.kernels.scene import is_alone
from proximity.kernels.segment_query import segment_batch

CLOSEST = "(int64, float64[:,:], float64, float64[:,::1])"
DISTANCE = "(int64, float64[:,:], float64[::1])"
CONTAINS = "(int64, float64[:,:], boolean[::1])"
SEGMENTS = CAST = "(int64, float64[:,:], float64[:,:], float64, float64[:,::1])"
LENGTHS = "(int64, float64[:,:], float64[:,:], float64, float64[::1])"
"""Types of the arguments; see `compiling.Settled`."""

NOT_ASKED = -2
"""Of rays: these are not rows."""


@kernel
def closest_few(handle, rows, limit, answers):
    """`closest_batch`; whether that was done."""
    if not are_rows(rows):
        return False
    closest_batch(handle, as_rows(rows), longs_here(0), limit, answers)
    return True


@kernel
def signed_few(handle, rows, distances):
    """`signed_batch`; whether that was done."""
    if not are_rows(rows):
        return False
    _, _, _, parts = arrays_at(handle)
    if is_alone(parts):
        signed_alone(handle, as_rows(rows), distances)
    else:
        signed_batch(handle, as_rows(rows), longs_here(0), distances)
    return True


@kernel
def distance_few(handle, rows, distances):
    """`distance_batch`; whether that was done."""
    if not are_rows(rows):
        return False
    distance_batch(handle, as_rows(rows), longs_here(0), np.inf, distances)
    return True


@kernel
def contains_few(handle, rows, inside):
    """`contains_batch`; whether that was done, which it is not where nothing has an inside."""
    if not are_rows(rows) or not has_inside(handle):
        return False
    contains_batch(handle, as_rows(rows), longs_here(0), inside)
    return True


@kernel
def cast_few(handle, origins, directions, limit, answers):
    """`cast_batch`, and what it returns, or `NOT_ASKED`."""
    if len(origins) != len(directions) or not (are_rows(origins) and are_rows(directions)):
        return np.int64(NOT_ASKED)
    return cast_batch(handle, as_rows(origins), as_rows(directions), longs_here(0), limit, answers)


@kernel
def lengths_few(handle, origins, directions, limit, distances):
    """`cast_few` for distances alone."""
    return cast_few(handle, origins, directions, limit, as_column(distances))


@kernel
def segments_few(handle, starts, ends, limit, answers):
    """`segment_batch`; whether that was done."""
    if len(starts) != len(ends) or not (are_rows(starts) and are_rows(ends)):
        return False
    segment_batch(handle, as_rows(starts), as_rows(ends), longs_here(0), limit, answers)
    return True
