"""Rays against a whole scene: the first hit of each, in the scene's frame.

A direction is scaled by a power of two until its largest component is near 1, and is not normalised: nothing
is rounded before a ray is tested. Parameters of all parts are then comparable; the direction's length turns
the least of them into metres.
"""

import numpy as np

from proximity.kernels.geometry.frames import (
    direction_to_local,
    is_alone,
    to_local,
)
from proximity.kernels.geometry.rows import fetch_row, limit_of
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    ENTRY,
    FRAME_SCALE,
    LANES,
    NO_PART,
    NO_ROW,
    NO_SLOT,
    NODE_STRIDE,
    PART_IS_FUSED,
    PART_ROOT,
    SCENE_ALL_FUSED,
    SCENE_ENTRIES,
    STACK_SIZE,
    STACKS_SIZE,
)
from proximity.kernels.model_arrays import ModelArrays
from proximity.kernels.ray.hit_rows import (
    DISTANCE_WIDTH,
    HIT_OFFSETS_SIZE,
    HITS_SIZE,
    RAY_ANSWER_DISTANCE,
    fill_hits,
    write_hit,
    write_no_hit,
)
from proximity.kernels.ray.ray_lanes import (
    AIM_BOUND,
    AIM_SIZE,
    RAY_CHUNK,
    VIEW_DIRECTION,
    VIEW_IS_SOUND,
    VIEW_REACH,
    VIEW_SIZE,
    VIEW_START,
    VIEW_WEIGHTS,
    aim_of,
    direction_of,
    load_three,
    make_ready,
    view_of,
)
from proximity.kernels.ray.walk import bound_of_parameter, first_hit, first_in_block, open_boxes, ray_in_part
from proximity.kernels.stack_arrays import longs_here, reals_here, words_here
from proximity.kernels.tree.traversal import NOTHING_WAITS, descend_in_order, next_open
from proximity.native import HANDFUL, entry, inlined, kernel
from proximity.native.simd import (
    bits,
    load,
    load_int,
    splat,
    splat32,
    square_root,
    store,
)

FAR_MARGIN = 2.0**-46
"""Further margin of the boxes of parts, times the origin's distance from the scene: a ray from afar
is rounded for each part on its own."""


@kernel
def _hits_of_tree(reals, words, root, scale, count, aims, views, slots, stacks):
    """Fill the first hits of the rays in the tables, where all leaves are blocks in the frame of the rays.

    *root*: the reference to walk from; *scale*: of the frame. Slots, or `NO_SLOT`; the parameters, in that
    frame, replace the longest ones, and the weights replace the view.
    """
    for k in range(count):
        best, slots[k], u, v, w = first_hit(
            reals, words, root, aim_of(aims, k), view_of(views, k), views[RAY_CHUNK * VIEW_START + k],
            views[RAY_CHUNK * VIEW_REACH + k] * scale, aims[RAY_CHUNK * AIM_BOUND + k], np.int64(NO_SLOT),
            stacks, 0,
        )  # fmt: skip
        _keep_hit(views, k, best, u, v, w)


@inlined
def _keep_hit(views, k, best, u, v, w):
    views[RAY_CHUNK * VIEW_REACH + k] = best
    (
        views[RAY_CHUNK * VIEW_WEIGHTS + k],
        views[RAY_CHUNK * (VIEW_WEIGHTS + 1) + k],
        views[RAY_CHUNK * (VIEW_WEIGHTS + 2) + k],
    ) = u, v, w


@kernel
def _hits_of_parts(reals, words, frames, parts, count, origins, rows, aims, views, slots, stacks):
    """The same, where parts may have frames of their own.

    *rows*: of *origins*. Ties go to the lower part, then to the lower slot.
    """
    for k in range(count):
        best, slots[k], u, v, w = _first_hit_in_scene(
            reals, words, frames, parts, origins, aims, views, rows[k], k, stacks
        )
        _keep_hit(views, k, best, u, v, w)


@inlined
def _first_hit_in_scene(reals, words, frames, parts, origins, aims, views, row, k, stacks):
    """First hit of ray *k*: parameter (scene's scaled frame), slot, weights.

    Parts in the scene's own frame are walked as if they were one tree; the others in frames of their own.
    """
    scene = len(parts) - 1
    scale = frames[scene, FRAME_SCALE]
    aim, view, entry, best32 = (
        aim_of(aims, k),
        view_of(views, k),
        views[RAY_CHUNK * VIEW_START + k],
        aims[RAY_CHUNK * AIM_BOUND + k],
    )
    best, best_slot = views[RAY_CHUNK * VIEW_REACH + k] * scale, np.int64(NO_SLOT)
    b0, b1, b2 = 0.0, 0.0, 0.0
    # The ray in the frame of the part that was met last.
    last_part, ratio = np.int64(NO_PART), 1.0
    lx, ly, lz, ux, uy, uz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    entries = parts[scene, SCENE_ENTRIES]
    zero32 = splat32(np.float32(0.0))
    bottom = 2 * STACK_SIZE
    at = bottom
    reference = parts[scene, PART_ROOT]
    while True:
        if reference >= 0:
            base = NODE_STRIDE * reference
            bounds, leaving, is_open = open_boxes(words, base, aim, zero32, best32)
            if bits(is_open):
                reference, at = descend_in_order(words, base, bounds, leaving, is_open, stacks, at)
                continue
        elif ~reference < ENTRY:
            block = ~reference
            found, first, a, b, c = first_in_block(reals, BLOCK_STRIDE * block, view, entry, best)
            slot = LANES * block + first
            if first >= 0 and (found < best or slot < best_slot or best_slot == NO_SLOT):
                best, best_slot = found, slot
                b0, b1, b2 = a, b, c
                best32 = bound_of_parameter(best, entry)
        else:
            entry_at = entries + 2 * (~reference - ENTRY)
            part, start = load_int(words, entry_at), load_int(words, entry_at + 1)
            if parts[part, PART_IS_FUSED]:
                reference = start
                continue
            if part != last_part:
                last_part, ratio = part, frames[part, FRAME_SCALE] / scale
                x, y, z = origins[row, 0], origins[row, 1], origins[row, 2]
                lx, ly, lz = to_local(frames, parts, part, x, y, z)
                dx, dy, dz = direction_of(views, k)
                ux, uy, uz = direction_to_local(frames, parts, part, dx, dy, dz)
            found, slot, a, b, c = ray_in_part(
                reals, words, start, (lx, ly, lz), (ux, uy, uz), best * ratio, best_slot, stacks, 0
            )
            if slot != best_slot:
                best, best_slot = found / ratio, slot
                b0, b1, b2 = a, b, c
                best32 = bound_of_parameter(best, entry)
        at = next_open(stacks, bottom, at, best32)
        if at == NOTHING_WAITS:
            return best, best_slot, b0, b1, b2
        reference = load_int(stacks, at + STACK_SIZE)


