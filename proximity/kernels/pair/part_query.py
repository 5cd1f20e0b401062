"""The shortest connection of two parts."""

from math import sqrt

import numpy as np

from proximity.kernels.answers import APART, CROSSES, FIRST_INSIDE, TOUCHES
from proximity.kernels.geometry.frames import rounding_at, to_scene, turn_to_scene
from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.layout import NO_FACE, NO_SLOT, ModelArrays
from proximity.kernels.pair.boxes import frames_between, gap_along, rounding_size
from proximity.kernels.pair.meeting import common_line, meeting_reach
from proximity.kernels.pair.triangles import BOTH, CROSSING, between, connect, corner_of, read_both
from proximity.kernels.pair.walk import nearest_of_parts
from proximity.kernels.scene.inside.chunk_tables import new_workspace, reset_recent
from proximity.kernels.scene.inside.containment import contained_corner
from proximity.kernels.stack_arrays import stack_f64, stack_i64
from proximity.native import entry, kernel
from proximity.native.simd import load_int


@entry(ModelArrays, "int, int, float, float, int, ClearanceAnswer[:]")
def connect_parts(model, first, second, limit, tolerance, budget, answers):
    """Fill the shortest connection of two parts, (1,): of length 0 if they cross.

    Only connections shorter than *limit*, m, are searched; the result may exceed the shortest by the relative
    *tolerance*. *budget*: maximum opened nodes and blocks; 0: no limit. If none is found, the length is inf,
    the points nan and the faces `NO_FACE`. If ``may_be_inside`` is set, `decide_inside` completes the answer.
    """
    connect_pair(model, first, second, limit, tolerance, budget, answers[0])


@entry(ModelArrays, "int, int, int32[:], int32[:], ClearanceAnswer[:]")
def decide_inside(model, first, second, faces, other_faces, answers):
    """Complete the connection of two parts of which one may be inside the other.

    *faces*, *other_faces*: one of each surface of either part.
    """
    complete_pair(model, first, second, faces, other_faces, answers[0])


@kernel
def complete_pair(model, first, second, faces, other_faces, answer):
    """Complete an answer as `decide_inside` does: both ends are then one point of the inner surface."""
    inside = inner_part(model, first, second, faces, other_faces)
    if inside:
        if np.isnan(answer.points[0]):
            connect_pair(model, first, second, np.inf, 0.0, 0, answer)
        answer.lower = answer.distance = 0.0
        answer.faces[0] = answer.faces[1] = NO_FACE
        answer.relation = FIRST_INSIDE + inside - 1
        inner_end = 3 * (inside - 1)
        for k in range(3):
            answer.points[3 - inner_end + k] = answer.points[inner_end + k]
    answer.may_be_inside = 0


@kernel
def inner_part(model, first, second, faces, other_faces):
    """Return 1 if the first part is inside the second, 2 for the reverse, else 0; no surfaces cross."""
    workspace, point = new_workspace(), stack_f64(3)
    reset_recent(workspace)
    if contained_corner(model, second, first, faces, (0.0, 0.0, 0.0), point, workspace):
        return 1
    reset_recent(workspace)
    return 2 if contained_corner(model, first, second, other_faces, (0.0, 0.0, 0.0), point, workspace) else 0


@kernel
def connect_pair(model, first, second, limit, tolerance, budget, answer):
    """Fill the connection of two parts as `connect_parts` does."""
    frames = model.frames
    # The order of the parts does not change the answer.
    is_crossing = _shortest(model, min(first, second), max(first, second), limit, tolerance, budget, answer)
    if first > second:
        points, faces = answer.points, answer.faces
        for k in range(3):
            points[k], points[3 + k] = points[3 + k], points[k]
        faces[0], faces[1] = faces[1], faces[0]
    # Written so that nan does not touch.
    is_touching = answer.distance <= rounding_at(frames, *vector(answer.points))
    answer.relation = CROSSES if is_crossing else (TOUCHES if is_touching else APART)
    one, other = frames[first], frames[second]
    gap = max(gap_along(one, other, 0), gap_along(one, other, 1), gap_along(one, other, 2))
    answer.may_be_inside = 1 if gap <= 0.0 and not is_crossing else 0


