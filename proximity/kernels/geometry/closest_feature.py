"""The closest point of one triangle: position, feature, and side.

Scalar code for the one triangle a walk has found. Edge parameters are measured from the nearer end, the
normal is compensated, and barycentric weights are solved along the longest edge, so that they give the
point back even on a needle.
"""

from math import sqrt

from proximity.kernels.geometry.triangle import TINY, cross, dot
from proximity.kernels.layout import FEATURE_EDGE, FEATURE_FACE, FEATURE_VERTEX, LANES
from proximity.kernels.nodes import offset_of
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
        closest[CLOSEST_TRIANGLE + k] = reals[base + LANES * k]


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
def height_over(px, py, pz, ax, ay, az, bx, by, bz, cx, cy, cz):
    """Whether the foot of *p* on the plane is strictly inside the triangle *abc*, height, and unit normal.

    Scalars or vectors of eight. The same formula as the walk's, so that both agree on what is inside. A
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
