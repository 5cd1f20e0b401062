"""One tick: every finger against every part.

For each finger: take its pose in; bound the distance, by a walk or, out of the working range, by what was
known and how far finger and parts have moved since. Then, for each again, look ahead (`ahead`): the code of
either half is more than the nearest cache holds, and a skin's tick takes 3 to 5 % less in halves.
"""

from math import isfinite, sqrt

import numpy as np

from proximity.kernels.compiler import inlined, kernel
from proximity.kernels.contact_columns import (
    AGE_NS,
    APPROACH_SPEED,
    CONTACT_BEND,
    DAMPING,
    FACE,
    FLAGS,
    FORCE,
    FORCE_VALID_BIT,
    IN_RANGE,
    INSIDE,
    KINDS,
    LOWER,
    MODE_BIT,
    MODE_FORCE,
    MODE_HOLD,
    MODE_POSITION,
    MODE_RETRACT,
    NORMAL,
    PART,
    PART_CHANGED,
    PART_VELOCITY,
    POINT_ON_FINGER,
    POINT_ON_PART,
    POSE_NS,
    POSITION,
    PREDICTED,
    PREDICTED_LOWER,
    PREDICTED_NS,
    PREDICTED_UPPER,
    RECORD_REALS,
    SIGNED,
    SIGNED_DISTANCE,
    SKIPPED,
    STIFFNESS,
    SURFACE_DEFORMABLE,
    TIME_TO_CONTACT,
    TIME_TO_CONTACT_LOWER,
    TRACKED,
    UPPER,
    VELOCITY,
    WORK,
)
from proximity.kernels.geometry.closest_feature import (
    LENGTH,
    POINT,
    WITNESS_SIZE,
    closest_on_triangle,
    pseudo_normal,
)
from proximity.kernels.geometry.closest_feature import NORMAL as WITNESS_NORMAL
from proximity.kernels.geometry.frames import (
    FARTHEST,
    ROUNDING,
    is_alone,
    rounding_at,
    to_local,
    to_scene,
    turn_to_scene,
)
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.given import FLAG, GIVEN_ROWS, INTEGER, row_count, rows_of
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    IS_FUSED,
    LANES,
    NO_FACE,
    NO_PART,
    SCALE,
    SIGN,
    SIGN_NONE,
    SLOT_FACES,
    SURFACE,
)
from proximity.kernels.layout import DAMPING as PART_DAMPING
from proximity.kernels.layout import STIFFNESS as PART_STIFFNESS
from proximity.kernels.memory import arrays_at, real_rows_here
from proximity.kernels.point.coherent_search import BEGINS, LONG, nearest_from_last_answer
from proximity.kernels.scene.distance_bounds import (
    beyond_all,
    bounds_at,
    bounds_of_nearest,
    fill_witness,
    may_slip_in,
)
from proximity.kernels.tracking.conservative_advancement import outward_of
from proximity.kernels.tracking.motion import VELOCITY as ESTIMATE
from proximity.kernels.tracking.motion import observe, observe_with_velocity
from proximity.kernels.tracking.part_drift import gather_movers, velocity_of_part
from proximity.kernels.tracking.prediction import foretell, look_along_path
from proximity.kernels.tracking.track import (
    AHEAD_LEFT,
    ANCHOR,
    BUDGET,
    CLEAR,
    EACH_ITS_OWN,
    FARTHEST_WAY,
    FIRST,
    FOOT,
    FOOT_FROM,
    FOOT_WAY,
    FRONT_COUNT,
    HAS_PATHS,
    HAS_VELOCITIES,
    HOLES,
    IS_OUTSIDE,
    LATENCY,
    MAX_ACCELERATION,
    MAX_SPEED,
    MOST_NS,
    MOVER_COUNT,
    ODOMETER,
    PATIENCE,
    PLACE_AT,
    RADIUS,
    SCRATCH_SIZE,
    SLOT,
    STAGES_AT,
    STANDS,
    STEPS_LEFT,
    TOLD_PART,
    TOLERANCE,
    WAY,
    WORKING_RANGE,
    forget_surfaces,
    tracker_arrays_at,
    way_of_parts,
)
from proximity.kernels.tracking.track import PART as TRACK_PART
from proximity.simd import load_int, prefetch

