"""Distance between a segment and triangles, and the witness points of the nearest triangle.

The squared distance to a triangle is the smallest of several candidates: from both ends to the plane, if
their foot is inside; and for each edge, from both ends to the edge, from its corner to the segment, and
between the two lines at their common perpendicular. All parameters are clamped, so every candidate is the
distance of two existing points. For nearly parallel lines the perpendicular is inaccurate, but ends and
corners are exact. The distance is zero if the segment crosses the triangle.

The axes of the coordinates may be permuted: z is the one along which the segment is longest.

Sources: Ericson, Real-Time Collision Detection, 5.1.9 (two segments); Kahan's difference of products for the
common perpendicular; Woop, Benthin, Wald 2013, "Watertight ray/triangle intersection" (sheared corners).
"""

from math import inf, sqrt

from proximity.kernels.geometry.closest_feature import (
    CLOSEST_FIELDS,
    closest_on_triangle,
    corner_of,
)
from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import TINY, cross, difference_of_products, dot
from proximity.kernels.segment.plan import ordered_axes
from proximity.kernels.stack_arrays import stack_arrays_of
from proximity.native import inlined, kernel, record
from proximity.native.simd import absolute, fma, like, maximum, minimum, select

WITNESS = record(
    "Witness",
    gap="f8",  # distance
    fraction="f8",  # along the planned segment
    on_segment="(3,)f8",
    on_solid="(3,)f8",
    solid_weights="(3,)f8",  # barycentric
    **CLOSEST_FIELDS,  # of the triangle, and of an end of the segment; last, so that it is not a subtype
)
"""Nearest points of a segment and a triangle, in the local frame."""
stack_witness, _ = stack_arrays_of(WITNESS)


@inlined
def segment_triangle_crossing(a, b, c, slope_x, slope_y, span):
    """Test whether the segment from the origin to (slope_x, slope_y, 1) · span crosses triangle *abc*.

    Return also the numerator and the denominator of the fraction along the segment, the weights of the three
    corners and their sum. Corners are sheared until the segment is parallel to z. The signs of the weights
    are then exact, and faces that share an edge or a corner leave no gap. The edges and ends belong to the
    segment and the triangle. A face seen edge-on is not crossed, but its neighbours are.
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
    """Return the squared length of w + t d."""
    x, y, z = fma(t, dx, wx), fma(t, dy, wy), fma(t, dz, wz)
    return dot(x, y, z, x, y, z)


@inlined
def _clamp(t):
    return minimum(maximum(t, like(0.0, t)), like(1.0, t))


@inlined
def segment_edge_distance_sq(a, e, d, inverse_sq):
    """Return the squared distance from a segment to a half-open edge of a triangle.

    The segment is from the origin to *d*, the edge is from *a* to a + e; (x, y, z) each. The end a + e is the
    start of the next edge. *inverse_sq*: 1 / |d|².
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
    # The common perpendicular of the two lines.
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
    """Test whether the foot of a point is inside the triangle. Return also its squared distance to the plane.

    *p*, *r*: the point relative to corners a and b. Every side is computed from its own corner, as in
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
    """Return the squared distance from the segment between the origin and *d* to triangle *abc*.

    *a*, *b*, *c*, *d*: (x, y, z) each, scalars or vectors of eight. *slope_x*, *slope_y*: dx / dz, dy / dz.
    *inverse_sq*: 1 / |d|².
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
def _take_end(end, fraction, witness):
    """Update the witness by an end of the segment and the point of the triangle nearest to that end."""
    closest_on_triangle(end[0], end[1], end[2], witness)
    if witness.length < witness.gap:
        witness.gap, witness.fraction = witness.length, fraction
        for k in range(3):
            witness.on_segment[k] = end[k]
            witness.on_solid[k] = witness.point[k]
            witness.solid_weights[k] = witness.weights[k]


@inlined
def _from_nearer_end(start, end, fraction):
    """Return a point between two others as the nearer of them and the step from it."""
    if fraction <= 0.5:
        return start, fraction * (end - start)
    return end, (fraction - 1.0) * (end - start)


