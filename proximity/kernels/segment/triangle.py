"""Distance between a segment and triangles, and the witness points of the nearest one.

The squared distance to a triangle is the smallest of: both ends to the plane where their foot is inside, and
for each edge both ends to the edge, its corner to the segment, and the two lines where they pass each other.
All parameters are clamped, so every candidate is the distance between two points that exist; nearly parallel
lines may clamp anywhere, the ends and corners are exact there. Zero where the segment crosses.

Coordinates may come with their axes in any order, z being that in which the segment is longest.

Sources: Ericson, Real-Time Collision Detection, 5.1.9 (two segments); Kahan's difference of products for the
common perpendicular; Woop, Benthin, Wald 2013, "Watertight ray/triangle intersection" (sheared corners).
"""

from math import inf, sqrt

from proximity.kernels.geometry.closest_feature import (
    CLOSEST_LENGTH,
    CLOSEST_POINT,
    CLOSEST_TRIANGLE,
    CLOSEST_WEIGHT,
    closest_on_triangle,
)
from proximity.kernels.geometry.triangle import TINY, cross, difference_of_products, dot
from proximity.kernels.segment.plan import PLAN_END, PLAN_SLOPE_X, PLAN_SLOPE_Y, PLAN_START, ordered_axes
from proximity.native import inlined, kernel
from proximity.native.simd import absolute, fma, like, maximum, minimum, select

# Behind the columns of `witness`: the answer for a segment.
WITNESS_GAP = 24  # distance
WITNESS_FRACTION = 25  # along the planned segment
WITNESS_ON_SEGMENT = 26
WITNESS_ON_SOLID = 29
WITNESS_WEIGHT = 32  # barycentric weights
WITNESS_SIZE = 36


@inlined
def segment_triangle_crossing(a, b, c, slope_x, slope_y, span):
    """Whether the segment from the origin to (slope_x, slope_y, 1) · span crosses *abc*, and where.

    Returns the truth, numerator and denominator of the fraction along the segment, the weights of the three
    corners and their sum. Corners are sheared until the segment runs along z: then the signs of the weights
    are exact, and faces that share an edge or a corner leave no gap between them. Closed: edges and ends
    count. A face seen edge-on is not crossed, its neighbours are.
    """
    ax, ay, az = a
    bx, by, bz = b
    cx, cy, cz = c
    ax, ay = fma(-slope_x, az, ax), fma(-slope_y, az, ay)
    bx, by = fma(-slope_x, bz, bx), fma(-slope_y, bz, by)
    cx, cy = fma(-slope_x, cz, cx), fma(-slope_y, cz, cy)
    weight_a = difference_of_products(bx, cy, by, cx)
    weight_b = difference_of_products(cx, ay, cy, ax)
    weight_c = difference_of_products(ax, by, ay, bx)
    least = minimum(weight_a, minimum(weight_b, weight_c))
    most = maximum(weight_a, maximum(weight_b, weight_c))
    total = weight_a + weight_b + weight_c
    depth = fma(weight_a, az, fma(weight_b, bz, weight_c * cz))
    whole, zero = total * span, like(0.0, total)
    part = select(whole < zero, -depth, depth)
    whole = absolute(whole)
    is_hit = ((least >= zero) | (most <= zero)) & (whole > zero) & (part >= zero) & (part <= whole)
    return is_hit, part, whole, weight_a, weight_b, weight_c, total


@inlined
def _gap_sq(wx, wy, wz, t, dx, dy, dz):
    """Squared length of w + t d."""
    x, y, z = fma(t, dx, wx), fma(t, dy, wy), fma(t, dz, wz)
    return dot(x, y, z, x, y, z)


@inlined
def _clamp(t):
    return minimum(maximum(t, like(0.0, t)), like(1.0, t))


