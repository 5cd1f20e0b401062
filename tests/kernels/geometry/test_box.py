"""Lower bounds of boxes, correct at any distance despite rounding."""

from fractions import Fraction

import numba
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from nodes import node_of

from proximity.kernels.geometry.box import (
    BOX_MARGIN,
    FAR,
    bound_of,
    far_offset_sq,
    lanes_of_point,
    node_bounds_sq,
    round_down,
    round_up,
)
from proximity.kernels.layout import LANES
from proximity.native.simd import bits, lane, splat32

pytestmark = pytest.mark.internals

compiled = numba.njit(error_model="numpy")


@compiled
def open_lanes(node, points, best_sq, bounds, opened):
    """Bounds of the node's boxes for each point, and the lanes that a traversal with that best opens."""
    for i in range(len(points)):
        px, py, pz = points[i]
        point_lanes = lanes_of_point(px, py, pz)
        found = node_bounds_sq(node, 0, point_lanes)
        opened[i] = bits(found <= splat32(bound_of(best_sq[i], point_lanes[2])))
        for k in range(LANES):
            bounds[i, k] = lane(found, k)


@compiled
def offset_of(x, y, z):
    return far_offset_sq(x, y, z)


@compiled
def rounded(value):
    return round_down(value), round_up(value)


def opened_at(node, points, best_sq):
    bounds, opened = np.empty((len(points), LANES), np.float32), np.empty(len(points), np.int64)
    with np.errstate(over="ignore"):
        open_lanes(node, points, best_sq, bounds, opened)
    return (opened[:, None] >> np.arange(LANES)) & 1 == 1, bounds


def rounded_distance_sq(point, contents):
    """Squared distance from a point to the nearest of points, as low as a traversal may compute it."""
    exact = min(
        sum((Fraction(x) - Fraction(y)) ** 2 for x, y in zip(point.tolist(), q.tolist(), strict=True))
        for q in contents
    )
    try:
        return float(exact) * (1.0 - 2.0**-51)
    except OverflowError:
        return np.inf


def points_around(rng, contents, count, reach):
    """Points at all distances up to *reach* from the contents, many along one axis only."""
    base = contents.reshape(-1, 3)[rng.integers(0, contents[..., 0].size, count)]
    ways = rng.normal(size=(count, 3))
    ways[::3] = np.eye(3)[rng.integers(0, 3, len(ways[::3]))]
    return base + ways * 10.0 ** rng.uniform(-18, np.log10(reach), (count, 1)) * rng.choice(
        [-1, 1], (count, 1)
    )


@pytest.mark.parametrize("reach", [1e-6, 1.0, 3.0, 1e3, 1e12, 1e30, 1e99])
@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-3, 1.0])
def test_box_that_holds_the_nearest_point_is_always_opened(reach, size):
    rng = np.random.default_rng(7)
    contents = np.clip(rng.uniform(-1, 1, (LANES, 1, 3)) + size * rng.uniform(-1, 1, (LANES, 4, 3)), -1, 1)
    points = points_around(rng, contents, 300, reach)
    node = node_of(contents)

    for box in range(LANES):
        best_sq = np.array([rounded_distance_sq(point, contents[box]) for point in points])
        opened, _ = opened_at(node, points, best_sq)
        assert opened[:, box].all()


@pytest.mark.parametrize(("nearest", "farthest"), [(1.0, 2.0), (2.0, 8.0)])
def test_boxes_in_the_corners_are_opened_from_the_opposite_ones(nearest, farthest):
    # Here rounding of the squares and of the point is largest relative to the margin.
    rng = np.random.default_rng(7)
    contents = np.array([[[i & 1, i >> 1 & 1, i >> 2]] for i in range(LANES)], float) * 2.0 - 1.0
    points = rng.uniform(nearest, farthest, (1500, 3)) * rng.choice([-1, 1], (1500, 3))
    points[::2, rng.integers(0, 3)] = 0.0
    node = node_of(contents)

    for box in range(LANES):
        best_sq = np.array([rounded_distance_sq(point, contents[box]) for point in points])
        opened, _ = opened_at(node, points, best_sq)
        assert opened[:, box].all()


coordinate = st.floats(-1.0, 1.0)
reached = st.one_of(st.floats(-2.5, 2.5), st.floats(-1e12, 1e12), st.floats(-1e99, 1e99))


