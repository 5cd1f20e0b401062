"""The point of one part that lies deepest inside another, with bounds of its depth.

Branch and bound over pieces of the inner part's surface, then over boxes of the volume. The distance to one
triangle of the outer surface is convex: nowhere on a piece is the depth more than at the corner farthest from
it, nor more than half the sum of the distances to two triangles. Pieces are cut where they cross the outer
surface and at the edges of the nearest triangle, so that plane regions are settled at once.

Within the volume the depth is largest at a critical point: its nearest points lie on all sides of it. A box
near which all outer faces look to one side has none, and what it contains is settled by its surroundings.

Source: critical points of the distance function, Chazal, Lieutier 2005; the bounds are ours.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.closest_feature import (
    CLOSEST_ARM,
    CLOSEST_POINT,
    closest_on_triangle,
    read_corners,
)
from proximity.kernels.geometry.frames import ROUNDED_DOWN, ROUNDED_UP, to_scene
from proximity.kernels.geometry.triangle import corners_of_block, cross, dot, offset_of
from proximity.kernels.inside.chunk_tables import new_workspace, reset_recent
from proximity.kernels.inside.containment import state_in_part
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    LANES,
    NO_SLOT,
    NODE_CHILDREN,
    NODE_STRIDE,
    SIGN_NONE,
    ModelArrays,
)
from proximity.kernels.pair.boxes import frames_between, mapped
from proximity.kernels.pair.meeting import to_second
from proximity.kernels.pair.triangles import CROSSING, SIDE_ROUNDING, between, triangles_apart
from proximity.kernels.pair.walk import used
from proximity.kernels.point.walk import NOTHING_SEEN, closest_in_part, slot_distance_sq
from proximity.kernels.ray.walk import ray_in_part
from proximity.kernels.sign.inside_grid import CELL_CROSSED, CELL_INSIDE
from proximity.kernels.sign.side import signed_of_slot
from proximity.kernels.stack_arrays import stack_f64, stack_f64_rows, stack_i64
from proximity.kernels.traverse.depth_first import depth_first
from proximity.native import entry, inlined, kernel
from proximity.native.simd import (
    absolute,
    bits,
    load,
    load_int,
    maximum,
    minimum,
    select,
    splat,
    splat32,
    trailing_zeros,
)

DEEPEST_LOWER, DEEPEST_UPPER, DEEPEST_POINT, DEEPEST_STEPS = 0, 1, 2, 5
DEEPEST_SIZE = 6
"""m: a point is so deep, and none is deeper; that point, scene's frame; steps."""
CAPACITY = 512
"""Pieces or boxes that wait at once."""
NODES = 1024
LEAST_CUT = 2.0**-10
"""A cut leaves at least this share of a piece on either side."""
WIDENING = np.float32(2.0**-20)
"""Local units by which boxes are widened for the rounding to float32."""
SIDES = 8
"""Directions that are tried for it."""
FACING = 2.0**-10
"""Least cosine between faces and the side to which all of them look."""
# State of a search in the outer part's local frame: the deepest point found so far and how deep it is; the
# largest bound of what was settled; steps.
BEST, POSITION, BOUND, STEPS, STATE_SIZE = 0, 1, 4, 5, 6


@inlined
def _nearest(model, outer, p, known, workspace):
    """Distance to the outer surface and slot of its nearest triangle; *known*: a slot near by, or none."""
    best_sq = np.inf
    if known != NO_SLOT:
        best_sq = slot_distance_sq(model.reals, known, *p)
    root = model.parts[outer].root
    found_sq, slot = closest_in_part(model, outer, root, p, best_sq, known, NOTHING_SEEN, workspace.stacks)
    return sqrt(found_sq), slot


@inlined
def _contains(model, part, p, slot, workspace):
    """Whether a part contains *p*, of which the nearest triangle is known."""
    state = state_in_part(model, part, p)
    return (
        signed_of_slot(model, part, slot, p, workspace.closest) < 0.0
        if state == CELL_CROSSED
        else state == CELL_INSIDE
    )


