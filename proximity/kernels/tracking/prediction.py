"""Predictions for a finger: distance when the controller acts, and time to contact.

All queries use the scene at the tick. A path in time is followed relative to the nearest part: the finger's
position at time t, less the displacement of that part until then. Other parts that may arrive by then, and
the rotation of the nearest one, move relative to it with a bounded speed, the *drift*; the bounds of a
distance widen by drift times t.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from proximity.kernels.contact_record import IN_RANGE, INSIDE, PREDICTED
from proximity.kernels.geometry.frames import ROUNDED_UP, rounding_at
from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.scene.queries.distance_bounds import bounds_at, is_in_box_with_holes, may_pass_hole
from proximity.kernels.tracking.conservative_advancement import Sphere, advance_conservatively
from proximity.kernels.tracking.motion import predict
from proximity.kernels.tracking.part_drift import (
    Drift,
    contact_free_time,
    gather_near,
    part_travel,
)
from proximity.native import inlined

STILL = 1e-6
"""m/s. A slower motion is negligible within a horizon."""
CHEAP = 0.02
"""Share of the distance up to which a predicted displacement needs no traversal."""
LOOK_TOLERANCE = 0.1
"""Share of a clearance by which a query along the velocity may fall short: later steps make up for it, and
every traversal is shorter. Ten fingers among moving parts take a fifth fewer steps and are certified free for
5 % less of the time; with 0.3 for 14 % less. Five near a part with holes take 155 steps at p99 instead of
197. On a given path the contact's position counts, and queries are exact."""
STRIDE, LOOK_BUDGET = 8, 40
"""Steps of a finger along its velocity per tick after which no query begins, and at most; the next tick
continues from the stored balls. Without the limits one tick in a hundred takes 100 µs, with five fingers near
90 k free-form faces. With 40 instead of 8, five fingers near six parts took up to 1.8 times as long at p99,
and were certified free for 0.1 to 1.3 % more of the time. With a budget of 8 or 12, queries that end early
leave small balls: 1.1 times as long, for the same certified time."""
MIN_PREDICTION_STEPS = 4
"""Minimum for prediction and path each, when the distance has used the budget."""


class RelativeMotion(NamedTuple):
    """Motion of a finger relative to its nearest part, and bounds of the speeds of other parts."""

    part_velocity: tuple[float, float, float]  # m/s, of the nearest part at its closest point
    velocity: tuple[float, float, float]  # m/s, of the finger relative to part_velocity
    speed: float  # m/s, bound of the finger's relative speed
    drift: Drift  # of the parts that may arrive within the horizon
    fastest: float  # m/s, of all parts relative to the nearest, at any distance


@inlined
def steps_left(settings, record):
    """Return the remaining steps of a finger, limited by those that all fingers share for predictions."""
    own = max(np.int64(settings.budget) - np.int64(record.work), MIN_PREDICTION_STEPS)
    return min(own, np.int64(settings.prediction_steps_left))


@inlined
def count_steps(settings, record, steps):
    """Count the steps of a finger's prediction."""
    record.work += steps
    settings.prediction_steps_left -= steps


@inlined
def relative_motion(frames, settings, movers, finger, flags):
    """Return the `RelativeMotion` of a finger and its nearest part."""
    record = finger.record
    part_velocity = (0.0, 0.0, 0.0)
    if movers.moving_count and finger.track.slot >= 0:
        part_velocity = vector(record.part_velocity)
    ux, uy, uz = part_velocity
    own_speed = sqrt(dot(ux, uy, uz, ux, uy, uz)) * ROUNDED_UP
    least = own_speed if movers.any_stands else 0.0
    vx, vy, vz = (record.velocity[0] - ux, record.velocity[1] - uy, record.velocity[2] - uz)
    speed = sqrt(dot(vx, vy, vz, vx, vy, vz)) * ROUNDED_UP
    if not flags & PREDICTED:
        speed = settings.max_speed + own_speed
    near, fastest = np.int64(0), 0.0
    if movers.moving_count:
        x, y, z = vector(record.position)
        off = finger.track.radius + rounding_at(frames, x, y, z)
        near, fastest = gather_near(movers, part_velocity, (x, y, z), off, speed, 1.0, settings.horizon)
    drift = Drift(movers.rows, near, least)
    return RelativeMotion(part_velocity, (vx, vy, vz), speed, drift, max(fastest, least))


