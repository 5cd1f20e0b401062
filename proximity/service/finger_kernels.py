"""Kernels that select the newest samples of all fingers and track measured distances.

A *sample* of a finger is a row of ``values`` (float64, with nan in the first column if unknown) and its
instant.
"""

import math

import numpy as np

from proximity.kernels.contact_record import (
    BOUNDED,
    EXACT,
    IN_RANGE,
    JUMPED,
    MODE_FORCE,
    MODE_POSITION,
    MODE_RETRACT,
    PREDICTED,
    SIGNED,
    SURFACE_DEFORMABLE,
    TRACKED,
)
from proximity.kernels.tracking.motion import (
    REPEATED,
    STARTED,
    USABLE,
    instant_defect,
    observe_with_velocity,
    predict,
)
from proximity.native import entry, inlined, record

# --- columns of the error sums of a tracked distance, each a sum of weight times squared error, m² ---
DISTANCE_ERROR = 0  # sum of the present track
DISTANCE_ERROR_BEFORE = 1  # upper bound for the track before the last jump
ERROR_SUMS_SIZE = 2
MAX_DISTANCE_ERROR = 1e3
"""Limit of the error of a distance, m. A larger error makes a distance useless, and must decay like
others."""

OBSERVED = TRACKED | PREDICTED | JUMPED
"""Flags derived from successive distances."""

MEASUREMENT_RECORD = record(
    "Measurement",
    finger="u4",
    surface="u1",
    force_is_valid="u1",
    reserved="(2,)u1",
    measured_ns="i8",
    signed_distance="f8",
    error="f8",
    position="(3,)f8",
    velocity="(3,)f8",
    normal="(3,)f8",
    approach_speed="f8",
    bend="f8",
    bend_rate="f8",
    force="f8",
    stiffness="f8",
    damping="f8",
)
"""Measurement of a finger, with the fields of `message.MEASUREMENT`; a test compares both."""
REFUSED = 255
"""Defect of a sample that was refused before and is not counted again."""
LOST = 254
"""Defect of a sample of a hand whose fingers all have one position, as sensors report a lost hand."""
HAND, MIN_FINGERS = 5, 3
"""Number of fingers of a hand in a row, and minimum number that marks a lost hand. Two fingers may touch."""


@inlined
def _is_lost(fingers, positions, row_of, given, count):
    """Return whether all fingers of a hand have the same position, as the fingers of a lost hand do.

    The hand is that of the sample in row *given*. Fewer than three fingers are never lost.
    """
    first = fingers[given] - fingers[given] % HAND
    last = min(first + HAND, count)
    if positions.shape[1] != 3 or last - first < MIN_FINGERS:
        return False
    for finger in range(first, last):
        row = row_of[finger]
        if row >= len(fingers) or fingers[row] != finger:
            return False
        for axis in range(3):
            if positions[row, axis] != positions[given, axis]:
                return False
    return True


@entry(
    "int64[:], float64[:, :], int64[:], int64[:], int64[:], int64[:], float64[:, :], uint8[:], int, int",
)
def update_newest(
    newest_ns, newest, refused_ns, row_of, fingers, given_ns, given, defects, oldest_ns, latest_ns
):
    """Copy the samples that are newer than the stored ones, and write the defects of the others.

    The defects are those of `motion.instant_defect`. A hand whose fingers all have one position has the
    defect `LOST` and becomes unknown. *refused_ns* (N,) stores the instants of refused samples: a repeated
    one is refused again, with the defect `REFUSED`. A sample of nan is accepted at any instant and does not
    change the newest instant, so later samples must still be newer. *row_of* (N,) is scratch memory.
    """
    for row in range(len(fingers)):
        row_of[fingers[row]] = row
    for row in range(len(fingers)):
        finger = fingers[row]
        defects[row] = USABLE
        is_known = True
        for column in range(newest.shape[1]):
            is_known &= math.isfinite(given[row, column])
        if is_known and _is_lost(fingers, given, row_of, row, len(newest_ns)):
            is_known = False
            defects[row] = LOST
        if not is_known:
            newest[finger, 0] = np.nan
            continue
        if given_ns[row] == refused_ns[finger]:
            defects[row] = REFUSED
        elif given_ns[row] != newest_ns[finger]:
            defects[row] = instant_defect(given_ns[row], newest_ns[finger], oldest_ns, latest_ns)
        if defects[row] != USABLE:
            refused_ns[finger] = given_ns[row]
            continue
        newest_ns[finger] = given_ns[row]
        for column in range(newest.shape[1]):
            newest[finger, column] = given[row, column]


