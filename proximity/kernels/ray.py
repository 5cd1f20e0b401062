"""A ray against one part's tree: the first hit.

Triangles are tested in float64 and watertight: seen along the ray, a shared corner is at the same place for
all its triangles, and the side on which an edge passes is never wrong. So a ray through an edge or a corner
of a closed surface hits one of the triangles there. There is no tolerance at edges and no smallest area: a
face that the ray runs along has no area seen from there and is not hit; its neighbours are.

Boxes are tested in float32, from a start near the part, and widened by more than all roundings can be off.
The answer is the smallest computed parameter, and among equals the lowest slot; so it depends neither on the
order of the walk nor on a bound known beforehand.

Source: Woop, Benthin, Wald 2013, "Watertight ray/triangle intersection"; Ize 2013, "Robust BVH ray
traversal". Unlike there, edge functions are compensated (Kahan) instead of repeated in a wider type, and the
error of the box test is put into its constants.
"""

from math import copysign

import numpy as np

from proximity.kernels.box import FAR
from proximity.kernels.compiling import inlined
from proximity.kernels.descent import NOTHING_WAITS, descend_in_order, next_open
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NO_SLOT, NODE_STRIDE, STACK_SIZE
from proximity.kernels.triangle import difference_of_products
from proximity.simd import (
    bits,
    fma,
    horizontal_min,
    lane,
    load,
    load_int,
    maximum,
    minimum,
    select,
    splat,
    splat32,
    trailing_zeros,
)

REACH = 1.5
"""A ray from farther away than `FAR` is started where it enters the cube of this half side."""
SLAB_MARGIN = 2.0**-20
"""What a box is widened by, local units: twice what float32 can be off. With a start within 2 and planes
within 1 the reciprocal and the result are off by 2^-24 of a way of at most 3, the constant by 2^-24 of 2."""
SLOWEST = 2.0**-60
"""Least component of a direction in the box test: its reciprocal stays finite, and over the length of the
part it moves the ray by far less than the margin."""
START_SLACK = 2.0**-50
"""A ray that starts this little behind a face starts on it: rounding of local coordinates."""
LATE = 2.0**-51
"""Rounding of a parameter and of its difference from the start of the box test."""
WIDEN = np.float32(2.0**-22)
"""Rounding of that difference to float32; a test which way it went would be mispredicted every other time."""


@inlined
def approach(ox, oy, oz, dx, dy, dz):
    """Whether a ray comes near the local cube, from which parameter on, and the point there.

    The direction's largest component is near 1. Within `FAR` rays start where they start. From afar the
    point is rounded, which is as if the origin were.
    """
    if max(abs(ox), abs(oy), abs(oz)) <= FAR:
        return True, 0.0, ox, oy, oz
    enter_x, leave_x = _way_through(ox, dx)
    enter_y, leave_y = _way_through(oy, dy)
    enter_z, leave_z = _way_through(oz, dz)
    enter = max(enter_x, enter_y, enter_z)
    is_near = enter >= 0.0 and enter <= min(leave_x, leave_y, leave_z)
    return is_near, enter, _inside(ox + enter * dx), _inside(oy + enter * dy), _inside(oz + enter * dz)


@inlined
def _way_through(o, d):
    """Parameters at which one coordinate enters and leaves the cube."""
    way = d if abs(d) > SLOWEST else copysign(SLOWEST, d)
    reach = copysign(REACH, way)
    return (-reach - o) / way, (reach - o) / way


@inlined
def _inside(value):
    return min(max(value, -REACH), REACH)


@inlined
def slab(o, d, margin):
    """Factor and two constants that turn a plane's coordinate into the parameters of entering and leaving.

    The error of factor, constants and result is in the constants: entering comes out early, leaving late.
    """
    rate = np.float32(1.0 / (d if abs(d) > SLOWEST else copysign(SLOWEST, d)))
    start, spread = -o * np.float64(rate), margin * abs(np.float64(rate))
    return rate, np.float32(start - spread), np.float32(start + spread)


@inlined
def near_plane(d):
    """Offset in a node from a box's lower x (y, z) to the plane that is entered first; the other is left."""
    return 24 if copysign(1.0, d) < 0.0 else 0


