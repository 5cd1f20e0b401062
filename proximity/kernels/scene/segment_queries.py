"""Segment queries against a whole scene: the shortest connection between a segment and the surfaces.

As `nearest_part` does for points: the scene's tree first, parts' trees below it, squared distances compared
in the scene's scaled frame. A segment without length is a point, and is answered as a point.
"""

import numpy as np

from proximity.kernels.geometry.closest_feature import (
    CLOSEST_LENGTH,
    CLOSEST_POINT,
    CLOSEST_WEIGHT,
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
    ENTRY,
    FRAME_SCALE,
    LANES,
    NO_FACE,
    NO_PART,
    NO_ROW,
    NO_SLOT,
    NODE_STRIDE,
    PART_IS_FUSED,
    PART_ROOT,
    PART_SLOT_FACES,
    SCENE_ENTRIES,
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
from proximity.kernels.segment.plan import (
    PLAN_HIGH,
    PLAN_IS_FAR,
    PLAN_LOW,
    PLAN_PART,
    PLAN_SIZE,
    PROBE_SIZE,
    make_plan,
)
from proximity.kernels.segment.triangle import (
    WITNESS_FRACTION,
    WITNESS_GAP,
    WITNESS_ON_SEGMENT,
    WITNESS_ON_SOLID,
    WITNESS_SIZE,
    WITNESS_WEIGHT,
    segment_on_triangle,
)
from proximity.kernels.segment.walk import segment_in_block, segment_in_part
from proximity.kernels.stack_arrays import real_rows_here, reals_here, word_rows_here, words_here
from proximity.kernels.tree.traversal import NOTHING_WAITS, descend, next_open
from proximity.native import HANDFUL, entry, inlined, kernel
from proximity.native.simd import (
    bits,
    load_int,
    splat32,
)

# columns of the answers: float64
SEGMENT_ANSWER_DISTANCE = 0
SEGMENT_ANSWER_POINT_ON_SEGMENT = 1
SEGMENT_ANSWER_POINT_ON_SOLID = 4
SEGMENT_ANSWER_FRACTION = 7
SEGMENT_ANSWER_BARYCENTRIC = 8
SEGMENT_ANSWER_REALS = 11
# and int32, behind them
SEGMENT_ANSWER_PART = 2 * SEGMENT_ANSWER_REALS
SEGMENT_ANSWER_FACE = SEGMENT_ANSWER_PART + 1
SEGMENT_ANSWER_WIDTH = SEGMENT_ANSWER_REALS + 1
"""float64 that a row takes in all."""


@kernel
def plan_in_part(frames, parts, part, segment, plan, probe):
    """Make the plan of a segment (six coordinates, scene's frame) in the local frame of *part*, once."""
    if plan[PLAN_PART] == part:
        return
    sx, sy, sz = to_local(frames, parts, part, segment[0], segment[1], segment[2])
    ex, ey, ez = to_local(frames, parts, part, segment[3], segment[4], segment[5])
    make_plan(plan, probe, sx, sy, sz, ex, ey, ez)
    plan[PLAN_PART] = part


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
    scene_scale = frames[scene, FRAME_SCALE]
    plan, probe, scene_plan, scene_probe = plans[0], probes[0], plans[1], probes[1]
    plan[PLAN_PART] = scene_plan[PLAN_PART] = NO_PART
    best_fraction, best_slot = np.inf, np.int64(NO_SLOT)
    found_part = np.int64(0)
    if known_slot >= 0:
        found_part = part_of_slot(words, parts, known_slot)
        plan_in_part(frames, parts, found_part, segment, plan, probe)
        ratio_sq = (frames[found_part, FRAME_SCALE] / scene_scale) ** 2
        best_sq, best_fraction, best_slot = segment_in_block(
            reals, known_slot // LANES, plan, best_sq * ratio_sq, best_fraction, best_slot, witness
        )
        best_sq /= ratio_sq
    if is_alone(parts):
        plan_in_part(frames, parts, found_part, segment, plan, probe)
        best_sq, _, best_slot = segment_in_part(
            reals,
            words,
            parts[0, PART_ROOT],
            plan,
            probe,
            best_sq,
            best_fraction,
            best_slot,
            witness,
            stacks,
            0,
        )
        return best_sq, found_part, best_slot

    plan_in_part(frames, parts, scene, segment, scene_plan, scene_probe)
    is_far = scene_plan[PLAN_IS_FAR] != 0.0
    entries = parts[scene, SCENE_ENTRIES]
    best32 = open_bound(scene_plan, best_sq, best_fraction)
    bottom = 2 * STACK_SIZE
    at = bottom
    reference = parts[scene, PART_ROOT]
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
            if parts[part, PART_IS_FUSED]:
                reference = start
                continue
            plan_in_part(frames, parts, part, segment, plan, probe)
            ratio_sq = (frames[part, FRAME_SCALE] / scene_scale) ** 2
            best_sq, best_fraction, best_slot = segment_in_part(
                reals, words, start, plan, probe, best_sq * ratio_sq, best_fraction, best_slot, witness,
                stacks, 0,
            )  # fmt: skip
            best_sq /= ratio_sq
        best32 = open_bound(scene_plan, best_sq, best_fraction)
        at = next_open(stacks, bottom, at, best32)
        if at == NOTHING_WAITS:
            if best_slot >= 0:
                found_part = part_of_slot(words, parts, best_slot)
            return best_sq, found_part, best_slot
        reference = load_int(stacks, at + STACK_SIZE)


@inlined
def _write_nothing(answer, choice, distance):
    for column in range(SEGMENT_ANSWER_REALS):
        answer[column] = np.nan
    answer[SEGMENT_ANSWER_DISTANCE] = distance
    choice[SEGMENT_ANSWER_PART] = NO_PART
    choice[SEGMENT_ANSWER_FACE] = NO_FACE


@kernel
def _fill_witness(reals, frames, parts, part, slot, found_sq, segment, plan, probe, witness):
    """The careful answer for the triangle found, in the columns of a segment's witness."""
    read_corners(reals, slot, witness)
    plan_in_part(frames, parts, part, segment, plan, probe)
    segment_on_triangle(plan, witness)
    # A touch is a touch: where both formulas round differently, the walk's word counts.
    if found_sq == 0.0:
        witness[WITNESS_GAP] = 0.0


@kernel
def _fill_point_witness(reals, frames, parts, part, slot, segment, plan, witness):
    """The same for a segment without length: to the bit what the point query answers."""
    read_corners(reals, slot, witness)
    px, py, pz = to_local(frames, parts, part, segment[0], segment[1], segment[2])
    closest_on_triangle(px, py, pz, witness)
    witness[WITNESS_GAP], witness[WITNESS_FRACTION], plan[PLAN_LOW], plan[PLAN_HIGH] = (
        witness[CLOSEST_LENGTH],
        0.0,
        0.0,
        1.0,
    )
    for k in range(3):
        witness[WITNESS_ON_SOLID + k], witness[WITNESS_WEIGHT + k] = (
            witness[CLOSEST_POINT + k],
            witness[CLOSEST_WEIGHT + k],
        )


@kernel
def _write_answer(reals, words, frames, parts, part, slot, segment, plan, witness, limit, answer, choice):
    """Take a witness from the part's local frame to the scene's."""
    distance = witness[WITNESS_GAP] / frames[part, FRAME_SCALE]
    if not distance <= limit:
        _write_nothing(answer, choice, np.inf)
        return
    fraction = plan[PLAN_LOW] + witness[WITNESS_FRACTION] * (plan[PLAN_HIGH] - plan[PLAN_LOW])
    answer[SEGMENT_ANSWER_DISTANCE], answer[SEGMENT_ANSWER_FRACTION] = distance, fraction
    to_scene(frames, parts, part, witness, WITNESS_ON_SOLID, answer, SEGMENT_ANSWER_POINT_ON_SOLID)
    if fraction == 0.0 or fraction == 1.0:
        end = 0 if fraction == 0.0 else 3
        for axis in range(3):
            answer[SEGMENT_ANSWER_POINT_ON_SEGMENT + axis] = segment[end + axis]
    else:
        to_scene(frames, parts, part, witness, WITNESS_ON_SEGMENT, answer, SEGMENT_ANSWER_POINT_ON_SEGMENT)
    for k in range(3):
        answer[SEGMENT_ANSWER_BARYCENTRIC + k] = witness[WITNESS_WEIGHT + k]
    choice[SEGMENT_ANSWER_PART] = part
    choice[SEGMENT_ANSWER_FACE] = load_int(words, parts[part, PART_SLOT_FACES] + slot)


@entry(
    ModelArrays,
    "float64[:, 3], float64[:, 3], int64[:], float64[:], float64[:, :] -> int",
    handful=HANDFUL,
)
def segment_batch(model, starts, ends, order, limits, answers):
    """Fill answers (N, `SEGMENT_ANSWER_WIDTH`) for segments (N, 3) to (N, 3); see the columns above.

    *order*: the rows in the order to take them in, or empty. *limits*, m, (1,) or (N,): nothing farther is
    looked for. A row that is not finite, or with an end too far off to be computed with, answers nan.
    Returns `NO_ROW`.
    """
    reals, words, frames, parts = model
    choices = answers.view(np.int32)
    stacks = words_here(STACKS_SIZE)
    plans, probes = real_rows_here(2, PLAN_SIZE), word_rows_here(2, PROBE_SIZE)
    witness = reals_here(WITNESS_SIZE)
    plans[:], probes[:], witness[:] = 0.0, 0.0, 0.0
    segment = reals_here(6)
    scale = frames[len(parts) - 1, FRAME_SCALE]
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
    return NO_ROW