@inlined
def _goal(state, limits):
    """A bound up to this settles a piece; *limits*: the share and the length, local, left between bounds."""
    return state[BEST] * (1.0 + limits[0]) + limits[1]


@inlined
def _keep_deeper(state, depth, p):
    """Keep a point inside both parts if it is the deepest so far."""
    state[STEPS] += 1.0
    if depth > state[BEST]:
        state[BEST] = depth
        state[POSITION], state[POSITION + 1], state[POSITION + 2] = p


@inlined
def _meets_box(words, base, box):
    """Which children of a node meet a box: lower and upper corners, float32."""
    (lx, ly, lz), (ux, uy, uz) = box
    return (
        (load(words, base) <= splat32(ux))
        & (load(words, base + 24) >= splat32(lx))
        & (load(words, base + 8) <= splat32(uy))
        & (load(words, base + 32) >= splat32(ly))
        & (load(words, base + 16) <= splat32(uz))
        & (load(words, base + 40) >= splat32(lz))
    )


@inlined
def _open_meeting(words, base, query, reach):
    """Children of a node that meet the box of a query."""
    is_met = _meets_box(words, base, query[0])
    bounds = select(is_met, splat32(np.float32(0.0)), splat32(np.float32(np.inf)))
    return bounds, bounds, bounds <= splat32(reach)


@inlined
def _find_crossing(reals, reference, query, best):
    """A triangle of a block that crosses that of the query."""
    _, triangle, rounding_sq = query
    base = BLOCK_STRIDE * ~reference
    apart_sq = triangles_apart(triangle, corners_of_block(reals, base), rounding_sq)
    which = bits(apart_sq == splat(CROSSING))
    if which:
        return np.float32(-1.0), np.int64(LANES * ~reference + trailing_zeros(which))
    return best


@inlined
def _find_averted(reals, reference, query, best):
    """A triangle of a block that meets the box of the query, and does not look to its side."""
    (lower, upper), (x, y, z) = query
    base = BLOCK_STRIDE * ~reference
    a, b, c = corners_of_block(reals, base)
    normal = cross(*between(a, b), *between(a, c))
    is_met, height, reach = a[0] == a[0], splat(0.0), splat(0.0)
    for k in range(3):
        low, high = minimum(minimum(a[k], b[k]), c[k]), maximum(maximum(a[k], b[k]), c[k])
        middle, half = 0.5 * (np.float64(lower[k]) + upper[k]), 0.5 * (np.float64(upper[k]) - lower[k])
        is_met = is_met & (low <= splat(middle + half)) & (high >= splat(middle - half))
        height = height + normal[k] * (splat(middle) - a[k])
        reach = reach + absolute(normal[k]) * splat(half)
    is_met = is_met & (absolute(height) <= reach * splat(ROUNDED_UP))
    along = dot(*normal, splat(x), splat(y), splat(z))
    is_facing = (along > splat(0.0)) & (along * along > splat(FACING * FACING) * dot(*normal, *normal))
    which = bits(is_met & ~is_facing)
    if which:
        return np.float32(-1.0), np.int64(LANES * ~reference + trailing_zeros(which))
    return best


_walk_crossing = depth_first(_open_meeting, _find_crossing)
_walk_averted = depth_first(_open_meeting, _find_averted)


@inlined
def _box(lower, upper, margin):
    """A box in float32, wider by a margin and by rounding."""
    return (
        (
            np.float32(lower[0] - margin) - WIDENING,
            np.float32(lower[1] - margin) - WIDENING,
            np.float32(lower[2] - margin) - WIDENING,
        ),
        (
            np.float32(upper[0] + margin) + WIDENING,
            np.float32(upper[1] + margin) + WIDENING,
            np.float32(upper[2] + margin) + WIDENING,
        ),
    )


@inlined
def _corner(pieces, row, k):
    """A corner of a piece."""
    return pieces[row, 3 * k], pieces[row, 3 * k + 1], pieces[row, 3 * k + 2]


@inlined
def _put(pieces, row, k, p):
    """Write a corner of a piece."""
    pieces[row, 3 * k], pieces[row, 3 * k + 1], pieces[row, 3 * k + 2] = p


