"""One triangle and one point: the traversal's formula, scalar and for eight, and the closest feature."""

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

import oracle
from proximity.kernels.geometry.closest_feature import CLOSEST, closest_on_triangle
from proximity.kernels.geometry.triangle import (
    difference_of_products,
    point_block_distance_sq,
    point_triangle_distance_sq,
)
from proximity.kernels.layout import BLOCK_STRIDE, FEATURE_EDGE, FEATURE_FACE, FEATURE_VERTEX, LANES
from proximity.native.simd import splat, store

pytestmark = pytest.mark.internals

ROUNDING = 2.0**-52
ALLOWED = 4.0
"""In units of the last place of the largest coordinate, at least of 1; the largest error seen is 2.9."""


@numba.njit(error_model="numpy")
def scalar_distances_sq(points, triangles, out):
    """Squared distances (N,), one at a time."""
    for i in range(len(points)):
        p, t = points[i], triangles[i]
        out[i] = point_triangle_distance_sq(
            (p[0], p[1], p[2]),
            (t[0, 0], t[0, 1], t[0, 2]),
            (t[1, 0], t[1, 1], t[1, 2]),
            (t[2, 0], t[2, 1], t[2, 2]),
        )


@numba.njit(error_model="numpy")
def block_distances_sq(points, blocks, out):
    """Squared distances (N, 8): each point with the eight triangles of its block."""
    for i in range(len(points)):
        p = splat(points[i, 0]), splat(points[i, 1]), splat(points[i, 2])
        store(out, LANES * i, point_block_distance_sq(blocks, BLOCK_STRIDE * i, p))


@numba.njit(error_model="numpy")
def witnesses(points, triangles, out, features):
    """The closest feature of each point on its triangle."""
    for i in range(len(points)):
        corners = out[i].corners
        for k in range(3):
            corners[k, 0], corners[k, 1], corners[k, 2] = triangles[i, k]
        features[i] = closest_on_triangle(points[i, 0], points[i, 1], points[i, 2], out[i])


@numba.njit
def products(a, b, c, d):
    return difference_of_products(a, b, c, d)


def in_blocks(triangles):
    """Each triangle in lane 0 of a block, followed by the next triangles in the other lanes."""
    rows = np.arange(len(triangles))[:, None] + np.arange(LANES)
    return triangles.reshape(-1, 9)[rows % len(triangles)].transpose(0, 2, 1).ravel()


def closest_of(points, triangles):
    points, triangles = (
        np.atleast_2d(np.asarray(points, float)),
        np.asarray(triangles, float).reshape(-1, 3, 3),
    )
    out = np.zeros(len(points), CLOSEST)
    features = np.empty((len(points), 2), np.int64)
    witnesses(points, triangles, out, features)
    return out, features


def distances_of(points, triangles):
    out = np.empty(len(points))
    scalar_distances_sq(np.asarray(points, float), np.asarray(triangles, float), out)
    return np.sqrt(out)


def exact_distances(points, triangles):
    return np.array(
        [oracle.root(oracle.closest_exact(t, [[0, 1, 2]], p)) for p, t in zip(points, triangles, strict=True)]
    )


def units(errors, points):
    """Errors in units of the last place of the largest coordinate."""
    return errors / (ROUNDING * np.maximum(1.0, np.abs(points).max(axis=1)))


