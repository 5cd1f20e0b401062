"""What is reported of rays: rows of answers, worked out for eight hits at a time."""

import numpy as np

from proximity.kernels.geometry.frames import (
    part_of_slot,
)
from proximity.kernels.geometry.triangle import cross, dot, place_of
from proximity.kernels.layout import (
    CENTRE,
    FRAME_COLUMNS,
    IS_TURNED,
    LANES,
    NO_FACE,
    NO_PART,
    ROTATION,
    SCALE,
    SLOT_FACES,
    TRANSLATION,
)
from proximity.kernels.ray.ray_lanes import CHUNK, HIT, WAY, load_three, store_three
from proximity.native import inlined
from proximity.simd import load_each, load_int, maximum, select, splat, square_root

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
HITS_SIZE = ANSWER_REALS * CHUNK
"""float64 of a table of answers, column by column."""
PLACES_SIZE = 2 * CHUNK


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
def write_hit(words, parts, part, slot, hits, k, answers, choices, row):
    """The row of hit *k* of the table, which `work_out` has filled, but for its distance."""
    for column in range(1, ANSWER_REALS):
        answers[row, column] = hits[CHUNK * column + k]
    choices[row, PART] = part
    choices[row, FACE] = load_int(words, parts[part, SLOT_FACES] + slot)


@inlined
def work_out(reals, words, frames, parts, slots, at, views, owners, places, hits):
    """Fill columns *at* to *at* + 7 of *hits*: point, normal and barycentric of hits, scene's frame.

    *slots*: what was hit; where that is negative, nothing comes of it. *views*: the table of the rays.
    *owners* gets the part of each; *places* (PLACES_SIZE,) is scratch.
    """
    is_turned = False
    for k in range(at, at + LANES):
        slot = max(slots[k], 0)
        part = part_of_slot(words, parts, slot)
        owners[k] = part
        places[k] = place_of(slot)
        places[CHUNK + k] = FRAME_COLUMNS * part
        is_turned |= parts[part, IS_TURNED] != 0
    u, v, w = load_three(views, HIT, at)
    total = u + v + w
    b0, b1, b2 = u / total, v / total, w / total
    store_three(hits, BARYCENTRIC, at, b0, b1, b2)

    ax, ay, az = _corner(reals, places, at, 0)
    bx, by, bz = _corner(reals, places, at, 24)
    cx, cy, cz = _corner(reals, places, at, 48)
    # From the corner that weighs most: nothing is lost where the hit is a corner.
    is_b, is_c = b1 > b0, b2 > maximum(b0, b1)
    second, third = _after(is_b, is_c, b0, b1, b2)
    frames_at = CHUNK + at
    metres = splat(1.0) / load_each(frames, places, frames_at, SCALE)
    px = _weighted(is_b, is_c, ax, bx, cx, second, third) * metres + load_each(
        frames, places, frames_at, CENTRE
    )
    py = _weighted(is_b, is_c, ay, by, cy, second, third) * metres + load_each(
        frames, places, frames_at, CENTRE + 1
    )
    pz = _weighted(is_b, is_c, az, bz, cz, second, third) * metres + load_each(
        frames, places, frames_at, CENTRE + 2
    )
    nx, ny, nz = cross(bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az)
    if is_turned:
        px, py, pz = _turned(frames, places, frames_at, px, py, pz)
        nx, ny, nz = _turned(frames, places, frames_at, nx, ny, nz)
    store_three(
        hits, POINT, at,
        px + load_each(frames, places, frames_at, TRANSLATION),
        py + load_each(frames, places, frames_at, TRANSLATION + 1),
        pz + load_each(frames, places, frames_at, TRANSLATION + 2),
    )  # fmt: skip
    # A face without area has no normal: it faces the ray.
    size_sq = dot(nx, ny, nz, nx, ny, nz)
    has_area = size_sq > splat(0.0)
    dx, dy, dz = load_three(views, WAY, at)
    nx, ny, nz = select(has_area, nx, -dx), select(has_area, ny, -dy), select(has_area, nz, -dz)
    size = square_root(select(has_area, size_sq, dot(dx, dy, dz, dx, dy, dz)))
    store_three(hits, NORMAL, at, nx / size, ny / size, nz / size)


@inlined
def _corner(reals, places, at, corner):
    return (
        load_each(reals, places, at, corner),
        load_each(reals, places, at, corner + 8),
        load_each(reals, places, at, corner + 16),
    )


@inlined
def _after(is_b, is_c, a, b, c):
    """Of three that go round, the two that come after the one that weighs most."""
    return select(is_c, a, select(is_b, c, b)), select(is_c, b, select(is_b, a, c))


@inlined
def _weighted(is_b, is_c, a, b, c, second, third):
    """A coordinate from those of the corners, and the weights of the two after the heaviest."""
    heaviest = select(is_c, c, select(is_b, b, a))
    one, other = _after(is_b, is_c, a, b, c)
    return heaviest + second * (one - heaviest) + third * (other - heaviest)


@inlined
def _turned(frames, places, at, x, y, z):
    """Directions of the parts' frames in the scene's: `scene.direction_to_scene` of eight."""
    return (
        _along(frames, places, at, 0, x, y, z),
        _along(frames, places, at, 3, x, y, z),
        _along(frames, places, at, 6, x, y, z),
    )


@inlined
def _along(frames, places, at, row, x, y, z):
    return (
        load_each(frames, places, at, ROTATION + row) * x
        + load_each(frames, places, at, ROTATION + row + 1) * y
        + load_each(frames, places, at, ROTATION + row + 2) * z
    )
