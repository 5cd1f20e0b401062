"""The first contact of a finger on a given path, and the time until it.

A path is a polyline with a *bend* at each corner, the coordinate that the glove's controller uses. The
contact is found by conservative advancement along its length, and confirmed by queries beyond it.
"""

from math import isfinite, sqrt

import numpy as np

from proximity.kernels.contact_record import CONTACT_FOUND, INSIDE, ON_PATH, PREDICTED
from proximity.kernels.geometry.frames import rounding_at, velocity_at
from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.point.budgeted_walk import DOWN
from proximity.kernels.scene.queries.distance_bounds import bounds_at
from proximity.kernels.tracking.conservative_advancement import (
    TOUCH,
    Sphere,
    advance_conservatively,
    point_on_path,
    touches,
)
from proximity.kernels.tracking.part_drift import Drift, gather_near
from proximity.kernels.tracking.prediction import STILL, count_steps, steps_left
from proximity.native import inlined, kernel

PROBES = 3
"""Queries beyond the expected contact, at growing distances, that confirm it."""
ROUNDS = 16
"""Advancements along a path that grazes a surface, each from the end of the previous one, until a contact is
found or excluded: 16 pass a surface 0.05 mm away."""


@inlined
def _measure(path):
    """Fill the parameters of a path with its length up to each corner; return its total length."""
    corners, lengths = path
    lengths[0] = 0.0
    for k in range(len(lengths) - 1):
        dx, dy = corners[k + 1, 0] - corners[k, 0], corners[k + 1, 1] - corners[k, 1]
        dz = corners[k + 1, 2] - corners[k, 2]
        lengths[k + 1] = lengths[k] + sqrt(dx * dx + dy * dy + dz * dz)
    return lengths[len(lengths) - 1]


@inlined
def _nearest_parameter(path, x, y, z):
    """Return the parameter of the point on a path that is nearest to a point."""
    corners, lengths = path
    best_sq, best = np.inf, 0.0
    for k in range(len(lengths) - 1):
        ex, ey = corners[k + 1, 0] - corners[k, 0], corners[k + 1, 1] - corners[k, 1]
        ez = corners[k + 1, 2] - corners[k, 2]
        ax, ay, az = x - corners[k, 0], y - corners[k, 1], z - corners[k, 2]
        length_sq = dot(ex, ey, ez, ex, ey, ez)
        share = min(max(dot(ax, ay, az, ex, ey, ez) / length_sq, 0.0), 1.0) if length_sq > 0.0 else 0.0
        ax, ay, az = ax - share * ex, ay - share * ey, az - share * ez
        distance_sq = dot(ax, ay, az, ax, ay, az)
        if distance_sq < best_sq:
            best_sq, best = distance_sq, lengths[k] + share * (lengths[k + 1] - lengths[k])
    return best


@inlined
def _interpolate(xs, ys, x):
    """Interpolate *ys* over non-decreasing *xs* linearly, constant beyond the ends; return also the slope.

    At repeated *xs* the last piece that starts there counts.
    """
    last = len(xs) - 1
    k = 0
    while k < last - 1 and xs[k + 1] <= x:
        k += 1
    span = xs[k + 1] - xs[k]
    slope = (ys[k + 1] - ys[k]) / span if span > 0.0 else 0.0
    return ys[k] + slope * (min(max(x, xs[k]), xs[k + 1]) - xs[k]), slope


@inlined
def _first_at(xs, ys, x):
    """Interpolate as `_interpolate`; at repeated *xs* the first piece counts."""
    k = 0
    while k < len(xs) - 2 and xs[k + 1] < x:
        k += 1
    span = xs[k + 1] - xs[k]
    slope = (ys[k + 1] - ys[k]) / span if span > 0.0 else 0.0
    return ys[k] + slope * (min(max(x, xs[k]), xs[k + 1]) - xs[k])


