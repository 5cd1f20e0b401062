"""Tables of the closest points of eight triangles to a point each, see `closest_feature`."""

from proximity.kernels.geometry.closest_feature import (
    CLOSEST_ARM,
    CLOSEST_LENGTH,
    CLOSEST_NORMAL,
    CLOSEST_POINT,
    CLOSEST_TRIANGLE,
    CLOSEST_WEIGHT,
    chosen,
    closest_on_triangle,
    height_over,
    nearest_on_edges,
    weighted,
    weights_on_face,
)
from proximity.kernels.layout import ALL_LANES, FEATURE_FACE, LANES
from proximity.native import inlined, kernel
from proximity.native.simd import absolute, bits, load, load_each, select, splat, square_root, store

LANES_FEATURE = CLOSEST_TRIANGLE
"""Columns behind those of `closest_feature` up to the triangle: the feature, and which edge or corner."""
LANES_WHICH = CLOSEST_TRIANGLE + 1
LANES_HEIGHT = CLOSEST_TRIANGLE + 2
"""Height over the plane of the face; of `sides_of_lanes` only."""
LANES_COLUMNS = CLOSEST_TRIANGLE + 3


@inlined
def _store_point(table, chunk, at, column, point):
    store(table, column * chunk + at, point[0])
    store(table, (column + 1) * chunk + at, point[1])
    store(table, (column + 2) * chunk + at, point[2])


@inlined
def _triangles(reals, offsets, at):
    """Corners of eight triangles."""
    return (
        _corners(reals, offsets, at, 0),
        _corners(reals, offsets, at, 3 * LANES),
        _corners(reals, offsets, at, 6 * LANES),
    )


@inlined
def _corners(reals, offsets, at, shift):
    return (
        load_each(reals, offsets, at, shift),
        load_each(reals, offsets, at, shift + LANES),
        load_each(reals, offsets, at, shift + 2 * LANES),
    )


@inlined
def _features(p, triangle):
    """Which lanes are over their faces, heights, normals; lengths, arms, features, and the edges' weights."""
    a, b, c = triangle
    is_over, height, nx, ny, nz = height_over(*p, *a, *b, *c)
    length, arm = absolute(height), (nx * height, ny * height, nz * height)
    feature, which = splat(float(FEATURE_FACE)), splat(0.0)
    weights = which, which, which
    if bits(is_over) != ALL_LANES:
        best_sq, edge_arm, weights, edge_feature, which = nearest_on_edges(p, a, b, c)
        length = select(is_over, length, square_root(best_sq))
        arm, feature = chosen(is_over, arm, edge_arm), select(is_over, feature, edge_feature)
    return is_over, height, (nx, ny, nz), length, arm, feature, which, weights


@inlined
def _store_feature(table, chunk, at, length, arm, normal, feature, which):
    store(table, CLOSEST_LENGTH * chunk + at, length)
    _store_point(table, chunk, at, CLOSEST_ARM, arm)
    _store_point(table, chunk, at, CLOSEST_NORMAL, normal)
    store(table, LANES_FEATURE * chunk + at, feature)
    store(table, LANES_WHICH * chunk + at, which)


@kernel
def closest_of_lanes(reals, offsets, at, local_points, table):
    """Fill what is closest of eight triangles to a point each, local.

    *offsets* (N,): the first number of each triangle. *local_points* (3 N,): the points, coordinate by
    coordinate. Columns *at* to *at* + 7 of these belong together; and those of *table*, which has
    `LANES_COLUMNS` rows of N: those of `closest_feature`, the normal being that of the face.
    """
    chunk = len(offsets)
    p = load(local_points, at), load(local_points, chunk + at), load(local_points, 2 * chunk + at)
    a, b, c = _triangles(reals, offsets, at)
    is_over, height, normal, length, arm, feature, which, edge_weights = _features(p, (a, b, c))
    foot = p[0] - normal[0] * height, p[1] - normal[1] * height, p[2] - normal[2] * height
    weights = chosen(is_over, weights_on_face(a, b, c, normal, foot), edge_weights)
    _store_feature(table, chunk, at, length, arm, normal, feature, which)
    _store_point(table, chunk, at, CLOSEST_WEIGHT, weights)
    _store_point(table, chunk, at, CLOSEST_POINT, weighted(a, b, c, weights))


@kernel
def closest_of_row(reals, offsets, k, local_points, table, closest):
    """Fill one column of *table*, as `closest_of_lanes` fills eight. *closest*: scratch."""
    chunk = len(offsets)
    for number in range(9):
        closest[CLOSEST_TRIANGLE + number] = reals[offsets[k] + LANES * number]
    feature, which = closest_on_triangle(
        local_points[k], local_points[chunk + k], local_points[2 * chunk + k], closest
    )
    for column in range(CLOSEST_TRIANGLE):
        table[column * chunk + k] = closest[column]
    table[LANES_FEATURE * chunk + k], table[LANES_WHICH * chunk + k] = feature, which


@kernel
def sides_of_lanes(reals, offsets, at, local_points, table):
    """As `closest_of_lanes`, fill what tells the side: heights, but neither weights nor points."""
    chunk = len(offsets)
    p = load(local_points, at), load(local_points, chunk + at), load(local_points, 2 * chunk + at)
    _, height, normal, length, arm, feature, which, _ = _features(p, _triangles(reals, offsets, at))
    _store_feature(table, chunk, at, length, arm, normal, feature, which)
    store(table, LANES_HEIGHT * chunk + at, height)
