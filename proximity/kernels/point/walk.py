"""The closest-point walk over one part's tree.

Straight down to the nearest child, the others pushed unsorted: sorting them cost more than it saved. The
answer is the smallest computed squared distance, and among equals the lowest slot; a box is skipped only
when its bound exceeds the best. So the answer depends neither on the order of the walk nor on a bound known
beforehand.

Tried and dropped (2026-11, AVX-512): a store that compresses into memory instead of a register (1.4 times
the time: microcode); one division for the four of a triangle (no change); always the first open child
instead of the nearest (3 times the time, except with a bound that is known).
"""

import numpy as np

from proximity.kernels.geometry.box import bound_of, lanes_of_point, node_bounds_sq
from proximity.kernels.geometry.triangle import offset_of, point_triangle_distance_sq
from proximity.kernels.layout import LANES, NO_SLOT, NODE_STRIDE, STACK_SIZE
from proximity.kernels.tree.traversal import NOTHING_WAITS, descend, nearer_in_block, next_open
from proximity.native import inlined
from proximity.native.simd import (
    bits,
    load_int,
    splat,
    splat32,
)

NOTHING_SEEN = 0
"""A reference that no block has."""


@inlined
def closest_in_part(reals, words, start, px, py, pz, best_sq, best_slot, seen, stacks, at):
    """Squared distance and slot of the triangle nearest to *p*, all in the part's local frame.

    *start*: the reference to walk from, the part's root for all of it. *best_sq* and *best_slot*: what is
    known already; nothing farther is looked at. *seen*: the block they are the best of, or `NOTHING_SEEN`.
    *stacks* float32, from *at* on: `STACK_SIZE` bounds, then as many references.
    """
    point_lanes = _, wide_lanes, offset = lanes_of_point(px, py, pz)
    best32 = bound_of(best_sq, offset)
    bottom = at
    reference = start
    while True:
        if reference >= 0:
            base = NODE_STRIDE * reference
            bounds = node_bounds_sq(words, base, point_lanes)
            is_open = bounds <= splat32(best32)
            if bits(is_open):
                reference, at = descend(words, base, bounds, is_open, stacks, at)
                continue
        elif reference != seen:
            best_sq, best_slot = nearer_in_block(reals, ~reference, wide_lanes, best_sq, best_slot)
            best32 = bound_of(best_sq, offset)
        # The next that is still open.
        at = next_open(stacks, bottom, at, best32)
        if at == NOTHING_WAITS:
            return best_sq, best_slot
        reference = load_int(stacks, at + STACK_SIZE)


@inlined
def best_of_block(reals, slot, px, py, pz):
    """Squared distance from *p*, local, to the nearest triangle of the block a slot is in; its slot.

    It takes less time than one triangle alone, and a walk that starts from there need not come by again.
    """
    p = splat(px), splat(py), splat(pz)
    return nearer_in_block(reals, slot // LANES, p, np.inf, np.int64(NO_SLOT))


@inlined
def slot_distance_sq(reals, slot, px, py, pz):
    """Squared distance from *p* to the triangle at *slot*: to the bit what the walk computes for it."""
    base = offset_of(slot)
    return point_triangle_distance_sq(
        (px, py, pz),
        (reals[base], reals[base + 8], reals[base + 16]),
        (reals[base + 24], reals[base + 32], reals[base + 40]),
        (reals[base + 48], reals[base + 56], reals[base + 64]),
    )
