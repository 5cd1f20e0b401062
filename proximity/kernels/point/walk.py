"""Search for the closest point of one part, or of a whole scene.

The answer is the smallest computed squared distance, and in a tie the lowest slot. A box is pruned only if
its bound exceeds the best. So the answer depends neither on the order of the walk nor on the initial bound.

Boxes of a scene's tree are in the scene's scaled frame, which is stored in the last row of ``frames`` and
``parts``. Squared distances are compared in this frame. All scales are powers of two, so that changing frames
does not round.

Tried and dropped (2026-11, AVX-512): a store that compresses into memory instead of a register (1.4 times the
time: microcode); one division for the four of a triangle (no change); always the first open child instead of
the nearest (3 times the time, except with a known bound).
"""

import numpy as np

from proximity.kernels.geometry.box import bound_of, lanes_of_point, node_bounds_sq
from proximity.kernels.geometry.frames import ignores_some, is_alone, part_of_slot, to_local
from proximity.kernels.geometry.triangle import point_block_distance_sq, point_triangle_distance_sq
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NO_PART, NO_SLOT, ORIENTED_STRIDE
from proximity.kernels.nodes import corners_at, offset_of
from proximity.kernels.traverse.depth_first import (
    SCENE_STACKS,
    depth_first,
    fetch_ahead,
    in_blocks,
    in_blocks_and_parts,
)
from proximity.kernels.traverse.ignored_parts import heed_some
from proximity.kernels.tree.oriented_box import oriented_box_distance_sq, reach_into_boxes
from proximity.native import inlined
from proximity.native.simd import bits, horizontal_min, select, splat, splat32, trailing_zeros

NOTHING_SEEN = 0
"""A reference that is not a block."""


@inlined
def nearer_in_block(reals, block, p, best_sq, best_slot):
    """Return the squared distance and the slot of the best triangle so far, after a search in *block*.

    *p*: the point, (x, y, z) of float64x8. A triangle is better if it is nearer, or as near with a lower
    slot.
    """
    distances = point_block_distance_sq(reals, BLOCK_STRIDE * block, p)
    is_better = distances <= splat(best_sq)
    if bits(is_better):
        smallest = horizontal_min(select(is_better, distances, splat(np.inf)))
        slot = LANES * block + trailing_zeros(bits(distances <= splat(smallest)))
        if smallest < best_sq or slot < best_slot or best_slot == NO_SLOT:
            return smallest, slot
    return best_sq, best_slot


