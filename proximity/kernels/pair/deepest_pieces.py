"""Deepest point of one part's surface inside another part: branch and bound over pieces of triangles.

The distance to one triangle of the outer surface is convex: the depth on a piece is at most the distance of
the farthest corner, and at most half the sum of the distances to two triangles. Pieces are cut where they
cross the outer surface and at the edges of the nearest triangle, so that plane regions are resolved
immediately.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.frames import ROUNDED_UP
from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NO_SLOT, NODE_STRIDE
from proximity.kernels.nodes import (
    child_at,
    corner_at,
    corners_at,
    corners_of_block,
    lower_at,
    offset_of,
    upper_at,
    used_lanes,
)
from proximity.kernels.pair.boxes import mapped
from proximity.kernels.pair.deepest_state import (
    CAPACITY,
    contains,
    distance_to_slot,
    goal_of,
    keep_deeper,
    nearest_outer,
    normal_of_slot,
    open_meeting,
    widened_box,
)
from proximity.kernels.pair.triangles import CROSSING, SIDE_ROUNDING, between, in_all_lanes, triangles_apart
from proximity.kernels.stack_arrays import stack_arrays_of, stack_f64, stack_i64
from proximity.kernels.traverse.depth_first import depth_first, in_blocks
from proximity.native import inlined, kernel, record
from proximity.native.simd import bits, splat, trailing_zeros

NODES = 1024
PIECE = record("Piece", corners="(3, 3)f8", bound="f8")
"""A piece of the inner surface, in the outer local frame, and an upper bound of its depth."""
stack_pieces, _ = stack_arrays_of(PIECE)
MIN_CUT = 2.0**-10
"""Minimum share of a piece on either side of a cut."""


@inlined
def _find_crossing(reals, reference, query, best):
    """Find a triangle of a block that crosses that of the query."""
    _, triangle, rounding_sq = query
    base = BLOCK_STRIDE * ~reference
    apart_sq = triangles_apart(triangle, corners_of_block(reals, base), rounding_sq)
    which = bits(apart_sq == splat(CROSSING))
    if which:
        return np.float32(-1.0), np.int64(LANES * ~reference + trailing_zeros(which))
    return best


_walk_crossing = depth_first(open_meeting, in_blocks(_find_crossing))


@inlined
def _corner(pieces, row, k):
    """Return a corner of a piece."""
    corners = pieces[row].corners
    return corners[k, 0], corners[k, 1], corners[k, 2]


@inlined
def _put(pieces, row, k, p):
    """Write a corner of a piece."""
    corners = pieces[row].corners
    corners[k, 0], corners[k, 1], corners[k, 2] = p


@kernel
def _crossing_slot(model, outer, a, b, c, workspace):
    """Return a slot of the outer part whose triangle crosses a piece, or `NO_SLOT`."""
    lower = min(a[0], b[0], c[0]), min(a[1], b[1], c[1]), min(a[2], b[2], c[2])
    upper = max(a[0], b[0], c[0]), max(a[1], b[1], c[1]), max(a[2], b[2], c[2])
    rounding = splat(SIDE_ROUNDING * SIDE_ROUNDING)
    query = widened_box(lower, upper, 0.0), in_all_lanes(a, b, c), rounding
    best = np.float32(0.0), np.int64(NO_SLOT)
    root = model.parts[outer].root
    return _walk_crossing(model, root, 0, query, best, workspace.stacks)[1]


@kernel
def _cut(pieces, count, heights, bound):
    """Replace the piece after the last one by its parts above and below height 0; return the count.

    The longest edge is halved instead if one side would be nearly empty.
    """
    low, high = min(heights[0], heights[1], heights[2]), max(heights[0], heights[1], heights[2])
    a, b, c = _corner(pieces, count, 0), _corner(pieces, count, 1), _corner(pieces, count, 2)
    h = heights[0], heights[1], heights[2]
    if not min(high, -low) > MIN_CUT * (high - low):
        ab, bc, ca = between(a, b), between(b, c), between(c, a)
        one, two, three = dot(*ab, *ab), dot(*bc, *bc), dot(*ca, *ca)
        if one >= two and one >= three:
            h = -1.0, 1.0, 0.0
        elif two >= three:
            h = 0.0, -1.0, 1.0
        else:
            h = 1.0, 0.0, -1.0
    # Rotate until the first corner is alone on its side, or on the cut.
    while not ((h[0] > 0.0) != (h[1] > 0.0) and (h[0] > 0.0) != (h[2] > 0.0)):
        a, b, c = b, c, a
        h = h[1], h[2], h[0]
    s, t = h[0] / (h[0] - h[1]), h[0] / (h[0] - h[2])
    p = a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]), a[2] + s * (b[2] - a[2])
    q = a[0] + t * (c[0] - a[0]), a[1] + t * (c[1] - a[1]), a[2] + t * (c[2] - a[2])
    count = _add_piece(pieces, count, a, p, q, bound)
    count = _add_piece(pieces, count, p, b, c, bound)
    return _add_piece(pieces, count, p, c, q, bound)


@inlined
def _add_piece(pieces, count, a, b, c, bound):
    """Append a piece, unless it has no area; return the count."""
    _put(pieces, count, 0, a)
    _put(pieces, count, 1, b)
    _put(pieces, count, 2, c)
    pieces[count].bound = bound
    normal = cross(*between(a, b), *between(a, c))
    return count + (1 if dot(*normal, *normal) > 0.0 else 0)


@kernel
def _fill_heights(reals, slot, pieces, row, heights):
    """Fill the heights of a piece's corners over the plane of a triangle; return the largest."""
    a, b, c = corners_at(reals, offset_of(slot))
    normal, highest = cross(*between(a, b), *between(a, c)), 0.0
    length = sqrt(dot(*normal, *normal))
    for k in range(3):
        heights[k] = dot(*normal, *between(a, _corner(pieces, row, k))) / length if length > 0.0 else 0.0
        highest = max(highest, abs(heights[k]))
    return highest


