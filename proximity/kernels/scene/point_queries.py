"""Point queries as Python calls them: distance, signed distance, closest point, inside or not.

Many points are taken in the order of a curve (*order*: row numbers), so that each can start from what the
one before has found; few as they come (*order* empty), each from nothing: five points that lie apart are
answered sooner so.

Tried and dropped (2026-11): a list of the leaves within reach of sixteen neighbours, along which each of them
runs instead of descending (0.94 of the time on a part of 3 k faces, 1.4 on one of 43 k).
"""

from math import sqrt

import numpy as np

from proximity.kernels.compiler import inlined, kernel
from proximity.kernels.geometry.closest_feature import ARM, LENGTH, NORMAL, POINT, WEIGHT, WITNESS_SIZE
from proximity.kernels.geometry.frames import (
    ROUNDING,
    can_be_asked,
    to_local,
    to_scene,
    turn_to_scene,
)
from proximity.kernels.geometry.rows import fetch_row, limit_of
from proximity.kernels.geometry.triangle import place_of
from proximity.kernels.layout import (
    FEATURE_NONE,
    LANES,
    NO_FACE,
    NO_PART,
    NO_SLOT,
    ROOT,
    SCALE,
    SIGN,
    SIGN_NONE,
    STACKS_SIZE,
)
from proximity.kernels.memory import (
    arrays_at,
    long_rows_here,
    longs_here,
    reals_here,
    word_rows_here,
    words_here,
)
from proximity.kernels.point.walk import NOTHING_SEEN, best_of_block, closest_in_part
from proximity.kernels.scene.containment import (
    RECENT,
    deepest_of_certain,
    deepest_of_chunk,
    is_held,
    note_holders,
)
from proximity.kernels.scene.nearest_part import (
    nearest_in_scene,
)
from proximity.kernels.sign.side import has_normals, heights_over, is_beyond, signed_of_slot, witness_of_slot

SHORTEST = 1e-150
"""Local units; the square of less would vanish."""
CHUNK = 64
"""Points that go through each step together."""
FOUND = CHUNK + 1
PAIRS = LANES * CHUNK
SPOTS = 3 * CHUNK

# columns of the answers: float64
SIGNED_DISTANCE = 0
POINT_AT = 1
GRADIENT = 4
BARYCENTRIC = 7
ANSWER_REALS = 10
# and int32, behind them
PART = 2 * ANSWER_REALS
FACE = PART + 1
FEATURE = PART + 2
IS_SIGNED = PART + 3
ANSWER_WIDTH = ANSWER_REALS + 2
"""float64 that a row takes in all."""


@inlined
def reach_sq(limit):
    """How far to look for what is within *limit*, local: a little farther, since distances round."""
    return (limit + ROUNDING) * (limit + ROUNDING) * (1.0 + ROUNDING)


@inlined
def _row(order, i):
    """The row that is *i*-th in order."""
    return order[i] if len(order) else i


