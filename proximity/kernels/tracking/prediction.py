"""What a finger will meet: the distance when the controller acts, and time and place of the next contact.

All questions go to the scene as it stands at the tick. A way in time is followed relative to the nearest
part: the place of the finger at time t, less what that part has moved until then. Other parts that can have
come by then, and the turning of that one, move at some speed at most relative to it, the *drift*, and a
distance found is less certain by drift times t.
"""

from math import isfinite, sqrt

import numpy as np

from proximity.kernels.compiler import inlined, kernel
from proximity.kernels.contact_columns import (
    APPROACH_SPEED,
    BEND,
    BEND_RATE,
    CONTACT_BEND,
    CONTACT_BEND_ERROR,
    CONTACT_BEND_RATE,
    CONTACT_FOUND,
    IN_RANGE,
    INSIDE,
    LOWER,
    ON_PATH,
    PART_VELOCITY,
    POINT_ON_PART,
    POSITION,
    PREDICTED,
    PREDICTED_DISTANCE,
    PREDICTED_LOWER,
    PREDICTED_UPPER,
    SIGNED_DISTANCE,
    TIME_TO_CONTACT,
    TIME_TO_CONTACT_LOWER,
    UPPER,
    VELOCITY,
    WORK,
)
from proximity.kernels.geometry.frames import (
    rounding_at,
)
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.point.budgeted_walk import DOWN
from proximity.kernels.scene.distance_bounds import bounds_at, may_slip, may_slip_in
from proximity.kernels.tracking.conservative_advancement import TOUCH, advance, place_on, touches
from proximity.kernels.tracking.motion import predict
from proximity.kernels.tracking.part_drift import (
    ROUNDED_UP,
    drift_until,
    free_for,
    gather_near,
    velocity_of_part,
)
from proximity.kernels.tracking.track import (
    AHEAD_LEFT,
    BUDGET,
    HOLES,
    HORIZON,
    MAX_ACCELERATION,
    MAX_SPEED,
    RADIUS,
    SLOT,
    WAY,
    WORKING_RANGE,
)
from proximity.kernels.tracking.track import PART as TRACK_PART

STILL = 1e-6
"""m/s. Slower than this nothing gets anywhere within a horizon."""
CHEAP = 0.02
"""Share of the distance that a finger may go before its prediction takes a walk of its own."""
EASE = 0.1
"""Share of a clearance that a step along the velocity need not find: what it leaves, later steps get, and all
walks end sooner. Ten fingers among moving parts take a fifth fewer steps and are certified to be free for 5 %
less of the time; with 0.3 for 14 % less. Five near a part with holes take 155 steps at p99 instead of 197.
On a path the contact's place counts, and nothing is spared."""
STRIDE = 40
"""Steps that a finger takes along its velocity in one tick, about; the next goes on from the balls it keeps.
All at once are 100 µs for five fingers near 90 k faces of free form, one tick in a hundred."""
FEWEST_STEPS = 4
"""For prediction and way each, when the distance has taken the budget."""
PROBES = 3
"""Looks beyond the expected contact, each farther, to confirm it."""


@inlined
def _left(settings, numbers, i):
    """Steps that the finger may still take: of its budget, and of what all fingers have for looking ahead."""
    own = max(np.int64(settings[BUDGET]) - np.int64(numbers[i, WORK]), FEWEST_STEPS)
    return min(own, np.int64(settings[AHEAD_LEFT]))


@inlined
def _count(settings, numbers, i, steps):
    """Take note of steps taken to look ahead."""
    numbers[i, WORK] += steps
    settings[AHEAD_LEFT] -= steps


