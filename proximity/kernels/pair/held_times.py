"""For how long a part that is followed meets nothing, while all velocities stay.

Distances shrink no faster than the points of one part move as the other sees them. So much later the parts
are looked at again, where their velocities have taken them (conservative advancement, Mirtich 1996).
"""

from math import sqrt

from proximity.kernels.geometry.frames import ROUNDED_DOWN
from proximity.kernels.pair.boxes import frames_at
from proximity.kernels.pair.held_motion import POSE_SIZE, fastest_between, pose_ahead
from proximity.kernels.pair.walk import nearest_of_parts
from proximity.kernels.stack_arrays import stack_f64, stack_i64
from proximity.native import inlined, kernel

MOST_ADVANCES = 6
"""Walks of one tick that look ahead."""
AHEAD_TOLERANCE = 0.1
"""Of those walks: that much of the way to a contact is left for the next."""
AT_CONTACT = 1e-6
"""Share of the way that is left where a contact counts as found."""
TIMED, MAY_OPEN = 1, 2
SLIP = 2.0**-17
"""Parts that touch are not in each other's way if they are apart when they have moved so far, in sizes."""


@inlined
def lower_of(pair):
    """The lower bound of the distance between parts: 0 where one is inside the other."""
    return 0.0 if pair.is_inside else pair.lower


@inlined
def _size_of(frame):
    """Length of the diagonal of a part's box, m."""
    x, y, z = (
        frame.own_upper[0] - frame.own_lower[0],
        frame.own_upper[1] - frame.own_lower[1],
        frame.own_upper[2] - frame.own_lower[2],
    )
    return sqrt(x * x + y * y + z * z)


@kernel
def find_times(model, held):
    """Find for how long nothing is met, while all velocities stay: of the pairs that come first."""
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
    for _ in range(MOST_ADVANCES):
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
    """The pair that may meet first, unless that is known to within what is looked for; -1: none."""
    first, soonest = -1, held.settings[0].horizon * (1.0 - AT_CONTACT)
    for number in range(len(held.pairs)):
        pair = held.pairs[number]
        if pair.free_time < soonest:
            first, soonest = number, pair.free_time
    return first if first >= 0 and held.pairs[first].is_timed != TIMED and soonest > 0.0 else -1


@kernel
def _advance(model, pair, option, budget):
    """Look at a pair when it may meet, and put that off by what it is apart then; return the steps."""
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
