"""One tick: every finger against every part.

All positions are taken in, then all distances are found, then all predictions made: the code of each is more
than the nearest cache holds, and a skin's tick takes 3 to 5 % less than with one finger after the other.
"""

from math import isfinite

import numpy as np

from proximity.kernels.contact_columns import (
    FORCE_VALID_BIT,
    JUMPED,
    MODE_BIT,
    MODE_FORCE,
    MODE_HOLD,
    MODE_POSITION,
    MODE_RETRACT,
    PART_CHANGED,
    PREDICTED,
    RECORD_AGE_NS,
    RECORD_APPROACH_SPEED,
    RECORD_CONTACT_BEND,
    RECORD_DAMPING,
    RECORD_FACE,
    RECORD_FINGER,
    RECORD_FLAGS,
    RECORD_FORCE,
    RECORD_KINDS,
    RECORD_LOWER,
    RECORD_PART,
    RECORD_POSE_NS,
    RECORD_POSITION,
    RECORD_PREDICTED_LOWER,
    RECORD_PREDICTED_NS,
    RECORD_PREDICTED_UPPER,
    RECORD_REALS,
    RECORD_SIGNED_DISTANCE,
    RECORD_STIFFNESS,
    RECORD_TIME_TO_CONTACT,
    RECORD_TIME_TO_CONTACT_LOWER,
    RECORD_UPPER,
    RECORD_VELOCITY,
    RECORD_WORK,
    SURFACE_DEFORMABLE,
    TRACKED,
)
from proximity.kernels.geometry.closest_feature import CLOSEST_SIZE
from proximity.kernels.geometry.frames import can_be_asked, looks_like_millimetres
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NO_FACE, NO_PART
from proximity.kernels.model_arrays import ModelArrays
from proximity.kernels.stack_arrays import real_rows_here, reals_here
from proximity.kernels.tracking.conservative_advancement import Path
from proximity.kernels.tracking.finger_distance import find_distance
from proximity.kernels.tracking.motion import (
    BACKWARDS,
    ESTIMATE_POSE_COUNT,
    ESTIMATE_POSE_NS,
    ESTIMATE_VELOCITY,
    FUTURE,
    TOO_OLD,
    USABLE,
    instant_defect,
    observe,
    observe_with_velocity,
)
from proximity.kernels.tracking.part_drift import Movers, displacement_of_parts, gather_movers
from proximity.kernels.tracking.path_contact import predict_contact_on_path
from proximity.kernels.tracking.prediction import (
    predict_distance,
    predict_time_to_contact,
    relative_motion,
)
from proximity.kernels.tracking.track import (
    MOST_DISPLACEMENT,
    MOST_NS,
    SETTING_ADAPTIVE_TOLERANCE,
    SETTING_AHEAD_NS,
    SETTING_ANY_STANDS,
    SETTING_BUDGET,
    SETTING_DISPLACEMENT,
    SETTING_FIRST_FINGER,
    SETTING_HAS_PATHS,
    SETTING_HAS_VELOCITIES,
    SETTING_LATENCY,
    SETTING_MAX_ACCELERATION,
    SETTING_MAX_SPEED,
    SETTING_MOVER_COUNT,
    SETTING_OTHER_CLOCK_NS,
    SETTING_PREDICTION_STEPS_LEFT,
    SETTING_STEPS_LEFT,
    TRACK_FRONTIER_COUNT,
    TRACK_REPORTED_PART,
    TRACK_SLOT,
    Scratch,
    TrackerArrays,
    finger_at,
    forget_surfaces,
)
from proximity.native import HANDFUL, entry, inlined
from proximity.native.simd import prefetch

# --- bits of the answer of a tick: it is done, and what its caller should know ---
NOT_DONE = 0
DONE = 1
HAS_DEFECT = 2  # shifted by `FUTURE`, `TOO_OLD`, `BACKWARDS`: poses with such instants
ALL_IN_MILLIMETRES = 32  # all fingers are as far away as points in millimetres