@inlined
def predict_distance(model, settings, finger, motion, ahead, flags, scratch):
    """Write the distance of a finger *ahead* seconds after its pose, with bounds."""
    record, radius = finger.record, finger.track.radius
    ahead = max(ahead, 0.0)
    # Predicted displacement of the finger relative to the part.
    dx, dy, dz, uncertainty = predict(finger.estimate, ahead, settings.max_speed, settings.max_acceleration)
    ux, uy, uz = motion.part_velocity
    dx, dy, dz = dx - ux * ahead, dy - uy * ahead, dz - uz * ahead
    length = sqrt(dot(dx, dy, dz, dx, dy, dz))
    distance, lower, upper = _distance_after(
        model, settings, finger, (dx, dy, dz), length, uncertainty, flags, scratch
    )
    # The fastest of all parts counts here: consumers that are late read from this spread how fast a surface
    # may approach.
    spread = uncertainty + motion.fastest * ahead
    if settings.has_holes != 0.0:
        x, y, z = vector(record.position)
        if may_pass_hole(model.frames, model.parts, x + dx, y + dy, z + dz, spread + length):
            # Through a hole the sign changes away from the surface: only the magnitude is bounded.
            upper = max(upper, -lower)
            lower = -upper
    record.predicted_distance = distance - radius
    # Infinitely far and infinitely fast: no lower bound.
    record.predicted_lower = lower - spread - radius if spread < np.inf else -np.inf
    record.predicted_upper = upper + spread - radius


@inlined
def _distance_after(model, settings, finger, displacement, length, uncertainty, flags, scratch):
    """Return distance, lower and upper bound, m, of a fingertip's centre after a displacement."""
    record, radius = finger.record, finger.track.radius
    part, slot = finger.track.part, finger.track.slot
    x, y, z = vector(record.position)
    dx, dy, dz = displacement
    distance = record.signed_distance + radius
    lower, upper = record.lower + radius, record.upper + radius
    stays_outside = not flags & INSIDE
    if stays_outside and settings.has_holes != 0.0:
        stays_outside = not is_in_box_with_holes(model, (x + dx, y + dy, z + dz))
    if not (length > 0.0 and slot >= 0):
        # Without a face to query: the distance changes by at most the displacement.
        return distance, lower - length, upper + length
    left = steps_left(settings, finger.record)
    # The predicted position is uncertain, and the surface need not be known more exactly.
    is_cheap = length <= CHEAP * lower or (length <= uncertainty and length < lower)
    if stays_outside and (is_cheap or not flags & IN_RANGE or left <= 0):
        # The present closest point bounds the distance from above, and is hardly farther than the new one.
        px, py, pz = vector(record.point_on_part)
        ax, ay, az = x + dx - px, y + dy - py, z + dz - pz
        distance = sqrt(dot(ax, ay, az, ax, ay, az))
        return distance, lower - length, distance
    distance, lower, upper, _, _, _, _, steps = bounds_at(
        model, (x + dx, y + dy, z + dz), part, slot, stays_outside and length < lower, CHEAP, radius, left,
        scratch.workspace, scratch.closest,
    )  # fmt: skip
    count_steps(settings, finger.record, steps)
    return distance, lower, upper


@inlined
def predict_time_to_contact(model, settings, finger, motion, path, flags, scratch):
    """Write the time to contact of a finger that keeps its velocity. *path*: scratch for two corners."""
    record = finger.record
    x, y, z = vector(record.position)
    horizon, speed, drift = settings.horizon, motion.speed, motion.drift
    # A finger that may touch already has no contact-free time, however slow it is.
    clearance = max(record.lower - rounding_at(model.frames, x, y, z), 0.0)
    if record.signed_distance <= 0.0:
        record.time_to_contact, record.time_to_contact_lower = 0.0, 0.0
        return
    # Motion beyond the working range is not of interest.
    if speed * horizon > settings.working_range:
        horizon = max(settings.working_range / speed, 0.1 * horizon)
    fastest, _ = part_travel(drift, speed, horizon)
    free = contact_free_time(drift, speed, clearance)
    if free >= horizon or speed + fastest < STILL:
        record.time_to_contact, record.time_to_contact_lower = np.inf, min(free, horizon)
        return
    closing = record.approach_speed
    expected = record.signed_distance / closing if closing > 0.0 and flags & PREDICTED else np.inf
    if flags & PREDICTED and flags & IN_RANGE and not flags & INSIDE:
        vx, vy, vz = motion.velocity
        corners, parameters = path
        corners[0, 0], corners[0, 1], corners[0, 2] = x, y, z
        corners[1, 0], corners[1, 1], corners[1, 2] = x + vx * horizon, y + vy * horizon, z + vz * horizon
        parameters[0], parameters[1] = 0.0, horizon
        sphere = Sphere(finger.track.radius, speed, finger.balls, settings.displacement)
        budget = min(steps_left(settings, finger.record), LOOK_BUDGET)
        advance = advance_conservatively(
            model, path, sphere, drift, 0.0, clearance, finger.track.part, finger.track.slot,
            LOOK_TOLERANCE, min(budget, STRIDE), budget, scratch,
        )  # fmt: skip
        free = max(free, advance.free)
        # If the path was not followed to its end or to a contact, the estimate from the nearest face stays.
        if free >= horizon or advance.expected < np.inf:
            expected = advance.expected
        count_steps(settings, finger.record, advance.steps)
    record.time_to_contact_lower = free
    record.time_to_contact = max(expected, free) if expected < horizon else np.inf