@entry("int64[:], float64[:, :], int")
def drop_stale(newest_ns, newest, oldest_ns):
    """Set samples older than *oldest_ns* to unknown."""
    for i in range(len(newest_ns)):
        if newest_ns[i] < oldest_ns:
            newest[i, 0] = np.nan


@inlined
def _distance_error(motions, error_sums, i, error, status, weight_before):
    """Return the maximum error of a track's slope that errors of its distances can cause, m/s.

    The slope is the sum of weight times deviation of age times distance, divided by the sum of weight times
    squared deviation. The bound follows from the Cauchy-Schwarz inequality.
    """
    error_sq = min(error, MAX_DISTANCE_ERROR) ** 2 if error >= 0.0 else MAX_DISTANCE_ERROR**2
    weights = motions[i, 0].weights
    weight = weights[0]
    if status & STARTED:
        # After a jump the track may continue from its old position.
        error_sums[i, DISTANCE_ERROR_BEFORE] = (
            max(error_sums[i, DISTANCE_ERROR], error_sums[i, DISTANCE_ERROR_BEFORE])
            if status & JUMPED
            else 0.0
        )
        error_sums[i, DISTANCE_ERROR] = error_sq
    elif status & JUMPED:
        error_sums[i, DISTANCE_ERROR] = error_sums[i, DISTANCE_ERROR_BEFORE] + error_sq
    elif not status & REPEATED:
        error_sums[i, DISTANCE_ERROR] = (weight - 1.0) / weight_before * error_sums[
            i, DISTANCE_ERROR
        ] + error_sq
    spread = weight * weights[2] - weights[1] * weights[1]
    return math.sqrt(error_sums[i, DISTANCE_ERROR] * weight / spread) if spread > 0.0 else 0.0


@inlined
def _follow(motions, error_sums, i, measured_ns, distance, measured, acts_ns, max_speed, max_acceleration):
    """Track a distance along one axis as `motion` tracks a finger. Return status, rate, step and its spread.

    A reported rate is used unchanged. The *step*, m, is the expected change of the distance, and the spread
    its maximum error.
    """
    present = motions[i, 0]
    weight_before, rate = present.weights[0], -measured.approach_speed
    status = observe_with_velocity(
        motions, i, measured_ns, distance, 0.0, 0.0, (rate, 0.0, 0.0), max_speed,
        max_acceleration,
    )  # fmt: skip
    if status:
        distance_error = _distance_error(motions, error_sums, i, measured.error, status, weight_before)
        if not (status & REPEATED or math.isfinite(rate)):
            present.velocity_error += distance_error
    step, _, _, spread = predict(present, 1e-9 * (acts_ns - measured_ns), max_speed, max_acceleration)
    return status, present.velocity[0], step, spread


@inlined
def _write_distances(contact, measured, status, rate, step, spread):
    """Write the measured and the predicted distance with their bounds and flags."""
    distance, error = measured.signed_distance, measured.error
    flags = status & OBSERVED | SIGNED | IN_RANGE
    if not 0.0 <= error < np.inf:
        error = np.inf
        flags |= BOUNDED
    if error == 0.0:
        flags |= EXACT
    contact.signed_distance, contact.predicted_distance = distance, distance + step
    contact.lower, contact.upper = distance - error, distance + error
    contact.predicted_lower = contact.lower + (step - spread)
    contact.predicted_upper = contact.upper + (step + spread)
    contact.approach_speed = -rate if status & PREDICTED else np.nan
    contact["flags"] = flags


