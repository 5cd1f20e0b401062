"""The shortest connection of two parts, as Python asks for it."""

from math import sqrt

import numpy as np

from proximity.kernels.answers import APART, CROSSES, TOUCHES
from proximity.kernels.geometry.frames import rounding_at, to_scene, turn_to_scene
from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.layout import NO_FACE, NO_SLOT, ModelArrays
from proximity.kernels.pair.boxes import frames_between
from proximity.kernels.pair.connection import BOTH, connect, corner_of, read_both
from proximity.kernels.pair.meeting import common_line, meeting_reach
from proximity.kernels.pair.triangles import CROSSING, between
from proximity.kernels.pair.walk import nearest_of_parts, rounding_size
from proximity.kernels.stack_arrays import stack_f64, stack_i64
from proximity.native import entry, inlined, kernel
from proximity.native.simd import load_int

ANSWER_SIZE = 12
"""A lower bound of the distance, and the distance, m; a point on each part, m, scene's frame; the faces; the
relation of the parts; 1 where one part may be inside the other, because boxes overlap and nothing crosses."""
ANSWER_LOWER = 0
ANSWER_DISTANCE = 1
ANSWER_POINTS = 2
ANSWER_FACES = 8
ANSWER_RELATION = 10
ANSWER_MAY_BE_INSIDE = 11


@entry(ModelArrays, "int, int, float, float, int, float64[:]")
def connect_parts(model, first, second, limit, tolerance, budget, answer):
    """Fill the shortest connection of two parts, (`ANSWER_SIZE`,): 0 long where they cross.

    Only connections shorter than *limit*, m, are looked for, and none that is shorter by less than a share of
    *tolerance*. *budget*: opened nodes and blocks at most; 0: as many as it takes. What is not found is inf
    long, between nan and `NO_FACE`.
    """
    # In this order whoever asks first: so both ways the answer is the same.
    is_crossing = _shortest(model, min(first, second), max(first, second), limit, tolerance, budget, answer)
    if first > second:
        for k in range(3):
            one, other = ANSWER_POINTS + k, ANSWER_POINTS + 3 + k
            answer[one], answer[other] = answer[other], answer[one]
        one, other = ANSWER_FACES, ANSWER_FACES + 1
        answer[one], answer[other] = answer[other], answer[one]
    # In this order a distance that is nan is none.
    is_touching = answer[ANSWER_DISTANCE] <= rounding_at(model.frames, *_point(answer))
    answer[ANSWER_RELATION] = CROSSES if is_crossing else (TOUCHES if is_touching else APART)
    is_overlapping = _overlap(model.frames[first], model.frames[second])
    answer[ANSWER_MAY_BE_INSIDE] = 1.0 if is_overlapping and not is_crossing else 0.0


@inlined
def _point(answer):
    """The end on the first part."""
    return answer[ANSWER_POINTS], answer[ANSWER_POINTS + 1], answer[ANSWER_POINTS + 2]


@inlined
def _overlap(one, other):
    """Whether the boxes of two parts overlap."""
    overlap = True
    for k in range(3):
        overlap = (
            overlap and one.box_lower[k] <= other.box_upper[k] and other.box_lower[k] <= one.box_upper[k]
        )
    return overlap


@kernel
def _shortest(model, first, second, limit, tolerance, budget, answer):
    """Fill distance, ends and faces of an answer; whether the parts cross."""
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
        answer[ANSWER_LOWER], answer[ANSWER_DISTANCE] = min(sqrt(lower_sq) / scale, limit), np.inf
        for k in range(6):
            answer[ANSWER_POINTS + k] = np.nan
        answer[ANSWER_FACES] = answer[ANSWER_FACES + 1] = NO_FACE
        return False
    distance = fill_connection(model, first, second, best == CROSSING, slots, answer, ANSWER_POINTS)
    # Where all was looked into, the bound is the distance but for its rounding.
    is_exact = best == CROSSING or (tolerance == 0.0 and lower_sq >= best > 0.0)
    answer[ANSWER_LOWER] = distance if is_exact else min(sqrt(lower_sq) / scale, distance)
    answer[ANSWER_DISTANCE] = distance
    answer[ANSWER_FACES] = load_int(words, parts[first].slot_faces + slots[0])
    answer[ANSWER_FACES + 1] = load_int(words, parts[second].slot_faces + slots[1])
    return best == CROSSING


@kernel
def fill_connection(model, first, second, is_crossing, slots, answer, at):
    """Write the ends, scene's frame, of the shortest connection of two triangles; return its length, m."""
    turn, offset = stack_f64(9), stack_f64(3)
    frames_between(model.frames, first, second, turn, offset)
    return fill_ends(model, first, second, (turn, offset), is_crossing, slots, answer, at)


@kernel
def fill_ends(model, first, second, frame_map, is_crossing, slots, answer, at):
    """As `fill_connection`, with the second part where *frame_map* takes it."""
    reals, _, frames, parts = model
    corners, ends = stack_f64(BOTH), stack_f64(6)
    read_both(reals, slots, frame_map[0], frame_map[1], corners)
    apart_sq = connect(corners, ends)
    if is_crossing:
        common_line(corners, meeting_reach(rounding_size(frames, first, second, frame_map[1])), ends)
        ends[3], ends[4], ends[5], apart_sq = ends[0], ends[1], ends[2], 0.0
    to_scene(frames, parts, first, ends, 0, answer, at)
    to_scene(frames, parts, first, ends, 3, answer, at + 3)
    return sqrt(apart_sq) / frames[first].scale


@kernel
def turn_normal(model, first, frame_map, slots, normal):
    """Set the direction, scene's frame, by which the first part moves away where two triangles touch.

    It is normal to that one of them beyond which the other is. *frame_map*: from the second part's frame.
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
