"""Closest point of one triangle to a query, with its feature and side.

This is scalar code for the triangle that a walk has found. Edge parameters are measured from the nearer end,
the normal is compensated, and barycentric weights are solved along the longest edge, so that they reproduce
the point even on a needle.
"""

from math import sqrt
from typing import Any

from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import TINY, cross, dot, height_over
from proximity.kernels.layout import FEATURE_EDGE, FEATURE_FACE, FEATURE_VERTEX
from proximity.kernels.nodes import corner_at, offset_of
from proximity.kernels.stack_arrays import stack_arrays_of
from proximity.native import inlined, record

CLOSEST_FIELDS: Any = {
    "length": "f8",  # distance
    "arm": "(3,)f8",  # from the closest point to the query
    "weights": "(3,)f8",  # barycentric, of the corners
    "point": "(3,)f8",  # the closest point
    "normal": "(3,)f8",  # pseudo-normal of the feature, unit
    "corners": "(3, 3)f8",
}
CLOSEST = record("Closest", **CLOSEST_FIELDS)
"""A triangle and its closest point to a query, in the local frame."""
stack_closest, _ = stack_arrays_of(CLOSEST)


@inlined
def read_corners(reals, slot, closest):
    """Copy the corners of the triangle at *slot* into *closest*."""
    position, corners = offset_of(slot), closest.corners
    for k in range(3):
        corners[k, 0], corners[k, 1], corners[k, 2] = corner_at(reals, position, k)


@inlined
def corner_of(closest, k):
    """Return the coordinates (x, y, z) of corner *k*."""
    return closest.corners[k, 0], closest.corners[k, 1], closest.corners[k, 2]


@inlined
def _arm(closest, k, x, y, z):
    """Return the vector from corner *k* to a point."""
    ax, ay, az = corner_of(closest, k)
    return x - ax, y - ay, z - az


@inlined
def _edge(closest, k, j):
    """Return the vector from corner *k* to corner *j*."""
    return _arm(closest, k, *corner_of(closest, j))


@inlined
def over_face(closest, px, py, pz):
    """Test whether the foot of *p* is strictly inside the triangle.

    Return also the signed height over its plane. The unit normal in *closest* is filled, with 0 for a
    triangle without area.
    """
    normal, corners = closest.normal, (*corner_of(closest, 0), *corner_of(closest, 1), *corner_of(closest, 2))
    is_over, height, normal[0], normal[1], normal[2] = height_over(px, py, pz, *corners)
    return is_over, height


@inlined
def closest_on_face(px, py, pz, height, closest):
    """Fill *closest* for a point above or below the interior of the face, at *height* along its unit normal.

    Weights are solved along the longest edge. The weight of the third corner comes from the height over that
    edge, the others come from the position along it. They reproduce the point even on a needle.
    """
    closest.length = abs(height)
    for axis in range(3):
        closest.arm[axis] = closest.normal[axis] * height
    i, longest_sq = 0, -1.0
    for k in range(3):
        ex, ey, ez = _edge(closest, k, (k + 1) % 3)
        length_sq = dot(ex, ey, ez, ex, ey, ez)
        if length_sq > longest_sq:
            i, longest_sq = k, length_sq
    j, k = (i + 1) % 3, (i + 2) % 3
    ex, ey, ez = _edge(closest, i, j)
    cx, cy, cz = _edge(closest, i, k)
    ax, ay, az = vector(closest.arm)
    fx, fy, fz = _arm(closest, i, px - ax, py - ay, pz - az)
    nx, ny, nz = vector(closest.normal)
    # Heights of the foot and of the third corner over the longest edge, times its length.
    foot = dot(nx, ny, nz, *cross(ex, ey, ez, fx, fy, fz))
    full = dot(nx, ny, nz, *cross(ex, ey, ez, cx, cy, cz))
    third = min(max(foot / full, 0.0), 1.0) if full > 0.0 else 0.0
    along = min(max(dot(fx, fy, fz, ex, ey, ez) / longest_sq, 0.0), 1.0)
    tip = dot(cx, cy, cz, ex, ey, ez) / longest_sq
    # Rounding may put the foot outside a needle: move it onto the nearer of the two shorter sides.
    height_sq = full * full / longest_sq
    if third * tip > along:
        third = (along * tip * longest_sq + third * height_sq) / (tip * tip * longest_sq + height_sq)
    rest, tip_rest = 1.0 - along, 1.0 - tip
    if third * tip_rest > rest:
        third = (rest * tip_rest * longest_sq + third * height_sq) / (
            tip_rest * tip_rest * longest_sq + height_sq
        )
    second = min(max(along - third * tip, 0.0), 1.0 - third)
    closest.weights[i] = (1.0 - third) - second
    closest.weights[j] = second
    closest.weights[k] = third


