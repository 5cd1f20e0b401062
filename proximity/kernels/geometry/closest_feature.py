"""The closest point of one triangle: position, feature, and side.

Scalar code for the one triangle a walk has found. Edge parameters are measured from the nearer end, the
normal is compensated, and barycentric weights are solved along the longest edge, so that they give the
point back even on a needle.
"""

from math import sqrt

from proximity.kernels.geometry.triangle import TINY, cross, dot, height_over, offset_of
from proximity.kernels.layout import FEATURE_EDGE, FEATURE_FACE, FEATURE_VERTEX
from proximity.native import inlined

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
def _arm(closest, k, x, y, z):
    """From corner *k* to a point."""
    at = CLOSEST_TRIANGLE + 3 * k
    return x - closest[at], y - closest[at + 1], z - closest[at + 2]


@inlined
def _edge(closest, k, j):
    """From corner *k* to corner *j*."""
    at = CLOSEST_TRIANGLE + 3 * j
    return _arm(closest, k, closest[at], closest[at + 1], closest[at + 2])


@inlined
def over_face(closest, px, py, pz):
    """Whether the foot of *p* on the plane is strictly inside the triangle, and the height with its sign.

    Fills the unit normal; 0 where there is none.
    """
    at = CLOSEST_TRIANGLE
    is_over, height, nx, ny, nz = height_over(
        px, py, pz, closest[at], closest[at + 1], closest[at + 2], closest[at + 3], closest[at + 4],
        closest[at + 5], closest[at + 6], closest[at + 7], closest[at + 8],
    )  # fmt: skip
    closest[CLOSEST_NORMAL], closest[CLOSEST_NORMAL + 1], closest[CLOSEST_NORMAL + 2] = nx, ny, nz
    return is_over, height


@inlined
def closest_on_face(px, py, pz, height, closest):
    """Fill *closest* for a point over the face's inside, at *height* along its unit normal.

    Weights are solved along the longest edge: the third corner's from its height over that edge, the others
    from the position along it. So they give the point back even on a needle.
    """
    closest[CLOSEST_LENGTH] = abs(height)
    for axis in range(3):
        closest[CLOSEST_ARM + axis] = closest[CLOSEST_NORMAL + axis] * height
    i, longest_sq = 0, -1.0
    for k in range(3):
        ex, ey, ez = _edge(closest, k, (k + 1) % 3)
        length_sq = dot(ex, ey, ez, ex, ey, ez)
        if length_sq > longest_sq:
            i, longest_sq = k, length_sq
    j, k = (i + 1) % 3, (i + 2) % 3
    ex, ey, ez = _edge(closest, i, j)
    cx, cy, cz = _edge(closest, i, k)
    fx, fy, fz = _arm(
        closest, i, px - closest[CLOSEST_ARM], py - closest[CLOSEST_ARM + 1], pz - closest[CLOSEST_ARM + 2]
    )
    nx, ny, nz = closest[CLOSEST_NORMAL], closest[CLOSEST_NORMAL + 1], closest[CLOSEST_NORMAL + 2]
    # Heights of the foot and of the third corner over the longest edge, both times its length.
    foot = dot(nx, ny, nz, *cross(ex, ey, ez, fx, fy, fz))
    full = dot(nx, ny, nz, *cross(ex, ey, ez, cx, cy, cz))
    third = min(max(foot / full, 0.0), 1.0) if full > 0.0 else 0.0
    along = min(max(dot(fx, fy, fz, ex, ey, ez) / longest_sq, 0.0), 1.0)
    tip = dot(cx, cy, cz, ex, ey, ez) / longest_sq
    # Rounding may put the foot beside a needle: back onto the nearer of the two shorter sides.
    height_sq = full * full / longest_sq
    if third * tip > along:
        third = (along * tip * longest_sq + third * height_sq) / (tip * tip * longest_sq + height_sq)
    rest, tip_rest = 1.0 - along, 1.0 - tip
    if third * tip_rest > rest:
        third = (rest * tip_rest * longest_sq + third * height_sq) / (
            tip_rest * tip_rest * longest_sq + height_sq
        )
    second = min(max(along - third * tip, 0.0), 1.0 - third)
    closest[CLOSEST_WEIGHT + i] = (1.0 - third) - second
    closest[CLOSEST_WEIGHT + j] = second
    closest[CLOSEST_WEIGHT + k] = third


@inlined
def closest_on_edges(px, py, pz, closest):
    """Fill *closest* for the nearest point of the three edges; return the feature and which one.

    The second number is the edge (from corner k to k + 1) or the corner. Each edge is measured from its
    nearer end; one without length answers as its start.
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
            closest[CLOSEST_ARM], closest[CLOSEST_ARM + 1], closest[CLOSEST_ARM + 2] = dx, dy, dz
            closest[CLOSEST_WEIGHT + k], closest[CLOSEST_WEIGHT + j], closest[CLOSEST_WEIGHT + 3 - k - j] = (
                1.0 - t,
                t,
                0.0,
            )
    closest[CLOSEST_LENGTH] = sqrt(best_sq)
    return feature, which


@inlined
def closest_on_triangle(px, py, pz, closest):
    """Fill *closest* for the point of its triangle nearest to *p*; return the feature and which one.

    All in the local frame. Degenerate: zero area falls back to the edges.
    Source: as `triangle`; the weights are our own.
    """
    is_over, height = over_face(closest, px, py, pz)
    if is_over:
        closest_on_face(px, py, pz, height, closest)
        feature, which = FEATURE_FACE, 0
    else:
        feature, which = closest_on_edges(px, py, pz, closest)
    # From the corner that weighs most: nothing is lost where the point is a corner.
    base = 0
    for k in range(1, 3):
        if closest[CLOSEST_WEIGHT + k] > closest[CLOSEST_WEIGHT + base]:
            base = k
    k, j = (base + 1) % 3, (base + 2) % 3
    ux, uy, uz = _edge(closest, base, k)
    vx, vy, vz = _edge(closest, base, j)
    at = CLOSEST_TRIANGLE + 3 * base
    second, third = closest[CLOSEST_WEIGHT + k], closest[CLOSEST_WEIGHT + j]
    closest[CLOSEST_POINT] = closest[at] + (second * ux + third * vx)
    closest[CLOSEST_POINT + 1] = closest[at + 1] + (second * uy + third * vy)
    closest[CLOSEST_POINT + 2] = closest[at + 2] + (second * uz + third * vz)
    return feature, which