def hard_triangles(rng, kind, count):
    """Triangles within [-1, 1]; needles are 1e-16 to 1 of their length wide."""
    triangles = np.empty((count, 3, 3))
    for i in range(count):
        a, along, across = rng.uniform(-1, 1, 3), rng.normal(size=3), rng.normal(size=3)
        along *= rng.uniform(0.1, 1.0) / np.linalg.norm(along)
        across -= across @ along / (along @ along) * along
        across *= 10.0 ** -rng.uniform(0, 16) / np.linalg.norm(across)
        triangles[i] = {
            "any": lambda a=a: rng.uniform(-1, 1, (3, 3)),
            "needle": lambda a=a, u=along, w=across: [a, a + u, a + w],
            "blade": lambda a=a, u=along, w=across: [a, a + u, a + u + w],
            "flat": lambda a=a, u=along, w=across: [a, a + u, a + rng.random() * u + w],
            "obtuse": lambda a=a, u=along, w=across: [a, a + u, a + rng.uniform(1, 2) * u + w],
            "collinear": lambda a=a, u=along: [a, a + u, a + rng.uniform(-1, 2) * u],
            "two equal corners": lambda a=a, u=along: [a, a + u, a],
            "point": lambda a=a: [a, a, a],
            "small": lambda a=a, u=along, w=across: [a, a + 1e-9 * u, a + w],
            "at the origin": lambda u=along, w=across: [w, 1e-8 * u, [0, 0, 0]],
        }[kind]()
        triangles[i] = triangles[i][rng.permutation(3)]
    return np.clip(triangles, -1.0, 1.0)


def hard_points(rng, triangles, farthest=10.0):
    """Points on, over, near and far from the triangles."""
    count = len(triangles)
    weights = rng.dirichlet((1, 1, 1), count)
    weights[::5] = np.eye(3)[rng.integers(0, 3, len(weights[::5]))]
    weights[1::5, 0] = 0.0
    points = (triangles * weights[:, :, None] / weights.sum(axis=1)[:, None, None]).sum(axis=1)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    over = np.divide(normals, lengths, out=np.ones_like(normals), where=lengths > 0.0)
    ways = np.where((np.arange(count) % 2 == 0)[:, None], over, rng.normal(size=(count, 3)))
    offsets = 10.0 ** rng.uniform(-20, np.log10(farthest), (count, 1))
    offsets[::11] = 0.0
    return points + offsets * ways


KINDS = [
    "any", "needle", "blade", "flat", "obtuse", "collinear", "two equal corners", "point", "small",
    "at the origin",
]  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("farthest", [10.0, 1e12], ids=["near", "far"])
def test_distances_are_right_to_rounding_on_every_shape(kind, farthest):
    rng = np.random.default_rng(7)
    triangles = hard_triangles(rng, kind, 600)
    points = hard_points(rng, triangles, farthest)
    exact = exact_distances(points, triangles)

    walk = distances_of(points, triangles)
    closest, _ = closest_of(points, triangles)

    assert units(abs(walk - exact), points).max() <= ALLOWED
    assert units(abs(closest["length"] - exact), points).max() <= ALLOWED


@pytest.mark.parametrize("kind", KINDS)
def test_witness_holds_together_on_every_shape(kind):
    rng = np.random.default_rng(8)
    triangles = hard_triangles(rng, kind, 3000)
    points = hard_points(rng, triangles)

    closest, features = closest_of(points, triangles)

    weights, point = (
        closest["weights"],
        closest["point"],
    )
    arm, length = closest["arm"], closest["length"]
    assert (weights >= 0.0).all() and (weights <= 1.0).all()
    assert abs(weights.sum(axis=1) - 1.0).max() <= ROUNDING
    combined = (weights[:, :, None] * triangles).sum(axis=1)
    assert units(abs(combined - point).max(axis=1), points).max() <= ALLOWED
    assert units(abs(np.linalg.norm(points - point, axis=1) - length), points).max() <= ALLOWED
    assert units(abs(points - point - arm).max(axis=1), points).max() <= ALLOWED
    assert abs(np.linalg.norm(arm, axis=1) - length).max() <= ALLOWED * ROUNDING * length.max()
    is_vertex = features[:, 0] == FEATURE_VERTEX
    np.testing.assert_array_equal(point[is_vertex], triangles[is_vertex, features[is_vertex, 1]])
    zero_count = (weights == 0.0).sum(axis=1)
    assert (zero_count[features[:, 0] == FEATURE_VERTEX] == 2).all()
    assert (zero_count[features[:, 0] == FEATURE_EDGE] >= 1).all()
    is_face = features[:, 0] == FEATURE_FACE
    normals = closest["normal"][is_face]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=4 * ROUNDING)