FLAG_BITS = (1 << 16) - 1
"""Bits of an observation's answer that go into the record."""
SHARED_BUDGETS, FEWEST_BUDGETS = 20, 8
PREDICTION_BUDGETS = 4
"""Budgets that all fingers share in a tick: for distances, and for looking ahead. Two hands never come to the
end of them; a skin of thousands would be late. Who finds none left goes by what it knows, within bounds, and
is among the first at the next tick."""
MANY, PRESENCE = 500, 4
"""Steps that each finger beyond so many takes the time of, not searched for: so many fewer are shared."""
LEAST_TOLERANCE, MOST_TOLERANCE = 1e-3, 0.5
TOLERANCE_GROWTH, TOLERANCE_DECAY = 1.1, 0.99
"""In a crowd bounds may be apart by some share of the distance, which grows when no steps are left and fades
when there are: so all are as well known as can be, for how far they are. Turns regardless of that left points
within 20 mm of a skin with bounds 9.5 mm apart (p99; 3.8 with this), with half again as many steps."""


@entry(ModelArrays, TrackerArrays, "float64[:, 3], int64[:], int, bool -> int", handful=HANDFUL)
def tick(model, arrays, positions, pose_ns, now_ns, is_moved):
    """Fill the records of a tracker; `NOT_DONE`, or `DONE` and what should be known about the poses.

    It is not done, and nothing is changed, where *positions* or their instants, which are within `MOST_NS`,
    are not as many as fingers. *is_moved*: whether parts may stand elsewhere than at the tick before.
    """
    settings, count = arrays.settings, len(arrays.marks)
    if len(positions) != count or len(pose_ns) != count:
        return NOT_DONE
    scratch = Scratch(arrays.workspace, reals_here(CLOSEST_SIZE), reals_here(9))
    straight = Path(real_rows_here(2, 3), reals_here(2))
    settings[SETTING_STEPS_LEFT] = steps_for_all(settings[SETTING_BUDGET], count)
    settings[SETTING_PREDICTION_STEPS_LEFT] = PREDICTION_BUDGETS * settings[SETTING_BUDGET]
    if is_moved:
        _follow_parts(model, arrays)
    answer = DONE | _observe_all(model, arrays, positions, pose_ns, now_ns)
    late = min(
        _find_all_distances(model, arrays, is_moved, scratch), _predict_all(model, arrays, straight, scratch)
    )
    settings[SETTING_FIRST_FINGER] = (
        (np.int64(settings[SETTING_FIRST_FINGER]) + late) % count if late < count else 0.0
    )
    settings[SETTING_ADAPTIVE_TOLERANCE] = _tolerance_after(
        settings[SETTING_ADAPTIVE_TOLERANCE], settings[SETTING_STEPS_LEFT]
    )
    return answer | ALL_IN_MILLIMETRES if _all_in_millimetres(model.frames, arrays) else answer


@inlined
def steps_for_all(budget, count):
    """Steps that so many fingers share in a tick for their distances."""
    return max(SHARED_BUDGETS * budget - PRESENCE * max(count - MANY, 0), FEWEST_BUDGETS * budget)


@inlined
def _tolerance_after(adaptive_tolerance, steps_left):
    """The share by which bounds may be apart at the next tick."""
    if steps_left <= 0.0:
        return min(max(adaptive_tolerance, LEAST_TOLERANCE) * TOLERANCE_GROWTH, MOST_TOLERANCE)
    return adaptive_tolerance * TOLERANCE_DECAY if adaptive_tolerance > LEAST_TOLERANCE else 0.0


@inlined
def _follow_parts(model, arrays):
    """Take in that parts have moved: how far at most, and which of them have a velocity."""
    settings = arrays.settings
    for i in range(len(arrays.marks)):
        arrays.marks[i, TRACK_FRONTIER_COUNT] = 0
    displacement = displacement_of_parts(model.frames, arrays.before)
    settings[SETTING_DISPLACEMENT] = (settings[SETTING_DISPLACEMENT] + displacement) * (1.0 + 2.0**-52)
    if not settings[SETTING_DISPLACEMENT] <= MOST_DISPLACEMENT:
        settings[SETTING_DISPLACEMENT] = 0.0
        forget_surfaces(arrays.tracks, arrays.balls)
    settings[SETTING_MOVER_COUNT], settings[SETTING_ANY_STANDS] = gather_movers(
        model.frames, model.parts, arrays.movers
    )


