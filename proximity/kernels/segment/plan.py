"""The *plan* of a segment, which has its precomputed values for a traversal in the local frame of one part.

The segment is clipped to the range that can contain the nearest point, and the values for bounds and
distances are broadcast to eight lanes. Two records are filled once for each segment and part: ``plan`` and,
for near segments, ``probe``.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.box import FAR, round_down, round_up
from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import TINY, dot
from proximity.kernels.layout import LANES
from proximity.kernels.stack_arrays import stack_arrays_of
from proximity.native import inlined, kernel, record
from proximity.native.simd import fma, splat, splat32, store


def _probe_fields(number):
    """Return the fields of values for bounds, which have eight lanes each. *number*: their type."""
    return {
        "lower": f"({3 * LANES},){number}",  # box of the segment
        "upper": f"({3 * LANES},){number}",
        "first": f"({3 * LANES},){number}",  # of three perpendiculars: half their first components
        "second": f"({3 * LANES},){number}",  # and half their second components
        "middle": f"({3 * LANES},){number}",  # centre of the segment along them
        "spread": f"({3 * LANES},){number}",  # its half width along them, with slack
        "origin": f"({3 * LANES},){number}",  # start of the segment
        "direction": f"({3 * LANES},){number}",  # from its start to its end
        "inverse_sq": f"({LANES},){number}",  # 1 / length²
        "slack": f"({LANES},){number}",  # for the rounding of positions
        "zero": f"({LANES},){number}",
        "half": f"({LANES},){number}",
        "one": f"({LANES},){number}",
        "touch": f"({LANES},){number}",
    }


PROBE = record("Probe", **_probe_fields("f4"))
"""Values for bounds of a segment that is near the part."""
PLAN = record(
    "Plan",
    start="(3,)f8",  # of the clipped segment, local
    end="(3,)f8",
    low="f8",  # ends of the clipped segment, as fractions of the whole one
    high="f8",
    is_far="i8",  # 1 if float32 cannot distinguish the boxes
    part="i8",  # part whose frame it is; set by the caller
    offset="f8",  # a lower bound of the squared distance to the local cube; 0 if not far
    axis_x="i8",  # first of the axes in cyclic order; the segment is longest along the last
    slope_x="f8",  # step along the first and second axis per unit along the last
    slope_y="f8",
    per_length_sq="f8",  # 1 / length²
    **_probe_fields("f8"),  # values for the bounds of a segment far from the part
)
stack_plans, stack_probes = stack_arrays_of(PLAN)[0], stack_arrays_of(PROBE)[0]

NEAR_REACH = 8.0
"""Distance, in part sizes, up to which a segment is compared with boxes in float32."""
CUBE_RADIUS = 1.7320509
"""Slightly more than the distance from the centre of the local cube [-1, 1]³ to its corners."""
AXIS_SHRINK = 1.0 - 2.0**-22
"""Factor on unit vectors that keeps their length at most 1."""
TOUCHING = 1e-37
"""Factor on fractions along the segment that are added to squared bounds.

It is below any significant distance.
"""
SEGMENT_ROUNDING = 2.0**-24 * 64.0
"""Bound of the rounding of a position along a vector in float32.

