"""Lower bounds of the distance from a point to eight boxes at once.

Boxes are float32 and wider than what they contain, by enough to make up for a query point that is rounded
to float32 as well; the roundings of the squares are made up for on the other side of the comparison. So
nothing is skipped that could be nearer.
"""

import numpy as np

from proximity.kernels.nodes import boxes_of, wide_boxes_of
from proximity.native import inlined
from proximity.native.simd import fma, maximum, minimum, narrow, select, splat, splat32

FAR = 2.0
"""Within this (part sizes from the middle) a coordinate rounded to float32 is off by 2^-24 at most."""
BOX_MARGIN = np.float32(2.0**-23)
"""Margin of boxes, added when they are made: the query's rounding and their own, twice over."""
BOUND_SLACK = 1.0 + 2.0**-20
"""Factor on the best squared distance before it is compared with a bound: it makes up for the five float32
roundings, of 2^-24 each, between a bound and its computed value."""
LARGEST_BOUND = np.float32(3.4e38)
"""Stands for no bound yet: less than the infinity of unused lanes."""
LARGEST_REST = 3.3e38
"""Below `LARGEST_BOUND`, so that it is looked at as long as nothing is found."""
SHRINK_FAR = 1.0 - 2.0**-48


@inlined
def nearest_in_boxes(nodes, base, x, y, z):
    """The point of each box of the node at *base* that is nearest to a point: x, y and z, float32x8."""
    (lx, ly, lz), (ux, uy, uz) = boxes_of(nodes, base)
    return minimum(maximum(x, lx), ux), minimum(maximum(y, ly), uy), minimum(maximum(z, lz), uz)


@inlined
def point_boxes_distance_sq(nodes, base, x, y, z):
    """Squared distances from a point to the boxes of the node at *base*; unused lanes give inf.

    *x y z* are float32x8 splats of a point within `FAR`. Times `LOOSEN` these are lower bounds.
    """
    at_x, at_y, at_z = nearest_in_boxes(nodes, base, x, y, z)
    gap_x, gap_y, gap_z = x - at_x, y - at_y, z - at_z
    return fma(gap_x, gap_x, fma(gap_y, gap_y, gap_z * gap_z))


@inlined
def far_offset_sq(px, py, pz):
    """A squared distance below that of anything in the local cube [-1, 1]; 0 for a point that is not far."""
    if max(abs(px), abs(py), abs(pz)) <= FAR:
        return 0.0
    gap_x, gap_y, gap_z = max(abs(px) - 1.0, 0.0), max(abs(py) - 1.0, 0.0), max(abs(pz) - 1.0, 0.0)
    return (gap_x * gap_x + gap_y * gap_y + gap_z * gap_z) * (1.0 - 2.0**-45)


@inlined
def wide_gaps_sq(nodes, base, x, y, z):
    """Squared distances from a point to the boxes of a node in float64; *x y z* are float64x8 splats."""
    ((lx, ly, lz), (ux, uy, uz)), zero = wide_boxes_of(nodes, base), splat(0.0)
    gap_x = maximum(maximum(lx - x, x - ux), zero)
    gap_y = maximum(maximum(ly - y, y - uy), zero)
    gap_z = maximum(maximum(lz - z, z - uz), zero)
    return fma(gap_x, gap_x, fma(gap_y, gap_y, gap_z * gap_z))


@inlined
def far_point_boxes_distance_sq(nodes, base, x, y, z, offset):
    """The same bounds from float64 arithmetic, for a point far outside, less *offset*.

    The squares of a far distance differ by little: taking the bound of the whole part away first leaves
    numbers that float32 tells apart. *x y z offset* are float64x8 splats.
    """
    bounds = wide_gaps_sq(nodes, base, x, y, z) * splat(SHRINK_FAR)
    rest = maximum(bounds - offset, splat(0.0))
    # From 1e26 part sizes on the rest leaves float32; only that of unused lanes may.
    return narrow(select(rest < splat(np.inf), minimum(rest, splat(LARGEST_REST)), rest))


@inlined
def lanes_of_point(px, py, pz):
    """A point as nodes and blocks take it: (x, y, z) of float32x8, the same of float64x8; `far_offset_sq`."""
    narrow_lanes = splat32(np.float32(px)), splat32(np.float32(py)), splat32(np.float32(pz))
    return narrow_lanes, (splat(px), splat(py), splat(pz)), far_offset_sq(px, py, pz)


@inlined
def node_bounds_sq(words, base, point_lanes):
    """One of the two above; *point_lanes*: see `lanes_of_point`."""
    narrow_lanes, wide_lanes, offset = point_lanes
    if offset > 0.0:
        x, y, z = wide_lanes
        return far_point_boxes_distance_sq(words, base, x, y, z, splat(offset))
    x, y, z = narrow_lanes
    return point_boxes_distance_sq(words, base, x, y, z)


@inlined
def bound_of(best_sq, offset):
    """The float32 number that bounds are compared with: what is not above it must be looked at."""
    return min(np.float32((best_sq - offset) * BOUND_SLACK), LARGEST_BOUND)


@inlined
def round_down(value):
    """The float32 at or just below a float64."""
    rounded = np.float32(value)
    below = rounded - (abs(rounded) * np.float32(1.2e-7) + np.float32(1e-38))
    return below if rounded > value else rounded


@inlined
def round_up(value):
    """The float32 at or just above a float64."""
    rounded = np.float32(value)
    above = rounded + (abs(rounded) * np.float32(1.2e-7) + np.float32(1e-38))
    return above if rounded < value else rounded
