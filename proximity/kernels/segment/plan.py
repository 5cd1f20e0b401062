"""The *plan* of a segment: everything a walk needs of it, in the local frame of one part.

It is cut down to what can hold the nearest point, and all that bounds and distances need is worked out and
spread over eight lanes. Two arrays, filled once for a segment and part: ``plan`` (float64, `PLAN_SIZE`) and,
for what is near, ``probe`` (float32, `PROBE_SIZE`).
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.box import FAR, round_down, round_up
from proximity.kernels.geometry.triangle import TINY, dot
from proximity.kernels.layout import LANES
from proximity.native import inlined, kernel
from proximity.native.simd import fma, splat, splat32, store

# --- what bounds need, eight lanes each: in a plan from PLAN_PROBE on, or in a probe ---
PROBE_LOWER = 0  # box of the segment, three each
PROBE_UPPER = 3
PROBE_AXIS = 6  # of three perpendiculars: half its two components, the segment's position along it, slack
PROBE_AXIS_STRIDE = 4
PROBE_START = 18  # the segment: start, step to its end, 1 / length²
PROBE_DIRECTION = 21
PROBE_INVERSE_SQ = 24
PROBE_SLACK = 25  # for the rounding of positions
PROBE_ZERO = 26
PROBE_HALF = 27
PROBE_ONE = 28
PROBE_TOUCH = 29
PROBE_SIZE = 30 * LANES

# --- a plan ---
PLAN_START = 0  # of what is left of the segment, local
PLAN_END = 3
PLAN_LOW = 6  # where on the whole segment that is, as fractions of it
PLAN_HIGH = 7
PLAN_IS_FAR = 8  # 1 where float32 would not tell the boxes apart
PLAN_OFFSET = 9  # a squared distance below that of anything in the local cube; 0 if not far
PLAN_PART = 10  # whose frame it is; set by who knows
PLAN_AXIS_X = 11  # axes in cyclic order, that in which the segment is longest last
PLAN_SLOPE_X = 12  # step along the first and second of them for each unit along the last
PLAN_SLOPE_Y = 13
PLAN_PER_LENGTH_SQ = 14  # 1 / length²
PLAN_PROBE = 16
PLAN_SIZE = PLAN_PROBE + PROBE_SIZE

NEAR_REACH = 8.0
"""A segment within this (part sizes) is compared with boxes in float32."""
CUBE_RADIUS = 1.7320509
"""A little more than the distance from the middle of the local cube [-1, 1]³ to its corners."""
AXIS_SHRINK = 1.0 - 2.0**-22
"""Factor on the vectors: their length stays at most 1."""
TOUCHING = 1e-37
"""Fractions along the segment are added to squared bounds times this: beneath any distance that counts."""
SEGMENT_ROUNDING = 2.0**-24 * 64.0
"""Bounds the rounding of a position along a vector in float32: a few dozen roundings of numbers up to 1, and
`SEGMENT_ROUNDING_FAR` in float64; longer segments get that many times more."""
SEGMENT_ROUNDING_FAR = 2.0**-53 * 64.0


@inlined
def _point_along(start, end, fraction):
    """start + fraction · (end - start), rounded once: the ends may be millions of part sizes away."""
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
    """Put what matters of the segment into *plan*: PLAN_START, PLAN_END, PLAN_LOW, PLAN_HIGH, PLAN_OFFSET.

    Let r be the distance from the middle of the cube to the segment. The surface lies within √3 of the
    middle, so the answer is at most r + √3 and its point on the segment within r + 2 √3 of the middle: no
    farther along than √(4 √3 r + 12) from where the segment passes.
    """
    plan[PLAN_START], plan[PLAN_START + 1], plan[PLAN_START + 2] = sx, sy, sz
    plan[PLAN_END], plan[PLAN_END + 1], plan[PLAN_END + 2] = ex, ey, ez
    plan[PLAN_LOW], plan[PLAN_HIGH], plan[PLAN_OFFSET] = 0.0, 1.0, 0.0
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
            start, end = plan[PLAN_START + axis], plan[PLAN_END + axis]
            plan[PLAN_START + axis] = _point_along(start, end, low)
            plan[PLAN_END + axis] = _point_along(start, end, high)
        plan[PLAN_LOW], plan[PLAN_HIGH] = low, high
    beyond = max(passing - rounding - CUBE_RADIUS, 0.0)
    plan[PLAN_OFFSET] = beyond * beyond * (1.0 - 2.0**-40)


@kernel
def make_plan(plan, probe, sx, sy, sz, ex, ey, ez):
    """Fill *plan* and *probe* for a segment in a part's local frame."""
    _clip(plan, sx, sy, sz, ex, ey, ez)
    _order_axes(plan)
    reach = max(
        _largest(plan[PLAN_START], plan[PLAN_START + 1], plan[PLAN_START + 2]),
        _largest(plan[PLAN_END], plan[PLAN_END + 1], plan[PLAN_END + 2]),
    )
    if reach <= NEAR_REACH:
        plan[PLAN_IS_FAR], plan[PLAN_OFFSET] = 0.0, 0.0
        _aim_near(plan, probe, SEGMENT_ROUNDING * (1.0 + reach))
    else:
        plan[PLAN_IS_FAR] = 1.0
        _aim_far(plan, SEGMENT_ROUNDING_FAR * (1.0 + reach))


