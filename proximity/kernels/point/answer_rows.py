"""Answers for closest points, computed for eight points at a time in the scene's frame.

The formulas and their order are those of `side.closest_of_slot` and `nearest_parts`, so that a
point gets the same answer alone or in a batch.
"""

import numpy as np

from proximity.kernels.geometry.closest_lanes import (
    LANES_ARM,
    LANES_FEATURE,
    LANES_LENGTH,
    LANES_NORMAL,
    LANES_POINT,
    LANES_WHICH,
    chosen,
    closest_of_lanes,
    load_point,
    store_point,
)
from proximity.kernels.geometry.frames import CENTRE_AT, SCALE_AT, TRANSLATION_AT, direction_to_scene
from proximity.kernels.geometry.rows import columns
from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.layout import (
    ALL_LANES,
    FEATURE_EDGE,
    FEATURE_VERTEX,
    FRAME_COLUMNS,
    LANES,
    NO_PART,
    SIGN_NONE,
)
from proximity.kernels.sign.side import MIN_SIDE_SINE, has_normals, is_inside_by_winding
from proximity.kernels.stack_arrays import reals_of, stack_f64, stack_i64
from proximity.native import inlined, kernel
from proximity.native.simd import (
    absolute,
    bits,
    load,
    load_each,
    load_int,
    maximum,
    select,
    splat,
    square_root,
    store,
    trailing_zeros,
)

SHORTEST_ARM = 1e-150
"""Local units; the square of a shorter arm underflows."""
CORNERS_OF_LANES = 3 * LANES


@kernel
def answers_of_chunk(model, features, count):
    """Fill the table and the faces of a chunk; the first columns of the table are the numbers of an answer.

    They are meaningless for points without a part.
    """
    frames_at, corners, turns = stack_i64(LANES), stack_i64(CORNERS_OF_LANES), stack_f64(LANES)
    for at in range(0, count, LANES):
        closest_of_lanes(model.reals, features.offsets, at, features.local_points, features.table)
        _answers_of_lanes(model, features, at, frames_at, corners, turns)


@inlined
def _answers_of_lanes(model, features, at, frames_at, corners, turns):
    """Turn columns *at* to *at* + 7 of the table of `closest_of_lanes` into answers.

    The last three arguments are scratch memory.
    """
    _, words, frames, parts = model
    table, local, chunk = features.table, features.local_points, len(features.slots)
    turned, by_winding, known, missing = 0, 0, 0, 0
    for k in range(LANES):
        part, slot = max(features.parts[at + k], 0), features.slots[at + k]
        features.faces[at + k] = load_int(words, parts[part].slot_faces + slot)
        frames_at[k] = FRAME_COLUMNS * part
        turned |= np.int64(parts[part].is_turned != 0) << k
        by_winding |= np.int64(not has_normals(words, parts, part, slot)) << k
        missing |= np.int64(features.parts[at + k] == NO_PART) << k
        known |= np.int64((features.are_inside[at + k] != 0) | (parts[part].sign == SIGN_NONE)) << k
    length, arm = load(table, LANES_LENGTH * chunk + at), load_point(table, chunk, at, LANES_ARM)
    normal = _pseudo_normals(model, features, at, ALL_LANES & ~missing, corners, turns)
    zero, one = splat(0.0), splat(1.0)
    x, y, z = load_point(local, chunk, at, 0)
    is_outside = (maximum(maximum(absolute(x), absolute(y)), absolute(z)) > one) | (length == zero)
    side = dot(*arm, *normal)
    store(turns, 0, select(is_outside, one, select(side < zero, splat(-1.0), one)))
    undecided = (~bits(absolute(side) > splat(MIN_SIDE_SINE) * length) | by_winding) & ~bits(is_outside)
    rest = (undecided | known) & ALL_LANES & ~missing
    while rest:
        k = trailing_zeros(rest)
        rest &= rest - 1
        is_inside = features.are_inside[at + k] != 0
        if not (known >> k) & 1:
            p = local[at + k], local[chunk + at + k], local[2 * chunk + at + k]
            is_inside, _ = is_inside_by_winding(model, features.parts[at + k], p)
        turns[k] = -1.0 if is_inside else 1.0
    turn, frame_reals = load(turns, 0), reals_of(frames)
    metres = one / load_each(frame_reals, frames_at, 0, SCALE_AT)
    x, y, z = load_point(table, chunk, at, LANES_POINT)
    x = x * metres + load_each(frame_reals, frames_at, 0, CENTRE_AT)
    y = y * metres + load_each(frame_reals, frames_at, 0, CENTRE_AT + 1)
    z = z * metres + load_each(frame_reals, frames_at, 0, CENTRE_AT + 2)
    # A shorter connection has no usable direction; the pseudo-normal stays, as on the surface.
    is_long, factor = length > splat(SHORTEST_ARM), turn / length
    nx, ny, nz = chosen(is_long, (arm[0] * factor, arm[1] * factor, arm[2] * factor), normal)
    store_point(table, chunk, at, LANES_POINT, (x, y, z))
    store_point(table, chunk, at, LANES_NORMAL, (nx, ny, nz))
    turned &= ~missing
    while turned:  # a rotation by the identity would change the sign of zeros
        k = at + trailing_zeros(turned)
        turned &= turned - 1
        _turn(model, features.parts[k], table, LANES_POINT * chunk + k, chunk)
        _turn(model, features.parts[k], table, LANES_NORMAL * chunk + k, chunk)
    x, y, z = load_point(table, chunk, at, LANES_POINT)
    x = x + load_each(frame_reals, frames_at, 0, TRANSLATION_AT)
    y = y + load_each(frame_reals, frames_at, 0, TRANSLATION_AT + 1)
    z = z + load_each(frame_reals, frames_at, 0, TRANSLATION_AT + 2)
    store(table, LANES_LENGTH * chunk + at, turn * (length * metres))
    store_point(table, chunk, at, LANES_POINT, (x, y, z))


