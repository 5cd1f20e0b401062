"""The distance of one finger, with bounds, and the surface that is nearest to it.

A finger out of the working range, or one whose bounds are close enough, goes by what was known at an earlier
tick and how far finger and parts have moved since. Otherwise the distance is searched for.
"""

from math import sqrt

import numpy as np

from proximity.kernels.contact_columns import (
    APPROACH_SPEED,
    DAMPING,
    FACE,
    IN_RANGE,
    INSIDE,
    KINDS,
    LOWER,
    NORMAL,
    PART,
    PART_VELOCITY,
    POINT_ON_FINGER,
    POINT_ON_PART,
    POSITION,
    SIGNED,
    SIGNED_DISTANCE,
    SKIPPED,
    STIFFNESS,
    UPPER,
    VELOCITY,
    WORK,
)
from proximity.kernels.geometry.closest_feature import LENGTH, POINT, closest_on_triangle, pseudo_normal
from proximity.kernels.geometry.closest_feature import NORMAL as WITNESS_NORMAL
from proximity.kernels.geometry.frames import (
    ROUNDING,
    is_alone,
    rounding_at,
    to_local,
    to_scene,
    turn_to_scene,
)
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import DAMPING as PART_DAMPING
from proximity.kernels.layout import IS_FUSED, SIGN, SIGN_NONE, SLOT_FACES, SURFACE
from proximity.kernels.layout import STIFFNESS as PART_STIFFNESS
from proximity.kernels.point.coherent_search import BEGINS, LONG, nearest_from_last_answer
from proximity.kernels.scene.distance_bounds import (
    beyond_all,
    bounds_at,
    bounds_of_nearest,
    fill_witness,
    may_slip_in,
)
from proximity.kernels.tracking.conservative_advancement import outward_of
from proximity.kernels.tracking.part_drift import velocity_of_part
from proximity.kernels.tracking.track import (
    ADAPTIVE_TOLERANCE,
    ANCHOR,
    BUDGET,
    CLEAR,
    FOOT,
    FOOT_FROM,
    FOOT_WAY,
    FRONTIER_COUNT,
    HOLES,
    IS_OUTSIDE,
    ODOMETER,
    RADIUS,
    SLOT,
    STEPS_LEFT,
    TOLERANCE,
    WAY,
    WORKING_RANGE,
    finger_at,
    vector_at,
)
from proximity.kernels.tracking.track import PART as TRACK_PART
from proximity.native import inlined
from proximity.simd import load_int

CROWD = 10
"""Fingers of two hands: more than that are a crowd."""
TOLERANCE_SHARE = 0.4
"""Of what bounds may be apart, the share that a search in a crowd leaves them apart, rather than going on. A
skin whose bounds may be 5 % apart wants less than half the steps that it wants with 0, to the same bounds on
average."""
SHORT, PAUSE = 2, 200
"""Divisor of the budget: what a front may take of it, and a search for one to be begun. Where it does not get
done in that, none is tried for so many ticks, which matters from a million faces on."""
STRAY = 1.0 / 16.0
"""Share of its distance that a finger may go until the reported point of the surface is looked for anew:
meanwhile it is up to 0.2 % farther than the nearest. Ticks of fingers far off take a seventh less so."""
FEWEST_STEPS = 8
"""For the distance of a finger of which nothing is known, when none are left."""


