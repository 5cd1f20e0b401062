"""One tick: every finger against every part.

The positions of all fingers are processed first, then distances, then predictions: the code of each phase
fills the nearest cache, and a skin's tick takes 3 to 5 % less time than finger by finger.
"""

from math import isfinite

import numpy as np

from proximity.kernels.contact_record import (
    JUMPED,
    MODE_FORCE,
    MODE_HOLD,
    MODE_POSITION,
    MODE_RETRACT,
    PART_CHANGED,
    PREDICTED,
    SURFACE_DEFORMABLE,
    TRACKED,
)
from proximity.kernels.geometry.closest_feature import stack_closest
from proximity.kernels.geometry.frames import can_be_asked, ignores_some, is_alone, looks_like_millimetres
from proximity.kernels.geometry.rows import vector
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NO_PART, ModelArrays
from proximity.kernels.nodes import fetch_block
from proximity.kernels.stack_arrays import stack_f64, stack_f64_rows
from proximity.kernels.tracking.conservative_advancement import Path
from proximity.kernels.tracking.finger_distance import find_distance
from proximity.kernels.tracking.motion import (
    BACKWARDS,
    FUTURE,
    TOO_OLD,
    USABLE,
    instant_defect,
    observe,
    observe_with_velocity,
)
from proximity.kernels.tracking.part_drift import Movers, displacement_of_parts, gather_movers
from proximity.kernels.tracking.path_contact import predict_contact_on_path
from proximity.kernels.tracking.prediction import predict_distance, predict_time_to_contact, relative_motion
from proximity.kernels.tracking.track import (
    MAX_DISPLACEMENT,
    MAX_NS,
    Finger,
    Scratch,
    TrackerArrays,
    begin_heeding,
    forget_distances,
    heeded_by,
)
from proximity.native import ROWS_WITH_GIL, entry, inlined

# --- bits of a tick's result: it is done, and warnings for its caller ---
NOT_DONE = 0
DONE = 1
HAS_DEFECT = 2  # shifted by `FUTURE`, `TOO_OLD`, `BACKWARDS`: poses with such times
ALL_IN_MILLIMETRES = 32  # the distances of all fingers suggest points in millimetres

FLAG_BITS = (1 << 16) - 1
"""Bits of an observation's status that enter the record."""
SHARED_BUDGETS, MIN_BUDGETS = 20, 8
PREDICTION_BUDGETS = 4
"""Budgets that all fingers share in a tick, for distances and for predictions. Two hands never exhaust them;
a skin of thousands would be late. A finger without steps reports bounds from earlier ticks, and is among the
first at the next tick."""
MANY, PRESENCE = 500, 4
"""Fingers above `MANY` reduce the shared steps by `PRESENCE` each, for the time that they take without a
search."""
MIN_TOLERANCE, MAX_TOLERANCE = 1e-3, 0.5
TOLERANCE_GROWTH, TOLERANCE_DECAY = 1.1, 0.99
"""The bounds of many fingers may differ by a share of the distance, which grows while steps run out and
decays otherwise: the accuracy is then uniform relative to the distance. A fixed rotation instead left points
within 20 mm of a skin with bounds 9.5 mm apart (p99; 3.8 with this), and took 50 % more steps."""


@entry(ModelArrays, TrackerArrays, "float64[:, 3], int64[:], int, bool -> int", rows_with_gil=ROWS_WITH_GIL)
def tick(model, arrays, positions, pose_ns, now_ns, is_moved):
    """Fill the records of a tracker; return `NOT_DONE`, or `DONE` with warning bits about the poses.

    It is not done, and no state changes, if *positions* or *pose_ns*, which is within `MAX_NS`, does not
    have one row per finger. *is_moved*: whether parts may have moved since the previous tick.
    """
    settings, count = arrays.settings[0], len(arrays.tracks)
    if len(positions) != count or len(pose_ns) != count:
        return NOT_DONE
    scratch = Scratch(arrays.workspace, stack_closest(1)[0], stack_f64(9))
    straight = Path(stack_f64_rows(2, 3), stack_f64(2))
    settings.steps_left = steps_for_all(settings.budget, count)
    settings.prediction_steps_left = PREDICTION_BUDGETS * settings.budget
    begin_heeding(model, arrays)
    if is_moved:
        _follow_parts(model, arrays)
    answer = DONE | _observe_all(model, arrays, positions, pose_ns, now_ns)
    late = min(
        _find_all_distances(model, arrays, is_moved, scratch), _predict_all(model, arrays, straight, scratch)
    )
    settings.first_finger = (np.int64(settings.first_finger) + late) % count if late < count else 0.0
    settings.adaptive_tolerance = _tolerance_after(settings.adaptive_tolerance, settings.steps_left)
    return answer | ALL_IN_MILLIMETRES if _all_in_millimetres(model.frames, arrays) else answer


