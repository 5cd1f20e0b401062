"""First hit of a ray with one part, and with a scene.

The triangle test is watertight, in float64: seen along the ray, a shared corner has the same position for all
its triangles, and the side of an edge is always correct. A ray through an edge or corner of a closed surface
hits one of the triangles there. There is no tolerance at edges and no minimum area: a face parallel to the
ray has no projected area and is not hit; its neighbours are.

Boxes are tested in float32, from a start near the part, and padded by more than the rounding. The answer is
the smallest computed parameter, and among ties the lowest slot, so it depends neither on the order of the
walk nor on the initial bound.

Source: Woop, Benthin, Wald 2013, "Watertight ray/triangle intersection"; Ize 2013, "Robust BVH ray
traversal". Unlike there, edge functions are compensated (Kahan) instead of repeated in a wider type, and the
constants of the box test include its error.
"""

import numpy as np

from proximity.kernels.geometry.box import FAR
from proximity.kernels.geometry.frames import direction_to_local, to_local
from proximity.kernels.geometry.triangle import difference_of_products
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NO_SLOT, NODE_UPPER
from proximity.kernels.nodes import lower_along, turned_corners_of_block, upper_along
from proximity.kernels.traverse.depth_first import depth_first, in_blocks, in_blocks_and_parts, in_order
from proximity.kernels.traverse.ignored_parts import heed_some
from proximity.native import inlined
from proximity.native.simd import (
    absolute,
    bits,
    fma,
    horizontal_min,
    lane,
    like,
    maximum,
    minimum,
    narrow,
    select,
    splat,
    splat32,
    trailing_zeros,
    widen,
)

APPROACH_REACH = 1.5
"""Half side of the cube to whose surface the start of a ray from beyond `FAR` is moved."""
SLAB_MARGIN = 2.0**-20
"""Padding of a box, local units: 1.5 times the float32 error. With a start within 2 and planes within 1 the
reciprocal errs by 2^-23 of a length of at most 3, the result by 2^-24 of it, and the constant by 2^-24 of
2."""
SLOWEST_COMPONENT = 2.0**-60
"""Minimum component of a direction in the box test: its reciprocal stays finite, and over the length of the
part it moves the ray by far less than the padding."""
START_SLACK = 2.0**-50
"""Rounding of local coordinates: a ray that starts less than this behind a face starts on it."""
PARAMETER_ROUNDING = 2.0**-51
"""Rounding of a parameter and of its difference from the start of the box test."""
FLOAT32_WIDENING = 2.0**-22
"""Rounding of that difference to float32; a branch on the sign would often be mispredicted."""


@inlined
def is_from_afar(ox, oy, oz):
    """Test whether a ray starts beyond `FAR`, to be moved by `approach`; scalars or vectors."""
    reach = maximum(maximum(absolute(ox), absolute(oy)), absolute(oz))
    return reach > like(FAR, reach)


@inlined
def approach(ox, oy, oz, dx, dy, dz):
    """Return whether a distant ray comes near the local cube, the parameter there, and the point.

    The direction's largest component is near 1. Rounding of the point is equivalent to rounding of the
    origin. Scalars or vectors of eight.
    """
    enter_x, leave_x = _cube_parameters(ox, dx)
    enter_y, leave_y = _cube_parameters(oy, dy)
    enter_z, leave_z = _cube_parameters(oz, dz)
    enter = maximum(maximum(enter_x, enter_y), enter_z)
    is_near = (enter >= like(0.0, enter)) & (enter <= minimum(minimum(leave_x, leave_y), leave_z))
    return is_near, enter, _inside(ox + enter * dx), _inside(oy + enter * dy), _inside(oz + enter * dz)


