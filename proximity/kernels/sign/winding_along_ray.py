"""Decision between inside and outside of a closed part, by the faces that a ray along an axis crosses.

The ray goes to the nearest side of the part's box. The winding number is the number of faces through which
the ray leaves, minus the number of faces through which it enters. The traversal takes a few steps where the
expansion of `winding_number` takes a hundred, and a tenth of its steps among fans of long thin triangles. The
result is exact, up to rounding, for every point off the surface: a projected edge contributes bit-identical
values of opposite sign to its two faces, so that no ray passes between them.

Source: the half-open rule for edges of Haines 1994, "Point in polygon strategies".
"""

import numpy as np

from proximity.kernels.layout import BLOCK_STRIDE, CORNER_STRIDE, LANES, NODE_STRIDE, STACK_SIZE
from proximity.kernels.nodes import lower_along, upper_along, used_lanes
from proximity.kernels.stack_arrays import stack_f32
from proximity.kernels.traverse.depth_first import through_all
from proximity.native import inlined, kernel
from proximity.native.simd import (
    bits,
    count_bits,
    horizontal_min,
    load,
    maximum,
    minimum,
    select,
    splat,
    splat32,
    widen,
)


@kernel
def _turns_of_block(reals, base, ray):
    """Return how many faces of a block the ray leaves through, minus how many it enters through."""
    axis, u_axis, v_axis, sign, along, across_u, across_v = ray
    zero, to_sign = splat(0.0), splat(sign)
    u, v = base + LANES * u_axis, base + LANES * v_axis
    au, av = load(reals, u) - across_u, load(reals, v) - across_v
    bu, bv = load(reals, u + CORNER_STRIDE) - across_u, load(reals, v + CORNER_STRIDE) - across_v
    cu, cv = load(reals, u + 2 * CORNER_STRIDE) - across_u, load(reals, v + 2 * CORNER_STRIDE) - across_v
    # Products and differences without fma: exactly opposite numbers for the two faces of an edge.
    ab, bc, ca = au * bv - av * bu, bu * cv - bv * cu, cu * av - cv * au
    turn = _turn_of_edge(av, bv, ab) + _turn_of_edge(bv, cv, bc) + _turn_of_edge(cv, av, ca)
    if not bits((turn > zero) | (turn < zero)):
        return np.int64(0)
    at = base + LANES * axis
    a = to_sign * (load(reals, at) - along)
    b = to_sign * (load(reals, at + CORNER_STRIDE) - along)
    c = to_sign * (load(reals, at + 2 * CORNER_STRIDE) - along)
    height = turn * (bc * a + ca * b + ab * c)
    nearest, farthest = minimum(a, minimum(b, c)), maximum(a, maximum(b, c))
    is_ahead = (nearest > zero) | ((farthest > zero) & (height > zero))
    turn = to_sign * turn
    return np.int64(count_bits(bits(is_ahead & (turn > zero)))) - np.int64(
        count_bits(bits(is_ahead & (turn < zero)))
    )


@inlined
def _turn_of_edge(av, bv, cross):
    """Return 1 if an edge passes the origin upwards on its right, -1 if it passes downwards, otherwise 0."""
    zero, one = splat(0.0), splat(1.0)
    is_up = (av <= zero) & (bv > zero) & (cross > zero)
    is_down = (av > zero) & (bv <= zero) & (cross < zero)
    return select(is_up, one, select(is_down, splat(-1.0), zero))


@inlined
def _open_children(words, node, ray, total):
    """Return the children of a node that the ray may intersect, and count one step."""
    axis, u_axis, v_axis, sign, along, across_u, across_v = ray
    base = NODE_STRIDE * node
    far = widen(upper_along(words, base, axis) if sign > 0.0 else lower_along(words, base, axis))
    is_met = (far >= along) if sign > 0.0 else (far <= along)
    is_met = is_met & (widen(lower_along(words, base, u_axis)) <= across_u)
    is_met = is_met & (widen(lower_along(words, base, v_axis)) <= across_v)
    is_met = is_met & (widen(upper_along(words, base, u_axis)) >= across_u)
    is_met = is_met & (widen(upper_along(words, base, v_axis)) >= across_v)
    return (total[0], total[1] + 1), is_met


@inlined
def _turn_by_leaf(reals, reference, ray, total):
    return total[0] + _turns_of_block(reals, BLOCK_STRIDE * ~reference, ray), total[1] + 1


_walk_ahead = through_all(_open_children, _turn_by_leaf)


@kernel
def _turns_ahead(reals, words, root, axis, sign, px, py, pz):
    """Return the winding number along a ray from *p* and the number of steps.

    The ray is parallel to an axis, with the direction *sign*.
    """
    u_axis, v_axis = (axis + 1) % 3, (axis + 2) % 3
    own = px if axis == 0 else (py if axis == 1 else pz)
    across_u = px if u_axis == 0 else (py if u_axis == 1 else pz)
    across_v = px if v_axis == 0 else (py if v_axis == 1 else pz)
    ray = axis, u_axis, v_axis, sign, splat(own), splat(across_u), splat(across_v)
    return _walk_ahead(reals, words, root, ray, (np.int64(0), np.int64(0)), stack_f32(STACK_SIZE))


@inlined
def winding_along_ray(reals, words, root, px, py, pz):
    """Return the winding number of a closed part around a local point.

    Return also how many nodes and leaves were visited.
    """
    base = NODE_STRIDE * root
    is_used = used_lanes(words, base)
    none = splat32(np.float32(np.inf))
    axis, sign, least = 0, 1.0, np.inf
    for k in range(3):
        p = px if k == 0 else (py if k == 1 else pz)
        below = p - horizontal_min(select(is_used, lower_along(words, base, k), none))
        above = -horizontal_min(select(is_used, -upper_along(words, base, k), none)) - p
        if below < least:
            axis, sign, least = k, -1.0, below
        if above < least:
            axis, sign, least = k, 1.0, above
    return _turns_ahead(reals, words, root, axis, sign, px, py, pz)