@inlined
def bound_of_parameter(best, start):
    """The float32 number, counted from *start*, that bounds are compared with."""
    bound = np.float32(best - start + best * LATE)
    return bound + abs(bound) * WIDEN


@inlined
def ray_boxes_bound(
    nodes, base, near_x, near_y, near_z, rate_x, rate_y, rate_z, in_x, in_y, in_z, out_x, out_y, out_z,
    zero, best,
):  # fmt: skip
    """Parameters at which a ray enters the boxes of the node at *base*, and which it meets up to *best*.

    Bounds are >= 0. Rates and constants are float32x8 splats of `slab`.
    """
    enter_x = fma(load(nodes, base + near_x), rate_x, in_x)
    enter_y = fma(load(nodes, base + 8 + near_y), rate_y, in_y)
    enter_z = fma(load(nodes, base + 16 + near_z), rate_z, in_z)
    leave_x = fma(load(nodes, base + 24 - near_x), rate_x, out_x)
    leave_y = fma(load(nodes, base + 32 - near_y), rate_y, out_y)
    leave_z = fma(load(nodes, base + 40 - near_z), rate_z, out_z)
    enter = maximum(maximum(enter_x, enter_y), maximum(enter_z, zero))
    leave = minimum(minimum(leave_x, leave_y), minimum(leave_z, best))
    return enter, enter <= leave


@inlined
def steepest_axis(dx, dy, dz):
    """The axis along which a direction goes fastest."""
    axis = select(abs(dx) >= abs(dy), 0.0, 1.0)
    return np.int64(select(max(abs(dx), abs(dy)) >= abs(dz), axis, 2.0))


@inlined
def pick(axis, x, y, z):
    """One of three by number."""
    return select(axis == 0, x, select(axis == 1, y, z))


@inlined
def ray_triangle_sides(ox, oy, oz, lean_x, lean_y, ax, ay, az, bx, by, bz, cx, cy, cz):
    """Weights of the corners, not yet divided by their sum, and the weighted height; scalars or vectors.

    Axes are turned so that the ray runs mostly along z; *lean_x*, *lean_y* are -dx/dz, -dy/dz. A line hits
    where no two weights differ in sign.
    """
    az, bz, cz = az - oz, bz - oz, cz - oz
    ax, ay = fma(lean_x, az, ax - ox), fma(lean_y, az, ay - oy)
    bx, by = fma(lean_x, bz, bx - ox), fma(lean_y, bz, by - oy)
    cx, cy = fma(lean_x, cz, cx - ox), fma(lean_y, cz, cy - oy)
    u = difference_of_products(bx, cy, by, cx)
    v = difference_of_products(cx, ay, cy, ax)
    w = difference_of_products(ax, by, ay, bx)
    return u, v, w, fma(u, az, fma(v, bz, w * cz))


@inlined
def look_along(ox, oy, oz, dx, dy, dz):
    """What `ray_triangle_sides` needs of a ray: offsets of x, y, z in a block, origin, leans, pace.

    Axes are turned so that the ray runs mostly along z; pace is the parameter's change along z.
    """
    axis = steepest_axis(dx, dy, dz)
    speed = pick(axis, dx, dy, dz)
    return (
        8 * ((axis + 1) % 3),
        8 * ((axis + 2) % 3),
        8 * axis,
        pick(axis, oy, oz, ox),
        pick(axis, oz, ox, oy),
        pick(axis, ox, oy, oz),
        -pick(axis, dy, dz, dx) / speed,
        -pick(axis, dz, dx, dy) / speed,
        1.0 / speed,
    )


