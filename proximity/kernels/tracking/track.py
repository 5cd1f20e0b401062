"""The state of a tracker between ticks, and the arrays that it hands to a tick.

A *track* is what is known about one finger: where it was asked for last, how far every surface was then, and
the nearest face. A distance changes by no more than finger and parts have moved since.
"""

from typing import NamedTuple

import numpy as np

from proximity.kernels.contact_columns import RECORD_INTS, RECORD_REALS
from proximity.kernels.point.coherent_search import FRONTIER_SIZE
from proximity.kernels.tracking.conservative_advancement import BALL_COUNT, BALLS_SIZE
from proximity.kernels.tracking.motion import MOTION_INTS, MOTION_REALS
from proximity.kernels.tracking.part_drift import POSE_COLUMNS
from proximity.native import bundle, entry, inlined

# --- columns of ``tracks`` (float64), a row a finger ---
TRACK_ANCHOR = 0  # m, scene's frame: where TRACK_CLEAR was found
TRACK_CLEAR = 3  # m: every surface was at least so far from the anchor; negative: not known
TRACK_ODOMETER = 4  # m: how far parts had moved until then
TRACK_RADIUS = 5  # m, of the fingertip
TRACK_FOOT = 6  # m, scene's frame: the point of the surface that was reported last
TRACK_FOOT_FROM = 9  # m: where the finger was when it was the nearest of its face
TRACK_FOOT_DISPLACEMENT = 12  # m: how far parts had moved then; negative where there is none
TRACK_REALS = 16

# --- columns of ``marks`` (int64), a row a finger ---
TRACK_SLOT = 0  # of the nearest face found last, or NO_SLOT
TRACK_PART = 1  # its part
TRACK_IS_OUTSIDE = 2  # 1 where no part held the anchor
TRACK_REPORTED_PART = 3  # part of the last answer
TRACK_FRONTIER_COUNT = (
    4  # nodes of the frontier kept, see `coherent_search`; negative: ticks until the next try
)
TRACK_INTS = 5

# --- ``settings`` (float64) ---
SETTING_WORKING_RANGE = 0  # m
SETTING_LATENCY = 1  # s
SETTING_HORIZON = 2  # s
SETTING_MAX_SPEED = 3  # m/s
SETTING_MAX_ACCELERATION = 4  # m/s²
SETTING_DISPLACEMENT = 5  # m that parts have moved since the tracker began; written by the tick
SETTING_BUDGET = 6  # steps a finger
SETTING_HAS_VELOCITIES = 7  # 1 where the caller gives velocities
SETTING_HAS_PATHS = 8
SETTING_HAS_HOLES = 9  # 1 where some part has an inside though it is not closed
SETTING_MOVER_COUNT = 10  # parts that have a velocity; written by the tick
SETTING_ANY_STANDS = 11  # 1 where some part has none
SETTING_TOLERANCE = 14  # of a distance, see `Tracker`
SETTING_PREDICTION_STEPS_LEFT = 12  # steps left for predictions, of all fingers; written by the tick
SETTING_FIRST_FINGER = 13  # finger that is done first, so that each has its turn; written by the tick
SETTING_STEPS_LEFT = 15  # steps that are left for distances, of all fingers; written by the tick
SETTING_ADAPTIVE_TOLERANCE = 16  # likewise, of a crowd; written by the tick
SETTING_AHEAD_NS = 17  # a pose farther in the future is reported
SETTING_OTHER_CLOCK_NS = 18  # a pose farther from the tick, either way, is of another clock, and not used
SETTING_COUNT = 19

MOST_DISPLACEMENT = 1e3
"""m that parts may have moved until all tracks start anew: of larger sums, small steps are lost by rounding.
A part that is put far away and back goes so far at once."""
MOST_NS = 2**62
"""ns; it is 146 years. Differences of such instants, but for one from end to end, fit into 64 bits."""


class TrackerArrays(NamedTuple):
    """All that a tick reads and writes, beside the model; arrays of many rows have one a finger."""

    settings: np.ndarray  # float64, see above
    velocities: np.ndarray  # (N, 3) float64, m/s, as given
    paths: np.ndarray  # (N, K, 3) float64, m, scene's frame: corners; nan for none
    path_bends: np.ndarray  # (K,) float64, at the corners of all paths
    bends: np.ndarray  # (N,) float64, as given; nan: the nearest on the path
    path_lengths: np.ndarray  # (K,) float64, m: scratch, along one path up to each corner
    motions: np.ndarray  # float64, see `motion`
    motion_marks: np.ndarray  # int64, see `motion`
    tracks: np.ndarray  # float64, see above
    marks: np.ndarray  # int64, see above
    balls: np.ndarray  # float64, see `conservative_advancement`
    frontiers: np.ndarray  # float32, see `coherent_search`; no rows for a crowd
    records: np.ndarray  # float64, the answers, see `contact_columns`
    wide: np.ndarray  # int64, the same memory
    numbers: np.ndarray  # int32, the same memory
    before: np.ndarray  # (P, 12) float64, poses of the parts at the tick before
    movers: np.ndarray  # float64, see `part_drift`
    workspace: np.ndarray  # float32, of searches, see `budgeted_walk`


class Finger(NamedTuple):
    """The rows of one finger."""

    track: np.ndarray  # float64, see above
    marks: np.ndarray  # int64, see above
    balls: np.ndarray  # float64
    record: np.ndarray  # float64, its answer
    numbers: np.ndarray  # int32, the same memory


class Scratch(NamedTuple):
    """Scratch memory of a search; nothing in it is kept from one finger to the next."""

    workspace: np.ndarray  # float32, see `budgeted_walk`
    closest: np.ndarray  # float64, see `closest_feature`
    vectors: np.ndarray  # (9,) float64: three vectors, for each function to say which


@inlined
def finger_at(arrays, i):
    """The rows of finger *i*."""
    return Finger(arrays.tracks[i], arrays.marks[i], arrays.balls[i], arrays.records[i], arrays.numbers[i])


@inlined
def vector_at(row, column):
    """Three numbers of a row, from *column* on."""
    return row[column], row[column + 1], row[column + 2]


bundle(
    TrackerArrays,
    settings=f"float64[{SETTING_COUNT}]",
    velocities="float64[:, 3]",
    paths="float64[:, :, 3]",
    path_bends="float64[:]",
    bends="float64[:]",
    path_lengths="float64[:]",
    motions=f"float64[:, {MOTION_REALS}]",
    motion_marks=f"int64[:, {MOTION_INTS}]",
    tracks=f"float64[:, {TRACK_REALS}]",
    marks=f"int64[:, {TRACK_INTS}]",
    balls=f"float64[:, {BALLS_SIZE}]",
    frontiers=f"float32[:, {FRONTIER_SIZE}]",
    records=f"float64[:, {RECORD_REALS}]",
    wide=f"int64[:, {RECORD_REALS}]",
    numbers=f"int32[:, {RECORD_INTS}]",
    before=f"float64[:, {POSE_COLUMNS}]",
    movers="float64[:]",
    workspace="float32[:]",
)


@entry("float64[:, :], float64[:, :]")
def forget_surfaces(tracks, balls):
    """Forget how far surfaces were, as no tick had been before."""
    for i in range(len(tracks)):
        tracks[i, TRACK_CLEAR], tracks[i, TRACK_ODOMETER], tracks[i, TRACK_FOOT_DISPLACEMENT] = (
            -1.0,
            0.0,
            -1.0,
        )
        for ball in range(BALL_COUNT):
            balls[i, 3 * BALL_COUNT + ball], balls[i, 4 * BALL_COUNT + ball] = -1.0, 0.0