@inlined
def _is_still(directions, row):
    """Whether a direction is zero."""
    return directions[row, 0] == 0.0 and directions[row, 1] == 0.0 and directions[row, 2] == 0.0


@entry(
    ModelArrays,
    "float64[:, 3], float64[:, 3], int64[:], float64[:], float64[:, :] -> int",
    handful=HANDFUL,
)
def cast_batch(model, origins, directions, order, limits, answers):
    """Fill answers (N, `ANSWER_WIDTH`) for rays (N, 3) each; see the columns above.

    Of answers (N, `DISTANCE_WIDTH`) distances are filled and nothing else is worked out.
    *order*: the rows in the order to take them in, or empty. *limits*, m, (1,) or (N,): how far to look. A
    direction that is zero, or a row that is not finite, answers nan and `NO_FACE`. Returns the lowest row
    whose direction is zero, or `NO_ROW`: looking for it here spares a call of five rays two microseconds.
    """
    reals, words, frames, parts = model
    choices = answers.view(np.int32)
    stacks, aims, views = words_here(STACKS_SIZE), words_here(AIM_SIZE), reals_here(VIEW_SIZE)
    rows, offsets, slots = longs_here(RAY_CHUNK), longs_here(RAY_CHUNK), longs_here(RAY_CHUNK)
    is_single, fills_all_columns = is_alone(parts), answers.shape[1] != DISTANCE_WIDTH
    walk_row = np.int64(0) if is_single else len(parts) - 1
    scale, root, is_one_tree = (
        frames[walk_row, FRAME_SCALE],
        parts[walk_row, PART_ROOT],
        is_single or parts[walk_row, SCENE_ALL_FUSED],
    )
    owners, hit_offsets, hits = longs_here(RAY_CHUNK), longs_here(HIT_OFFSETS_SIZE), reals_here(HITS_SIZE)
    zero_row = np.int64(NO_ROW)
    total = len(order) if len(order) else len(origins)
    for begin in range(0, total, RAY_CHUNK):
        count = min(RAY_CHUNK, total - begin)
        for k in range(count):
            row = order[begin + k] if len(order) else begin + k
            rows[k], offsets[k], views[RAY_CHUNK * VIEW_REACH + k] = row, 3 * row, limit_of(limits, row)
            fetch_row(origins, order, begin + k + RAY_CHUNK)
            fetch_row(directions, order, begin + k + RAY_CHUNK)
        for k in range(count, -(-count // LANES) * LANES):
            # Whoever stands in for a ray is not asked: he has hit nothing.
            offsets[k], slots[k], views[RAY_CHUNK * VIEW_REACH + k] = offsets[0], NO_SLOT, np.inf
        for at in range(0, count, LANES):
            drift = 0.0 if is_single else FAR_MARGIN
            make_ready(frames, parts, walk_row, drift, origins, directions, offsets, at, aims, views)
        if is_one_tree:
            _hits_of_tree(reals, words, root, scale, count, aims, views, slots, stacks)
        else:
            _hits_of_parts(reals, words, frames, parts, count, origins, rows, aims, views, slots, stacks)
        if fills_all_columns:
            for at in range(0, count, LANES):
                fill_hits(reals, words, frames, parts, slots, at, views, owners, hit_offsets, hits)
        for at in range(0, count, LANES):
            dx, dy, dz = load_three(views, VIEW_DIRECTION, at)
            reach = load(views, RAY_CHUNK * VIEW_REACH + at) / splat(scale)
            store(views, RAY_CHUNK * VIEW_REACH + at, reach * square_root(dot(dx, dy, dz, dx, dy, dz)))
        for k in range(count):
            row, slot = rows[k], slots[k]
            if slot < 0:
                is_sound = views[RAY_CHUNK * VIEW_IS_SOUND + k] > 0.0
                if not is_sound and (zero_row == NO_ROW or row < zero_row) and _is_still(directions, row):
                    zero_row = row
                write_no_hit(answers, choices, row, np.inf if is_sound else np.nan)
                continue
            distance = views[RAY_CHUNK * VIEW_REACH + k]
            if not distance <= limit_of(limits, row):
                write_no_hit(answers, choices, row, np.inf)
                continue
            answers[row, RAY_ANSWER_DISTANCE] = distance
            if fills_all_columns:
                write_hit(words, parts, owners[k], slot, hits, k, answers, choices, row)
    return zero_row
