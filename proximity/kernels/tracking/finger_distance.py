"""The distance of one finger, with bounds, and the surface that is nearest to it.

A finger out of the working range, or one whose bounds are close enough, goes by what was known at an earlier
tick and how far finger and parts have moved since. Otherwise the distance is searched for.
"""

from math import sqrt

import numpy as np

from proximity.kernels.contact_columns import (
    IN_RANGE,
    INSIDE,
    RECORD_APPROACH_SPEED,
    RECORD_DAMPING,
    RECORD_FACE,
    RECORD_KINDS,
    RECORD_LOWER,
    RECORD_NORMAL,
    RECORD_PART,
    RECORD_PART_VELOCITY,
    RECORD_POINT_ON_FINGER,
    RECORD_POINT_ON_PART,
    RECORD_POSITION,
    RECORD_SIGNED_DISTANCE,
    RECORD_STIFFNESS,
    RECORD_UPPER,
    RECORD_VELOCITY,
    RECORD_WORK,
    SIGNED,
    SKIPPED,
)
from proximity.kernels.geometry.closest_feature import (
    CLOSEST_LENGTH,
    CLOSEST_NORMAL,
    CLOSEST_POINT,
    closest_on_triangle,
    pseudo_normal,
)
from proximity.kernels.geometry.frames import (
    LENGTH_ROUNDING,
    is_alone,
    rounding_at,
    to_local,
    to_scene,
    turn_to_scene,
)
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import (
    FRAME_DAMPING,
    FRAME_STIFFNESS,
    FRAME_SURFACE,
    PART_IS_FUSED,
    PART_SIGN,
    PART_SLOT_FACES,
    SIGN_NONE,
)
from proximity.kernels.point.coherent_search import FRONTIER_BEGINS, LONG_WALK, nearest_from_last_answer
from proximity.kernels.scene.distance_bounds import (
    beyond_all,
    bounds_at,
    bounds_of_nearest,
    fill_closest,
    is_in_box_with_holes,
)
from proximity.kernels.tracking.conservative_advancement import outward_of
from proximity.kernels.tracking.part_drift import velocity_of_part
from proximity.kernels.tracking.track import (
    SETTING_ADAPTIVE_TOLERANCE,
    SETTING_BUDGET,
    SETTING_DISPLACEMENT,
    SETTING_HAS_HOLES,
    SETTING_STEPS_LEFT,
    SETTING_TOLERANCE,
    SETTING_WORKING_RANGE,
    TRACK_ANCHOR,
    TRACK_CLEAR,
    TRACK_FOOT,
    TRACK_FOOT_DISPLACEMENT,
    TRACK_FOOT_FROM,
    TRACK_FRONTIER_COUNT,
    TRACK_IS_OUTSIDE,
    TRACK_ODOMETER,
    TRACK_PART,
    TRACK_RADIUS,
    TRACK_SLOT,
    finger_at,
    vector_at,
)
from proximity.native import inlined
from proximity.native.simd import load_int

CROWD = 10
"""Fingers of two hands: more than that are a crowd."""
TOLERANCE_SHARE = 0.4
"""Share of the tolerance by which a search in a crowd leaves its bounds apart, rather than going on. A
skin whose bounds may be 5 % apart wants less than half the steps that it wants with 0, to the same bounds on
average."""
SHORT, PAUSE = 2, 200
"""Divisor of the budget: what a coherent search may take of it, and a walk for one to be begun. Where it does
not get done in that, none is tried for so many ticks, which matters from a million faces on."""
STRAY = 1.0 / 16.0
"""Share of its distance that a finger may go until the reported point of the surface is looked for anew:
meanwhile it is up to 0.2 % farther than the nearest. Ticks of fingers far off take a seventh less so."""
FEWEST_DISTANCE_STEPS = 8
"""For the distance of a finger of which nothing is known, when none are left."""