It is a few dozen roundings of numbers up to 1, and grows in proportion to the segment's reach.
`SEGMENT_ROUNDING_FAR` is the bound in float64.
"""
SEGMENT_ROUNDING_FAR = 2.0**-53 * 64.0


@inlined
def _point_along(start, end, fraction):
    """Return start + fraction · (end - start) with one rounding.

    The ends may be millions of part sizes away.
    """
    if fraction <= 0.0:
        return start
    if fraction >= 1.0:
        return end
    step = end - start
    back = step - end
    step_rest = (end - (step - back)) - (start + back)
    product = fraction * step
    product_rest = fma(fraction, step, -product)
    total = start + product
    shift = total - start
    total_rest = (start - (total - shift)) + (product - shift)
    return total + (total_rest + (product_rest + fraction * step_rest))


@inlined
def _largest(x, y, z):
    return max(abs(x), abs(y), abs(z))


@kernel
def _clip(plan, sx, sy, sz, ex, ey, ez):
    """Clip the segment, and write the result to the fields start, end, low, high and offset of *plan*.

    Let r be the distance from the centre of the cube to the segment. The surface is within √3 of the centre,
    so the distance is at most r + √3, and its point on the segment is within r + 2 √3 of the centre. This is
    at most √(4 √3 r + 12) along the segment from the point nearest to the centre.
    """
    plan.start[0], plan.start[1], plan.start[2] = sx, sy, sz
    plan.end[0], plan.end[1], plan.end[2] = ex, ey, ez
    plan.low, plan.high, plan.offset = 0.0, 1.0, 0.0
    reach = max(_largest(sx, sy, sz), _largest(ex, ey, ez))
    if reach <= FAR:
        return
    dx, dy, dz = ex - sx, ey - sy, ez - sz
    length = sqrt(dot(dx, dy, dz, dx, dy, dz))
    middle = min(max(-dot(sx, sy, sz, dx, dy, dz) / (length * length), 0.0), 1.0) if length > 0.0 else 0.0
    mx, my, mz = fma(middle, dx, sx), fma(middle, dy, sy), fma(middle, dz, sz)
    passing = sqrt(dot(mx, my, mz, mx, my, mz))
    rounding = reach * 2.0**-44
    half = 1.001 * (sqrt(4.0 * CUBE_RADIUS * (passing + rounding) + 12.0) + rounding)
    if length > 0.0:
        low, high = max(middle - half / length, 0.0), min(middle + half / length, 1.0)
        for axis in range(3):
            start, end = plan.start[axis], plan.end[axis]
            plan.start[axis] = _point_along(start, end, low)
            plan.end[axis] = _point_along(start, end, high)
        plan.low, plan.high = low, high
    beyond = max(passing - rounding - CUBE_RADIUS, 0.0)
    plan.offset = beyond * beyond * (1.0 - 2.0**-40)


@inlined
def _order_axes(plan):
    """Write the values for distances to *plan*.

    A segment without length has slopes of nan, and no crossings.
    """
    dx, dy, dz = (
        plan.end[0] - plan.start[0],
        plan.end[1] - plan.start[1],
        plan.end[2] - plan.start[2],
    )
    plan.per_length_sq = 1.0 / max(dot(dx, dy, dz, dx, dy, dz), TINY)
    if abs(dz) >= abs(dx) and abs(dz) >= abs(dy):
        plan.axis_x, plan.slope_x, plan.slope_y = 0, dx / dz, dy / dz
    elif abs(dx) >= abs(dy):
        plan.axis_x, plan.slope_x, plan.slope_y = 1, dy / dx, dz / dx
    else:
        plan.axis_x, plan.slope_x, plan.slope_y = 2, dz / dy, dx / dy


@inlined
def ordered_axes(plan):
    """Return the three axes in cyclic order. The segment is longest along the last one."""
    first = plan.axis_x
    return first, (first + 1) % 3, (first + 2) % 3


@inlined
def _perpendicular(plan, j, k):
    """Return half the unit vector that is perpendicular to an axis and to the segment, or 0 without one.

    It has two components. It is halved because it is multiplied by the sum of a box's ends.
    """
    step_j, step_k = plan.end[j] - plan.start[j], plan.end[k] - plan.start[k]
    length = sqrt(step_j * step_j + step_k * step_k)
    if not length > 0.0:
        return 0.0, 0.0
    return 0.5 * AXIS_SHRINK * (step_k / length), -0.5 * AXIS_SHRINK * (step_j / length)


@inlined
def _extent_along(plan, n_j, n_k, j, k):
    """Return the centre and the half width of the segment along a vector. The vector is given by its half."""
    start = 2.0 * (n_j * plan.start[j] + n_k * plan.start[k])
    end = 2.0 * (n_j * plan.end[j] + n_k * plan.end[k])
    return 0.5 * (start + end), 0.5 * abs(end - start)


@inlined
def _inverse_sq(plan):
    """Return 1 / length² for bounds, or 0 if this exceeds float32."""
    return plan.per_length_sq if plan.per_length_sq < 1e30 else 0.0


@inlined
def _put32(lanes, at, value):
    store(lanes, LANES * at, splat32(np.float32(value)))


@inlined
def _put(lanes, at, value):
    store(lanes, LANES * at, splat(value))


@inlined
def _narrowed(value):
    return np.float64(np.float32(value))


@inlined
def _unchanged(value):
    return value


def _aiming(put, below, above, component):
    """Return a kernel that writes the values for bounds to a probe, or to a plan, in one precision."""

    @kernel
    def aim(plan, probe, rounding):
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            start, end = plan.start[i], plan.end[i]
            put(probe.lower, i, below(min(start, end)))
            put(probe.upper, i, above(max(start, end)))
            put(probe.origin, i, start)
            put(probe.direction, i, end - start)
            n_j, n_k = _perpendicular(plan, j, k)
            # The rounded vector is the one used for the extent.
            n_j, n_k = component(n_j), component(n_k)
            middle, spread = _extent_along(plan, n_j, n_k, j, k)
            put(probe.first, i, n_j)
            put(probe.second, i, n_k)
            put(probe.middle, i, middle)
            put(probe.spread, i, spread + rounding)
        put(probe.inverse_sq, 0, _inverse_sq(plan))
        put(probe.slack, 0, rounding)
        put(probe.zero, 0, 0.0)
        put(probe.half, 0, 0.5)
        put(probe.one, 0, 1.0)
        put(probe.touch, 0, TOUCHING)

    return aim


_aim_near = _aiming(_put32, round_down, round_up, _narrowed)
_aim_far = _aiming(_put, _unchanged, _unchanged, _unchanged)


@kernel
def make_plan(plan, probe, sx, sy, sz, ex, ey, ez):
    """Compute *plan* and *probe* for a segment in the local frame of a part."""
    _clip(plan, sx, sy, sz, ex, ey, ez)
    _order_axes(plan)
    reach = max(_largest(*vector(plan.start)), _largest(*vector(plan.end)))
    if reach <= NEAR_REACH:
        plan.is_far, plan.offset = 0, 0.0
        _aim_near(plan, probe, SEGMENT_ROUNDING * (1.0 + reach))
    else:
        plan.is_far = 1
        _aim_far(plan, plan, SEGMENT_ROUNDING_FAR * (1.0 + reach))