@kernel
def _crossing_slot(model, outer, a, b, c, workspace):
    """A triangle of the outer part that crosses a piece, or `NO_SLOT`."""
    lower = min(a[0], b[0], c[0]), min(a[1], b[1], c[1]), min(a[2], b[2], c[2])
    upper = max(a[0], b[0], c[0]), max(a[1], b[1], c[1]), max(a[2], b[2], c[2])
    rounding = splat(SIDE_ROUNDING * SIDE_ROUNDING)
    triangle = (
        (splat(a[0]), splat(a[1]), splat(a[2])),
        (splat(b[0]), splat(b[1]), splat(b[2])),
        (splat(c[0]), splat(c[1]), splat(c[2])),
    )
    query, best = (_box(lower, upper, 0.0), triangle, rounding), (np.float32(0.0), np.int64(NO_SLOT))
    root = model.parts[outer].root
    return _walk_crossing(model.reals, model.words, root, query, best, workspace.stacks)[1]


@inlined
def _distance_to(reals, slot, p):
    """Distance to one triangle."""
    return sqrt(slot_distance_sq(reals, slot, *p))


@kernel
def _cut(pieces, count, heights, bound):
    """Replace the piece behind the last one by its parts above and below height 0; return the count.

    Where it would leave next to nothing on one side, the longest edge is halved.
    """
    low, high = min(heights[0], heights[1], heights[2]), max(heights[0], heights[1], heights[2])
    a, b, c = _corner(pieces, count, 0), _corner(pieces, count, 1), _corner(pieces, count, 2)
    h = heights[0], heights[1], heights[2]
    if not min(high, -low) > LEAST_CUT * (high - low):
        ab, bc, ca = between(a, b), between(b, c), between(c, a)
        one, two, three = dot(*ab, *ab), dot(*bc, *bc), dot(*ca, *ca)
        if one >= two and one >= three:
            h = -1.0, 1.0, 0.0
        elif two >= three:
            h = 0.0, -1.0, 1.0
        else:
            h = 1.0, 0.0, -1.0
    # Turned until the first corner is alone on its side, or on the cut.
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
    """Append a piece that has area; return the count."""
    _put(pieces, count, 0, a)
    _put(pieces, count, 1, b)
    _put(pieces, count, 2, c)
    pieces[count, 9] = bound
    normal = cross(*between(a, b), *between(a, c))
    return count + (1 if dot(*normal, *normal) > 0.0 else 0)


@inlined
def _triangle_at(reals, slot):
    """The corners of a triangle."""
    at = offset_of(slot)
    return (
        (reals[at], reals[at + 8], reals[at + 16]),
        (reals[at + 24], reals[at + 32], reals[at + 40]),
        (reals[at + 48], reals[at + 56], reals[at + 64]),
    )


@inlined
def _normal_of(reals, slot):
    """The unit normal of a triangle; 0 where it has no area."""
    a, b, c = _triangle_at(reals, slot)
    x, y, z = cross(*between(a, b), *between(a, c))
    length = sqrt(dot(x, y, z, x, y, z))
    return (x / length, y / length, z / length) if length > 0.0 else (0.0, 0.0, 0.0)


@kernel
def _fill_heights(reals, slot, pieces, row, heights):
    """Fill the heights of a piece's corners over the plane of a triangle; return the largest."""
    a, b, c = _triangle_at(reals, slot)
    normal, highest = cross(*between(a, b), *between(a, c)), 0.0
    length = sqrt(dot(*normal, *normal))
    for k in range(3):
        heights[k] = dot(*normal, *between(a, _corner(pieces, row, k))) / length if length > 0.0 else 0.0
        highest = max(highest, abs(heights[k]))
    return highest


@kernel
def _fill_beyond(reals, slot, pieces, row, heights):
    """Fill how far corners of a piece are beyond the edge that cuts it best; return the length cut off."""
    a, b, c = _triangle_at(reals, slot)
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
    """A depth that a piece nowhere exceeds: half the sum of the distances to two triangles; its corner."""
    farthest = -1.0
    for k in range(3):
        x, y, z = pieces[row, 3 * k], pieces[row, 3 * k + 1], pieces[row, 3 * k + 2]
        length = 0.5 * (_distance_to(reals, slot, (x, y, z)) + _distance_to(reals, other, (x, y, z)))
        if length > farthest:
            farthest, far[0], far[1], far[2] = length, x, y, z
    return farthest * ROUNDED_UP


