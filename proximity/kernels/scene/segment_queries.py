"""Segment queries against a whole scene: the shortest connection between a segment and the surfaces.

As `query` does for points: the scene's tree first, parts' trees below it, squared distances compared in the
scene's scaled frame. A segment without length is a point, and takes the way of points.
"""

import numpy as np

from proximity.kernels.geometry.closest_feature import (
    LENGTH,
    POINT,
    WEIGHT,
    closest_on_triangle,
    read_corners,
)
from proximity.kernels.geometry.frames import (
    can_be_asked,
    is_alone,
    part_of_slot,
    to_local,
    to_scene,
)
from proximity.kernels.geometry.rows import limit_of
from proximity.kernels.layout import (
    ANSWERED,
    ENTRY,
    FACES,
    IS_FUSED,
    LANES,
    NO_FACE,
    NO_PART,
    NO_SLOT,
    NODE_STRIDE,
    ROOT,
    SCALE,
    SLOT_FACES,
    STACK_SIZE,
    STACKS_SIZE,
)
from proximity.kernels.model_arrays import ModelArrays
from proximity.kernels.point.walk import NOTHING_SEEN
from proximity.kernels.scene.nearest_part import (
    nearest_in_scene,
)
from proximity.kernels.scene.point_chunk import reach_sq
from proximity.kernels.segment.box import node_bounds_sq, open_bound
from proximity.kernels.segment.plan import HIGH, IS_FAR, LOW, PLAN_SIZE, PROBE_SIZE, make_plan
from proximity.kernels.segment.plan import PART as PLANNED_PART
from proximity.kernels.segment.triangle import (
    FRACTION,
    GAP,
    ON_SEGMENT,
    ON_SOLID,
    SEGMENT_WITNESS_SIZE,
    SHARE,
    segment_on_triangle,
)
from proximity.kernels.segment.walk import segment_in_block, segment_in_part
from proximity.kernels.stack_arrays import real_rows_here, reals_here, word_rows_here, words_here
from proximity.kernels.tree.traversal import NOTHING_WAITS, descend, next_open
from proximity.native import HANDFUL, entry, inlined, kernel
from proximity.simd import (
    bits,
    load_int,
    splat32,
)

# columns of the answers: float64
DISTANCE = 0
POINT_ON_SEGMENT = 1
POINT_ON_SOLID = 4
FRACTION_AT = 7
BARYCENTRIC = 8
ANSWER_REALS = 11
# and int32, behind them
PART = 2 * ANSWER_REALS
FACE = PART + 1
ANSWER_WIDTH = ANSWER_REALS + 1
"""float64 that a row takes in all."""


@kernel
def plan_in_part(frames, parts, part, segment, plan, probe):
    """Make the plan of a segment (six coordinates, scene's frame) in the local frame of *part*, once."""
    if plan[PLANNED_PART] == part:
        return
    sx, sy, sz = to_local(frames, parts, part, segment[0], segment[1], segment[2])
    ex, ey, ez = to_local(frames, parts, part, segment[3], segment[4], segment[5])
    make_plan(plan, probe, sx, sy, sz, ex, ey, ez)
    plan[PLANNED_PART] = part


@kernel
def segment_in_scene(
    reals, words, frames, parts, segment, best_sq, known_slot, plans, probes, witness, stacks
):
    """Squared distance (scene's scaled frame), part and slot of the surface nearest to a segment.

    *best_sq* is the limit. *known_slot*, or `NO_SLOT`: a triangle that may be near; it changes the cost, not
    the answer. Ties go to the lower part, then to the lower slot; of crossings the first along the segment
    counts. Scratch: *plans* (2, `PLAN_SIZE`), of which the first is left as the plan of some part, *probes*
    (2, `PROBE_SIZE`), *witness*, *stacks*.

    Parts in the scene's own frame are walked as if they were one tree; the others by a walk of their own.
    """
    scene = len(parts) - 1
    scene_scale = frames[scene, SCALE]
    plan, probe, scene_plan, scene_probe = plans[0], probes[0], plans[1], probes[1]
    plan[PLANNED_PART] = scene_plan[PLANNED_PART] = NO_PART
    best_fraction, best_slot = np.inf, np.int64(NO_SLOT)
    here = np.int64(0)
    if known_slot >= 0:
        here = part_of_slot(words, parts, known_slot)
        plan_in_part(frames, parts, here, segment, plan, probe)
        ratio_sq = (frames[here, SCALE] / scene_scale) ** 2
        best_sq, best_fraction, best_slot = segment_in_block(
            reals, known_slot // LANES, plan, best_sq * ratio_sq, best_fraction, best_slot, witness
        )
        best_sq /= ratio_sq
    if is_alone(parts):
        plan_in_part(frames, parts, here, segment, plan, probe)
        best_sq, _, best_slot = segment_in_part(
            reals, words, parts[0, ROOT], plan, probe, best_sq, best_fraction, best_slot, witness, stacks, 0
        )
        return best_sq, here, best_slot

    plan_in_part(frames, parts, scene, segment, scene_plan, scene_probe)
    is_far = scene_plan[IS_FAR] != 0.0
    entries = parts[scene, FACES]
    best32 = open_bound(scene_plan, best_sq, best_fraction)
    bottom = 2 * STACK_SIZE
    at = bottom
    reference = parts[scene, ROOT]
    while True:
        if reference >= 0:
            base = NODE_STRIDE * reference
            bounds = node_bounds_sq(words, base, scene_plan, scene_probe, is_far)
            is_open = bounds <= splat32(best32)
            if bits(is_open):
                reference, at = descend(words, base, bounds, is_open, stacks, at)
                continue
        elif ~reference < ENTRY:
            best_sq, best_fraction, best_slot = segment_in_block(
                reals, ~reference, scene_plan, best_sq, best_fraction, best_slot, witness
            )
        else:
            entry = entries + 2 * (~reference - ENTRY)
            part, start = load_int(words, entry), load_int(words, entry + 1)
            if parts[part, IS_FUSED]:
                reference = start
                continue
            plan_in_part(frames, parts, part, segment, plan, probe)
            ratio_sq = (frames[part, SCALE] / scene_scale) ** 2
            best_sq, best_fraction, best_slot = segment_in_part(
                reals,
                words,
                start,
                plan,
                probe,
                best_sq * ratio_sq,
                best_fraction,
                best_slot,
                witness,
                stacks,
                0,
            )
            best_sq /= ratio_sq
        best32 = open_bound(scene_plan, best_sq, best_fraction)
        at = next_open(stacks, bottom, at, best32)
        if at == NOTHING_WAITS:
            if best_slot >= 0:
                here = part_of_slot(words, parts, best_slot)
            return best_sq, here, best_slot
        reference = load_int(stacks, at + STACK_SIZE)


