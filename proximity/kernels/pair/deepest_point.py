"""The point of one part that lies deepest inside another, with bounds of its depth.

First pieces of the inner part's surface are searched (`deepest_pieces`), then boxes of the volume that both
have in common, by branch and bound.

Within the volume the depth is largest at a critical point: its nearest points lie on all sides of it. A box
near which all outer faces look to one side has none, and what it contains is settled by its surroundings.

Source: critical points of the distance function, Chazal, Lieutier 2005; the bounds are ours.
"""

from math import sqrt

import numpy as np

from proximity.kernels.answers import DEEPEST_LOWER, DEEPEST_POINT, DEEPEST_STEPS, DEEPEST_UPPER
from proximity.kernels.geometry.closest_feature import (
    CLOSEST_ARM,
    CLOSEST_POINT,
    closest_on_triangle,
    read_corners,
)
from proximity.kernels.geometry.frames import ROUNDED_DOWN, ROUNDED_UP, to_scene
from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.inside.chunk_tables import new_workspace, reset_recent
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NO_SLOT, SIGN_NONE, ModelArrays
from proximity.kernels.nodes import corners_of_block
from proximity.kernels.pair.boxes import frames_between, mapped
from proximity.kernels.pair.deepest_pieces import search_surface
from proximity.kernels.pair.deepest_state import (
    BEST,
    BOUND,
    CAPACITY,
    POSITION,
    STATE_SIZE,
    STEPS,
    contains,
    distance_to_slot,
    goal_of,
    keep_deeper,
    nearest_outer,
    normal_of_slot,
    open_meeting,
    widened_box,
)
from proximity.kernels.pair.meeting import to_second
from proximity.kernels.pair.triangles import SIDE_ROUNDING, between
from proximity.kernels.ray.walk import ray_in_part
from proximity.kernels.stack_arrays import stack_f64, stack_f64_rows
from proximity.kernels.traverse.depth_first import depth_first, in_blocks
from proximity.native import entry, inlined, kernel
from proximity.native.simd import absolute, bits, maximum, minimum, splat, trailing_zeros

SIDES = 8
"""Directions that are tried for the side to which all faces near a box look."""
FACING = 2.0**-10
"""Least cosine between faces and the side to which all of them look."""


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


_walk_averted = depth_first(open_meeting, in_blocks(_find_averted))


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
        farthest = max(farthest, distance_to_slot(reals, slot, _box_corner(boxes, row, k)))
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
        both = distance_to_slot(reals, slot, corner) + distance_to_slot(reals, other, corner)
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
    box = widened_box(_box_corner(boxes, row, 0), _box_corner(boxes, row, 7), bound)
    root, best = model.parts[outer].root, (np.float32(0.0), np.int64(NO_SLOT))
    for _ in range(SIDES):
        query = box, (x, y, z)
        _, averted = _walk_averted(model, root, 0, query, best, workspace.stacks)
        if averted == NO_SLOT:
            return False
        # Turned towards the face that looks elsewhere, until all do or none can.
        nx, ny, nz = normal_of_slot(model.reals, averted)
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
def search_volume(model, inner, outer, frame_map, boxes, state, limits, budget, workspace):
    """Look for deep points within the volume that both parts may have in common: in a first box and below."""
    ratio = abs(model.frames[inner].scale / model.frames[outer].scale)
    count, known, inner_known = 1, np.int64(NO_SLOT), np.int64(NO_SLOT)
    while count > 0 and state[STEPS] < budget and count + 2 < CAPACITY:
        count -= 1
        middle, bound = (boxes[count, 0], boxes[count, 1], boxes[count, 2]), boxes[count, 6]
        if bound <= goal_of(state, limits):
            state[BOUND] = max(state[BOUND], bound)
            continue
        radius = sqrt(
            boxes[count, 3] * boxes[count, 3]
            + boxes[count, 4] * boxes[count, 4]
            + boxes[count, 5] * boxes[count, 5]
        )
        state[STEPS] += 1.0
        distance, known = nearest_outer(model, outer, middle, known, workspace)
        is_inside = contains(model, outer, middle, known, workspace)
        if distance > radius * ROUNDED_UP and not is_inside:
            continue
        p = to_second(frame_map, *middle)
        inner_distance, inner_known = nearest_outer(model, inner, p, inner_known, workspace)
        is_inner = contains(model, inner, p, inner_known, workspace)
        if inner_distance > radius * ratio * ROUNDED_UP and not is_inner:
            continue
        if is_inside:
            gap = 0.0 if is_inner else inner_distance / ratio * ROUNDED_UP
            position = middle if is_inner else _foot(model.reals, inner_known, p, frame_map, workspace)
            keep_deeper(state, distance - gap, position)
        bound, goal = min(bound, (distance + radius) * ROUNDED_UP), goal_of(state, limits)
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
def fill_common_box(model, inner, outer, frame_map, boxes):
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
    cap = fill_common_box(model, inner, outer, (turn, offset), boxes)
    search_surface(model, inner, outer, (turn, offset), cap, state, limits, budget, workspace)
    search_volume(model, inner, outer, (turn, offset), boxes, state, limits, 2.0 * budget, workspace)
    deepest[DEEPEST_STEPS] = state[STEPS]
    deepest[DEEPEST_UPPER] = max(known, max(state[BEST], state[BOUND]) / scale * ROUNDED_UP)
    if state[BEST] > known * scale:
        deepest[DEEPEST_LOWER] = state[BEST] / scale * ROUNDED_DOWN
        to_scene(frames, model.parts, outer, state, POSITION, deepest, DEEPEST_POINT)