@inlined
def first_in_block(reals, base, x, y, z, px, py, pz, lean_x, lean_y, pace, entry, best):
    """First hit, up to *best*, of the eight triangles at *base*: t, lane (-1: none), and three weights.

    *x* … *pace* as `look_along` gives them, *entry* as `approach`.
    """
    found, first = best, np.int64(-1)
    weight_a, weight_b, weight_c = 0.0, 0.0, 0.0
    u, v, w, height = ray_triangle_sides(
        splat(px), splat(py), splat(pz), splat(lean_x), splat(lean_y),
        load(reals, base + x), load(reals, base + y), load(reals, base + z),
        load(reals, base + 24 + x), load(reals, base + 24 + y), load(reals, base + 24 + z),
        load(reals, base + 48 + x), load(reals, base + 48 + y), load(reals, base + 48 + z),
    )  # fmt: skip
    zero = splat(0.0)
    is_hit = (minimum(u, minimum(v, w)) >= zero) | (maximum(u, maximum(v, w)) <= zero)
    if bits(is_hit):
        # No area: 0/0, which no comparison lets through.
        parameters = splat(entry) + height / (u + v + w) * splat(pace)
        is_better = is_hit & (parameters >= splat(-START_SLACK)) & (parameters <= splat(best))
        if bits(is_better):
            parameters = select(is_better, maximum(parameters, zero), splat(np.inf))
            found = horizontal_min(parameters)
            first = trailing_zeros(bits(parameters <= splat(found)))
            weight_a, weight_b, weight_c = lane(u, first), lane(v, first), lane(w, first)
    return found, first, weight_a, weight_b, weight_c


@inlined
def ray_in_part(reals, words, start, ox, oy, oz, dx, dy, dz, best, best_slot, stacks, at):
    """First hit of the ray *o* + t *d*, t >= 0, in the part's local frame: t, slot, and three weights.

    The weights are barycentric coordinates times some number; 0 where nothing better than known was found.

    *start*: the reference to walk from, the part's root for all of it. The largest component of *d* is
    between 0.5 and 2. *best* and *best_slot*: what is known already; nothing farther is looked at. *stacks*
    float32, from *at* on: `STACK_SIZE` bounds, then as many references.
    """
    is_near, entry, ox, oy, oz = approach(ox, oy, oz, dx, dy, dz)
    near_x, near_y, near_z = near_plane(dx), near_plane(dy), near_plane(dz)
    rate_x, in_x, out_x = slab(ox, dx, SLAB_MARGIN)
    rate_y, in_y, out_y = slab(oy, dy, SLAB_MARGIN)
    rate_z, in_z, out_z = slab(oz, dz, SLAB_MARGIN)
    rates_x, rates_y, rates_z = splat32(rate_x), splat32(rate_y), splat32(rate_z)
    ins_x, ins_y, ins_z = splat32(in_x), splat32(in_y), splat32(in_z)
    outs_x, outs_y, outs_z = splat32(out_x), splat32(out_y), splat32(out_z)
    zero32 = splat32(np.float32(0.0))

    x, y, z, px, py, pz, lean_x, lean_y, pace = look_along(ox, oy, oz, dx, dy, dz)
    weight_a, weight_b, weight_c = 0.0, 0.0, 0.0
    # A ray that passes by opens nothing.
    best32 = bound_of_parameter(best, entry) if is_near else np.float32(-1.0)
    bottom = at
    reference = start
    while True:
        if reference >= 0:
            base = NODE_STRIDE * reference
            bounds, is_open = ray_boxes_bound(
                words, base, near_x, near_y, near_z, rates_x, rates_y, rates_z, ins_x, ins_y, ins_z,
                outs_x, outs_y, outs_z, zero32, splat32(best32),
            )  # fmt: skip
            if bits(is_open):
                reference, at = descend_in_order(words, base, bounds, is_open, stacks, at)
                continue
        else:
            block = ~reference
            found, first, a, b, c = first_in_block(
                reals, BLOCK_STRIDE * block, x, y, z, px, py, pz, lean_x, lean_y, pace, entry, best
            )
            slot = LANES * block + first
            if first >= 0 and (found < best or slot < best_slot or best_slot == NO_SLOT):
                best, best_slot = found, slot
                weight_a, weight_b, weight_c = a, b, c
                best32 = bound_of_parameter(best, entry)
        # The next that is still open.
        at = next_open(stacks, bottom, at, best32)
        if at == NOTHING_WAITS:
            return best, best_slot, weight_a, weight_b, weight_c
        reference = load_int(stacks, at + STACK_SIZE)