@inlined
def _write_nothing(answer, choice, distance):
    for column in range(ANSWER_REALS):
        answer[column] = np.nan
    answer[DISTANCE] = distance
    choice[PART] = NO_PART
    choice[FACE] = NO_FACE


@kernel
def _fill_witness(reals, frames, parts, part, slot, found_sq, segment, plan, probe, witness):
    """The careful answer for the triangle found, in the columns of a segment's witness."""
    read_corners(reals, slot, witness)
    plan_in_part(frames, parts, part, segment, plan, probe)
    segment_on_triangle(plan, witness)
    # A touch is a touch: where both formulas round differently, the walk's word counts.
    if found_sq == 0.0:
        witness[GAP] = 0.0


@kernel
def _fill_point_witness(reals, frames, parts, part, slot, segment, plan, witness):
    """The same for a segment without length: to the bit what the point query answers."""
    read_corners(reals, slot, witness)
    px, py, pz = to_local(frames, parts, part, segment[0], segment[1], segment[2])
    closest_on_triangle(px, py, pz, witness)
    witness[GAP], witness[FRACTION], plan[LOW], plan[HIGH] = witness[LENGTH], 0.0, 0.0, 1.0
    for k in range(3):
        witness[ON_SOLID + k], witness[SHARE + k] = witness[POINT + k], witness[WEIGHT + k]


@kernel
def _write_answer(reals, words, frames, parts, part, slot, segment, plan, witness, limit, answer, choice):
    """Take a witness from the part's local frame to the scene's."""
    distance = witness[GAP] / frames[part, SCALE]
    if not distance <= limit:
        _write_nothing(answer, choice, np.inf)
        return
    fraction = plan[LOW] + witness[FRACTION] * (plan[HIGH] - plan[LOW])
    answer[DISTANCE], answer[FRACTION_AT] = distance, fraction
    to_scene(frames, parts, part, witness, ON_SOLID, answer, POINT_ON_SOLID)
    if fraction == 0.0 or fraction == 1.0:
        end = 0 if fraction == 0.0 else 3
        for axis in range(3):
            answer[POINT_ON_SEGMENT + axis] = segment[end + axis]
    else:
        to_scene(frames, parts, part, witness, ON_SEGMENT, answer, POINT_ON_SEGMENT)
    for k in range(3):
        answer[BARYCENTRIC + k] = witness[SHARE + k]
    choice[PART] = part
    choice[FACE] = load_int(words, parts[part, SLOT_FACES] + slot)


@entry(
    ModelArrays,
    "float64[:, 3], float64[:, 3], int64[:], float64[:], float64[:, :] -> int",
    handful=HANDFUL,
)
def segment_batch(model, starts, ends, order, limits, answers):
    """Fill answers (N, `ANSWER_WIDTH`) for segments (N, 3) to (N, 3); see the columns above.

    *order*: the rows in the order to take them in, or empty. *limits*, m, (1,) or (N,): nothing farther is
    looked for. A row that is not finite, or with an end too far off to be computed with, answers nan.
    Returns `ANSWERED`.
    """
    reals, words, frames, parts = model
    choices = answers.view(np.int32)
    stacks = words_here(STACKS_SIZE)
    plans, probes = real_rows_here(2, PLAN_SIZE), word_rows_here(2, PROBE_SIZE)
    witness = reals_here(SEGMENT_WITNESS_SIZE)
    plans[:], probes[:], witness[:] = 0.0, 0.0, 0.0
    segment = reals_here(6)
    scale = frames[len(parts) - 1, SCALE]
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
                reals, words, frames, parts, segment, limit_sq, known_slot, plans, probes, witness, stacks
            )
        else:
            _, part, slot = nearest_in_scene(
                reals, words, frames, parts, segment[0], segment[1], segment[2], limit_sq,
                np.int64(NO_PART), np.int64(NO_SLOT), NOTHING_SEEN, stacks,
            )  # fmt: skip
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
    return ANSWERED
