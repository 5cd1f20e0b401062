"""Point queries called from Python: distance, signed distance, closest point, containment.

Large batches are processed along a space-filling curve (*order*: row numbers), so that each search starts
from the previous result. Small batches (*order* empty) are processed as given, each search without a start,
which is faster for five scattered points.

Tried and dropped (2026-11): a list of the leaves within reach of sixteen neighbours, which each of them scans
instead of traversing the tree (0.94 of the time on a part of 3 k faces, 1.4 on one of 43 k).
"""

from math import sqrt

import numpy as np

from proximity.kernels.answers import (
    POINT_ANSWER_FACE,
    POINT_ANSWER_FEATURE,
    POINT_ANSWER_IS_SIGNED,
    POINT_ANSWER_PART,
    POINT_ANSWER_REALS,
    POINT_ANSWER_SIGNED_DISTANCE,
    POINT_ANSWER_WIDTH,
)
from proximity.kernels.geometry.closest_feature import stack_closest
from proximity.kernels.geometry.closest_lanes import (
    LANES_FEATURE,
    LANES_HEIGHT,
    sides_of_lanes,
)
from proximity.kernels.geometry.frames import (
    LENGTH_ROUNDING,
    can_be_asked,
    is_alone,
    looks_like_millimetres,
    to_local,
)
from proximity.kernels.layout import (
    FEATURE_FACE,
    FEATURE_NONE,
    IN_MILLIMETRES,
    LANES,
    NO_FACE,
    NO_PART,
    NO_ROW,
    NO_SLOT,
    SIGN_NONE,
    STACKS_SIZE,
    ModelArrays,
)
from proximity.kernels.nodes import offset_of
from proximity.kernels.point.answer_rows import answers_of_chunk
from proximity.kernels.point.walk import NOTHING_SEEN, closest_in_part, nearest_from_block
from proximity.kernels.scene.inside.chunk_tables import (
    POINT_CHUNK,
    Chunk,
    new_candidates,
    new_features,
    new_found,
    new_workspace,
    reset_found,
    reset_recent,
)
from proximity.kernels.scene.inside.containment import (
    deepest_of_certain,
    deepest_of_chunk,
    is_contained,
    note_candidates,
)
from proximity.kernels.sign.side import (
    closest_of_lane,
    has_normals,
    is_beyond,
    signed_of_slot,
)
from proximity.kernels.stack_arrays import stack_f32, stack_f64, stack_i64
from proximity.native import ROWS_WITH_GIL, entry, inlined, kernel
from proximity.native.simd import prefetch

NO_INSIDE = 0
"""Returned by `contains_batch` if no part has an inside."""


@entry(ModelArrays, "float64[:, 3], int64[:], float64[:], float64[:, 1] -> int", rows_with_gil=ROWS_WITH_GIL)
def distance_batch(model, points, order, limits, distances):
    """Fill unsigned distances (N, 1), m. *limits* are ignored."""
    stacks = stack_f32(STACKS_SIZE)
    _, _, frames, parts = model
    scale = frames[len(parts) - 1].scale
    limit_sq = reach_sq(np.inf)
    part, slot = np.int64(NO_PART), np.int64(NO_SLOT)
    for i in range(len(order) if len(order) else len(points)):
        row = row_of(order, i)
        fetch_row(points, order, i + POINT_CHUNK)
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        if not can_be_asked(frames, parts, x, y, z):
            distances[row, 0] = np.nan
            continue
        if not len(order):
            part, slot = np.int64(NO_PART), np.int64(NO_SLOT)
        best_sq, part, slot = nearest_from_block(model, (x, y, z), limit_sq, part, slot, stacks)
        distances[row, 0] = sqrt(best_sq) / scale if slot >= 0 else np.inf
    return _units_code(frames, order, distances)


@inlined
def _units_code(frames, order, answers):
    """Return `IN_MILLIMETRES` if all rows of a small batch suggest points in millimetres; else `NO_ROW`."""
    if len(order) or not len(answers):
        return NO_ROW
    for row in range(len(answers)):
        if not looks_like_millimetres(frames, answers[row, 0]):
            return NO_ROW
    return IN_MILLIMETRES


