"""Closest points of eight triangles to one point each.

It is `closest_feature.closest_on_triangle` in every lane. The formulas and their order are the same, so that
a point gets the same answer alone or in a batch.
"""

import numpy as np

from proximity.kernels.geometry.triangle import TINY, cross, dot, height_over
from proximity.kernels.layout import ALL_LANES, FEATURE_EDGE, FEATURE_FACE, FEATURE_VERTEX, LANES
from proximity.native import inlined, kernel
from proximity.native.simd import absolute, bits, load, load_each, select, splat, square_root, store

LANES_LENGTH, LANES_POINT, LANES_NORMAL, LANES_WEIGHTS, LANES_ARM = 0, 1, 4, 7, 10
LANES_FEATURE, LANES_WHICH, LANES_HEIGHT, LANES_COLUMNS = 13, 14, 15, 16
"""Columns of a table: the numbers of `closest_feature.CLOSEST`, first those of an answer in the order of
`answers`, then the feature and its number.

The last column, the height over the plane of the face, is filled only by `sides_of_lanes`.
"""


@inlined
def _lesser(a, b):
    """Return the lesser of two numbers, with the same result as min."""
    return select(b < a, b, a)


@inlined
def _share(value):
    """Clamp values to [0, 1], with the same result as min and max of numbers."""
    zero = splat(0.0)
    return _lesser(select(zero > value, zero, value), splat(1.0))


@inlined
def _one_of(is_second, is_third, first, second, third):
    return select(is_third, third, select(is_second, second, first))


@inlined
def _points_of(is_second, is_third, first, second, third):
    """Select one of three points in each lane."""
    return (
        _one_of(is_second, is_third, first[0], second[0], third[0]),
        _one_of(is_second, is_third, first[1], second[1], third[1]),
        _one_of(is_second, is_third, first[2], second[2], third[2]),
    )


@inlined
def _between(start, end):
    return end[0] - start[0], end[1] - start[1], end[2] - start[2]


@inlined
def _length_sq(vector):
    return dot(*vector, *vector)


@inlined
def _back_onto(third, tip, along, longest_sq, height_sq):
    """Move a foot back onto a shorter side, if rounding has put it outside a needle."""
    is_outside = third * tip > along
    if not bits(is_outside):
        return third
    back = (along * tip * longest_sq + third * height_sq) / (tip * tip * longest_sq + height_sq)
    return select(is_outside, back, third)


@inlined
def _weights_on_face(a, b, c, normal, foot_point):
    """Compute barycentric weights in the same way as `closest_feature.closest_on_face`."""
    length_a, length_b, length_c = (
        _length_sq(_between(a, b)), _length_sq(_between(b, c)), _length_sq(_between(c, a))
    )  # fmt: skip
    is_second = length_b > length_a
    longest_sq = select(is_second, length_b, length_a)
    is_third = length_c > longest_sq
    longest_sq = select(is_third, length_c, longest_sq)
    start = _points_of(is_second, is_third, a, b, c)
    edge = _between(start, _points_of(is_second, is_third, b, c, a))
    side = _between(start, _points_of(is_second, is_third, c, a, b))
    foot_arm = _between(start, foot_point)
    foot, full = dot(*normal, *cross(*edge, *foot_arm)), dot(*normal, *cross(*edge, *side))
    third = select(full > splat(0.0), _share(foot / full), splat(0.0))
    along = _share(dot(*foot_arm, *edge) / longest_sq)
    tip = dot(*side, *edge) / longest_sq
    height_sq = full * full / longest_sq
    one, zero = splat(1.0), splat(0.0)
    third = _back_onto(third, tip, along, longest_sq, height_sq)
    third = _back_onto(third, one - tip, one - along, longest_sq, height_sq)
    second = along - third * tip
    second = _lesser(select(zero > second, zero, second), one - third)
    first = (one - third) - second
    return (
        _one_of(is_second, is_third, first, third, second),
        _one_of(is_second, is_third, second, first, third),
        _one_of(is_second, is_third, third, second, first),
    )