@kernel
def _is_shallow(model, outer, pieces, count, middle, slot, goal, heights, workspace):
    """Whether no point of a piece is deeper than *goal*: 1, or 0 where that is open, or -1 where to cut it.

    A point deeper than that stays inside when it is displaced by as much, along the normal of a near face.
    *heights*: filled where it is to be cut.
    """
    x, y, z = _normal_of(model.reals, slot)
    for k in range(3):
        pieces[count, 3 * k] += goal * x
        pieces[count, 3 * k + 1] += goal * y
        pieces[count, 3 * k + 2] += goal * z
    a, b, c = _corner(pieces, count, 0), _corner(pieces, count, 1), _corner(pieces, count, 2)
    crossing = _crossing_slot(model, outer, a, b, c, workspace)
    if crossing != NO_SLOT:
        _fill_heights(model.reals, crossing, pieces, count, heights)
    for k in range(3):
        pieces[count, 3 * k] -= goal * x
        pieces[count, 3 * k + 1] -= goal * y
        pieces[count, 3 * k + 2] -= goal * z
    if crossing != NO_SLOT:
        return -1
    position = middle[0] + goal * x, middle[1] + goal * y, middle[2] + goal * z
    _, slot = _nearest(model, outer, position, slot, workspace)
    return 0 if _contains(model, outer, position, slot, workspace) else 1