@inlined
def _cube_parameters(o, d):
    """Return the parameters at which one coordinate enters and leaves the cube; infinite if constant."""
    zero, endless = like(0.0, d), like(np.inf, d)
    is_still, is_within = d == zero, absolute(o) <= like(APPROACH_REACH, o)
    step = select(is_still, like(1.0, d), d)
    reach = select(step < zero, like(-APPROACH_REACH, step), like(APPROACH_REACH, step))
    enter = select(is_within, -endless, endless)
    return (select(is_still, enter, (-reach - o) / step), select(is_still, -enter, (reach - o) / step))


@inlined
def _not_still(d):
    """Clamp a component of a direction away from zero."""
    least = select(d < like(0.0, d), like(-SLOWEST_COMPONENT, d), like(SLOWEST_COMPONENT, d))
    return select(absolute(d) > like(SLOWEST_COMPONENT, d), d, least)


@inlined
def _inside(value):
    return minimum(maximum(value, like(-APPROACH_REACH, value)), like(APPROACH_REACH, value))


@inlined
def slab(o, d, margin):
    """Return factor and two constants that map a plane's coordinate to the entry and exit parameters.

    The constants include the error of factor, constants and result: entry is early, exit late. Scalars or
    vectors of eight: float64 in, float32 out.
    """
    step = narrow(_not_still(d))
    rate = like(1.0, step) / step
    wide = widen(rate)
    start, spread = -o * wide, margin * absolute(wide)
    return rate, narrow(start - spread), narrow(start + spread)


@inlined
def near_plane(rate):
    """Return the offset in a node from a box's lower x (y, z) to the plane that is entered first.

    *rate*: as returned by `slab`.
    """
    return NODE_UPPER if rate < 0.0 else 0


@inlined
def bound_of_parameter(best, start):
    """Return the float32 limit for bounds, counted from *start*; scalars or vectors."""
    bound = narrow(best - start + best * like(PARAMETER_ROUNDING, best))
    return bound + absolute(bound) * like(FLOAT32_WIDENING, bound)


@inlined
def open_boxes(words, base, aim, zero, best32):
    """Return entry and exit parameters of the boxes at *base*, and the mask of hits up to *best32*.

    Entry parameters are >= 0. *aim*: nine numbers, from `slab` for x, y and z. *best32* is a scalar, *zero* a
    float32x8.
    """
    rate_x, in_x, out_x, rate_y, in_y, out_y, rate_z, in_z, out_z = aim
    near_x, near_y, near_z = near_plane(rate_x), near_plane(rate_y), near_plane(rate_z)
    rate_x, rate_y, rate_z = splat32(rate_x), splat32(rate_y), splat32(rate_z)
    enter_x = fma(lower_along(words, base + near_x, 0), rate_x, splat32(in_x))
    enter_y = fma(lower_along(words, base + near_y, 1), rate_y, splat32(in_y))
    enter_z = fma(lower_along(words, base + near_z, 2), rate_z, splat32(in_z))
    leave_x = fma(upper_along(words, base - near_x, 0), rate_x, splat32(out_x))
    leave_y = fma(upper_along(words, base - near_y, 1), rate_y, splat32(out_y))
    leave_z = fma(upper_along(words, base - near_z, 2), rate_z, splat32(out_z))
    enter = maximum(maximum(enter_x, enter_y), maximum(enter_z, zero))
    leave = minimum(minimum(leave_x, leave_y), minimum(leave_z, splat32(best32)))
    return enter, leave, enter <= leave


@inlined
def steepest_axis(dx, dy, dz):
    """Return the axis of a direction's largest component, as float64; scalars or vectors of eight."""
    axis = select(absolute(dx) >= absolute(dy), like(0.0, dx), like(1.0, dx))
    return select(maximum(absolute(dx), absolute(dy)) >= absolute(dz), axis, like(2.0, dx))


@inlined
def pick(axis, x, y, z):
    """Select one of three by number; *axis* from `steepest_axis`."""
    return select(axis == like(0.0, axis), x, select(axis == like(1.0, axis), y, z))


@inlined
def corner_seen_along(origin, lean_x, lean_y, corner):
    """Shear a corner so that the ray is the z axis, from the origin on; see `ray_triangle_sides`."""
    (ox, oy, oz), (x, y, z) = origin, corner
    height = z - oz
    return fma(lean_x, height, x - ox), fma(lean_y, height, y - oy), height