@given(
    npst.arrays(np.float64, (2, 3), elements=coordinate), npst.arrays(np.float64, (1, 3), elements=reached)
)
@example(np.full((2, 3), 1.0), np.full((1, 3), 1.0 + 2.0**-25))
@example(np.full((2, 3), -1.0), np.array([[-2.0, -1.0 - 2.0**-24, 0.0]]))
@example(np.zeros((2, 3)), np.array([[2.0 + 2.0**-51, 0.0, 0.0]]))
@example(np.zeros((2, 3)), np.array([[1e-30, 0.0, 0.0]]))
def test_no_rounding_closes_the_box_of_the_nearest_point(content, point):
    opened, _ = opened_at(node_of(content[None]), point, np.array([rounded_distance_sq(point[0], content)]))

    assert opened[0, 0]


@pytest.mark.parametrize("power", range(-40, 41, 4))
def test_point_on_its_own_box_is_opened_with_best_zero(power):
    rng = np.random.default_rng(power + 100)
    contents = np.clip(rng.normal(size=(LANES, 1, 3)) * 2.0**power, -1, 1)

    opened, _ = opened_at(node_of(contents), contents[:, 0], np.zeros(LANES))

    assert np.diagonal(opened).all()


@pytest.mark.parametrize("best", [0.0, 1.0, 1e38, 1e300, np.inf])
@pytest.mark.parametrize("distance", [0.0, 1.9, 2.1, 1e12, 1e25, 1e27, 1e99])
def test_unused_lane_is_never_opened(best, distance):
    node = node_of(np.zeros((3, 1, 3)))

    opened, _ = opened_at(node, np.array([[distance, 0.0, 0.0]]), np.array([best]))

    assert not opened[0, 3:].any()


@pytest.mark.parametrize("distance", [0.5, 3.0, 1e12, 1e26, 1e30, 1e99])
def test_everything_is_opened_as_long_as_nothing_is_found(distance):
    # Regression: from 1e26 part sizes on all bounds were infinite, and the traversal read out of bounds.
    node = node_of(np.random.default_rng(7).uniform(-1, 1, (LANES, 2, 3)))

    opened, _ = opened_at(node, np.array([[distance, -distance, 0.1]]), np.array([np.inf]))

    assert opened.all()


@pytest.mark.parametrize("distance", [1.0, 1.99, 2.01, 10.0, 1e3, 1e6])
def test_far_point_still_tells_near_boxes_from_far_ones(distance):
    # Otherwise a point a kilometre from a screw would test every face.
    contents = np.zeros((2, 1, 3))
    contents[0, 0, 0], contents[1, 0, 0] = 0.9, -0.9
    point = np.array([[distance, 0.0, 0.0]])

    opened, _ = opened_at(node_of(contents), point, np.array([(distance - 0.9) ** 2]))

    assert opened[0, :2].tolist() == [True, False]


def test_bounds_are_tight_but_for_the_margin():
    rng = np.random.default_rng(7)
    contents = rng.uniform(-1, 1, (LANES, 2, 3))
    points = rng.uniform(-2, 2, (200, 3))
    _, bounds = opened_at(node_of(contents), points, np.full(200, np.inf))
    low, high = contents.min(axis=1), contents.max(axis=1)
    gaps = np.maximum(np.maximum(low - points[:, None], points[:, None] - high), 0.0)
    exact = (gaps**2).sum(axis=-1)

    assert (abs(np.sqrt(bounds) - np.sqrt(exact)) <= 8.0 * BOX_MARGIN).all()


@given(st.floats(-1e99, 1e99), st.floats(-1e99, 1e99), st.floats(-1e99, 1e99))
def test_far_offset_is_below_the_distance_of_the_whole_cube(x, y, z):
    offset = offset_of(x, y, z)
    gaps = [max(abs(Fraction(value)) - 1, Fraction(0)) for value in (x, y, z)]

    if max(abs(x), abs(y), abs(z)) <= FAR:
        assert offset == 0.0
    else:
        exact = sum(gap * gap for gap in gaps)
        assert exact * Fraction(1.0 - 2.0**-44) <= Fraction(offset) <= exact


@given(st.floats(-1e6, 1e6))
@example(1.0)
@example(1.0 + 2.0**-52)
@example(1.0 - 2.0**-53)
@example(2.0**-149)
@example(2.0**-151)
@example(-1e-45)
@example(0.0)
def test_rounding_outward_encloses_and_is_tight(value):
    low, high = rounded(value)

    assert float(low) <= value <= float(high)
    assert float(high) - float(low) <= 5e-7 * abs(value) + 3e-38


def test_not_a_number_opens_nothing():
    opened, _ = opened_at(node_of(np.zeros((8, 1, 3))), np.array([[np.nan, 0.0, 0.0]]), np.array([np.nan]))

    assert not opened.any()
