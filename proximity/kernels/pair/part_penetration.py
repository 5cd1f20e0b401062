"""First displacement of a part along a direction that separates it from another, with bounds.

Lower bound: a line along the direction passes through a common point of both parts, and the parts overlap
while its intervals inside the two do. Upper bound: parts at some distance stay apart while one of them moves
by less. Neither depends on the resolution of the surfaces, so the depth does not go to 0 when a mesh is
refined.

Source: directional penetration depth, Dobkin, Hershberger, Kirkpatrick, Suri 1993; the enclosure is ours.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.frames import (
    ROUNDED_DOWN,
    direction_to_local,
    to_local,
    to_scene,
    turn_to_scene,
)
from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import NO_SLOT
from proximity.kernels.pair.boxes import POSE_SIZE, frames_at, rounding_size
from proximity.kernels.pair.meeting import SHARING, share_at
from proximity.kernels.pair.part_query import fill_ends, turn_normal
from proximity.kernels.pair.triangles import CROSSING
from proximity.kernels.pair.walk import nearest_of_parts
from proximity.kernels.ray.walk import ray_in_part
from proximity.kernels.scene.inside.chunk_tables import new_workspace, reset_recent
from proximity.kernels.scene.inside.containment import contained_corner, is_deep
from proximity.kernels.stack_arrays import stack_arrays_of, stack_f64, stack_i64
from proximity.native import inlined, kernel, record

MAX_PROBES = 48
CLOSEST_PROBE_TOLERANCE = 0.1
NEAR_CEILING = 0.8
"""Offset of the next probe below a separating displacement, as a share of the tolerance."""
SKIPPED_AHEAD = 2.0**-36
"""Local units skipped ahead of a point, which may lie on a face."""

PROBE_APART, PROBE_OVERLAPS, PROBE_UNDECIDED = 1, 0, -1
PROBE_RESULT = record(
    "ProbeResult",
    state="i8",  # PROBE_APART, PROBE_OVERLAPS or PROBE_UNDECIDED
    gap="f8",  # m: lower bound of the distance of the parts
    point="(3,)f8",  # scene's frame: a common point
)
DISPLACEMENTS = record(
    "Displacements",
    lower="f8",  # m: no smaller displacement separates the parts
    upper="f8",  # m: this displacement separates them
    floor="f8",  # m: the next probe is between these two
    ceiling="f8",
    next_stride="f8",  # relative offset of the next probe from the floor: 0 at first, to separate flush parts
    first_stride="f8",
)
stack_result, stack_displacements = stack_arrays_of(PROBE_RESULT)[0], stack_arrays_of(DISPLACEMENTS)[0]


@inlined
def _unit(x, y, z):
    """Return a normalized direction and its length; zeros for a zero vector."""
    length = sqrt(dot(x, y, z, x, y, z))
    return (x / length, y / length, z / length, length) if length > 0.0 else (0.0, 0.0, 0.0, 0.0)


@inlined
def _boxes_apart_from(one, other, direction):
    """Return the displacement from which on the boxes of two parts are apart."""
    apart = np.inf
    for k in range(3):
        if direction[k] > 0.0:
            apart = min(apart, (other.box_upper[k] - one.box_lower[k]) / direction[k])
        elif direction[k] < 0.0:
            apart = min(apart, (other.box_lower[k] - one.box_upper[k]) / direction[k])
    return max(apart, 0.0) / ROUNDED_DOWN


@kernel
def _inside_ahead(model, part, point, direction, longest, workspace):
    """Return the length, m, at most *longest*, of a part's inside along a unit direction from a point."""
    reals, words, frames, parts = model
    scale = frames[part].scale
    x, y, z = to_local(frames, parts, part, point[0], point[1], point[2])
    dx, dy, dz = direction_to_local(frames, parts, part, direction[0], direction[1], direction[2])
    origin = x + SKIPPED_AHEAD * dx, y + SKIPPED_AHEAD * dy, z + SKIPPED_AHEAD * dz
    start, no_slot = parts[part].root, np.int64(NO_SLOT)
    _, length, _, _ = ray_in_part(
        reals, words, start, origin, (dx, dy, dz), longest * scale, no_slot, workspace.stacks
    )
    if length == np.inf:
        return 0.0
    half = SKIPPED_AHEAD + 0.5 * length
    middle = x + half * dx, y + half * dy, z + half * dz
    return (length + SKIPPED_AHEAD) / scale if is_deep(model, part, middle, 0.0, workspace) else 0.0