@kernel
def _fill_beyond(reals, slot, pieces, row, heights):
    """Fill heights of a piece's corners beyond the edge with the deepest cut; return the length cut off."""
    a, b, c = corners_at(reals, offset_of(slot))
    normal, best = cross(*between(a, b), *between(a, c)), 0.0
    heights[0] = heights[1] = heights[2] = 0.0
    for _ in range(3):
        x, y, z = cross(*between(a, b), *normal)
        length = sqrt(dot(x, y, z, x, y, z))
        h = (
            dot(x, y, z, *between(a, _corner(pieces, row, 0))),
            dot(x, y, z, *between(a, _corner(pieces, row, 1))),
            dot(x, y, z, *between(a, _corner(pieces, row, 2))),
        )
        cut = min(max(h[0], h[1], h[2]), -min(h[0], h[1], h[2]))
        if cut > best * length:
            best = cut / length
            heights[0], heights[1], heights[2] = h
        a, b, c = b, c, a
    return best


@kernel
def _bound_of_piece(reals, slot, other, pieces, row, far):
    """Return an upper bound of a piece's depth, from distances to two triangles; fill the corner *far*."""
    farthest = -1.0
    for k in range(3):
        x, y, z = _corner(pieces, row, k)
        length = 0.5 * (distance_to_slot(reals, slot, (x, y, z)) + distance_to_slot(reals, other, (x, y, z)))
        if length > farthest:
            farthest, far[0], far[1], far[2] = length, x, y, z
    return farthest * ROUNDED_UP


@kernel
def _is_shallow(model, outer, pieces, count, middle, slot, goal, heights, workspace):
    """Return 1 if no point of a piece is deeper than *goal*, 0 if unknown, -1 if the piece must be cut.

    A deeper point stays inside when displaced by *goal* along the normal of a near face. *heights*: filled if
    the piece must be cut.
    """
    x, y, z = normal_of_slot(model.reals, slot)
    for k in range(3):
        ax, ay, az = _corner(pieces, count, k)
        _put(pieces, count, k, (ax + goal * x, ay + goal * y, az + goal * z))
    a, b, c = _corner(pieces, count, 0), _corner(pieces, count, 1), _corner(pieces, count, 2)
    crossing = _crossing_slot(model, outer, a, b, c, workspace)
    if crossing != NO_SLOT:
        _fill_heights(model.reals, crossing, pieces, count, heights)
    for k in range(3):
        ax, ay, az = _corner(pieces, count, k)
        _put(pieces, count, k, (ax - goal * x, ay - goal * y, az - goal * z))
    if crossing != NO_SLOT:
        return -1
    position = middle[0] + goal * x, middle[1] + goal * y, middle[2] + goal * z
    _, slot = nearest_outer(model, outer, position, slot, workspace)
    return 0 if contains(model, outer, position, slot, workspace) else 1


