"""A segment made ready for the walk: its *plan*, in the local frame of one part.

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
from proximity.simd import fma, splat, splat32, store

# --- what bounds need, eight lanes each: in a plan from AXES on, or in a probe ---
LOWER = 0  # box of the segment, three each
UPPER = 3
AXIS = 6  # of three perpendiculars: half its two components, the segment's place along it, slack
AXIS_STRIDE = 4
FROM = 18  # the segment: start, way to its end, 1 / length²
WAY = 21
INVERSE_SQ = 24
SLACK = 25  # for the rounding of places
ZERO = 26
HALF = 27
ONE = 28
TOUCH = 29
PROBE_SIZE = 30 * LANES

# --- a plan ---
START = 0  # of what is left of the segment, local
END = 3
LOW = 6  # where on the whole segment that is, as fractions of it
HIGH = 7
IS_FAR = 8  # 1 where float32 would not tell the boxes apart
OFFSET = 9  # a squared distance below that of anything in the local cube; 0 if not far
PART = 10  # whose frame it is; set by who knows
AXIS_X = 11  # axes in cyclic order, that in which the segment is longest last
SLOPE_X = 12  # way along the first and second of them for each unit along the last
SLOPE_Y = 13
PER_LENGTH_SQ = 14  # 1 / length²
AXES = 16
PLAN_SIZE = AXES + PROBE_SIZE

NEAR_REACH = 8.0
"""A segment within this (part sizes) is compared with boxes in float32."""
CUBE_RADIUS = 1.7320509
"""A little more than the distance from the middle of the local cube [-1, 1]³ to its corners."""
SHRINK = 1.0 - 2.0**-22
"""Factor on the vectors: their length stays at most 1."""
TOUCHING = 1e-37
"""Fractions along the segment are added to squared bounds times this: beneath any distance that counts."""
ROUNDING = 2.0**-24 * 64.0
"""Bounds the rounding of a place along a vector in float32: a few dozen roundings of numbers up to 1, and
`ROUNDING_FAR` in float64; longer segments get that many times more."""
ROUNDING_FAR = 2.0**-53 * 64.0


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
    """Put what matters of the segment into *plan*: START, END, LOW, HIGH, OFFSET.

    Let r be the distance from the middle of the cube to the segment. The surface lies within √3 of the
    middle, so the answer is at most r + √3 and its point on the segment within r + 2 √3 of the middle: no
    farther along than √(4 √3 r + 12) from where the segment passes.
    """
    plan[START], plan[START + 1], plan[START + 2] = sx, sy, sz
    plan[END], plan[END + 1], plan[END + 2] = ex, ey, ez
    plan[LOW], plan[HIGH], plan[OFFSET] = 0.0, 1.0, 0.0
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
            start, end = plan[START + axis], plan[END + axis]
            plan[START + axis] = _point_along(start, end, low)
            plan[END + axis] = _point_along(start, end, high)
        plan[LOW], plan[HIGH] = low, high
    beyond = max(passing - rounding - CUBE_RADIUS, 0.0)
    plan[OFFSET] = beyond * beyond * (1.0 - 2.0**-40)


@kernel
def make_plan(plan, probe, sx, sy, sz, ex, ey, ez):
    """Fill *plan* and *probe* for a segment in a part's local frame."""
    _clip(plan, sx, sy, sz, ex, ey, ez)
    _order_axes(plan)
    reach = max(
        _largest(plan[START], plan[START + 1], plan[START + 2]),
        _largest(plan[END], plan[END + 1], plan[END + 2]),
    )
    if reach <= NEAR_REACH:
        plan[IS_FAR], plan[OFFSET] = 0.0, 0.0
        _aim_near(plan, probe, ROUNDING * (1.0 + reach))
    else:
        plan[IS_FAR] = 1.0
        _aim_far(plan, ROUNDING_FAR * (1.0 + reach))


@inlined
def _order_axes(plan):
    """Fill what distances need; a segment without length has slopes of nan and crosses nothing."""
    dx, dy, dz = plan[END] - plan[START], plan[END + 1] - plan[START + 1], plan[END + 2] - plan[START + 2]
    plan[PER_LENGTH_SQ] = 1.0 / max(dot(dx, dy, dz, dx, dy, dz), TINY)
    if abs(dz) >= abs(dx) and abs(dz) >= abs(dy):
        plan[AXIS_X], plan[SLOPE_X], plan[SLOPE_Y] = 0.0, dx / dz, dy / dz
    elif abs(dx) >= abs(dy):
        plan[AXIS_X], plan[SLOPE_X], plan[SLOPE_Y] = 1.0, dy / dx, dz / dx
    else:
        plan[AXIS_X], plan[SLOPE_X], plan[SLOPE_Y] = 2.0, dz / dy, dx / dy