@inlined
def _locate(path, path_bends, bend, x, y, z):
    """Locate a finger on its path: return parameter, bend, and the slope of the bend per metre.

    *bend*: as given; nan for that of the nearest point on the path.
    """
    parameters = path.parameters
    if isfinite(bend):
        current, _ = _interpolate(path_bends, parameters, bend)
    else:
        current = _nearest_parameter(path, x, y, z)
    current_bend, bend_per_metre = _interpolate(parameters, path_bends, current)
    # At repeated corners the point does not determine the bend.
    within = min(max(bend, path_bends[0]), path_bends[len(path_bends) - 1])
    return current, within if isfinite(bend) else current_bend, bend_per_metre


@inlined
def _bounds_at_vectors(model, settings, finger, part, slot, scratch):
    """Return bounds of the distance at the first scratch vector, m, and the nearest part and slot."""
    vectors = scratch.vectors
    _, lower, upper, _, part, slot, _, steps = bounds_at(
        model, (vectors[0], vectors[1], vectors[2]), part, slot, False, 0.0, 0.0,
        steps_left(settings, finger.record), scratch.workspace, scratch.closest,
    )  # fmt: skip
    count_steps(settings, finger.record, steps)
    return lower, upper, part, slot


@inlined
def _write_contact_now(record, speed, is_certain):
    """Write that a finger is in contact, or too near to decide; return the flag of a contact.

    *speed*: along its path, m/s.
    """
    record.contact_bend = record.bend
    record.contact_bend_error = 0.0 if is_certain else np.inf
    record.contact_bend_rate = 0.0
    if speed > 0.0:
        record.time_to_contact = 0.0 if is_certain else record.time_to_contact
        record.time_to_contact_lower = 0.0
    return CONTACT_FOUND if is_certain else 0


@kernel
def _advance_on_path(model, settings, finger, path, drift, start, clearance, part, slot, scratch):
    """Advance a fingertip along its path and count the steps; return an `Advance`."""
    sphere = Sphere(finger.track.radius, 1.0, finger.balls, settings.displacement)
    budget = steps_left(settings, finger.record)
    advance = advance_conservatively(
        model, path, sphere, drift, start, clearance, part, slot, 0.0, budget, budget, scratch
    )
    count_steps(settings, finger.record, advance.steps)
    return advance


@kernel
def predict_contact_on_path(model, settings, finger, path, path_bends, bend, movers, scratch, flags):
    """Write the first contact of a finger on its path and, if it moves toward it, the time; return the flags.

    *path*: its corners; its parameters are filled. *path_bends* (K,): at the corners. *bend*: of the finger;
    nan for that of the nearest point on the path.
    """
    whole = _measure(path)
    if not (whole > 0.0 and isfinite(whole)):
        return flags
    flags |= ON_PATH
    record, radius, vectors = finger.record, finger.track.radius, scratch.vectors
    x, y, z = vector(record.position)
    current, bend, bend_per_metre = _locate(path, path_bends, bend, x, y, z)
    point_on_path(path, current, vectors)
    vx, vy, vz = vector(record.velocity)
    speed = dot(vectors[3], vectors[4], vectors[5], vx, vy, vz)
    if abs(speed) <= STILL:
        speed = 0.0
    record.bend, record.bend_rate = bend, speed * bend_per_metre
    ox, oy, oz = x - vectors[0], y - vectors[1], z - vectors[2]
    off = sqrt(dot(ox, oy, oz, ox, oy, oz)) * (1.0 + 1e-12)

    # The finger may be off the path: bound the distance of the path's point instead.
    part, slot = finger.track.part, finger.track.slot
    lower = record.lower + radius - off
    if flags & INSIDE or lower <= radius:
        lower, upper, part, slot = _bounds_at_vectors(model, settings, finger, part, slot, scratch)
        if lower <= radius:
            return flags | _write_contact_now(record, speed, upper <= radius)
    standing = Drift(movers.rows, np.int64(0), 0.0)
    advance = _advance_on_path(
        model, settings, finger, path, standing, current, lower - radius, part, slot, scratch
    )
    if advance.free < whole:
        is_found, advance = _decide_contact(
            model, settings, finger, path, path_bends, movers, standing, advance, scratch
        )
        flags |= is_found
    if speed > 0.0 and flags & PREDICTED and record.signed_distance > 0.0:
        near = np.int64(0)
        if movers.moving_count:
            near, _ = gather_near(
                movers, (0.0, 0.0, 0.0), (x, y, z), radius + off + rounding_at(model.frames, x, y, z), 1.0,
                1.0 / speed, whole - current,
            )  # fmt: skip
        if near:
            advance = _advance_on_path(
                model, settings, finger, path, Drift(movers.rows, near, 0.0), current, lower - radius,
                advance.part, advance.slot, scratch,
            )  # fmt: skip
        record.time_to_contact_lower = max(advance.free - current, 0.0) / speed * DOWN
        record.time_to_contact = max(advance.expected - current, 0.0) / speed
    return flags