@pytest.mark.parametrize("kind", KINDS)
def test_eight_at_once_give_to_the_bit_what_one_gives(kind):
    rng = np.random.default_rng(9)
    triangles = hard_triangles(rng, kind, 200)
    points = hard_points(rng, triangles, 1e6)
    together = np.empty(LANES * len(points))
    block_distances_sq(points, in_blocks(triangles), together)

    for lane in range(LANES):
        alone = np.empty(len(points))
        scalar_distances_sq(points, np.roll(triangles, -lane, axis=0), alone)
        np.testing.assert_array_equal(together.reshape(-1, LANES)[:, lane], alone)


def test_unused_lane_is_nan_and_disturbs_no_neighbour():
    block = in_blocks(np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], float))
    block[3::LANES] = np.nan
    distances = np.empty(LANES)

    block_distances_sq(np.array([[0.25, 0.25, 2.0]]), block, distances)

    assert np.isnan(distances[3])
    assert (np.delete(distances, 3) == 4.0).all()


CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.25, 0.5, 0.0]])
#       2
#      . .
#    .     .        edge k runs from corner k to corner k + 1
#  0 ------- 1
REGIONS = {
    "face": ([0.375, 0.125, 0.5], FEATURE_FACE, 0, 0.5),
    "face from below": ([0.375, 0.125, -0.25], FEATURE_FACE, 0, 0.25),
    "on the face": ([0.375, 0.125, 0.0], FEATURE_FACE, 0, 0.0),
    "edge 0": ([0.5, -1.0, 0.0], FEATURE_EDGE, 0, 1.0),
    "edge 0 from above": ([0.5, -3.0, 4.0], FEATURE_EDGE, 0, 5.0),
    "on edge 0": ([0.5, 0.0, 0.0], FEATURE_EDGE, 0, 0.0),
    "over edge 0": ([0.5, 0.0, 1.0], FEATURE_EDGE, 0, 1.0),
    "edge 1": ([0.625 + 0.5, 0.25 + 0.75, 0.0], FEATURE_EDGE, 1, 0.8125**0.5),
    "edge 2": ([0.125 - 0.5, 0.25 + 0.25, 0.0], FEATURE_EDGE, 2, 0.3125**0.5),
    "corner 0": ([-3.0, -4.0, 0.0], FEATURE_VERTEX, 0, 5.0),
    "corner 1": ([4.0, 0.0, 4.0], FEATURE_VERTEX, 1, 5.0),
    "corner 2": ([0.25, 2.5, 0.0], FEATURE_VERTEX, 2, 2.0),
    "on corner 0": ([0.0, 0.0, 0.0], FEATURE_VERTEX, 0, 0.0),
    "on corner 1": ([1.0, 0.0, 0.0], FEATURE_VERTEX, 1, 0.0),
    "over corner 2": ([0.25, 0.5, 1.0], FEATURE_VERTEX, 2, 1.0),
    "border of corner 0 and edge 0": ([0.0, -2.0, 0.0], FEATURE_VERTEX, 0, 2.0),
}


@pytest.mark.parametrize("name", REGIONS)
@pytest.mark.parametrize("turns", [0, 1, 2])
def test_feature_is_the_one_the_point_was_made_over(name, turns):
    point, feature, which, distance = REGIONS[name]
    corners = np.roll(CORNERS, -turns, axis=0)
    expected = 0 if feature == FEATURE_FACE else (which - turns) % 3

    closest, features = closest_of(point, corners)

    assert features[0].tolist() == [feature, expected]
    assert closest["length"][0] == pytest.approx(distance, rel=4 * ROUNDING)