@inlined
def foretell(
    reals, words, frames, parts, settings, motions, tracks, marks, balls, records, numbers, movers,
    mover_count, stands, i, ahead, flags, room, witness, way, stages, place,
):  # fmt: skip
    """Write the distance expected *ahead* seconds after the pose, and the time to contact."""
    part, slot, radius = marks[i, TRACK_PART], marks[i, SLOT], tracks[i, RADIUS]
    ux, uy, uz = 0.0, 0.0, 0.0
    if mover_count and slot >= 0:
        ux, uy, uz = (
            records[i, PART_VELOCITY],
            records[i, PART_VELOCITY + 1],
            records[i, PART_VELOCITY + 2],
        )
    own_speed = sqrt(dot(ux, uy, uz, ux, uy, uz)) * ROUNDED_UP
    least = own_speed if stands else 0.0
    vx, vy, vz = records[i, VELOCITY] - ux, records[i, VELOCITY + 1] - uy, records[i, VELOCITY + 2] - uz
    speed = sqrt(dot(vx, vy, vz, vx, vy, vz)) * ROUNDED_UP
    if not flags & PREDICTED:
        speed = settings[MAX_SPEED] + own_speed
    x, y, z = records[i, POSITION], records[i, POSITION + 1], records[i, POSITION + 2]
    ahead = max(ahead, 0.0)

    # The distance then: of the place the finger will have relative to the part.
    dx, dy, dz, rho = predict(motions, i, ahead, settings[MAX_SPEED], settings[MAX_ACCELERATION])
    dx, dy, dz = dx - ux * ahead, dy - uy * ahead, dz - uz * ahead
    length = sqrt(dot(dx, dy, dz, dx, dy, dz))
    distance, lower, upper = (
        records[i, SIGNED_DISTANCE] + radius,
        records[i, LOWER] + radius,
        records[i, UPPER] + radius,
    )
    is_outside = not flags & INSIDE
    stays_outside = is_outside
    if is_outside and settings[HOLES] != 0.0:
        stays_outside = not may_slip_in(words, frames, parts, x + dx, y + dy, z + dz)
    if length > 0.0 and slot >= 0:
        left = _left(settings, numbers, i)
        # Where the finger will be is less certain than by rho; the surface need not be known better.
        is_cheap = length <= CHEAP * lower or (length <= rho and length < lower)
        if stays_outside and (is_cheap or not flags & IN_RANGE or left <= 0):
            # The point that is nearest now is, there, as far as the surface at most; hardly farther, so near.
            ax = x + dx - records[i, POINT_ON_PART]
            ay = y + dy - records[i, POINT_ON_PART + 1]
            az = z + dz - records[i, POINT_ON_PART + 2]
            distance = sqrt(dot(ax, ay, az, ax, ay, az))
            lower, upper = lower - length, distance
        else:
            distance, lower, upper, _, _, _, _, steps = bounds_at(
                (reals, words, frames, parts), (x + dx, y + dy, z + dz), part, slot,
                stays_outside and length < lower, CHEAP, radius, left, room, witness,
            )  # fmt: skip
            _count(settings, numbers, i, steps)
    else:
        # No face is known to ask: a distance changes by no more than the way.
        lower, upper = lower - length, upper + length
    # Here the fastest part of all counts: readers learn from this spread how fast anything may come when they
    # are late.
    horizon = settings[HORIZON]
    near, fastest = np.int64(0), 0.0
    if mover_count:
        near, fastest = gather_near(
            movers, mover_count, ux, uy, uz, x, y, z, radius + rounding_at(frames, x, y, z), speed, 1.0,
            horizon,
        )  # fmt: skip
    spread = rho + max(fastest, least) * ahead
    if settings[HOLES] != 0.0 and may_slip(frames, parts, x + dx, y + dy, z + dz, spread + length):
        # Through a hole the side changes away from the surface: what is left is how far that is.
        upper = max(upper, -lower)
        lower = -upper
    records[i, PREDICTED_DISTANCE] = distance - radius
    # Far from everything, and as fast as no number tells: nothing is known.
    records[i, PREDICTED_LOWER] = lower - spread - radius if spread < np.inf else -np.inf
    records[i, PREDICTED_UPPER] = upper + spread - radius

    # The time to contact, along the velocity.
    # What may touch already is not free for a moment, however slow.
    clearance = max(records[i, LOWER] - rounding_at(frames, x, y, z), 0.0)
    if records[i, SIGNED_DISTANCE] <= 0.0:
        records[i, TIME_TO_CONTACT], records[i, TIME_TO_CONTACT_LOWER] = 0.0, 0.0
        return
    # Nobody waits for what is beyond the working range.
    if speed * horizon > settings[WORKING_RANGE]:
        horizon = max(settings[WORKING_RANGE] / speed, 0.1 * horizon)
    drift, _ = drift_until(movers, near, least, speed, horizon)
    free = free_for(movers, near, least, speed, clearance)
    if free >= horizon or speed + drift < STILL:
        records[i, TIME_TO_CONTACT], records[i, TIME_TO_CONTACT_LOWER] = np.inf, min(free, horizon)
        return
    closing = records[i, APPROACH_SPEED]
    expected = records[i, SIGNED_DISTANCE] / closing if closing > 0.0 and flags & PREDICTED else np.inf
    if flags & PREDICTED and flags & IN_RANGE and is_outside:
        way[0, 0], way[0, 1], way[0, 2] = x, y, z
        way[1, 0], way[1, 1], way[1, 2] = x + vx * horizon, y + vy * horizon, z + vz * horizon
        stages[0], stages[1] = 0.0, horizon
        reached, found, _, _, steps, _ = advance(
            reals, words, frames, parts, way, stages, 2, 0.0, clearance, radius, speed, movers, near, least,
            part, slot, EASE, min(_left(settings, numbers, i), STRIDE), balls, settings[WAY], room, witness,
            place,
        )  # fmt: skip
        free = max(free, reached)
        # Where the way has not been followed to its end, or to a touch, there is still the nearest face.
        if free >= horizon or found < np.inf:
            expected = found
        _count(settings, numbers, i, steps)
    records[i, TIME_TO_CONTACT_LOWER] = free
    records[i, TIME_TO_CONTACT] = max(expected, free) if expected < horizon else np.inf


