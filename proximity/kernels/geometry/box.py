"""Lower bounds of the distances from a point to eight boxes at a time.

Float32 boxes are padded to cover the rounding of the query point to float32. `BOUND_SLACK` covers the
rounding of the squares. So the nearest subtree is never pruned.
"""

import numpy as np

from proximity.kernels.nodes import boxes_of, wide_boxes_of
from proximity.native import inlined
from proximity.native.simd import fma, maximum, minimum, narrow, select, splat, splat32

FAR = 2.0
"""Distance from the middle, in part sizes, up to which points have float32 bounds.

Up to it, rounding a coordinate to float32 errs by at most 2^-24.
"""
BOX_MARGIN = np.float32(2.0**-23)
"""Padding of boxes when they are made. It is twice the rounding of the query and of the box itself."""
BOUND_SLACK = 1.0 + 2.0**-20
"""Factor on the best squared distance before it is compared with a bound.

It covers the five roundings of a bound in float32, of 2^-24 each.
"""
MAX_BOUND = np.float32(3.4e38)
"""Initial bound, below the infinity of unused lanes."""
MAX_REST = 3.3e38
"""Largest bound of a distant box.

As it is below `MAX_BOUND`, the box is visited until a first triangle is found.
"""
SHRINK_FAR = 1.0 - 2.0**-48


@inlined
def nearest_in_boxes(nodes, base, x, y, z):
    """Return the nearest point to (x, y, z) of each box of the node at *base*, as three float32x8."""
    (lx, ly, lz), (ux, uy, uz) = boxes_of(nodes, base)
    return minimum(maximum(x, lx), ux), minimum(maximum(y, ly), uy), minimum(maximum(z, lz), uz)


@inlined
def point_boxes_distance_sq(nodes, base, x, y, z):
    """Return squared distances from a point to the boxes of the node at *base*. Unused lanes give inf.

    *x y z* are float32x8 splats of a point within `FAR`. Compare the result with a limit that has the factor
    `BOUND_SLACK`.
    """
    at_x, at_y, at_z = nearest_in_boxes(nodes, base, x, y, z)
    gap_x, gap_y, gap_z = x - at_x, y - at_y, z - at_z
    return fma(gap_x, gap_x, fma(gap_y, gap_y, gap_z * gap_z))


@inlined
def far_offset_sq(px, py, pz):
    """Return a lower bound of the squared distance from a point to the local cube [-1, 1].

    It is 0 for a point within `FAR`.
    """
    if max(abs(px), abs(py), abs(pz)) <= FAR:
        return 0.0
    gap_x, gap_y, gap_z = max(abs(px) - 1.0, 0.0), max(abs(py) - 1.0, 0.0), max(abs(pz) - 1.0, 0.0)
    return (gap_x * gap_x + gap_y * gap_y + gap_z * gap_z) * (1.0 - 2.0**-45)


@inlined
def wide_gaps_sq(nodes, base, x, y, z):
    """Return squared distances in float64 from a point to the boxes of a node.

    *x y z* are float64x8 splats.
    """
    ((lx, ly, lz), (ux, uy, uz)), zero = wide_boxes_of(nodes, base), splat(0.0)
    gap_x = maximum(maximum(lx - x, x - ux), zero)
    gap_y = maximum(maximum(ly - y, y - uy), zero)
    gap_z = maximum(maximum(lz - z, z - uz), zero)
    return fma(gap_x, gap_x, fma(gap_y, gap_y, gap_z * gap_z))


@inlined
def far_point_boxes_distance_sq(nodes, base, x, y, z, offset):
    """Return bounds of squared distances from a distant point, computed in float64 and reduced by *offset*.

    Squares of large distances differ by little. Subtracting the bound of the whole part first leaves numbers
    that float32 can distinguish. *x y z offset* are float64x8 splats.
    """
    bounds = wide_gaps_sq(nodes, base, x, y, z) * splat(SHRINK_FAR)
    rest = maximum(bounds - offset, splat(0.0))
    # From 1e26 part sizes on the difference overflows float32; only unused lanes may be infinite.
    return narrow(select(rest < splat(np.inf), minimum(rest, splat(MAX_REST)), rest))


@inlined
def lanes_of_point(px, py, pz):
    """Return a point as three float32x8 and as three float64x8, and its `far_offset_sq`."""
    narrow_lanes = splat32(np.float32(px)), splat32(np.float32(py)), splat32(np.float32(pz))
    return narrow_lanes, (splat(px), splat(py), splat(pz)), far_offset_sq(px, py, pz)


@inlined
def node_bounds_sq(words, base, point_lanes):
    """Return bounds of squared distances to a node's boxes, by the method for near or for distant points.

    *point_lanes*: from `lanes_of_point`.
    """
    narrow_lanes, wide_lanes, offset = point_lanes
    if offset > 0.0:
        x, y, z = wide_lanes
        return far_point_boxes_distance_sq(words, base, x, y, z, splat(offset))
    x, y, z = narrow_lanes
    return point_boxes_distance_sq(words, base, x, y, z)


@inlined
def bound_of(best_sq, offset):
    """Return the float32 limit for bounds of boxes. Boxes up to this limit must be visited."""
    return min(np.float32((best_sq - offset) * BOUND_SLACK), MAX_BOUND)


@inlined
def round_down(value):
    """Return a float32 that equals a float64 or is just below it."""
    rounded = np.float32(value)
    below = rounded - (abs(rounded) * np.float32(1.2e-7) + np.float32(1e-38))
    return below if rounded > value else rounded


@inlined
def round_up(value):
    """Return a float32 that equals a float64 or is just above it."""
    rounded = np.float32(value)
    above = rounded + (abs(rounded) * np.float32(1.2e-7) + np.float32(1e-38))
    return above if rounded < value else rounded