@inlined
def _on_edge(p, start, end):
    """Return the point on an edge that is nearest to *p*.

    It is given by its parameter, the arm from it to *p*, its squared distance, and masks of the two ends of
    the edge.
    """
    edge, from_a, from_b = _between(start, end), _between(start, p), _between(end, p)
    length_sq = _length_sq(edge)
    ahead, behind = dot(*from_a, *edge), -dot(*from_b, *edge)
    zero, one = splat(0.0), splat(1.0)
    is_start = (ahead <= zero) | (length_sq <= splat(TINY))
    is_end = (behind <= zero) & ~is_start
    is_near = ahead <= behind
    t, u = _lesser(ahead / length_sq, one), _lesser(behind / length_sq, one)
    dx = _arm_of(is_start, is_end, is_near, t, u, from_a[0], from_b[0], edge[0])
    dy = _arm_of(is_start, is_end, is_near, t, u, from_a[1], from_b[1], edge[1])
    dz = _arm_of(is_start, is_end, is_near, t, u, from_a[2], from_b[2], edge[2])
    t = select(is_start, zero, select(is_end, one, select(is_near, t, one - u)))
    return t, (dx, dy, dz), dot(dx, dy, dz, dx, dy, dz), is_start, is_end


@inlined
def _arm_of(is_start, is_end, is_near, t, u, from_a, from_b, edge):
    along = select(is_near, from_a - t * edge, from_b + u * edge)
    return select(is_start, from_a, select(is_end, from_b, along))


@inlined
def _feature_of(is_start, is_end, number, end_number):
    """Return the kind of feature of a point on an edge, and the number of this feature."""
    is_corner = is_start | is_end
    feature = select(is_corner, splat(float(FEATURE_VERTEX)), splat(float(FEATURE_EDGE)))
    return feature, select(is_end, splat(end_number), splat(number))


@inlined
def _closest_on_edges(p, a, b, c):
    """Return the nearest point on three edges, in the same way as `closest_feature.closest_on_edges`.

    It is given by squared distance, arm, weights, feature and number.
    """
    zero, one = splat(0.0), splat(1.0)
    t, arm, best_sq, is_start, is_end = _on_edge(p, a, b)
    feature, which = _feature_of(is_start, is_end, 0.0, 1.0)
    weights = one - t, t, zero
    t, other, other_sq, is_start, is_end = _on_edge(p, b, c)
    other_feature, other_which = _feature_of(is_start, is_end, 1.0, 2.0)
    is_nearer = other_sq < best_sq
    best_sq = select(is_nearer, other_sq, best_sq)
    arm = chosen(is_nearer, other, arm)
    weights = chosen(is_nearer, (zero, one - t, t), weights)
    feature, which = select(is_nearer, other_feature, feature), select(is_nearer, other_which, which)
    t, other, other_sq, is_start, is_end = _on_edge(p, c, a)
    other_feature, other_which = _feature_of(is_start, is_end, 2.0, 0.0)
    is_nearer = other_sq < best_sq
    best_sq = select(is_nearer, other_sq, best_sq)
    arm = chosen(is_nearer, other, arm)
    weights = chosen(is_nearer, (t, zero, one - t), weights)
    feature, which = select(is_nearer, other_feature, feature), select(is_nearer, other_which, which)
    return best_sq, arm, weights, feature, which


@inlined
def chosen(is_first, one, other):
    """Select one of two points in each lane."""
    return (
        select(is_first, one[0], other[0]),
        select(is_first, one[1], other[1]),
        select(is_first, one[2], other[2]),
    )


@inlined
def _weighted(a, b, c, weights):
    """Return the points with these weights, computed from the corner with the largest weight."""
    is_second = weights[1] > weights[0]
    is_third = weights[2] > select(is_second, weights[1], weights[0])
    base = _points_of(is_second, is_third, a, b, c)
    u = _between(base, _points_of(is_second, is_third, b, c, a))
    v = _between(base, _points_of(is_second, is_third, c, a, b))
    second = _one_of(is_second, is_third, weights[1], weights[2], weights[0])
    third = _one_of(is_second, is_third, weights[2], weights[0], weights[1])
    return (
        base[0] + (second * u[0] + third * v[0]),
        base[1] + (second * u[1] + third * v[1]),
        base[2] + (second * u[2] + third * v[2]),
    )