@inlined
def _measure_path(path, stages):
    """Fill the lengths of a path up to each of its corners; its whole length."""
    stages[0] = 0.0
    for k in range(len(stages) - 1):
        dx, dy, dz = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1], path[k + 1, 2] - path[k, 2]
        stages[k + 1] = stages[k] + sqrt(dx * dx + dy * dy + dz * dz)
    return stages[len(stages) - 1]


@inlined
def _nearest_stage(path, stages, x, y, z):
    """The stage of the place on a path that is nearest to a point."""
    best_sq, best = np.inf, 0.0
    for k in range(len(stages) - 1):
        ex, ey, ez = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1], path[k + 1, 2] - path[k, 2]
        ax, ay, az = x - path[k, 0], y - path[k, 1], z - path[k, 2]
        length_sq = dot(ex, ey, ez, ex, ey, ez)
        share = min(max(dot(ax, ay, az, ex, ey, ez) / length_sq, 0.0), 1.0) if length_sq > 0.0 else 0.0
        ax, ay, az = ax - share * ex, ay - share * ey, az - share * ez
        distance_sq = dot(ax, ay, az, ax, ay, az)
        if distance_sq < best_sq:
            best_sq, best = distance_sq, stages[k] + share * (stages[k + 1] - stages[k])
    return best


@inlined
def interpolate(xs, ys, x):
    """Piecewise linear: *ys* over *xs* that do not fall, held beyond the ends; and the slope there.

    Where several have the same *x*, the last that a piece begins at counts.
    """
    last = len(xs) - 1
    k = 0
    while k < last - 1 and xs[k + 1] <= x:
        k += 1
    span = xs[k + 1] - xs[k]
    slope = (ys[k + 1] - ys[k]) / span if span > 0.0 else 0.0
    return ys[k] + slope * (min(max(x, xs[k]), xs[k + 1]) - xs[k]), slope


