"""Deepest point of one part inside another, with bounds of its depth.

Branch and bound, first over pieces of the inner part's surface (`deepest_pieces`), then over boxes of the
common volume.

Within the volume the depth is largest at a critical point, which has nearest points on all sides. A box whose
near outer faces all face one side has none, and its surroundings bound its depth.

Source: critical points of the distance function, Chazal, Lieutier 2005; the bounds are ours.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.closest_feature import (
    closest_on_triangle,
    read_corners,
)
from proximity.kernels.geometry.frames import ROUNDED_DOWN, ROUNDED_UP, to_scene
from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NO_SLOT, SIGN_NONE, ModelArrays
from proximity.kernels.nodes import corners_of_block
from proximity.kernels.pair.boxes import frames_between, mapped, to_second
from proximity.kernels.pair.deepest_pieces import search_surface
from proximity.kernels.pair.deepest_state import (
    CAPACITY,
    contains,
    distance_to_slot,
    goal_of,
    keep_deeper,
    nearest_outer,
    normal_of_slot,
    open_meeting,
    stack_search,
    widened_box,
)
from proximity.kernels.pair.triangles import SIDE_ROUNDING, between
from proximity.kernels.ray.walk import ray_in_part
from proximity.kernels.scene.inside.chunk_tables import new_workspace, reset_recent
from proximity.kernels.stack_arrays import stack_arrays_of, stack_f64
from proximity.kernels.traverse.depth_first import depth_first, in_blocks
from proximity.native import entry, inlined, kernel, record
from proximity.native.simd import absolute, bits, maximum, minimum, splat, trailing_zeros

VOLUME_BOX = record("VolumeBox", middle="(3,)f8", half="(3,)f8", bound="f8")
"""A box of the common volume, outer local frame: centre, half sides, and an upper bound of the depth."""
stack_boxes, _ = stack_arrays_of(VOLUME_BOX)
SIDES = 8
"""Number of directions tried as a common side of all faces near a box."""
FACING = 2.0**-10
"""Minimum cosine between the faces' normals and their common side."""
REST = 1e-7
"""Relative to a part's size: bounds of the deepest point are brought no closer."""


@inlined
def _find_averted(reals, reference, query, best):
    """Find a triangle of a block that meets the box of the query and does not face its direction."""
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
    """Return one of the eight corners of a waiting box."""
    middle, half = boxes[row].middle, boxes[row].half
    return (
        middle[0] + (half[0] if k & 1 else -half[0]),
        middle[1] + (half[1] if k & 2 else -half[1]),
        middle[2] + (half[2] if k & 4 else -half[2]),
    )


@kernel
def _bound_in_box(model, outer, boxes, row, middle, distance, slot, bound, goal, workspace):
    """Return an upper bound of the depth in a box: from one triangle, or from two on opposite sides."""
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
    """Return the unit direction from the nearest point of a triangle to *p*."""
    closest = workspace.closest[0]
    read_corners(reals, slot, closest)
    closest_on_triangle(p[0], p[1], p[2], closest)
    x, y, z = vector(closest.arm)
    return x / distance, y / distance, z / distance


@kernel
def _has_critical(model, outer, boxes, row, middle, distance, slot, is_inside, bound, workspace):
    """Test whether a box may have a critical point of the depth: nearby outer faces have no common side."""
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
        # Rotate towards the face found, until all faces agree or none can.
        nx, ny, nz = normal_of_slot(model.reals, averted)
        x, y, z = x + nx, y + ny, z + nz
        length = sqrt(dot(x, y, z, x, y, z))
        if not length > FACING:
            return True
        x, y, z = x / length, y / length, z / length
    return True


@kernel
def _foot(reals, slot, p, frame_map, workspace):
    """Return the point of a triangle of the inner part nearest to *p*, in the outer frame."""
    closest = workspace.closest[0]
    read_corners(reals, slot, closest)
    closest_on_triangle(p[0], p[1], p[2], closest)
    return mapped(frame_map[0], frame_map[1], *vector(closest.point))