@kernel
def signed_alone(model, points, distances):
    """Fill signed distances (N, 1), m, to a single part, without the tables of large batches."""
    _, _, frames, parts = model
    stacks, closest = stack_f32(STACKS_SIZE), stack_closest(1)[0]
    for row in range(len(points)):
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        distances[row, 0] = np.nan
        if can_be_asked(frames, parts, x, y, z):
            p = to_local(frames, parts, 0, x, y, z)
            _, slot = closest_in_part(
                model, 0, parts[0].root, p, np.inf, np.int64(NO_SLOT), NOTHING_SEEN, stacks
            )
            signed = signed_of_slot(model, 0, slot, p, closest)
            distances[row, 0] = signed / frames[0].scale


@entry(ModelArrays, "float64[:, 3], int64[:], float64[:], float64[:, 1] -> int", rows_with_gil=ROWS_WITH_GIL)
def signed_batch(model, points, order, limits, distances):
    """Fill signed distances (N, 1), m. *limits* are ignored."""
    _, _, frames, parts = model
    if is_alone(parts) and not len(order):
        signed_alone(model, points, distances)
        return _units_code(frames, order, distances)
    rows, reaches, no_limits = stack_i64(POINT_CHUNK), stack_f64(POINT_CHUNK), stack_f64(0)
    candidates, found, features, workspace = (new_candidates(), new_found(), new_features(), new_workspace())
    for k in range(POINT_CHUNK):
        reaches[k] = np.inf
    reset_found(found, workspace)
    total = len(order) if len(order) else len(points)
    for first in range(0, total, POINT_CHUNK):
        chunk = Chunk(points, rows, min(POINT_CHUNK, total - first))
        pair_count = begin_chunk(model, chunk, order, first, no_limits, reaches, candidates, found, workspace)
        nearest_of_chunk(model, chunk, order, reaches, candidates, found, workspace)
        signs_of_chunk(model, chunk, candidates, found, features, workspace)
        if len(parts) > 2:
            deepest_of_chunk(model, chunk, candidates, pair_count, found, workspace)
            for k in range(chunk.point_count):
                part = found.deeper[k, 0]
                if part != NO_PART and part != found.nearest[k, 0]:
                    row, slot = rows[k], found.deeper[k, 1]
                    p = to_local(frames, parts, part, points[row, 0], points[row, 1], points[row, 2])
                    depth = signed_of_slot(model, part, slot, p, workspace.closest[0])
                    found.distances[k] = -abs(depth) / frames[part].scale
        for k in range(chunk.point_count):
            distances[rows[k], 0] = found.distances[k]
    return _units_code(frames, order, distances)


@entry(ModelArrays, "float64[:, 3], int64[:], float64[:], float64[:, 12] -> int", rows_with_gil=ROWS_WITH_GIL)
def closest_batch(model, points, order, limits, answers):
    """Fill answers (N, `POINT_ANSWER_WIDTH`), columns as in `answers`. *limits*, m: (1,) or (N,)."""
    _, _, frames, parts = model
    choices = answers.view(np.int32)
    rows, reaches = stack_i64(POINT_CHUNK), stack_f64(POINT_CHUNK)
    candidates, found, features, workspace = (new_candidates(), new_found(), new_features(), new_workspace())
    reset_found(found, workspace)
    total = len(order) if len(order) else len(points)
    for first in range(0, total, POINT_CHUNK):
        chunk = Chunk(points, rows, min(POINT_CHUNK, total - first))
        pair_count = begin_chunk(model, chunk, order, first, limits, reaches, candidates, found, workspace)
        nearest_of_chunk(model, chunk, order, reaches, candidates, found, workspace)
        for k in range(chunk.point_count):
            prefetch(answers, POINT_ANSWER_WIDTH * rows[k])
            prefetch(answers, POINT_ANSWER_WIDTH * rows[k] + POINT_ANSWER_WIDTH - 1)
        if len(parts) > 2:
            signs_of_chunk(model, chunk, candidates, found, features, workspace)
            deepest_of_chunk(model, chunk, candidates, pair_count, found, workspace)
        _gather(model, chunk, found, features, len(parts) > 2)
        answers_of_chunk(model, features, chunk.point_count)
        for k in range(chunk.point_count):
            row = rows[k]
            if features.parts[k] == NO_PART:
                write_nothing(answers, choices, row, found.distances[k])
            else:
                _write_column(parts, features, k, limit_of(limits, row), answers, choices, row)
    return _units_code(frames, order, answers)