def test_height_over_a_face_has_the_side_of_the_normal():
    above, _ = closest_of([0.375, 0.125, 0.5], CORNERS)
    below, _ = closest_of([0.375, 0.125, -0.5], CORNERS)

    np.testing.assert_array_equal(above["normal"][0], [0, 0, 1])
    np.testing.assert_array_equal(above["arm"][0], [0, 0, 0.5])
    np.testing.assert_array_equal(below["arm"][0], [0, 0, -0.5])


def test_point_beyond_an_obtuse_corner_belongs_to_the_long_side():
    #   2
    #      .  .
    #          0 ------ 1     the foot is to the left of edge 0, not over a corner
    corners = [[0, 0, 0], [1, 0, 0], [-4, 1, 0]]
    closest, features = closest_of([-1.5, 0.625, 0.0], corners)

    assert features[0].tolist() == [FEATURE_EDGE, 1]
    assert closest["length"][0] == pytest.approx(distances_of([[-1.5, 0.625, 0.0]], [corners])[0], rel=1e-14)


def test_closest_point_of_a_needle_thinner_than_rounding_stays_at_its_place():
    # Regression: clamped weights moved the point along the needle by up to its length.
    rng = np.random.default_rng(2)
    along = np.array([0.3, 0.5, 0.7])
    triangles = np.array([[along * 0.1, along * 0.8, along * t] for t in rng.uniform(0.1, 0.8, 500)])
    points = rng.uniform(0.1, 0.8, (500, 1)) * along

    closest, _ = closest_of(points, triangles)

    assert np.linalg.norm(closest["point"] - points, axis=1).max() <= 4 * ROUNDING


