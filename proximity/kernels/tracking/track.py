"""The state of a tracker between ticks, and the arrays that it hands to a tick.

A *track* is what is known about one finger: where it was asked for last, how far every surface was then, and
the nearest face. A distance changes by no more than finger and parts have moved since.
"""

from typing import NamedTuple

import numpy as np

from proximity.kernels.layout import NO_GRID, NO_PART, NO_SLOT, SIGN_WINDING, ModelArrays
from proximity.kernels.point.coherent_search import FRONTIER_SIZE
from proximity.kernels.tracking.conservative_advancement import BALL_COUNT, BALLS_SIZE
from proximity.kernels.tracking.motion import ESTIMATES
from proximity.kernels.tracking.part_drift import POSE_COLUMNS
from proximity.native import bundle, entry, inlined, record

TRACK = record(
    "Track",
    anchor="(3,)f8",  # m, scene's frame: where `clear` was found
    clear="f8",  # m: every surface was at least so far from the anchor; negative: not known
    odometer="f8",  # m: how far parts had moved until then
    radius="f8",  # m, of the fingertip
    foot="(3,)f8",  # m, scene's frame: the point of the surface that was reported last
    foot_from="(3,)f8",  # m: where the finger was when it was the nearest of its face
    foot_displacement="f8",  # m: how far parts had moved then; negative where there is none
    slot="i8",  # of the nearest face found last, or NO_SLOT
    part="i8",  # its part
    is_outside="i8",  # 1 where no part held the anchor
    reported_part="i8",  # part of the last answer
    frontier_count="i8",  # nodes kept, see `coherent_search`; negative: ticks until the next try
)

SETTINGS = record(
    "Settings",
    working_range="f8",  # m
    latency="f8",  # s
    horizon="f8",  # s
    max_speed="f8",  # m/s
    max_acceleration="f8",  # m/s²
    displacement="f8",  # m that parts have moved since the tracker began; written by the tick
    budget="f8",  # steps a finger
    has_velocities="f8",  # 1 where the caller gives velocities
    has_paths="f8",
    has_holes="f8",  # 1 where some part has an inside though it is not closed
    mover_count="f8",  # parts that have a velocity; written by the tick
    any_stands="f8",  # 1 where some part has none
    prediction_steps_left="f8",  # steps left for predictions, of all fingers; written by the tick
    first_finger="f8",  # finger that is done first, so that each has its turn; written by the tick
    tolerance="f8",  # of a distance, see `Tracker`
    steps_left="f8",  # steps that are left for distances, of all fingers; written by the tick
    adaptive_tolerance="f8",  # likewise, of a crowd; written by the tick
    ahead_ns="f8",  # a pose farther in the future is reported
    other_clock_ns="f8",  # a pose farther from the tick, either way, is of another clock, and not used
)

MOST_DISPLACEMENT = 1e3
"""m that parts may have moved until all tracks start anew: of larger sums, small steps are lost by rounding.
A part that is put far away and back goes so far at once."""
MOST_NS = 2**62
"""ns; it is 146 years. Differences of such instants, but for one from end to end, fit into 64 bits."""


class TrackerArrays(NamedTuple):
    """All that a tick reads and writes, beside the model; arrays of many rows have one a finger."""

    settings: np.ndarray  # (1,) SETTINGS
    velocities: np.ndarray  # (N, 3) float64, m/s, as given
    paths: np.ndarray  # (N, K, 3) float64, m, scene's frame: corners; nan for none
    path_bends: np.ndarray  # (K,) float64, at the corners of all paths
    bends: np.ndarray  # (N,) float64, as given; nan: the nearest on the path
    path_lengths: np.ndarray  # (K,) float64, m: scratch, along one path up to each corner
    motions: np.ndarray  # (N, 2) ESTIMATE, see `motion`
    tracks: np.ndarray  # (N,) TRACK
    balls: np.ndarray  # float64, see `conservative_advancement`
    frontiers: np.ndarray  # float32, see `coherent_search`; no rows for a crowd
    records: np.ndarray  # (N,) CONTACT_RECORD, the answers
    unknown: np.ndarray  # (1,) CONTACT_RECORD, of a finger of which nothing is known
    before: np.ndarray  # (P, 12) float64, poses of the parts at the tick before
    movers: np.ndarray  # float64, see `part_drift`
    workspace: np.ndarray  # float32, of searches, see `budgeted_walk`
    ignored: np.ndarray  # (N, P) bool, the parts that each finger ignores; (N, 0) where none ignores any
    heeded: np.ndarray  # (P + 1,) PART, scratch: the model's rows, as a finger heeds them; or as few


