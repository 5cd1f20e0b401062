"""Inside or outside: of one part by its nearest triangle, of a scene by every part that may hold the point.

The signed distance of a scene is the smallest over its parts: exact outside; inside, of several parts that
hold the point, the deepest counts.
"""

import numpy as np

from proximity.kernels.box import point_boxes_distance_sq
from proximity.kernels.compiling import inlined, kernel
from proximity.kernels.grid import CROSSED, INSIDE, OUTSIDE, cell_state
from proximity.kernels.layout import (
    GRID,
    GRID_LOWER,
    GRID_RATE,
    GRID_X,
    GRID_Y,
    GRID_Z,
    IS_HIDDEN,
    LANES,
    MOMENTS,
    NO_GRID,
    NO_PART,
    NO_SLOT,
    NODE_STRIDE,
    ROOT,
    SCALE,
    SIGN,
    SIGN_NONE,
    SIGN_PSEUDONORMAL,
    SLOT_FACES,
)
from proximity.kernels.point import closest_in_part, slot_distance_sq
from proximity.kernels.scene import to_local
from proximity.kernels.triangle import dot
from proximity.kernels.winding import winding_number
from proximity.kernels.witness import (
    ARM,
    LENGTH,
    NORMAL,
    closest_on_triangle,
    over_face,
    pseudo_normal,
    read_corners,
)
from proximity.simd import bits, load_int, splat32, trailing_zeros

FLAT = 1e-6
"""Sine of the angle between the way to the closest point and the plane across the pseudo-normal below which
the side is not believed: rounding, at a point 1e-9 part sizes away, turns the way by 1e-7. The winding number
decides there."""


@kernel
def is_inside_by_winding(reals, words, parts, part, px, py, pz):
    """Whether *p*, local, has a winding number above one half."""
    return winding_number(reals, words, parts[part, ROOT], parts[part, MOMENTS], px, py, pz) > 0.5


@inlined
def is_beyond(px, py, pz):
    """Whether *p* is outside the cube that holds the part: from far away both sides may be equally near."""
    return max(abs(px), abs(py), abs(pz)) > 1.0


@kernel
def witness_of_slot(reals, words, parts, part, slot, px, py, pz, witness):
    """Fill *witness* for a triangle found; return face, feature and whether *p* is inside the part."""
    read_corners(reals, slot, witness)
    face = load_int(words, parts[part, SLOT_FACES] + slot)
    feature, which = closest_on_triangle(px, py, pz, witness)
    pseudo_normal(reals, words, parts, part, face, feature, which, witness)
    return face, feature, _is_inside(reals, words, parts, part, px, py, pz, witness)


@kernel
def _is_inside(reals, words, parts, part, px, py, pz, witness):
    """The side that a filled witness tells; on the surface: outside."""
    sign = parts[part, SIGN]
    length = witness[LENGTH]
    if sign == SIGN_NONE or length == 0.0 or is_beyond(px, py, pz):
        return False
    if sign == SIGN_PSEUDONORMAL:
        side = dot(
            witness[ARM],
            witness[ARM + 1],
            witness[ARM + 2],
            witness[NORMAL],
            witness[NORMAL + 1],
            witness[NORMAL + 2],
        )
        if abs(side) > FLAT * length:
            return side < 0.0
    return is_inside_by_winding(reals, words, parts, part, px, py, pz)


@kernel
def signed_of_slot(reals, words, parts, part, slot, px, py, pz, witness):
    """Signed local distance to a triangle found; what `witness_of_slot` would tell, without the rest."""
    read_corners(reals, slot, witness)
    if parts[part, SIGN] == SIGN_PSEUDONORMAL:
        is_over, height = over_face(witness, px, py, pz)
        if is_over and not is_beyond(px, py, pz):
            return height + 0.0  # never -0.0
    _, _, inside = witness_of_slot(reals, words, parts, part, slot, px, py, pz, witness)
    return -witness[LENGTH] if inside else witness[LENGTH]


@kernel
def state_in_part(reals, words, frames, parts, part, px, py, pz):
    """`INSIDE`, `OUTSIDE` or `CROSSED` (ask the surface) for *p* in the part's local frame."""
    if parts[part, SIGN] == SIGN_NONE:
        return OUTSIDE
    if parts[part, GRID] != NO_GRID:
        return cell_state(
            words,
            parts[part, GRID],
            frames[part, GRID_LOWER],
            frames[part, GRID_LOWER + 1],
            frames[part, GRID_LOWER + 2],
            frames[part, GRID_RATE],
            parts[part, GRID_X],
            parts[part, GRID_Y],
            parts[part, GRID_Z],
            px,
            py,
            pz,
        )
    return INSIDE if is_inside_by_winding(reals, words, parts, part, px, py, pz) else OUTSIDE


