"""What a tracker keeps from tick to tick, and what it hands to a tick: arrays behind one number.

A *track* is what is known about one finger: where it was asked for last, how far every surface was then, and
the nearest face. A distance changes by no more than finger and parts have moved since.
"""

import numpy as np

from proximity.kernels.compiler import inlined, kernel
from proximity.kernels.contact_columns import RECORD_INTS, RECORD_REALS
from proximity.kernels.layout import LANES, OWN_LOWER, ROTATION, TRANSLATION
from proximity.kernels.memory import Told, arrays_behind
from proximity.kernels.point.coherent_search import FRONT_SIZE
from proximity.kernels.tracking.conservative_advancement import BALLS, BALLS_SIZE
from proximity.kernels.tracking.motion import MOTION_INTS, MOTION_REALS
from proximity.simd import bits, load

# --- columns of ``tracks`` (float64), a row a finger ---
ANCHOR = 0  # m, scene's frame: where CLEAR was found
CLEAR = 3  # m: every surface was at least so far from the anchor; negative: not known
ODOMETER = 4  # m: how far parts had moved until then
RADIUS = 5  # m, of the fingertip
FOOT = 6  # m, scene's frame: the point of the surface that was told last
FOOT_FROM = 9  # m: where the finger was when it was the nearest of its face
FOOT_WAY = 12  # m: how far parts had moved then; negative where there is none
TRACK_REALS = 16

# --- columns of ``marks`` (int64), a row a finger ---
SLOT = 0  # of the nearest face found last, or NO_SLOT
PART = 1  # its part
IS_OUTSIDE = 2  # 1 where no part held the anchor
TOLD_PART = 3  # part of the last answer
FRONT_COUNT = 4  # of the front that is kept, see `front`; 0 for none; negative: ticks until one
TRACK_INTS = 5

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
LAST = POSE_COLUMNS - LANES
ALL_LANES = 2**LANES - 1

PLACE_AT, STAGES_AT, SCRATCH_SIZE = 24, 40, 42
"""Places in ``scratch``: a witness comes first, the stages of a path last."""
MOST_NS = 2**62
"""ns; it is 146 years. Differences of such instants, but for one from end to end, fit into 64 bits."""
EACH_ITS_OWN = -MOST_NS - 1
"""Instant of all poses: none, every finger has one of its own."""

FINGER_COUNT, PATH_COUNT, PART_COUNT, MOVERS_SIZE, ROOM_COUNT, SCRATCH_COUNT, FRONTS_COUNT = range(7)
FIRST_ADDRESS = 7
NAMES = (
    "settings",
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
    "fronts",
    "records",
    "before",
    "movers",
    "room",
    "scratch",
)
"""Of the arrays, in the order of their addresses in the table."""
FINGERS, KNOTS = Told(FINGER_COUNT), Told(PATH_COUNT)


def _address(name):
    return FIRST_ADDRESS + NAMES.index(name)


tracker_arrays_at = arrays_behind(
    ("float64", _address("settings"), (SETTINGS_SIZE,)),
    ("int64", _address("pose_ns"), (FINGERS,)),
    ("float64", _address("velocities"), (FINGERS, 3)),
    ("float64", _address("paths"), (FINGERS, KNOTS, 3)),
    ("float64", _address("path_bends"), (KNOTS,)),
    ("float64", _address("bends"), (FINGERS,)),
    ("float64", _address("motions"), (FINGERS, MOTION_REALS)),
    ("int64", _address("motion_marks"), (FINGERS, MOTION_INTS)),
    ("float64", _address("tracks"), (FINGERS, TRACK_REALS)),
    ("int64", _address("marks"), (FINGERS, TRACK_INTS)),
    ("float64", _address("balls"), (FINGERS, BALLS_SIZE)),
    ("float32", _address("fronts"), (Told(FRONTS_COUNT), FRONT_SIZE)),
    ("float64", _address("records"), (FINGERS, RECORD_REALS)),
    ("int64", _address("records"), (FINGERS, RECORD_REALS)),
    ("int32", _address("records"), (FINGERS, RECORD_INTS)),
    ("float64", _address("before"), (Told(PART_COUNT), POSE_COLUMNS)),
    ("float64", _address("movers"), (Told(MOVERS_SIZE),)),
    ("float32", _address("room"), (Told(ROOM_COUNT),)),
    ("float64", _address("scratch"), (Told(SCRATCH_COUNT),)),
)
"""The arrays of the tracker whose table is at an address, in the order of `NAMES`.

``records`` comes three times: as float64, int64 and int32.
"""


@kernel
def forget_surfaces(tracks, balls):
    """Forget how far surfaces were, as no tick had been before."""
    for i in range(len(tracks)):
        tracks[i, CLEAR], tracks[i, ODOMETER], tracks[i, FOOT_WAY] = -1.0, 0.0, -1.0
        for ball in range(BALLS):
            balls[i, 3 * BALLS + ball], balls[i, 4 * BALLS + ball] = -1.0, 0.0


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
        # Rotation and translation, which follow each other, by two vectors that overlap.
        is_first_same = load(frames[part], ROTATION) == load(before[part], 0)
        is_last_same = load(frames[part], ROTATION + LAST) == load(before[part], LAST)
        if bits(is_first_same & is_last_same) == ALL_LANES:
            continue
        for corner in range(8):
            x = frames[part, OWN_LOWER + 3 * (corner & 1)]
            y = frames[part, OWN_LOWER + 1 + 3 * ((corner >> 1) & 1)]
            z = frames[part, OWN_LOWER + 2 + 3 * (corner >> 2)]
            farthest_sq = max(farthest_sq, _shift_of_corner(frames, before, part, x, y, z))
        for k in range(POSE_COLUMNS):
            before[part, k] = frames[part, ROTATION + k]
    return np.sqrt(farthest_sq) * (1.0 + 1e-12)
