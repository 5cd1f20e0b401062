"""State of a tracker between ticks, and the arrays passed to a tick.

A *track* is the state of one finger: the position of its last search, the clearance found there, and the
nearest face. A distance changes by no more than finger and parts have moved since.
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
    anchor="(3,)f8",  # m, scene's frame: position of the search that found `clear`
    clear="f8",  # m: least distance of any surface from the anchor; negative: unknown
    odometer="f8",  # m: total displacement of the parts until then
    radius="f8",  # m, of the fingertip
    foot="(3,)f8",  # m, scene's frame: the surface point reported last
    foot_from="(3,)f8",  # m: position of the finger when that point was found
    foot_displacement="f8",  # m: total displacement of the parts then; negative: no point
    slot="i8",  # of the nearest face found last, or NO_SLOT
    part="i8",  # part of that face
    is_outside="i8",  # 1 if no part contained the anchor
    reported_part="i8",  # part reported last
    frontier_count="i8",  # stored nodes, see `coherent_search`; negative: ticks until the next attempt
)

SETTINGS = record(
    "Settings",
    working_range="f8",  # m
    latency="f8",  # s
    horizon="f8",  # s
    max_speed="f8",  # m/s
    max_acceleration="f8",  # m/s²
    displacement="f8",  # m, of the parts since the tracker started; written by the tick
    budget="f8",  # steps per finger
    has_velocities="f8",  # 1 if the caller gives velocities
    has_paths="f8",
    has_holes="f8",  # 1 if some part has an inside without being watertight
    mover_count="f8",  # parts that have a velocity; written by the tick
    any_stands="f8",  # 1 if some part has none
    prediction_steps_left="f8",  # remaining prediction steps of all fingers; written by the tick
    first_finger="f8",  # finger processed first, so that the order rotates; written by the tick
    tolerance="f8",  # of a distance, see `Tracker`
    steps_left="f8",  # remaining distance steps of all fingers; written by the tick
    adaptive_tolerance="f8",  # tolerance of a large set of fingers; written by the tick
    ahead_ns="f8",  # a pose farther in the future is reported
    other_clock_ns="f8",  # a pose farther from the tick, before or after, has another clock and is not used
)

MAX_DISPLACEMENT = 1e3
"""m of total part displacement after which all tracks restart: rounding loses small steps in larger sums. A
part moved very far away reaches it in one tick."""
MAX_NS = 2**62
"""ns; 146 years. Differences of times within it, except between its two ends, fit into 64 bits."""


class TrackerArrays(NamedTuple):
    """Arrays that a tick reads and writes, in addition to the model; arrays of N rows have one per finger."""

    settings: np.ndarray  # (1,) SETTINGS
    velocities: np.ndarray  # (N, 3) float64, m/s, as given
    paths: np.ndarray  # (N, K, 3) float64, m, scene's frame: corners; nan for none
    path_bends: np.ndarray  # (K,) float64, at the corners of all paths
    bends: np.ndarray  # (N,) float64, as given; nan: from the nearest point on the path
    path_lengths: np.ndarray  # (K,) float64, m: scratch, length of one path up to each corner
    motions: np.ndarray  # (N, 2) ESTIMATE, see `motion`
    tracks: np.ndarray  # (N,) TRACK
    balls: np.ndarray  # float64, see `conservative_advancement`
    frontiers: np.ndarray  # float32, see `coherent_search`; no rows for many fingers
    records: np.ndarray  # (N,) CONTACT_RECORD, the results
    unknown: np.ndarray  # (1,) CONTACT_RECORD, of a finger without a result
    before: np.ndarray  # (P, 12) float64, poses of the parts at the previous tick
    movers: np.ndarray  # float64, see `part_drift`
    workspace: np.ndarray  # float32, of searches, see `budgeted_walk`
    ignored: np.ndarray  # (N, P) bool, the parts that each finger ignores; (N, 0) where none ignores any
    heeded: np.ndarray  # (P + 1,) PART, scratch: the model's rows, as a finger heeds them; or as few


class Finger(NamedTuple):
    """The rows of one finger."""

    track: np.record  # TRACK
    estimate: np.record  # ESTIMATE, the present one
    balls: np.ndarray  # float64
    record: np.record  # CONTACT_RECORD, its result


class Scratch(NamedTuple):
    """Scratch memory of a search; no content passes from one finger to the next."""

    workspace: np.ndarray  # float32, see `budgeted_walk`
    closest: np.ndarray  # float64, see `closest_feature`
    vectors: np.ndarray  # (9,) float64: three vectors, documented by each function


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
    """Reset the distances of all tracks, keeping their faces."""
    for i in range(len(tracks)):
        tracks[i].clear, tracks[i].odometer, tracks[i].foot_displacement = -1.0, 0.0, -1.0
        for ball in range(BALL_COUNT):
            balls[i, 3 * BALL_COUNT + ball], balls[i, 4 * BALL_COUNT + ball] = -1.0, 0.0


@entry("Track[:], float64[:, :]")
def forget_surfaces(tracks, balls):
    """Reset the distances and nearest faces of all tracks to the state before the first tick."""
    forget_distances(tracks, balls)
    for i in range(len(tracks)):
        tracks[i].slot, tracks[i].part = NO_SLOT, NO_PART
        tracks[i].is_outside, tracks[i].frontier_count = 0, 0


@entry(ModelArrays, TrackerArrays)
def adopt_parts(model, arrays):
    """Reset the tracks for a model with other parts, and store their poses as those before the tick."""
    frames, parts, has_holes = model.frames, model.parts, False
    for part in range(len(parts) - 1):
        has_holes = has_holes or (parts[part].sign == SIGN_WINDING and parts[part].grid == NO_GRID)
        for k in range(9):
            arrays.before[part, k] = frames[part].rotation[k]
        for axis in range(3):
            arrays.before[part, 9 + axis] = frames[part].translation[axis]
    arrays.settings[0].has_holes = has_holes
    forget_surfaces(arrays.tracks, arrays.balls)