@kernel
def _bound_or_cut(model, outer, pieces, count, state, limits, workspace):
    """Settle a piece, the one behind the last, or replace it by smaller ones; return the count."""
    reals, heights, far, goal = model.reals, stack_f64(3), stack_f64(3), _goal(state, limits)
    a, b, c = _corner(pieces, count, 0), _corner(pieces, count, 1), _corner(pieces, count, 2)
    middle = (a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0, (a[2] + b[2] + c[2]) / 3.0
    radius_sq = 0.0
    for k in range(3):
        arm = between(middle, _corner(pieces, count, k))
        radius_sq = max(radius_sq, dot(*arm, *arm))
    distance, slot = _nearest(model, outer, middle, np.int64(NO_SLOT), workspace)
    is_inside = distance > limits[2] and _contains(model, outer, middle, slot, workspace)
    bound = min(pieces[count, 9], _bound_of_piece(reals, slot, slot, pieces, count, far))
    if distance > sqrt(radius_sq) + limits[2] and not is_inside:
        return count
    if bound > goal and distance <= sqrt(radius_sq) + goal:
        shallow = _is_shallow(model, outer, pieces, count, middle, slot, goal, heights, workspace)
        if shallow < 0:
            return _cut(pieces, count, heights, bound)
        if shallow > 0:
            bound = goal
    if is_inside:
        _keep_deeper(state, distance, middle)
    if bound > _goal(state, limits):
        position = far[0], far[1], far[2]
        depth, other = _nearest(model, outer, position, slot, workspace)
        if depth > limits[2] and _contains(model, outer, position, other, workspace):
            _keep_deeper(state, depth, position)
        bound = min(bound, _bound_of_piece(reals, slot, other, pieces, count, far))
    if bound > _goal(state, limits):
        _fill_beyond(reals, slot, pieces, count, heights)
        return _cut(pieces, count, heights, bound)
    state[BOUND] = max(state[BOUND], bound)
    return count


@kernel
def _search_pieces(model, outer, pieces, count, state, limits, budget, workspace):
    """Settle pieces of the inner surface; what the budget leaves counts with its bound."""
    while count > 0 and state[STEPS] < budget and count + 3 < CAPACITY:
        count -= 1
        state[STEPS] += 1.0
        if pieces[count, 9] > _goal(state, limits):
            count = _bound_or_cut(model, outer, pieces, count, state, limits, workspace)
        else:
            state[BOUND] = max(state[BOUND], pieces[count, 9])
    for row in range(count):
        state[BOUND] = max(state[BOUND], pieces[row, 9])


@kernel
def _search_surface(model, inner, outer, frame_map, cap, state, limits, budget, workspace):
    """Look for the deepest point of the inner part's surface."""
    reals, words, frames, parts = model
    turn, offset = frame_map
    nodes, pieces = stack_i64(NODES), stack_f64_rows(CAPACITY, 10)
    ratio = abs(frames[outer].scale / frames[inner].scale)
    nodes[0], count, known = parts[inner].root, 1, np.int64(NO_SLOT)
    while count > 0:
        count -= 1
        base = NODE_STRIDE * nodes[count]
        left = used(words, base)
        while left:
            lane = trailing_zeros(left)
            left &= left - 1
            at, middle, radius_sq = base + lane, stack_f64(3), 0.0
            for k in range(3):
                low, high = np.float64(words[at + 8 * k]), np.float64(words[at + 24 + 8 * k])
                middle[k] = 0.5 * (low + high)
                radius_sq += 0.25 * (high - low) * (high - low)
            radius = sqrt(radius_sq) * ratio * ROUNDED_UP + limits[2]
            p = mapped(turn, offset, middle[0], middle[1], middle[2])
            if max(abs(p[0]), abs(p[1]), abs(p[2])) > 1.0 + radius:
                continue
            distance, known = _nearest(model, outer, p, known, workspace)
            state[STEPS] += 1.0
            if distance > radius and not _contains(model, outer, p, known, workspace):
                continue
            bound = min(distance + radius, cap)
            if bound <= _goal(state, limits):
                state[BOUND] = max(state[BOUND], bound)
                continue
            child = load_int(words, at + NODE_CHILDREN)
            if state[STEPS] >= budget or (child >= 0 and count + 1 >= NODES):
                state[BOUND] = max(state[BOUND], bound)
            elif child >= 0:
                nodes[count] = child
                count += 1
            else:
                waiting = _read_block(reals, ~child, frame_map, bound, pieces)
                _search_pieces(model, outer, pieces, waiting, state, limits, budget, workspace)


@kernel
def _read_block(reals, block, frame_map, bound, pieces):
    """Fill the triangles of a block as pieces, in the outer frame; return the count."""
    count = 0
    for slot in range(LANES * block, LANES * block + LANES):
        at = offset_of(slot)
        if reals[at] == reals[at]:
            for k in range(3):
                x, y, z = reals[at + 24 * k], reals[at + 24 * k + 8], reals[at + 24 * k + 16]
                _put(pieces, count, k, mapped(frame_map[0], frame_map[1], x, y, z))
            pieces[count, 9] = bound
            count += 1
    return count


@inlined
def _box_corner(boxes, row, k):
    """One of the eight corners of a waiting box, which has middle and half sides."""
    return (
        boxes[row, 0] + (boxes[row, 3] if k & 1 else -boxes[row, 3]),
        boxes[row, 1] + (boxes[row, 4] if k & 2 else -boxes[row, 4]),
        boxes[row, 2] + (boxes[row, 5] if k & 4 else -boxes[row, 5]),
    )


@kernel
def _bound_in_box(model, outer, boxes, row, middle, distance, slot, bound, goal, workspace):
    """A depth that no point of a box exceeds: from one triangle, or from two on opposite sides."""
    reals, farthest = model.reals, 0.0
    for k in range(8):
        farthest = max(farthest, _distance_to(reals, slot, _box_corner(boxes, row, k)))
    bound = min(bound, farthest * ROUNDED_UP)
    if bound <= goal or distance == 0.0:
        return bound
    away = _away(reals, slot, middle, distance, workspace)
    start, no_slot = model.parts[outer].root, np.int64(NO_SLOT)
    _, _, other, _ = ray_in_part(reals, model.words, start, middle, away, np.inf, no_slot, workspace.stacks)
    if other == NO_SLOT:
        return bound
    farthest = 0.0
    for k in range(8):
        corner = _box_corner(boxes, row, k)
        both = _distance_to(reals, slot, corner) + _distance_to(reals, other, corner)
        farthest = max(farthest, 0.5 * both)
    return min(bound, farthest * ROUNDED_UP)


@inlined
def _away(reals, slot, p, distance, workspace):
    """The unit direction from the nearest point of a triangle to *p*."""
    closest = workspace.closest
    read_corners(reals, slot, closest)
    closest_on_triangle(p[0], p[1], p[2], closest)
    return (
        closest[CLOSEST_ARM] / distance,
        closest[CLOSEST_ARM + 1] / distance,
        closest[CLOSEST_ARM + 2] / distance,
    )


@kernel
def _has_critical(model, outer, boxes, row, middle, distance, slot, is_inside, bound, workspace):
    """Whether a box may have a critical point of the depth: outer faces near it look to all sides."""
    if distance == 0.0:
        return True
    x, y, z = _away(model.reals, slot, middle, distance, workspace)
    if is_inside:
        x, y, z = -x, -y, -z
    box = _box(_box_corner(boxes, row, 0), _box_corner(boxes, row, 7), bound)
    root, best = model.parts[outer].root, (np.float32(0.0), np.int64(NO_SLOT))
    for _ in range(SIDES):
        query = box, (x, y, z)
        _, averted = _walk_averted(model.reals, model.words, root, query, best, workspace.stacks)
        if averted == NO_SLOT:
            return False
        # Turned towards the face that looks elsewhere, until all do or none can.
        nx, ny, nz = _normal_of(model.reals, averted)
        x, y, z = x + nx, y + ny, z + nz
        length = sqrt(dot(x, y, z, x, y, z))
        if not length > FACING:
            return True
        x, y, z = x / length, y / length, z / length
    return True


@kernel
def _foot(reals, slot, p, frame_map, workspace):
    """The point of a triangle of the inner part that is nearest to *p*, in the outer frame."""
    closest = workspace.closest
    read_corners(reals, slot, closest)
    closest_on_triangle(p[0], p[1], p[2], closest)
    x, y, z = closest[CLOSEST_POINT], closest[CLOSEST_POINT + 1], closest[CLOSEST_POINT + 2]
    return mapped(frame_map[0], frame_map[1], x, y, z)


@kernel
def _search_volume(model, inner, outer, frame_map, boxes, state, limits, budget, workspace):
    """Look for deep points within the volume that both parts may have in common: in a first box and below."""
    ratio = abs(model.frames[inner].scale / model.frames[outer].scale)
    count, known, inner_known = 1, np.int64(NO_SLOT), np.int64(NO_SLOT)
    while count > 0 and state[STEPS] < budget and count + 2 < CAPACITY:
        count -= 1
        middle, bound = (boxes[count, 0], boxes[count, 1], boxes[count, 2]), boxes[count, 6]
        if bound <= _goal(state, limits):
            state[BOUND] = max(state[BOUND], bound)
            continue
        radius = sqrt(
            boxes[count, 3] * boxes[count, 3]
            + boxes[count, 4] * boxes[count, 4]
            + boxes[count, 5] * boxes[count, 5]
        )
        state[STEPS] += 1.0
        distance, known = _nearest(model, outer, middle, known, workspace)
        is_inside = _contains(model, outer, middle, known, workspace)
        if distance > radius * ROUNDED_UP and not is_inside:
            continue
        p = to_second(frame_map, *middle)
        inner_distance, inner_known = _nearest(model, inner, p, inner_known, workspace)
        is_inner = _contains(model, inner, p, inner_known, workspace)
        if inner_distance > radius * ratio * ROUNDED_UP and not is_inner:
            continue
        if is_inside:
            gap = 0.0 if is_inner else inner_distance / ratio * ROUNDED_UP
            position = middle if is_inner else _foot(model.reals, inner_known, p, frame_map, workspace)
            _keep_deeper(state, distance - gap, position)
        bound, goal = min(bound, (distance + radius) * ROUNDED_UP), _goal(state, limits)
        if bound > goal:
            bound = _bound_in_box(model, outer, boxes, count, middle, distance, known, bound, goal, workspace)
        if bound <= goal:
            state[BOUND] = max(state[BOUND], bound)
        elif _has_critical(model, outer, boxes, count, middle, distance, known, is_inside, bound, workspace):
            count = _halve(boxes, count, bound)
    for row in range(count):
        state[BOUND] = max(state[BOUND], boxes[row, 6])


@kernel
def _halve(boxes, row, bound):
    """Replace a box by its halves along the longest side; return the count."""
    axis = 0
    for k in range(1, 3):
        axis = k if boxes[row, 3 + k] > boxes[row, 3 + axis] else axis
    for k in range(7):
        boxes[row + 1, k] = boxes[row, k]
    half = 0.5 * boxes[row, 3 + axis]
    for k in range(2):
        boxes[row + k, 3 + axis], boxes[row + k, 6] = half, bound
        boxes[row + k, axis] += half if k else -half
    return row + 2


@kernel
def _fill_common_box(model, inner, outer, frame_map, boxes):
    """Fill the common box of both parts, outer local frame; return a depth that no point of it exceeds."""
    frames, corner, least = model.frames, stack_f64(3), np.inf
    turn, offset = frame_map
    for axis in range(3):
        low, high = np.inf, -np.inf
        for k in range(8):
            for i in range(3):
                side = frames[inner].own_upper[i] if k >> i & 1 else frames[inner].own_lower[i]
                corner[i] = (side - frames[inner].centre[i]) * frames[inner].scale
            position = mapped(turn, offset, corner[0], corner[1], corner[2])[axis]
            low, high = min(low, position), max(high, position)
        lower = (frames[outer].own_lower[axis] - frames[outer].centre[axis]) * frames[outer].scale
        upper = (frames[outer].own_upper[axis] - frames[outer].centre[axis]) * frames[outer].scale
        least = min(least, 0.5 * (upper - lower))
        low, high = max(low, lower), min(high, upper)
        boxes[0, axis], boxes[0, 3 + axis] = 0.5 * (low + high), max(0.5 * (high - low), 0.0) * ROUNDED_UP
    boxes[0, 6] = least * ROUNDED_UP
    return boxes[0, 6]


@entry(ModelArrays, "int, int, float, float, int, float64[:]")
def deepest_point(model, inner, outer, tolerance, rest, budget, deepest):
    """Fill how deep points of one part are inside another at most; (`DEEPEST_SIZE`,).

    *tolerance*, *rest*: share of the depth, and length, m, that may be left between its bounds. *budget*:
    steps at most. The lower bound that is in *deepest* before is known from elsewhere.
    """
    frames, scale = model.frames, model.frames[outer].scale
    workspace, state, boxes = new_workspace(), stack_f64(STATE_SIZE), stack_f64_rows(CAPACITY, 7)
    turn, offset = stack_f64(9), stack_f64(3)
    reset_recent(workspace)
    known = deepest[DEEPEST_LOWER]
    deepest[DEEPEST_UPPER], deepest[DEEPEST_STEPS] = known, 0.0
    if model.parts[outer].sign == SIGN_NONE or model.parts[inner].sign == SIGN_NONE:
        return
    frames_between(frames, outer, inner, turn, offset)
    slack = 1.0
    for k in range(3):
        slack = max(slack, abs(offset[k]) + 2.0 * abs(scale / frames[inner].scale))
    limits = tolerance, max(rest * scale, 16.0 * SIDE_ROUNDING * slack), 16.0 * SIDE_ROUNDING * slack
    state[BEST], state[BOUND], state[STEPS] = known * scale, 0.0, 0.0
    cap = _fill_common_box(model, inner, outer, (turn, offset), boxes)
    _search_surface(model, inner, outer, (turn, offset), cap, state, limits, budget, workspace)
    _search_volume(model, inner, outer, (turn, offset), boxes, state, limits, 2.0 * budget, workspace)
    deepest[DEEPEST_STEPS] = state[STEPS]
    deepest[DEEPEST_UPPER] = max(known, max(state[BEST], state[BOUND]) / scale * ROUNDED_UP)
    if state[BEST] > known * scale:
        deepest[DEEPEST_LOWER] = state[BEST] / scale * ROUNDED_DOWN
        to_scene(frames, model.parts, outer, state, POSITION, deepest, DEEPEST_POINT)
