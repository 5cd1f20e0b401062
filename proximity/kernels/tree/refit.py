"""Refit of a part's tree, normals and moments to new vertex positions.

One pass over the nodes, from last to first, computes all of it. The eight triangles of a leaf are loaded
once, and contribute to their block, box, corner normals and moments while they are in registers. The number
of a child is above its parent's, so children are complete before their parent. Boxes are rounded and padded
as in `builder`. Normals equal those of `mesh.faces`, and moments those of `winding_number`, except for the
order of summation.

Tried and dropped (2026-11): loading and adding single numbers instead of rows took 18 ms instead of 12 for
300 k faces.
"""

from math import pi, sqrt

import numpy as np

from proximity.kernels.geometry.box import BOX_MARGIN
from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    CORNER_STRIDE,
    LANES,
    MOMENT_AREA_NORMAL,
    MOMENT_CENTRE,
    MOMENT_FAR_SQ,
    MOMENT_SPREAD,
    MOMENT_STRIDE,
    NO_ROW,
    NODE_STRIDE,
    NODE_UPPER,
    ORIENTED_STRIDE,
    UNUSED,
    ModelArrays,
)
from proximity.kernels.nodes import child_at, fetch_block, is_used, store_points
from proximity.kernels.sign.winding_number import OPENING
from proximity.kernels.tree.normal_slab import fill_slabs
from proximity.kernels.tree.oriented_box import write_oriented_box
from proximity.native import entry, inlined, kernel
from proximity.native.simd import (
    absolute,
    add_rows,
    fma,
    lane_minima,
    lane_sums,
    load_int,
    load_rows,
    maximum,
    minimum,
    narrow,
    prefetch,
    select,
    splat,
    splat32,
    square_root,
    store,
    widen,
)

RESULT_SUMS = 16
"""Number of sums of a subtree.

They are its area; area times centre, three; area normal, three; and area normal times position, nine.
"""
RESULT_STRIDE = 24
"""Numbers stored for a subtree: its sums, the lower xyz and the negated upper xyz of its box, two unused."""
CORNER_ROW = 8
"""Numbers stored for a corner, in a cache line. They are its coordinates and its normal, in rows of four."""
CORNER_NORMAL = 4
BLOCK_CORNERS = 3 * LANES
"""Number of corners of a block."""
ULP = np.float32(1.2e-7)
SMALLEST_STEP = np.float32(1e-38)
EIGHTH_TANGENT = 0.41421356237309503
"""Tangent of pi / 8. Above it, the arc is computed from its difference to pi / 4."""


@entry("float64[:, 3], int32[:], float, float64[:, 3], float64[:] -> int")
def survey_vertices(vertices, leaders, largest, kept, box):
    """Copy *vertices* (V, 3) to *kept*, and write their box to *box* (6,). Return the first invalid row.

    *leaders*: (V,) int32, the first vertex at the same position, its own row or a lower one, or `UNUSED`. A
    row is invalid if it is not finite, exceeds *largest*, or differs from its leader. `NO_ROW` is returned if
    all are valid. *box*: lower and upper corner.
    """
    bad = np.int64(NO_ROW)
    low_x, low_y, low_z = np.inf, np.inf, np.inf
    high_x, high_y, high_z = -np.inf, -np.inf, -np.inf
    for row in range(len(vertices)):
        x, y, z = vertices[row, 0], vertices[row, 1], vertices[row, 2]
        kept[row, 0], kept[row, 1], kept[row, 2] = x, y, z
        leader = leaders[row]
        if leader == UNUSED:
            continue
        fits = abs(x) <= largest and abs(y) <= largest and abs(z) <= largest
        if leader != row:
            fits = fits and x == kept[leader, 0] and y == kept[leader, 1] and z == kept[leader, 2]
        if not fits and bad == NO_ROW:
            bad = np.int64(row)
        low_x, low_y, low_z = min(low_x, x), min(low_y, y), min(low_z, z)
        high_x, high_y, high_z = max(high_x, x), max(high_y, y), max(high_z, z)
    box[0], box[1], box[2] = low_x, low_y, low_z
    box[3], box[4], box[5] = high_x, high_y, high_z
    return bad