@kernel
def _decide_contact(model, settings, finger, path, path_bends, movers, standing, advance, scratch):
    """Write the contact of a path that is not free to its end; return its flag, and the last `Advance`.

    A grazing path may use up the steps of an advancement without a contact; the next one continues from its
    end.
    """
    record, whole = finger.record, path.parameters[len(path.parameters) - 1]
    flag = _write_contact(model, settings, finger, path, path_bends, movers, advance, scratch)
    for _ in range(ROUNDS):
        if flag or steps_left(settings, finger.record) <= 0:
            break
        before = advance.free
        advance = _advance_on_path(
            model, settings, finger, path, standing, before, 0.0, advance.part, advance.slot, scratch
        )
        if not advance.free < whole:
            record.contact_bend = record.contact_bend_error = np.nan
            record.contact_bend_rate = np.nan
            break
        flag = _write_contact(model, settings, finger, path, path_bends, movers, advance, scratch)
        if not advance.free > before:
            break
    return flag, advance


@inlined
def _speed_of_contact(frames, path, advance, vectors):
    """Return the speed of the contact along the path, m/s, caused by the motion of its part.

    The contact is some millimetres beyond the last query point, to which the normal in the last three numbers
    of *vectors* belongs.
    """
    point_on_path(path, advance.expected, vectors)
    vx, vy, vz = velocity_at(frames[advance.part], vectors[0], vectors[1], vectors[2])
    along = dot(vectors[6], vectors[7], vectors[8], vectors[3], vectors[4], vectors[5])
    return dot(vectors[6], vectors[7], vectors[8], vx, vy, vz) / along if along < 0.0 else 0.0


@kernel
def _write_contact(model, settings, finger, path, path_bends, movers, advance, scratch):
    """Write the contact with its error, from an `Advance` and queries beyond it; return its flag."""
    record, radius, parameters = finger.record, finger.track.radius, path.parameters
    free, expected, part, slot, _ = advance
    least = max(_first_at(parameters, path_bends, free), record.bend)
    if not expected < np.inf:
        # No expected contact: report the end of the free range, the safe value, without a normal.
        record.contact_bend = least
        record.contact_bend_error = np.inf
        return 0
    speed = 0.0
    if movers.moving_count and slot >= 0:
        speed = _speed_of_contact(model.frames, path, advance, scratch.vectors)
    bend, slope = _interpolate(parameters, path_bends, expected)
    record.contact_bend, record.contact_bend_error = bend, np.inf
    record.contact_bend_rate = speed * slope
    margin = max(2.0 * (expected - free), 2.0 * TOUCH)
    for _ in range(PROBES):
        beyond = min(expected + margin, parameters[len(parameters) - 1])
        point_on_path(path, beyond, scratch.vectors)
        is_touch, steps = touches(
            model, vector(scratch.vectors), radius, part, slot, steps_left(settings, finger.record),
            scratch.workspace,
        )  # fmt: skip
        count_steps(settings, finger.record, steps)
        if not is_touch and radius < margin:
            # A sphere this small may have passed the surface: test whether it is inside.
            _, upper, _, _ = _bounds_at_vectors(model, settings, finger, part, slot, scratch)
            is_touch = upper <= radius
        if is_touch:
            most, _ = _interpolate(parameters, path_bends, beyond)
            record.contact_bend_error = max(bend - least, most - bend)
            return CONTACT_FOUND
        margin *= 4.0
    return 0
