"""Segment queries of a whole scene: the shortest connection between a segment and the surfaces.

A segment without length is processed as a point.
"""

import numpy as np

from proximity.kernels.answers import (
    SEGMENT_ANSWER_BARYCENTRIC,
    SEGMENT_ANSWER_DISTANCE,
    SEGMENT_ANSWER_FACE,
    SEGMENT_ANSWER_FRACTION,
    SEGMENT_ANSWER_PART,
    SEGMENT_ANSWER_POINT_ON_SEGMENT,
    SEGMENT_ANSWER_POINT_ON_SOLID,
    SEGMENT_ANSWER_REALS,
)
from proximity.kernels.geometry.closest_feature import (
    closest_on_triangle,
    read_corners,
)
from proximity.kernels.geometry.frames import can_be_asked, to_local, to_scene
from proximity.kernels.layout import NO_FACE, NO_PART, NO_ROW, NO_SLOT, STACKS_SIZE, ModelArrays
from proximity.kernels.point.walk import NOTHING_SEEN, nearest_in_scene
from proximity.kernels.scene.queries.point_queries import limit_of, reach_sq
from proximity.kernels.segment.plan import stack_plans, stack_probes
from proximity.kernels.segment.triangle import (
    segment_on_triangle,
    stack_witness,
)
from proximity.kernels.segment.walk import plan_in_part, segment_in_scene
from proximity.kernels.stack_arrays import stack_f32, stack_f64
from proximity.native import ROWS_WITH_GIL, entry, inlined, kernel
from proximity.native.simd import load_int


@inlined
def _write_nothing(answer, choice, distance):
    for column in range(SEGMENT_ANSWER_REALS):
        answer[column] = np.nan
    answer[SEGMENT_ANSWER_DISTANCE] = distance
    choice[SEGMENT_ANSWER_PART] = NO_PART
    choice[SEGMENT_ANSWER_FACE] = NO_FACE


@kernel
def _fill_witness(reals, frames, parts, part, slot, found_sq, segment, plan, probe, witness):
    """Fill a segment's witness for the triangle found, with the accurate formulas."""
    read_corners(reals, slot, witness)
    plan_in_part(frames, parts, part, segment, plan, probe)
    segment_on_triangle(plan, witness)
    # Both formulas round differently: a contact found by the traversal stays a contact.
    if found_sq == 0.0:
        witness.gap = 0.0


@kernel
def _fill_point_witness(reals, frames, parts, part, slot, segment, plan, witness):
    """Fill the witness of a segment without length, bit-identical to the point query."""
    read_corners(reals, slot, witness)
    px, py, pz = to_local(frames, parts, part, segment[0], segment[1], segment[2])
    closest_on_triangle(px, py, pz, witness)
    witness.gap, witness.fraction, plan.low, plan.high = witness.length, 0.0, 0.0, 1.0
    for k in range(3):
        witness.on_solid[k], witness.solid_weights[k] = witness.point[k], witness.weights[k]


@kernel
def _write_answer(reals, words, frames, parts, part, slot, segment, plan, witness, limit, answer, choice):
    """Write a witness, transformed from the part's local frame to the scene's."""
    distance = witness.gap / frames[part].scale
    if not distance <= limit:
        _write_nothing(answer, choice, np.inf)
        return
    fraction = plan.low + witness.fraction * (plan.high - plan.low)
    answer[SEGMENT_ANSWER_DISTANCE], answer[SEGMENT_ANSWER_FRACTION] = distance, fraction
    to_scene(frames, parts, part, witness.on_solid, 0, answer, SEGMENT_ANSWER_POINT_ON_SOLID)
    if fraction == 0.0 or fraction == 1.0:
        end = 0 if fraction == 0.0 else 3
        for axis in range(3):
            answer[SEGMENT_ANSWER_POINT_ON_SEGMENT + axis] = segment[end + axis]
    else:
        to_scene(frames, parts, part, witness.on_segment, 0, answer, SEGMENT_ANSWER_POINT_ON_SEGMENT)
    for k in range(3):
        answer[SEGMENT_ANSWER_BARYCENTRIC + k] = witness.solid_weights[k]
    choice[SEGMENT_ANSWER_PART] = part
    choice[SEGMENT_ANSWER_FACE] = load_int(words, parts[part].slot_faces + slot)


@entry(
    ModelArrays,
    "float64[:, 3], float64[:, 3], int64[:], float64[:], float64[:, :] -> int",
    rows_with_gil=ROWS_WITH_GIL,
)
def segment_batch(model, starts, ends, order, limits, answers):
    """Fill answers (N, `SEGMENT_ANSWER_WIDTH`) for segments (N, 3) to (N, 3), columns as in `answers`.

    *order*: the processing order of the rows, or empty. *limits*, m, (1,) or (N,): maximum distance. A row
    that is not finite, or with an end beyond the range of coordinates, gives nan. Returns `NO_ROW`.
    """
    reals, words, frames, parts = model
    choices = answers.view(np.int32)
    stacks = stack_f32(STACKS_SIZE)
    plans, probes, witness = stack_plans(2), stack_probes(2), stack_witness(1)[0]
    segment = stack_f64(6)
    scale = frames[len(parts) - 1].scale
    known_slot = np.int64(NO_SLOT)
    for i in range(len(order) if len(order) else len(starts)):
        row = order[i] if len(order) else i
        limit = limit_of(limits, row)
        limit_sq = reach_sq(limit * scale)
        has_length = False
        for axis in range(3):
            segment[axis], segment[3 + axis] = starts[row, axis], ends[row, axis]
            has_length = has_length or segment[axis] != segment[3 + axis]
        if not (
            can_be_asked(frames, parts, segment[0], segment[1], segment[2])
            and can_be_asked(frames, parts, segment[3], segment[4], segment[5])
        ):
            _write_nothing(answers[row], choices[row], np.nan)
            continue
        plan, probe = plans[0], probes[0]
        if has_length:
            found_sq, part, slot = segment_in_scene(
                model, segment, limit_sq, known_slot, plans, probes, witness, stacks
            )
        else:
            start = segment[0], segment[1], segment[2]
            _, part, slot = nearest_in_scene(
                model, start, limit_sq, np.int64(NO_PART), np.int64(NO_SLOT), NOTHING_SEEN, stacks
            )
        if slot < 0:
            _write_nothing(answers[row], choices[row], np.inf)
            continue
        known_slot = slot
        if has_length:
            _fill_witness(reals, frames, parts, part, slot, found_sq, segment, plan, probe, witness)
        else:
            _fill_point_witness(reals, frames, parts, part, slot, segment, plan, witness)
        _write_answer(
            reals, words, frames, parts, part, slot, segment, plan, witness, limit, answers[row], choices[row]
        )
    return NO_ROW
