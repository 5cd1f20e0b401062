"""Motion of parts: displacement since the previous tick, largest speed, and time until two parts may meet.

A distance shrinks no faster than the points of one part move relative to the other. The pair is queried again
after that time, with the poses extrapolated (conservative advancement, Mirtich 1996).
"""

from math import cos, sin, sqrt

from proximity.kernels.geometry.frames import ROUNDED_DOWN, ROUNDED_UP
from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.pair.boxes import POSE_SIZE, frames_at
from proximity.kernels.pair.walk import nearest_of_parts
from proximity.kernels.stack_arrays import stack_f64, stack_i64
from proximity.native import inlined, kernel

STILL_ROUNDING = 2.0**-50
"""Bound of the rounding error of a displacement, relative to the coordinates."""
MAX_ADVANCES = 6
"""Predictive queries per tick."""
AHEAD_TOLERANCE = 0.1
"""Tolerance of predictive queries: the share of the distance to a contact that is left to the next one."""
AT_CONTACT = 1e-6
"""Remaining share of the time at which a contact counts as found."""
TIMED, MAY_OPEN = 1, 2
SLIP = 2.0**-17
"""Touching parts do not block each other if they are apart after this displacement, relative to the part's
size."""


@inlined
def _length(x, y, z):
    return sqrt(x * x + y * y + z * z)


@kernel
def displacements(frames, before, moved):
    """Fill the largest displacement of each part since the poses in *before*, m, and update those poses."""
    for part in range(len(moved)):
        frame = frames[part]
        moved[part] = 0.0
        for k in range(POSE_SIZE):
            now = frame.rotation[k] if k < 9 else frame.translation[k - 9]
            if now != before[part, k]:
                moved[part] = -1.0
        if moved[part] < 0.0:
            moved[part] = _displacement(frame, before, part)
            for k in range(9):
                before[part, k] = frame.rotation[k]
            for k in range(3):
                before[part, 9 + k] = frame.translation[k]


@kernel
def _displacement(frame, before, part):
    """Bound the displacement of a part, m: that of its box's centre, plus that by rotation."""
    total, size, step = 0.0, 0.0, stack_f64(3)
    for row in range(3):
        step[row] = frame.translation[row] - before[part, 9 + row]
        size += abs(frame.translation[row])
        for k in range(3):
            change = frame.rotation[3 * row + k] - before[part, 3 * row + k]
            step[row] += change * 0.5 * (frame.own_lower[k] + frame.own_upper[k])
    for k in range(3):
        half = 0.5 * (frame.own_upper[k] - frame.own_lower[k])
        size += half + abs(frame.own_lower[k])
        total += half * _length(
            frame.rotation[k] - before[part, k],
            frame.rotation[3 + k] - before[part, 3 + k],
            frame.rotation[6 + k] - before[part, 6 + k],
        )
    return (total + _length(step[0], step[1], step[2])) * ROUNDED_UP + STILL_ROUNDING * size


@kernel
def fastest_between(own, other, horizon):
    """Return the largest speed, m/s, of a point of one part relative to another, up to *horizon*, s.

    *own*, *other*: frames, whose velocities are constant. Relative to a rotating part, the speed of a point
    grows with its distance.
    """
    vx, vy, vz = (
        own.velocity[0] - other.velocity[0],
        own.velocity[1] - other.velocity[1],
        own.velocity[2] - other.velocity[2],
    )
    speed = _length(vx, vy, vz)
    apart = _length(
        own.translation[0] - other.translation[0],
        own.translation[1] - other.translation[1],
        own.translation[2] - other.translation[2],
    )
    turn, other_turn = _turning(own), _turning(other)
    reach, other_reach = _reach(own), _reach(other)
    far = apart + speed * horizon
    as_other = turn * reach + (other_turn * (far + reach) if other_turn > 0.0 else 0.0)
    as_own = other_turn * other_reach + (turn * (far + other_reach) if turn > 0.0 else 0.0)
    return (speed + min(as_other, as_own)) * ROUNDED_UP


@inlined
def _turning(frame):
    return _length(frame.angular_velocity[0], frame.angular_velocity[1], frame.angular_velocity[2])


@inlined
def _reach(frame):
    """Return the distance of the farthest corner of a part's box from the part's origin."""
    return _length(
        max(abs(frame.own_lower[0]), abs(frame.own_upper[0])),
        max(abs(frame.own_lower[1]), abs(frame.own_upper[1])),
        max(abs(frame.own_lower[2]), abs(frame.own_upper[2])),
    )