@inlined
def _observe_all(model, arrays, positions, pose_ns, now_ns):
    """Clear all records, and write where each finger is, how fast it moves, and whether it is tracked.

    Returns `HAS_DEFECT`, shifted by each defect that instants have. A pose of another clock is not used, and
    one before the last is a jump; one that is ahead by less is predicted for its own instant.
    """
    settings, wide, found = arrays.settings, arrays.wide, 0
    apart_ns, ahead_ns = np.int64(settings[SETTING_OTHER_CLOCK_NS]), np.int64(settings[SETTING_AHEAD_NS])
    acts_ns = now_ns + np.int64(1e9 * settings[SETTING_LATENCY])
    for i in range(len(positions)):
        finger = finger_at(arrays, i)
        # First of all: somebody may give positions that the last tick has written.
        x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
        _clear_record(finger, i)
        taken_ns = pose_ns[i]
        wide[i, RECORD_POSE_NS], wide[i, RECORD_AGE_NS] = taken_ns, now_ns - max(taken_ns, 1 - MOST_NS)
        wide[i, RECORD_PREDICTED_NS] = max(acts_ns, taken_ns)
        record = finger.record
        record[RECORD_POSITION], record[RECORD_POSITION + 1], record[RECORD_POSITION + 2] = x, y, z
        motion_marks = arrays.motion_marks
        is_seen = motion_marks[i, ESTIMATE_POSE_COUNT] > 0
        last_ns = motion_marks[i, ESTIMATE_POSE_NS] if is_seen else taken_ns
        defect = instant_defect(taken_ns, last_ns, now_ns - apart_ns, now_ns + apart_ns)
        is_used, flags = defect != FUTURE and defect != TOO_OLD, 0
        if is_used:
            flags = _observe(arrays, i, taken_ns, x, y, z) & FLAG_BITS
            if defect == BACKWARDS and flags & TRACKED:
                flags |= JUMPED
            if defect == USABLE and taken_ns > now_ns + ahead_ns:
                defect = FUTURE
        if defect != USABLE and isfinite(x):
            found |= HAS_DEFECT << defect
        if flags & TRACKED and can_be_asked(model.frames, model.parts, x, y, z):
            for axis in range(3):
                record[RECORD_VELOCITY + axis] = arrays.motions[i, ESTIMATE_VELOCITY + axis]
        else:
            flags &= ~(TRACKED | PREDICTED)
            finger.numbers[RECORD_KINDS] = MODE_HOLD << MODE_BIT
            finger.marks[TRACK_REPORTED_PART] = NO_PART
        finger.numbers[RECORD_FLAGS] = flags
    return found


@inlined
def _all_in_millimetres(frames, arrays):
    """Whether fingers are tracked, and all of them are as far from all parts as points in millimetres."""
    has_any = False
    for i in range(len(arrays.marks)):
        if arrays.numbers[i, RECORD_FLAGS] & TRACKED:
            has_any = looks_like_millimetres(frames, arrays.records[i, RECORD_LOWER])
            if not has_any:
                return False
    return has_any


@inlined
def _clear_record(finger, i):
    """Have the record of finger *i* say that nothing is known."""
    record, numbers = finger.record, finger.numbers
    for column in range(RECORD_REALS):
        record[column] = np.nan
    record[RECORD_LOWER], record[RECORD_UPPER] = -np.inf, np.inf
    record[RECORD_PREDICTED_LOWER], record[RECORD_PREDICTED_UPPER] = -np.inf, np.inf
    record[RECORD_TIME_TO_CONTACT_LOWER] = 0.0
    record[RECORD_STIFFNESS], record[RECORD_DAMPING], record[RECORD_FORCE] = 0.0, 0.0, 0.0
    numbers[RECORD_FINGER], numbers[RECORD_FLAGS] = i, 0
    numbers[RECORD_PART], numbers[RECORD_FACE], numbers[RECORD_WORK], numbers[RECORD_KINDS] = (
        NO_PART,
        NO_FACE,
        0,
        0,
    )


@inlined
def _observe(arrays, i, pose_ns, x, y, z):
    """Take in the pose of finger *i*, and its velocity where that is given; the bits of `motion.observe`."""
    settings, motions, marks = arrays.settings, arrays.motions, arrays.motion_marks
    if settings[SETTING_HAS_VELOCITIES] == 0.0:
        return observe(
            motions,
            marks,
            i,
            pose_ns,
            x,
            y,
            z,
            settings[SETTING_MAX_SPEED],
            settings[SETTING_MAX_ACCELERATION],
        )
    velocities = arrays.velocities
    return observe_with_velocity(
        motions, marks, i, pose_ns, x, y, z, velocities[i, 0], velocities[i, 1], velocities[i, 2],
        settings[SETTING_MAX_SPEED], settings[SETTING_MAX_ACCELERATION],
    )  # fmt: skip


