"""One tick: every finger against every part.

All positions are taken in, then all distances are found, then all predictions made: the code of each is more
than the nearest cache holds, and a skin's tick takes 3 to 5 % less than with one finger after the other.
"""

from math import isfinite

import numpy as np

from proximity.kernels.contact_columns import (
    AGE_NS,
    APPROACH_SPEED,
    CONTACT_BEND,
    DAMPING,
    FACE,
    FINGER,
    FLAGS,
    FORCE,
    FORCE_VALID_BIT,
    KINDS,
    LOWER,
    MODE_BIT,
    MODE_FORCE,
    MODE_HOLD,
    MODE_POSITION,
    MODE_RETRACT,
    PART,
    PART_CHANGED,
    POSE_NS,
    POSITION,
    PREDICTED,
    PREDICTED_LOWER,
    PREDICTED_NS,
    PREDICTED_UPPER,
    RECORD_REALS,
    SIGNED_DISTANCE,
    STIFFNESS,
    SURFACE_DEFORMABLE,
    TIME_TO_CONTACT,
    TIME_TO_CONTACT_LOWER,
    TRACKED,
    UPPER,
    VELOCITY,
    WORK,
)
from proximity.kernels.geometry.closest_feature import WITNESS_SIZE
from proximity.kernels.geometry.frames import can_be_asked
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NO_FACE, NO_PART
from proximity.kernels.model_arrays import ModelArrays
from proximity.kernels.stack_arrays import real_rows_here, reals_here
from proximity.kernels.tracking.conservative_advancement import Path
from proximity.kernels.tracking.finger_distance import find_distance
from proximity.kernels.tracking.motion import VELOCITY as ESTIMATE
from proximity.kernels.tracking.motion import observe, observe_with_velocity
from proximity.kernels.tracking.part_drift import Movers, displacement_of_parts, gather_movers
from proximity.kernels.tracking.path_contact import predict_contact_on_path
from proximity.kernels.tracking.prediction import (
    predict_distance,
    predict_time_to_contact,
    relative_motion,
)
from proximity.kernels.tracking.track import (
    ADAPTIVE_TOLERANCE,
    AHEAD_LEFT,
    BUDGET,
    EACH_ITS_OWN,
    FARTHEST_WAY,
    FIRST,
    FRONTIER_COUNT,
    HAS_PATHS,
    HAS_VELOCITIES,
    LATENCY,
    MAX_ACCELERATION,
    MAX_SPEED,
    MOST_NS,
    MOVER_COUNT,
    REPORTED_PART,
    SLOT,
    STANDS,
    STEPS_LEFT,
    WAY,
    Scratch,
    TrackerArrays,
    finger_at,
    forget_surfaces,
)
from proximity.native import HANDFUL, entry, inlined
from proximity.simd import prefetch

FLAG_BITS = (1 << 16) - 1
"""Of an observation's answer: what goes into the record."""
SHARED_BUDGETS, FEWEST_BUDGETS = 20, 8
AHEAD = 4
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