@inlined
def ray_triangle_sides(origin, lean_x, lean_y, a, b, c):
    """Return the unnormalized weights of the corners, and the weighted height; scalars or vectors.

    *origin* of the ray and corners *a b c*: (x, y, z) each, axes permuted so that the ray runs mostly along
    z; *lean_x*, *lean_y* are -dx/dz, -dy/dz. A line hits if no two weights differ in sign.
    """
    ax, ay, az = corner_seen_along(origin, lean_x, lean_y, a)
    bx, by, bz = corner_seen_along(origin, lean_x, lean_y, b)
    cx, cy, cz = corner_seen_along(origin, lean_x, lean_y, c)
    u = difference_of_products(bx, cy, by, cx)
    v = difference_of_products(cx, ay, cy, ax)
    w = difference_of_products(ax, by, ay, bx)
    return u, v, w, fma(u, az, fma(v, bz, w * cz))


@inlined
def look_along(ox, oy, oz, dx, dy, dz):
    """Return a ray's numbers for `ray_triangle_sides`: axis, origin, leans, pace; scalars or vectors.

    Axes are permuted so that the ray runs mostly along z; pace is the parameter's change along z.
    """
    axis = steepest_axis(dx, dy, dz)
    speed = pick(axis, dx, dy, dz)
    pace = like(1.0, speed) / speed
    return (
        axis,
        pick(axis, oy, oz, ox),
        pick(axis, oz, ox, oy),
        pick(axis, ox, oy, oz),
        -pick(axis, dy, dz, dx) * pace,
        -pick(axis, dz, dx, dy) * pace,
        pace,
    )


@inlined
def seen_along(reals, base, view):
    """Compute `ray_triangle_sides` of the eight triangles at *base*, and the mask of hits by the line."""
    axis, px, py, pz, lean_x, lean_y, _ = view
    z = np.int64(axis)
    a, b, c = turned_corners_of_block(reals, base, z + 1 if z < 2 else 0, z - 1 if z > 0 else 2, z)
    origin = splat(px), splat(py), splat(pz)
    u, v, w, height = ray_triangle_sides(origin, splat(lean_x), splat(lean_y), a, b, c)
    zero = splat(0.0)
    is_hit = (minimum(u, minimum(v, w)) >= zero) | (maximum(u, maximum(v, w)) <= zero)
    return u, v, w, height, is_hit


@inlined
def hits_in_block(reals, base, view, longest):
    """Return the mask of the eight triangles at *base* that a ray hits up to the parameter *longest*.

    *view* from `look_along`; the ray starts within `FAR`.
    """
    u, v, w, height, is_hit = seen_along(reals, base, view)
    hits = bits(is_hit)
    if hits:
        parameters = height / (u + v + w) * splat(view[6])
        hits = bits(is_hit & (parameters >= splat(0.0)) & (parameters <= splat(longest)))
    return hits


@inlined
def first_in_block(reals, base, view, entry, best):
    """Return the first hit up to *best* in the block at *base*: t, lane (-1: none), and three weights.

    *view* from `look_along`, *entry* from `approach`.
    """
    found, first = best, np.int64(-1)
    weight_a, weight_b, weight_c = 0.0, 0.0, 0.0
    zero, pace = splat(0.0), view[6]
    u, v, w, height, is_hit = seen_along(reals, base, view)
    if bits(is_hit):
        # Without area: 0/0, which fails every comparison.
        parameters = splat(entry) + height / (u + v + w) * splat(pace)
        is_better = is_hit & (parameters >= splat(-START_SLACK)) & (parameters <= splat(best))
        if bits(is_better):
            parameters = select(is_better, maximum(parameters, zero), splat(np.inf))
            found = horizontal_min(parameters)
            first = trailing_zeros(bits(parameters <= splat(found)))
            weight_a, weight_b, weight_c = lane(u, first), lane(v, first), lane(w, first)
    return found, first, weight_a, weight_b, weight_c


