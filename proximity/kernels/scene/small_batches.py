"""Few rows as they come from Python: looked at by compiled code, and answered one after the other.

Here calls of five points spend least on being calls. Anything may be given; what is not (N, 3) float64 in C
order is left to those who have more time.
"""

import numpy as np

from proximity.kernels.compiler import kernel
from proximity.kernels.geometry.frames import (
    is_alone,
)
from proximity.kernels.given import COLUMN, FLAGS, GIVEN_ROWS, INTEGER, REAL, TABLE, row_count, rows_of
from proximity.kernels.memory import arrays_at, as_column, longs_here, reals_here
from proximity.kernels.scene.point_queries import (
    closest_batch,
    contains_batch,
    distance_batch,
    has_inside,
    signed_alone,
    signed_batch,
)
from proximity.kernels.scene.ray_queries import cast_batch
from proximity.kernels.scene.segment_queries import segment_batch

CLOSEST = (INTEGER, GIVEN_ROWS, REAL, TABLE)
DISTANCE = (INTEGER, GIVEN_ROWS, COLUMN)
CONTAINS = (INTEGER, GIVEN_ROWS, FLAGS)
SEGMENTS = CAST = (INTEGER, GIVEN_ROWS, GIVEN_ROWS, REAL, TABLE)
LENGTHS = (INTEGER, GIVEN_ROWS, GIVEN_ROWS, REAL, COLUMN)
"""Types of the arguments; see `compiling.CompiledCall`."""

NOT_ASKED = -2
"""Of rays: these are not rows."""


@kernel
def closest_few(handle, rows, limit, answers):
    """`closest_batch`; whether that was done."""
    if row_count(rows) < 0:
        return False
    limits = reals_here(1)
    limits[0] = limit
    closest_batch(handle, rows_of(rows), longs_here(0), limits, answers)
    return True


@kernel
def signed_few(handle, rows, distances):
    """`signed_batch`; whether that was done."""
    if row_count(rows) < 0:
        return False
    _, _, _, parts = arrays_at(handle)
    if is_alone(parts):
        signed_alone(handle, rows_of(rows), distances)
    else:
        signed_batch(handle, rows_of(rows), longs_here(0), distances)
    return True


@kernel
def distance_few(handle, rows, distances):
    """`distance_batch`; whether that was done."""
    if row_count(rows) < 0:
        return False
    distance_batch(handle, rows_of(rows), longs_here(0), np.inf, distances)
    return True


@kernel
def contains_few(handle, rows, inside):
    """`contains_batch`; whether that was done, which it is not where nothing has an inside."""
    if row_count(rows) < 0 or not has_inside(handle):
        return False
    contains_batch(handle, rows_of(rows), longs_here(0), inside)
    return True


@kernel
def cast_few(handle, origins, directions, limit, answers):
    """`cast_batch`, and what it returns, or `NOT_ASKED`."""
    if not 0 <= row_count(origins) == row_count(directions):
        return np.int64(NOT_ASKED)
    limits = reals_here(1)
    limits[0] = limit
    return cast_batch(handle, rows_of(origins), rows_of(directions), longs_here(0), limits, answers)


@kernel
def lengths_few(handle, origins, directions, limit, distances):
    """`cast_few` for distances alone."""
    return cast_few(handle, origins, directions, limit, as_column(distances))


@kernel
def segments_few(handle, starts, ends, limit, answers):
    """`segment_batch`; whether that was done."""
    if not 0 <= row_count(starts) == row_count(ends):
        return False
    limits = reals_here(1)
    limits[0] = limit
    segment_batch(handle, rows_of(starts), rows_of(ends), longs_here(0), limits, answers)
    return True
