"""Rows of three numbers: loading eight at a time, and copying."""

from proximity.kernels.layout import LANES
from proximity.native import inlined
from proximity.native.simd import load_each


@inlined
def vector(values):
    """Return the first three numbers of an array."""
    return values[0], values[1], values[2]


@inlined
def columns(rows, offsets, at):
    """Load eight rows of three numbers by column. Their offsets are those in *offsets* from *at* on."""
    return load_each(rows, offsets, at, 0), load_each(rows, offsets, at, 1), load_each(rows, offsets, at, 2)


@inlined
def columns_from(rows, first, offsets):
    """Load eight consecutive rows by column, with the last row repeated past the end.

    *offsets*: (8,), scratch memory.
    """
    for k in range(LANES):
        offsets[k] = 3 * min(first + k, len(rows) - 1)
    return columns(rows, offsets, 0)


@inlined
def copy_numbers(source, start, target, at, count):
    """Copy *count* numbers of *source* from *start* on to *target* from *at* on.

    A slice assignment would compare lengths, and include the code of numba's error for it.
    """
    for k in range(count):
        target[at + k] = source[start + k]


@inlined
def copy_row(source, row, target, to):
    """Copy a row of a table to row *to* of another table."""
    for column in range(source.shape[1]):
        target[to, column] = source[row, column]
