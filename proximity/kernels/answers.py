"""Answers that kernels write and Python reads: a row per point, ray or segment, a record per pair."""

from typing import NamedTuple

import numpy as np

from proximity.native import bundle, record

# --- points: float64 ---
POINT_ANSWER_SIGNED_DISTANCE = 0
POINT_ANSWER_POINT = 1
POINT_ANSWER_GRADIENT = 4
POINT_ANSWER_BARYCENTRIC = 7
POINT_ANSWER_REALS = 10
# followed by int32
POINT_ANSWER_PART = 2 * POINT_ANSWER_REALS
POINT_ANSWER_FACE = POINT_ANSWER_PART + 1
POINT_ANSWER_FEATURE = POINT_ANSWER_PART + 2
POINT_ANSWER_IS_SIGNED = POINT_ANSWER_PART + 3
POINT_ANSWER_WIDTH = POINT_ANSWER_REALS + 2
"""Width of a row in float64."""

# --- rays: float64 ---
RAY_ANSWER_DISTANCE = 0
RAY_ANSWER_POINT = 1
RAY_ANSWER_NORMAL = 4
RAY_ANSWER_BARYCENTRIC = 7
RAY_ANSWER_REALS = 10
# followed by int32
RAY_ANSWER_PART = 2 * RAY_ANSWER_REALS
RAY_ANSWER_FACE = RAY_ANSWER_PART + 1
RAY_ANSWER_WIDTH = RAY_ANSWER_REALS + 1
"""Width of a row in float64."""
CROSSING_IS_ENTERING = RAY_ANSWER_FACE + 1
"""Third int32 of a crossing; the fourth is unused."""
CROSSING_WIDTH = RAY_ANSWER_REALS + 2
DISTANCE_WIDTH = 1
"""Width in float64 of a row that holds only the distance."""

# --- segments: float64 ---
SEGMENT_ANSWER_DISTANCE = 0
SEGMENT_ANSWER_POINT_ON_SEGMENT = 1
SEGMENT_ANSWER_POINT_ON_SOLID = 4
SEGMENT_ANSWER_FRACTION = 7
SEGMENT_ANSWER_BARYCENTRIC = 8
SEGMENT_ANSWER_REALS = 11
# followed by int32
SEGMENT_ANSWER_PART = 2 * SEGMENT_ANSWER_REALS
SEGMENT_ANSWER_FACE = SEGMENT_ANSWER_PART + 1
SEGMENT_ANSWER_WIDTH = SEGMENT_ANSWER_REALS + 1
"""Width of a row in float64."""

# --- pairs of parts ---
APART, TOUCHES, CROSSES, FIRST_INSIDE, SECOND_INSIDE = range(5)
CLEARANCE_ANSWER = record(
    "ClearanceAnswer",
    lower="f8",  # m: no two points of the parts are nearer
    distance="f8",  # m
    points="(6,)f8",  # m, scene's frame: one on each part
    faces="(2,)i4",
    relation="i4",  # one of the five above
    may_be_inside="i4",  # 1 until `decide_inside` if boxes overlap and no surfaces cross
)
DEPTH_ANSWER = record(
    "DepthAnswer",
    lower="f8",  # m: no shorter displacement separates the parts
    upper="f8",  # m: this displacement separates them
    normal="(3,)f8",  # scene's frame: normal of the contact at *upper*, towards the first part, or 0
    steps="i8",
)
PAIR_SEARCH = record(
    "PairSearch",
    limit="f8",  # m: farther pairs are left out; less when all rows are filled
    only="i8",  # pairs of this part; -1: of all visible ones
    waiting="i8",  # pairs in the heap
    found="i8",  # rows that are filled
)


class PairSearchArrays(NamedTuple):
    """Arrays that the search for the nearest pairs reads and writes."""

    search: np.ndarray  # (1,) PAIR_SEARCH
    gaps: np.ndarray  # (N,) float64, m: a heap of all pairs, by the gap and then the number
    numbers: np.ndarray  # (N,) int64: of each pair, first part * P + second part
    faces: np.ndarray  # see `containment.Surfaces`
    ranges: np.ndarray
    pairs: np.ndarray  # (K, 2) int32: the parts of each row
    answers: np.ndarray  # (K,) CLEARANCE_ANSWER


bundle(
    PairSearchArrays,
    search="PairSearch[:]",
    gaps="float64[:]",
    numbers="int64[:]",
    faces="int32[:]",
    ranges="int64[:, 2]",
    pairs="int32[:, 2]",
    answers="ClearanceAnswer[:]",
)

EXIT_ANSWER = record(
    "ExitAnswer",
    depth="f8",  # m: this displacement along the direction separates the parts
    lower="f8",  # m: no shorter displacement along it does
    direction="(3,)f8",  # unit, scene's frame
    normal="(3,)f8",  # normal of the second part at the last contact, or 0
    steps="i8",
)
DEEPEST_ANSWER = record(
    "DeepestAnswer",
    lower="f8",  # m: a point is at least this deep
    upper="f8",  # m: no point is deeper
    point="(3,)f8",  # m, scene's frame
    steps="i8",
)
