"""Rays against a whole scene: the first hit of each, in the scene's frame.

A direction is scaled by a power of two until its largest component is near 1, and is not normalised: nothing
is rounded before a ray is tested. Parameters of all parts are then comparable; the direction's length turns
the least of them into metres.
"""

from math import frexp, isfinite, ldexp, sqrt

import numpy as np

from proximity.kernels.compiling import inlined, kernel, maker
from proximity.kernels.curve import morton_order
from proximity.kernels.descent import NOTHING_WAITS, descend_in_order, next_open
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    BOX_LOWER,
    BOX_UPPER,
    CENTRE,
    ENTRY,
    FACES,
    IS_FUSED,
    LANES,
    NO_FACE,
    NO_PART,
    NO_SLOT,
    NODE_STRIDE,
    ROOT,
    SCALE,
    SLOT_FACES,
    STACK_SIZE,
    STACKS_SIZE,
    TRANSLATION,
)
from proximity.kernels.memory import arrays_at, longs_here, words_here
from proximity.kernels.ray import (
    SLAB_MARGIN,
    approach,
    bound_of_parameter,
    first_in_block,
    look_along,
    near_plane,
    ray_boxes_bound,
    ray_in_part,
    slab,
)
from proximity.kernels.scene import direction_to_local, direction_to_scene, is_alone, part_of_slot, to_local
from proximity.kernels.triangle import difference_of_products, dot
from proximity.simd import (
    bits,
    load_int,
    select,
    splat32,
)

FAR_MARGIN = 2.0**-46
"""What the boxes of parts are widened by besides, times the origin's distance from the scene: a ray from afar
is rounded for each part on its own."""

# columns of the answers: float64
DISTANCE = 0
POINT = 1
NORMAL = 4
BARYCENTRIC = 7
ANSWER_REALS = 10
# and int32, behind them
PART = 2 * ANSWER_REALS
FACE = PART + 1
ANSWER_WIDTH = ANSWER_REALS + 1
"""float64 that a row takes in all."""
DISTANCE_WIDTH = 1
"""float64 of a row of which only the distance is asked."""
NO_ROW = -1
"""Where a row is told: none."""
NO_RAYS = -2
"""Where a row is told: nothing was asked."""


@inlined
def scaled_direction(x, y, z):
    """The direction times the power of two that brings its largest component to 0.5 … 2."""
    largest = max(abs(x), abs(y), abs(z))
    if largest >= 0.5 and largest < 2.0:
        return x, y, z
    exponent = -frexp(largest)[1]
    return ldexp(x, exponent), ldexp(y, exponent), ldexp(z, exponent)


@inlined
def first_hit_of_part(reals, words, frames, parts, part, start, x, y, z, dx, dy, dz, best, best_slot, stacks):
    """`ray_in_part` for a ray and a parameter of the scene's frame, m."""
    scale = frames[part, SCALE]
    px, py, pz = to_local(frames, parts, part, x, y, z)
    ux, uy, uz = direction_to_local(frames, parts, part, dx, dy, dz)
    found, slot, b0, b1, b2 = ray_in_part(
        reals, words, start, px, py, pz, ux, uy, uz, best * scale, best_slot, stacks, 0
    )
    return found / scale, slot, b0, b1, b2


