"""All crossings of a ray with the parts of a scene, or its first hit beyond a distance.

A ray crosses a part as if it were shifted sideways by an infinitesimal amount, the same for all faces of the
part. No edge or corner then lies on the ray: exactly one of the two faces at a shared edge is crossed
where the ray passes through the surface, and both or none where it only touches the edge. Crossings of one
part that rounding cannot order are one crossing if the ray changes its side there, else none.

Source: Edelsbrunner, Mücke 1990, "Simulation of simplicity"; Woop, Benthin, Wald 2013, see `walk`.
"""

import numpy as np

from proximity.kernels.answers import RAY_ANSWER_BARYCENTRIC, RAY_ANSWER_FACE, RAY_ANSWER_PART
from proximity.kernels.geometry.frames import direction_to_local, part_of_slot, to_local
from proximity.kernels.layout import BLOCK_STRIDE, LANES
from proximity.kernels.nodes import turned_corners_of_block
from proximity.kernels.ray.walk import (
    START_SLACK,
    aim_in_part,
    bound_of_parameter,
    corner_seen_along,
    open_children,
    seen_along,
)
from proximity.kernels.traverse.depth_first import depth_first, in_blocks, in_blocks_and_parts, in_order
from proximity.kernels.traverse.ignored_parts import heed_some
from proximity.native import inlined, kernel
from proximity.native.simd import bits, lane, maximum, minimum, select, splat, trailing_zeros

SAME_CROSSING = 2.0**-46
"""Difference of parameters, relative where they exceed 1, up to which their order is not known: four times
what rounding causes. The weights of the corners have one sign, so the slant of a face does not matter."""

# Columns of a hit until `write_crossings` replaces them.
HIT_PARAMETER = 0  # units of the walk
HIT_DISTANCE = 1  # m
HIT_SENSE = RAY_ANSWER_PART  # 1 entering, -1 leaving
HIT_SLOT = RAY_ANSWER_FACE
_CHOSEN = 2  # times the sense


@inlined
def _shifted_side(cross, bx, by, cx, cy):
    """Return a number with the sign of an edge's *cross* product after a shift by (e, e^2), e > 0 tiny."""
    zero = splat(0.0)
    return select(cross == zero, select(by == cy, cx - bx, by - cy), cross)


@inlined
def _crossed_lanes(reals, base, view, u, v, w):
    """Return the mask of the eight triangles at *base* that the shifted line crosses."""
    axis, px, py, pz, lean_x, lean_y, _ = view
    z = np.int64(axis)
    a, b, c = turned_corners_of_block(reals, base, (z + 1) % 3, (z + 2) % 3, z)
    origin, lean_x, lean_y = (splat(px), splat(py), splat(pz)), splat(lean_x), splat(lean_y)
    ax, ay, _ = corner_seen_along(origin, lean_x, lean_y, a)
    bx, by, _ = corner_seen_along(origin, lean_x, lean_y, b)
    cx, cy, _ = corner_seen_along(origin, lean_x, lean_y, c)
    u, v, w = (
        _shifted_side(u, bx, by, cx, cy), _shifted_side(v, cx, cy, ax, ay), _shifted_side(w, ax, ay, bx, by)
    )  # fmt: skip
    zero = splat(0.0)
    return bits((minimum(u, minimum(v, w)) > zero) | (maximum(u, maximum(v, w)) < zero))


@inlined
def _hits_in_leaf(reals, reference, query, best):
    """Add the hits of a block to the table, or replace its one row by an earlier hit."""
    _, view, entry, (_, ratio, table) = query
    bound, count, longest = best
    base = BLOCK_STRIDE * ~reference
    u, v, w, height, is_hit = seen_along(reals, base, view)
    if bits(is_hit):
        answers, choices, first, is_first, scale, length, nearest, farthest = table
        zero, total = splat(0.0), u + v + w
        parameters = splat(entry) + height / total * splat(view[6])
        is_hit = is_hit & (parameters >= splat(-START_SLACK)) & (parameters <= splat(longest))
        hits = bits(is_hit)
        if hits and not is_first and bits(is_hit & ((u == zero) | (v == zero) | (w == zero))):
            hits &= _crossed_lanes(reals, base, view, u, v, w)
        while hits:
            k = trailing_zeros(hits)
            hits &= hits - 1
            slot = LANES * ~reference + k
            parameter = max(lane(parameters, k), 0.0) / ratio
            distance = parameter / scale * length
            row = first if is_first else first + count
            is_added = row < len(answers)
            if is_first:
                is_added = distance >= nearest and distance <= farthest
                if count > 0 and parameter >= answers[row, HIT_PARAMETER]:
                    is_added &= parameter == answers[row, HIT_PARAMETER] and slot < choices[row, HIT_SLOT]
                if is_added:
                    longest, count = parameter * ratio, np.int64(1)
                    bound = bound_of_parameter(longest, entry)
            else:
                count += 1
            if is_added:
                answers[row, HIT_PARAMETER], answers[row, HIT_DISTANCE] = parameter, distance
                answers[row, RAY_ANSWER_BARYCENTRIC] = lane(u, k)
                answers[row, RAY_ANSWER_BARYCENTRIC + 1] = lane(v, k)
                answers[row, RAY_ANSWER_BARYCENTRIC + 2] = lane(w, k)
                choices[row, HIT_SENSE] = 1 if (lane(total, k) < 0.0) == (view[6] > 0.0) else -1
                choices[row, HIT_SLOT] = slot
    return bound, count, longest