@entry(ModelArrays, "int, float64[:, 3], int32[:] -> float, float", makes_arrays=True)
def refit_part(model, part, vertices, leaders):
    """Write new vertices into a part.

    Return its area and three times its enclosed volume, in the local frame. *vertices*: (V, 3) m, valid. The
    frame of the part must be set and contain them.
    """
    reals, words, frames, parts = model
    root, node_count = parts[part].root, parts[part].node_count
    slot_faces, faces, moments = (parts[part].slot_faces, parts[part].faces, parts[part].moments)
    corner_count, boxes = parts[part].corner_count, parts[part].block_boxes
    corner_rows = np.empty((corner_count + 1) * CORNER_ROW)
    _write_corners(reals, frames, parts, part, vertices, leaders, corner_rows)
    # Results of each node for its parent, then of the current node's leaves, and of an empty child.
    results = np.empty((node_count + LANES + 1) * RESULT_STRIDE)
    nothing = (node_count + LANES) * RESULT_STRIDE
    for k in range(RESULT_SUMS):
        results[nothing + k] = 0.0
    for k in range(RESULT_SUMS, RESULT_STRIDE):
        results[nothing + k] = np.inf
    below, ids = np.empty(LANES, np.int64), np.empty(LANES * BLOCK_CORNERS, np.int64)
    for node in range(root + node_count - 1, root - 1, -1):
        base, at = NODE_STRIDE * node, RESULT_STRIDE * (node - root)
        for k in range(LANES):
            below[k] = nothing
            if is_used(words, base + k):
                child = child_at(words, base + k)
                below[k] = RESULT_STRIDE * (child - root if child >= 0 else node_count + k)
                if child < 0:
                    fetch_block(reals, BLOCK_STRIDE * ~child)
                    slot = slot_faces + LANES * ~child
                    _find_corners(words, slot, faces, corner_count, ids, BLOCK_CORNERS * k, corner_rows)
        for k in range(LANES):
            child = child_at(words, base + k)
            if child < 0 and below[k] != nothing:
                corners = BLOCK_CORNERS * k
                _refit_block(model, boxes, ~child, corner_rows, ids, corners, results, below[k])
        _refit_node(words, base, moments + MOMENT_STRIDE * node, results, below, at)
    _write_normals(reals, parts[part].corner_normals, corner_count, corner_rows)
    fill_slabs(words, reals, root, node_count, words, moments)
    return results[0], results[7] + results[11] + results[15]


@kernel
def _write_corners(reals, frames, parts, part, vertices, leaders, corner_rows):
    """Write local corners to the model, and to *corner_rows* with normals of zero."""
    x, y, z = frames[part].centre[0], frames[part].centre[1], frames[part].centre[2]
    scale = frames[part].scale
    corner, corner_at = parts[part].corners, 0
    # Corners are numbered in the order of the first vertices at their positions.
    for row in range(len(vertices)):
        if leaders[row] == row:
            for k in range(3, CORNER_ROW):
                corner_rows[corner_at + k] = 0.0
            corner_rows[corner_at] = reals[corner] = (vertices[row, 0] - x) * scale
            corner_rows[corner_at + 1] = reals[corner + 1] = (vertices[row, 1] - y) * scale
            corner_rows[corner_at + 2] = reals[corner + 2] = (vertices[row, 2] - z) * scale
            corner += 3
            corner_at += CORNER_ROW
    # One more, for unused lanes.
    for k in range(CORNER_ROW):
        corner_rows[corner_at + k] = np.nan


@inlined
def _find_corners(words, slot, faces, corner_count, ids, first, corner_rows):
    """Write the offsets of the rows of the corners of eight slots to *ids* from *first* on.

    First come the offsets of all corners a, then of all corners b, then of all corners c.
    """
    for i in range(LANES):
        face = load_int(words, slot + i)
        for k in range(3):
            corner = load_int(words, faces + 3 * face + k) if face >= 0 else corner_count
            ids[first + LANES * k + i] = CORNER_ROW * corner
            prefetch(corner_rows, CORNER_ROW * corner)


