"""Lower bounds of the distance from a planned segment to eight boxes.

A bound is the largest of several gaps along unit vectors, each of which is a valid bound:

- along x, y and z together, the gap between the box and the segment's own box;
- along each vector perpendicular to the segment and to x, y or z: it is tight for long segments;
- from the centre of the box to the nearest point of the segment: it is tight for distant boxes.

Boxes that the segment may touch are ordered by the smallest fraction at which the segment may reach them.
This fraction times `TOUCHING` is added to the bound. Then the first of several crossings is found first and
ends the traversal.

Source: Gottschalk, Lin, Manocha 1996, "OBBTree" (separating axes).
"""

import numpy as np

from proximity.kernels.geometry.box import MAX_REST, bound_of
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import LANES
from proximity.kernels.nodes import boxes_of, load_points, wide_boxes_of
from proximity.kernels.segment.plan import (
    TOUCHING,
)
from proximity.native import inlined, kernel
from proximity.native.simd import absolute, fma, load, maximum, minimum, narrow, select, splat

SEGMENT_SHRINK_FAR = 1.0 - 2.0**-44
"""Factor on squared float64 bounds.

It covers their rounding, and that of the distances compared with them.
"""


@inlined
def _of(lanes, index):
    """Return the eight lanes of a field of a probe."""
    return load(lanes, LANES * index)


@inlined
def _side_gap(lower, upper, probe, axis):
    """Return the gap between boxes and the segment's own box along a coordinate."""
    gap = maximum(lower - _of(probe.upper, axis), _of(probe.lower, axis) - upper)
    return maximum(gap, _of(probe.zero, 0))


@inlined
def _axis_gap(sum_j, sum_k, width_j, width_k, probe, axis):
    """Return the gap between boxes and the segment along a vector perpendicular to the segment.

    It is 0 instead of NaN in unused lanes.
    """
    n_j, n_k = _of(probe.first, axis), _of(probe.second, axis)
    apart = absolute(fma(n_j, sum_j, n_k * sum_k) - _of(probe.middle, axis))
    within = fma(absolute(n_j), width_j, fma(absolute(n_k), width_k, _of(probe.spread, axis)))
    return maximum(apart - within, _of(probe.zero, 0))


@inlined
def _middle_gap_sq(sum_x, sum_y, sum_z, wide_x, wide_y, wide_z, probe):
    """Return squared gaps from the centres of boxes to the segment, and the first fractions inside the boxes.

    A gap may be NaN.
    """
    zero, half, one = _of(probe.zero, 0), _of(probe.half, 0), _of(probe.one, 0)
    slack, inverse_sq = _of(probe.slack, 0), _of(probe.inverse_sq, 0)
    dx, dy, dz = load_points(probe.direction, 0)
    sx, sy, sz = load_points(probe.origin, 0)
    cx, cy, cz = fma(-half, sum_x, sx), fma(-half, sum_y, sy), fma(-half, sum_z, sz)
    hx, hy, hz = fma(half, wide_x, slack), fma(half, wide_y, slack), fma(half, wide_z, slack)
    along = -dot(cx, cy, cz, dx, dy, dz)
    t = minimum(maximum(along * inverse_sq, zero), one)
    gx, gy, gz = fma(t, dx, cx), fma(t, dy, cy), fma(t, dz, cz)
    # The vector may be rounded: the gap along it is computed from both ends of the segment.
    nearest = dot(gx, gy, gz, cx, cy, cz) + minimum(dot(gx, gy, gz, dx, dy, dz), zero)
    within = dot(absolute(gx), absolute(gy), absolute(gz), hx, hy, hz)
    gap = maximum(nearest - within, zero)
    early = along - dot(absolute(dx), absolute(dy), absolute(dz), hx, hy, hz)
    early = minimum(maximum(early * inverse_sq, zero), one)
    # This order avoids overflow for distant boxes.
    return gap / dot(gx, gy, gz, gx, gy, gz) * gap, early


@inlined
def _bounds_sq(lx, ly, lz, ux, uy, uz, probe):
    """Return squared bounds of the distances to boxes, and the first fractions times `TOUCHING`.

    They are inf and 0 in unused lanes.
    """
    sum_x, sum_y, sum_z = lx + ux, ly + uy, lz + uz
    wide_x, wide_y, wide_z = ux - lx, uy - ly, uz - lz
    gap_x = _side_gap(lx, ux, probe, 0)
    gap_y = _side_gap(ly, uy, probe, 1)
    gap_z = _side_gap(lz, uz, probe, 2)
    beside_x = _axis_gap(sum_y, sum_z, wide_y, wide_z, probe, 0)
    beside_y = _axis_gap(sum_z, sum_x, wide_z, wide_x, probe, 1)
    beside_z = _axis_gap(sum_x, sum_y, wide_x, wide_y, probe, 2)
    xx, yy, zz = gap_x * gap_x, gap_y * gap_y, gap_z * gap_z
    middle_sq, early = _middle_gap_sq(sum_x, sum_y, sum_z, wide_x, wide_y, wide_z, probe)
    axes_sq = maximum(fma(beside_x, beside_x, xx), fma(beside_y, beside_y, yy))
    axes_sq = maximum(axes_sq, maximum(fma(beside_z, beside_z, zz), xx + yy + zz))
    # With NaN first, maximum returns the other operand.
    return maximum(middle_sq, axes_sq), early * _of(probe.touch, 0)


@inlined
def segment_boxes_distance_sq(nodes, base, probe):
    """Return float32 bounds from the segment to the boxes of the node at *base*. See `node_bounds_sq`."""
    lower, upper = boxes_of(nodes, base)
    bounds, early = _bounds_sq(*lower, *upper, probe)
    return bounds + early


@inlined
def far_segment_boxes_distance_sq(nodes, base, plan):
    """Return bounds computed in float64 and reduced by the plan's offset, for a segment far from the part.

    See `geometry.box.far_point_boxes_distance_sq`.
    """
    lower, upper = wide_boxes_of(nodes, base)
    bounds, early = _bounds_sq(*lower, *upper, plan)
    rest = maximum(bounds * splat(SEGMENT_SHRINK_FAR) - splat(plan.offset), splat(0.0)) + early
    # Only unused lanes may exceed float32.
    return narrow(select(rest < splat(np.inf), minimum(rest, splat(MAX_REST)), rest))


@inlined
def node_bounds_sq(words, base, plan, probe, is_far):
    """Return float32 bounds of a node's children. Those with bounds up to `open_bound` must be visited."""
    if is_far:
        return far_segment_boxes_distance_sq(words, base, plan)
    return segment_boxes_distance_sq(words, base, probe)


@kernel
def open_bound(plan, best_sq, best_fraction):
    """Return the float32 limit of bounds, given the best squared distance and its fraction.

    The fraction is relative to the whole segment, and is only used if the distance is 0.
    """
    if best_sq > 0.0:
        return max(bound_of(best_sq, plan.offset), np.float32(1.001 * TOUCHING))
    span = plan.high - plan.low
    rest = 1.0
    if best_fraction < plan.high:
        # Fractions of the whole segment are coarse if the span is short.
        rest = min(max((best_fraction - plan.low) / span, 0.0) + 2.0**-50 / span + 1e-5, 1.0)
    return np.float32(1.001 * TOUCHING * rest)