@inlined
def aim_and_view(ox, oy, oz, dx, dy, dz, margin):
    """Return a ray's numbers for box tests (see `open_boxes`) and for triangle tests (see `look_along`)."""
    aim = (*slab(ox, dx, margin), *slab(oy, dy, margin), *slab(oz, dz, margin))
    return aim, look_along(ox, oy, oz, dx, dy, dz)


@inlined
def open_children(words, base, query, reach):
    """Apply `open_boxes` to the node at *base*; the query begins with the aim."""
    return open_boxes(words, base, query[0], splat32(np.float32(0.0)), reach)


@inlined
def _first_in_leaf(reals, reference, query, best):
    _, view, entry, _ = query
    _, parameter, best_slot, _ = best
    found, first, a, b, c = first_in_block(reals, BLOCK_STRIDE * ~reference, view, entry, parameter)
    slot = LANES * ~reference + first
    if first >= 0 and (found < parameter or slot < best_slot or best_slot == NO_SLOT):
        return bound_of_parameter(found, entry), found, slot, (a, b, c)
    return best


first_hit = depth_first(open_children, in_blocks(_first_in_leaf), in_order)
"""Walk for the first hit of a ray below a reference. The query: `aim_and_view`, the entry from `approach`,
and data for `into_part`; the best: a bound of boxes, parameter, slot, and unnormalized barycentric
coordinates, 0 if the initial best was not improved."""


@inlined
def aim_in_part(origin, direction):
    """Return whether a ray, in a part's frame, approaches the part, the entry from `approach`, aim and view.

    The largest component of *direction* is between 0.5 and 2. Aim and view: see `aim_and_view`.
    """
    ox, oy, oz = origin
    dx, dy, dz = direction
    is_near, entry = True, 0.0
    if is_from_afar(ox, oy, oz):
        is_near, entry, ox, oy, oz = approach(ox, oy, oz, dx, dy, dz)
    aim, view = aim_and_view(ox, oy, oz, dx, dy, dz, SLAB_MARGIN)
    return is_near, entry, aim, view


@inlined
def ray_in_part(reals, words, start, origin, direction, parameter, slot, stacks):
    """Find the `first_hit` of the ray *origin* + t *direction*, t >= 0, (x, y, z) each, in the local frame.

    The largest component of *direction* is between 0.5 and 2.
    """
    is_near, entry, aim, view = aim_in_part(origin, direction)
    # A ray that misses the cube opens no box.
    reach = bound_of_parameter(parameter, entry) if is_near else np.float32(-1.0)
    best = reach, parameter, slot, (0.0, 0.0, 0.0)
    return first_hit((reals, words), start, 0, (aim, view, entry, 0), best, stacks)


@inlined
def _first_in_part(model, part, start, query, best, stacks):
    """Update *best* with the subtree *start* of a part with a separate frame."""
    reals, words, frames, parts = model
    _, _, entry, ((x, y, z), (dx, dy, dz)) = query
    _, parameter, best_slot, _ = best
    ratio = frames[part].scale / frames[len(parts) - 1].scale
    origin = to_local(frames, parts, part, x, y, z)
    direction = direction_to_local(frames, parts, part, dx, dy, dz)
    _, found, slot, weights = ray_in_part(
        reals, words, start, origin, direction, parameter * ratio, best_slot, stacks
    )
    if slot == best_slot:
        return best
    return bound_of_parameter(found / ratio, entry), found / ratio, slot, weights


_at_leaf = in_blocks_and_parts(_first_in_leaf, _first_in_part)
first_hit_in_scene = depth_first(open_children, _at_leaf, in_order)
"""The same over all parts of a scene; the additional data are origin and direction in the scene's frame."""
first_hit_of_heeded = depth_first(open_children, _at_leaf, in_order, heed_some)
"""The same over those parts of a scene that are not ignored."""
