"""Inside or outside: of one part by its nearest triangle, of a scene by every part that may hold the point.

The signed distance of a scene is the smallest over its parts: exact outside; inside, of several parts that
hold the point, the deepest counts.
"""

import numpy as np

from proximity.kernels.compiling import inlined, kernel
from proximity.kernels.folds import is_folded
from proximity.kernels.grid import CROSSED, INSIDE, OUTSIDE, cell_state
from proximity.kernels.layout import (
    BLOCK_NOTES,
    GRID,
    GRID_LOWER,
    GRID_RATE,
    GRID_X,
    GRID_Y,
    GRID_Z,
    LANES,
    MOMENTS,
    NO_GRID,
    NO_PART,
    NO_SLOT,
    ROOT,
    SCALE,
    SIGN,
    SIGN_NONE,
    SIGN_PSEUDONORMAL,
    SLOT_FACES,
)
from proximity.kernels.occupancy import (
    holder,
    holding_bits,
    list_of,
    listed_bits,
    loose_bits,
    turns_of,
    turns_of_list,
    turns_of_loose,
)
from proximity.kernels.point import NOTHING_SEEN, best_of_block, closest_in_part
from proximity.kernels.scene import to_local
from proximity.kernels.triangle import dot
from proximity.kernels.winding import winding_number
from proximity.kernels.witness import (
    ARM,
    LENGTH,
    NORMAL,
    closest_on_triangle,
    height_over,
    over_face,
    pseudo_normal,
    read_corners,
)
from proximity.simd import load, load_each, load_int, select, splat, splat32, store, trailing_zeros

FLAT = 1e-6
"""Sine of the angle between the way to the closest point and the plane across the pseudo-normal below which
the side is not believed: rounding, at a point 1e-9 part sizes away, turns the way by 1e-7. The winding number
decides there."""
RECENT = 16
"""Parts of which it is remembered what was found in them last."""


@kernel
def is_inside_by_winding(reals, words, parts, part, px, py, pz):
    """Whether *p*, local, has a winding number above one half."""
    return winding_number(reals, words, parts[part, ROOT], parts[part, MOMENTS], px, py, pz) > 0.5


@inlined
def is_beyond(px, py, pz):
    """Whether *p* is outside the cube that holds the part: from far away both sides may be equally near."""
    return max(abs(px), abs(py), abs(pz)) > 1.0


@inlined
def has_normals(words, parts, part, slot):
    """Whether the side of a face, and of its edges and corners, is told by their normals."""
    return parts[part, SIGN] == SIGN_PSEUDONORMAL and not is_folded(words, parts[part, BLOCK_NOTES], slot)


@kernel
def witness_of_slot(reals, words, parts, part, slot, px, py, pz, witness):
    """Fill *witness* for a triangle found; return face, feature and whether *p* is inside the part."""
    read_corners(reals, slot, witness)
    face = load_int(words, parts[part, SLOT_FACES] + slot)
    feature, which = closest_on_triangle(px, py, pz, witness)
    pseudo_normal(reals, words, parts, part, face, feature, which, witness)
    return face, feature, _is_inside(reals, words, parts, part, slot, px, py, pz, witness)


@kernel
def _is_inside(reals, words, parts, part, slot, px, py, pz, witness):
    """The side that a filled witness tells; on the surface: outside."""
    sign = parts[part, SIGN]
    length = witness[LENGTH]
    if sign == SIGN_NONE or length == 0.0 or is_beyond(px, py, pz):
        return False
    if has_normals(words, parts, part, slot):
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
    if has_normals(words, parts, part, slot):
        is_over, height = over_face(witness, px, py, pz)
        if is_over and not is_beyond(px, py, pz):
            return height + 0.0  # never -0.0
    _, _, inside = witness_of_slot(reals, words, parts, part, slot, px, py, pz, witness)
    return -witness[LENGTH] if inside else witness[LENGTH]