@inlined
def find_distance(model, arrays, i, is_moved, scratch):
    """Write distance, bounds and nearest surface of finger *i*; return the flags that say what is known.

    *is_moved*: whether parts may stand elsewhere than at the tick before.
    """
    settings, finger = arrays.settings, finger_at(arrays, i)
    radius, part, slot = finger.track[TRACK_RADIUS], finger.marks[TRACK_PART], finger.marks[TRACK_SLOT]
    clearance = _clearance_left(model.frames, settings, finger)
    is_outside = finger.marks[TRACK_IS_OUTSIDE] == 1 and clearance > 0.0
    if is_outside and settings[SETTING_HAS_HOLES] != 0.0:
        x, y, z = vector_at(finger.record, RECORD_POSITION)
        is_outside = not is_in_box_with_holes(model.words, model.frames, model.parts, x, y, z)
    left = np.int64(settings[SETTING_STEPS_LEFT])
    is_far = is_outside and clearance - radius > settings[SETTING_WORKING_RANGE]
    is_near_enough, has_surface = False, False
    work, upper = np.int64(0), np.inf
    tolerance = max(settings[SETTING_TOLERANCE], settings[SETTING_ADAPTIVE_TOLERANCE])
    if is_far or (is_outside and (tolerance > 0.0 or left <= 0)):
        upper, has_surface = _upper_bound(model, settings, finger, clearance, scratch)
        is_near_enough = left <= 0 or upper - clearance <= tolerance * (clearance - radius)
    if is_far or is_near_enough:
        bits, lower, distance = SKIPPED, min(clearance, upper), upper
        if slot >= 0 and model.parts[part, PART_SIGN] != SIGN_NONE:
            bits |= SIGNED
    else:
        has_surface = False
        distance, lower, upper, clear, part, slot, bits, work = _search(
            model,
            arrays,
            i,
            is_outside,
            is_moved,
            TOLERANCE_SHARE * tolerance if len(arrays.marks) > CROWD else 0.0,
            min(np.int64(settings[SETTING_BUDGET]), max(left, FEWEST_DISTANCE_STEPS)),
            scratch,
        )
        settings[SETTING_STEPS_LEFT] -= work
        _keep_search(settings, finger, clear, part, slot, bits)
    record, numbers = finger.record, finger.numbers
    record[RECORD_SIGNED_DISTANCE] = distance - radius
    record[RECORD_LOWER], record[RECORD_UPPER] = lower - radius, upper - radius
    numbers[RECORD_WORK] = work
    if slot >= 0:
        numbers[RECORD_PART] = part
        numbers[RECORD_FACE] = load_int(model.words, model.parts[part, PART_SLOT_FACES] + slot)
        numbers[RECORD_KINDS] = np.int64(model.frames[part, FRAME_SURFACE])
        if not has_surface:
            _find_surface(model, settings, finger, part, slot, bits, scratch)
        _write_surface(model.frames, part, finger, scratch.vectors)
    if distance - radius <= settings[SETTING_WORKING_RANGE]:
        bits |= IN_RANGE
    return bits


@inlined
def _clearance_left(frames, settings, finger):
    """A distance, m, within which there is still no surface: what was clear less what has moved."""
    track = finger.track
    x, y, z = vector_at(finger.record, RECORD_POSITION)
    dx, dy, dz = x - track[TRACK_ANCHOR], y - track[TRACK_ANCHOR + 1], z - track[TRACK_ANCHOR + 2]
    moved = sqrt(dx * dx + dy * dy + dz * dz) + (settings[SETTING_DISPLACEMENT] - track[TRACK_ODOMETER])
    return track[TRACK_CLEAR] - moved * (1.0 + LENGTH_ROUNDING) - rounding_at(frames, x, y, z)


@inlined
def _upper_bound(model, settings, finger, clearance, scratch):
    """A distance, m, that some surface is not beyond, without a search; whether the surface is known by it.

    Where it is, the scratch vectors are filled as by `_find_surface`; else, if the finger has a face, the
    closest feature.
    """
    part, slot = finger.marks[TRACK_PART], finger.marks[TRACK_SLOT]
    x, y, z = vector_at(finger.record, RECORD_POSITION)
    if slot >= 0:
        upper, is_kept = _to_kept_surface(settings, finger, scratch.vectors)
        if not is_kept:
            upper = fill_closest(
                model.reals, model.words, model.parts, model.frames, part, slot, x, y, z, scratch.closest
            )
        return upper, is_kept
    return beyond_all(model.frames, x, y, z) if clearance < np.inf else np.inf, False


@inlined
def _to_kept_surface(settings, finger, vectors):
    """The distance, m, to the surface point that was answered last, and whether it is still near enough.

    Fills *vectors*: outward direction, and the point.
    """
    track = finger.track
    if track[TRACK_FOOT_DISPLACEMENT] != settings[SETTING_DISPLACEMENT]:
        return 0.0, False
    x, y, z = vector_at(finger.record, RECORD_POSITION)
    dx, dy, dz = x - track[TRACK_FOOT], y - track[TRACK_FOOT + 1], z - track[TRACK_FOOT + 2]
    ax, ay, az = x - track[TRACK_FOOT_FROM], y - track[TRACK_FOOT_FROM + 1], z - track[TRACK_FOOT_FROM + 2]
    length_sq = dot(dx, dy, dz, dx, dy, dz)
    if not (length_sq > 1e-200 and dot(ax, ay, az, ax, ay, az) <= STRAY * STRAY * length_sq):
        return 0.0, False
    length = sqrt(length_sq)
    factor = 1.0 / length
    vectors[0], vectors[1], vectors[2] = factor * dx, factor * dy, factor * dz
    vectors[3], vectors[4], vectors[5] = track[TRACK_FOOT], track[TRACK_FOOT + 1], track[TRACK_FOOT + 2]
    return length, True


