"""Conversion of array arguments, and errors for invalid ones."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from odd_arrays import unaligned

from proximity.checks import as_float64, as_points
from proximity.errors import ArgumentError

ROWS = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


class Flavoured(np.ndarray):
    """A subclass, like memory maps and arrays with units."""


def read_only():
    rows = np.array(ROWS)
    rows.flags.writeable = False
    return rows


@pytest.mark.parametrize(
    "rows",
    [
        ROWS,
        tuple(map(tuple, ROWS)),
        [np.array(row) for row in ROWS],
        np.array(ROWS, np.int8),
        np.array(ROWS, np.uint64),
        np.array(ROWS, np.float16),
        np.array(ROWS, np.float32),
        np.array(ROWS, np.longdouble),
        np.array(ROWS, ">f8"),
        np.array(ROWS, ">i4"),
        np.array(ROWS, object),
        np.array([[Fraction(1), Decimal(2), 3], [4, 5.0, np.float32(6)]], object),
        np.asfortranarray(ROWS),
        np.repeat(ROWS, 2, axis=0)[::2],
        np.array(ROWS)[::-1][::-1],
        np.array(ROWS).view(Flavoured),
        np.ma.array(ROWS),
        read_only(),
        unaligned(np.array(ROWS)),
    ],
    ids=lambda rows: f"{type(rows).__name__} {getattr(rows, 'dtype', '')}",
)
def test_numbers_of_any_kind_become_plain_float64(rows):
    """Writeable, aligned and C-ordered: other arrays would make numba compile all kernels again."""
    points = as_points(rows)

    assert type(points) is np.ndarray
    assert points.dtype == np.float64
    assert points.dtype.isnative
    assert points.flags.carray
    assert points.tolist() == ROWS


def test_float64_is_not_copied():
    points = np.array(ROWS)

    assert as_float64(points, "points") is points


def test_truth_values_are_numbers():
    assert as_points([True, False, True]).tolist() == [1.0, 0.0, 1.0]


def test_what_a_mask_hides_is_nan():
    hidden = np.ma.array([1, 2, 3], mask=[False, True, False])

    assert np.array_equal(as_points(hidden), [1.0, np.nan, 3.0], equal_nan=True)


@pytest.mark.skipif(np.finfo(np.longdouble).max == np.finfo(np.float64).max, reason="no wider type here")
def test_numbers_too_large_for_float64_are_infinite():
    assert as_points(np.array(["1e4000", "0", "0"], np.longdouble)).tolist() == [np.inf, 0.0, 0.0]


@pytest.mark.parametrize("shape", [(3,), (1, 3), (0, 3), (2, 4, 3), (2, 0, 3)])
def test_points_keep_their_shape(shape):
    assert as_points(np.ones(shape)).shape == shape
    assert as_points(np.ones(shape, np.float32)).shape == shape


@pytest.mark.parametrize("rows", [[], (), np.empty(0), np.empty(0, np.float32)])
def test_an_empty_list_is_no_points(rows):
    points = as_points(rows)
    assert (points.shape, points.dtype) == ((0, 3), np.float64)


@pytest.mark.parametrize(
    "rows, shape",
    [
        (5.0, r"\(\)"),
        (np.ones((0, 2)), r"\(0, 2\)"),
        ([1.0, 2.0], r"\(2,\)"),
        ([1.0, 2.0, 3.0, 4.0], r"\(4,\)"),
        (np.ones((3, 2)), r"\(3, 2\)"),
        (np.ones((3, 0)), r"\(3, 0\)"),
        (np.ones((3, 1)), r"\(3, 1\)"),
    ],
)
def test_other_shapes_are_refused(rows, shape):
    with pytest.raises(ArgumentError, match=rf"^points have shape {shape}, expected \(\.\.\., 3\)$"):
        as_points(rows)


@pytest.mark.parametrize(
    "rows, reason",
    [
        ([[1, 2, 3], [4, 5]], "points have rows of different lengths"),
        ([1, 2, 3j], "points have dtype complex128"),
        (["1", "2", "3"], "points have dtype <U1"),
        ([b"1", b"2", b"3"], r"points have dtype \|S1"),
        (np.array(["2020-01-01"] * 3, "datetime64[D]"), r"points have dtype datetime64\[D\]"),
        (np.zeros(3, "f8,f8"), "points have dtype"),
        (np.array(["1", 2, 3], object), "points hold '1', which is not a number"),
        (np.array([1, None, 3], object), "points hold None, which is not a number"),
        (None, "points hold None, which is not a number"),
        ({}, r"points contain something that is not a number \(float\(\) argument .* not 'dict'\)"),
        (np.array([1j, 2, 3], object), r"points contain something that is not a number \(.*complex'\)"),
        (np.array([10**400, 2, 3], object), r"points contain something that is not a number \(int too large"),
    ],
)
def test_what_holds_no_numbers_is_refused_with_the_reason(rows, reason):
    with pytest.raises(ArgumentError, match=rf"^{reason}.*, expected numbers of shape \(\.\.\., 3\)$"):
        as_points(rows)


def test_caller_chooses_names():
    with pytest.raises(ArgumentError, match=r"^vertices have dtype <U1, expected numbers of shape \(V, 3\)$"):
        as_float64(["a"], "vertices", expected="numbers of shape (V, 3)")
    with pytest.raises(ArgumentError, match=r"^x have dtype <U1, expected numbers$"):
        as_float64(["a"], "x")
