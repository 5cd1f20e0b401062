"""Steps of point queries on a chunk: containing parts, nearest surface, side.

What comes after, the deepest of several parts that contain a point, is in `containment`.
"""

import numpy as np

from proximity.kernels.geometry.closest_lanes import (
    LANES_FEATURE,
    LANES_HEIGHT,
    closest_of_lanes,
    closest_of_row,
    sides_of_lanes,
)
from proximity.kernels.geometry.frames import LENGTH_ROUNDING, can_be_asked, to_local
from proximity.kernels.geometry.rows import fetch_row, limit_of
from proximity.kernels.inside.chunk_tables import POINT_CHUNK
from proximity.kernels.inside.containment import deepest_of_certain, note_candidates
from proximity.kernels.layout import FEATURE_FACE, LANES, NO_PART, NO_SLOT
from proximity.kernels.nodes import offset_of
from proximity.kernels.point.walk import NOTHING_SEEN, best_of_block, nearest_in_scene
from proximity.kernels.sign.side import closest_of_lane, has_normals, is_beyond
from proximity.native import inlined

FEWEST_IN_LANES = 3
"""Points from which on it is sooner to work out eight at a time what is closest."""


@inlined
def reach_sq(limit):
    """Squared search radius, local, for what is within *limit*: a little more, since distances round."""
    return (limit + LENGTH_ROUNDING) * (limit + LENGTH_ROUNDING) * (1.0 + LENGTH_ROUNDING)


@inlined
def row_of(order, i):
    """The row that is *i*-th in order."""
    return order[i] if len(order) else i


@inlined
def nearest_from_block(model, point, limit_sq, part, slot, stacks):
    """`nearest_in_scene`, starting from the block of what the point before has found, if anything."""
    reals, _, frames, parts = model
    x, y, z = point
    best_sq, seen = limit_sq, np.int64(NOTHING_SEEN)
    if slot >= 0:
        seen = ~(slot // LANES)
        px, py, pz = to_local(frames, parts, part, x, y, z)
        ratio = frames[part].scale / frames[len(parts) - 1].scale
        best_sq, slot = best_of_block(reals, slot, px, py, pz)
        best_sq /= ratio * ratio
        if not best_sq <= limit_sq:
            best_sq, part, slot = limit_sq, np.int64(NO_PART), np.int64(NO_SLOT)
    return nearest_in_scene(model, point, best_sq, part, slot, seen, stacks)


@inlined
def begin_chunk(model, chunk, order, first, limits, reaches, candidates, found, workspace):
    """Fill rows that are next, how far to look for each, and ask parts that contain some of them for certain.

    See `deepest_of_certain`. Of one part there is nothing to be asked. With a limit, most walks end sooner
    than depths are found. No *limits*: *reaches* are filled already.
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

    See `deepest_of_chunk`. Where there is no answer the nearest part is `NO_PART`, and the distance nan or
    inf. What the last chunk ended with, behind the nearest, is where the first walk may start from.
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
    """Fill the signed distances of a chunk, m, and turn depths into -1 where nothing contains the point.

    What is closest is worked out for eight points at a time.
    """
    reals, words, frames, parts = model
    nearest, depths, _, distances = found
    offsets, local_points, table = features
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
def closest_of_chunk(model, chunk, found, features, workspace):
    """Fill what is closest to each point of a chunk, see `closest_of_lanes`.

    That is in the part which contains it deepest, if any does, or else in the nearest one.
    """
    offsets, local_points, table = features
    _gather(model, chunk, found, features, len(model.parts) > 2)
    if chunk.point_count < FEWEST_IN_LANES:
        for k in range(chunk.point_count):
            closest_of_row(model.reals, offsets, k, local_points, table, workspace.closest[0])
        return
    for at in range(0, chunk.point_count, LANES):
        closest_of_lanes(model.reals, offsets, at, local_points, table)


@inlined
def _gather(model, chunk, found, features, are_deeper):
    """Fill where the nearest triangles are, or those of deeper parts, and the points in their frames."""
    _, _, frames, parts = model
    points, rows, count = chunk
    offsets, local_points, _ = features
    for k in range(-(-count // LANES) * LANES):
        offsets[k] = 0
        if k < count and found.nearest[k, 0] != NO_PART:
            row, part, slot = rows[k], found.nearest[k, 0], found.nearest[k, 1]
            if are_deeper and found.deeper[k, 0] != NO_PART:
                part, slot = found.deeper[k, 0], found.deeper[k, 1]
            offsets[k] = offset_of(slot)
            local_points[k], local_points[POINT_CHUNK + k], local_points[2 * POINT_CHUNK + k] = to_local(
                frames, parts, part, points[row, 0], points[row, 1], points[row, 2]
            )
