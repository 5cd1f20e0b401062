"""Records of a tracked part: its pairs, its settings, and the reported connections."""

from typing import NamedTuple

import numpy as np

from proximity.kernels.traverse.dual_first import SIDE as SIDE  # numbers of `sides` per entry
from proximity.native import bundle, record

FRONTIER_ENTRIES = 32_768
"""Total of all frontiers: 2.5 MB at 76 bytes each; unused pages occupy no memory."""
MIN_FRONTIERS, MAX_FRONTIERS = 4, 32
"""Limits of the number of frontiers, otherwise one per pair of parts."""
CROSSING_PARTS = 4096
"""A flag in addition to those of `contact_record`: the two surfaces intersect, and the parts share volume."""
OWN_INSIDE, OTHER_INSIDE = 1, 2

HELD_PAIR = record(
    "HeldPair",
    own="i8",  # row of a tracked part
    other="i8",  # row of another part
    slots="(2,)i8",  # of the nearest triangles found last, or `NO_SLOT`
    lower="f8",  # m: lower bound of the distance between the surfaces
    upper="f8",  # m: upper bound of that distance
    speed="f8",  # m/s: bound of the speed of a point of one part relative to the other
    free_time="f8",  # s: the surfaces do not meet before
    depth="f8",  # m, as found last; 0: none
    normal="(3,)f8",  # direction in which the tracked part separates, as found last; or 0
    frontier="i8",  # of `HeldArrays`, or -1
    frontier_count="i8",  # its entries; 0: not usable; negative: searches until the next attempt
    frontier_turn="(9,)f8",  # map from the other part's local frame when it was last used
    frontier_offset="(3,)f8",
    is_resolved="i8",  # 1 if this tick has searched the pair
    is_timed="i8",  # `TIMED` if this tick has found the free time, `MAY_OPEN` if it must find it
    is_opening="i8",  # 1 if the parts touch and separate, unless one is inside the other
    is_crossing="i8",  # 1 if the surfaces intersect and the parts share volume
    is_touching="i8",  # 1 if the surfaces touch and certainly do not cross
    is_inside="i8",  # `OWN_INSIDE` or `OTHER_INSIDE` if one is inside the other
    is_unsure="i8",  # 1 if the surfaces may have met since containment was decided
    is_undecided="i8",  # 1 if containment is to be decided after this tick
)

HELD_SETTINGS = record(
    "HeldSettings",
    working_range="f8",  # m
    tolerance="f8",  # share of the distance by which bounds may differ
    latency="f8",  # s, from a tick until its result is used
    horizon="f8",  # s
    budget="i8",  # steps per tick; 0: unlimited
    group="i8",  # number of tracked parts
    is_predicted="i8",  # 1 if the velocities are known
    pose_ns="i8",
    now_ns="i8",
    work="i8",  # steps of this tick; written by it
    frontier_count="i8",
    frontier_length="i8",  # its entries
    next_frontier="i8",  # the frontier that is assigned next; written by the tick
    unsure="i8",  # pairs whose containment must be decided; written by the tick
    opening="i8",  # opening pairs whose containment must be decided; written by the tick
    free_time="f8",  # s: no surfaces meet before; written by the tick
    last_ns="i8",  # instant of the last given pose; written by `move_group`
    has_last="i8",  # 1 if there is one; written by `move_group`
)

CONNECTION_RECORD = record(
    "Connection",
    flags="u4",
    work="u4",
    part="i4",
    own_part="i4",
    face="i4",
    own_face="i4",
    pose_ns="i8",
    age_ns="i8",
    distance="f8",
    lower="f8",
    upper="f8",
    point_on_own="(3,)f8",
    point_on_part="(3,)f8",
    normal="(3,)f8",
    approach_speed="f8",
    predicted_ns="i8",
    predicted_distance="f8",
    predicted_lower="f8",
    predicted_upper="f8",
    time_to_contact="f8",
    time_to_contact_lower="f8",
    depth="f8",
    depth_lower="f8",
)
"""The record of one connection; `tracker.connections` documents its fields."""


class HeldArrays(NamedTuple):
    """Arrays that the tick of a tracked part reads and writes."""

    settings: np.ndarray  # (1,) HELD_SETTINGS
    pairs: np.ndarray  # (others * group,) HELD_PAIR; those of one other part are adjacent
    records: np.ndarray  # (K,) CONNECTION_RECORD
    before: np.ndarray  # (P, 12) float64: poses at the last tick
    moved: np.ndarray  # (P,) float64: displacement of each part since
    limits: np.ndarray  # (FRONTIER_ENTRIES,) float64: see `dual_first`
    entries: np.ndarray  # (FRONTIER_ENTRIES, 3) int32
    sides: np.ndarray  # (SIDE * FRONTIER_ENTRIES,) float64
    own: np.ndarray  # (group,) int64: rows of the tracked parts
    faces: np.ndarray  # see `containment.Surfaces`
    ranges: np.ndarray


bundle(
    HeldArrays,
    settings="HeldSettings[:]",
    pairs="HeldPair[:]",
    records="Connection[:]",
    before="float64[:, 12]",
    moved="float64[:]",
    limits="float64[:]",
    entries="int32[:, 3]",
    sides="float64[:]",
    own="int64[:]",
    faces="int32[:]",
    ranges="int64[:, 2]",
)