@inlined
def _arc(y, x):
    """Return the angles of directions (x, y) with y >= 0, from 0 to pi, as float64x8.

    They are accurate to 1e-14, and nan if both x and y are zero. The polynomial interpolates the arc tangent
    at Chebyshev points.
    """
    across = absolute(x)
    low, high = minimum(across, y), maximum(across, y)
    is_middle = low > splat(EIGHTH_TANGENT) * high
    t = select(is_middle, low - high, low) / select(is_middle, low + high, high)
    z = t * t
    p = fma(z, splat(-0.02723288406057488), splat(0.05168834935919362))
    p = fma(z, p, splat(-0.0655090730756309))
    p = fma(z, p, splat(0.07681045202742948))
    p = fma(z, p, splat(-0.09090255952690657))
    p = fma(z, p, splat(0.11111089649211055))
    p = fma(z, p, splat(-0.14285713930378566))
    p = fma(z, p, splat(0.19999999997724888))
    p = fma(z, p, splat(-0.3333333333333093))
    angle = fma(t * z, p, t) + select(is_middle, splat(0.25 * pi), splat(0.0))
    angle = select(y > across, splat(0.5 * pi) - angle, angle)
    return select(x < splat(0.0), splat(pi) - angle, angle)


@inlined
def _refit_block(model, boxes, block, corner_rows, ids, first, results, at):
    """Write a block and its boxes. Add its triangles to the normals of their corners and to its result."""
    reals, base = model.reals, BLOCK_STRIDE * block
    ax, ay, az, _ = load_rows(corner_rows, ids, first, 0)
    bx, by, bz, _ = load_rows(corner_rows, ids, first + LANES, 0)
    cx, cy, cz, _ = load_rows(corner_rows, ids, first + 2 * LANES, 0)
    store_points(reals, base, ax, ay, az)
    store_points(reals, base + CORNER_STRIDE, bx, by, bz)
    store_points(reals, base + 2 * CORNER_STRIDE, cx, cy, cz)
    zero, none = splat(0.0), splat(np.inf)
    is_there = ax == ax

    low_x, high_x = minimum(minimum(ax, bx), cx), -maximum(maximum(ax, bx), cx)
    low_y, high_y = minimum(minimum(ay, by), cy), -maximum(maximum(ay, by), cy)
    low_z, high_z = minimum(minimum(az, bz), cz), -maximum(maximum(az, bz), cz)
    exact = lane_minima(
        select(is_there, low_x, none), select(is_there, low_y, none), select(is_there, low_z, none),
        select(is_there, high_x, none), select(is_there, high_y, none), select(is_there, high_z, none),
        zero, zero,
    )  # fmt: skip
    rounded = narrow(exact)
    lower = rounded - (absolute(rounded) * splat32(ULP) + splat32(SMALLEST_STEP))
    lower = select(widen(rounded) > exact, lower, rounded) - splat32(BOX_MARGIN)
    store(results, at + RESULT_SUMS, widen(lower))

    abx, aby, abz = bx - ax, by - ay, bz - az
    acx, acy, acz = cx - ax, cy - ay, cz - az
    bcx, bcy, bcz = cx - bx, cy - by, cz - bz
    nx, ny, nz = cross(abx, aby, abz, acx, acy, acz)
    length = square_root(dot(nx, ny, nz, nx, ny, nz))
    # A face without area has neither a normal nor a weight.
    has_area = length > zero
    inverse = splat(1.0) / length
    a = select(has_area, _arc(length, dot(abx, aby, abz, acx, acy, acz)) * inverse, zero)
    b = select(has_area, _arc(length, -dot(abx, aby, abz, bcx, bcy, bcz)) * inverse, zero)
    c = select(has_area, _arc(length, dot(acx, acy, acz, bcx, bcy, bcz)) * inverse, zero)
    add_rows(corner_rows, ids, first, CORNER_NORMAL, a * nx, a * ny, a * nz)
    add_rows(corner_rows, ids, first + LANES, CORNER_NORMAL, b * nx, b * ny, b * nz)
    add_rows(corner_rows, ids, first + 2 * LANES, CORNER_NORMAL, c * nx, c * ny, c * nz)

    third, half = splat(1.0 / 3.0), splat(0.5)
    x = select(is_there, (ax + bx + cx) * third, zero)
    y = select(is_there, (ay + by + cy) * third, zero)
    z = select(is_there, (az + bz + cz) * third, zero)
    nx, ny = select(is_there, half * nx, zero), select(is_there, half * ny, zero)
    nz, area = select(is_there, half * nz, zero), select(is_there, half * length, zero)
    box = boxes + ORIENTED_STRIDE * block
    write_oriented_box(model.words, box, (ax, ay, az), (bx, by, bz), (cx, cy, cz), (nx, ny, nz))
    store(results, at, lane_sums(area, area * x, area * y, area * z, nx, ny, nz, nx * x))
    store(
        results, at + LANES, lane_sums(nx * y, nx * z, ny * x, ny * y, ny * z, nz * x, nz * y, nz * z)
    )  # fmt: skip


