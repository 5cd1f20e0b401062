"""The surface of a whole scene that is nearest to a point.

The scene's tree has, for leaves, *entries*: subtrees of parts, as (part, reference) pairs. Its boxes are in
the scene's own scaled frame, kept in the row behind the last part's in ``frames`` and ``parts``; squared
distances are compared there, and all scales are powers of two, so that nothing is rounded from
frame to frame.
"""

import numpy as np

from proximity.kernels.geometry.box import bound_of, lanes_of_point, node_bounds_sq
from proximity.kernels.geometry.frames import is_alone, part_of_slot, to_local
from proximity.kernels.layout import (
    ENTRY,
    FRAME_SCALE,
    NODE_STRIDE,
    PART_IS_FUSED,
    PART_ROOT,
    SCENE_ENTRIES,
    STACK_SIZE,
)
from proximity.kernels.point.walk import closest_in_part
from proximity.kernels.tree.traversal import NOTHING_WAITS, descend, nearer_in_block, next_open
from proximity.native import inlined
from proximity.native.simd import (
    bits,
    load_int,
    splat32,
)


@inlined
def nearest_in_scene(reals, words, frames, parts, x, y, z, best_sq, best_part, best_slot, seen, stacks):
    """Squared distance (scene's scaled frame), part and slot of the surface nearest to a point.

    What is known already goes in as best; with `NO_PART` it is the limit. *seen*: as in `closest_in_part`.
    Ties go to the lower part, then to the lower slot. *stacks*: float32, four times `STACK_SIZE`.

    Parts in the scene's own frame are walked as if they were one tree; the others by a walk of their own.
    """
    scene = len(parts) - 1
    scene_scale = frames[scene, FRAME_SCALE]
    if is_alone(parts):
        px, py, pz = to_local(frames, parts, 0, x, y, z)
        best_sq, best_slot = closest_in_part(
            reals, words, parts[0, PART_ROOT], px, py, pz, best_sq, best_slot, seen, stacks, 0
        )
        return best_sq, np.int64(0) if best_slot >= 0 else best_part, best_slot

    px, py, pz = to_local(frames, parts, scene, x, y, z)
    point_lanes = _, wide_lanes, offset = lanes_of_point(px, py, pz)
    entries = parts[scene, SCENE_ENTRIES]
    best32 = bound_of(best_sq, offset)
    bottom = 2 * STACK_SIZE
    at = bottom
    reference = parts[scene, PART_ROOT]
    found_part = best_part
    while True:
        if reference >= 0:
            base = NODE_STRIDE * reference
            bounds = node_bounds_sq(words, base, point_lanes)
            is_open = bounds <= splat32(best32)
            if bits(is_open):
                reference, at = descend(words, base, bounds, is_open, stacks, at)
                continue
        elif ~reference < ENTRY:
            if reference != seen:
                best_sq, best_slot = nearer_in_block(reals, ~reference, wide_lanes, best_sq, best_slot)
                best32 = bound_of(best_sq, offset)
        else:
            entry = entries + 2 * (~reference - ENTRY)
            part, start = load_int(words, entry), load_int(words, entry + 1)
            if parts[part, PART_IS_FUSED]:
                reference = start
                continue
            qx, qy, qz = to_local(frames, parts, part, x, y, z)
            ratio_sq = (frames[part, FRAME_SCALE] / scene_scale) ** 2
            found_sq, slot = closest_in_part(
                reals, words, start, qx, qy, qz, best_sq * ratio_sq, best_slot, seen, stacks, 0
            )
            if slot != best_slot:
                best_sq, best_slot = found_sq / ratio_sq, slot
                best32 = bound_of(best_sq, offset)
        at = next_open(stacks, bottom, at, best32)
        if at == NOTHING_WAITS:
            if best_slot >= 0:
                found_part = part_of_slot(words, parts, best_slot)
            return best_sq, found_part, best_slot
        reference = load_int(stacks, at + STACK_SIZE)