@inlined
def _first_at(xs, ys, x):
    """As `interpolate`, but where several have the same *x*, the first of them counts."""
    k = 0
    while k < len(xs) - 2 and xs[k + 1] < x:
        k += 1
    span = xs[k + 1] - xs[k]
    slope = (ys[k + 1] - ys[k]) / span if span > 0.0 else 0.0
    return ys[k] + slope * (min(max(x, xs[k]), xs[k + 1]) - xs[k])


@kernel
def _advance_on_path(
    reals, words, frames, parts, path, stages, stage, clearance, radius, movers, near, part, slot, budget,
    balls, way_of_parts, room, witness, place,
):  # fmt: skip
    """`advance` along all of a path, and what it returns but for the last."""
    free, expected, part, slot, steps, _ = advance(
        reals, words, frames, parts, path, stages, len(stages), stage, clearance, radius, 1.0, movers, near,
        0.0, part, slot, 0.0, budget, balls, way_of_parts, room, witness, place,
    )  # fmt: skip
    return free, expected, part, slot, steps


@kernel
def look_along_path(
    reals, words, frames, parts, settings, path, path_bends, bend, tracks, marks, balls, records, numbers,
    movers, mover_count, i, flags, room, witness, stages, place,
):  # fmt: skip
    """Write where on its path the finger touches first and, if it goes that way, when; the flags."""
    whole = _measure_path(path, stages)
    if not (whole > 0.0 and isfinite(whole)):
        return flags
    part, slot, radius = marks[i, TRACK_PART], marks[i, SLOT], tracks[i, RADIUS]
    x, y, z = records[i, POSITION], records[i, POSITION + 1], records[i, POSITION + 2]
    if isfinite(bend):
        stage, _ = interpolate(path_bends, stages, bend)
    else:
        stage = _nearest_stage(path, stages, x, y, z)
    bend_here, bend_per_metre = interpolate(stages, path_bends, stage)
    # Where corners are repeated, the place does not tell the bend.
    told = min(max(bend, path_bends[0]), path_bends[len(path_bends) - 1])
    bend = told if isfinite(bend) else bend_here
    place_on(path, stages, len(stages), stage, place)
    speed = dot(
        place[3], place[4], place[5], records[i, VELOCITY], records[i, VELOCITY + 1], records[i, VELOCITY + 2]
    )
    if abs(speed) <= STILL:
        speed = 0.0
    records[i, BEND], records[i, BEND_RATE] = bend, speed * bend_per_metre
    ox, oy, oz = x - place[0], y - place[1], z - place[2]
    off = sqrt(dot(ox, oy, oz, ox, oy, oz)) * (1.0 + 1e-12)

    # How far it is from the path's place; the finger itself may be a little beside it.
    lower = records[i, LOWER] + radius - off
    if flags & INSIDE or lower <= radius:
        _, lower, upper, _, part, slot, _, steps = bounds_at(
            (reals, words, frames, parts), (place[0], place[1], place[2]), part, slot, False,
            0.0, 0.0, _left(settings, numbers, i), room, witness,
        )  # fmt: skip
        _count(settings, numbers, i, steps)
        if lower <= radius:
            # In contact already, or so near that it cannot be told.
            records[i, CONTACT_BEND] = bend
            records[i, CONTACT_BEND_ERROR] = 0.0 if upper <= radius else np.inf
            records[i, CONTACT_BEND_RATE] = 0.0
            if speed > 0.0:
                records[i, TIME_TO_CONTACT] = 0.0 if upper <= radius else records[i, TIME_TO_CONTACT]
                records[i, TIME_TO_CONTACT_LOWER] = 0.0
            return flags | ON_PATH | (CONTACT_FOUND if upper <= radius else 0)
    free, expected, part, slot, steps = _advance_on_path(
        reals, words, frames, parts, path, stages, stage, lower - radius, radius, movers, np.int64(0), part,
        slot, _left(settings, numbers, i), balls, settings[WAY], room, witness, place,
    )  # fmt: skip
    _count(settings, numbers, i, steps)
    flags |= ON_PATH
    if free < whole:
        flags = _write_contact(
            reals, words, frames, parts, settings, path, path_bends, stages, free, expected, part, slot,
            radius, records, numbers, mover_count, i, flags, room, witness, place,
        )  # fmt: skip
    if speed > 0.0 and flags & PREDICTED and records[i, SIGNED_DISTANCE] > 0.0:
        near = np.int64(0)
        if mover_count:
            near, _ = gather_near(
                movers, mover_count, 0.0, 0.0, 0.0, x, y, z, radius + off + rounding_at(frames, x, y, z),
                1.0, 1.0 / speed, whole - stage,
            )  # fmt: skip
        if near:
            free, expected, part, slot, steps = _advance_on_path(
                reals, words, frames, parts, path, stages, stage, lower - radius, radius, movers, near, part,
                slot, _left(settings, numbers, i), balls, settings[WAY], room, witness, place,
            )  # fmt: skip
            _count(settings, numbers, i, steps)
        records[i, TIME_TO_CONTACT_LOWER] = max(free - stage, 0.0) / speed * DOWN
        records[i, TIME_TO_CONTACT] = max(expected - stage, 0.0) / speed
    return flags