@inlined
def heights_over(reals, places, at, spots, heights, feet):
    """Height over eight triangles, local, of points with their feet inside; whether they have them there.

    *places* (CHUNK,): the first number of each triangle. *spots* (3 CHUNK,): the points, local, coordinate by
    coordinate. Columns *at* to *at* + 7 of *heights* and *feet* (CHUNK,): 1, or 0 for elsewhere.
    """
    chunk = len(heights)
    is_over, height, _, _, _ = height_over(
        load(spots, at),
        load(spots, chunk + at),
        load(spots, 2 * chunk + at),
        load_each(reals, places, at, 0),
        load_each(reals, places, at, 8),
        load_each(reals, places, at, 16),
        load_each(reals, places, at, 24),
        load_each(reals, places, at, 32),
        load_each(reals, places, at, 40),
        load_each(reals, places, at, 48),
        load_each(reals, places, at, 56),
        load_each(reals, places, at, 64),
    )
    store(heights, at, height)
    store(feet, at, select(is_over, splat(1.0), splat(0.0)))


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

    *state*: `INSIDE` or `CROSSED`, as `state_in_part` tells. *recent* (RECENT, 2) int64: parts asked lately
    and the slots found there, from which walks may start.
    """
    # Faces that pass by a cell may have marked it: mostly, not always, the surface is within its diagonal.
    rate = frames[part, GRID_RATE]
    reach_sq = np.inf if state == INSIDE else 3.001 / (rate * rate)
    slot, seen = np.int64(NO_SLOT), np.int64(NOTHING_SEEN)
    last = part % RECENT
    if recent[last, 0] == part:
        known_sq, known = best_of_block(reals, recent[last, 1], px, py, pz)
        if known_sq <= reach_sq:
            reach_sq, slot, seen = known_sq, known, ~(known // LANES)
    root = parts[part, ROOT]
    found_sq, slot = closest_in_part(reals, words, root, px, py, pz, reach_sq, slot, seen, stacks, 0)
    if slot == NO_SLOT:
        found_sq, slot = closest_in_part(
            reals, words, root, px, py, pz, np.inf, slot, NOTHING_SEEN, stacks, 0
        )
    if slot >= 0:
        recent[last, 0], recent[last, 1] = part, slot
        if state == CROSSED:
            signed = signed_of_slot(reals, words, parts, part, slot, px, py, pz, witness)
            if not signed < 0.0:
                slot = np.int64(NO_SLOT)
    return found_sq, slot


@kernel
def is_held(reals, words, frames, parts, x, y, z, recent, stacks, witness):
    """Whether some part holds a point of the scene's frame; *recent* as in `depth_in_part`."""
    sx, sy, sz = to_local(frames, parts, len(parts) - 1, x, y, z)
    sx, sy, sz = splat32(np.float32(sx)), splat32(np.float32(sy)), splat32(np.float32(sz))
    first, last = list_of(words, frames, parts, x, y, z)
    is_inside = False
    for turn in range(turns_of(parts, first, last)):
        holding, at = holding_bits(words, frames, parts, first, last, turn, x, y, z, sx, sy, sz)
        while holding and not is_inside:
            part = holder(words, parts, at, holding)
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
    reals, words, frames, parts, points, rows, count, found, depths, deeper, places, lists, pairs, recent,
    stacks, witness,
):  # fmt: skip
    """Find, for points of which the nearest surface is known, the part that holds each of them deepest.

    *rows* (count,): of *points*. *found* (count, 2): nearest part, or `NO_PART`, and slot. *depths* (count,):
    squared distance (scene's scaled frame) where the nearest part holds the point, else -1; made larger where
    another goes deeper, and then *deeper* (count, 2) gets that part and slot; else `NO_PART`. *places*
    (count, 3) float32, *lists* (count, 2), *pairs* (count * LANES, 3) and the rest are scratch.

    The points are asked together, turn by turn: so few steps wait for another.
    """
    scene = len(parts) - 1
    turns, loose_turns = np.int64(0), turns_of_loose(parts)
    for k in range(count):
        deeper[k, 0], deeper[k, 1] = NO_PART, NO_SLOT
        row = rows[k]
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        lists[k, 0], lists[k, 1] = list_of(words, frames, parts, x, y, z)
        turns = max(turns, turns_of_list(lists[k, 0], lists[k, 1]))
        if loose_turns:
            x, y, z = to_local(frames, parts, scene, x, y, z)
            places[k, 0], places[k, 1], places[k, 2] = np.float32(x), np.float32(y), np.float32(z)
    for turn in range(turns):
        pair_count = 0
        for k in range(count):
            row = rows[k]
            at = lists[k, 0] + LANES * turn
            holding = listed_bits(
                words, frames, parts, at, lists[k, 1], points[row, 0], points[row, 1], points[row, 2]
            )
            pair_count = _add_pairs(words, at, holding, k, found[k, 0], pairs, pair_count)
        _deepest_of_pairs(
            reals, words, frames, parts, points, rows, pair_count, depths, deeper, pairs, recent, stacks,
            witness,
        )  # fmt: skip
    for turn in range(loose_turns):
        pair_count = 0
        for k in range(count):
            sx, sy, sz = splat32(places[k, 0]), splat32(places[k, 1]), splat32(places[k, 2])
            holding, at = loose_bits(words, parts, turn, sx, sy, sz)
            pair_count = _add_pairs(words, at, holding, k, found[k, 0], pairs, pair_count)
        _deepest_of_pairs(
            reals, words, frames, parts, points, rows, pair_count, depths, deeper, pairs, recent, stacks,
            witness,
        )  # fmt: skip


@inlined
def _add_pairs(words, at, holding, k, nearest, pairs, pair_count):
    """Note which parts point *k* is to be asked of, but for the *nearest*, which has been; how many pairs."""
    while holding:
        part = np.int64(load_int(words, at + trailing_zeros(holding)))
        holding &= holding - 1
        pairs[pair_count, 0], pairs[pair_count, 1] = k, part
        # Neither branch could be foreseen.
        pair_count += part != nearest
    return pair_count


@kernel
def _deepest_of_pairs(
    reals, words, frames, parts, points, rows, pair_count, depths, deeper, pairs, recent, stacks, witness
):
    """Ask parts that may hold points; see `deepest_of_chunk`. *pairs*: place in *rows*, and part."""
    scene = len(parts) - 1
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
            is_lower = depth_sq == depths[k] and deeper[k, 0] != NO_PART and part < deeper[k, 0]
            if depth_sq > depths[k] or is_lower:
                depths[k], deeper[k, 0], deeper[k, 1] = depth_sq, part, slot
