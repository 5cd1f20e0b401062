"""How far a part must move along a direction until it is free of another, for the first time, with bounds.

From below: a line along the direction passes through a point that both parts have in common. As long as the
stretches of the line inside the one and inside the other overlap, the parts do. From above: parts that are
some distance apart stay so while one of them moves by less. Neither depends on how finely surfaces are
divided, and so the depth does not go to 0 where a mesh is refined.

Source: directional penetration depth, Dobkin, Hershberger, Kirkpatrick, Suri 1993; the enclosure is ours.
"""

from math import sqrt

import numpy as np

from proximity.kernels.answers import DEPTH_LOWER, DEPTH_NORMAL, DEPTH_STEPS, DEPTH_UPPER
from proximity.kernels.geometry.frames import (
    ROUNDED_DOWN,
    direction_to_local,
    to_local,
    to_scene,
    turn_to_scene,
)
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import NO_SLOT, ModelArrays
from proximity.kernels.pair.boxes import frames_at
from proximity.kernels.pair.held_motion import POSE_SIZE
from proximity.kernels.pair.meeting import SHARING, share_at
from proximity.kernels.pair.part_query import fill_ends, turn_normal
from proximity.kernels.pair.triangles import CROSSING
from proximity.kernels.pair.walk import nearest_of_parts, rounding_size
from proximity.kernels.ray.walk import ray_in_part
from proximity.kernels.scene.inside.chunk_tables import new_workspace, reset_recent
from proximity.kernels.scene.inside.containment import contained_corner, is_deep
from proximity.kernels.stack_arrays import stack_f64, stack_i64
from proximity.native import entry, inlined, kernel

MOST_PROBES = 48
CLOSEST_PROBE_TOLERANCE = 0.1
NEAR_CEILING = 0.8
"""Share of the tolerance below a displacement at which parts are apart, where it is looked next."""
SKIPPED_AHEAD = 2.0**-36
"""Local units ahead of a point that are not looked at: the point may lie on a face."""

# What is known: the first part is free nowhere below `LOWER`, and free at `UPPER`; the next probe is between
# `FLOOR` and `CEILING`, and `NEXT_STRIDE` beyond the floor: 0 at first, since flush parts come free there.
LOWER, UPPER, FLOOR, CEILING, NEXT_STRIDE, FIRST_STRIDE, KNOWN_SIZE = 0, 1, 2, 3, 4, 5, 6
# What a probe finds: whether the parts are apart, and how far; or a point of both, scene's frame.
STATE, GAP, POINT = 0, 1, 2
PROBE_APART, PROBE_OVERLAPS, PROBE_UNDECIDED = 1.0, 0.0, -1.0


@inlined
def _unit(x, y, z):
    """A direction with its length taken out, and the length; 0 where there is none."""
    length = sqrt(dot(x, y, z, x, y, z))
    return (x / length, y / length, z / length, length) if length > 0.0 else (0.0, 0.0, 0.0, 0.0)


@inlined
def _boxes_apart_from(one, other, direction):
    """From which displacement on the boxes of two parts are apart."""
    apart = np.inf
    for k in range(3):
        if direction[k] > 0.0:
            apart = min(apart, (other.box_upper[k] - one.box_lower[k]) / direction[k])
        elif direction[k] < 0.0:
            apart = min(apart, (other.box_lower[k] - one.box_upper[k]) / direction[k])
    return max(apart, 0.0) / ROUNDED_DOWN


@kernel
def _inside_ahead(model, part, point, direction, longest, workspace):
    """How far from a point on, m, at most *longest*, a part's inside reaches along a unit direction."""
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
    """Fill a point that is inside both of two parts next to two triangles; whether it is found."""
    frames, parts = model.frames, model.parts
    inside, direction = stack_f64(6), stack_f64(3)
    slack = rounding_size(frames, first, second, frame_map[1])
    if share_at(model, first, second, slots, frame_map, slack, inside) != SHARING:
        return False
    to_scene(frames, parts, first, inside, 0, found, POINT)
    turn_to_scene(frames, parts, first, inside, 3, direction, 0)
    x, y, z = found[POINT], found[POINT + 1], found[POINT + 2]
    along, there = (direction[0], direction[1], direction[2]), (x + shift[0], y + shift[1], z + shift[2])
    reach = _inside_ahead(model, first, (x, y, z), along, np.inf, workspace)
    reach = min(reach, _inside_ahead(model, second, there, along, np.inf, workspace))
    for k in range(3):
        found[POINT + k] = there[k] + 0.5 * reach * direction[k]
    return True