@inlined
def _refit_node(words, base, moments, results, below, at):
    """Write the boxes, moments and result of the node at *base* from the results of its children."""
    # Each lane is a child: area; area times centre; area normal n; n times position, xy for nx times y.
    area, x, y, z = load_rows(results, below, 0, 0)
    nx, ny, nz, xx = load_rows(results, below, 0, 4)
    xy, xz, yx, yy = load_rows(results, below, 0, 8)
    yz, zx, zy, zz = load_rows(results, below, 0, 12)
    store(results, at, lane_sums(area, x, y, z, nx, ny, nz, xx))
    store(results, at + LANES, lane_sums(xy, xz, yx, yy, yz, zx, zy, zz))
    low_x, low_y, low_z, high_x = load_rows(results, below, 0, RESULT_SUMS)
    high_y, high_z, _, _ = load_rows(results, below, 0, RESULT_SUMS + 4)
    zero, half, third = splat(0.0), splat(0.5), splat(1.0 / 3.0)
    store(results, at + RESULT_SUMS, lane_minima(low_x, low_y, low_z, high_x, high_y, high_z, zero, zero))
    high_x, high_y, high_z = -high_x, -high_y, -high_z
    is_there = low_x <= high_x
    store_points(words, base, narrow(low_x), narrow(low_y), narrow(low_z))
    store_points(words, base + NODE_UPPER, narrow(high_x), narrow(high_y), narrow(high_z))

    has_area = area > zero
    x = select(has_area, x / area, half * (low_x + high_x))
    y = select(has_area, y / area, half * (low_y + high_y))
    z = select(has_area, z / area, half * (low_z + high_z))
    reach_x, reach_y = maximum(high_x - x, x - low_x), maximum(high_y - y, y - low_y)
    reach_z = maximum(high_z - z, z - low_z)
    far_sq = splat(OPENING * OPENING) * dot(reach_x, reach_y, reach_z, reach_x, reach_y, reach_z)
    # The first moment about the centre, symmetric and without its trace.
    xx, yy, zz = xx - nx * x, yy - ny * y, zz - nz * z
    mean = (xx + yy + zz) * third
    xy = half * (xy - nx * y + (yx - ny * x))
    xz = half * (xz - nx * z + (zx - nz * x))
    yz = half * (yz - ny * z + (zy - nz * y))
    # Lanes without a child are zero.
    x, y, z = select(is_there, x, zero), select(is_there, y, zero), select(is_there, z, zero)
    store_points(words, moments + MOMENT_CENTRE, narrow(x), narrow(y), narrow(z))
    store_points(words, moments + MOMENT_AREA_NORMAL, narrow(nx), narrow(ny), narrow(nz))
    store(words, moments + MOMENT_FAR_SQ, narrow(select(is_there, far_sq, zero)))
    spread = moments + MOMENT_SPREAD
    store(words, spread, narrow(select(has_area, xx - mean, zero)))
    store(words, spread + LANES, narrow(select(has_area, yy - mean, zero)))
    xy, xz, yz = select(has_area, xy, zero), select(has_area, xz, zero), select(has_area, yz, zero)
    store_points(words, spread + 2 * LANES, narrow(xy), narrow(xz), narrow(yz))


@kernel
def _write_normals(reals, first, count, corner_rows):
    """Write the normals of *count* corners from real *first* on. Their length is 1, or 0 without an area."""
    for corner in range(count):
        corner_at, at = CORNER_ROW * corner + CORNER_NORMAL, first + 3 * corner
        x, y, z = corner_rows[corner_at], corner_rows[corner_at + 1], corner_rows[corner_at + 2]
        length = sqrt(x * x + y * y + z * z)
        if length > 0.0:
            x, y, z = x / length, y / length, z / length
        reals[at], reals[at + 1], reals[at + 2] = x, y, z