@inlined
def segment_edge_distance_sq(a, e, d, inverse_sq):
    """Squared distance from the segment, origin to *d*, to an edge, from *a* to a + e; without its end a + e.

    (x, y, z) each; *inverse_sq* is 1 / |d|². The end a + e is the next edge's start.
    """
    ax, ay, az = a
    ex, ey, ez = e
    dx, dy, dz = d
    tiny = like(TINY, ex)
    edge_sq = maximum(dot(ex, ey, ez, ex, ey, ez), tiny)
    inverse_edge_sq = like(1.0, ex) / edge_sq
    along_edge = -dot(ex, ey, ez, ax, ay, az)
    gain = dot(ex, ey, ez, dx, dy, dz)
    # Both ends of the segment, and the corner.
    u = _clamp(along_edge * inverse_edge_sq)
    best_sq = _gap_sq(ax, ay, az, u, ex, ey, ez)
    u = _clamp((along_edge + gain) * inverse_edge_sq)
    best_sq = minimum(best_sq, _gap_sq(ax - dx, ay - dy, az - dz, u, ex, ey, ez))
    t = _clamp(dot(dx, dy, dz, ax, ay, az) * inverse_sq)
    best_sq = minimum(best_sq, _gap_sq(ax, ay, az, -t, dx, dy, dz))
    # Where the two lines pass each other.
    nx, ny, nz = cross(dx, dy, dz, ex, ey, ez)
    mx = fma(ay, ez, -(az * ey))
    my = fma(az, ex, -(ax * ez))
    mz = fma(ax, ey, -(ay * ex))
    t = dot(mx, my, mz, nx, ny, nz) / maximum(dot(nx, ny, nz, nx, ny, nz), tiny * tiny)
    t = _clamp(t)
    u = _clamp(fma(t, gain, along_edge) * inverse_edge_sq)
    passing_sq = _gap_sq(fma(-t, dx, ax), fma(-t, dy, ay), fma(-t, dz, az), u, ex, ey, ez)
    return minimum(best_sq, passing_sq)


@inlined
def _foot_distance_sq(p, r, ab, ac, bc, normal, inverse_sq):
    """Whether the foot of a point is inside the triangle; squared distance to the plane.

    The point as seen from corner a is *p*, from corner b *r*: every side is taken at its own corner, as in
    `point_triangle_distance_sq`. *inverse_sq*: 1 / |normal|².
    """
    px, py, pz = p
    rx, ry, rz = r
    abx, aby, abz = ab
    acx, acy, acz = ac
    bcx, bcy, bcz = bc
    nx, ny, nz = normal
    qx = fma(py, nz, -(pz * ny))
    qy = fma(pz, nx, -(px * nz))
    qz = fma(px, ny, -(py * nx))
    side_ab = dot(abx, aby, abz, qx, qy, qz)
    side_ac = -dot(acx, acy, acz, qx, qy, qz)
    sx = fma(ry, nz, -(rz * ny))
    sy = fma(rz, nx, -(rx * nz))
    sz = fma(rx, ny, -(ry * nx))
    side_bc = dot(bcx, bcy, bcz, sx, sy, sz)
    height = dot(nx, ny, nz, px, py, pz)
    is_inside = minimum(side_ab, minimum(side_ac, side_bc)) >= like(0.0, height)
    return is_inside, height * height * inverse_sq


@inlined
def segment_triangle_distance_sq(a, b, c, d, slope_x, slope_y, inverse_sq):
    """Squared distance from the segment, origin to *d*, to triangle *abc*; scalars or vectors of eight.

    (x, y, z) each. *slope_x*, *slope_y*: dx / dz, dy / dz. *inverse_sq*: 1 / |d|².
    """
    ax, ay, az = a
    bx, by, bz = b
    cx, cy, cz = c
    dx, dy, dz = d
    ab = abx, aby, abz = bx - ax, by - ay, bz - az
    ac = acx, acy, acz = cx - ax, cy - ay, cz - az
    bc = cx - bx, cy - by, cz - bz
    best_sq = minimum(
        segment_edge_distance_sq(a, ab, d, inverse_sq),
        minimum(
            segment_edge_distance_sq(b, bc, d, inverse_sq),
            segment_edge_distance_sq(c, (-acx, -acy, -acz), d, inverse_sq),
        ),
    )
    normal = nx, ny, nz = cross(abx, aby, abz, acx, acy, acz)
    normal_sq, tiny = dot(nx, ny, nz, nx, ny, nz), like(TINY, nx)
    inverse_normal_sq = like(1.0, nx) / maximum(normal_sq, tiny)
    has_plane = normal_sq > tiny
    from_a, from_b = (-ax, -ay, -az), (-bx, -by, -bz)
    inside, plane_sq = _foot_distance_sq(from_a, from_b, ab, ac, bc, normal, inverse_normal_sq)
    best_sq = select(inside & has_plane, minimum(plane_sq, best_sq), best_sq)
    from_a, from_b = (dx - ax, dy - ay, dz - az), (dx - bx, dy - by, dz - bz)
    inside, plane_sq = _foot_distance_sq(from_a, from_b, ab, ac, bc, normal, inverse_normal_sq)
    best_sq = select(inside & has_plane, minimum(plane_sq, best_sq), best_sq)
    is_hit, _, _, _, _, _, _ = segment_triangle_crossing(a, b, c, slope_x, slope_y, dz)
    return select(is_hit, like(0.0, dz), best_sq)


