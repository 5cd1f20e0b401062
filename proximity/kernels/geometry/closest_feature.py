"""The closest point of a triangle: position, feature, and side.

Formulas take numbers, for the one triangle that a walk has found, or vectors of eight (`closest_lanes`), so
that a point has one answer, whether it is asked alone or among many. Edge parameters are measured from the
nearer end, the normal is compensated, and barycentric weights are solved along the longest edge, so that they
give the point back even on a needle.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.triangle import TINY, cross, dot, offset_of
from proximity.kernels.layout import FEATURE_EDGE, FEATURE_FACE, FEATURE_VERTEX
from proximity.native import inlined
from proximity.native.simd import fma, like, load_int, minimum, select, square_root

CLOSEST_SIZE = 24
CLOSEST_LENGTH = 0  # distance
CLOSEST_ARM = 1  # from the closest point to the query
CLOSEST_WEIGHT = 4  # barycentric weights of the corners
CLOSEST_POINT = 7  # the closest point
CLOSEST_NORMAL = 10  # pseudo-normal of the feature, unit
CLOSEST_TRIANGLE = 13  # the nine coordinates of the corners


@inlined
def read_corners(reals, slot, closest):
    """Copy the corners of the triangle at *slot* into *closest*."""
    base = offset_of(slot)
    for k in range(9):
        closest[CLOSEST_TRIANGLE + k] = reals[base + 8 * k]


@inlined
def height_over(px, py, pz, ax, ay, az, bx, by, bz, cx, cy, cz):
    """Whether the foot of *p* on the plane is strictly inside the triangle *abc*, height, and unit normal.

    The same formula as the walk's, so that both agree on what is inside. A
    triangle without area has normal and height 0.
    """
    abx, aby, abz = bx - ax, by - ay, bz - az
    acx, acy, acz = cx - ax, cy - ay, cz - az
    pax, pay, paz = px - ax, py - ay, pz - az
    nx, ny, nz = cross(abx, aby, abz, acx, acy, acz)
    normal_sq = dot(nx, ny, nz, nx, ny, nz)
    zero = like(0.0, normal_sq)
    has_area = normal_sq > like(TINY, normal_sq)
    nx, ny, nz = select(has_area, nx, zero), select(has_area, ny, zero), select(has_area, nz, zero)
    qx = fma(pay, nz, -(paz * ny))
    qy = fma(paz, nx, -(pax * nz))
    qz = fma(pax, ny, -(pay * nx))
    side_ab = dot(abx, aby, abz, qx, qy, qz)
    side_ac = -dot(acx, acy, acz, qx, qy, qz)
    pbx, pby, pbz = px - bx, py - by, pz - bz
    rx = fma(pby, nz, -(pbz * ny))
    ry = fma(pbz, nx, -(pbx * nz))
    rz = fma(pbx, ny, -(pby * nx))
    side_bc = dot(cx - bx, cy - by, cz - bz, rx, ry, rz)
    length = select(has_area, square_root(normal_sq), like(1.0, normal_sq))
    nx, ny, nz = nx / length, ny / length, nz / length
    is_over = minimum(minimum(side_ab, side_ac), side_bc) > zero
    return is_over, dot(nx, ny, nz, pax, pay, paz), nx, ny, nz


@inlined
def _lesser(a, b):
    """As min of two numbers."""
    return select(b < a, b, a)


@inlined
def _share(value):
    """Within 0 and 1, as min and max of numbers."""
    zero = like(0.0, value)
    return _lesser(select(zero > value, zero, value), like(1.0, value))


@inlined
def _one_of(is_second, is_third, first, second, third):
    return select(is_third, third, select(is_second, second, first))


@inlined
def _points_of(is_second, is_third, first, second, third):
    """One of three points."""
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
    """Rounding may put the foot beside a needle: back onto a shorter side."""
    back = (along * tip * longest_sq + third * height_sq) / (tip * tip * longest_sq + height_sq)
    return select(third * tip > along, back, third)


@inlined
def weights_on_face(a, b, c, normal, foot_point):
    """Barycentric weights of a foot in the face's inside, solved along the longest edge.

    The third corner's is from its height over that edge, the others from the position along it.
    """
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
    # Heights of the foot and of the third corner over the longest edge, both times its length.
    foot, full = dot(*normal, *cross(*edge, *foot_arm)), dot(*normal, *cross(*edge, *side))
    one, zero = like(1.0, full), like(0.0, full)
    third = select(full > zero, _share(foot / full), zero)
    along = _share(dot(*foot_arm, *edge) / longest_sq)
    tip = dot(*side, *edge) / longest_sq
    height_sq = full * full / longest_sq
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
    """Parameter along an edge, arm from its nearest point, squared distance; whether an end is that.

    The parameter is measured from the nearer end; an edge without length answers as its start.
    """
    edge, from_a, from_b = _between(start, end), _between(start, p), _between(end, p)
    length_sq = _length_sq(edge)
    ahead, behind = dot(*from_a, *edge), -dot(*from_b, *edge)
    zero, one = like(0.0, ahead), like(1.0, ahead)
    is_start = (ahead <= zero) | (length_sq <= like(TINY, ahead))
    is_end = behind <= zero  # unless it is the start
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
def _feature_of(t, is_start, is_end, number, end_number):
    """The kind of feature on an edge, and which one."""
    vertex, edge = like(float(FEATURE_VERTEX), t), like(float(FEATURE_EDGE), t)
    start, end = like(number, t), like(end_number, t)
    return select(is_start | is_end, vertex, edge), select(is_start, start, select(is_end, end, start))


@inlined
def nearest_on_edges(p, a, b, c):
    """Of the nearest point of the three edges: squared distance, arm, weights, feature and which one.

    The last is the number of the edge (from corner k to k + 1) or of the corner.
    """
    t, arm, best_sq, is_start, is_end = _on_edge(p, a, b)
    zero, one = like(0.0, t), like(1.0, t)
    feature, which = _feature_of(t, is_start, is_end, 0.0, 1.0)
    weights = one - t, t, zero
    t, other, other_sq, is_start, is_end = _on_edge(p, b, c)
    other_feature, other_which = _feature_of(t, is_start, is_end, 1.0, 2.0)
    is_nearer = other_sq < best_sq
    best_sq = select(is_nearer, other_sq, best_sq)
    arm = chosen(is_nearer, other, arm)
    weights = chosen(is_nearer, (zero, one - t, t), weights)
    feature, which = select(is_nearer, other_feature, feature), select(is_nearer, other_which, which)
    t, other, other_sq, is_start, is_end = _on_edge(p, c, a)
    other_feature, other_which = _feature_of(t, is_start, is_end, 2.0, 0.0)
    is_nearer = other_sq < best_sq
    best_sq = select(is_nearer, other_sq, best_sq)
    arm = chosen(is_nearer, other, arm)
    weights = chosen(is_nearer, (t, zero, one - t), weights)
    feature, which = select(is_nearer, other_feature, feature), select(is_nearer, other_which, which)
    return best_sq, arm, weights, feature, which


@inlined
def chosen(is_first, one, other):
    """One of two points."""
    return (
        select(is_first, one[0], other[0]),
        select(is_first, one[1], other[1]),
        select(is_first, one[2], other[2]),
    )


@inlined
def weighted(a, b, c, weights):
    """The point with these weights, from the corner that weighs most."""
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
def _corners(closest):
    """The corners of the triangle."""
    at = CLOSEST_TRIANGLE
    return (
        (closest[at], closest[at + 1], closest[at + 2]),
        (closest[at + 3], closest[at + 4], closest[at + 5]),
        (closest[at + 6], closest[at + 7], closest[at + 8]),
    )


@inlined
def _keep(closest, column, point):
    """Write three numbers."""
    closest[column], closest[column + 1], closest[column + 2] = point


@inlined
def over_face(closest, px, py, pz):
    """Whether the foot of *p* on the plane is strictly inside the triangle, and the height with its sign.

    Fills the unit normal; 0 where there is none.
    """
    a, b, c = _corners(closest)
    is_over, height, nx, ny, nz = height_over(px, py, pz, *a, *b, *c)
    _keep(closest, CLOSEST_NORMAL, (nx, ny, nz))
    return is_over, height


@inlined
def closest_on_edges(px, py, pz, closest):
    """Fill *closest* for the nearest point of the three edges; return the feature and which one."""
    a, b, c = _corners(closest)
    best_sq, arm, weights, feature, which = nearest_on_edges((px, py, pz), a, b, c)
    closest[CLOSEST_LENGTH] = sqrt(best_sq)
    _keep(closest, CLOSEST_ARM, arm)
    _keep(closest, CLOSEST_WEIGHT, weights)
    return np.int64(feature), np.int64(which)


@inlined
def closest_on_triangle(px, py, pz, closest):
    """Fill *closest* for the point of its triangle nearest to *p*; return the feature and which one.

    All in the local frame. Degenerate: zero area falls back to the edges.
    Source: as `triangle`; the weights are our own.
    """
    a, b, c = _corners(closest)
    is_over, height = over_face(closest, px, py, pz)
    feature, which = np.int64(FEATURE_FACE), np.int64(0)
    if is_over:
        x, y, z = closest[CLOSEST_NORMAL], closest[CLOSEST_NORMAL + 1], closest[CLOSEST_NORMAL + 2]
        arm = x * height, y * height, z * height
        foot = px - arm[0], py - arm[1], pz - arm[2]
        closest[CLOSEST_LENGTH] = abs(height)
        _keep(closest, CLOSEST_ARM, arm)
        _keep(closest, CLOSEST_WEIGHT, weights_on_face(a, b, c, (x, y, z), foot))
    else:
        feature, which = closest_on_edges(px, py, pz, closest)
    weights = closest[CLOSEST_WEIGHT], closest[CLOSEST_WEIGHT + 1], closest[CLOSEST_WEIGHT + 2]
    _keep(closest, CLOSEST_POINT, weighted(a, b, c, weights))
    return feature, which


@inlined
def _add_face_normal(reals, words, corners_at, face_at, closest):
    """Add the unit normal of the face whose corners are listed at *face_at* to the pseudo-normal."""
    a = corners_at + 3 * load_int(words, face_at)
    b = corners_at + 3 * load_int(words, face_at + 1)
    c = corners_at + 3 * load_int(words, face_at + 2)
    ux, uy, uz = reals[b] - reals[a], reals[b + 1] - reals[a + 1], reals[b + 2] - reals[a + 2]
    vx, vy, vz = reals[c] - reals[a], reals[c + 1] - reals[a + 1], reals[c + 2] - reals[a + 2]
    nx, ny, nz = cross(ux, uy, uz, vx, vy, vz)
    length = sqrt(dot(nx, ny, nz, nx, ny, nz))
    if length > 0.0:
        closest[CLOSEST_NORMAL] += nx / length
        closest[CLOSEST_NORMAL + 1] += ny / length
        closest[CLOSEST_NORMAL + 2] += nz / length


@inlined
def pseudo_normal(model, part, face, feature, which, closest):
    """Make the face's unit normal in *closest* the pseudo-normal of the feature: the one that tells the side.

    Source: Bærentzen & Aanæs 2005, "Signed distance computation using the angle weighted pseudonormal".
    """
    reals, words, _, parts = model
    if feature == FEATURE_VERTEX:
        corner = load_int(words, parts[part].faces + 3 * face + which)
        at = parts[part].corner_normals + 3 * corner
        closest[CLOSEST_NORMAL], closest[CLOSEST_NORMAL + 1], closest[CLOSEST_NORMAL + 2] = (
            reals[at],
            reals[at + 1],
            reals[at + 2],
        )
    elif feature == FEATURE_EDGE:
        neighbor = load_int(words, parts[part].neighbors + 3 * face + which)
        if neighbor >= 0:
            _add_face_normal(reals, words, parts[part].corners, parts[part].faces + 3 * neighbor, closest)
            nx, ny, nz = closest[CLOSEST_NORMAL], closest[CLOSEST_NORMAL + 1], closest[CLOSEST_NORMAL + 2]
            length = sqrt(dot(nx, ny, nz, nx, ny, nz))
            if length > 0.0:
                for axis in range(3):
                    closest[CLOSEST_NORMAL + axis] /= length
