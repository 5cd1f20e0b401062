"""Distance of one finger with bounds, and the surface point nearest to it.

A finger outside the working range, or whose bounds are close enough, reuses the result of an earlier tick,
widened by the displacement of finger and parts since. Otherwise the distance is searched.
"""

from math import sqrt

import numpy as np

from proximity.kernels.contact_record import IN_RANGE, INSIDE, SIGNED, SKIPPED
from proximity.kernels.geometry.closest_feature import (
    closest_on_triangle,
)
from proximity.kernels.geometry.frames import (
    LENGTH_ROUNDING,
    ignores_some,
    is_alone,
    rounding_at,
    to_local,
    to_scene,
    turn_to_scene,
    velocity_at,
)
from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import SIGN_NONE
from proximity.kernels.point.coherent_search import FRONTIER_BEGINS, LONG_WALK, nearest_from_last_answer
from proximity.kernels.scene.queries.distance_bounds import (
    beyond_all,
    bounds_at,
    bounds_of_nearest,
    fill_closest,
    is_in_box_with_holes,
)
from proximity.kernels.sign.side import pseudo_normal
from proximity.kernels.tracking.conservative_advancement import outward_of
from proximity.native import inlined
from proximity.native.simd import load_int

CROWD = 10
"""Fingers of two hands; larger numbers are a crowd."""
TOLERANCE_SHARE = 0.4
"""Share of the tolerance by which a search in a crowd leaves its bounds apart. With a tolerance of 5 % a skin
needs less than half the steps of an exact search, for the same bounds on average."""
SHORT, PAUSE = 0.75, 30
"""Share of the budget that limits a coherent search, and the traversal after which one may start; and ticks
until the next attempt after one that exceeded it. With a half and 200 ticks, five fingers near a million
faces took 320 steps a tick on average instead of 180, and the bounds were apart in 0.2 % instead of 0.4 %."""
STRAY = 1.0 / 16.0
"""Share of its distance that a finger may move before the reported surface point is searched again: until
then the point is up to 0.2 % farther than the nearest. Ticks of distant fingers take a seventh less time."""
MIN_DISTANCE_STEPS = 8
"""Steps for the distance of a finger without bounds when the shared steps are used up."""


@inlined
def find_distance(model, arrays, i, finger, is_moved, scratch):
    """Write distance, bounds and nearest surface point of finger *i*; return the flags of the result.

    *is_moved*: whether parts may have moved since the previous tick.
    """
    settings = arrays.settings[0]
    radius, part, slot = finger.track.radius, finger.track.part, finger.track.slot
    clearance = _clearance_left(model.frames, settings, finger)
    is_outside = finger.track.is_outside == 1 and clearance > 0.0
    if is_outside and settings.has_holes != 0.0:
        is_outside = not is_in_box_with_holes(model, vector(finger.record.position))
    left = np.int64(settings.steps_left)
    is_far = is_outside and clearance - radius > settings.working_range
    is_near_enough, has_surface = False, False
    work, upper = np.int64(0), np.inf
    tolerance = max(settings.tolerance, settings.adaptive_tolerance)
    if is_far or (is_outside and (tolerance > 0.0 or left <= 0)):
        upper, has_surface = _upper_bound(model, settings, finger, clearance, scratch)
        is_near_enough = left <= 0 or upper - clearance <= tolerance * (clearance - radius)
    if is_far or is_near_enough:
        bits, lower, distance = SKIPPED, min(clearance, upper), upper
        if slot >= 0 and model.parts[part].sign != SIGN_NONE:
            bits |= SIGNED
    else:
        has_surface = False
        distance, lower, upper, clear, part, slot, bits, work = _search(
            model,
            arrays,
            i,
            finger,
            is_outside,
            is_moved,
            TOLERANCE_SHARE * tolerance if len(arrays.tracks) > CROWD else 0.0,
            min(np.int64(settings.budget), max(left, MIN_DISTANCE_STEPS)),
            scratch,
        )
        settings.steps_left -= work
        _keep_search(settings, finger, clear, part, slot, bits)
    record = finger.record
    record.signed_distance = distance - radius
    record.lower, record.upper = lower - radius, upper - radius
    record.work = work
    if slot >= 0:
        record.part = part
        record.face = load_int(model.words, model.parts[part].slot_faces + slot)
        record.surface = np.int64(model.frames[part].surface)
        if not has_surface:
            _find_surface(model, settings, finger, part, slot, bits, scratch)
        _write_surface(model.frames, part, finger, scratch.vectors)
    if distance - radius <= settings.working_range:
        bits |= IN_RANGE
    return bits


@inlined
def _clearance_left(frames, settings, finger):
    """Return a lower bound of the distance, m: the last clearance less the displacement since."""
    track = finger.track
    x, y, z = vector(finger.record.position)
    dx, dy, dz = x - track.anchor[0], y - track.anchor[1], z - track.anchor[2]
    moved = sqrt(dx * dx + dy * dy + dz * dz) + (settings.displacement - track.odometer)
    return track.clear - moved * (1.0 + LENGTH_ROUNDING) - rounding_at(frames, x, y, z)


@inlined
def _upper_bound(model, settings, finger, clearance, scratch):
    """Return an upper bound of the distance, m, without a search, and whether it gives the surface point.

    If it does, the scratch vectors are filled as by `_find_surface`; otherwise, if the finger has a face, the
    closest feature is.
    """
    part, slot = finger.track.part, finger.track.slot
    x, y, z = vector(finger.record.position)
    if slot >= 0:
        upper, is_kept = _to_kept_surface(settings, finger, scratch.vectors)
        if not is_kept:
            upper = fill_closest(model, part, slot, (x, y, z), scratch.closest)
        return upper, is_kept
    return beyond_all(model.frames, x, y, z) if clearance < np.inf else np.inf, False


