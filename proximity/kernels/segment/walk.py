"""Traversal of one part, or of a scene, for the smallest distance from a segment to the triangles.

It is the same as the traversal for a point (see `point.walk`), with a bound for segments. The result is the
smallest computed squared distance. In a tie the lowest slot is chosen. Among crossings the first along the
segment is chosen, and once one is known only earlier ones are searched. The result does not depend on the
order of traversal.
"""

import numpy as np

from proximity.kernels.geometry.closest_feature import read_corners
from proximity.kernels.geometry.frames import ignores_some, is_alone, part_of_slot, to_local
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NO_PART, NO_SLOT
from proximity.kernels.nodes import turned_corners_of_block
from proximity.kernels.segment.box import node_bounds_sq, open_bound
from proximity.kernels.segment.plan import (
    make_plan,
    ordered_axes,
)
from proximity.kernels.segment.triangle import (
    segment_on_triangle,
    segment_triangle_distance_sq,
)
from proximity.kernels.traverse.depth_first import SCENE_STACKS, depth_first, in_blocks, in_blocks_and_parts
from proximity.kernels.traverse.ignored_parts import heed_some
from proximity.native import inlined, kernel
from proximity.native.simd import bits, horizontal_min, select, splat, splat32, trailing_zeros


@inlined
def segment_block_distance_sq(reals, base, plan):
    """Return squared distances from the planned segment to the eight triangles at *base*."""
    i, j, k = ordered_axes(plan)
    px, py, pz = splat(plan.start[i]), splat(plan.start[j]), splat(plan.start[k])
    dx, dy, dz = (
        splat(plan.end[i]) - px,
        splat(plan.end[j]) - py,
        splat(plan.end[k]) - pz,
    )
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = turned_corners_of_block(reals, base, i, j, k)
    return segment_triangle_distance_sq(
        (ax - px, ay - py, az - pz),
        (bx - px, by - py, bz - pz),
        (cx - px, cy - py, cz - pz),
        (dx, dy, dz),
        splat(plan.slope_x),
        splat(plan.slope_y),
        splat(plan.per_length_sq),
    )