@kernel
def _bound_or_cut(model, outer, pieces, count, state, limits, workspace):
    """Resolve the piece after the last, or replace it by smaller ones; return the count."""
    reals, heights, far, goal = model.reals, stack_f64(3), stack_f64(3), goal_of(state, limits)
    a, b, c = _corner(pieces, count, 0), _corner(pieces, count, 1), _corner(pieces, count, 2)
    middle = (a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0, (a[2] + b[2] + c[2]) / 3.0
    radius_sq = 0.0
    for k in range(3):
        arm = between(middle, _corner(pieces, count, k))
        radius_sq = max(radius_sq, dot(*arm, *arm))
    distance, slot = nearest_outer(model, outer, middle, np.int64(NO_SLOT), workspace)
    is_inside = distance > limits[2] and contains(model, outer, middle, slot, workspace)
    bound = min(pieces[count].bound, _bound_of_piece(reals, slot, slot, pieces, count, far))
    if distance > sqrt(radius_sq) + limits[2] and not is_inside:
        return count
    if bound > goal and distance <= sqrt(radius_sq) + goal:
        shallow = _is_shallow(model, outer, pieces, count, middle, slot, goal, heights, workspace)
        if shallow < 0:
            return _cut(pieces, count, heights, bound)
        if shallow > 0:
            bound = goal
    if is_inside:
        keep_deeper(state, distance, middle)
    if bound > goal_of(state, limits):
        position = far[0], far[1], far[2]
        depth, other = nearest_outer(model, outer, position, slot, workspace)
        if depth > limits[2] and contains(model, outer, position, other, workspace):
            keep_deeper(state, depth, position)
        bound = min(bound, _bound_of_piece(reals, slot, other, pieces, count, far))
    if bound > goal_of(state, limits):
        _fill_beyond(reals, slot, pieces, count, heights)
        return _cut(pieces, count, heights, bound)
    state.bound = max(state.bound, bound)
    return count


@kernel
def _search_pieces(model, outer, pieces, count, state, limits, budget, workspace):
    """Resolve pieces of the inner surface; pieces beyond the budget contribute their bound."""
    while count > 0 and state.steps < budget and count + 3 < CAPACITY:
        count -= 1
        state.steps += 1
        if pieces[count].bound > goal_of(state, limits):
            count = _bound_or_cut(model, outer, pieces, count, state, limits, workspace)
        else:
            state.bound = max(state.bound, pieces[count].bound)
    for row in range(count):
        state.bound = max(state.bound, pieces[row].bound)


@kernel
def search_surface(model, inner, outer, frame_map, cap, state, limits, budget, workspace):
    """Search for the deepest point of the inner part's surface."""
    reals, words, frames, parts = model
    turn, offset = frame_map
    nodes, pieces = stack_i64(NODES), stack_pieces(CAPACITY)
    ratio = abs(frames[outer].scale / frames[inner].scale)
    nodes[0], count, known = parts[inner].root, 1, np.int64(NO_SLOT)
    while count > 0:
        count -= 1
        base = NODE_STRIDE * nodes[count]
        left = bits(used_lanes(words, base))
        while left:
            lane = trailing_zeros(left)
            left &= left - 1
            at, middle, radius_sq = base + lane, stack_f64(3), 0.0
            for k in range(3):
                low, high = np.float64(lower_at(words, at, k)), np.float64(upper_at(words, at, k))
                middle[k] = 0.5 * (low + high)
                radius_sq += 0.25 * (high - low) * (high - low)
            radius = sqrt(radius_sq) * ratio * ROUNDED_UP + limits[2]
            p = mapped(turn, offset, middle[0], middle[1], middle[2])
            if max(abs(p[0]), abs(p[1]), abs(p[2])) > 1.0 + radius:
                continue
            distance, known = nearest_outer(model, outer, p, known, workspace)
            state.steps += 1
            if distance > radius and not contains(model, outer, p, known, workspace):
                continue
            bound = min(distance + radius, cap)
            if bound <= goal_of(state, limits):
                state.bound = max(state.bound, bound)
                continue
            child = child_at(words, at)
            if state.steps >= budget or (child >= 0 and count + 1 >= NODES):
                state.bound = max(state.bound, bound)
            elif child >= 0:
                nodes[count] = child
                count += 1
            else:
                waiting = _read_block(reals, ~child, frame_map, bound, pieces)
                _search_pieces(model, outer, pieces, waiting, state, limits, budget, workspace)


@kernel
def _read_block(reals, block, frame_map, bound, pieces):
    """Copy the triangles of a block into pieces, in the outer frame; return the count."""
    count = 0
    for slot in range(LANES * block, LANES * block + LANES):
        at = offset_of(slot)
        if reals[at] == reals[at]:
            for k in range(3):
                _put(pieces, count, k, mapped(frame_map[0], frame_map[1], *corner_at(reals, at, k)))
            pieces[count].bound = bound
            count += 1
    return count