@kernel
def _write_contact(
    reals, words, frames, parts, settings, path, path_bends, stages, free, expected, part, slot, radius,
    records, numbers, mover_count, i, flags, room, witness, place,
):  # fmt: skip
    """Write the contact location: free up to one stage, expected at another, confirmed beyond that."""
    whole = stages[len(stages) - 1]
    least = max(_first_at(stages, path_bends, free), records[i, BEND])
    if not expected < np.inf:
        # Nothing beyond is known: not farther than this, to be safe; nor which way a surface faces.
        records[i, CONTACT_BEND] = least
        records[i, CONTACT_BEND_ERROR] = np.inf
        return flags
    drift_bend = 0.0
    if mover_count and slot >= 0:
        # Where it touches, some millimetres beyond the last place that was asked; the normal is from there.
        place_on(path, stages, len(stages), expected, place)
        vx, vy, vz = velocity_of_part(frames, part, place[0], place[1], place[2])
        along = dot(place[6], place[7], place[8], place[3], place[4], place[5])
        if along < 0.0:
            drift_bend = dot(place[6], place[7], place[8], vx, vy, vz) / along
    bend, slope = interpolate(stages, path_bends, expected)
    records[i, CONTACT_BEND], records[i, CONTACT_BEND_ERROR] = bend, np.inf
    records[i, CONTACT_BEND_RATE] = drift_bend * slope
    margin = max(2.0 * (expected - free), 2.0 * TOUCH)
    for _ in range(PROBES):
        beyond = min(expected + margin, whole)
        place_on(path, stages, len(stages), beyond, place)
        is_touch, steps = touches(
            reals, words, frames, parts, place[0], place[1], place[2], radius, part, slot,
            _left(settings, numbers, i), room,
        )  # fmt: skip
        _count(settings, numbers, i, steps)
        if not is_touch and radius < margin:
            # So small a sphere may be through the surface already: then it is inside.
            _, _, upper, _, _, _, _, steps = bounds_at(
                (reals, words, frames, parts), (place[0], place[1], place[2]), part, slot, False, 0.0, 0.0,
                _left(settings, numbers, i), room, witness,
            )  # fmt: skip
            _count(settings, numbers, i, steps)
            is_touch = upper <= radius
        if is_touch:
            most, _ = interpolate(stages, path_bends, beyond)
            records[i, CONTACT_BEND_ERROR] = max(bend - least, most - bend)
            return flags | CONTACT_FOUND
        margin *= 4.0
    return flags
