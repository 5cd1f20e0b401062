"""What a tracker keeps from tick to tick, and what it hands to a tick: arrays behind one number.

A *track* is what is known about one finger: where it was asked for last, how far every surface was then, and
the nearest face. A distance changes by no more than finger and parts have moved since.
"""

import numpy as np

from proximity.kernels.advance import BALLS, BALLS_SIZE
from proximity.kernels.compiling import inlined, kernel
from proximity.kernels.contact import RECORD_INTS, RECORD_REALS
from proximity.kernels.layout import OWN_LOWER, ROTATION, TRANSLATION
from proximity.kernels.memory import ints_at, longs_at, reals_at, words_at
from proximity.kernels.motion import MOTION_INTS, MOTION_REALS

# --- columns of ``tracks`` (float64), a row a finger ---
ANCHOR = 0  # m, scene's frame: where CLEAR was found
CLEAR = 3  # m: every surface was at least so far from the anchor; negative: not known
ODOMETER = 4  # m: how far parts had moved until then
RADIUS = 5  # m, of the fingertip
TRACK_REALS = 8

# --- columns of ``marks`` (int64), a row a finger ---
SLOT = 0  # of the nearest face found last, or NO_SLOT
PART = 1  # its part
IS_OUTSIDE = 2  # 1 where no part held the anchor
TOLD_PART = 3  # part of the last answer
TRACK_INTS = 4

# --- ``settings`` (float64) ---
WORKING_RANGE = 0  # m
LATENCY = 1  # s
HORIZON = 2  # s
MAX_SPEED = 3  # m/s
MAX_ACCELERATION = 4  # m/s²
WAY = 5  # m that parts have moved since the tracker began; written by the tick
BUDGET = 6  # steps a finger
HAS_VELOCITIES = 7  # 1 where the caller gives velocities
HAS_PATHS = 8
HOLES = 9  # 1 where some part has an inside though it is not closed
MOVER_COUNT = 10  # parts that have a velocity; written by the tick
STANDS = 11  # 1 where some part has none
TOLERANCE = 14  # of a distance, see `Tracker`
AHEAD_LEFT = 12  # steps that are left for looking ahead, of all fingers; written by the tick
FIRST = 13  # finger that is done first, so that each has its turn; written by the tick
STEPS_LEFT = 15  # steps that are left for distances, of all fingers; written by the tick
PATIENCE = 16  # likewise, of a crowd; written by the tick
SETTINGS_SIZE = 17

FARTHEST_WAY = 1e3
"""m that parts may have moved until all tracks start anew: of larger sums, small steps are lost by rounding.
A part that is put far away and back goes so far at once."""
POSE_COLUMNS = 12
"""Of ``before``: rotation and translation of each part at the tick before."""

PLACE_AT, WAY_AT, STAGES_AT, SCRATCH_SIZE = 24, 40, 46, 48
"""Places in ``scratch``: a witness comes first, the stages of a path last."""
FINGER_COUNT, PATH_COUNT, PART_COUNT, MOVERS_SIZE, ROOM_COUNT = 0, 1, 2, 3, 4
FIRST_ADDRESS = 5
NAMES = (
    "settings",
    "positions",
    "pose_ns",
    "velocities",
    "paths",
    "path_bends",
    "bends",
    "motions",
    "motion_marks",
    "tracks",
    "marks",
    "balls",
    "records",
    "before",
    "movers",
    "room",
    "scratch",
)
"""Of the arrays, in the order of their addresses in the table."""
TABLE_SIZE = FIRST_ADDRESS + len(NAMES)


@kernel
def tracker_arrays_at(handle):
    """The arrays of the tracker whose table is at *handle*, in the order of `NAMES`.

    ``records`` comes three times: as float64, int64 and int32.
    """
    table = longs_at(handle, (TABLE_SIZE,))
    fingers, knots, parts, movers, room = (
        table[FINGER_COUNT],
        table[PATH_COUNT],
        table[PART_COUNT],
        table[MOVERS_SIZE],
        table[ROOM_COUNT],
    )
    at = FIRST_ADDRESS
    return (
        reals_at(table[at], (SETTINGS_SIZE,)),
        reals_at(table[at + 1], (fingers, 3)),
        longs_at(table[at + 2], (fingers,)),
        reals_at(table[at + 3], (fingers, 3)),
        reals_at(table[at + 4], (fingers, knots, 3)),
        reals_at(table[at + 5], (knots,)),
        reals_at(table[at + 6], (fingers,)),
        reals_at(table[at + 7], (fingers, MOTION_REALS)),
        longs_at(table[at + 8], (fingers, MOTION_INTS)),
        reals_at(table[at + 9], (fingers, TRACK_REALS)),
        longs_at(table[at + 10], (fingers, TRACK_INTS)),
        reals_at(table[at + 11], (fingers, BALLS_SIZE)),
        reals_at(table[at + 12], (fingers, RECORD_REALS)),
        longs_at(table[at + 12], (fingers, RECORD_REALS)),
        ints_at(table[at + 12], (fingers, RECORD_INTS)),
        reals_at(table[at + 13], (parts, POSE_COLUMNS)),
        reals_at(table[at + 14], (movers,)),
        words_at(table[at + 15], (room,)),
        reals_at(table[at + 16], (SCRATCH_SIZE + knots,)),
    )


@kernel
def forget_surfaces(tracks, balls):
    """Forget how far surfaces were, as no tick had been before."""
    for i in range(len(tracks)):
        tracks[i, CLEAR] = -1.0
        for ball in range(BALLS):
            balls[i, 3 * BALLS + ball] = -1.0


@inlined
def _shift_of_corner(frames, before, part, x, y, z):
    """Squared way of a point of the part from its pose *before* to the present one, m²."""
    total = 0.0
    for axis in range(3):
        at = ROTATION + 3 * axis
        way = (
            (frames[part, at] - before[part, 3 * axis]) * x
            + (frames[part, at + 1] - before[part, 3 * axis + 1]) * y
            + (frames[part, at + 2] - before[part, 3 * axis + 2]) * z
            + (frames[part, TRANSLATION + axis] - before[part, 9 + axis])
        )
        total += way * way
    return total


@kernel
def way_of_parts(frames, before):
    """How far any point of any part has moved at most since *before* (P, 12) was taken, m; takes it anew.

    The way of a point is a convex function of where on the part it is, so that a corner of the box goes
    farthest.
    """
    farthest_sq = 0.0
    for part in range(len(before)):
        has_moved = False
        for k in range(POSE_COLUMNS):
            has_moved |= frames[part, ROTATION + k] != before[part, k]
        if not has_moved:
            continue
        for corner in range(8):
            x = frames[part, OWN_LOWER + 3 * (corner & 1)]
            y = frames[part, OWN_LOWER + 1 + 3 * ((corner >> 1) & 1)]
            z = frames[part, OWN_LOWER + 2 + 3 * (corner >> 2)]
            farthest_sq = max(farthest_sq, _shift_of_corner(frames, before, part, x, y, z))
        for k in range(POSE_COLUMNS):
            before[part, k] = frames[part, ROTATION + k]
    return np.sqrt(farthest_sq) * (1.0 + 1e-12)