@kernel
def _take_end(plan, at, fraction, witness):
    """Offer the point of the triangle nearest to an end of the segment."""
    closest_on_triangle(plan[at], plan[at + 1], plan[at + 2], witness)
    if witness[CLOSEST_LENGTH] < witness[WITNESS_GAP]:
        witness[WITNESS_GAP], witness[WITNESS_FRACTION] = witness[CLOSEST_LENGTH], fraction
        for k in range(3):
            witness[WITNESS_ON_SEGMENT + k] = plan[at + k]
            witness[WITNESS_ON_SOLID + k] = witness[CLOSEST_POINT + k]
            witness[WITNESS_WEIGHT + k] = witness[CLOSEST_WEIGHT + k]


@inlined
def _from_nearer_end(start, end, fraction):
    """A point between two, as the end it is nearer to and the step from there."""
    if fraction <= 0.5:
        return start, fraction * (end - start)
    return end, (fraction - 1.0) * (end - start)


@inlined
def _take_passing(plan, corner, t, u, witness):
    """Offer two points: at *t* along the segment, and at *u* along the edge that starts at *corner*."""
    a, b = CLOSEST_TRIANGLE + 3 * corner, CLOSEST_TRIANGLE + 3 * ((corner + 1) % 3)
    px, wx = _from_nearer_end(plan[PLAN_START], plan[PLAN_END], t)
    py, wy = _from_nearer_end(plan[PLAN_START + 1], plan[PLAN_END + 1], t)
    pz, wz = _from_nearer_end(plan[PLAN_START + 2], plan[PLAN_END + 2], t)
    qx, vx = _from_nearer_end(witness[a], witness[b], u)
    qy, vy = _from_nearer_end(witness[a + 1], witness[b + 1], u)
    qz, vz = _from_nearer_end(witness[a + 2], witness[b + 2], u)
    gap_x, gap_y, gap_z = (px - qx) + (wx - vx), (py - qy) + (wy - vy), (pz - qz) + (wz - vz)
    gap = sqrt(dot(gap_x, gap_y, gap_z, gap_x, gap_y, gap_z))
    if gap < witness[WITNESS_GAP] or (gap == witness[WITNESS_GAP] and t < witness[WITNESS_FRACTION]):
        other = (corner + 1) % 3
        witness[WITNESS_GAP], witness[WITNESS_FRACTION] = gap, t
        witness[WITNESS_ON_SEGMENT], witness[WITNESS_ON_SEGMENT + 1], witness[WITNESS_ON_SEGMENT + 2] = (
            px + wx,
            py + wy,
            pz + wz,
        )
        witness[WITNESS_ON_SOLID], witness[WITNESS_ON_SOLID + 1], witness[WITNESS_ON_SOLID + 2] = (
            qx + vx,
            qy + vy,
            qz + vz,
        )
        witness[WITNESS_WEIGHT + corner], witness[WITNESS_WEIGHT + other] = 1.0 - u, u
        witness[WITNESS_WEIGHT + 3 - corner - other] = 0.0


