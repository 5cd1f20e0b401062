"""Rows of numbers: three of them, loaded eight at a time, copied."""

from proximity.kernels.layout import LANES
from proximity.native import inlined
from proximity.native.simd import load_each


@inlined
def vector(values):
    """The first three numbers of an array."""
    return values[0], values[1], values[2]


@inlined
def columns(rows, offsets, at):
    """The three numbers of eight rows, by column; *offsets*, from *at* on: how many are before each row."""
    return load_each(rows, offsets, at, 0), load_each(rows, offsets, at, 1), load_each(rows, offsets, at, 2)


@inlined
def columns_from(rows, first, offsets):
    """The same for eight rows in order, the last standing for those behind it. *offsets* (8,): scratch."""
    for k in range(LANES):
        offsets[k] = 3 * min(first + k, len(rows) - 1)
    return columns(rows, offsets, 0)


@inlined
def copy_numbers(source, start, target, at, count):
    """Copy so many numbers of an array, from *start* on, to *target*, from *at* on.

    An assignment of slices would compare their lengths, and carry numba's error for it.
    """
    for k in range(count):
        target[at + k] = source[start + k]


@inlined
def copy_row(source, row, target, to):
    """Copy a row of a table to row *to* of another."""
    for column in range(source.shape[1]):
        target[to, column] = source[row, column]