@kernel
def _turn(model, part, table, at, chunk):
    """Rotate the direction at positions *at*, *at* + chunk and *at* + 2 chunk from its part to the scene."""
    x, y, z = table[at], table[at + chunk], table[at + 2 * chunk]
    x, y, z = direction_to_scene(model.frames, model.parts, part, x, y, z)
    table[at], table[at + chunk], table[at + 2 * chunk] = x, y, z


@inlined
def _pseudo_normals(model, features, at, used, corners, has_neighbor):
    """Return the pseudo-normals of eight features, in the same way as `side.pseudo_normal`.

    *used*: bits of the lanes with a part; others are meaningless. The last two arguments are scratch memory.
    """
    reals, words, _, parts = model
    table, chunk = features.table, len(features.slots)
    feature, which_at = load(table, LANES_FEATURE * chunk + at), LANES_WHICH * chunk + at
    edges = bits(feature == splat(float(FEATURE_EDGE))) & used
    vertices = bits(feature == splat(float(FEATURE_VERTEX))) & used
    if edges:
        for k in range(CORNERS_OF_LANES):
            corners[k] = 0
        store(has_neighbor, 0, splat(0.0))
        while edges:
            k = trailing_zeros(edges)
            edges &= edges - 1
            part, face = features.parts[at + k], features.faces[at + k]
            neighbor = load_int(words, parts[part].neighbors + 3 * face + np.int64(table[which_at + k]))
            if neighbor >= 0:
                has_neighbor[k] = 1.0
                for j in range(3):
                    corner = load_int(words, parts[part].faces + 3 * neighbor + j)
                    corners[LANES * j + k] = parts[part].corners + 3 * corner
        added = _with_neighbors(reals, load_point(table, chunk, at, LANES_NORMAL), corners, has_neighbor)
        store_point(table, chunk, at, LANES_NORMAL, added)
    while vertices:
        k = trailing_zeros(vertices)
        vertices &= vertices - 1
        part, face = features.parts[at + k], features.faces[at + k]
        corner = load_int(words, parts[part].faces + 3 * face + np.int64(table[which_at + k]))
        for j in range(3):
            normal = reals[parts[part].corner_normals + 3 * corner + j]
            table[(LANES_NORMAL + j) * chunk + at + k] = normal
    return load_point(table, chunk, at, LANES_NORMAL)


@inlined
def _with_neighbors(reals, normal, corners, has_neighbor):
    """Return the unit normals of eight edges from those of their faces, and the corners of the neighbors."""
    a, b, c = columns(reals, corners, 0), columns(reals, corners, LANES), columns(reals, corners, 2 * LANES)
    nx, ny, nz = cross(
        b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2]
    )  # fmt: skip
    has, zero = load(has_neighbor, 0) > splat(0.0), splat(0.0)
    length = square_root(dot(nx, ny, nz, nx, ny, nz))
    sums = normal[0] + nx / length, normal[1] + ny / length, normal[2] + nz / length
    sums = chosen(length > zero, sums, normal)
    length = square_root(dot(*sums, *sums))
    unit = sums[0] / length, sums[1] / length, sums[2] / length
    return chosen(has, chosen(length > zero, unit, sums), normal)