@inlined
def _take_edge(plan, corner, witness):
    """Offer what the edge from *corner* to the next has: its corner, and where the two lines pass."""
    a, b = CLOSEST_TRIANGLE + 3 * corner, CLOSEST_TRIANGLE + 3 * ((corner + 1) % 3)
    dx, dy, dz = (
        plan[PLAN_END] - plan[PLAN_START],
        plan[PLAN_END + 1] - plan[PLAN_START + 1],
        plan[PLAN_END + 2] - plan[PLAN_START + 2],
    )
    ex, ey, ez = witness[b] - witness[a], witness[b + 1] - witness[a + 1], witness[b + 2] - witness[a + 2]
    wx, wy, wz = (
        witness[a] - plan[PLAN_START],
        witness[a + 1] - plan[PLAN_START + 1],
        witness[a + 2] - plan[PLAN_START + 2],
    )
    vx, vy, vz = (
        witness[a] - plan[PLAN_END],
        witness[a + 1] - plan[PLAN_END + 1],
        witness[a + 2] - plan[PLAN_END + 2],
    )
    length_sq = max(dot(dx, dy, dz, dx, dy, dz), TINY)
    from_start, from_end = dot(wx, wy, wz, dx, dy, dz), -dot(vx, vy, vz, dx, dy, dz)
    t = from_start / length_sq if from_start <= from_end else 1.0 - from_end / length_sq
    _take_passing(plan, corner, min(max(t, 0.0), 1.0), 0.0, witness)
    # The lines pass each other along their common perpendicular.
    nx, ny, nz = cross(dx, dy, dz, ex, ey, ez)
    mx, my, mz = cross(wx, wy, wz, ex, ey, ez)
    t = dot(mx, my, mz, nx, ny, nz) / max(dot(nx, ny, nz, nx, ny, nz), TINY * TINY)
    t = min(max(t, 0.0), 1.0)
    gx, gy, gz = fma(t, dx, -wx), fma(t, dy, -wy), fma(t, dz, -wz)
    u = dot(gx, gy, gz, ex, ey, ez) / max(dot(ex, ey, ez, ex, ey, ez), TINY)
    _take_passing(plan, corner, t, min(max(u, 0.0), 1.0), witness)


@inlined
def _take_crossing(plan, witness):
    """Answer with the crossing, if there is one: to the sign what `segment_triangle_distance_sq` decides."""
    i, j, k = ordered_axes(plan)
    px, py, pz = plan[PLAN_START + i], plan[PLAN_START + j], plan[PLAN_START + k]
    a, b, c = CLOSEST_TRIANGLE, CLOSEST_TRIANGLE + 3, CLOSEST_TRIANGLE + 6
    is_hit, part, whole, weight_a, weight_b, weight_c, total = segment_triangle_crossing(
        (witness[a + i] - px, witness[a + j] - py, witness[a + k] - pz),
        (witness[b + i] - px, witness[b + j] - py, witness[b + k] - pz),
        (witness[c + i] - px, witness[c + j] - py, witness[c + k] - pz),
        plan[PLAN_SLOPE_X],
        plan[PLAN_SLOPE_Y],
        plan[PLAN_END + k] - pz,
    )
    if not is_hit:
        return False
    t = min(part / whole, 1.0)
    witness[WITNESS_GAP], witness[WITNESS_FRACTION] = 0.0, t
    witness[WITNESS_WEIGHT], witness[WITNESS_WEIGHT + 1], witness[WITNESS_WEIGHT + 2] = (
        weight_a / total,
        weight_b / total,
        weight_c / total,
    )
    for axis in range(3):
        near, step = _from_nearer_end(plan[PLAN_START + axis], plan[PLAN_END + axis], t)
        witness[WITNESS_ON_SEGMENT + axis], witness[WITNESS_ON_SOLID + axis] = near + step, near + step
    return True


@kernel
def segment_on_triangle(plan, witness):
    """Fill *witness* from `WITNESS_GAP` on: the nearest points of the planned segment and of its triangle.

    Among equals the first along the segment. Degenerate: see `closest_on_triangle`; a segment without length
    answers with its start.
    """
    witness[WITNESS_GAP] = inf
    if _take_crossing(plan, witness):
        return
    _take_end(plan, PLAN_START, 0.0, witness)
    for corner in range(3):
        _take_edge(plan, corner, witness)
    _take_end(plan, PLAN_END, 1.0, witness)
