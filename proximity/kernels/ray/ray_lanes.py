"""Preparation of rays for a walk, eight at a time.

Preparing a single ray would take three steps of a walk.
"""

from math import frexp, ldexp

import numpy as np

from proximity.kernels.geometry.frames import FARTHEST_LOCAL, direction_to_local, to_local
from proximity.kernels.geometry.rows import columns
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import LANES
from proximity.kernels.ray.walk import SLAB_MARGIN, aim_and_view, approach, bound_of_parameter, is_from_afar
from proximity.native import inlined
from proximity.native.simd import (
    absolute,
    bits,
    load,
    maximum,
    minimum,
    narrow,
    select,
    splat,
    square_root,
    store,
)

RAY_CHUNK = 64
"""Rays per table; each row is a quantity, each column a ray."""

# rows of the float32 table
AIM_SLABS = 0  # nine
AIM_BOUND = 9  # initial limit for bounds of boxes
AIM_ROWS = 10
# rows of the float64 table
VIEW_LINE = 0  # seven
VIEW_START = 7  # parameter that bounds are counted from
VIEW_DIRECTION = 8  # direction, scene's frame, scaled
VIEW_IS_SOUND = 11  # 0 for an invalid ray
VIEW_REACH = 12  # longest parameter, m in units of the direction's length
VIEW_WEIGHTS = 13  # weights of the hit, three
VIEW_ROWS = 16

WIDEST_MARGIN = 2.0**60
"""Largest padding of boxes, local units: it opens all of them, and its product with a reciprocal, at most
2^60, still fits float32."""
AIM_SIZE, VIEW_SIZE = AIM_ROWS * RAY_CHUNK, VIEW_ROWS * RAY_CHUNK


@inlined
def make_ready(frames, parts, walk_row, drift, origins, directions, offsets, at, aims, views):
    """Fill columns *at* to *at* + 7 of the tables, for rays in the frame of row *walk_row*.

    *origins*, *directions* (N, 3); *offsets* (RAY_CHUNK,): offset of each ray. *drift*: additional padding of
    boxes per unit of the origin's distance. Row `VIEW_REACH` holds limits, m.
    """
    x, y, z = columns(origins, offsets, at)
    dx, dy, dz = columns(directions, offsets, at)
    zero, one = splat(0.0), splat(1.0)
    largest = maximum(maximum(absolute(dx), absolute(dy)), absolute(dz))
    # x - x is not zero if x is not finite.
    is_finite = ((x - x) + (y - y) + (z - z) + (dx - dx) + (dy - dy) + (dz - dz)) == zero
    is_sound = is_finite & (largest > zero)
    if bits(is_sound & (largest >= splat(0.5)) & (largest < splat(2.0))) != 2**LANES - 1:
        x, y, z = select(is_sound, x, zero), select(is_sound, y, zero), select(is_sound, z, zero)
        dx, dy, dz = select(is_sound, dx, one), select(is_sound, dy, one), select(is_sound, dz, one)
        dx, dy, dz = _scaled(dx, dy, dz, views, at)
    reach = load(views, RAY_CHUNK * VIEW_REACH + at)
    if bits(reach < splat(np.inf)):
        # Slightly farther, so that rounding does not lose a hit at the limit.
        reach = reach / square_root(dot(dx, dy, dz, dx, dy, dz)) * splat(1.0 + 1e-12)
    store_three(views, VIEW_DIRECTION, at, dx, dy, dz)
    store(views, RAY_CHUNK * VIEW_REACH + at, reach)

    x, y, z = to_local(frames, parts, walk_row, x, y, z)
    dx, dy, dz = direction_to_local(frames, parts, walk_row, dx, dy, dz)
    away = maximum(maximum(absolute(x), absolute(y)), absolute(z))
    margin = minimum(splat(SLAB_MARGIN) + splat(drift) * away, splat(WIDEST_MARGIN))
    entry, passes_by = zero, zero > one
    is_far = is_from_afar(x, y, z)
    if bits(is_far):
        is_near, enter, near_x, near_y, near_z = approach(x, y, z, dx, dy, dz)
        entry, passes_by = select(is_far, enter, zero), is_far & ~is_near
        x, y, z = select(is_far, near_x, x), select(is_far, near_y, y), select(is_far, near_z, z)
    # Beyond the range of the arithmetic the hit is unknown.
    is_sound = is_sound & ((away < splat(FARTHEST_LOCAL)) | passes_by)
    store(views, RAY_CHUNK * VIEW_IS_SOUND + at, select(is_sound, one, zero))
    aim, view = aim_and_view(x, y, z, dx, dy, dz, margin)
    store_three(aims, AIM_SLABS, at, aim[0], aim[1], aim[2])
    store_three(aims, AIM_SLABS + 3, at, aim[3], aim[4], aim[5])
    store_three(aims, AIM_SLABS + 6, at, aim[6], aim[7], aim[8])
    store_three(views, VIEW_LINE, at, view[0], view[1], view[2])
    store_three(views, VIEW_LINE + 3, at, view[3], view[4], view[5])
    store(views, RAY_CHUNK * (VIEW_LINE + 6) + at, view[6])
    store(views, RAY_CHUNK * VIEW_START + at, entry)
    # A ray that misses the part or is invalid opens no box.
    bound = bound_of_parameter(reach * splat(frames[walk_row].scale), entry)
    store(aims, RAY_CHUNK * AIM_BOUND + at, select(passes_by | ~is_sound, narrow(splat(-1.0)), bound))