@kernel
def pose_ahead(frame, t, pose):
    """Fill the pose (`POSE_SIZE`,) of a part after *t* seconds at constant velocities."""
    rate = _turning(frame)
    angle = rate * t
    for k in range(3):
        pose[9 + k] = frame.translation[k] + frame.velocity[k] * t
    for k in range(9):
        pose[k] = frame.rotation[k]
    if not angle > 0.0:
        return
    ux, uy, uz = (
        frame.angular_velocity[0] / rate,
        frame.angular_velocity[1] / rate,
        frame.angular_velocity[2] / rate,
    )
    c, s = cos(angle), sin(angle)
    for k in range(3):
        x, y, z = frame.rotation[k], frame.rotation[3 + k], frame.rotation[6 + k]
        qx, qy, qz = cross(ux, uy, uz, x, y, z)
        along = dot(ux, uy, uz, x, y, z) * (1.0 - c)
        pose[k] = x * c + qx * s + ux * along
        pose[3 + k] = y * c + qy * s + uy * along
        pose[6 + k] = z * c + qz * s + uz * along


@inlined
def lower_of(pair):
    """Return the lower bound of the distance between parts: 0 if one is inside the other."""
    return 0.0 if pair.is_inside else pair.lower


@inlined
def _size_of(frame):
    """Return the diagonal of a part's box, m."""
    return _length(
        frame.own_upper[0] - frame.own_lower[0],
        frame.own_upper[1] - frame.own_lower[1],
        frame.own_upper[2] - frame.own_lower[2],
    )


@kernel
def find_times(model, held):
    """Find the time in which no surfaces meet at constant velocities, refining the earliest pairs."""
    option = held.settings[0]
    horizon, option.free_time, option.opening = option.horizon, option.horizon, 0
    if not option.is_predicted:
        option.free_time = 0.0
        return
    for number in range(len(held.pairs)):
        pair = held.pairs[number]
        pair.speed = fastest_between(model.frames[pair.own], model.frames[pair.other], horizon)
        lower, pair.free_time = lower_of(pair), horizon
        if lower < pair.speed * horizon:
            pair.free_time = lower / pair.speed
        elif lower == 0.0:
            pair.free_time = 0.0
        slip, pair.is_opening = SLIP * _size_of(model.frames[pair.own]), 0
        is_touching = pair.upper <= AT_CONTACT * slip and not pair.is_crossing and not pair.is_inside
        if is_touching and pair.speed > 0.0:
            pair.free_time, pair.is_timed, pair.is_opening = min(slip / pair.speed, horizon), MAY_OPEN, 1
    work = 0
    for _ in range(MAX_ADVANCES):
        first = _first_to_meet(held)
        if first < 0 or (option.budget > 0 and work >= option.budget):
            break
        work += _advance(model, held.pairs[first], option, option.budget - work if option.budget > 0 else 0)
    option.work += work
    for number in range(len(held.pairs)):
        pair = held.pairs[number]
        if pair.is_timed == MAY_OPEN:
            pair.free_time = 0.0
        option.free_time = min(option.free_time, pair.free_time)
        pair.is_opening = 1 if pair.is_opening and pair.is_unsure and pair.free_time > 0.0 else 0
        option.opening += pair.is_opening


@inlined
def _first_to_meet(held):
    """Return the pair that may meet first within the horizon; -1 if none, or its time is already found."""
    first, soonest = -1, held.settings[0].horizon * (1.0 - AT_CONTACT)
    for number in range(len(held.pairs)):
        pair = held.pairs[number]
        if pair.free_time < soonest:
            first, soonest = number, pair.free_time
    return first if first >= 0 and held.pairs[first].is_timed != TIMED and soonest > 0.0 else -1


@kernel
def _advance(model, pair, option, budget):
    """Query a pair at its free time and extend it by the distance there; return the steps."""
    frames, slots = model.frames, stack_i64(2)
    turn, offset = stack_f64(9), stack_f64(3)
    one, other = stack_f64(POSE_SIZE), stack_f64(POSE_SIZE)
    scale = frames[pair.own].scale
    pose_ahead(frames[pair.own], pair.free_time, one)
    pose_ahead(frames[pair.other], pair.free_time, other)
    frames_at(frames, pair.own, pair.other, one, other, turn, offset)
    slots[0], slots[1] = pair.slots[0], pair.slots[1]
    reach = pair.speed * (option.horizon - pair.free_time) * scale
    _, lower_sq, steps = nearest_of_parts(
        model, pair.own, pair.other, (turn, offset), reach * reach, AHEAD_TOLERANCE, budget, slots
    )
    if pair.is_timed == MAY_OPEN:
        pair.is_timed = 0
        if lower_sq <= 0.0:
            pair.free_time, pair.is_timed = 0.0, TIMED
            return steps
    later = sqrt(max(lower_sq, 0.0)) / scale / pair.speed * ROUNDED_DOWN
    if later <= AT_CONTACT * (pair.free_time + later):
        pair.is_timed = TIMED
    pair.free_time = min(pair.free_time + later, option.horizon)
    return steps
