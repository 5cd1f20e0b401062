"""The closest-point walk over one part, and over a whole scene.

The answer is the smallest computed squared distance, and among equals the lowest slot; a box is skipped only
when its bound exceeds the best. So the answer depends neither on the order of the walk nor on a bound known
beforehand.

The boxes of a scene's tree are in the scene's own scaled frame, kept in the row behind the last part's in
``frames`` and ``parts``; squared distances are compared there, and all scales are powers of two, so that
nothing is rounded from frame to frame.

Tried and dropped (2026-11, AVX-512): a store that compresses into memory instead of a register (1.4 times
the time: microcode); one division for the four of a triangle (no change); always the first open child
instead of the nearest (3 times the time, except with a bound that is known).
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
"""A reference that no block has."""


@inlined
def nearer_in_block(reals, block, p, best_sq, best_slot):
    """Squared distance and slot of the best so far or, nearer or of a lower slot, a triangle of *block*.

    *p*: the point, (x, y, z) of float64x8.
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
    """Squared distance from *p*, local, to the nearest triangle of the block a slot is in; its slot.

    It takes less time than one triangle alone, and a walk that starts from there need not come by again.
    """
    p = splat(px), splat(py), splat(pz)
    return nearer_in_block(reals, slot // LANES, p, np.inf, np.int64(NO_SLOT))


@inlined
def slot_distance_sq(reals, slot, px, py, pz):
    """Squared distance from *p* to the triangle at *slot*: to the bit what the walk computes for it."""
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
    """Whether oriented boxes are looked at in a walk of *row*; words, where they begin, the point in float32.

    They tell nothing about a point that is far, see `far_offset_sq`.
    """
    (x, y, z), is_asked = p, model.parts[row].is_oblique != 0 and offset <= 0.0
    return is_asked, model.words, model.parts[row].block_boxes, (np.float32(x), np.float32(y), np.float32(z))


@inlined
def _is_box_beyond(boxes, block, best_sq):
    """Whether a block is farther than the best, as its oriented box tells."""
    is_asked, words, first, (x, y, z) = boxes
    at = first + ORIENTED_STRIDE * block
    return is_asked and oriented_box_distance_sq(words, at, x, y, z) > reach_into_boxes(best_sq)


_walk_part = depth_first(_open_children, in_blocks(_nearer_in_leaf, fetch_ahead))


@inlined
def closest_in_part(model, part, start, p, best_sq, best_slot, seen, stacks):
    """Squared distance and slot of the triangle nearest to *p*, (x, y, z), all in the part's local frame.

    *start*: the reference to walk from, the part's root for all of it. *best_sq* and *best_slot*: what is
    known already; nothing farther is looked at. *seen*: the block they are the best of, or `NOTHING_SEEN`.
    """
    lanes = lanes_of_point(p[0], p[1], p[2])
    best = bound_of(best_sq, lanes[2]), best_sq, best_slot
    query = lanes, seen, p, _boxes_of(model, part, p, lanes[2])
    _, best_sq, best_slot = _walk_part(model, start, 0, query, best, stacks)
    return best_sq, best_slot


@inlined
def _nearer_in_part(model, part, start, query, best, stacks):
    """The best, with what is below *start* in a part that has a frame of its own."""
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
    """Squared distance (scene's scaled frame), part and slot of the surface nearest to a point, (x, y, z).

    What is known already goes in as best; with `NO_PART` it is the limit. *seen*: as in `closest_in_part`.
    Ties go to the lower part, then to the lower slot.
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
    """`nearest_in_scene`, starting from the block of what the point before has found, if anything."""
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