@inlined
def store_three(table, row, at, x, y, z):
    """Store eight rays' numbers in three rows of a table."""
    store(table, RAY_CHUNK * row + at, x)
    store(table, RAY_CHUNK * (row + 1) + at, y)
    store(table, RAY_CHUNK * (row + 2) + at, z)


@inlined
def load_three(table, row, at):
    """Load three rows of a table for eight rays."""
    return (
        load(table, RAY_CHUNK * row + at),
        load(table, RAY_CHUNK * (row + 1) + at),
        load(table, RAY_CHUNK * (row + 2) + at),
    )


@inlined
def three_of(table, row, k):
    """Return three rows of a table for ray *k*."""
    return number_at(table, row, k), number_at(table, row + 1, k), number_at(table, row + 2, k)


@inlined
def number_at(table, row, k):
    """Return a number of ray *k*. The position is unsigned: a negative one would cost three instructions."""
    return table[np.uint64(RAY_CHUNK * row + k)]


@inlined
def scaled_direction(x, y, z):
    """Return the direction times the power of two that brings its largest component to 0.5 … 2."""
    largest = max(abs(x), abs(y), abs(z))
    if largest >= 0.5 and largest < 2.0:
        return x, y, z
    exponent = -frexp(largest)[1]
    return ldexp(x, exponent), ldexp(y, exponent), ldexp(z, exponent)


@inlined
def _scaled(x, y, z, views, at):
    """Scale eight directions like `scaled_direction`, through the table."""
    store_three(views, VIEW_DIRECTION, at, x, y, z)
    first = RAY_CHUNK * VIEW_DIRECTION + at
    for k in range(first, first + LANES):
        views[k], views[k + RAY_CHUNK], views[k + 2 * RAY_CHUNK] = scaled_direction(
            views[k], views[k + RAY_CHUNK], views[k + 2 * RAY_CHUNK]
        )
    return load_three(views, VIEW_DIRECTION, at)


@inlined
def aim_of(aims, k):
    """Return the numbers of ray *k* for box tests."""
    return (
        *three_of(aims, AIM_SLABS, k),
        *three_of(aims, AIM_SLABS + 3, k),
        *three_of(aims, AIM_SLABS + 6, k),
    )


@inlined
def view_of(views, k):
    """Return the numbers of ray *k* for triangle tests."""
    return (
        *three_of(views, VIEW_LINE, k),
        *three_of(views, VIEW_LINE + 3, k),
        number_at(views, VIEW_LINE + 6, k),
    )


@inlined
def direction_of(views, k):
    """Return the scaled direction of ray *k*, scene's frame."""
    return three_of(views, VIEW_DIRECTION, k)