@inlined
def _find_all_distances(model, arrays, is_moved, scratch):
    """Write the distance of each tracked finger; the turn of the first that found no steps left, if any.

    Turns count from the finger that is first in this tick.
    """
    settings, count = arrays.settings, len(arrays.marks)
    first, late = np.int64(settings[SETTING_FIRST_FINGER]), count
    for turn in range(count):
        i = (first + turn) % count
        _fetch_face(model.reals, arrays.marks, (i + 1) % count)
        if settings[SETTING_STEPS_LEFT] <= 0.0:
            late = min(late, turn)
        finger = finger_at(arrays, i)
        flags = np.int64(finger.numbers[RECORD_FLAGS])
        if not flags & TRACKED:
            continue
        flags |= find_distance(model, arrays, i, is_moved, scratch)
        part, marks = finger.numbers[RECORD_PART], finger.marks
        if marks[TRACK_REPORTED_PART] != part and marks[TRACK_REPORTED_PART] != NO_PART:
            flags |= PART_CHANGED
        marks[TRACK_REPORTED_PART] = part
        finger.numbers[RECORD_FLAGS] = flags
    return late


@inlined
def _fetch_face(reals, marks, i):
    """Have the face that a finger starts from brought from memory, while another finger is done."""
    if marks[i, TRACK_SLOT] >= 0:
        base = BLOCK_STRIDE * (marks[i, TRACK_SLOT] // LANES)
        for line in range(BLOCK_STRIDE // 8):
            prefetch(reals, base + 8 * line)


@inlined
def _predict_all(model, arrays, straight, scratch):
    """Write what each tracked finger will meet, and the advice; returns as `_find_all_distances`.

    *straight*: a path of two corners, to be filled.
    """
    settings, count = arrays.settings, len(arrays.marks)
    first, late = np.int64(settings[SETTING_FIRST_FINGER]), count
    latency_ns = np.int64(1e9 * settings[SETTING_LATENCY])
    movers = Movers(
        arrays.movers, np.int64(settings[SETTING_MOVER_COUNT]), settings[SETTING_ANY_STANDS] != 0.0
    )
    for turn in range(count):
        i = (first + turn) % count
        if settings[SETTING_PREDICTION_STEPS_LEFT] <= 0.0:
            late = min(late, turn)
        finger = finger_at(arrays, i)
        flags = np.int64(finger.numbers[RECORD_FLAGS])
        if not flags & TRACKED:
            continue
        ahead = 1e-9 * (float(arrays.wide[i, RECORD_AGE_NS]) + float(latency_ns))
        motion = relative_motion(model.frames, settings, movers, finger, flags)
        predict_distance(model, settings, finger, arrays.motions, i, motion, ahead, flags, scratch)
        predict_time_to_contact(model, settings, finger, motion, straight, flags, scratch)
        if settings[SETTING_HAS_PATHS] != 0.0 and isfinite(arrays.paths[i, 0, 0]):
            path = Path(arrays.paths[i], arrays.path_lengths)
            flags = predict_contact_on_path(
                model, settings, finger, path, arrays.path_bends, arrays.bends[i], movers, scratch, flags
            )
        finger.numbers[RECORD_FLAGS] = flags
        _advise(finger.record, finger.numbers)
    return late


@inlined
def _advise(record, numbers):
    """Write what the controller is advised to do, and with what force a deformable part answers a touch."""
    is_deformable = numbers[RECORD_KINDS] == SURFACE_DEFORMABLE
    is_touching = record[RECORD_SIGNED_DISTANCE] <= 0.0
    mode = MODE_RETRACT
    if is_touching or record[RECORD_TIME_TO_CONTACT] < np.inf or record[RECORD_CONTACT_BEND] < np.inf:
        mode = MODE_FORCE if is_deformable else MODE_POSITION
    numbers[RECORD_KINDS] |= mode << MODE_BIT
    if is_deformable and is_touching:
        damped = record[RECORD_DAMPING] * record[RECORD_APPROACH_SPEED]
        force = max(0.0, damped - record[RECORD_STIFFNESS] * record[RECORD_SIGNED_DISTANCE])
        if isfinite(force):
            record[RECORD_FORCE] = force
            numbers[RECORD_KINDS] |= 1 << FORCE_VALID_BIT