_hits_below = depth_first(open_children, in_blocks(_hits_in_leaf), in_order)


@inlined
def _hits_in_part(model, part, start, query, best, stacks):
    """Add the hits below *start* of a part that has a frame of its own."""
    reals, words, frames, parts = model
    _, _, entry, (((x, y, z), (dx, dy, dz)), _, table) = query
    bound, count, longest = best
    ratio = frames[part].scale / frames[len(parts) - 1].scale
    origin = to_local(frames, parts, part, x, y, z)
    direction = direction_to_local(frames, parts, part, dx, dy, dz)
    is_near, local_entry, aim, view = aim_in_part(origin, direction)
    if is_near:
        reach = longest * ratio
        own = bound_of_parameter(reach, local_entry), count, reach
        own_query = aim, view, local_entry, (query[3][0], ratio, table)
        _, count, reach = _hits_below((reals, words), start, 0, own_query, own, stacks)
        longest = reach / ratio
        bound = bound_of_parameter(longest, entry)
    return bound, count, longest


_at_leaf = in_blocks_and_parts(_hits_in_leaf, _hits_in_part)
hits_of_ray = depth_first(open_children, _at_leaf, in_order)
"""Walk that writes the hits of a ray into a table. The query: as of `first_hit_in_scene`; the additional data
are origin and direction in the scene's frame, the ratio 1, and the table: float64 and int32 view, first row,
whether only the first hit is needed, scale of the walk, length of the direction, smallest and largest
distance of a first hit, m. The best: a bound of boxes, the number of hits, which may exceed the rows of the
table, and the largest parameter."""
hits_of_heeded = depth_first(open_children, _at_leaf, in_order, heed_some)
"""The same over those parts of a scene that are not ignored."""


@inlined
def _copy_hit(answers, choices, source, target):
    for column in range(2):
        answers[target, column] = answers[source, column]
    for column in range(RAY_ANSWER_BARYCENTRIC, RAY_ANSWER_BARYCENTRIC + 3):
        answers[target, column] = answers[source, column]
    choices[target, HIT_SENSE], choices[target, HIT_SLOT] = (
        choices[source, HIT_SENSE], choices[source, HIT_SLOT]
    )  # fmt: skip


@inlined
def _sort_hits(answers, choices, first, last):
    """Sort rows by parameter, then slot; row *last* is scratch. The walk leaves them almost sorted."""
    for row in range(first + 1, last):
        parameter, slot, to = answers[row, HIT_PARAMETER], choices[row, HIT_SLOT], row
        while to > first and (
            answers[to - 1, HIT_PARAMETER] > parameter
            or (answers[to - 1, HIT_PARAMETER] == parameter and choices[to - 1, HIT_SLOT] > slot)
        ):
            to -= 1
        if to < row:
            _copy_hit(answers, choices, row, last)
            for source in range(row - 1, to - 1, -1):
                _copy_hit(answers, choices, source, source + 1)
            _copy_hit(answers, choices, last, to)


@kernel
def merge_crossings(words, parts, answers, choices, first, count, nearest, farthest):
    """Turn *count* hits of a ray, from row *first* on, into crossings in order; return their number.

    The row after them is scratch. *nearest*, *farthest*: limits of the distances, m.
    """
    last = first + count
    _sort_hits(answers, choices, first, last)
    for row in range(first, last):
        sense = choices[row, HIT_SENSE]
        if sense != 1 and sense != -1:
            continue
        # One group: each hit is within rounding of the one before it.
        part = part_of_slot(words, parts, choices[row, HIT_SLOT])
        net, end, behind = np.int64(0), row, answers[row, HIT_PARAMETER]
        while end < last and answers[end, HIT_PARAMETER] - behind <= SAME_CROSSING * max(1.0, behind):
            if part_of_slot(words, parts, choices[end, HIT_SLOT]) == part:
                net += choices[end, HIT_SENSE]
                behind = answers[end, HIT_PARAMETER]
            end += 1
        for member in range(row, end):
            if part_of_slot(words, parts, choices[member, HIT_SLOT]) == part:
                is_chosen = net * choices[member, HIT_SENSE] > 0
                choices[member, HIT_SENSE] *= _CHOSEN if is_chosen else 0
                net = 0 if is_chosen else net
    kept = first
    for row in range(first, last):
        distance = answers[row, HIT_DISTANCE]
        if choices[row, HIT_SENSE] != 0 and distance >= nearest and distance <= farthest:
            _copy_hit(answers, choices, row, kept)
            kept += 1
    return kept - first