@kernel
def _probe(model, first, second, faces, shift, nearest, found, normal, last, budget, workspace):
    """Fill *found* with how the parts lie with the first one shifted; return the steps.

    *nearest*, m: how far apart at most is of interest. *normal*, *last* slots: renewed where they are found.
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
        found[STATE] = PROBE_OVERLAPS if is_found else PROBE_UNDECIDED
        return steps
    found[GAP], point = min(sqrt(max(lower_sq, 0.0)) / scale, nearest), stack_f64(3)
    back = -shift[0], -shift[1], -shift[2]
    found[STATE] = PROBE_APART if found[GAP] > 0.0 or budget == 0 or steps < budget else PROBE_UNDECIDED
    if contained_corner(model, second, first, faces[0], shift, point, workspace):
        found[STATE] = PROBE_OVERLAPS
    elif contained_corner(model, first, second, faces[1], back, point, workspace):
        found[STATE] = PROBE_OVERLAPS
        for k in range(3):
            point[k] += shift[k]
    elif slots[0] != NO_SLOT:
        if best > 0.0:
            ends = stack_f64(6)
            fill_ends(model, first, second, (turn, offset), False, slots, ends, 0)
            normal[0], normal[1], normal[2], _ = _unit(
                ends[0] - ends[3], ends[1] - ends[4], ends[2] - ends[5]
            )
        else:
            turn_normal(model, first, (turn, offset), slots, normal)
    for k in range(3):
        found[POINT + k] = point[k]
    return steps


@kernel
def _learn(model, first, second, at, direction, shift, known, found, workspace):
    """Take into account what a probe has found with the first part displaced by *at*."""
    if found[STATE] == PROBE_APART:
        known[UPPER] = max(min(known[UPPER], at - found[GAP] * ROUNDED_DOWN), known[LOWER])
        known[CEILING] = min(known[CEILING], known[UPPER])
        return
    begin = end = at
    if found[STATE] == PROBE_OVERLAPS:
        there = found[POINT], found[POINT + 1], found[POINT + 2]
        here = there[0] - shift[0], there[1] - shift[1], there[2] - shift[2]
        along = direction[0], direction[1], direction[2]
        against = -direction[0], -direction[1], -direction[2]
        end += _inside_ahead(model, second, there, along, np.inf, workspace)
        end += _inside_ahead(model, first, here, against, np.inf, workspace)
        begin -= _inside_ahead(model, second, there, against, np.inf, workspace)
        begin -= _inside_ahead(model, first, here, along, np.inf, workspace)
        end = min(end * ROUNDED_DOWN, known[UPPER])
    known[NEXT_STRIDE] = 4.0 * known[NEXT_STRIDE] + known[FIRST_STRIDE]
    # Stretches that only meet leave an instant at which the parts may be free.
    if begin < known[LOWER] * ROUNDED_DOWN:
        known[LOWER] = max(known[LOWER], end)
        known[FLOOR] = max(known[FLOOR], end)
    elif begin <= known[FLOOR]:
        known[FLOOR] = max(known[FLOOR], end)
    else:
        known[CEILING] = min(known[CEILING], begin)
        known[FLOOR] = known[FLOOR] if end > begin else at


@entry(ModelArrays, "int, int, int32[:], int32[:], float64[:], float, float, int, float64[:]")
def depth_along(model, first, second, faces, other_faces, direction, limit, tolerance, budget, depth):
    """Fill how far the first part must move along a unit *direction*, scene's frame; (`DEPTH_SIZE`,).

    *faces*, *other_faces*: one of each of their surfaces. *limit*, m: a depth beyond it is not looked for.
    *tolerance*: share of it by which its bounds may differ. *budget*: steps at most; 0: as many as it takes.
    The bound from above that is in *depth* before is where it is looked first; 0: nowhere.
    """
    frames, known, found, shift = model.frames, stack_f64(KNOWN_SIZE), stack_f64(5), stack_f64(3)
    normal, last, workspace = stack_f64(3), stack_i64(2), new_workspace()
    last[0] = last[1] = NO_SLOT
    reset_recent(workspace)
    size = _boxes_apart_from(frames[first], frames[second], direction)
    known[LOWER] = known[FLOOR] = 0.0
    known[UPPER] = known[CEILING] = size
    known[FIRST_STRIDE] = max(0.5 * tolerance, 1e-6)
    known[NEXT_STRIDE] = -0.25 * known[FIRST_STRIDE]
    normal[0] = normal[1] = normal[2] = 0.0
    at, steps, probes, is_open = min(depth[DEPTH_UPPER], size), 0, 0, size > 0.0
    while is_open:
        for k in range(3):
            shift[k] = at * direction[k]
        nearest = max(at - known[LOWER], 1e-9 * size) * 1.001
        left = budget - steps if budget > 0 else 0
        steps += _probe(
            model, first, second, (faces, other_faces), shift, nearest, found, normal, last, left, workspace
        )
        _learn(model, first, second, at, direction, shift, known, found, workspace)
        probes += 1
        if known[CEILING] - known[FLOOR] <= tolerance * known[CEILING] + 1e-12 * size:
            # A gap that is left open below: it is looked on beyond it.
            known[CEILING] = known[UPPER]
            known[FLOOR] = max(known[FLOOR], min(at, known[UPPER]))
        is_open = (
            known[UPPER] - known[FLOOR] > tolerance * known[UPPER] + 1e-12 * size
            and known[LOWER] <= limit
            and probes < MOST_PROBES
            and (budget == 0 or steps < budget)
        )
        at = 0.5 * (known[FLOOR] + known[CEILING])
        if found[STATE] == PROBE_APART and probes % 2 == 1:
            at = max(at, (1.0 - NEAR_CEILING * tolerance) * known[CEILING])
        elif found[STATE] != PROBE_APART:
            stride = known[NEXT_STRIDE]
            at = min(at, known[FLOOR] / ROUNDED_DOWN * (1.0 + stride) + stride * 1e-3 * size)
    depth[DEPTH_LOWER], depth[DEPTH_UPPER], depth[DEPTH_STEPS] = known[LOWER], known[UPPER], steps
    for k in range(3):
        depth[DEPTH_NORMAL + k] = normal[k]
