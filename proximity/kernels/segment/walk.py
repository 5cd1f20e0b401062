"""The segment walk over one part's tree: the smallest distance between a segment and the triangles.

As the walk for a point (see `point.walk`), with a bound for segments. The answer is the smallest computed
squared distance and among equals the lowest slot; of several crossings the one that is first along the
segment, and once one is known only what comes before it is looked at. So nothing depends on the order of the
walk.
"""

import numpy as np

from proximity.kernels.geometry.closest_feature import read_corners
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NO_SLOT, NODE_STRIDE, STACK_SIZE
from proximity.kernels.segment.box import node_bounds_sq, open_bound
from proximity.kernels.segment.plan import (
    PLAN_END,
    PLAN_HIGH,
    PLAN_IS_FAR,
    PLAN_LOW,
    PLAN_PER_LENGTH_SQ,
    PLAN_SLOPE_X,
    PLAN_SLOPE_Y,
    PLAN_START,
    ordered_axes,
)
from proximity.kernels.segment.triangle import (
    WITNESS_FRACTION,
    segment_on_triangle,
    segment_triangle_distance_sq,
)
from proximity.kernels.tree.traversal import NOTHING_WAITS, descend, next_open
from proximity.native import inlined, kernel
from proximity.native.simd import (
    bits,
    horizontal_min,
    load,
    load_int,
    select,
    splat,
    splat32,
    trailing_zeros,
)


@inlined
def segment_block_distance_sq(reals, base, plan):
    """Squared distances from the planned segment to the eight triangles at *base*."""
    i, j, k = ordered_axes(plan)
    px, py, pz = splat(plan[PLAN_START + i]), splat(plan[PLAN_START + j]), splat(plan[PLAN_START + k])
    dx, dy, dz = (
        splat(plan[PLAN_END + i]) - px,
        splat(plan[PLAN_END + j]) - py,
        splat(plan[PLAN_END + k]) - pz,
    )
    x, y, z = base + 8 * i, base + 8 * j, base + 8 * k
    return segment_triangle_distance_sq(
        (load(reals, x) - px, load(reals, y) - py, load(reals, z) - pz),
        (load(reals, x + 24) - px, load(reals, y + 24) - py, load(reals, z + 24) - pz),
        (load(reals, x + 48) - px, load(reals, y + 48) - py, load(reals, z + 48) - pz),
        (dx, dy, dz),
        splat(plan[PLAN_SLOPE_X]),
        splat(plan[PLAN_SLOPE_Y]),
        splat(plan[PLAN_PER_LENGTH_SQ]),
    )


@kernel
def segment_in_block(reals, block, plan, best_sq, best_fraction, best_slot, witness):
    """Squared distance (local), fraction and slot of the nearest triangle: in *block*, or the one known.

    The fraction is of the whole segment and counts where the distance is 0; elsewhere it is inf, in and out.
    *witness*: scratch.
    """
    distances = segment_block_distance_sq(reals, BLOCK_STRIDE * block, plan)
    is_better = distances <= splat(best_sq)
    if not bits(is_better):
        return best_sq, best_fraction, best_slot
    smallest = horizontal_min(select(is_better, distances, splat(np.inf)))
    found = bits(distances <= splat(smallest))
    if smallest > 0.0:
        slot = LANES * block + trailing_zeros(found)
        if smallest < best_sq or slot < best_slot or best_slot == NO_SLOT:
            return smallest, best_fraction, slot
        return best_sq, best_fraction, best_slot
    while found:
        slot = LANES * block + trailing_zeros(found)
        found &= found - 1
        read_corners(reals, slot, witness)
        segment_on_triangle(plan, witness)
        fraction = plan[PLAN_LOW] + witness[WITNESS_FRACTION] * (plan[PLAN_HIGH] - plan[PLAN_LOW])
        is_first = fraction < best_fraction or (
            fraction == best_fraction and (slot < best_slot or best_slot == NO_SLOT)
        )
        if best_sq > 0.0 or is_first:
            best_sq, best_fraction, best_slot = 0.0, fraction, slot
    return best_sq, best_fraction, best_slot


@kernel
def segment_in_part(reals, words, start, plan, probe, best_sq, best_fraction, best_slot, witness, stacks, at):
    """The same of all blocks below *start*.

    *start*, *best_sq*, *best_slot*, *stacks*, *at*: as for `point.walk.closest_in_part`. *plan*, *probe*:
    from `plan.make_plan`.
    """
    is_far = plan[PLAN_IS_FAR] != 0.0
    best32 = open_bound(plan, best_sq, best_fraction)
    bottom = at
    reference = start
    while True:
        if reference >= 0:
            base = NODE_STRIDE * reference
            bounds = node_bounds_sq(words, base, plan, probe, is_far)
            is_open = bounds <= splat32(best32)
            if bits(is_open):
                reference, at = descend(words, base, bounds, is_open, stacks, at)
                continue
        else:
            best_sq, best_fraction, best_slot = segment_in_block(
                reals, ~reference, plan, best_sq, best_fraction, best_slot, witness
            )
            best32 = open_bound(plan, best_sq, best_fraction)
        # The next that is still open.
        at = next_open(stacks, bottom, at, best32)
        if at == NOTHING_WAITS:
            return best_sq, best_fraction, best_slot
        reference = load_int(stacks, at + STACK_SIZE)