@kernel
def _point_of_both(model, first, second, slots, frame_map, shift, found, workspace):
    """Find a point inside both parts next to two triangles; return success."""
    frames, parts = model.frames, model.parts
    inside, direction = stack_f64(6), stack_f64(3)
    slack = rounding_size(frames, first, second, frame_map[1])
    if share_at(model, first, second, slots, frame_map, slack, inside) != SHARING:
        return False
    to_scene(frames, parts, first, inside, 0, found.point, 0)
    turn_to_scene(frames, parts, first, inside, 3, direction, 0)
    x, y, z = vector(found.point)
    along, there = (direction[0], direction[1], direction[2]), (x + shift[0], y + shift[1], z + shift[2])
    reach = _inside_ahead(model, first, (x, y, z), along, np.inf, workspace)
    reach = min(reach, _inside_ahead(model, second, there, along, np.inf, workspace))
    for k in range(3):
        found.point[k] = there[k] + 0.5 * reach * direction[k]
    return True


@kernel
def _probe(model, first, second, faces, shift, nearest, found, normal, last, budget, workspace):
    """Determine the relation of the parts with the first one shifted, into *found*; return the steps.

    *nearest*, m: larger distances are irrelevant. *normal*, *last* slots: updated if found.
    """
    frames, slots = model.frames, stack_i64(2)
    turn, offset, one, other = stack_f64(9), stack_f64(3), stack_f64(POSE_SIZE), stack_f64(POSE_SIZE)
    for k in range(9):
        one[k], other[k] = frames[first].rotation[k], frames[second].rotation[k]
    for k in range(3):
        one[9 + k], other[9 + k] = frames[first].translation[k] + shift[k], frames[second].translation[k]
    frames_at(frames, first, second, one, other, turn, offset)
    slots[0], slots[1] = last[0], last[1]
    reach, scale = nearest * frames[first].scale, frames[first].scale
    best, lower_sq, steps = nearest_of_parts(
        model, first, second, (turn, offset), reach * reach, CLOSEST_PROBE_TOLERANCE, budget, slots
    )
    if slots[0] != NO_SLOT:
        last[0], last[1] = slots[0], slots[1]
    if best == CROSSING:
        is_found = _point_of_both(model, first, second, slots, (turn, offset), shift, found, workspace)
        found.state = PROBE_OVERLAPS if is_found else PROBE_UNDECIDED
        return steps
    found.gap, point = min(sqrt(max(lower_sq, 0.0)) / scale, nearest), stack_f64(3)
    back = -shift[0], -shift[1], -shift[2]
    found.state = PROBE_APART if found.gap > 0.0 or budget == 0 or steps < budget else PROBE_UNDECIDED
    if contained_corner(model, second, first, faces[0], shift, point, workspace):
        found.state = PROBE_OVERLAPS
    elif contained_corner(model, first, second, faces[1], back, point, workspace):
        found.state = PROBE_OVERLAPS
        for k in range(3):
            point[k] += shift[k]
    elif slots[0] != NO_SLOT:
        if best > 0.0:
            ends = stack_f64(6)
            fill_ends(model, first, second, (turn, offset), False, slots, ends)
            normal[0], normal[1], normal[2], _ = _unit(
                ends[0] - ends[3], ends[1] - ends[4], ends[2] - ends[5]
            )
        else:
            turn_normal(model, first, (turn, offset), slots, normal)
    for k in range(3):
        found.point[k] = point[k]
    return steps