@kernel
def depth_in_part(reals, words, frames, parts, part, px, py, pz, state, recent, stacks, witness):
    """Squared local depth and slot where *p* (local) is inside *part*; `NO_SLOT` where it is not.

    *state*: `INSIDE` or `CROSSED`, as `state_in_part` tells. *recent* (2,) int64: the last part asked and the
    slot found there, from which a walk may start.
    """
    # Faces that pass by a cell may have marked it: mostly, not always, the surface is within its diagonal.
    rate = frames[part, GRID_RATE]
    reach_sq = np.inf if state == INSIDE else 3.001 / (rate * rate)
    slot = np.int64(NO_SLOT)
    if recent[0] == part:
        known_sq = slot_distance_sq(reals, recent[1], px, py, pz)
        if known_sq <= reach_sq:
            reach_sq, slot = known_sq, recent[1]
    root = parts[part, ROOT]
    found_sq, slot = closest_in_part(reals, words, root, px, py, pz, reach_sq, slot, stacks, 0)
    if slot == NO_SLOT:
        found_sq, slot = closest_in_part(reals, words, root, px, py, pz, np.inf, slot, stacks, 0)
    if slot >= 0:
        recent[0], recent[1] = part, slot
        if state == CROSSED:
            signed = signed_of_slot(reals, words, parts, part, slot, px, py, pz, witness)
            if not signed < 0.0:
                slot = np.int64(NO_SLOT)
    return found_sq, slot


@inlined
def holding_bits(words, parts, first, x, y, z):
    """Which of the eight parts from *first* on have a point in their boxes; float32x8 splats, scene's frame.

    The only part of a scene is asked itself: its row has no list of boxes.
    """
    scene = len(parts) - 1
    if scene == 1:
        return np.int64(not parts[0, IS_HIDDEN])
    base = parts[scene, GRID] + NODE_STRIDE * (first // LANES)
    return bits(point_boxes_distance_sq(words, base, x, y, z) <= splat32(np.float32(0.0)))


@kernel
def is_held(reals, words, frames, parts, x, y, z, recent, stacks, witness):
    """Whether some part holds a point of the scene's frame; *recent* as in `depth_in_part`."""
    scene = len(parts) - 1
    sx, sy, sz = to_local(frames, parts, scene, x, y, z)
    sx, sy, sz = splat32(np.float32(sx)), splat32(np.float32(sy)), splat32(np.float32(sz))
    is_inside = False
    for first in range(0, scene, LANES):
        holding = holding_bits(words, parts, first, sx, sy, sz)
        while holding and not is_inside:
            part = first + trailing_zeros(holding)
            holding &= holding - 1
            px, py, pz = to_local(frames, parts, part, x, y, z)
            state = state_in_part(reals, words, frames, parts, part, px, py, pz)
            is_inside = state == INSIDE
            if state == CROSSED:
                _, slot = depth_in_part(
                    reals, words, frames, parts, part, px, py, pz, state, recent, stacks, witness
                )
                is_inside = slot >= 0
    return is_inside


@kernel
def deepest_of_chunk(
    reals, words, frames, parts, points, rows, count, found, depths, deeper, places, pairs, recent, stacks,
    witness,
):  # fmt: skip
    """Find, for points of which the nearest surface is known, the part that holds each of them deepest.

    *rows* (count,): of *points*. *found* (count, 2): nearest part, or `NO_PART`, and slot. *depths* (count,):
    squared distance (scene's scaled frame) where the nearest part holds the point, else -1; made larger where
    another goes deeper, and then *deeper* (count, 2) gets that part and slot; else `NO_PART`. *places*
    (count, 3) float32, *pairs* (count * LANES, 3) and the rest are scratch.

    The points are asked together, part by part: so few steps wait for another, and boxes stay in registers.
    """
    scene = len(parts) - 1
    for k in range(count):
        deeper[k, 0], deeper[k, 1] = NO_PART, NO_SLOT
        row = rows[k]
        x, y, z = to_local(frames, parts, scene, points[row, 0], points[row, 1], points[row, 2])
        places[k, 0], places[k, 1], places[k, 2] = np.float32(x), np.float32(y), np.float32(z)
    for first in range(0, scene, LANES):
        pair_count = 0
        for k in range(count):
            x, y, z = splat32(places[k, 0]), splat32(places[k, 1]), splat32(places[k, 2])
            holding = holding_bits(words, parts, first, x, y, z)
            while holding:
                part = first + trailing_zeros(holding)
                holding &= holding - 1
                pairs[pair_count, 0], pairs[pair_count, 1] = k, part
                # The nearest part has been asked; neither branch can be foreseen.
                pair_count += part != found[k, 0]
        left = 0
        for i in range(pair_count):
            k, part = pairs[i, 0], pairs[i, 1]
            row = rows[k]
            px, py, pz = to_local(frames, parts, part, points[row, 0], points[row, 1], points[row, 2])
            state = state_in_part(reals, words, frames, parts, part, px, py, pz)
            pairs[left, 0], pairs[left, 1], pairs[left, 2] = k, part, state
            left += state != OUTSIDE
        for i in range(left):
            k, part = pairs[i, 0], pairs[i, 1]
            row = rows[k]
            px, py, pz = to_local(frames, parts, part, points[row, 0], points[row, 1], points[row, 2])
            depth_sq, slot = depth_in_part(
                reals, words, frames, parts, part, px, py, pz, pairs[i, 2], recent, stacks, witness
            )
            if slot >= 0:
                ratio = frames[part, SCALE] / frames[scene, SCALE]
                depth_sq /= ratio * ratio
                if depth_sq > depths[k]:
                    depths[k], deeper[k, 0], deeper[k, 1] = depth_sq, part, slot
