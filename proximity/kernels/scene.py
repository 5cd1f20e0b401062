"""From frame to frame, and the surface of a whole scene that is nearest to a point.

The scene's tree has, for leaves, *entries*: subtrees of parts, as (part, reference) pairs. Its boxes are in
the scene's own scaled frame, kept in the row behind the last part's in ``frames`` and ``parts``; squared
distances are compared there, and all scales are powers of two, so that nothing is rounded on the way from
frame to frame.
"""

import numpy as np

from proximity.kernels.box import bound_of, far_offset_sq, node_bounds_sq
from proximity.kernels.compiling import inlined
from proximity.kernels.descent import NOTHING_WAITS, descend, nearer_in_block, next_open
from proximity.kernels.layout import (
    BLOCK_NOTES,
    CENTRE,
    ENTRY,
    FACES,
    FOLDED_AT,
    IS_FUSED,
    IS_HIDDEN,
    IS_TURNED,
    LANES,
    NODE_STRIDE,
    ROOT,
    ROTATION,
    SCALE,
    STACK_SIZE,
    TRANSLATION,
)
from proximity.kernels.point import closest_in_part
from proximity.simd import (
    bits,
    like,
    load_int,
    maximum,
    minimum,
    splat,
    splat32,
)

ROUNDING = 1e-13
"""More than what distances and ways are off by rounding, relative and in sizes of the scene."""
FARTHEST = 1e100
"""Local coordinates beyond this are pulled in: the direction stays, the square does not overflow."""


@inlined
def can_be_asked(frames, parts, x, y, z):
    """Whether a point is finite, and not so far that squares overflow."""
    reach = FARTHEST / frames[len(parts) - 1, SCALE]
    return abs(x) <= reach and abs(y) <= reach and abs(z) <= reach


@inlined
def is_alone(parts):
    """Whether there is one part, to be found: then it is asked itself, without a tree over parts."""
    return len(parts) == 2 and not parts[0, IS_HIDDEN]


@inlined
def direction_to_local(frames, parts, part, x, y, z):
    """A direction of the scene's frame in that of *part*, as long; scalars or vectors of eight."""
    if parts[part, IS_TURNED]:
        return (
            _along(frames, part, 0, x, y, z),
            _along(frames, part, 1, x, y, z),
            _along(frames, part, 2, x, y, z),
        )
    return x, y, z


@inlined
def _along(frames, part, column, x, y, z):
    at = ROTATION + column
    return (
        like(frames[part, at], x) * x + like(frames[part, at + 3], y) * y + like(frames[part, at + 6], z) * z
    )


@inlined
def direction_to_scene(frames, parts, part, x, y, z):
    """A direction of the frame of *part* in the scene's frame."""
    if parts[part, IS_TURNED]:
        return (
            frames[part, ROTATION] * x + frames[part, ROTATION + 1] * y + frames[part, ROTATION + 2] * z,
            frames[part, ROTATION + 3] * x + frames[part, ROTATION + 4] * y + frames[part, ROTATION + 5] * z,
            frames[part, ROTATION + 6] * x + frames[part, ROTATION + 7] * y + frames[part, ROTATION + 8] * z,
        )
    return x, y, z


@inlined
def to_local(frames, parts, part, x, y, z):
    """A point of the scene's frame in the local frame of *part*; scalars or vectors of eight."""
    dx = x - like(frames[part, TRANSLATION], x)
    dy = y - like(frames[part, TRANSLATION + 1], y)
    dz = z - like(frames[part, TRANSLATION + 2], z)
    dx, dy, dz = direction_to_local(frames, parts, part, dx, dy, dz)
    scale = like(frames[part, SCALE], x)
    return (
        _pull_in((dx - like(frames[part, CENTRE], x)) * scale),
        _pull_in((dy - like(frames[part, CENTRE + 1], y)) * scale),
        _pull_in((dz - like(frames[part, CENTRE + 2], z)) * scale),
    )


@inlined
def rounding_at(frames, x, y, z):
    """More than what a distance from a point of the scene's frame is off by rounding, m."""
    return ROUNDING * (1.0 / frames[len(frames) - 1, SCALE] + abs(x) + abs(y) + abs(z))


