"""Records of a part that is followed: its pairs, its settings, and the connections that are answered."""

from typing import NamedTuple

import numpy as np

from proximity.native import bundle, record

FRONTIER_ENTRIES = 32_768
"""Of all frontiers together: with 20 bytes each, 655 KB."""
FEWEST_FRONTIERS, MOST_FRONTIERS = 4, 32
"""As many as there are pairs of parts, within these limits."""
CROSSING_PARTS = 4096
"""A bit next to those of `contact_record`: the surfaces of the two parts meet, and they share volume."""
OWN_INSIDE, OTHER_INSIDE = 1, 2

HELD_PAIR = record(
    "HeldPair",
    own="i8",  # row of a part that is followed
    other="i8",  # row of one of the rest
    slots="(2,)i8",  # of the nearest triangles found last, or `NO_SLOT`
    lower="f8",  # m: no two points of the surfaces are nearer
    upper="f8",  # m: the surfaces are no farther apart
    speed="f8",  # m/s: of a point of one part as the other sees it, at most
    free_time="f8",  # s: the surfaces do not meet before
    depth="f8",  # m, as found last; 0: none
    normal="(3,)f8",  # along which the part that is followed moves away, as found last; or 0
    frontier="i8",  # of `HeldArrays`, or -1
    frontier_count="i8",  # its entries; 0: it is of no use
    frontier_moved="f8",  # m that anything has moved since it was looked at
    is_resolved="i8",  # 1 where this tick has looked
    is_timed="i8",  # `TIMED` where it has found how long they do not meet, `MAY_OPEN` where it has to
    is_opening="i8",  # 1 where they touch and come free, if neither part is inside the other
    is_crossing="i8",  # 1 where surfaces meet and both share volume
    is_touching="i8",  # 1 where surfaces meet and certainly do not cross
    is_inside="i8",  # `OWN_INSIDE` or `OTHER_INSIDE` where one is inside the other
    is_unsure="i8",  # 1 where surfaces may have met since inside and outside were decided
    is_undecided="i8",  # 1 where inside and outside are to be decided after this tick
)

HELD_SETTINGS = record(
    "HeldSettings",
    working_range="f8",  # m
    tolerance="f8",  # share of the distance by which bounds may differ
    latency="f8",  # s, from a tick until its answer is used
    horizon="f8",  # s
    budget="i8",  # steps a tick; 0: as many as it takes
    group="i8",  # parts that are followed
    is_predicted="i8",  # 1 where the velocities are known
    pose_ns="i8",
    now_ns="i8",
    work="i8",  # steps of this tick; written by it
    frontier_count="i8",
    frontier_length="i8",  # its entries
    next_frontier="i8",  # the one that is given away next; written by it
    unsure="i8",  # pairs of which it must be asked whether one part is inside the other; likewise
    opening="i8",  # pairs that are opening, and of which it must be asked; likewise
    free_time="f8",  # s: nothing is met before; likewise
    last_ns="i8",  # of the pose given last; written by `move_group`
    has_last="i8",  # 1 where there is one; likewise
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
"""The record of one connection; `tracker.connections` says what is in it."""


class HeldArrays(NamedTuple):
    """What a tick of a part that is followed reads and writes."""

    settings: np.ndarray  # (1,) HELD_SETTINGS
    pairs: np.ndarray  # (others * group,) HELD_PAIR; those of one of the rest together
    records: np.ndarray  # (K,) CONNECTION_RECORD
    before: np.ndarray  # (P, 12) float64: poses at the last tick
    moved: np.ndarray  # (P,) float64: how far parts have moved since
    limits: np.ndarray  # (FRONTIER_ENTRIES,) float64: see `dual_first`
    entries: np.ndarray  # (FRONTIER_ENTRIES, 3) int32
    own: np.ndarray  # (group,) int64: rows of the parts that are followed
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
    own="int64[:]",
    faces="int32[:]",
    ranges="int64[:, 2]",
)