@inlined
def ordered_axes(plan):
    """The three axes in cyclic order, the last that in which the segment is longest."""
    first = np.int64(plan[AXIS_X])
    return first, (first + 1) % 3, (first + 2) % 3


@inlined
def _perpendicular(plan, j, k):
    """Half the unit vector (two components) perpendicular to an axis and the segment; 0 where there is none.

    Half, because it is multiplied with the sum of a box's ends.
    """
    step_j, step_k = plan[END + j] - plan[START + j], plan[END + k] - plan[START + k]
    length = sqrt(step_j * step_j + step_k * step_k)
    if not length > 0.0:
        return 0.0, 0.0
    return 0.5 * SHRINK * (step_k / length), -0.5 * SHRINK * (step_j / length)


@inlined
def _place(plan, n_j, n_k, j, k):
    """Where the segment lies along a vector, given by its half, and how far it reaches to each side."""
    start = 2.0 * (n_j * plan[START + j] + n_k * plan[START + k])
    end = 2.0 * (n_j * plan[END + j] + n_k * plan[END + k])
    return 0.5 * (start + end), 0.5 * abs(end - start)


@inlined
def _inverse_sq(plan):
    """1 / length² for bounds: 0 where float32 could not hold it."""
    return plan[PER_LENGTH_SQ] if plan[PER_LENGTH_SQ] < 1e30 else 0.0


@inlined
def _put32(probe, at, value):
    store(probe, LANES * at, splat32(np.float32(value)))


@inlined
def _put(plan, at, value):
    store(plan, AXES + LANES * at, splat(value))


@kernel
def _aim_near(plan, probe, rounding):
    """Fill *probe* for a segment near the part."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        start, end = plan[START + i], plan[END + i]
        _put32(probe, LOWER + i, round_down(min(start, end)))
        _put32(probe, UPPER + i, round_up(max(start, end)))
        _put32(probe, FROM + i, start)
        _put32(probe, WAY + i, end - start)
        n_j, n_k = _perpendicular(plan, j, k)
        # What is rounded here is the vector that counts.
        n_j, n_k = np.float64(np.float32(n_j)), np.float64(np.float32(n_k))
        place, spread = _place(plan, n_j, n_k, j, k)
        _put32(probe, AXIS + AXIS_STRIDE * i, n_j)
        _put32(probe, AXIS + AXIS_STRIDE * i + 1, n_k)
        _put32(probe, AXIS + AXIS_STRIDE * i + 2, place)
        _put32(probe, AXIS + AXIS_STRIDE * i + 3, spread + rounding)
    _put32(probe, INVERSE_SQ, _inverse_sq(plan))
    _put32(probe, SLACK, rounding)
    _put32(probe, ZERO, 0.0)
    _put32(probe, HALF, 0.5)
    _put32(probe, ONE, 1.0)
    _put32(probe, TOUCH, TOUCHING)


@kernel
def _aim_far(plan, rounding):
    """The same in float64, into the plan itself."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        start, end = plan[START + i], plan[END + i]
        _put(plan, LOWER + i, min(start, end))
        _put(plan, UPPER + i, max(start, end))
        _put(plan, FROM + i, start)
        _put(plan, WAY + i, end - start)
        n_j, n_k = _perpendicular(plan, j, k)
        place, spread = _place(plan, n_j, n_k, j, k)
        _put(plan, AXIS + AXIS_STRIDE * i, n_j)
        _put(plan, AXIS + AXIS_STRIDE * i + 1, n_k)
        _put(plan, AXIS + AXIS_STRIDE * i + 2, place)
        _put(plan, AXIS + AXIS_STRIDE * i + 3, spread + rounding)
    _put(plan, INVERSE_SQ, _inverse_sq(plan))
    _put(plan, SLACK, rounding)
    _put(plan, ZERO, 0.0)
    _put(plan, HALF, 0.5)
    _put(plan, ONE, 1.0)
    _put(plan, TOUCH, TOUCHING)