@kernel
def _learn(model, first, second, at, direction, shift, known, found, workspace):
    """Update the known bounds with the result of a probe at displacement *at*."""
    if found.state == PROBE_APART:
        known.upper = max(min(known.upper, at - found.gap * ROUNDED_DOWN), known.lower)
        known.ceiling = min(known.ceiling, known.upper)
        return
    begin = end = at
    if found.state == PROBE_OVERLAPS:
        there = vector(found.point)
        here = there[0] - shift[0], there[1] - shift[1], there[2] - shift[2]
        along = direction[0], direction[1], direction[2]
        against = -direction[0], -direction[1], -direction[2]
        end += _inside_ahead(model, second, there, along, np.inf, workspace)
        end += _inside_ahead(model, first, here, against, np.inf, workspace)
        begin -= _inside_ahead(model, second, there, against, np.inf, workspace)
        begin -= _inside_ahead(model, first, here, along, np.inf, workspace)
        end = min(end * ROUNDED_DOWN, known.upper)
    known.next_stride = 4.0 * known.next_stride + known.first_stride
    # Intervals that only touch leave an instant at which the parts may be apart.
    if begin < known.lower * ROUNDED_DOWN:
        known.lower = max(known.lower, end)
        known.floor = max(known.floor, end)
    elif begin <= known.floor:
        known.floor = max(known.floor, end)
    else:
        known.ceiling = min(known.ceiling, begin)
        known.floor = known.floor if end > begin else at


@kernel
def depth_along(model, first, second, faces, other_faces, direction, limit, tolerance, budget, depth):
    """Fill bounds of the first part's separating displacement along a unit *direction*, scene's frame.

    *faces*, *other_faces*: one of each of their surfaces. *limit*, m: the search ends beyond this depth.
    *tolerance*: permitted relative gap of the bounds. *budget*: maximum steps; 0: no limit. The first probe
    is at the upper bound in *depth* on entry, or 0.
    """
    known, found = stack_displacements(1)[0], stack_result(1)[0]
    frames, shift = model.frames, stack_f64(3)
    normal, last, workspace = stack_f64(3), stack_i64(2), new_workspace()
    last[0] = last[1] = NO_SLOT
    reset_recent(workspace)
    size = _boxes_apart_from(frames[first], frames[second], direction)
    known.lower = known.floor = 0.0
    known.upper = known.ceiling = size
    known.first_stride = max(0.5 * tolerance, 1e-6)
    known.next_stride = -0.25 * known.first_stride
    normal[0] = normal[1] = normal[2] = 0.0
    at, steps, probes, is_open = min(depth.upper, size), 0, 0, size > 0.0
    while is_open:
        for k in range(3):
            shift[k] = at * direction[k]
        nearest = max(at - known.lower, 1e-9 * size) * 1.001
        left = budget - steps if budget > 0 else 0
        steps += _probe(
            model, first, second, (faces, other_faces), shift, nearest, found, normal, last, left, workspace
        )
        _learn(model, first, second, at, direction, shift, known, found, workspace)
        probes += 1
        if known.ceiling - known.floor <= tolerance * known.ceiling + 1e-12 * size:
            # Search beyond a gap that stays open below.
            known.ceiling = known.upper
            known.floor = max(known.floor, min(at, known.upper))
        is_open = (
            known.upper - known.floor > tolerance * known.upper + 1e-12 * size
            and known.lower <= limit
            and probes < MAX_PROBES
            and (budget == 0 or steps < budget)
        )
        at = 0.5 * (known.floor + known.ceiling)
        if found.state == PROBE_APART and probes % 2 == 1:
            at = max(at, (1.0 - NEAR_CEILING * tolerance) * known.ceiling)
        elif found.state != PROBE_APART:
            stride = known.next_stride
            at = min(at, known.floor / ROUNDED_DOWN * (1.0 + stride) + stride * 1e-3 * size)
    depth.lower, depth.upper, depth.steps = known.lower, known.upper, steps
    for k in range(3):
        depth.normal[k] = normal[k]