@inlined
def best_of_block(reals, slot, px, py, pz):
    """Return the squared distance from a local point to the nearest triangle of a block, and its slot.

    *slot*: any slot of the block. This is faster than for one triangle alone, and a walk that starts from the
    result can skip the block.
    """
    p = splat(px), splat(py), splat(pz)
    return nearer_in_block(reals, slot // LANES, p, np.inf, np.int64(NO_SLOT))


@inlined
def slot_distance_sq(reals, slot, px, py, pz):
    """Return the squared distance from *p* to the triangle at *slot*.

    It is bit-identical to that of the walk.
    """
    return point_triangle_distance_sq((px, py, pz), *corners_at(reals, offset_of(slot)))


@inlined
def _open_children(words, base, query, reach):
    bounds = node_bounds_sq(words, base, query[0])
    return bounds, bounds, bounds <= splat32(reach)


@inlined
def _nearer_in_leaf(reals, reference, query, best):
    (_, wide_lanes, offset), seen, _, boxes = query
    if reference == seen or _is_box_beyond(boxes, ~reference, best[1]):
        return best
    best_sq, slot = nearer_in_block(reals, ~reference, wide_lanes, best[1], best[2])
    return bound_of(best_sq, offset), best_sq, slot


@inlined
def _boxes_of(model, row, p, offset):
    """Return what a walk of *row* needs to test oriented boxes.

    It is whether they are tested, the words, the offset of the boxes, and the point in float32. They give no
    bound for a far point, see `far_offset_sq`.
    """
    (x, y, z), is_asked = p, model.parts[row].is_oblique != 0 and offset <= 0.0
    return is_asked, model.words, model.parts[row].block_boxes, (np.float32(x), np.float32(y), np.float32(z))


@inlined
def _is_box_beyond(boxes, block, best_sq):
    """Test whether the oriented box of a block is farther away than the best."""
    is_asked, words, first, (x, y, z) = boxes
    at = first + ORIENTED_STRIDE * block
    return is_asked and oriented_box_distance_sq(words, at, x, y, z) > reach_into_boxes(best_sq)


_walk_part = depth_first(_open_children, in_blocks(_nearer_in_leaf, fetch_ahead))


@inlined
def closest_in_part(model, part, start, p, best_sq, best_slot, seen, stacks):
    """Find the triangle of a part that is nearest to a local point. Return its squared distance and its slot.

    *p*: (x, y, z). *start*: the first reference, which is the part's root for the whole part. *best_sq*,
    *best_slot*: the initial best; farther triangles are pruned. *seen*: the block already searched for it, or
    `NOTHING_SEEN`.
    """
    lanes = lanes_of_point(p[0], p[1], p[2])
    best = bound_of(best_sq, lanes[2]), best_sq, best_slot
    query = lanes, seen, p, _boxes_of(model, part, p, lanes[2])
    _, best_sq, best_slot = _walk_part(model, start, 0, query, best, stacks)
    return best_sq, best_slot


@inlined
def _nearer_in_part(model, part, start, query, best, stacks):
    """Update *best* by the subtree *start* of a part with a separate frame."""
    _, _, frames, parts = model
    (_, _, offset), seen, (x, y, z), _ = query
    _, best_sq, best_slot = best
    ratio_sq = (frames[part].scale / frames[len(parts) - 1].scale) ** 2
    p = to_local(frames, parts, part, x, y, z)
    found_sq, slot = closest_in_part(model, part, start, p, best_sq * ratio_sq, best_slot, seen, stacks)
    if slot == best_slot:
        return best
    return bound_of(found_sq / ratio_sq, offset), found_sq / ratio_sq, slot


_at_leaf = in_blocks_and_parts(_nearer_in_leaf, _nearer_in_part, fetch_ahead)
_walk_scene, _walk_heeded = (
    depth_first(_open_children, _at_leaf),
    depth_first(_open_children, _at_leaf, heed=heed_some),
)


@inlined
def nearest_in_scene(model, point, best_sq, best_part, best_slot, seen, stacks):
    """Find the surface of a scene that is nearest to a point in its frame.

    Return its squared distance (scene's scaled frame), part and slot. The initial best is the last answer, or
    a limit with `NO_PART`. *seen*: as in `closest_in_part`. Ties go to the lower part, then to the lower
    slot.
    """
    _, words, frames, parts = model
    x, y, z = point
    if is_alone(parts):
        p = to_local(frames, parts, 0, x, y, z)
        best_sq, best_slot = closest_in_part(model, 0, parts[0].root, p, best_sq, best_slot, seen, stacks)
        return best_sq, np.int64(0) if best_slot >= 0 else best_part, best_slot
    p = to_local(frames, parts, len(parts) - 1, x, y, z)
    lanes = lanes_of_point(p[0], p[1], p[2])
    best = bound_of(best_sq, lanes[2]), best_sq, best_slot
    query = lanes, seen, point, _boxes_of(model, len(parts) - 1, p, lanes[2])
    root = parts[len(parts) - 1].root
    if ignores_some(parts):
        _, best_sq, best_slot = _walk_heeded(model, root, SCENE_STACKS, query, best, stacks)
    else:
        _, best_sq, best_slot = _walk_scene(model, root, SCENE_STACKS, query, best, stacks)
    if best_slot >= 0:
        best_part = part_of_slot(words, parts, best_slot)
    return best_sq, best_part, best_slot


@inlined
def nearest_from_block(model, point, limit_sq, part, slot, stacks):
    """Return the result of `nearest_in_scene`, searched from the block of the previous answer on."""
    reals, _, frames, parts = model
    x, y, z = point
    best_sq, seen = limit_sq, np.int64(NOTHING_SEEN)
    if slot >= 0:
        seen = ~(slot // LANES)
        px, py, pz = to_local(frames, parts, part, x, y, z)
        ratio = frames[part].scale / frames[len(parts) - 1].scale
        best_sq, slot = best_of_block(reals, slot, px, py, pz)
        best_sq /= ratio * ratio
        if not best_sq <= limit_sq:
            best_sq, part, slot = limit_sq, np.int64(NO_PART), np.int64(NO_SLOT)
    return nearest_in_scene(model, point, best_sq, part, slot, seen, stacks)