FLAG_BITS = (1 << 16) - 1
"""Of an observation's answer: what goes into the record."""
CROWD = 10
"""Fingers of two hands: more than that are a crowd."""
SHARED_BUDGETS, FEWEST_BUDGETS = 20, 8
AHEAD = 4
"""Budgets that all fingers share in a tick: for distances, and for looking ahead. Two hands never come to the
end of them; a skin of thousands would be late. Who finds none left goes by what it knows, within bounds, and
is among the first at the next tick."""
MANY, PRESENCE = 500, 4
"""Steps that each finger beyond so many takes the time of, not searched for: so many fewer are shared."""
LEAST_PATIENCE, MOST_PATIENCE = 1e-3, 0.5
MORE_PATIENCE, LESS_PATIENCE = 1.1, 0.99
"""In a crowd bounds may be apart by some share of the distance, which grows when no steps are left and fades
when there are: so all are as well known as can be, for how far they are. Turns regardless of that left points
within 20 mm of a skin with bounds 9.5 mm apart (p99; 3.8 with this), with half again as many steps."""
EASE = 0.4
"""Of what bounds may be apart, the share that a search in a crowd leaves them apart, rather than going on. A
skin whose bounds may be 5 % apart wants less than half the steps that it wants with 0, to the same bounds on
average."""
SHORT, PAUSE = 2, 200
"""Divisor of the budget: what a front may take of it, and a search for one to be begun. Where it does not get
done in that, none is tried for so many ticks, which matters from a million faces on."""
STRAY = 1.0 / 16.0
"""Share of its distance that a finger may go until the point of the surface that is told is looked for anew:
meanwhile it is up to 0.2 % farther than the nearest. Ticks of fingers far off take a seventh less so."""
FEWEST_STEPS = 8
"""For the distance of a finger of which nothing is known, when none are left."""


@inlined
def steps_for_all(budget, count):
    """Steps that so many fingers share in a tick for their distances."""
    return max(SHARED_BUDGETS * budget - PRESENCE * max(count - MANY, 0), FEWEST_BUDGETS * budget)


@inlined
def _patience_after(patience, steps_left):
    """The share by which bounds may be apart at the next tick."""
    if steps_left <= 0.0:
        return min(max(patience, LEAST_PATIENCE) * MORE_PATIENCE, MOST_PATIENCE)
    return patience * LESS_PATIENCE if patience > LEAST_PATIENCE else 0.0


@inlined
def _clear_record(records, wide, numbers, i):
    for column in range(RECORD_REALS):
        records[i, column] = np.nan
    records[i, LOWER], records[i, UPPER] = -np.inf, np.inf
    records[i, PREDICTED_LOWER], records[i, PREDICTED_UPPER] = -np.inf, np.inf
    records[i, TIME_TO_CONTACT_LOWER] = 0.0
    records[i, STIFFNESS], records[i, DAMPING], records[i, FORCE] = 0.0, 0.0, 0.0
    wide[i, 0] = i
    numbers[i, PART], numbers[i, FACE], numbers[i, WORK], numbers[i, KINDS] = NO_PART, NO_FACE, 0, 0


