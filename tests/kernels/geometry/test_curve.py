"""Morton order of points: every row once, and cells along the curve in sequence."""

import numpy as np
import pytest

from proximity.kernels.geometry.morton_order import CELL_BITS, morton_order


def place_on_curve(points):
    """Morton code of each point's cell, by Python integers."""
    lower = points.min(axis=0)
    extent = float((points.max(axis=0) - lower).max())
    cells = ((points - lower) * ((2**CELL_BITS - 1) / extent)).astype(int)
    return [
        sum((int(cell[axis]) >> bit & 1) << (3 * bit + axis) for axis in range(3) for bit in range(CELL_BITS))
        for cell in cells
    ]


@pytest.mark.parametrize("count", [1, 7, 8, 9, 48, 1000])
@pytest.mark.parametrize("spread", [(1.0, 1.0, 1.0), (1e-6, 2.0, 0.0), (1e200, 1e190, 1.0)])
def test_cells_follow_one_another_along_the_curve(count, spread):
    points = np.random.default_rng(count).uniform(-1.0, 1.0, (count, 3)) * spread + 0.5

    order = morton_order(points)

    assert sorted(order) == list(range(count))
    if count > 1:
        places = np.array(place_on_curve(points))[order]
        assert (np.diff(places) >= 0).all()
        # Rows of one cell keep their order.
        assert (np.diff(order)[np.diff(places) == 0] > 0).all()


def test_rows_that_are_not_finite_change_nothing_for_the_others():
    rng = np.random.default_rng(1)
    points = rng.uniform(-1.0, 1.0, (500, 3))
    odd = points.copy()
    bad = rng.permutation(500)[:60]
    odd[bad[:20], 0], odd[bad[20:40], 1], odd[bad[40:]] = np.nan, np.inf, -np.inf
    good = np.setdiff1d(np.arange(500), bad)

    order = morton_order(odd)

    assert sorted(order) == list(range(500))
    np.testing.assert_array_equal(order[np.isin(order, good)], good[morton_order(points[good])])


@pytest.mark.parametrize("value", [0.0, 3.5, np.nan, np.inf, -1e301])
def test_points_that_are_all_alike_stay_as_they_are(value):
    np.testing.assert_array_equal(morton_order(np.full((50, 3), value)), np.arange(50))


def test_no_points_have_no_order():
    assert len(morton_order(np.empty((0, 3)))) == 0
