"""Answer rows for rays, computed for eight hits at a time."""

import numpy as np

from proximity.kernels.answers import (
    DISTANCE_WIDTH,
    RAY_ANSWER_BARYCENTRIC,
    RAY_ANSWER_DISTANCE,
    RAY_ANSWER_FACE,
    RAY_ANSWER_NORMAL,
    RAY_ANSWER_PART,
    RAY_ANSWER_POINT,
    RAY_ANSWER_REALS,
)
from proximity.kernels.geometry.frames import (
    CENTRE_AT,
    SCALE_AT,
    TRANSLATION_AT,
    part_of_slot,
    turned_by_frames,
)
from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.layout import CORNER_STRIDE, FRAME_COLUMNS, LANES, NO_FACE, NO_PART
from proximity.kernels.nodes import offset_of
from proximity.kernels.ray.ray_lanes import RAY_CHUNK, VIEW_DIRECTION, VIEW_WEIGHTS, load_three, store_three
from proximity.kernels.stack_arrays import reals_of
from proximity.native import inlined
from proximity.native.simd import load_each, load_int, maximum, select, splat, square_root

HITS_SIZE = RAY_ANSWER_REALS * RAY_CHUNK
"""float64 of a table of answers by column."""
HIT_OFFSETS_SIZE = 2 * RAY_CHUNK


@inlined
def write_no_hit(answers, choices, row, distance):
    """Write a row without a face: *distance* is inf for a miss, nan for an invalid ray."""
    answers[row, RAY_ANSWER_DISTANCE] = distance
    if answers.shape[1] == DISTANCE_WIDTH:
        return
    for column in range(1, RAY_ANSWER_REALS):
        answers[row, column] = np.nan
    choices[row, RAY_ANSWER_PART] = NO_PART
    choices[row, RAY_ANSWER_FACE] = NO_FACE


@inlined
def write_hit(words, parts, part, slot, hits, k, answers, choices, row):
    """Write the row of hit *k* from the table filled by `fill_hits`, except for its distance."""
    for column in range(1, RAY_ANSWER_REALS):
        answers[row, column] = hits[RAY_CHUNK * column + k]
    choices[row, RAY_ANSWER_PART] = part
    choices[row, RAY_ANSWER_FACE] = load_int(words, parts[part].slot_faces + slot)


@inlined
def fill_hits(reals, words, frames, parts, slots, at, views, owners, hit_offsets, hits):
    """Fill columns *at* to *at* + 7 of *hits*: point, normal and barycentric of hits, scene's frame.

    *slots*: the slots hit; columns with a negative one are meaningless. *views*: the table of the rays.
    *owners* receives the part of each; *hit_offsets* (HIT_OFFSETS_SIZE,) is scratch.
    """
    frame_reals, is_turned = reals_of(frames), False
    for k in range(at, at + LANES):
        slot = max(slots[k], 0)
        part = part_of_slot(words, parts, slot)
        owners[k] = part
        hit_offsets[k] = offset_of(slot)
        hit_offsets[RAY_CHUNK + k] = FRAME_COLUMNS * part
        is_turned |= parts[part].is_turned != 0
    u, v, w = load_three(views, VIEW_WEIGHTS, at)
    total = u + v + w
    b0, b1, b2 = u / total, v / total, w / total
    store_three(hits, RAY_ANSWER_BARYCENTRIC, at, b0, b1, b2)

    ax, ay, az = _corner(reals, hit_offsets, at, 0)
    bx, by, bz = _corner(reals, hit_offsets, at, CORNER_STRIDE)
    cx, cy, cz = _corner(reals, hit_offsets, at, 2 * CORNER_STRIDE)
    # From the corner with the largest weight: a hit at a corner is exact.
    is_b, is_c = b1 > b0, b2 > maximum(b0, b1)
    second, third = _after(is_b, is_c, b0, b1, b2)
    frames_at = RAY_CHUNK + at
    metres = splat(1.0) / load_each(frame_reals, hit_offsets, frames_at, SCALE_AT)
    px = _weighted(is_b, is_c, ax, bx, cx, second, third) * metres
    px = px + load_each(frame_reals, hit_offsets, frames_at, CENTRE_AT)
    py = _weighted(is_b, is_c, ay, by, cy, second, third) * metres
    py = py + load_each(frame_reals, hit_offsets, frames_at, CENTRE_AT + 1)
    pz = _weighted(is_b, is_c, az, bz, cz, second, third) * metres
    pz = pz + load_each(frame_reals, hit_offsets, frames_at, CENTRE_AT + 2)
    nx, ny, nz = cross(bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az)
    if is_turned:
        px, py, pz = turned_by_frames(frame_reals, hit_offsets, frames_at, px, py, pz)
        nx, ny, nz = turned_by_frames(frame_reals, hit_offsets, frames_at, nx, ny, nz)
    store_three(
        hits, RAY_ANSWER_POINT, at,
        px + load_each(frame_reals, hit_offsets, frames_at, TRANSLATION_AT),
        py + load_each(frame_reals, hit_offsets, frames_at, TRANSLATION_AT + 1),
        pz + load_each(frame_reals, hit_offsets, frames_at, TRANSLATION_AT + 2),
    )  # fmt: skip
    # A face without area has no normal: the reverse ray direction is used.
    size_sq = dot(nx, ny, nz, nx, ny, nz)
    has_area = size_sq > splat(0.0)
    dx, dy, dz = load_three(views, VIEW_DIRECTION, at)
    nx, ny, nz = select(has_area, nx, -dx), select(has_area, ny, -dy), select(has_area, nz, -dz)
    size = square_root(select(has_area, size_sq, dot(dx, dy, dz, dx, dy, dz)))
    store_three(hits, RAY_ANSWER_NORMAL, at, nx / size, ny / size, nz / size)


@inlined
def _corner(reals, hit_offsets, at, corner):
    return (
        load_each(reals, hit_offsets, at, corner),
        load_each(reals, hit_offsets, at, corner + LANES),
        load_each(reals, hit_offsets, at, corner + 2 * LANES),
    )


@inlined
def _after(is_b, is_c, a, b, c):
    """Return the two of three values that follow, in cyclic order, the one with the largest weight."""
    return select(is_c, a, select(is_b, c, b)), select(is_c, b, select(is_b, a, c))


@inlined
def _weighted(is_b, is_c, a, b, c, second, third):
    """Return a coordinate from those of the corners, and the weights of the two after the heaviest."""
    heaviest = select(is_c, c, select(is_b, b, a))
    one, other = _after(is_b, is_c, a, b, c)
    return heaviest + second * (one - heaviest) + third * (other - heaviest)