@inlined
def _search(model, arrays, i, is_outside, is_moved, tolerance, budget, scratch):
    """Search for the distance of finger *i* and return what `bounds_of_nearest` does.

    From the frontier of the finger's last search where it has one, by a walk otherwise; *tolerance* as the
    walk takes it.
    """
    parts = model.parts
    finger = finger_at(arrays, i)
    marks, part, slot = finger.marks, finger.marks[TRACK_PART], finger.marks[TRACK_SLOT]
    point = vector_at(finger.record, RECORD_POSITION)
    best_sq, is_found, steps = 0.0, False, np.int64(0)
    # A part with a frame of its own is walked as a whole, and gains nothing.
    may_keep = len(arrays.frontiers) > 0 and slot >= 0 and not is_moved
    may_keep = may_keep and (parts[part, PART_IS_FUSED] == 1 or is_alone(parts))
    kept = marks[TRACK_FRONTIER_COUNT]
    if may_keep and (kept > 0 or kept == FRONTIER_BEGINS):
        best_sq, part, slot, is_found, marks[TRACK_FRONTIER_COUNT], steps = nearest_from_last_answer(
            model, point, part, slot, arrays.frontiers[i], kept, budget // SHORT, scratch.workspace
        )
    if is_found:
        nearest = best_sq, part, slot, best_sq, steps
        return bounds_of_nearest(
            model, point, nearest, is_outside, budget, scratch.workspace, scratch.closest
        )
    distance, lower, upper, clear, part, slot, bits, work = bounds_at(
        model, point, part, slot, is_outside, tolerance, finger.track[TRACK_RADIUS], budget - steps,
        scratch.workspace, scratch.closest,
    )  # fmt: skip
    work += steps
    if steps > 0:  # in vain
        marks[TRACK_FRONTIER_COUNT] = -PAUSE
    elif kept < FRONTIER_BEGINS - 1:
        marks[TRACK_FRONTIER_COUNT] = kept + 1
    else:
        marks[TRACK_FRONTIER_COUNT] = (
            FRONTIER_BEGINS if may_keep and LONG_WALK <= work <= budget // SHORT else 0
        )
    return distance, lower, upper, clear, part, slot, bits, work


@inlined
def _keep_search(settings, finger, clear, part, slot, bits):
    """Keep for later ticks what a search has found: *clear* m around the finger, nearest face, and side."""
    track, marks = finger.track, finger.marks
    track[TRACK_ANCHOR], track[TRACK_ANCHOR + 1], track[TRACK_ANCHOR + 2] = vector_at(
        finger.record, RECORD_POSITION
    )
    track[TRACK_CLEAR], track[TRACK_ODOMETER] = clear, settings[SETTING_DISPLACEMENT]
    marks[TRACK_PART], marks[TRACK_SLOT] = part, slot
    marks[TRACK_IS_OUTSIDE] = 0 if bits & INSIDE else 1


@inlined
def _find_surface(model, settings, finger, part, slot, bits, scratch):
    """Fill the scratch vectors from a filled closest feature: outward direction, and the point of the
    surface.

    Keeps the point for later ticks.
    """
    frames, parts = model.frames, model.parts
    closest, vectors, track = scratch.closest, scratch.vectors, finger.track
    x, y, z = vector_at(finger.record, RECORD_POSITION)
    outward_of(model, part, closest, vectors)
    if closest[CLOSEST_LENGTH] <= 1e-150:
        px, py, pz = to_local(frames, parts, part, x, y, z)
        feature, which = closest_on_triangle(px, py, pz, closest)
        face = load_int(model.words, parts[part, PART_SLOT_FACES] + slot)
        pseudo_normal(model.reals, model.words, parts, part, face, feature, which, closest)
        turn_to_scene(frames, parts, part, closest, CLOSEST_NORMAL, vectors, 0)
    elif bits & INSIDE:
        for axis in range(3):
            vectors[axis] = -vectors[axis]
    to_scene(frames, parts, part, closest, CLOSEST_POINT, vectors, 3)
    track[TRACK_FOOT], track[TRACK_FOOT + 1], track[TRACK_FOOT + 2] = vectors[3], vectors[4], vectors[5]
    track[TRACK_FOOT_FROM], track[TRACK_FOOT_FROM + 1], track[TRACK_FOOT_FROM + 2] = x, y, z
    track[TRACK_FOOT_DISPLACEMENT] = settings[SETTING_DISPLACEMENT]


@inlined
def _write_surface(frames, part, finger, vectors):
    """Write points, normal and velocities. *vectors*: outward direction, point, and scratch for one more."""
    record, radius = finger.record, finger.track[TRACK_RADIUS]
    vectors[6], vectors[7], vectors[8] = velocity_of_part(frames, part, vectors[3], vectors[4], vectors[5])
    closing = 0.0
    for axis in range(3):
        record[RECORD_NORMAL + axis] = vectors[axis]
        record[RECORD_POINT_ON_PART + axis] = vectors[3 + axis]
        record[RECORD_POINT_ON_FINGER + axis] = record[RECORD_POSITION + axis] - radius * vectors[axis]
        record[RECORD_PART_VELOCITY + axis] = vectors[6 + axis]
        closing -= vectors[axis] * (record[RECORD_VELOCITY + axis] - vectors[6 + axis])
    record[RECORD_APPROACH_SPEED] = closing
    record[RECORD_STIFFNESS] = frames[part, FRAME_STIFFNESS]
    record[RECORD_DAMPING] = frames[part, FRAME_DAMPING]