@inlined
def find_distance(model, arrays, i, is_moved, scratch):
    """Write distance, bounds and nearest surface of finger *i*; return the flags that say what is known.

    *is_moved*: whether parts may stand elsewhere than at the tick before.
    """
    settings, finger = arrays.settings, finger_at(arrays, i)
    radius, part, slot = finger.track[RADIUS], finger.marks[TRACK_PART], finger.marks[SLOT]
    clearance = _clearance_left(model.frames, settings, finger)
    is_outside = finger.marks[IS_OUTSIDE] == 1 and clearance > 0.0
    if is_outside and settings[HOLES] != 0.0:
        x, y, z = vector_at(finger.record, POSITION)
        is_outside = not may_slip_in(model.words, model.frames, model.parts, x, y, z)
    left = np.int64(settings[STEPS_LEFT])
    is_far = is_outside and clearance - radius > settings[WORKING_RANGE]
    is_near_enough, has_surface = False, False
    work, upper = np.int64(0), np.inf
    tolerance = max(settings[TOLERANCE], settings[ADAPTIVE_TOLERANCE])
    if is_far or (is_outside and (tolerance > 0.0 or left <= 0)):
        upper, has_surface = _upper_bound(model, settings, finger, clearance, scratch)
        is_near_enough = left <= 0 or upper - clearance <= tolerance * (clearance - radius)
    if is_far or is_near_enough:
        bits, lower, distance = SKIPPED, min(clearance, upper), upper
        if slot >= 0 and model.parts[part, SIGN] != SIGN_NONE:
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
            min(np.int64(settings[BUDGET]), max(left, FEWEST_STEPS)),
            scratch,
        )
        settings[STEPS_LEFT] -= work
        _keep_search(settings, finger, clear, part, slot, bits)
    record, numbers = finger.record, finger.numbers
    record[SIGNED_DISTANCE] = distance - radius
    record[LOWER], record[UPPER] = lower - radius, upper - radius
    numbers[WORK] = work
    if slot >= 0:
        numbers[PART] = part
        numbers[FACE] = load_int(model.words, model.parts[part, SLOT_FACES] + slot)
        numbers[KINDS] = np.int64(model.frames[part, SURFACE])
        if not has_surface:
            _find_surface(model, settings, finger, part, slot, bits, scratch)
        _write_surface(model.frames, part, finger, scratch.vectors)
    if distance - radius <= settings[WORKING_RANGE]:
        bits |= IN_RANGE
    return bits


@inlined
def _clearance_left(frames, settings, finger):
    """A distance, m, within which there is still no surface: what was clear less what has moved."""
    track = finger.track
    x, y, z = vector_at(finger.record, POSITION)
    dx, dy, dz = x - track[ANCHOR], y - track[ANCHOR + 1], z - track[ANCHOR + 2]
    moved = sqrt(dx * dx + dy * dy + dz * dz) + (settings[WAY] - track[ODOMETER])
    return track[CLEAR] - moved * (1.0 + ROUNDING) - rounding_at(frames, x, y, z)


@inlined
def _upper_bound(model, settings, finger, clearance, scratch):
    """A distance, m, that some surface is not beyond, without a search; whether the surface is known by it.

    Where it is, the scratch vectors are filled as by `_find_surface`; else, if the finger has a face, the
    witness.
    """
    part, slot = finger.marks[TRACK_PART], finger.marks[SLOT]
    x, y, z = vector_at(finger.record, POSITION)
    if slot >= 0:
        upper, is_kept = _to_kept_surface(settings, finger, scratch.vectors)
        if not is_kept:
            upper = fill_witness(
                model.reals, model.words, model.parts, model.frames, part, slot, x, y, z, scratch.witness
            )
        return upper, is_kept
    return beyond_all(model.frames, x, y, z) if clearance < np.inf else np.inf, False


@inlined
def _to_kept_surface(settings, finger, vectors):
    """The distance, m, to the surface point that was answered last, and whether it is still near enough.

    Fills *vectors*: outward direction, and the point.
    """
    track = finger.track
    if track[FOOT_WAY] != settings[WAY]:
        return 0.0, False
    x, y, z = vector_at(finger.record, POSITION)
    dx, dy, dz = x - track[FOOT], y - track[FOOT + 1], z - track[FOOT + 2]
    ax, ay, az = x - track[FOOT_FROM], y - track[FOOT_FROM + 1], z - track[FOOT_FROM + 2]
    length_sq = dot(dx, dy, dz, dx, dy, dz)
    if not (length_sq > 1e-200 and dot(ax, ay, az, ax, ay, az) <= STRAY * STRAY * length_sq):
        return 0.0, False
    length = sqrt(length_sq)
    factor = 1.0 / length
    vectors[0], vectors[1], vectors[2] = factor * dx, factor * dy, factor * dz
    vectors[3], vectors[4], vectors[5] = track[FOOT], track[FOOT + 1], track[FOOT + 2]
    return length, True