@inlined
def first_hit_in_scene(reals, words, frames, parts, x, y, z, dx, dy, dz, limit, stacks):
    """First hit of a ray up to *limit*: parameter (m), part or `NO_PART`, slot, weights as `ray_in_part`.

    Ties go to the lower part, then to the lower slot. *stacks*: float32, four times `STACK_SIZE`.

    Parts in the scene's own frame are walked as if they were one tree; the others in frames of their own. Put
    into the caller, as `ray_in_part` is: a call would take a tenth of the time.
    """
    scene = len(parts) - 1
    scale = frames[scene, SCALE]
    best, best_slot = limit * scale, np.int64(NO_SLOT)
    b0, b1, b2 = 0.0, 0.0, 0.0
    ox, oy, oz = to_local(frames, parts, scene, x, y, z)
    margin = SLAB_MARGIN + FAR_MARGIN * max(abs(ox), abs(oy), abs(oz))
    is_near, entry, ox, oy, oz = approach(ox, oy, oz, dx, dy, dz)
    near_x, near_y, near_z = near_plane(dx), near_plane(dy), near_plane(dz)
    rate_x, in_x, out_x = slab(ox, dx, margin)
    rate_y, in_y, out_y = slab(oy, dy, margin)
    rate_z, in_z, out_z = slab(oz, dz, margin)
    ax, ay, az, px, py, pz, lean_x, lean_y, pace = look_along(ox, oy, oz, dx, dy, dz)
    # The ray in the frame of the part that was met last.
    here, ratio = np.int64(NO_PART), 1.0
    lx, ly, lz, ux, uy, uz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    best32 = bound_of_parameter(best, entry) if is_near else np.float32(-1.0)
    entries = parts[scene, FACES]
    bottom = 2 * STACK_SIZE
    at = bottom
    reference = parts[scene, ROOT]
    while True:
        if reference >= 0:
            base = NODE_STRIDE * reference
            bounds, is_open = ray_boxes_bound(
                words, base, near_x, near_y, near_z, splat32(rate_x), splat32(rate_y), splat32(rate_z),
                splat32(in_x), splat32(in_y), splat32(in_z), splat32(out_x), splat32(out_y), splat32(out_z),
                splat32(np.float32(0.0)), splat32(best32),
            )  # fmt: skip
            if bits(is_open):
                reference, at = descend_in_order(words, base, bounds, is_open, stacks, at)
                continue
        elif ~reference < ENTRY:
            block = ~reference
            found, first, a, b, c = first_in_block(
                reals, BLOCK_STRIDE * block, ax, ay, az, px, py, pz, lean_x, lean_y, pace, entry, best
            )
            slot = LANES * block + first
            if first >= 0 and (found < best or slot < best_slot or best_slot == NO_SLOT):
                best, best_slot = found, slot
                b0, b1, b2 = a, b, c
                best32 = bound_of_parameter(best, entry)
        else:
            entry_at = entries + 2 * (~reference - ENTRY)
            part, start = load_int(words, entry_at), load_int(words, entry_at + 1)
            if parts[part, IS_FUSED]:
                reference = start
                continue
            if part != here:
                here, ratio = part, frames[part, SCALE] / scale
                lx, ly, lz = to_local(frames, parts, part, x, y, z)
                ux, uy, uz = direction_to_local(frames, parts, part, dx, dy, dz)
            found, slot, a, b, c = ray_in_part(
                reals, words, start, lx, ly, lz, ux, uy, uz, best * ratio, best_slot, stacks, 0
            )
            if slot != best_slot:
                best, best_slot = found / ratio, slot
                b0, b1, b2 = a, b, c
                best32 = bound_of_parameter(best, entry)
        at = next_open(stacks, bottom, at, best32)
        if at == NOTHING_WAITS:
            part = part_of_slot(parts, best_slot, here) if best_slot >= 0 else np.int64(NO_PART)
            return best / scale, part, best_slot, b0, b1, b2
        reference = load_int(stacks, at + STACK_SIZE)


@inlined
def write_no_hit(answers, choices, row, distance):
    """A row without a face: *distance* is inf for a miss, nan for a ray that is none."""
    answers[row, DISTANCE] = distance
    if answers.shape[1] == DISTANCE_WIDTH:
        return
    for column in range(1, ANSWER_REALS):
        answers[row, column] = np.nan
    choices[row, PART] = NO_PART
    choices[row, FACE] = NO_FACE


@inlined
def face_normal(reals, base):
    """Normal, of any length, of the face whose first coordinate is at *base*; 0 where it has no area."""
    ax, ay, az = reals[base], reals[base + 8], reals[base + 16]
    bx, by, bz = reals[base + 24] - ax, reals[base + 32] - ay, reals[base + 40] - az
    cx, cy, cz = reals[base + 48] - ax, reals[base + 56] - ay, reals[base + 64] - az
    return (
        difference_of_products(by, cz, bz, cy),
        difference_of_products(bz, cx, bx, cz),
        difference_of_products(bx, cy, by, cx),
    )


