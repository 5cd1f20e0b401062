"""Ray queries of a whole scene: the first hit of each ray, in the scene's frame.

A direction is scaled by a power of two until its largest component is near 1, and not normalised, so that it
is not rounded before the test. Parameters of all parts are then comparable; the direction's length converts
the smallest to metres.
"""

import numpy as np

from proximity.kernels.answers import DISTANCE_WIDTH, RAY_ANSWER_DISTANCE
from proximity.kernels.geometry.frames import ignores_some, is_alone
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import LANES, NO_ROW, NO_SLOT, STACKS_SIZE, ModelArrays
from proximity.kernels.ray.hit_rows import HIT_OFFSETS_SIZE, HITS_SIZE, fill_hits, write_hit, write_no_hit
from proximity.kernels.ray.many_rays import first_hits
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
from proximity.kernels.ray.walk import first_hit, first_hit_in_scene, first_hit_of_heeded
from proximity.kernels.scene.queries.point_queries import fetch_row, limit_of
from proximity.kernels.stack_arrays import stack_f32, stack_f64, stack_i64
from proximity.kernels.traverse.depth_first import SCENE_STACKS
from proximity.native import ROWS_WITH_GIL, entry, inlined, kernel
from proximity.native.simd import load, splat, square_root, store

IN_TURNS_FROM = 1 << 25
"""Bytes of blocks and nodes from which rays are walked in turns, see `many_rays`."""
FAR_MARGIN = 2.0**-46
"""Additional margin of the boxes of parts, relative to the origin's distance from the scene: a distant ray is
rounded separately for each part."""


@inlined
def _before_walk(aims, views, k, scale):
    """Return the initial state of ray *k*, see `first_hit`."""
    parameter = views[RAY_CHUNK * VIEW_REACH + k] * scale
    return aims[RAY_CHUNK * AIM_BOUND + k], parameter, np.int64(NO_SLOT), (0.0, 0.0, 0.0)


@inlined
def _keep_hit(views, slots, k, best):
    """Store slot and parameter of a hit, and its weights over the view."""
    _, views[RAY_CHUNK * VIEW_REACH + k], slots[k], weights = best
    for corner in range(3):
        views[RAY_CHUNK * (VIEW_WEIGHTS + corner) + k] = weights[corner]


@kernel
def _hits_of_tree(reals, words, root, scale, count, aims, views, slots, stacks):
    """Fill the first hits of the rays in the tables; all leaves are blocks in the frame of the rays.

    *root*: the reference to start from; *scale*: of the frame. Fills slots, or `NO_SLOT`; the parameters, in
    that frame, replace the longest ones.
    """
    if count > 1 and 8 * len(reals) + 4 * len(words) >= IN_TURNS_FROM:
        first_hits(reals, words, root, scale, count, aims, views, slots)
        return
    for k in range(count):
        query = aim_of(aims, k), view_of(views, k), views[RAY_CHUNK * VIEW_START + k], 0
        best = first_hit((reals, words), root, 0, query, _before_walk(aims, views, k, scale), stacks)
        _keep_hit(views, slots, k, best)


@kernel
def _hits_of_parts(model, count, origins, rows, aims, views, slots, stacks):
    """Fill the first hits of the rays in a scene whose parts may have separate frames.

    *rows*: of *origins*. Ties go to the lower part, then to the lower slot.
    """
    scene = len(model.parts) - 1
    scale, root = model.frames[scene].scale, model.parts[scene].root
    for k in range(count):
        row = rows[k]
        ray = (origins[row, 0], origins[row, 1], origins[row, 2]), direction_of(views, k)
        query = aim_of(aims, k), view_of(views, k), views[RAY_CHUNK * VIEW_START + k], ray
        best = _before_walk(aims, views, k, scale)
        if ignores_some(model.parts):
            best = first_hit_of_heeded(model, root, SCENE_STACKS, query, best, stacks)
        else:
            best = first_hit_in_scene(model, root, SCENE_STACKS, query, best, stacks)
        _keep_hit(views, slots, k, best)


@inlined
def _is_still(directions, row):
    """Test whether a direction is zero."""
    return directions[row, 0] == 0.0 and directions[row, 1] == 0.0 and directions[row, 2] == 0.0


@entry(
    ModelArrays,
    "float64[:, 3], float64[:, 3], int64[:], float64[:], float64[:, :] -> int",
    rows_with_gil=ROWS_WITH_GIL,
)
def cast_batch(model, origins, directions, order, limits, answers):
    """Fill answers (N, `ANSWER_WIDTH`) for rays (N, 3) each, columns as in `answers`.

    Answers (N, `DISTANCE_WIDTH`) get distances only. *order*: the processing order of the rows, or empty.
    *limits*, m, (1,) or (N,): maximum distance. A direction that is zero, or a row that is not finite, gives
    nan and `NO_FACE`. Returns the lowest row whose direction is zero, or `NO_ROW`: the test here saves two
    microseconds in a call with five rays.
    """
    reals, words, frames, parts = model
    choices = answers.view(np.int32)
    stacks, aims, views = stack_f32(STACKS_SIZE), stack_f32(AIM_SIZE), stack_f64(VIEW_SIZE)
    rows, offsets, slots = stack_i64(RAY_CHUNK), stack_i64(RAY_CHUNK), stack_i64(RAY_CHUNK)
    is_single, fills_all_columns = is_alone(parts), answers.shape[1] != DISTANCE_WIDTH
    walk_row = np.int64(0) if is_single else len(parts) - 1
    scale, root, is_one_tree = (
        frames[walk_row].scale,
        parts[walk_row].root,
        is_single or (parts[walk_row].all_fused and not ignores_some(parts)),
    )
    owners, hit_offsets, hits = stack_i64(RAY_CHUNK), stack_i64(HIT_OFFSETS_SIZE), stack_f64(HITS_SIZE)
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
            # Padding lanes have no hit.
            offsets[k], slots[k], views[RAY_CHUNK * VIEW_REACH + k] = offsets[0], NO_SLOT, np.inf
        for at in range(0, count, LANES):
            drift = 0.0 if is_single else FAR_MARGIN
            make_ready(frames, parts, walk_row, drift, origins, directions, offsets, at, aims, views)
        if is_one_tree:
            _hits_of_tree(reals, words, root, scale, count, aims, views, slots, stacks)
        else:
            _hits_of_parts(model, count, origins, rows, aims, views, slots, stacks)
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
