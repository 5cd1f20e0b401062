"""Rays against a whole scene: all crossings of each, or its first hit beyond a distance; see `crossings`."""

import numpy as np

from proximity.kernels.answers import (
    CROSSING_IS_ENTERING,
    RAY_ANSWER_BARYCENTRIC,
    RAY_ANSWER_DISTANCE,
)
from proximity.kernels.geometry.frames import ignores_some, is_alone
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import LANES, NO_SLOT, STACKS_SIZE, ModelArrays
from proximity.kernels.ray.crossings import (
    HIT_DISTANCE,
    HIT_SENSE,
    HIT_SLOT,
    SAME_CROSSING,
    hits_of_heeded,
    hits_of_ray,
    merge_crossings,
)
from proximity.kernels.ray.hit_rows import HIT_OFFSETS_SIZE, HITS_SIZE, fill_hits, write_hit, write_no_hit
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
from proximity.kernels.ray.walk import bound_of_parameter
from proximity.kernels.scene.queries.point_queries import limit_of
from proximity.kernels.scene.queries.ray_queries import FAR_MARGIN
from proximity.kernels.stack_arrays import stack_f32, stack_f64, stack_i64
from proximity.kernels.traverse.depth_first import SCENE_STACKS
from proximity.native import ROWS_WITH_GIL, entry, inlined, kernel
from proximity.native.simd import square_root, store

NOT_A_RAY = -1
"""Crossings of a ray that is not finite, or starts too far away."""


@kernel
def _write_answers(model, answers, choices, count):
    """Replace hits in the table by answers, eight at a time."""
    reals, words, frames, parts = model
    slots, owners, views = stack_i64(RAY_CHUNK), stack_i64(RAY_CHUNK), stack_f64(VIEW_SIZE)
    hit_offsets, hits = stack_i64(HIT_OFFSETS_SIZE), stack_f64(HITS_SIZE)
    for k in range(LANES):
        for axis in range(3):
            views[RAY_CHUNK * (VIEW_DIRECTION + axis) + k] = (
                1.0  # only for faces without area, which are never hit
            )
    for begin in range(0, count, LANES):
        for k in range(LANES):
            row = min(begin + k, count - 1)
            slots[k] = choices[row, HIT_SLOT]
            for corner in range(3):
                views[RAY_CHUNK * (VIEW_WEIGHTS + corner) + k] = answers[row, RAY_ANSWER_BARYCENTRIC + corner]
        fill_hits(reals, words, frames, parts, slots, 0, views, owners, hit_offsets, hits)
        for k in range(min(LANES, count - begin)):
            row = begin + k
            distance, is_entering = answers[row, HIT_DISTANCE], choices[row, HIT_SENSE] > 0
            if slots[k] < 0:
                write_no_hit(answers, choices, row, distance)
                continue
            if choices.shape[1] > CROSSING_IS_ENTERING:
                choices[row, CROSSING_IS_ENTERING] = is_entering
            answers[row, RAY_ANSWER_DISTANCE] = distance
            write_hit(words, parts, owners[k], slots[k], hits, k, answers, choices, row)


@inlined
def _write_miss(answers, choices, row, is_sound):
    answers[row, HIT_DISTANCE], choices[row, HIT_SLOT] = np.inf if is_sound else np.nan, NO_SLOT
    for corner in range(3):
        answers[row, RAY_ANSWER_BARYCENTRIC + corner] = 1.0


@entry(
    ModelArrays,
    "float64[:, 3], float64[:, 3], float64[:], float64[:], int64[:], float64[:, :] -> int",
    rows_with_gil=ROWS_WITH_GIL,
)
def crossings_batch(model, origins, directions, limits, nearest, counts, answers):
    """Write the crossings of rays (N, 3) into a table, one ray after the other; return the rays that fit.

    *limits*, *nearest*: greatest and least distance, m, (1,) or (N,). *counts* (N,): crossings of each ray,
    or `NOT_A_RAY`; *answers*: any number of rows of `CROSSING_WIDTH`, of which the last stays scratch. With
    *counts* empty: the first hit of each ray at *nearest* or beyond, touches included, in *answers* (N,
    `RAY_ANSWER_WIDTH`).
    """
    _, words, frames, parts = model
    choices, is_first = answers.view(np.int32), len(counts) == 0
    stacks, aims, views = stack_f32(STACKS_SIZE), stack_f32(AIM_SIZE), stack_f64(VIEW_SIZE)
    offsets, lengths = stack_i64(RAY_CHUNK), stack_f64(RAY_CHUNK)
    is_single = is_alone(parts)
    walk_row = np.int64(0) if is_single else len(parts) - 1
    scale, root, drift = frames[walk_row].scale, parts[walk_row].root, 0.0 if is_single else FAR_MARGIN
    filled, total = np.int64(0), len(origins)
    for begin in range(0, total, RAY_CHUNK):
        count = min(RAY_CHUNK, total - begin)
        for k in range(-(-count // LANES) * LANES):
            row = begin + min(k, count - 1)
            offsets[k], views[RAY_CHUNK * VIEW_REACH + k] = 3 * row, limit_of(limits, row)
        for at in range(0, count, LANES):
            make_ready(frames, parts, walk_row, drift, origins, directions, offsets, at, aims, views)
            dx, dy, dz = load_three(views, VIEW_DIRECTION, at)
            store(lengths, at, square_root(dot(dx, dy, dz, dx, dy, dz)))
        for k in range(count):
            row = begin + k
            is_sound = views[RAY_CHUNK * VIEW_IS_SOUND + k] > 0.0
            least, most, start = (
                limit_of(nearest, row), limit_of(limits, row), views[RAY_CHUNK * VIEW_START + k]
            )  # fmt: skip
            bound, longest = aims[RAY_CHUNK * AIM_BOUND + k], views[RAY_CHUNK * VIEW_REACH + k] * scale
            if not is_first and bound >= 0.0:
                # Include all hits that may be merged with a crossing at the limit.
                longest += SAME_CROSSING * max(1.0, longest)
                bound = bound_of_parameter(longest, start)
            ray = (origins[row, 0], origins[row, 1], origins[row, 2]), direction_of(views, k)
            table = answers, choices, row if is_first else filled, is_first, scale, lengths[k], least, most
            query = aim_of(aims, k), view_of(views, k), start, (ray, 1.0, table)
            best = bound, np.int64(0), longest
            if ignores_some(parts):
                _, found, _ = hits_of_heeded(model, root, SCENE_STACKS, query, best, stacks)
            else:
                _, found, _ = hits_of_ray(model, root, SCENE_STACKS, query, best, stacks)
            if is_first:
                if found == 0:
                    _write_miss(answers, choices, row, is_sound)
                continue
            if filled + found >= len(answers):
                _write_answers(model, answers, choices, filled)
                return row
            kept = merge_crossings(words, parts, answers, choices, filled, found, least, most)
            counts[row] = kept if is_sound else NOT_A_RAY
            filled += kept
    _write_answers(model, answers, choices, total if is_first else filled)
    return total