@inlined
def _pull_in(value):
    # In this order NaN stays.
    return minimum(like(FARTHEST, value), maximum(like(-FARTHEST, value), value))


@inlined
def turn_to_scene(frames, parts, part, source, at, target, to):
    """Turn a direction from the part's frame to the scene's."""
    x, y, z = direction_to_scene(frames, parts, part, source[at], source[at + 1], source[at + 2])
    target[to], target[to + 1], target[to + 2] = x, y, z


@inlined
def to_scene(frames, parts, part, source, at, target, to):
    """Take a point from the part's local frame to the scene's."""
    for axis in range(3):
        target[to + axis] = source[at + axis] / frames[part, SCALE] + frames[part, CENTRE + axis]
    turn_to_scene(frames, parts, part, target, to, target, to)
    for axis in range(3):
        target[to + axis] += frames[part, TRANSLATION + axis]


@inlined
def nearest_in_scene(reals, words, frames, parts, x, y, z, best_sq, best_part, best_slot, seen, stacks):
    """Squared distance (scene's scaled frame), part and slot of the surface nearest to a point.

    What is known already goes in as best; with `NO_PART` it is the limit. *seen*: as in `closest_in_part`.
    Ties go to the lower part, then to the lower slot. *stacks*: float32, four times `STACK_SIZE`.

    Parts in the scene's own frame are walked as if they were one tree; the others by a walk of their own.
    """
    scene = len(parts) - 1
    scene_scale = frames[scene, SCALE]
    if is_alone(parts):
        px, py, pz = to_local(frames, parts, 0, x, y, z)
        best_sq, best_slot = closest_in_part(
            reals, words, parts[0, ROOT], px, py, pz, best_sq, best_slot, seen, stacks, 0
        )
        return best_sq, np.int64(0) if best_slot >= 0 else best_part, best_slot

    px, py, pz = to_local(frames, parts, scene, x, y, z)
    wide_x, wide_y, wide_z = splat(px), splat(py), splat(pz)
    vx, vy, vz = splat32(np.float32(px)), splat32(np.float32(py)), splat32(np.float32(pz))
    offset = far_offset_sq(px, py, pz)
    is_far = offset > 0.0
    offsets = splat(offset)
    entries = parts[scene, FACES]
    best32 = bound_of(best_sq, offset)
    bottom = 2 * STACK_SIZE
    at = bottom
    reference = parts[scene, ROOT]
    here = best_part
    while True:
        if reference >= 0:
            base = NODE_STRIDE * reference
            bounds = node_bounds_sq(words, base, is_far, vx, vy, vz, wide_x, wide_y, wide_z, offsets)
            is_open = bounds <= splat32(best32)
            if bits(is_open):
                reference, at = descend(words, base, bounds, is_open, stacks, at)
                continue
        elif ~reference < ENTRY:
            if reference != seen:
                best_sq, best_slot = nearer_in_block(
                    reals, ~reference, wide_x, wide_y, wide_z, best_sq, best_slot
                )
                best32 = bound_of(best_sq, offset)
        else:
            entry = entries + 2 * (~reference - ENTRY)
            part, start = load_int(words, entry), load_int(words, entry + 1)
            if parts[part, IS_FUSED]:
                reference = start
                continue
            qx, qy, qz = to_local(frames, parts, part, x, y, z)
            ratio_sq = (frames[part, SCALE] / scene_scale) ** 2
            found_sq, slot = closest_in_part(
                reals, words, start, qx, qy, qz, best_sq * ratio_sq, best_slot, seen, stacks, 0
            )
            if slot != best_slot:
                best_sq, best_slot = found_sq / ratio_sq, slot
                best32 = bound_of(best_sq, offset)
        at = next_open(stacks, bottom, at, best32)
        if at == NOTHING_WAITS:
            if best_slot >= 0:
                here = part_of_slot(words, parts, best_slot)
            return best_sq, here, best_slot
        reference = load_int(stacks, at + STACK_SIZE)


@inlined
def part_of_slot(words, parts, slot):
    """The part that a slot belongs to."""
    scene = len(parts) - 1
    if scene == 1:
        return np.int64(0)
    return np.int64(load_int(words, parts[scene, BLOCK_NOTES] + slot // LANES) & (2**FOLDED_AT - 1))