@entry(ModelArrays, TrackerArrays, "float64[:, 3], int, int, bool -> bool", handful=HANDFUL)
def tick(model, arrays, positions, all_pose_ns, now_ns, is_moved):
    """Fill the records of a tracker; whether that was done.

    It is not done, and nothing is changed, where *positions* are not as many as fingers, or instants are
    beyond `MOST_NS`. *all_pose_ns*: instant of the positions, or `EACH_ITS_OWN`. *is_moved*: whether parts
    may stand elsewhere than at the tick before.
    """
    settings, count = arrays.settings, len(arrays.marks)
    if len(positions) != count or not -MOST_NS <= now_ns <= MOST_NS:
        return False
    if all_pose_ns != EACH_ITS_OWN and not -MOST_NS <= all_pose_ns <= MOST_NS:
        return False
    scratch = Scratch(arrays.workspace, reals_here(WITNESS_SIZE), reals_here(9))
    straight = Path(real_rows_here(2, 3), reals_here(2))
    settings[STEPS_LEFT] = steps_for_all(settings[BUDGET], count)
    settings[AHEAD_LEFT] = AHEAD * settings[BUDGET]
    if is_moved:
        _follow_parts(model, arrays)
    _observe_all(model, arrays, positions, all_pose_ns, now_ns)
    late = min(
        _find_all_distances(model, arrays, is_moved, scratch), _predict_all(model, arrays, straight, scratch)
    )
    settings[FIRST] = (np.int64(settings[FIRST]) + late) % count if late < count else 0.0
    settings[ADAPTIVE_TOLERANCE] = _tolerance_after(settings[ADAPTIVE_TOLERANCE], settings[STEPS_LEFT])
    return True


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
        arrays.marks[i, FRONTIER_COUNT] = 0
    displacement = displacement_of_parts(model.frames, arrays.before)
    settings[WAY] = (settings[WAY] + displacement) * (1.0 + 2.0**-52)
    if not settings[WAY] <= FARTHEST_WAY:
        settings[WAY] = 0.0
        forget_surfaces(arrays.tracks, arrays.balls)
    settings[MOVER_COUNT], settings[STANDS] = gather_movers(model.frames, model.parts, arrays.movers)


@inlined
def _observe_all(model, arrays, positions, all_pose_ns, now_ns):
    """Clear all records, and write where each finger is, how fast it moves, and whether it is tracked."""
    settings, wide = arrays.settings, arrays.wide
    acts_ns = now_ns + np.int64(1e9 * settings[LATENCY])
    for i in range(len(positions)):
        finger = finger_at(arrays, i)
        # First of all: somebody may give positions that the last tick has written.
        x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
        _clear_record(finger, i)
        taken_ns = arrays.pose_ns[i] if all_pose_ns == EACH_ITS_OWN else np.int64(all_pose_ns)
        wide[i, POSE_NS], wide[i, AGE_NS] = taken_ns, now_ns - max(taken_ns, 1 - MOST_NS)
        wide[i, PREDICTED_NS] = max(acts_ns, taken_ns)
        record = finger.record
        record[POSITION], record[POSITION + 1], record[POSITION + 2] = x, y, z
        flags = _observe(arrays, i, taken_ns, x, y, z) & FLAG_BITS
        if flags & TRACKED and can_be_asked(model.frames, model.parts, x, y, z):
            for axis in range(3):
                record[VELOCITY + axis] = arrays.motions[i, ESTIMATE + axis]
        else:
            flags &= ~(TRACKED | PREDICTED)
            finger.numbers[KINDS] = MODE_HOLD << MODE_BIT
            finger.marks[REPORTED_PART] = NO_PART
        finger.numbers[FLAGS] = flags


@inlined
def _clear_record(finger, i):
    """Have the record of finger *i* say that nothing is known."""
    record, numbers = finger.record, finger.numbers
    for column in range(RECORD_REALS):
        record[column] = np.nan
    record[LOWER], record[UPPER] = -np.inf, np.inf
    record[PREDICTED_LOWER], record[PREDICTED_UPPER] = -np.inf, np.inf
    record[TIME_TO_CONTACT_LOWER] = 0.0
    record[STIFFNESS], record[DAMPING], record[FORCE] = 0.0, 0.0, 0.0
    numbers[FINGER], numbers[FLAGS] = i, 0
    numbers[PART], numbers[FACE], numbers[WORK], numbers[KINDS] = NO_PART, NO_FACE, 0, 0


@inlined
def _observe(arrays, i, pose_ns, x, y, z):
    """Take in the pose of finger *i*, and its velocity where that is given; the bits of `motion.observe`."""
    settings, motions, marks = arrays.settings, arrays.motions, arrays.motion_marks
    if settings[HAS_VELOCITIES] == 0.0:
        return observe(motions, marks, i, pose_ns, x, y, z, settings[MAX_SPEED], settings[MAX_ACCELERATION])
    velocities = arrays.velocities
    return observe_with_velocity(
        motions, marks, i, pose_ns, x, y, z, velocities[i, 0], velocities[i, 1], velocities[i, 2],
        settings[MAX_SPEED], settings[MAX_ACCELERATION],
    )  # fmt: skip