@inlined
def steps_for_all(budget, count):
    """Return the steps that *count* fingers share in a tick for their distances."""
    return max(SHARED_BUDGETS * budget - PRESENCE * max(count - MANY, 0), MIN_BUDGETS * budget)


@inlined
def _tolerance_after(adaptive_tolerance, steps_left):
    """Return the share by which bounds may differ at the next tick."""
    if steps_left <= 0.0:
        return min(max(adaptive_tolerance, MIN_TOLERANCE) * TOLERANCE_GROWTH, MAX_TOLERANCE)
    return adaptive_tolerance * TOLERANCE_DECAY if adaptive_tolerance > MIN_TOLERANCE else 0.0


@inlined
def _follow_parts(model, arrays):
    """Update the state for moved parts: their total displacement, and those that have a velocity."""
    settings = arrays.settings[0]
    if not is_alone(model.parts):  # frontiers move with the only part
        for i in range(len(arrays.tracks)):
            arrays.tracks[i].frontier_count = 0
    displacement = displacement_of_parts(model.frames, arrays.before)
    settings.displacement = (settings.displacement + displacement) * (1.0 + 2.0**-52)
    if not settings.displacement <= MAX_DISPLACEMENT:
        settings.displacement = 0.0
        forget_distances(arrays.tracks, arrays.balls)
    settings.mover_count, settings.any_stands = gather_movers(model.frames, model.parts, arrays.movers)


@inlined
def _observe_all(model, arrays, positions, pose_ns, now_ns):
    """Reset all records, and write position, velocity and tracking state of each finger.

    Return `HAS_DEFECT`, shifted by each defect of the poses' times. A pose of another clock is not used, and
    one before the last is a jump; one that is ahead by less is predicted for its own time.
    """
    settings, found = arrays.settings[0], 0
    apart_ns, ahead_ns = np.int64(settings.other_clock_ns), np.int64(settings.ahead_ns)
    acts_ns = now_ns + np.int64(1e9 * settings.latency)
    for i in range(len(positions)):
        finger = Finger(arrays.tracks[i], arrays.motions[i, 0], arrays.balls[i], arrays.records[i])
        # Read first: *positions* may be a view of the records, which are overwritten below.
        x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
        taken_ns = pose_ns[i]
        arrays.records[i] = arrays.unknown[0]
        record = finger.record
        record.finger = i
        record.pose_ns, record.age_ns = taken_ns, now_ns - max(taken_ns, 1 - MAX_NS)
        record.predicted_ns = max(acts_ns, taken_ns)
        record.position[0], record.position[1], record.position[2] = x, y, z
        estimate = finger.estimate
        last_ns = estimate.pose_ns if estimate.pose_count > 0 else taken_ns
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
                record.velocity[axis] = estimate.velocity[axis]
        else:
            flags &= ~(TRACKED | PREDICTED)
            record.mode = MODE_HOLD
            finger.track.reported_part = NO_PART
        finger.record["flags"] = flags
    return found


@inlined
def _all_in_millimetres(frames, arrays):
    """Test whether fingers are tracked, and the distances of all suggest positions in millimetres."""
    has_any = False
    for i in range(len(arrays.tracks)):
        if arrays.records[i]["flags"] & TRACKED:
            has_any = looks_like_millimetres(frames, arrays.records[i].lower)
            if not has_any:
                return False
    return has_any


@inlined
def _observe(arrays, i, pose_ns, x, y, z):
    """Add the pose and any given velocity of finger *i* to its estimate; return the bits of `observe`."""
    settings, motions = arrays.settings[0], arrays.motions
    max_speed, max_acceleration = settings.max_speed, settings.max_acceleration
    if settings.has_velocities == 0.0:
        return observe(motions, i, pose_ns, x, y, z, max_speed, max_acceleration)
    velocity = vector(arrays.velocities[i])
    return observe_with_velocity(motions, i, pose_ns, x, y, z, velocity, max_speed, max_acceleration)