@inlined
def _to_kept_surface(settings, finger, vectors):
    """Return the distance, m, to the last reported surface point, and whether that point is still usable.

    Fills *vectors*: outward direction, and the point.
    """
    track = finger.track
    if track.foot_displacement != settings.displacement:
        return 0.0, False
    x, y, z = vector(finger.record.position)
    dx, dy, dz = x - track.foot[0], y - track.foot[1], z - track.foot[2]
    ax, ay, az = x - track.foot_from[0], y - track.foot_from[1], z - track.foot_from[2]
    length_sq = dot(dx, dy, dz, dx, dy, dz)
    if not (length_sq > 1e-200 and dot(ax, ay, az, ax, ay, az) <= STRAY * STRAY * length_sq):
        return 0.0, False
    length = sqrt(length_sq)
    factor = 1.0 / length
    vectors[0], vectors[1], vectors[2] = factor * dx, factor * dy, factor * dz
    vectors[3], vectors[4], vectors[5] = track.foot[0], track.foot[1], track.foot[2]
    return length, True


@inlined
def _search(model, arrays, i, finger, is_outside, is_moved, tolerance, budget, scratch):
    """Search the distance of finger *i*; return the same as `bounds_of_nearest`.

    Starts from the frontier of the finger's last search if there is one, otherwise traverses the tree with
    *tolerance*.
    """
    parts = model.parts
    track, part, slot = finger.track, finger.track.part, finger.track.slot
    point = vector(finger.record.position)
    best_sq, is_found, steps = 0.0, False, np.int64(0)
    # The frontier of the only part moves with it. In a scene of several parts, a part with a separate frame
    # is traversed fully.
    may_keep = len(arrays.frontiers) > 0 and slot >= 0 and not ignores_some(parts)
    may_keep = may_keep and (is_alone(parts) or (parts[part].is_fused == 1 and not is_moved))
    kept = track.frontier_count
    if may_keep and (kept > 0 or kept == FRONTIER_BEGINS):
        best_sq, part, slot, is_found, track.frontier_count, steps = nearest_from_last_answer(
            model, point, part, slot, arrays.frontiers[i], kept, np.int64(SHORT * budget), scratch.workspace
        )
    if is_found:
        nearest = best_sq, part, slot, best_sq, steps
        return bounds_of_nearest(
            model, point, nearest, is_outside, budget, scratch.workspace, scratch.closest
        )
    distance, lower, upper, clear, part, slot, bits, work = bounds_at(
        model, point, part, slot, is_outside, tolerance, finger.track.radius, budget - steps,
        scratch.workspace, scratch.closest,
    )  # fmt: skip
    work += steps
    if steps > 0:  # the coherent search failed
        track.frontier_count = -PAUSE
    elif kept < FRONTIER_BEGINS - 1:
        track.frontier_count = kept + 1
    else:
        track.frontier_count = FRONTIER_BEGINS if may_keep and LONG_WALK <= work <= SHORT * budget else 0
    return distance, lower, upper, clear, part, slot, bits, work


@inlined
def _keep_search(settings, finger, clear, part, slot, bits):
    """Store the result of a search for later ticks: *clear* m around the finger, nearest face, and side."""
    track = finger.track
    track.anchor[0], track.anchor[1], track.anchor[2] = vector(finger.record.position)
    track.clear, track.odometer = clear, settings.displacement
    track.part, track.slot = part, slot
    track.is_outside = 0 if bits & INSIDE else 1


@inlined
def _find_surface(model, settings, finger, part, slot, bits, scratch):
    """Fill the scratch vectors from the closest feature: outward direction, and the surface point.

    Stores the point for later ticks.
    """
    frames, parts = model.frames, model.parts
    closest, vectors, track = scratch.closest, scratch.vectors, finger.track
    x, y, z = vector(finger.record.position)
    outward_of(model, part, closest, vectors)
    if closest.length <= 1e-150:
        px, py, pz = to_local(frames, parts, part, x, y, z)
        feature, which = closest_on_triangle(px, py, pz, closest)
        face = load_int(model.words, parts[part].slot_faces + slot)
        pseudo_normal(model, part, face, feature, which, closest)
        turn_to_scene(frames, parts, part, closest.normal, 0, vectors, 0)
    elif bits & INSIDE:
        for axis in range(3):
            vectors[axis] = -vectors[axis]
    to_scene(frames, parts, part, closest.point, 0, vectors, 3)
    track.foot[0], track.foot[1], track.foot[2] = vectors[3], vectors[4], vectors[5]
    track.foot_from[0], track.foot_from[1], track.foot_from[2] = x, y, z
    track.foot_displacement = settings.displacement


@inlined
def _write_surface(frames, part, finger, vectors):
    """Write points, normal and velocities. *vectors*: outward direction, point, and scratch for one more."""
    record, radius = finger.record, finger.track.radius
    vectors[6], vectors[7], vectors[8] = velocity_at(frames[part], vectors[3], vectors[4], vectors[5])
    closing = 0.0
    for axis in range(3):
        record.normal[axis] = vectors[axis]
        record.point_on_part[axis] = vectors[3 + axis]
        record.point_on_finger[axis] = record.position[axis] - radius * vectors[axis]
        record.part_velocity[axis] = vectors[6 + axis]
        closing -= vectors[axis] * (record.velocity[axis] - vectors[6 + axis])
    record.approach_speed = closing
    record.stiffness = frames[part].stiffness
    record.damping = frames[part].damping