@kernel
def search_volume(model, inner, outer, frame_map, boxes, state, limits, budget, workspace):
    """Search for deep points in the common volume of both parts, starting from the first box."""
    ratio = abs(model.frames[inner].scale / model.frames[outer].scale)
    count, known, inner_known = 1, np.int64(NO_SLOT), np.int64(NO_SLOT)
    while count > 0 and state.steps < budget and count + 2 < CAPACITY:
        count -= 1
        box = boxes[count]
        middle, half, bound = vector(box.middle), box.half, box.bound
        if bound <= goal_of(state, limits):
            state.bound = max(state.bound, bound)
            continue
        radius = sqrt(half[0] * half[0] + half[1] * half[1] + half[2] * half[2])
        state.steps += 1
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
            state.bound = max(state.bound, bound)
        elif _has_critical(model, outer, boxes, count, middle, distance, known, is_inside, bound, workspace):
            count = _halve(boxes, count, bound)
    for row in range(count):
        state.bound = max(state.bound, boxes[row].bound)


@kernel
def _halve(boxes, row, bound):
    """Split a box in half along its longest side; return the count."""
    box, other, axis = boxes[row], boxes[row + 1], 0
    for k in range(1, 3):
        axis = k if box.half[k] > box.half[axis] else axis
    quarter = 0.5 * box.half[axis]
    box.half[axis] = quarter
    for k in range(3):
        other.middle[k], other.half[k] = box.middle[k], box.half[k]
    box.middle[axis] -= quarter
    other.middle[axis] += quarter
    box.bound = other.bound = bound
    return row + 2


@kernel
def fill_common_box(model, inner, outer, frame_map, box):
    """Fill the common box of both parts, outer local frame; return an upper bound of the depth in it."""
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
        box.middle[axis], box.half[axis] = 0.5 * (low + high), max(0.5 * (high - low), 0.0) * ROUNDED_UP
    box.bound = least * ROUNDED_UP
    return box.bound


@entry(ModelArrays, "int, int, float, int, DeepestAnswer[:]")
def deepest_point(model, first, second, tolerance, budget, answers):
    """Fill bounds of the maximum depth of a point of either part in the other; (1,).

    The point is nan if there is none. *tolerance*: permitted relative gap of the bounds. *budget*: maximum
    steps for each part.
    """
    deepest, frames, size_sq = answers[0], model.frames, np.inf
    deepest.lower, upper, steps = 0.0, 0.0, 0
    deepest.point[0] = deepest.point[1] = deepest.point[2] = np.nan
    for part in (first, second):
        x, y, z = between(vector(frames[part].own_lower), vector(frames[part].own_upper))
        size_sq = min(size_sq, dot(x, y, z, x, y, z))
    rest = REST * sqrt(size_sq)
    for inner, outer in ((first, second), (second, first)):
        _deepest_inside(model, inner, outer, tolerance, rest, budget, deepest)
        upper, steps = max(upper, deepest.upper), steps + deepest.steps
    deepest.upper, deepest.steps = upper, steps


@kernel
def _deepest_inside(model, inner, outer, tolerance, rest, budget, deepest):
    """Update bounds of the depth of one part in another; *deepest* holds a known lower bound."""
    frames, scale = model.frames, model.frames[outer].scale
    workspace, state, boxes = new_workspace(), stack_search(1)[0], stack_boxes(CAPACITY)
    turn, offset = stack_f64(9), stack_f64(3)
    reset_recent(workspace)
    known = deepest.lower
    deepest.upper, deepest.steps = known, 0
    if model.parts[outer].sign == SIGN_NONE or model.parts[inner].sign == SIGN_NONE:
        return
    frames_between(frames, outer, inner, turn, offset)
    slack = 1.0
    for k in range(3):
        slack = max(slack, abs(offset[k]) + 2.0 * abs(scale / frames[inner].scale))
    limits = tolerance, max(rest * scale, 16.0 * SIDE_ROUNDING * slack), 16.0 * SIDE_ROUNDING * slack
    state.best, state.bound, state.steps = known * scale, 0.0, 0
    cap = fill_common_box(model, inner, outer, (turn, offset), boxes[0])
    search_surface(model, inner, outer, (turn, offset), cap, state, limits, budget, workspace)
    search_volume(model, inner, outer, (turn, offset), boxes, state, limits, 2 * budget, workspace)
    deepest.steps = state.steps
    deepest.upper = max(known, max(state.best, state.bound) / scale * ROUNDED_UP)
    if state.best > known * scale:
        deepest.lower = state.best / scale * ROUNDED_DOWN
        to_scene(frames, model.parts, outer, state.position, 0, deepest.point, 0)