@inlined
def _nearest(reals, words, frames, parts, x, y, z, limit_sq, part, slot, stacks):
    """`nearest_in_scene`, starting from the block of what the point before has found, if anything."""
    best_sq, seen = limit_sq, np.int64(NOTHING_SEEN)
    if slot >= 0:
        seen = ~(slot // LANES)
        px, py, pz = to_local(frames, parts, part, x, y, z)
        ratio = frames[part, SCALE] / frames[len(parts) - 1, SCALE]
        best_sq, slot = best_of_block(reals, slot, px, py, pz)
        best_sq /= ratio * ratio
        if not best_sq <= limit_sq:
            best_sq, part, slot = limit_sq, np.int64(NO_PART), np.int64(NO_SLOT)
    return nearest_in_scene(reals, words, frames, parts, x, y, z, best_sq, part, slot, seen, stacks)


@kernel
def distance_batch(handle, points, order, limit, distances):
    """Fill unsigned distances (N,), m; inf beyond *limit*."""
    reals, words, frames, parts = arrays_at(handle)
    stacks = words_here(STACKS_SIZE)
    scale = frames[len(parts) - 1, SCALE]
    limit_sq = reach_sq(limit * scale)
    part, slot = np.int64(NO_PART), np.int64(NO_SLOT)
    for i in range(len(order) if len(order) else len(points)):
        row = _row(order, i)
        fetch_row(points, order, i + CHUNK)
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        if not can_be_asked(frames, parts, x, y, z):
            distances[row] = np.nan
            continue
        if not len(order):
            part, slot = np.int64(NO_PART), np.int64(NO_SLOT)
        best_sq, part, slot = _nearest(reals, words, frames, parts, x, y, z, limit_sq, part, slot, stacks)
        distance = sqrt(best_sq) / scale
        distances[row] = distance if slot >= 0 and distance <= limit else np.inf


@inlined
def _begin_tables(found, recent):
    """Say in the tables of a chunk that nothing has been found yet."""
    found[CHUNK, 0], found[CHUNK, 1] = NO_PART, NO_SLOT
    for k in range(RECENT):
        recent[k, 0] = NO_PART


@inlined
def _begin_chunk(
    reals, words, frames, parts, points, order, first, count, limits, rows, reaches, certain, found, depths,
    deeper, lists, pairs, recent, stacks, witness,
):  # fmt: skip
    """Fill rows that are next, how far to look for each, and ask parts that hold some of them for certain.

    See `deepest_of_certain`. Of one part there is nothing to be asked. With a limit, most walks end sooner
    than depths are found. No *limits*: *reaches* are filled already.
    """
    for k in range(count):
        rows[k], certain[k] = _row(order, first + k), 0
        fetch_row(points, order, first + k + CHUNK)
    if len(limits):
        scale = frames[len(parts) - 1, SCALE]
        for k in range(count):
            reaches[k] = reach_sq(limit_of(limits, rows[k]) * scale)
    if len(parts) <= 2:
        return 0
    pair_count = note_holders(words, frames, parts, points, rows, count, lists, pairs, certain)
    if len(limits):
        for k in range(count):
            if reaches[k] < np.inf:
                certain[k] = 0
    return deepest_of_certain(
        reals, words, frames, parts, points, rows, count, pair_count, certain, found, depths, deeper, pairs,
        recent, stacks, witness,
    )  # fmt: skip


@inlined
def _nearest_of_chunk(
    reals, words, frames, parts, points, order, count, rows, reaches, certain, found, depths, signs, stacks
):
    """Fill what is nearest to each of `CHUNK` points, but to those that are held for *certain*.

    See `deepest_of_chunk`. Where there is no answer *found* has `NO_PART`, and *signs* nan or inf. What the
    last chunk ended with, at ``found[CHUNK]``, is where the first walk may start from.
    """
    part, slot = found[CHUNK, 0], found[CHUNK, 1]
    for k in range(count):
        if certain[k]:
            continue
        row = rows[k]
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        if not can_be_asked(frames, parts, x, y, z):
            found[k, 0], signs[k], depths[k] = NO_PART, np.nan, np.inf
            continue
        if not len(order):
            part, slot = np.int64(NO_PART), np.int64(NO_SLOT)
        best_sq, part, slot = _nearest(reals, words, frames, parts, x, y, z, reaches[k], part, slot, stacks)
        found[k, 0], found[k, 1], depths[k], signs[k] = part, slot, best_sq, np.inf
    found[CHUNK, 0], found[CHUNK, 1] = part, slot


@inlined
def _signs_of_chunk(
    reals, words, frames, parts, points, count, rows, certain, found, depths, signs, places, spots, heights,
    feet, witness,
):  # fmt: skip
    """Turn *signs* of a chunk into signed distances, m, and *depths* into -1 where nothing is held.

    What is over a face, as most is, is worked out for eight points at a time.
    """
    for k in range(CHUNK):
        places[k] = 0
        if k < count and found[k, 0] != NO_PART:
            row, slot = rows[k], found[k, 1]
            places[k] = place_of(slot)
            spots[k], spots[CHUNK + k], spots[2 * CHUNK + k] = to_local(
                frames, parts, found[k, 0], points[row, 0], points[row, 1], points[row, 2]
            )
    for at in range(0, count, LANES):
        heights_over(reals, places, at, spots, heights, feet)
    for k in range(count):
        part = found[k, 0]
        if part != NO_PART:
            px, py, pz = spots[k], spots[CHUNK + k], spots[2 * CHUNK + k]
            signed = heights[k] + 0.0  # never -0.0
            slot = found[k, 1]
            if feet[k] == 0.0 or is_beyond(px, py, pz) or not has_normals(words, parts, part, slot):
                signed = signed_of_slot(reals, words, parts, part, slot, px, py, pz, witness)
            if certain[k]:
                signed = -abs(signed)
            elif not signed < 0.0:
                depths[k] = -1.0
            signs[k] = signed / frames[part, SCALE]


@kernel
def signed_alone(handle, points, distances):
    """Fill signed distances (N,), m, to one part, of points as they come: without tables that many need."""
    reals, words, frames, parts = arrays_at(handle)
    stacks, witness = words_here(STACKS_SIZE), reals_here(WITNESS_SIZE)
    for row in range(len(points)):
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        distances[row] = np.nan
        if can_be_asked(frames, parts, x, y, z):
            px, py, pz = to_local(frames, parts, 0, x, y, z)
            _, slot = closest_in_part(
                reals, words, parts[0, ROOT], px, py, pz, np.inf, NO_SLOT, NOTHING_SEEN, stacks, 0
            )
            signed = signed_of_slot(reals, words, parts, 0, slot, px, py, pz, witness)
            distances[row] = signed / frames[0, SCALE]


@kernel
def signed_batch(handle, points, order, distances):
    """Fill signed distances (N,), m."""
    reals, words, frames, parts = arrays_at(handle)
    total = len(order) if len(order) else len(points)
    stacks, witness, places = words_here(STACKS_SIZE), reals_here(WITNESS_SIZE), word_rows_here(CHUNK, 3)
    depths, signs, rows, certain = (
        reals_here(CHUNK),
        reals_here(CHUNK),
        longs_here(CHUNK),
        longs_here(CHUNK),
    )
    found, deeper, lists = (
        long_rows_here(FOUND, 2),
        long_rows_here(CHUNK, 2),
        long_rows_here(CHUNK, 2),
    )
    pairs, recent, triangles = long_rows_here(PAIRS, 3), long_rows_here(RECENT, 2), longs_here(CHUNK)
    spots, heights, feet, reaches = (
        reals_here(SPOTS),
        reals_here(CHUNK),
        reals_here(CHUNK),
        reals_here(CHUNK),
    )
    no_limits = reals_here(0)
    for k in range(CHUNK):
        reaches[k] = np.inf
    _begin_tables(found, recent)
    for first in range(0, total, CHUNK):
        count = min(CHUNK, total - first)
        pair_count = _begin_chunk(
            reals, words, frames, parts, points, order, first, count, no_limits, rows, reaches, certain,
            found, depths, deeper, lists, pairs, recent, stacks, witness,
        )  # fmt: skip
        _nearest_of_chunk(
            reals, words, frames, parts, points, order, count, rows, reaches, certain, found, depths, signs,
            stacks,
        )  # fmt: skip
        _signs_of_chunk(
            reals, words, frames, parts, points, count, rows, certain, found, depths, signs, triangles, spots,
            heights, feet, witness,
        )  # fmt: skip
        if len(parts) > 2:
            deepest_of_chunk(
                reals, words, frames, parts, points, rows, count, found, depths, deeper, places, lists, pairs,
                pair_count, recent, stacks, witness,
            )  # fmt: skip
            for k in range(count):
                part = deeper[k, 0]
                if part != NO_PART and part != found[k, 0]:
                    row = rows[k]
                    px, py, pz = to_local(frames, parts, part, points[row, 0], points[row, 1], points[row, 2])
                    depth = signed_of_slot(reals, words, parts, part, deeper[k, 1], px, py, pz, witness)
                    signs[k] = -abs(depth) / frames[part, SCALE]
        for k in range(count):
            distances[rows[k]] = signs[k]


@kernel
def closest_batch(handle, points, order, limits, answers):
    """Fill answers (N, `ANSWER_WIDTH`); see the columns above. *limits*, m: (1,) or (N,)."""
    reals, words, frames, parts = arrays_at(handle)
    choices = answers.view(np.int32)
    total = len(order) if len(order) else len(points)
    stacks, witness, places = words_here(STACKS_SIZE), reals_here(WITNESS_SIZE), word_rows_here(CHUNK, 3)
    depths, signs, rows, certain = (
        reals_here(CHUNK),
        reals_here(CHUNK),
        longs_here(CHUNK),
        longs_here(CHUNK),
    )
    found, deeper, lists = (
        long_rows_here(FOUND, 2),
        long_rows_here(CHUNK, 2),
        long_rows_here(CHUNK, 2),
    )
    pairs, recent, triangles = long_rows_here(PAIRS, 3), long_rows_here(RECENT, 2), longs_here(CHUNK)
    spots, heights, feet, reaches = (
        reals_here(SPOTS),
        reals_here(CHUNK),
        reals_here(CHUNK),
        reals_here(CHUNK),
    )
    _begin_tables(found, recent)
    for first in range(0, total, CHUNK):
        count = min(CHUNK, total - first)
        pair_count = _begin_chunk(
            reals, words, frames, parts, points, order, first, count, limits, rows, reaches, certain, found,
            depths, deeper, lists, pairs, recent, stacks, witness,
        )  # fmt: skip
        _nearest_of_chunk(
            reals, words, frames, parts, points, order, count, rows, reaches, certain, found, depths, signs,
            stacks,
        )  # fmt: skip
        if len(parts) > 2:
            _signs_of_chunk(
                reals, words, frames, parts, points, count, rows, certain, found, depths, signs, triangles,
                spots, heights, feet, witness,
            )  # fmt: skip
            deepest_of_chunk(
                reals, words, frames, parts, points, rows, count, found, depths, deeper, places, lists, pairs,
                pair_count, recent, stacks, witness,
            )  # fmt: skip
        for k in range(count):
            row, part, slot = rows[k], found[k, 0], found[k, 1]
            if part == NO_PART:
                _write_nothing(answers, choices, row, signs[k])
                continue
            is_deeper = len(parts) > 2 and deeper[k, 0] != NO_PART
            if is_deeper:
                part, slot = deeper[k, 0], deeper[k, 1]
            px, py, pz = to_local(frames, parts, part, points[row, 0], points[row, 1], points[row, 2])
            face, feature, inside = witness_of_slot(reals, words, parts, part, slot, px, py, pz, witness)
            inside = inside or is_deeper
            limit = limit_of(limits, row)
            _write_answer(frames, parts, part, face, feature, inside, witness, limit, answers, choices, row)


@inlined
def _write_nothing(answers, choices, row, distance):
    for column in range(ANSWER_REALS):
        answers[row, column] = np.nan
    answers[row, SIGNED_DISTANCE] = distance
    choices[row, PART] = NO_PART
    choices[row, FACE] = NO_FACE
    choices[row, FEATURE] = FEATURE_NONE
    choices[row, IS_SIGNED] = 0


@kernel
def _write_answer(frames, parts, part, face, feature, inside, witness, limit, answers, choices, row):
    """Take a witness from the part's local frame to the scene's."""
    length = witness[LENGTH]
    distance = length / frames[part, SCALE]
    if not distance <= limit:
        _write_nothing(answers, choices, row, np.inf)
        return
    answers[row, SIGNED_DISTANCE] = -distance if inside else distance
    for k in range(3):
        answers[row, BARYCENTRIC + k] = witness[WEIGHT + k]
    to_scene(frames, parts, part, witness, POINT, witness, POINT)
    for axis in range(3):
        answers[row, POINT_AT + axis] = witness[POINT + axis]
    # Nearer than this the way has no direction, as on the surface itself.
    if length > SHORTEST:
        factor = -1.0 / length if inside else 1.0 / length
        for axis in range(3):
            witness[NORMAL + axis] = witness[ARM + axis] * factor
    turn_to_scene(frames, parts, part, witness, NORMAL, witness, NORMAL)
    for axis in range(3):
        answers[row, GRADIENT + axis] = witness[NORMAL + axis]
    choices[row, PART] = part
    choices[row, FACE] = face
    choices[row, FEATURE] = feature
    choices[row, IS_SIGNED] = parts[part, SIGN] != SIGN_NONE


@kernel
def has_inside(handle):
    """Whether some part has one."""
    _, _, _, parts = arrays_at(handle)
    part, count = 0, len(parts) - 1
    while part < count and parts[part, SIGN] == SIGN_NONE:
        part += 1
    return part < count


@kernel
def contains_batch(handle, points, order, inside):
    """Fill whether each point is inside some part (N,), bool. Points that are not finite are not."""
    reals, words, frames, parts = arrays_at(handle)
    stacks, witness = words_here(STACKS_SIZE), reals_here(WITNESS_SIZE)
    recent = long_rows_here(RECENT, 2)
    for k in range(RECENT):
        recent[k, 0] = NO_PART
    for i in range(len(order) if len(order) else len(points)):
        row = _row(order, i)
        fetch_row(points, order, i + CHUNK)
        inside[row] = is_held(
            reals,
            words,
            frames,
            parts,
            points[row, 0],
            points[row, 1],
            points[row, 2],
            recent,
            stacks,
            witness,
        )
