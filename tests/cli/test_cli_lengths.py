"""Metres in people's units: at most 15 significant digits, whatever their size."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from proximity.cli.lengths import distances_in_units, in_unit, in_units, rounded


def test_three_millimetres_are_three():
    # Was: 3.000000000000001.
    assert in_unit(0.0030000000000000005, 0.001) == 3.0
    assert in_units(np.array([[-0.0130000000000000012, 0.0, -0.0]]), 0.001).tolist() == [[-13.0, 0.0, 0.0]]


def test_distance_ends_where_its_coordinates_end():
    x = np.array([-13.0, -11.0, -10.7, 10.1, 10.0001, 12.34, 10.0, np.nan, np.inf])
    nothing = np.zeros(len(x))
    points = np.column_stack((x * 0.001, nothing, nothing))
    surface = np.column_stack((np.sign(x) * 0.01, nothing, nothing))
    distances = np.abs(points[:, 0]) - np.abs(surface[:, 0])
    distances[-1] = np.inf

    result = distances_in_units(distances, 0.001, points, surface)

    np.testing.assert_array_equal(result, [3.0, 1.0, 0.7, 0.1, 0.0001, 2.34, 0.0, np.nan, np.inf])


def test_distance_of_small_parts_keeps_its_digits():
    points = np.array([[1.23e-9, 0.0, 0.0]])

    assert distances_in_units(np.array([1.2e-10]), 1.0, points, np.zeros((1, 3))).tolist() == [1.2e-10]


def test_zero_has_no_sign():
    assert [str(value) for value in rounded(np.array([-0.0, 0.0])).tolist()] == ["0.0", "0.0"]


def test_length_beyond_the_range_of_the_unit_is_infinite():
    assert in_unit(1e308, 0.001) == np.inf


@given(st.floats(allow_nan=False, allow_infinity=False, max_value=1e308, min_value=-1e308))
def test_rounded_number_is_near_and_short(value):
    (result,) = rounded(np.array([value])).tolist()

    assert float(f"{result:.15g}") == result
    assert result == pytest.approx(value, rel=5.1e-15, abs=1e-323)