@pytest.mark.parametrize("first", [0, 1, 2])
@pytest.mark.parametrize("order", [1, -1])
def test_point_beyond_the_short_side_of_a_needle_is_not_over_its_face(first, order):
    # Regression: one side was derived from the other two; with the tip at corner a the distance was off by
    # up to 1 % of the part's size.
    #   a ----------------------- b
    #     ---------------------- c    . p
    rng = np.random.default_rng(5)
    along, across = rng.normal(size=(2, 2000, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across -= (across * along).sum(axis=1, keepdims=True) * along
    across *= 10.0 ** rng.uniform(-16, -3, (2000, 1)) / np.linalg.norm(across, axis=1, keepdims=True)
    tip, length = rng.uniform(-0.5, 0.5, (2000, 3)), 0.4
    triangles = np.stack([tip, tip + length * along, tip + length * along + across], axis=1)
    triangles = np.roll(triangles, first, axis=1)[:, ::order]
    beyond = rng.choice([-1.0, 1.0], (2000, 1)) * 10.0 ** rng.uniform(-16, -2, (2000, 1))
    points = tip + (length + beyond) * along + rng.uniform(-1, 2, (2000, 1)) * across
    exact = exact_distances(points, triangles)

    closest, _ = closest_of(points, triangles)

    assert units(abs(distances_of(points, triangles) - exact), points).max() <= ALLOWED
    assert units(abs(closest["length"] - exact), points).max() <= ALLOWED


SHORT_EDGES = """
    -0x1.4b2778bdaa959p-33 -0x1.3cc88a450bdb3p-27 0x1.bd6114415a902p-28
    -0x1.4b2778bdaa938p-33 -0x1.3cc88a450bdb2p-27 0x1.bd6114415a900p-28
    -0x1.4b2778bdaa922p-33 -0x1.3cc88a450bdb3p-27 0x1.bd6114415a903p-28
    0x1.e7a7ebbf49a12p-20 -0x1.110af8cd60368p-18 -0x1.a23e82bda0b12p-19
    -0x1.2e5e43384af16p-11 0x1.570b5ef0dd218p-13 0x1.b1ce224d309edp-11
    -0x1.2e5e43384b0ecp-11 0x1.570b5ef0dce40p-13 0x1.b1ce224d30f29p-11
    -0x1.2e5e43384ae4ap-11 0x1.570b5ef0dd839p-13 0x1.b1ce224d30d83p-11
    -0x1.0d61aaf7faab9p+2 0x1.f94991873a23dp+1 -0x1.80515be5bb573p-1
"""


def test_edges_shorter_than_rounding_have_weights_within_a_triangle():
    # Regression: a parameter of 50 on an edge of 1e-16 gave a weight of -49.
    cases = np.array([float.fromhex(number) for number in SHORT_EDGES.split()]).reshape(2, 4, 3)
    triangles, points = cases[:, :3], cases[:, 3]

    closest, _ = closest_of(points, triangles)

    assert (closest["weights"] >= 0.0).all()


small_integers = npst.arrays(np.float64, (4, 3), elements=st.integers(-4, 4).map(lambda n: n / 4.0))


@given(small_integers)
def test_points_and_corners_on_a_small_lattice_have_exact_distances(numbers):
    point, triangle = numbers[:1], numbers[None, 1:]
    exact = exact_distances(point, triangle)[0]

    closest, _ = closest_of(point, triangle)

    assert distances_of(point, triangle)[0] == pytest.approx(exact, rel=8 * ROUNDING)
    assert closest["length"][0] == pytest.approx(exact, rel=8 * ROUNDING)
    assert np.linalg.norm(point[0] - closest["point"][0]) == pytest.approx(exact, abs=4 * ROUNDING)


coordinates = st.floats(-1.0, 1.0, allow_subnormal=False)


@given(npst.arrays(np.float64, (4, 3), elements=coordinates), st.permutations([0, 1, 2]))
def test_any_triangle_has_the_exact_distance_in_any_order_of_corners(numbers, order):
    point, triangle = numbers[:1], numbers[None, 1:][:, list(order)]
    exact = exact_distances(point, triangle)

    assert units(abs(distances_of(point, triangle) - exact), point)[0] <= ALLOWED
    assert units(abs(closest_of(point, triangle)[0]["length"] - exact), point)[0] <= ALLOWED


@pytest.mark.parametrize("power", [-60, -20, 20, 60])
def test_scaling_by_a_power_of_two_scales_to_the_bit(power):
    rng = np.random.default_rng(7)
    triangles = rng.uniform(-1, 1, (200, 3, 3))
    points = rng.uniform(-2, 2, (200, 3))
    scale = 2.0**power
    # Sizes at which no square falls below TINY.
    expected, scaled = np.empty(200), np.empty(200)
    scalar_distances_sq(points, triangles, expected)
    scalar_distances_sq(points * scale, triangles * scale, scaled)

    if power > -40:
        np.testing.assert_array_equal(scaled, expected * scale**2)
    else:  # every square is below TINY: the corners replace the face, which is 1e-18 small
        assert abs(np.sqrt(scaled) - np.sqrt(expected) * scale).max() <= 4.0 * scale


@given(st.floats(-1e100, 1e100), st.floats(-1e100, 1e100), st.floats(-1e100, 1e100), st.floats(-1e100, 1e100))
def test_difference_of_products_has_the_right_sign(a, b, c, d):
    from fractions import Fraction

    if any(abs(product) < 1e-250 for product in (a * b, c * d)):
        return
    exact = Fraction(a) * Fraction(b) - Fraction(c) * Fraction(d)

    assert products(a, b, c, d) == pytest.approx(float(exact), rel=2 * ROUNDING, abs=0.0)


def test_not_a_number_is_no_nearer_than_anything():
    closest = np.zeros(1, CLOSEST)[0]
    closest["corners"] = CORNERS
    distances = np.empty(1)
    scalar_distances_sq(np.array([[np.nan, 0.0, 0.0]]), CORNERS[None], distances)

    assert not distances[0] <= 1.0