@inlined
def _search(model, arrays, i, is_outside, is_moved, tolerance, budget, scratch):
    """Search for the distance of finger *i* and return what `bounds_of_nearest` does.

    From the front of the finger's last search where it has one, by a walk otherwise; *tolerance* as the walk
    takes it.
    """
    parts = model.parts
    finger = finger_at(arrays, i)
    marks, part, slot = finger.marks, finger.marks[TRACK_PART], finger.marks[SLOT]
    point = vector_at(finger.record, POSITION)
    best_sq, is_found, steps = 0.0, False, np.int64(0)
    # A part with a frame of its own is walked as a whole, and gains nothing.
    may_keep = len(arrays.frontiers) > 0 and slot >= 0 and not is_moved
    may_keep = may_keep and (parts[part, IS_FUSED] == 1 or is_alone(parts))
    kept = marks[FRONTIER_COUNT]
    if may_keep and (kept > 0 or kept == BEGINS):
        best_sq, part, slot, is_found, marks[FRONTIER_COUNT], steps = nearest_from_last_answer(
            model, point, part, slot, arrays.frontiers[i], kept, budget // SHORT, scratch.workspace
        )
    if is_found:
        nearest = best_sq, part, slot, best_sq, steps
        return bounds_of_nearest(
            model, point, nearest, is_outside, budget, scratch.workspace, scratch.witness
        )
    distance, lower, upper, clear, part, slot, bits, work = bounds_at(
        model, point, part, slot, is_outside, tolerance, finger.track[RADIUS], budget - steps,
        scratch.workspace, scratch.witness,
    )  # fmt: skip
    work += steps
    if steps > 0:  # in vain
        marks[FRONTIER_COUNT] = -PAUSE
    elif kept < BEGINS - 1:
        marks[FRONTIER_COUNT] = kept + 1
    else:
        marks[FRONTIER_COUNT] = BEGINS if may_keep and LONG <= work <= budget // SHORT else 0
    return distance, lower, upper, clear, part, slot, bits, work


@inlined
def _keep_search(settings, finger, clear, part, slot, bits):
    """Keep for later ticks what a search has found: *clear* m around the finger, nearest face, and side."""
    track, marks = finger.track, finger.marks
    track[ANCHOR], track[ANCHOR + 1], track[ANCHOR + 2] = vector_at(finger.record, POSITION)
    track[CLEAR], track[ODOMETER] = clear, settings[WAY]
    marks[TRACK_PART], marks[SLOT] = part, slot
    marks[IS_OUTSIDE] = 0 if bits & INSIDE else 1


@inlined
def _find_surface(model, settings, finger, part, slot, bits, scratch):
    """Fill the scratch vectors from a filled witness: outward direction, and the point of the surface.

    Keeps the point for later ticks.
    """
    frames, parts = model.frames, model.parts
    witness, vectors, track = scratch.witness, scratch.vectors, finger.track
    x, y, z = vector_at(finger.record, POSITION)
    outward_of(model, part, witness, vectors)
    if witness[LENGTH] <= 1e-150:
        px, py, pz = to_local(frames, parts, part, x, y, z)
        feature, which = closest_on_triangle(px, py, pz, witness)
        face = load_int(model.words, parts[part, SLOT_FACES] + slot)
        pseudo_normal(model.reals, model.words, parts, part, face, feature, which, witness)
        turn_to_scene(frames, parts, part, witness, WITNESS_NORMAL, vectors, 0)
    elif bits & INSIDE:
        for axis in range(3):
            vectors[axis] = -vectors[axis]
    to_scene(frames, parts, part, witness, POINT, vectors, 3)
    track[FOOT], track[FOOT + 1], track[FOOT + 2] = vectors[3], vectors[4], vectors[5]
    track[FOOT_FROM], track[FOOT_FROM + 1], track[FOOT_FROM + 2] = x, y, z
    track[FOOT_WAY] = settings[WAY]


@inlined
def _write_surface(frames, part, finger, vectors):
    """Write points, normal and velocities. *vectors*: outward direction, point, and scratch for one more."""
    record, radius = finger.record, finger.track[RADIUS]
    vectors[6], vectors[7], vectors[8] = velocity_of_part(frames, part, vectors[3], vectors[4], vectors[5])
    closing = 0.0
    for axis in range(3):
        record[NORMAL + axis] = vectors[axis]
        record[POINT_ON_PART + axis] = vectors[3 + axis]
        record[POINT_ON_FINGER + axis] = record[POSITION + axis] - radius * vectors[axis]
        record[PART_VELOCITY + axis] = vectors[6 + axis]
        closing -= vectors[axis] * (record[VELOCITY + axis] - vectors[6 + axis])
    record[APPROACH_SPEED] = closing
    record[STIFFNESS] = frames[part, PART_STIFFNESS]
    record[DAMPING] = frames[part, PART_DAMPING]