@inlined
def closest_on_edges(px, py, pz, closest):
    """Fill *closest* with the nearest point on the three edges. Return the feature and its number.

    The number is the edge (from corner k to k + 1) or the corner. Each edge is measured from its nearer end;
    an edge without length counts as its start.
    """
    best_sq = -1.0
    feature, which = FEATURE_VERTEX, 0
    for k in range(3):
        j = (k + 1) % 3
        ex, ey, ez = _edge(closest, k, j)
        ax, ay, az = _arm(closest, k, px, py, pz)
        bx, by, bz = _arm(closest, j, px, py, pz)
        length_sq = dot(ex, ey, ez, ex, ey, ez)
        from_start = dot(ax, ay, az, ex, ey, ez)
        from_end = -dot(bx, by, bz, ex, ey, ez)
        if from_start <= 0.0 or length_sq <= TINY:
            t, kind, number = 0.0, FEATURE_VERTEX, k
            dx, dy, dz = ax, ay, az
        elif from_end <= 0.0:
            t, kind, number = 1.0, FEATURE_VERTEX, j
            dx, dy, dz = bx, by, bz
        elif from_start <= from_end:
            t, kind, number = min(from_start / length_sq, 1.0), FEATURE_EDGE, k
            dx, dy, dz = ax - t * ex, ay - t * ey, az - t * ez
        else:
            u = min(from_end / length_sq, 1.0)
            t, kind, number = 1.0 - u, FEATURE_EDGE, k
            dx, dy, dz = bx + u * ex, by + u * ey, bz + u * ez
        distance_sq = dot(dx, dy, dz, dx, dy, dz)
        if best_sq < 0.0 or distance_sq < best_sq:
            best_sq, feature, which = distance_sq, kind, number
            closest.arm[0], closest.arm[1], closest.arm[2] = dx, dy, dz
            closest.weights[k], closest.weights[j], closest.weights[3 - k - j] = 1.0 - t, t, 0.0
    closest.length = sqrt(best_sq)
    return feature, which


@inlined
def closest_on_triangle(px, py, pz, closest):
    """Fill *closest* with the point of its triangle nearest to *p*. Return the feature and its number.

    All coordinates are in the local frame. Degenerate: a triangle without area is replaced by its edges.
    Source: as `triangle`; the weights are our own.
    """
    is_over, height = over_face(closest, px, py, pz)
    if is_over:
        closest_on_face(px, py, pz, height, closest)
        feature, which = FEATURE_FACE, 0
    else:
        feature, which = closest_on_edges(px, py, pz, closest)
    # From the corner with the largest weight: a point at a corner is exact.
    base = 0
    for k in range(1, 3):
        if closest.weights[k] > closest.weights[base]:
            base = k
    k, j = (base + 1) % 3, (base + 2) % 3
    ux, uy, uz = _edge(closest, base, k)
    vx, vy, vz = _edge(closest, base, j)
    ax, ay, az = corner_of(closest, base)
    second, third = closest.weights[k], closest.weights[j]
    closest.point[0] = ax + (second * ux + third * vx)
    closest.point[1] = ay + (second * uy + third * vy)
    closest.point[2] = az + (second * uz + third * vz)
    return feature, which