@inlined
def _fetch_face(reals, marks, i):
    """Have the face that a finger starts from brought from memory, while another finger is done."""
    if marks[i, SLOT] >= 0:
        base = BLOCK_STRIDE * (marks[i, SLOT] // LANES)
        for line in range(BLOCK_STRIDE // 8):
            prefetch(reals, base + 8 * line)


@inlined
def _carried(frames, settings, tracks, i, x, y, z):
    """A distance, m, within which there is still no surface: what was clear less what has moved."""
    dx, dy, dz = x - tracks[i, ANCHOR], y - tracks[i, ANCHOR + 1], z - tracks[i, ANCHOR + 2]
    moved = sqrt(dx * dx + dy * dy + dz * dz) + (settings[WAY] - tracks[i, ODOMETER])
    return tracks[i, CLEAR] - moved * (1.0 + ROUNDING) - rounding_at(frames, x, y, z)


@inlined
def _to_foot(settings, tracks, i, x, y, z, place):
    """The distance, m, to the point of the surface that was told last, and whether that still tells enough.

    Fills *place*: outward direction, and the point.
    """
    if tracks[i, FOOT_WAY] != settings[WAY]:
        return 0.0, False
    dx, dy, dz = x - tracks[i, FOOT], y - tracks[i, FOOT + 1], z - tracks[i, FOOT + 2]
    ax, ay, az = x - tracks[i, FOOT_FROM], y - tracks[i, FOOT_FROM + 1], z - tracks[i, FOOT_FROM + 2]
    length_sq = dot(dx, dy, dz, dx, dy, dz)
    if not (length_sq > 1e-200 and dot(ax, ay, az, ax, ay, az) <= STRAY * STRAY * length_sq):
        return 0.0, False
    length = sqrt(length_sq)
    factor = 1.0 / length
    place[0], place[1], place[2] = factor * dx, factor * dy, factor * dz
    place[3], place[4], place[5] = tracks[i, FOOT], tracks[i, FOOT + 1], tracks[i, FOOT + 2]
    return length, True


@inlined
def _find_foot(reals, words, frames, parts, part, slot, bits, witness, settings, tracks, i, x, y, z, place):
    """Fill *place* with what lies at the end of a filled witness: outward direction, and the point."""
    outward_of(frames, parts, part, witness, place)
    if witness[LENGTH] <= 1e-150:
        px, py, pz = to_local(frames, parts, part, x, y, z)
        feature, which = closest_on_triangle(px, py, pz, witness)
        face = load_int(words, parts[part, SLOT_FACES] + slot)
        pseudo_normal(reals, words, parts, part, face, feature, which, witness)
        turn_to_scene(frames, parts, part, witness, WITNESS_NORMAL, place, 0)
    elif bits & INSIDE:
        for axis in range(3):
            place[axis] = -place[axis]
    to_scene(frames, parts, part, witness, POINT, place, 3)
    tracks[i, FOOT], tracks[i, FOOT + 1], tracks[i, FOOT + 2] = place[3], place[4], place[5]
    tracks[i, FOOT_FROM], tracks[i, FOOT_FROM + 1], tracks[i, FOOT_FROM + 2] = x, y, z
    tracks[i, FOOT_WAY] = settings[WAY]


@inlined
def _write_surface(frames, part, i, radius, records, place):
    """Write what *place* tells: points, normal, velocities."""
    vx, vy, vz = velocity_of_part(frames, part, place[3], place[4], place[5])
    place[6], place[7], place[8] = vx, vy, vz
    closing = 0.0
    for axis in range(3):
        records[i, NORMAL + axis] = place[axis]
        records[i, POINT_ON_PART + axis] = place[3 + axis]
        records[i, POINT_ON_FINGER + axis] = records[i, POSITION + axis] - radius * place[axis]
        records[i, PART_VELOCITY + axis] = place[6 + axis]
        closing -= place[axis] * (records[i, VELOCITY + axis] - place[6 + axis])
    records[i, APPROACH_SPEED] = closing
    records[i, STIFFNESS] = frames[part, PART_STIFFNESS]
    records[i, DAMPING] = frames[part, PART_DAMPING]


@inlined
def _search(
    reals, words, frames, parts, marks, fronts, i, x, y, z, part, slot, is_outside, is_moved, ease, radius,
    budget, room, witness,
):  # fmt: skip
    """As `bounds_at`: from the front of the finger's last search where it has one, by a walk otherwise."""
    best_sq, is_found, steps = 0.0, False, np.int64(0)
    # A part with a frame of its own is walked as a whole, and gains nothing.
    may_keep = len(fronts) > 0 and slot >= 0 and not is_moved
    may_keep = may_keep and (parts[part, IS_FUSED] == 1 or is_alone(parts))
    kept = marks[i, FRONT_COUNT]
    if may_keep and (kept > 0 or kept == BEGINS):
        best_sq, part, slot, is_found, marks[i, FRONT_COUNT], steps = nearest_from_last_answer(
            (reals, words, frames, parts), (x, y, z), part, slot, fronts[i], kept, budget // SHORT, room
        )
    if is_found:
        nearest = best_sq, part, slot, best_sq, steps
        return bounds_of_nearest(
            (reals, words, frames, parts), (x, y, z), nearest, is_outside, budget, room, witness
        )
    distance, lower, upper, clear, part, slot, bits, work = bounds_at(
        (reals, words, frames, parts), (x, y, z), part, slot, is_outside, ease, radius, budget - steps, room,
        witness,
    )  # fmt: skip
    work += steps
    if steps > 0:  # in vain
        marks[i, FRONT_COUNT] = -PAUSE
    elif kept < BEGINS - 1:
        marks[i, FRONT_COUNT] = kept + 1
    else:
        marks[i, FRONT_COUNT] = BEGINS if may_keep and LONG <= work <= budget // SHORT else 0
    return distance, lower, upper, clear, part, slot, bits, work


@inlined
def _distance(
    reals, words, frames, parts, settings, tracks, marks, fronts, records, numbers, i, x, y, z, flags,
    is_moved, room, witness, place,
):  # fmt: skip
    """Write distance, bounds and surface of one finger; the flags."""
    radius = tracks[i, RADIUS]
    part, slot = marks[i, TRACK_PART], marks[i, SLOT]
    carried = _carried(frames, settings, tracks, i, x, y, z)
    is_outside = marks[i, IS_OUTSIDE] == 1 and carried > 0.0
    if is_outside and settings[HOLES] != 0.0:
        is_outside = not may_slip_in(words, frames, parts, x, y, z)
    work, left = np.int64(0), np.int64(settings[STEPS_LEFT])
    budget = min(np.int64(settings[BUDGET]), max(left, FEWEST_STEPS))
    is_far = is_outside and carried - radius > settings[WORKING_RANGE]
    is_near_enough, has_foot = False, False
    upper = np.inf
    tolerance = max(settings[TOLERANCE], settings[PATIENCE])
    if is_far or (is_outside and (tolerance > 0.0 or left <= 0)):
        if slot >= 0:
            upper, has_foot = _to_foot(settings, tracks, i, x, y, z, place)
            if not has_foot:
                upper = fill_witness(reals, words, parts, frames, part, slot, x, y, z, witness)
        elif carried < np.inf:
            upper = beyond_all(frames, x, y, z)
        is_near_enough = left <= 0 or upper - carried <= tolerance * (carried - radius)
    if is_far or is_near_enough:
        bits, lower, distance = SKIPPED, min(carried, upper), upper
        if slot >= 0 and parts[part, SIGN] != SIGN_NONE:
            bits |= SIGNED
    else:
        has_foot = False
        ease = EASE * tolerance if len(tracks) > CROWD else 0.0
        distance, lower, upper, clear, part, slot, bits, work = _search(
            reals, words, frames, parts, marks, fronts, i, x, y, z, part, slot, is_outside, is_moved, ease,
            radius, budget, room, witness,
        )  # fmt: skip
        settings[STEPS_LEFT] -= work
        tracks[i, ANCHOR], tracks[i, ANCHOR + 1], tracks[i, ANCHOR + 2] = x, y, z
        tracks[i, CLEAR], tracks[i, ODOMETER] = clear, settings[WAY]
        marks[i, TRACK_PART], marks[i, SLOT] = part, slot
        marks[i, IS_OUTSIDE] = 0 if bits & INSIDE else 1
    records[i, SIGNED_DISTANCE] = distance - radius
    records[i, LOWER], records[i, UPPER] = lower - radius, upper - radius
    numbers[i, WORK] = work
    if slot >= 0:
        numbers[i, PART], numbers[i, FACE] = part, load_int(words, parts[part, SLOT_FACES] + slot)
        numbers[i, KINDS] = np.int64(frames[part, SURFACE])
        if not has_foot:
            _find_foot(
                reals, words, frames, parts, part, slot, bits, witness, settings, tracks, i, x, y, z, place
            )
        _write_surface(frames, part, i, radius, records, place)
    if distance - radius <= settings[WORKING_RANGE]:
        bits |= IN_RANGE
    return flags | bits


@inlined
def _advise(records, numbers, i):
    """Write what the controller is advised to do, and with what force a deformable part answers a touch."""
    is_deformable = numbers[i, KINDS] == SURFACE_DEFORMABLE
    is_touching = records[i, SIGNED_DISTANCE] <= 0.0
    mode = MODE_RETRACT
    if is_touching or records[i, TIME_TO_CONTACT] < np.inf or records[i, CONTACT_BEND] < np.inf:
        mode = MODE_FORCE if is_deformable else MODE_POSITION
    numbers[i, KINDS] |= mode << MODE_BIT
    if is_deformable and is_touching:
        damped = records[i, DAMPING] * records[i, APPROACH_SPEED]
        force = max(0.0, damped - records[i, STIFFNESS] * records[i, SIGNED_DISTANCE])
        if isfinite(force):
            records[i, FORCE] = force
            numbers[i, KINDS] |= 1 << FORCE_VALID_BIT


TICK = (INTEGER, INTEGER, GIVEN_ROWS, INTEGER, INTEGER, FLAG)


@kernel
def tick(handle, tracker, places, all_pose_ns, now_ns, is_moved):
    """Fill the records of the tracker at address *tracker* for the model at *handle*; whether that was done.

    It is not done, and nothing is changed, where *places* are not (fingers, 3) in C order, or instants are
    beyond `MOST_NS`. *all_pose_ns*: instant of the positions, or `EACH_ITS_OWN`. *is_moved*: whether parts
    may stand elsewhere than at the tick before.
    """
    reals, words, frames, parts = arrays_at(handle)
    (
        settings,
        pose_ns,
        velocities,
        paths,
        path_bends,
        bends,
        motions,
        motion_marks,
        tracks,
        marks,
        balls,
        fronts,
        records,
        wide,
        numbers,
        before,
        movers,
        room,
        scratch,
    ) = tracker_arrays_at(tracker)
    count = len(marks)
    if row_count(places) != count or not -MOST_NS <= now_ns <= MOST_NS:
        return False
    if all_pose_ns != EACH_ITS_OWN and not -MOST_NS <= all_pose_ns <= MOST_NS:
        return False
    positions = rows_of(places)
    if is_moved:
        for i in range(count):
            marks[i, FRONT_COUNT] = 0
        settings[WAY] = (settings[WAY] + way_of_parts(frames, before)) * (1.0 + 2.0**-52)
        if not settings[WAY] <= FARTHEST_WAY:
            settings[WAY] = 0.0
            forget_surfaces(tracks, balls)
        settings[MOVER_COUNT], settings[STANDS] = gather_movers(frames, parts, movers)
    mover_count, stands = np.int64(settings[MOVER_COUNT]), settings[STANDS] != 0.0
    latency_ns = np.int64(1e9 * settings[LATENCY])
    acts_ns = now_ns + latency_ns
    reach = FARTHEST / frames[len(parts) - 1, SCALE]
    witness, place = scratch[:WITNESS_SIZE], scratch[PLACE_AT:STAGES_AT]
    way, stages = real_rows_here(2, 3), scratch[STAGES_AT:SCRATCH_SIZE]
    path_stages = scratch[SCRATCH_SIZE:]
    first = np.int64(settings[FIRST])
    settings[STEPS_LEFT] = steps_for_all(settings[BUDGET], count)
    settings[AHEAD_LEFT] = AHEAD * settings[BUDGET]
    late = count  # turn of the first who finds no steps left
    for turn in range(count):
        i = (first + turn) % count
        _fetch_face(reals, marks, (i + 1) % count)
        if settings[STEPS_LEFT] <= 0.0:
            late = min(late, turn)
        # First of all: somebody may give places that the last tick has written.
        x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
        _clear_record(records, wide, numbers, i)
        taken_ns = pose_ns[i] if all_pose_ns == EACH_ITS_OWN else np.int64(all_pose_ns)
        wide[i, POSE_NS], wide[i, AGE_NS] = taken_ns, now_ns - max(taken_ns, 1 - MOST_NS)
        wide[i, PREDICTED_NS] = max(acts_ns, taken_ns)
        records[i, POSITION], records[i, POSITION + 1], records[i, POSITION + 2] = x, y, z
        if settings[HAS_VELOCITIES] != 0.0:
            flags = observe_with_velocity(
                motions, motion_marks, i, taken_ns, x, y, z,
                velocities[i, 0], velocities[i, 1], velocities[i, 2],
                settings[MAX_SPEED], settings[MAX_ACCELERATION],
            )  # fmt: skip
        else:
            flags = observe(
                motions, motion_marks, i, taken_ns, x, y, z, settings[MAX_SPEED], settings[MAX_ACCELERATION]
            )
        flags &= FLAG_BITS
        if not (flags & TRACKED and abs(x) <= reach and abs(y) <= reach and abs(z) <= reach):
            numbers[i, FLAGS] = flags & ~(TRACKED | PREDICTED)
            numbers[i, KINDS] = MODE_HOLD << MODE_BIT
            marks[i, TOLD_PART] = NO_PART
            continue
        for axis in range(3):
            records[i, VELOCITY + axis] = motions[i, ESTIMATE + axis]
        flags = _distance(
            reals, words, frames, parts, settings, tracks, marks, fronts, records, numbers, i, x, y, z, flags,
            is_moved, room, witness, place,
        )  # fmt: skip
        if marks[i, TOLD_PART] != numbers[i, PART] and marks[i, TOLD_PART] != NO_PART:
            flags |= PART_CHANGED
        marks[i, TOLD_PART] = numbers[i, PART]
        numbers[i, FLAGS] = flags
    for turn in range(count):
        i = (first + turn) % count
        if settings[AHEAD_LEFT] <= 0.0:
            late = min(late, turn)
        flags = np.int64(numbers[i, FLAGS])
        if not flags & TRACKED:
            continue
        foretell(
            reals, words, frames, parts, settings, motions, tracks, marks, balls[i], records, numbers, movers,
            mover_count, stands, i, 1e-9 * (float(wide[i, AGE_NS]) + float(latency_ns)), flags, room, witness,
            way, stages, place,
        )  # fmt: skip
        if settings[HAS_PATHS] != 0.0 and isfinite(paths[i, 0, 0]):
            flags = look_along_path(
                reals, words, frames, parts, settings, paths[i], path_bends, bends[i], tracks, marks,
                balls[i], records, numbers, movers, mover_count, i, flags, room, witness, path_stages, place,
            )  # fmt: skip
        numbers[i, FLAGS] = flags
        _advise(records, numbers, i)
    settings[FIRST] = (first + late) % count if late < count else 0.0
    settings[PATIENCE] = _patience_after(settings[PATIENCE], settings[STEPS_LEFT])
    return True