@inlined
def write_hit(reals, words, frames, parts, part, slot, u, v, w, dx, dy, dz, length, answers, choices, row):
    """Fill point, normal, barycentric, part and face of a hit.

    *u v w*: weights of the corners, in any measure. *length*: of the direction.
    """
    total = u + v + w
    b0, b1, b2 = u / total, v / total, w / total
    answers[row, BARYCENTRIC], answers[row, BARYCENTRIC + 1], answers[row, BARYCENTRIC + 2] = b0, b1, b2
    base = BLOCK_STRIDE * (slot // LANES) + slot % LANES
    # From the corner that weighs most: nothing is lost where the hit is a corner. Without branches, since
    # none could be predicted.
    is_b, is_c = b1 > b0, b2 > max(b0, b1)
    heaviest = np.int64(select(is_c, 2.0, select(is_b, 1.0, 0.0)))
    a, b, c = base + 24 * heaviest, base + 24 * ((heaviest + 1) % 3), base + 24 * ((heaviest + 2) % 3)
    b1, b2 = select(is_c, b0, select(is_b, b2, b1)), select(is_c, b1, select(is_b, b0, b2))
    metres = 1.0 / frames[part, SCALE]
    px = reals[a] + b1 * (reals[b] - reals[a]) + b2 * (reals[c] - reals[a])
    py = reals[a + 8] + b1 * (reals[b + 8] - reals[a + 8]) + b2 * (reals[c + 8] - reals[a + 8])
    pz = reals[a + 16] + b1 * (reals[b + 16] - reals[a + 16]) + b2 * (reals[c + 16] - reals[a + 16])
    px, py, pz = direction_to_scene(
        frames, parts, part,
        px * metres + frames[part, CENTRE], py * metres + frames[part, CENTRE + 1],
        pz * metres + frames[part, CENTRE + 2],
    )  # fmt: skip
    answers[row, POINT] = px + frames[part, TRANSLATION]
    answers[row, POINT + 1] = py + frames[part, TRANSLATION + 1]
    answers[row, POINT + 2] = pz + frames[part, TRANSLATION + 2]
    nx, ny, nz = face_normal(reals, base)
    nx, ny, nz = direction_to_scene(frames, parts, part, nx, ny, nz)
    size = sqrt(dot(nx, ny, nz, nx, ny, nz))
    if not size > 0.0:
        nx, ny, nz, size = -dx, -dy, -dz, length
    nx, ny, nz = nx / size, ny / size, nz / size
    answers[row, NORMAL], answers[row, NORMAL + 1], answers[row, NORMAL + 2] = nx, ny, nz
    choices[row, PART] = part
    choices[row, FACE] = load_int(words, parts[part, SLOT_FACES] + slot)


@maker
def cast_order(handle, origins, directions):
    """The rows of rays (N, 3) in an order in which neighbours meet the scene's box near one another.

    Of those that start inside or pass by, the origin counts, moved to the box.
    """
    _, _, frames, _ = arrays_at(handle)
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    for part in range(len(frames) - 1):
        for axis in range(3):
            lower[axis] = min(lower[axis], frames[part, BOX_LOWER + axis])
            upper[axis] = max(upper[axis], frames[part, BOX_UPPER + axis])
    places = np.empty((len(origins), 3))
    for i in range(len(origins)):
        enter = 0.0
        for axis in range(3):
            way = directions[i, axis]
            near = (lower[axis] if way > 0.0 else upper[axis]) - origins[i, axis]
            if near * way > 0.0:
                enter = max(enter, near / way)
        for axis in range(3):
            place = origins[i, axis] + enter * directions[i, axis]
            places[i, axis] = min(max(place, lower[axis]), upper[axis])
    return morton_order(places)


@kernel
def cast_batch(handle, origins, directions, order, limit, answers):
    """Fill answers (N, `ANSWER_WIDTH`) for rays (N, 3) each; see the columns above.

    Of answers (N, `DISTANCE_WIDTH`) distances are filled and nothing else is worked out.
    *order*: the rows in the order to take them in, or empty. *limit*: the longest distance to look, m. A
    direction that is zero, or a row that is not finite, answers nan and `NO_FACE`. Returns the lowest row
    whose direction is zero, or `NO_ROW`: looking for it here spares a caller with five rays two microseconds.
    """
    reals, words, frames, parts = arrays_at(handle)
    choices = answers.view(np.int32)
    stacks = words_here(STACKS_SIZE)
    is_single, is_told_all = is_alone(parts), answers.shape[1] != DISTANCE_WIDTH
    zero_row = np.int64(NO_ROW)
    for i in range(len(order) if len(order) else len(origins)):
        row = order[i] if len(order) else i
        x, y, z = origins[row, 0], origins[row, 1], origins[row, 2]
        dx, dy, dz = directions[row, 0], directions[row, 1], directions[row, 2]
        is_finite = isfinite(x) and isfinite(y) and isfinite(z)
        is_finite = is_finite and isfinite(dx) and isfinite(dy) and isfinite(dz)
        is_zero = dx == 0.0 and dy == 0.0 and dz == 0.0
        if is_zero or not is_finite:
            if is_zero and (zero_row == NO_ROW or row < zero_row):
                zero_row = row
            write_no_hit(answers, choices, row, np.nan)
            continue
        dx, dy, dz = scaled_direction(dx, dy, dz)
        length = sqrt(dot(dx, dy, dz, dx, dy, dz))
        # A little farther, since rounding must not lose a hit at the limit itself.
        reach = np.inf if limit == np.inf else limit / length * (1.0 + 1e-12)
        if is_single:
            best, slot, u, v, w = first_hit_of_part(
                reals, words, frames, parts, 0, parts[0, ROOT], x, y, z, dx, dy, dz, reach, NO_SLOT, stacks
            )
            part = np.int64(0)
        else:
            best, part, slot, u, v, w = first_hit_in_scene(
                reals, words, frames, parts, x, y, z, dx, dy, dz, reach, stacks
            )
        distance = best * length
        if slot < 0 or not distance <= limit:
            write_no_hit(answers, choices, row, np.inf)
            continue
        answers[row, DISTANCE] = distance
        if is_told_all:
            write_hit(
                reals, words, frames, parts, part, slot, u, v, w, dx, dy, dz, length, answers, choices, row
            )
    return zero_row


@kernel
def cast_unlimited(handle, origins, directions, answers):
    """`cast_batch` without an order or a limit; `NO_RAYS`, and nothing filled, where these are not (N, 3)."""
    if origins.shape != directions.shape or origins.shape[1] != 3:
        return np.int64(NO_RAYS)
    return cast_batch(handle, origins, directions, longs_here(0), np.inf, answers)
