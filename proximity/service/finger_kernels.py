"""Kernels of the service for all fingers at once: keep the newest samples, follow measured distances.

A *sample* of a finger is a row of ``values`` (float64, first column nan: nothing is known) and its instant.
"""

import math

import numpy as np

from proximity.kernels.tracking.motion import (
    JUMPED,
    REPEATED,
    STARTED,
    USABLE,
    instant_defect,
    observe_with_velocity,
    predict,
)
from proximity.native import entry, inlined

# --- columns of what `follow_distances` fills ---
FOLLOWED_STATUS = 0  # bits, as `motion.observe` answers
FOLLOWED_RATE = 1  # m/s, of the distance; zero while it is not known
FOLLOWED_STEP = 2  # m, by which the distance will have changed
FOLLOWED_SPREAD = 3  # m, by which that may be off
FOLLOWED_SIZE = 4

# --- columns of the error sums of a distance that is followed: sums of weight times squared error, m² ---
DISTANCE_ERROR = 0  # of the present track
DISTANCE_ERROR_BEFORE = 1  # of the one before the last jump, at most
ERROR_SUMS_SIZE = 2
LARGEST_DISTANCE_ERROR = 1e3
"""m: what is off by more is as good as not known, and must fade like others."""

REFUSED = 255
"""Defect of a sample that was refused before: it is not counted again."""
LOST = 254
"""Defect of a sample of a hand all fingers of which are at one position, as many programs send a lost one."""
HAND, FEWEST_FINGERS = 5, 3
"""Fingers in a row that are a hand; of fewer nobody can say that they are lost: two may touch."""


@inlined
def _is_lost(fingers, positions, row_of, given, count):
    """Whether all fingers of the hand of row *given*, three or more, are given at one position."""
    first = fingers[given] - fingers[given] % HAND
    last = min(first + HAND, count)
    if positions.shape[1] != 3 or last - first < FEWEST_FINGERS:
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
    """Take what is given of some *fingers* where it is newer, and write into *defects* why not, where not.

    Defects are those of `motion.instant_defect`. *refused_ns* (N,) keeps the instants of what is left out:
    the same sample again stays out, with the defect `REFUSED`. A sample of nan is taken, whatever its
    instant, and the newest instant stays: what comes next must still be newer than that. Of a hand that is
    `LOST` nothing is known. *row_of* (N,) is scratch.
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
    """Make the samples from before *oldest_ns* unknown."""
    for i in range(len(newest_ns)):
        if newest_ns[i] < oldest_ns:
            newest[i, 0] = np.nan


@inlined
def _distance_error(motions, error_sums, i, error, status, weight_before):
    """Error of a track's slope that errors of its distances can cause at most, m/s.

    The slope is the sum of weight times deviation of age times distance, over the sum of weight times squared
    deviation. By Cauchy and Schwarz errors change it by no more than this, whatever they are.
    """
    error_sq = min(error, LARGEST_DISTANCE_ERROR) ** 2 if error >= 0.0 else LARGEST_DISTANCE_ERROR**2
    weights = motions[i, 0].weights
    weight = weights[0]
    if status & STARTED:
        # After a jump the track may go on where it was.
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


@entry(
    "Estimate[:, 2], float64[:, :], int64[:], float64[:, :], float64[:], float64[:], int, float, float, "
    "float64[:, :]",
)
def follow_distances(
    motions, error_sums, measured_ns, distances, errors, rates, acts_ns, max_speed, max_acceleration, followed
):  # fmt: skip
    """Follow distances that were measured as `motion` follows a finger, along one axis; see `FOLLOWED_SIZE`.

    *rates* (N,), m/s, are of the distances; nan: to be estimated. *distances* (N, 1) of nan answer 0.
    *errors* (N,), m: how far off each distance may be; what is none is very far. *error_sums*
    (N, `ERROR_SUMS_SIZE`): what is kept of them, zeros at first. A rate that is reported is taken at its
    word.
    """
    for i in range(len(measured_ns)):
        present = motions[i, 0]
        weight_before = present.weights[0]
        status = observe_with_velocity(
            motions, i, measured_ns[i], distances[i, 0], 0.0, 0.0, (rates[i], 0.0, 0.0), max_speed,
            max_acceleration,
        )  # fmt: skip
        elapsed = 1e-9 * (acts_ns - measured_ns[i])
        if status:
            distance_error = _distance_error(motions, error_sums, i, errors[i], status, weight_before)
            if not (status & REPEATED or math.isfinite(rates[i])):
                present.velocity_error += distance_error
        step, _, _, spread = predict(present, elapsed, max_speed, max_acceleration)
        followed[i, FOLLOWED_STATUS], followed[i, FOLLOWED_RATE] = status, present.velocity[0]
        followed[i, FOLLOWED_STEP], followed[i, FOLLOWED_SPREAD] = step, spread