@inlined
def _write_column(parts, features, k, limit, answers, choices, row):
    """Write the answer of the *k*-th point, which `answers_of_chunk` has computed."""
    table, part = features.table, features.parts[k]
    if not abs(table[POINT_CHUNK * POINT_ANSWER_SIGNED_DISTANCE + k]) <= limit:
        write_nothing(answers, choices, row, np.inf)
        return
    for column in range(POINT_ANSWER_REALS):
        answers[row, column] = table[POINT_CHUNK * column + k]
    choices[row, POINT_ANSWER_PART] = part
    choices[row, POINT_ANSWER_FACE] = features.faces[k]
    choices[row, POINT_ANSWER_FEATURE] = np.int64(table[POINT_CHUNK * LANES_FEATURE + k])
    choices[row, POINT_ANSWER_IS_SIGNED] = parts[part].sign != SIGN_NONE


@inlined
def write_nothing(answers, choices, row, distance):
    for column in range(POINT_ANSWER_REALS):
        answers[row, column] = np.nan
    answers[row, POINT_ANSWER_SIGNED_DISTANCE] = distance
    choices[row, POINT_ANSWER_PART] = NO_PART
    choices[row, POINT_ANSWER_FACE] = NO_FACE
    choices[row, POINT_ANSWER_FEATURE] = FEATURE_NONE
    choices[row, POINT_ANSWER_IS_SIGNED] = 0


@entry(ModelArrays, "float64[:, 3], int64[:], float64[:], bool[:, 1] -> int", rows_with_gil=ROWS_WITH_GIL)
def contains_batch(model, points, order, limits, inside):
    """Test whether each point is inside some part, into *inside*; points that are not finite are outside.

    *limits* are ignored. Returns `NO_INSIDE`, without a result, if no part has an inside.
    """
    part, count = 0, len(model.parts) - 1
    while part < count and model.parts[part].sign == SIGN_NONE:
        part += 1
    if part == count:
        return NO_INSIDE
    workspace = new_workspace()
    reset_recent(workspace)
    for i in range(len(order) if len(order) else len(points)):
        row = row_of(order, i)
        fetch_row(points, order, i + POINT_CHUNK)
        inside[row, 0] = is_contained(model, (points[row, 0], points[row, 1], points[row, 2]), workspace)
    return NO_ROW


# --- steps on a chunk of points: containing parts, nearest surface, side ---


@inlined
def reach_sq(limit):
    """Return the squared local search radius for *limit*, enlarged for the rounding of distances."""
    return (limit + LENGTH_ROUNDING) * (limit + LENGTH_ROUNDING) * (1.0 + LENGTH_ROUNDING)


@inlined
def row_of(order, i):
    """Return the *i*-th row in order."""
    return order[i] if len(order) else i


@inlined
def limit_of(limits, row):
    """Return the limit of a row: (N,) has one per row, (1,) one for all."""
    return limits[row] if len(limits) > 1 else limits[0]


@inlined
def fetch_row(rows, order, i):
    """Prefetch the *i*-th row in order, if there is one."""
    if i < len(order):
        prefetch(rows, 3 * order[i])
        prefetch(rows, 3 * order[i] + 2)


@inlined
def begin_chunk(model, chunk, order, first, limits, reaches, candidates, found, workspace):
    """Fill rows and search radii of the next chunk, and find the depth of points that are certainly inside.

    See `deepest_of_certain`; skipped for a single part. With a limit, most searches end sooner than depths
    are found. Empty *limits*: *reaches* are filled already.
    """
    _, _, frames, parts = model
    points, rows, count = chunk
    certain = candidates.certain
    for k in range(count):
        rows[k], certain[k] = row_of(order, first + k), 0
        fetch_row(points, order, first + k + POINT_CHUNK)
    if len(limits):
        scale = frames[len(parts) - 1].scale
        for k in range(count):
            reaches[k] = reach_sq(limit_of(limits, rows[k]) * scale)
    if len(parts) <= 2:
        return 0
    pair_count = note_candidates(model, chunk, candidates)
    if len(limits):
        for k in range(count):
            if reaches[k] < np.inf:
                certain[k] = 0
    return deepest_of_certain(model, chunk, candidates, pair_count, found, workspace)