@inlined
def _write_times(contact, is_predicted, horizon, max_speed):
    """Write the time to contact at the present speed, and a lower bound of that time."""
    clearance = max(contact.lower, 0.0)
    closing = contact.approach_speed if is_predicted else max_speed
    free, expected = horizon if clearance > 0.0 else 0.0, np.inf
    if closing > 0.0:
        free = min(clearance / closing, horizon)
        if is_predicted and contact.signed_distance / closing <= horizon:
            expected = contact.signed_distance / closing
    if contact.signed_distance <= 0.0:
        free = expected = 0.0
    contact.time_to_contact, contact.time_to_contact_lower = expected, free


@inlined
def _write_surface(contact, measured):
    """Write the response of the object to contact, and the advised mode of the controller."""
    has_force = measured.force_is_valid != 0 and math.isfinite(measured.force)
    is_deformable = measured.surface == SURFACE_DEFORMABLE
    contact.surface, contact.force_is_valid = measured.surface, 1 if has_force else 0
    contact.force = measured.force if has_force else 0.0
    contact.stiffness = measured.stiffness if is_deformable and math.isfinite(measured.stiffness) else 0.0
    contact.damping = measured.damping if is_deformable and math.isfinite(measured.damping) else 0.0
    contact.mode = MODE_RETRACT
    if contact.time_to_contact < np.inf:
        contact.mode = MODE_FORCE if is_deformable else MODE_POSITION


@inlined
def _write_bend(contact, measured):
    """Write the bend and, if it can be predicted, the bend at contact.

    The prediction needs the bend rate and the time to contact.
    """
    bend, rate, left = measured.bend, measured.bend_rate, contact.time_to_contact
    contact.bend, contact.bend_rate, reached = bend, rate, np.nan
    if left < np.inf and rate > 0.0 and bend + rate * left <= 1.0:
        reached = bend + rate * left
    if contact.signed_distance <= 0.0:
        reached = bend
    contact.contact_bend, contact.contact_bend_error = reached, np.nan
    if not math.isnan(reached):
        contact.contact_bend_error = (
            0.0 if contact.signed_distance <= 0.0 and contact.upper <= 0.0 else np.inf
        )


@entry(
    "Estimate[:, 2], float64[:, :], int64[:], float64[:, :], Measurement[:], Contact[:], Contact[:], int, "
    "int, float, float, float",
)
def sense_contacts(
    motions, error_sums, measured_ns, distances, measured, contacts, unknown, now_ns, latency_ns, horizon,
    max_speed, max_acceleration,
):  # fmt: skip
    """Compute contacts from the newest measured distances.

    *distances* (N, 1) are nan where unknown; those rows of *measured* are ignored, and the contacts are
    copied from *unknown*. *error_sums* (N, `ERROR_SUMS_SIZE`) is the state of the error bounds, initially 0.
    """
    acts_ns = now_ns + latency_ns
    for i in range(len(measured_ns)):
        contact, reported = contacts[i], measured[i]
        contacts[i] = unknown[i]
        status, rate, step, spread = _follow(
            motions, error_sums, i, measured_ns[i], distances[i, 0], reported, acts_ns, max_speed,
            max_acceleration,
        )  # fmt: skip
        if status:
            _write_distances(contact, reported, status, rate, step, spread)
            _write_times(contact, status & PREDICTED != 0, horizon, max_speed)
            for axis in range(3):
                contact.position[axis] = reported.position[axis]
                contact.velocity[axis] = reported.velocity[axis]
                contact.normal[axis] = reported.normal[axis]
            _write_surface(contact, reported)
            _write_bend(contact, reported)
        contact.pose_ns, contact.age_ns = measured_ns[i], now_ns - measured_ns[i]
        contact.predicted_ns = max(acts_ns, measured_ns[i])