@inlined
def _find_all_distances(model, arrays, is_moved, scratch):
    """Write the distance of each tracked finger; return the turn of the first without steps.

    Turns count from the finger that is first in this tick; the number of fingers means that all had steps.
    """
    settings, count = arrays.settings[0], len(arrays.tracks)
    first, late = np.int64(settings.first_finger), count
    for turn in range(count):
        i = (first + turn) % count
        _fetch_face(model.reals, arrays.tracks[(i + 1) % count].slot)
        if settings.steps_left <= 0.0:
            late = min(late, turn)
        finger = Finger(arrays.tracks[i], arrays.motions[i, 0], arrays.balls[i], arrays.records[i])
        flags = np.int64(finger.record["flags"])
        if not flags & TRACKED:
            continue
        flags |= find_distance(heeded_by(model, arrays, i), arrays, i, finger, is_moved, scratch)
        part, track = finger.record.part, finger.track
        if track.reported_part != part and track.reported_part != NO_PART:
            flags |= PART_CHANGED
        track.reported_part = part
        finger.record["flags"] = flags
    return late


@inlined
def _fetch_face(reals, slot):
    """Prefetch the face that a finger starts from while the previous finger is processed."""
    if slot >= 0:
        fetch_block(reals, BLOCK_STRIDE * (slot // LANES))


@inlined
def _predict_all(whole, arrays, straight, scratch):
    """Write the predictions and the advice of each tracked finger; return the same as `_find_all_distances`.

    *whole*: the model with all parts; each finger uses those that it does not ignore. *straight*: scratch, a
    path of two corners.
    """
    settings, count = arrays.settings[0], len(arrays.tracks)
    first, late = np.int64(settings.first_finger), count
    latency_ns = np.int64(1e9 * settings.latency)
    movers = all_movers = Movers(arrays.movers, np.int64(settings.mover_count), settings.any_stands != 0.0)
    are_all = True
    for turn in range(count):
        i = (first + turn) % count
        if settings.prediction_steps_left <= 0.0:
            late = min(late, turn)
        finger = Finger(arrays.tracks[i], arrays.motions[i, 0], arrays.balls[i], arrays.records[i])
        flags = np.int64(finger.record["flags"])
        if not flags & TRACKED:
            continue
        model = heeded_by(whole, arrays, i)
        if all_movers.moving_count and not (are_all and not ignores_some(model.parts)):
            are_all = not ignores_some(model.parts)
            movers = Movers(arrays.movers, *gather_movers(model.frames, model.parts, arrays.movers))
        ahead = 1e-9 * (float(arrays.records[i].age_ns) + float(latency_ns))
        motion = relative_motion(model.frames, settings, movers, finger, flags)
        predict_distance(model, settings, finger, motion, ahead, flags, scratch)
        predict_time_to_contact(model, settings, finger, motion, straight, flags, scratch)
        if settings.has_paths != 0.0 and isfinite(arrays.paths[i, 0, 0]):
            path = Path(arrays.paths[i], arrays.path_lengths)
            flags = predict_contact_on_path(
                model, settings, finger, path, arrays.path_bends, arrays.bends[i], movers, scratch, flags
            )
        finger.record["flags"] = flags
        _advise(finger.record)
    if not are_all:
        gather_movers(whole.frames, whole.parts, arrays.movers)
    return late


@inlined
def _advise(record):
    """Write the advised control mode, and the contact force of a deformable part."""
    is_deformable = record.surface == SURFACE_DEFORMABLE
    is_touching = record.signed_distance <= 0.0
    mode = MODE_RETRACT
    if is_touching or record.time_to_contact < np.inf or record.contact_bend < np.inf:
        mode = MODE_FORCE if is_deformable else MODE_POSITION
    record.mode = mode
    if is_deformable and is_touching:
        damped = record.damping * record.approach_speed
        force = max(0.0, damped - record.stiffness * record.signed_distance)
        if isfinite(force):
            record.force = force
            record.force_is_valid = 1