@inlined
def load_point(table, chunk, at, column):
    """Load eight points from three rows of a table, *column* and the two that follow."""
    base = column * chunk + at
    return load(table, base), load(table, base + chunk), load(table, base + 2 * chunk)


@inlined
def store_point(table, chunk, at, column, point):
    """Store eight points in the order of `load_point`."""
    store(table, column * chunk + at, point[0])
    store(table, (column + 1) * chunk + at, point[1])
    store(table, (column + 2) * chunk + at, point[2])


@inlined
def _triangles(reals, offsets, at):
    """Load the corners of eight triangles."""
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
    """Return the closest features of eight triangles to eight points.

    They are given by the mask of the points over their faces, heights, normals, distances, arms, features,
    their numbers and weights. The weights are valid only on edges.
    """
    a, b, c = triangle
    is_over, height, nx, ny, nz = height_over(*p, *a, *b, *c)
    length, arm = absolute(height), (nx * height, ny * height, nz * height)
    feature, which = splat(float(FEATURE_FACE)), splat(0.0)
    weights = which, which, which
    if bits(is_over) != ALL_LANES:
        best_sq, edge_arm, weights, edge_feature, which = _closest_on_edges(p, a, b, c)
        length = select(is_over, length, square_root(best_sq))
        arm, feature = chosen(is_over, arm, edge_arm), select(is_over, feature, edge_feature)
    return is_over, height, (nx, ny, nz), length, arm, feature, which, weights


@inlined
def _store_feature(table, chunk, at, length, arm, normal, feature, which):
    store(table, LANES_LENGTH * chunk + at, length)
    store_point(table, chunk, at, LANES_ARM, arm)
    store_point(table, chunk, at, LANES_NORMAL, normal)
    store(table, LANES_FEATURE * chunk + at, feature)
    store(table, LANES_WHICH * chunk + at, which)


@inlined
def closest_of_lanes(reals, offsets, at, local_points, table):
    """Write the closest points of eight triangles to one point each, in local frames.

    *offsets*: (N,), the first number of each triangle. *local_points*: (3 N,), the points, coordinate by
    coordinate. Columns *at* to *at* + 7 of both are read. The same columns of *table*, which has
    `LANES_COLUMNS` rows of N, receive the fields of `closest_feature` and the normal of the face.
    """
    chunk = len(offsets)
    p = load_point(local_points, chunk, at, 0)
    a, b, c = _triangles(reals, offsets, at)
    is_over, height, normal, length, arm, feature, which, edge_weights = _features(p, (a, b, c))
    foot = p[0] - normal[0] * height, p[1] - normal[1] * height, p[2] - normal[2] * height
    weights = chosen(is_over, _weights_on_face(a, b, c, normal, foot), edge_weights)
    _store_feature(table, chunk, at, length, arm, normal, feature, which)
    store_point(table, chunk, at, LANES_WEIGHTS, weights)
    store_point(table, chunk, at, LANES_POINT, _weighted(a, b, c, weights))


@inlined
def read_row(table, chunk, k, closest):
    """Copy what decides the side in a column of a table to *closest*. Return the feature and its number."""
    closest.length = table[LANES_LENGTH * chunk + k]
    for axis in range(3):
        closest.arm[axis] = table[(LANES_ARM + axis) * chunk + k]
        closest.normal[axis] = table[(LANES_NORMAL + axis) * chunk + k]
    return np.int64(table[LANES_FEATURE * chunk + k]), np.int64(table[LANES_WHICH * chunk + k])


@kernel
def sides_of_lanes(reals, offsets, at, local_points, table):
    """Write only the columns of *table* that decide the side, and the heights.

    The arguments are those of `closest_of_lanes`. Weights and points are not written.
    """
    chunk = len(offsets)
    p = load_point(local_points, chunk, at, 0)
    _, height, normal, length, arm, feature, which, _ = _features(p, _triangles(reals, offsets, at))
    _store_feature(table, chunk, at, length, arm, normal, feature, which)
    store(table, LANES_HEIGHT * chunk + at, height)