class Finger(NamedTuple):
    """The rows of one finger."""

    track: np.record  # TRACK
    estimate: np.record  # ESTIMATE, the present one
    balls: np.ndarray  # float64
    record: np.record  # CONTACT_RECORD, its answer


class Scratch(NamedTuple):
    """Scratch memory of a search; nothing in it is kept from one finger to the next."""

    workspace: np.ndarray  # float32, see `budgeted_walk`
    closest: np.ndarray  # float64, see `closest_feature`
    vectors: np.ndarray  # (9,) float64: three vectors, for each function to say which


bundle(
    TrackerArrays,
    settings="Settings[1]",
    velocities="float64[:, 3]",
    paths="float64[:, :, 3]",
    path_bends="float64[:]",
    bends="float64[:]",
    path_lengths="float64[:]",
    motions=f"Estimate[:, {ESTIMATES}]",
    tracks="Track[:]",
    balls=f"float64[:, {BALLS_SIZE}]",
    frontiers=f"float32[:, {FRONTIER_SIZE}]",
    records="Contact[:]",
    unknown="Contact[1]",
    before=f"float64[:, {POSE_COLUMNS}]",
    movers="EightMovers[:]",
    workspace="float32[:]",
    ignored="bool[:, :]",
    heeded="Part[:]",
)


@inlined
def begin_heeding(model, arrays):
    """Copy the rows of parts, if some finger ignores any."""
    if arrays.ignored.shape[1]:
        for row in range(len(model.parts)):
            arrays.heeded[row] = model.parts[row]


@inlined
def heeded_by(model, arrays, i):
    """The model as finger *i* heeds it; until that of the next finger is asked for."""
    if not arrays.ignored.shape[1]:
        return model
    heeded, scene = arrays.heeded, len(model.parts) - 1
    heeded[scene].is_hidden = 0
    for part in range(scene):
        heeded[part].is_hidden = model.parts[part].is_hidden
        if arrays.ignored[i, part]:
            heeded[part].is_hidden = heeded[scene].is_hidden = 1
    return ModelArrays(model.reals, model.words, model.frames, heeded)


@inlined
def forget_distances(tracks, balls):
    """Forget how far surfaces were."""
    for i in range(len(tracks)):
        tracks[i].clear, tracks[i].odometer, tracks[i].foot_displacement = -1.0, 0.0, -1.0
        for ball in range(BALL_COUNT):
            balls[i, 3 * BALL_COUNT + ball], balls[i, 4 * BALL_COUNT + ball] = -1.0, 0.0


@entry("Track[:], float64[:, :]")
def forget_surfaces(tracks, balls):
    """Forget how far surfaces were, and which faces are near, as no tick had been before."""
    forget_distances(tracks, balls)
    for i in range(len(tracks)):
        tracks[i].slot, tracks[i].part = NO_SLOT, NO_PART
        tracks[i].is_outside, tracks[i].frontier_count = 0, 0


@entry(ModelArrays, TrackerArrays)
def adopt_parts(model, arrays):
    """Have ticks answer from a model of other parts: tracks begin anew, and poses are those before a tick."""
    frames, parts, has_holes = model.frames, model.parts, False
    for part in range(len(parts) - 1):
        has_holes = has_holes or (parts[part].sign == SIGN_WINDING and parts[part].grid == NO_GRID)
        for k in range(9):
            arrays.before[part, k] = frames[part].rotation[k]
        for axis in range(3):
            arrays.before[part, 9 + axis] = frames[part].translation[axis]
    arrays.settings[0].has_holes = has_holes
    forget_surfaces(arrays.tracks, arrays.balls)