@inlined
def _order_axes(plan):
    """Fill what distances need; a segment without length has slopes of nan and crosses nothing."""
    dx, dy, dz = (
        plan[PLAN_END] - plan[PLAN_START],
        plan[PLAN_END + 1] - plan[PLAN_START + 1],
        plan[PLAN_END + 2] - plan[PLAN_START + 2],
    )
    plan[PLAN_PER_LENGTH_SQ] = 1.0 / max(dot(dx, dy, dz, dx, dy, dz), TINY)
    if abs(dz) >= abs(dx) and abs(dz) >= abs(dy):
        plan[PLAN_AXIS_X], plan[PLAN_SLOPE_X], plan[PLAN_SLOPE_Y] = 0.0, dx / dz, dy / dz
    elif abs(dx) >= abs(dy):
        plan[PLAN_AXIS_X], plan[PLAN_SLOPE_X], plan[PLAN_SLOPE_Y] = 1.0, dy / dx, dz / dx
    else:
        plan[PLAN_AXIS_X], plan[PLAN_SLOPE_X], plan[PLAN_SLOPE_Y] = 2.0, dz / dy, dx / dy


@inlined
def ordered_axes(plan):
    """The three axes in cyclic order, the last that in which the segment is longest."""
    first = np.int64(plan[PLAN_AXIS_X])
    return first, (first + 1) % 3, (first + 2) % 3


@inlined
def _perpendicular(plan, j, k):
    """Half the unit vector (two components) perpendicular to an axis and the segment; 0 where there is none.

    Half, because it is multiplied with the sum of a box's ends.
    """
    step_j, step_k = plan[PLAN_END + j] - plan[PLAN_START + j], plan[PLAN_END + k] - plan[PLAN_START + k]
    length = sqrt(step_j * step_j + step_k * step_k)
    if not length > 0.0:
        return 0.0, 0.0
    return 0.5 * AXIS_SHRINK * (step_k / length), -0.5 * AXIS_SHRINK * (step_j / length)


@inlined
def _extent_along(plan, n_j, n_k, j, k):
    """Middle and half width of the segment along a vector, which is given by its half."""
    start = 2.0 * (n_j * plan[PLAN_START + j] + n_k * plan[PLAN_START + k])
    end = 2.0 * (n_j * plan[PLAN_END + j] + n_k * plan[PLAN_END + k])
    return 0.5 * (start + end), 0.5 * abs(end - start)


@inlined
def _inverse_sq(plan):
    """1 / length² for bounds: 0 where float32 could not hold it."""
    return plan[PLAN_PER_LENGTH_SQ] if plan[PLAN_PER_LENGTH_SQ] < 1e30 else 0.0


@inlined
def _put32(probe, at, value):
    store(probe, LANES * at, splat32(np.float32(value)))


@inlined
def _put(plan, at, value):
    store(plan, PLAN_PROBE + LANES * at, splat(value))


@kernel
def _aim_near(plan, probe, rounding):
    """Fill *probe* for a segment near the part."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        start, end = plan[PLAN_START + i], plan[PLAN_END + i]
        _put32(probe, PROBE_LOWER + i, round_down(min(start, end)))
        _put32(probe, PROBE_UPPER + i, round_up(max(start, end)))
        _put32(probe, PROBE_START + i, start)
        _put32(probe, PROBE_DIRECTION + i, end - start)
        n_j, n_k = _perpendicular(plan, j, k)
        # What is rounded here is the vector that counts.
        n_j, n_k = np.float64(np.float32(n_j)), np.float64(np.float32(n_k))
        middle, spread = _extent_along(plan, n_j, n_k, j, k)
        _put32(probe, PROBE_AXIS + PROBE_AXIS_STRIDE * i, n_j)
        _put32(probe, PROBE_AXIS + PROBE_AXIS_STRIDE * i + 1, n_k)
        _put32(probe, PROBE_AXIS + PROBE_AXIS_STRIDE * i + 2, middle)
        _put32(probe, PROBE_AXIS + PROBE_AXIS_STRIDE * i + 3, spread + rounding)
    _put32(probe, PROBE_INVERSE_SQ, _inverse_sq(plan))
    _put32(probe, PROBE_SLACK, rounding)
    _put32(probe, PROBE_ZERO, 0.0)
    _put32(probe, PROBE_HALF, 0.5)
    _put32(probe, PROBE_ONE, 1.0)
    _put32(probe, PROBE_TOUCH, TOUCHING)


@kernel
def _aim_far(plan, rounding):
    """The same in float64, into the plan itself."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        start, end = plan[PLAN_START + i], plan[PLAN_END + i]
        _put(plan, PROBE_LOWER + i, min(start, end))
        _put(plan, PROBE_UPPER + i, max(start, end))
        _put(plan, PROBE_START + i, start)
        _put(plan, PROBE_DIRECTION + i, end - start)
        n_j, n_k = _perpendicular(plan, j, k)
        middle, spread = _extent_along(plan, n_j, n_k, j, k)
        _put(plan, PROBE_AXIS + PROBE_AXIS_STRIDE * i, n_j)
        _put(plan, PROBE_AXIS + PROBE_AXIS_STRIDE * i + 1, n_k)
        _put(plan, PROBE_AXIS + PROBE_AXIS_STRIDE * i + 2, middle)
        _put(plan, PROBE_AXIS + PROBE_AXIS_STRIDE * i + 3, spread + rounding)
    _put(plan, PROBE_INVERSE_SQ, _inverse_sq(plan))
    _put(plan, PROBE_SLACK, rounding)
    _put(plan, PROBE_ZERO, 0.0)
    _put(plan, PROBE_HALF, 0.5)
    _put(plan, PROBE_ONE, 1.0)
    _put(plan, PROBE_TOUCH, TOUCHING)