@kernel
def segment_in_block(reals, block, plan, best_sq, best_fraction, best_slot, witness):
    """Return the nearest of the triangles of a block and the one known before.

    It is given by its squared distance (local), its fraction and its slot. The fraction is relative to the
    whole segment; it is inf, on input and output, unless the distance is 0. *witness*: scratch memory.
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
        fraction = plan.low + witness.fraction * (plan.high - plan.low)
        is_first = fraction < best_fraction or (
            fraction == best_fraction and (slot < best_slot or best_slot == NO_SLOT)
        )
        if best_sq > 0.0 or is_first:
            best_sq, best_fraction, best_slot = 0.0, fraction, slot
    return best_sq, best_fraction, best_slot


@inlined
def _open_children(words, base, query, reach):
    plan, probe, is_far, _, _ = query
    bounds = node_bounds_sq(words, base, plan, probe, is_far)
    return bounds, bounds, bounds <= splat32(reach)


@inlined
def _nearer_in_leaf(reals, reference, query, best):
    plan, _, _, witness, _ = query
    best_sq, fraction, slot = segment_in_block(reals, ~reference, plan, best[1], best[2], best[3], witness)
    return open_bound(plan, best_sq, fraction), best_sq, fraction, slot


_walk_part = depth_first(_open_children, in_blocks(_nearer_in_leaf))


@kernel
def segment_in_part(reals, words, start, plan, probe, best_sq, best_fraction, best_slot, witness, stacks):
    """Return the result of `segment_in_block` for all blocks below *start*.

    *start*, *best_sq*, *best_slot*: as for `point.walk.closest_in_part`. *plan*, *probe*: from
    `plan.make_plan`.
    """
    query = plan, probe, plan.is_far != 0, witness, 0
    best = open_bound(plan, best_sq, best_fraction), best_sq, best_fraction, best_slot
    _, best_sq, best_fraction, best_slot = _walk_part((reals, words), start, 0, query, best, stacks)
    return best_sq, best_fraction, best_slot


@kernel
def plan_in_part(frames, parts, part, segment, plan, probe):
    """Compute the plan of a segment in the frame of *part*, unless it is already known.

    *segment*: six coordinates in the scene's frame.
    """
    if plan.part == part:
        return
    sx, sy, sz = to_local(frames, parts, part, segment[0], segment[1], segment[2])
    ex, ey, ez = to_local(frames, parts, part, segment[3], segment[4], segment[5])
    make_plan(plan, probe, sx, sy, sz, ex, ey, ez)
    plan.part = part


@inlined
def _nearer_in_part(model, part, start, query, best, stacks):
    """Update the best result by the blocks below *start* in a part with a separate frame, and return it."""
    reals, words, frames, parts = model
    scene_plan, _, _, witness, (segment, plan, probe) = query
    _, best_sq, fraction, slot = best
    plan_in_part(frames, parts, part, segment, plan, probe)
    ratio_sq = (frames[part].scale / frames[len(parts) - 1].scale) ** 2
    best_sq, fraction, slot = segment_in_part(
        reals, words, start, plan, probe, best_sq * ratio_sq, fraction, slot, witness, stacks
    )
    best_sq /= ratio_sq
    return open_bound(scene_plan, best_sq, fraction), best_sq, fraction, slot


_at_leaf = in_blocks_and_parts(_nearer_in_leaf, _nearer_in_part)
_walk_scene, _walk_heeded = (
    depth_first(_open_children, _at_leaf),
    depth_first(_open_children, _at_leaf, heed=heed_some),
)


@kernel
def segment_in_scene(model, segment, best_sq, known_slot, plans, probes, witness, stacks):
    """Find the surface of a scene that is nearest to a segment.

    Return its squared distance (scene's scaled frame), part and slot. *best_sq* is the limit. *known_slot*: a
    triangle that may be near, or `NO_SLOT`; it changes the cost, not the result. Ties go to the lower part,
    then to the lower slot; the first of several crossings along the segment counts. Scratch memory: *plans*
    (2,) records, whose first is left as the plan of some part, *probes* (2,), *witness*, *stacks*.
    """
    reals, words, frames, parts = model
    scene = len(parts) - 1
    plan, probe, scene_plan, scene_probe = plans[0], probes[0], plans[1], probes[1]
    plan.part = scene_plan.part = NO_PART
    fraction, slot = np.inf, np.int64(NO_SLOT)
    found_part = np.int64(0)
    if known_slot >= 0:
        found_part = part_of_slot(words, parts, known_slot)
        plan_in_part(frames, parts, found_part, segment, plan, probe)
        ratio_sq = (frames[found_part].scale / frames[scene].scale) ** 2
        best_sq, fraction, slot = segment_in_block(
            reals, known_slot // LANES, plan, best_sq * ratio_sq, fraction, slot, witness
        )
        best_sq /= ratio_sq
    if is_alone(parts):
        plan_in_part(frames, parts, found_part, segment, plan, probe)
        best_sq, _, slot = segment_in_part(
            reals, words, parts[0].root, plan, probe, best_sq, fraction, slot, witness, stacks
        )
        return best_sq, found_part, slot
    plan_in_part(frames, parts, scene, segment, scene_plan, scene_probe)
    is_far = scene_plan.is_far != 0
    query = scene_plan, scene_probe, is_far, witness, (segment, plan, probe)
    best = open_bound(scene_plan, best_sq, fraction), best_sq, fraction, slot
    if ignores_some(parts):
        _, best_sq, _, slot = _walk_heeded(model, parts[scene].root, SCENE_STACKS, query, best, stacks)
    else:
        _, best_sq, _, slot = _walk_scene(model, parts[scene].root, SCENE_STACKS, query, best, stacks)
    if slot >= 0:
        found_part = part_of_slot(words, parts, slot)
    return best_sq, found_part, slot