@inlined
def nearest_of_chunk(model, chunk, order, reaches, candidates, found, workspace):
    """Find the nearest face of each point; skip points already known to be inside.

    See `deepest_of_chunk`. Points without a result get `NO_PART`, and the distance nan or inf. The last row
    of nearest, written by the previous chunk, is the start of the first search.
    """
    _, _, frames, parts = model
    points, rows, count = chunk
    nearest, depths, _, distances = found
    part, slot = nearest[POINT_CHUNK, 0], nearest[POINT_CHUNK, 1]
    for k in range(count):
        if candidates.certain[k]:
            continue
        row = rows[k]
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        if not can_be_asked(frames, parts, x, y, z):
            nearest[k, 0], distances[k], depths[k] = NO_PART, np.nan, np.inf
            continue
        if not len(order):
            part, slot = np.int64(NO_PART), np.int64(NO_SLOT)
        best_sq, part, slot = nearest_from_block(model, (x, y, z), reaches[k], part, slot, workspace.stacks)
        nearest[k, 0], nearest[k, 1], depths[k], distances[k] = part, slot, best_sq, np.inf
    nearest[POINT_CHUNK, 0], nearest[POINT_CHUNK, 1] = part, slot


@inlined
def signs_of_chunk(model, chunk, candidates, found, features, workspace):
    """Fill the signed distances of a chunk, m, and set the depth to -1 of points outside their nearest part.

    Closest features are computed for eight points at a time.
    """
    reals, words, frames, parts = model
    nearest, depths, _, distances = found
    offsets, local_points, table = features.offsets, features.local_points, features.table
    _gather(model, chunk, found, features, False)
    for at in range(0, chunk.point_count, LANES):
        sides_of_lanes(reals, offsets, at, local_points, table)
    for k in range(chunk.point_count):
        part, slot = nearest[k, 0], nearest[k, 1]
        if part != NO_PART:
            p = local_points[k], local_points[POINT_CHUNK + k], local_points[2 * POINT_CHUNK + k]
            signed = table[LANES_HEIGHT * POINT_CHUNK + k] + 0.0  # never -0.0
            is_over = table[LANES_FEATURE * POINT_CHUNK + k] == FEATURE_FACE
            if not is_over or is_beyond(p) or not has_normals(words, parts, part, slot):
                _, _, inside = closest_of_lane(model, part, slot, p, table, k, workspace.closest[0])
                length = workspace.closest[0].length
                signed = -length if inside else length
            if candidates.certain[k]:
                signed = -abs(signed)
            elif not signed < 0.0:
                depths[k] = -1.0
            distances[k] = signed / frames[part].scale


@inlined
def _gather(model, chunk, found, features, are_deeper):
    """Fill the nearest triangle of each point, or that of a deeper part, and the points in their frames.

    *are_deeper*: whether deeper parts are known.
    """
    _, _, frames, parts = model
    points, rows, count = chunk
    offsets, local_points = features.offsets, features.local_points
    for k in range(-(-count // LANES) * LANES):
        offsets[k], features.parts[k], features.slots[k], features.are_inside[k] = 0, NO_PART, 0, 0
        if k < count and found.nearest[k, 0] != NO_PART:
            row, part, slot = rows[k], found.nearest[k, 0], found.nearest[k, 1]
            if are_deeper and found.deeper[k, 0] != NO_PART:
                part, slot, features.are_inside[k] = found.deeper[k, 0], found.deeper[k, 1], 1
            offsets[k], features.parts[k], features.slots[k] = offset_of(slot), part, slot
            local_points[k], local_points[POINT_CHUNK + k], local_points[2 * POINT_CHUNK + k] = to_local(
                frames, parts, part, points[row, 0], points[row, 1], points[row, 2]
            )