@kernel
def _shortest(model, first, second, limit, tolerance, budget, answer):
    """Fill distance, ends and faces of an answer; return whether the parts cross."""
    _, words, frames, parts = model
    slots, scale = stack_i64(2), frames[first].scale
    slots[0] = slots[1] = NO_SLOT
    reach = limit * scale
    turn, offset = stack_f64(9), stack_f64(3)
    frames_between(frames, first, second, turn, offset)
    best, lower_sq, _ = nearest_of_parts(
        model, first, second, (turn, offset), reach * reach, tolerance, budget, slots
    )
    if slots[0] == NO_SLOT:
        answer.lower, answer.distance = min(sqrt(lower_sq) / scale, limit), np.inf
        for k in range(6):
            answer.points[k] = np.nan
        answer.faces[0] = answer.faces[1] = NO_FACE
        return False
    distance = fill_connection(model, first, second, best == CROSSING, slots, answer.points)
    # After a complete search the bound equals the distance, except for rounding.
    is_exact = best == CROSSING or (tolerance == 0.0 and lower_sq >= best > 0.0)
    answer.lower = distance if is_exact else min(sqrt(lower_sq) / scale, distance)
    answer.distance = distance
    answer.faces[0] = load_int(words, parts[first].slot_faces + slots[0])
    answer.faces[1] = load_int(words, parts[second].slot_faces + slots[1])
    return best == CROSSING


@kernel
def fill_connection(model, first, second, is_crossing, slots, points):
    """Fill the ends, (6,), scene's frame, of the connection of two triangles; return its length, m."""
    turn, offset = stack_f64(9), stack_f64(3)
    frames_between(model.frames, first, second, turn, offset)
    return fill_ends(model, first, second, (turn, offset), is_crossing, slots, points)


@kernel
def fill_ends(model, first, second, frame_map, is_crossing, slots, points):
    """Fill ends like `fill_connection`, with the second part mapped by *frame_map*."""
    reals, _, frames, parts = model
    corners, ends = stack_f64(BOTH), stack_f64(6)
    read_both(reals, slots, frame_map[0], frame_map[1], corners)
    apart_sq = connect(corners, ends)
    if is_crossing:
        common_line(corners, meeting_reach(rounding_size(frames, first, second, frame_map[1])), ends)
        ends[3], ends[4], ends[5], apart_sq = ends[0], ends[1], ends[2], 0.0
    to_scene(frames, parts, first, ends, 0, points, 0)
    to_scene(frames, parts, first, ends, 3, points, 3)
    return sqrt(apart_sq) / frames[first].scale


@kernel
def turn_normal(model, first, frame_map, slots, normal):
    """Set the direction, scene's frame, that separates the first part where two triangles touch.

    It is the normal of the triangle that has the other on its outer side. *frame_map*: from the second part's
    frame.
    """
    corners, local = stack_f64(BOTH), stack_f64(3)
    read_both(model.reals, slots, frame_map[0], frame_map[1], corners)
    best = -np.inf
    for one in range(2):
        a = corner_of(corners, one, 0)
        x, y, z = cross(*between(a, corner_of(corners, one, 1)), *between(a, corner_of(corners, one, 2)))
        length, lowest = sqrt(dot(x, y, z, x, y, z)), np.inf
        for k in range(3):
            lowest = min(lowest, dot(x, y, z, *between(a, corner_of(corners, 1 - one, k))))
        if length > 0.0 and lowest / length > best:
            best, side = lowest / length, 2 * one - 1
            local[0], local[1], local[2] = side * x / length, side * y / length, side * z / length
    if best > -np.inf:
        turn_to_scene(model.frames, model.parts, first, local, 0, normal, 0)