@inlined
def _take_passing(plan, corner, t, u, witness):
    """Update the witness by two points if they are nearer than its own.

    One is at *t* along the segment, the other at *u* along the edge from *corner*.
    """
    px, wx = _from_nearer_end(plan.start[0], plan.end[0], t)
    py, wy = _from_nearer_end(plan.start[1], plan.end[1], t)
    pz, wz = _from_nearer_end(plan.start[2], plan.end[2], t)
    (ax, ay, az), (bx, by, bz) = corner_of(witness, corner), corner_of(witness, (corner + 1) % 3)
    qx, vx = _from_nearer_end(ax, bx, u)
    qy, vy = _from_nearer_end(ay, by, u)
    qz, vz = _from_nearer_end(az, bz, u)
    gap_x, gap_y, gap_z = (px - qx) + (wx - vx), (py - qy) + (wy - vy), (pz - qz) + (wz - vz)
    gap = sqrt(dot(gap_x, gap_y, gap_z, gap_x, gap_y, gap_z))
    if gap < witness.gap or (gap == witness.gap and t < witness.fraction):
        other = (corner + 1) % 3
        witness.gap, witness.fraction = gap, t
        on_segment, on_solid = witness.on_segment, witness.on_solid
        on_segment[0], on_segment[1], on_segment[2] = px + wx, py + wy, pz + wz
        on_solid[0], on_solid[1], on_solid[2] = qx + vx, qy + vy, qz + vz
        witness.solid_weights[corner], witness.solid_weights[other] = 1.0 - u, u
        witness.solid_weights[3 - corner - other] = 0.0


@inlined
def _take_edge(plan, corner, witness):
    """Update the witness by the edge from *corner*: by its corner, and by the common perpendicular."""
    (sx, sy, sz), (tx, ty, tz) = vector(plan.start), vector(plan.end)
    (ax, ay, az), (bx, by, bz) = corner_of(witness, corner), corner_of(witness, (corner + 1) % 3)
    dx, dy, dz, ex, ey, ez = tx - sx, ty - sy, tz - sz, bx - ax, by - ay, bz - az
    wx, wy, wz, vx, vy, vz = ax - sx, ay - sy, az - sz, ax - tx, ay - ty, az - tz
    length_sq = max(dot(dx, dy, dz, dx, dy, dz), TINY)
    from_start, from_end = dot(wx, wy, wz, dx, dy, dz), -dot(vx, vy, vz, dx, dy, dz)
    t = from_start / length_sq if from_start <= from_end else 1.0 - from_end / length_sq
    _take_passing(plan, corner, min(max(t, 0.0), 1.0), 0.0, witness)
    # The common perpendicular of the two lines.
    nx, ny, nz = cross(dx, dy, dz, ex, ey, ez)
    mx, my, mz = cross(wx, wy, wz, ex, ey, ez)
    t = dot(mx, my, mz, nx, ny, nz) / max(dot(nx, ny, nz, nx, ny, nz), TINY * TINY)
    t = min(max(t, 0.0), 1.0)
    gx, gy, gz = fma(t, dx, -wx), fma(t, dy, -wy), fma(t, dz, -wz)
    u = dot(gx, gy, gz, ex, ey, ez) / max(dot(ex, ey, ez, ex, ey, ez), TINY)
    _take_passing(plan, corner, t, min(max(u, 0.0), 1.0), witness)


@inlined
def _take_crossing(plan, witness):
    """Write the crossing to the witness, if there is one, and return whether there is.

    It is consistent with `segment_triangle_distance_sq`.
    """
    i, j, k = ordered_axes(plan)
    px, py, pz = plan.start[i], plan.start[j], plan.start[k]
    corners = witness.corners
    is_hit, part, whole, weight_a, weight_b, weight_c, total = segment_triangle_crossing(
        (corners[0, i] - px, corners[0, j] - py, corners[0, k] - pz),
        (corners[1, i] - px, corners[1, j] - py, corners[1, k] - pz),
        (corners[2, i] - px, corners[2, j] - py, corners[2, k] - pz),
        plan.slope_x,
        plan.slope_y,
        plan.end[k] - pz,
    )
    if not is_hit:
        return False
    t = min(part / whole, 1.0)
    witness.gap, witness.fraction = 0.0, t
    weights = witness.solid_weights
    weights[0], weights[1], weights[2] = weight_a / total, weight_b / total, weight_c / total
    for axis in range(3):
        near, step = _from_nearer_end(plan.start[axis], plan.end[axis], t)
        witness.on_segment[axis], witness.on_solid[axis] = near + step, near + step
    return True


@kernel
def segment_on_triangle(plan, witness):
    """Write the nearest points of the planned segment and of a triangle to *witness*.

    The corners of the triangle are already in *witness*. Ties: the first along the segment. Degenerate: see
    `closest_on_triangle`; a segment without length gives its start.
    """
    witness.gap = inf
    if _take_crossing(plan, witness):
        return
    _take_end(plan.start, 0.0, witness)
    for corner in range(3):
        _take_edge(plan, corner, witness)
    _take_end(plan.end, 1.0, witness)