@inlined
def _find_all_distances(model, arrays, is_moved, scratch):
    """Write the distance of each tracked finger; the turn of the first that found no steps left, if any.

    Turns count from the finger that is first in this tick.
    """
    settings, count = arrays.settings, len(arrays.marks)
    first, late = np.int64(settings[FIRST]), count
    for turn in range(count):
        i = (first + turn) % count
        _fetch_face(model.reals, arrays.marks, (i + 1) % count)
        if settings[STEPS_LEFT] <= 0.0:
            late = min(late, turn)
        finger = finger_at(arrays, i)
        flags = np.int64(finger.numbers[FLAGS])
        if not flags & TRACKED:
            continue
        flags |= find_distance(model, arrays, i, is_moved, scratch)
        part, marks = finger.numbers[PART], finger.marks
        if marks[REPORTED_PART] != part and marks[REPORTED_PART] != NO_PART:
            flags |= PART_CHANGED
        marks[REPORTED_PART] = part
        finger.numbers[FLAGS] = flags
    return late


@inlined
def _fetch_face(reals, marks, i):
    """Have the face that a finger starts from brought from memory, while another finger is done."""
    if marks[i, SLOT] >= 0:
        base = BLOCK_STRIDE * (marks[i, SLOT] // LANES)
        for line in range(BLOCK_STRIDE // 8):
            prefetch(reals, base + 8 * line)


@inlined
def _predict_all(model, arrays, straight, scratch):
    """Write what each tracked finger will meet, and the advice; returns as `_find_all_distances`.

    *straight*: a path of two corners, to be filled.
    """
    settings, count = arrays.settings, len(arrays.marks)
    first, late = np.int64(settings[FIRST]), count
    latency_ns = np.int64(1e9 * settings[LATENCY])
    movers = Movers(arrays.movers, np.int64(settings[MOVER_COUNT]), settings[STANDS] != 0.0)
    for turn in range(count):
        i = (first + turn) % count
        if settings[AHEAD_LEFT] <= 0.0:
            late = min(late, turn)
        finger = finger_at(arrays, i)
        flags = np.int64(finger.numbers[FLAGS])
        if not flags & TRACKED:
            continue
        ahead = 1e-9 * (float(arrays.wide[i, AGE_NS]) + float(latency_ns))
        motion = relative_motion(model.frames, settings, movers, finger, flags)
        predict_distance(model, settings, finger, arrays.motions, i, motion, ahead, flags, scratch)
        predict_time_to_contact(model, settings, finger, motion, straight, flags, scratch)
        if settings[HAS_PATHS] != 0.0 and isfinite(arrays.paths[i, 0, 0]):
            path = Path(arrays.paths[i], arrays.path_lengths)
            flags = predict_contact_on_path(
                model, settings, finger, path, arrays.path_bends, arrays.bends[i], movers, scratch, flags
            )
        finger.numbers[FLAGS] = flags
        _advise(finger.record, finger.numbers)
    return late


@inlined
def _advise(record, numbers):
    """Write what the controller is advised to do, and with what force a deformable part answers a touch."""
    is_deformable = numbers[KINDS] == SURFACE_DEFORMABLE
    is_touching = record[SIGNED_DISTANCE] <= 0.0
    mode = MODE_RETRACT
    if is_touching or record[TIME_TO_CONTACT] < np.inf or record[CONTACT_BEND] < np.inf:
        mode = MODE_FORCE if is_deformable else MODE_POSITION
    numbers[KINDS] |= mode << MODE_BIT
    if is_deformable and is_touching:
        damped = record[DAMPING] * record[APPROACH_SPEED]
        force = max(0.0, damped - record[STIFFNESS] * record[SIGNED_DISTANCE])
        if isfinite(force):
            record[FORCE] = force
            numbers[KINDS] |= 1 << FORCE_VALID_BIT
