"""Velocities of parts at an instant, and the *drift*: a speed that no surface exceeds.

A part that cannot have come before an instant does not count until then. So each finger gathers the parts
that move and may come near within the time it asks for, each with the gap between their boxes and it: at most
a few, however many move elsewhere. And how far parts have moved since the tick before.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from proximity.kernels.geometry.frames import ROUNDED_DOWN, ROUNDED_UP
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import ALL_LANES, FRAME, LANES, field_at
from proximity.kernels.stack_arrays import reals_of
from proximity.native import inlined, kernel
from proximity.native.simd import (
    bits,
    horizontal_min,
    lane,
    load,
    maximum,
    minimum,
    select,
    splat,
    square_root,
    trailing_zeros,
)

# --- ``movers`` (float64): columns of as many numbers as parts that may move, one after another ---
MOVER_VELOCITY = 0  # m/s, of the part's origin
MOVER_TURN = 3  # m/s at most, by turning about it
MOVER_LOWER = 4  # m, scene's frame: of the part's box
MOVER_UPPER = 7
MOVER_NEAR_GAP = 10  # m between a finger and a box, of the parts it gathered
MOVER_NEAR_SPEED = 11  # their speed at most relative to a velocity, a unit of the path's parameter
MOVER_COLUMNS = 12
SIX_LANES = 2**6 - 1

MOST_COMINGS = 8
"""Faster and faster parts that are kept apart; where there are more, less is certain."""
AT_ONCE = 1e-12
"""s or m: what comes within so little is here, so that a look from one coming to the next gets on."""

POSE_COLUMNS = 12
"""Numbers of a part's pose: rotation and translation, the first in a row of ``frames``."""
VELOCITY_AT = field_at(FRAME, "velocity")
LAST_EIGHT = POSE_COLUMNS - LANES


class Movers(NamedTuple):
    """The parts of a scene that have a velocity."""

    columns: np.ndarray  # float64, as `gather_movers` fills them
    moving_count: int  # parts in the columns
    any_stands: bool  # whether some part has no velocity


class Drift(NamedTuple):
    """Speeds of surfaces toward a point of a path, at most; a unit is one of the path's parameter."""

    columns: np.ndarray  # float64, as `gather_near` fills them
    near_count: int  # parts in the columns
    least: float  # m a unit, of parts that are near from the start


def movers_workspace(part_count):
    """Return a table for so many parts, (`MOVER_COLUMNS` times some lanes,)."""
    return np.zeros(MOVER_COLUMNS * LANES * (part_count // LANES + 2))


@kernel
def gather_movers(frames, parts, movers):
    """Fill the columns of parts that have a velocity; how many there are, and whether any stands."""
    size = len(movers) // MOVER_COLUMNS
    rows, count, stands = reals_of(frames), 0, False
    for part in range(len(parts) - 1):
        # Both velocities follow each other; behind them is what does not count.
        is_still = bits(load(rows[part], VELOCITY_AT) == splat(0.0)) & SIX_LANES == SIX_LANES
        if (is_still and stands) or parts[part].is_hidden:
            continue
        if is_still:
            stands = True
            continue
        arm_sq, turn_sq = 0.0, 0.0
        for axis in range(3):
            arm = max(abs(frames[part].own_lower[axis]), abs(frames[part].own_upper[axis]))
            arm_sq += arm * arm
            turn_sq += frames[part].angular_velocity[axis] * frames[part].angular_velocity[axis]
            movers[(MOVER_VELOCITY + axis) * size + count] = frames[part].velocity[axis]
            movers[(MOVER_LOWER + axis) * size + count] = frames[part].box_lower[axis]
            movers[(MOVER_UPPER + axis) * size + count] = frames[part].box_upper[axis]
        movers[MOVER_TURN * size + count] = sqrt(arm_sq) * sqrt(turn_sq)
        count += 1
    for k in range(count, count + LANES):
        for axis in range(3):
            movers[(MOVER_LOWER + axis) * size + k] = np.inf
    return count, stands


@inlined
def _gaps(movers, at, size, x):
    """Gaps between a coordinate and eight boxes along one axis; 0 within them."""
    below = load(movers, MOVER_LOWER * size + at) - splat(x)
    above = splat(x) - load(movers, MOVER_UPPER * size + at)
    return maximum(maximum(below, above), splat(0.0))


@kernel
def gather_near(movers, velocity, point, off, speed, unit, extent):
    """Gather the parts that may come near a point in a while; their number, and the speed of the fastest.

    *velocity*, m/s, and *point*, m: (x, y, z). The point moves by at most *speed* m a unit of the path's
    parameter, parts as they do relative to *velocity*, *unit* seconds a unit; *extent* units are asked for. A
    part counts if it can come within *off* m of the point. The fastest, m a unit, is that of all that move,
    however far.
    """
    columns = movers.columns
    size = len(columns) // MOVER_COLUMNS
    x, y, z = point
    ux, uy, uz = velocity
    near = 0
    fastest = splat(0.0)
    for first in range(0, movers.moving_count, LANES):
        gap_x = _gaps(columns, first, size, x)
        gap_y = _gaps(columns, first + size, size, y)
        gap_z = _gaps(columns, first + 2 * size, size, z)
        gaps = square_root(dot(gap_x, gap_y, gap_z, gap_x, gap_y, gap_z)) * splat(ROUNDED_DOWN) - splat(off)
        vx = load(columns, MOVER_VELOCITY * size + first) - splat(ux)
        vy = load(columns, (MOVER_VELOCITY + 1) * size + first) - splat(uy)
        vz = load(columns, (MOVER_VELOCITY + 2) * size + first) - splat(uz)
        speeds = square_root(dot(vx, vy, vz, vx, vy, vz)) + load(columns, MOVER_TURN * size + first)
        speeds = speeds * splat(unit * ROUNDED_UP)
        speeds = select(gaps < splat(np.inf), speeds, splat(0.0))
        fastest = maximum(fastest, speeds)
        coming = bits(gaps <= (splat(speed) + speeds) * splat(extent * ROUNDED_UP))
        while coming:
            k = trailing_zeros(coming)
            coming &= coming - 1
            columns[MOVER_NEAR_GAP * size + near] = lane(gaps, k)
            columns[MOVER_NEAR_SPEED * size + near] = lane(speeds, k)
            near += 1
    for k in range(near, near + LANES):
        columns[MOVER_NEAR_GAP * size + k], columns[MOVER_NEAR_SPEED * size + k] = np.inf, 0.0
    return near, -horizontal_min(splat(0.0) - fastest)


@inlined
def part_travel(drift, speed, elapsed):
    """The drift a unit until *elapsed* units have passed, and the unit from which a faster part may be there.

    *speed*: m a unit, of the point, as `gather_near` had it.
    """
    near, least = drift.near_count, drift.least
    if near == 0:
        return least, np.inf
    size = len(drift.columns) // MOVER_COLUMNS
    soon = elapsed * ROUNDED_UP + AT_ONCE
    fastest = splat(least)
    for first in range(0, near, LANES):
        gaps, speeds = _near_at(drift.columns, size, first)
        has_come = gaps <= (splat(speed) + speeds) * splat(soon)
        fastest = maximum(fastest, select(has_come, speeds, splat(least)))
    fastest_now = -horizontal_min(splat(0.0) - fastest)
    coming = splat(np.inf)
    for first in range(0, near, LANES):
        gaps, speeds = _near_at(drift.columns, size, first)
        comes = gaps / (splat(speed) + speeds)
        coming = minimum(coming, select(speeds > splat(fastest_now), comes, splat(np.inf)))
    return fastest_now, horizontal_min(coming) * ROUNDED_DOWN


@inlined
def _near_at(columns, size, first):
    """Gaps, m, and speeds, m a unit, of eight parts that may come near."""
    return load(columns, MOVER_NEAR_GAP * size + first), load(columns, MOVER_NEAR_SPEED * size + first)


@inlined
def contact_free_time(drift, speed, clearance):
    """Units in which nothing *clearance* m away is reached, whatever moves; see `part_travel`."""
    free = 0.0
    for _ in range(MOST_COMINGS):
        fastest, faster = part_travel(drift, speed, free)
        rate = speed + fastest
        left = clearance / rate * ROUNDED_DOWN if rate > 0.0 else (np.inf if clearance > 0.0 else 0.0)
        if left <= faster:
            return max(free, left)
        free = faster
    return free


@inlined
def _corner_displacement_sq(frames, before, part, x, y, z):
    """Squared displacement of a point of the part from its pose *before* to the present one, m²."""
    total = 0.0
    for axis in range(3):
        at, turn = 3 * axis, frames[part].rotation
        shift = (
            (turn[at] - before[part, at]) * x
            + (turn[at + 1] - before[part, at + 1]) * y
            + (turn[at + 2] - before[part, at + 2]) * z
            + (frames[part].translation[axis] - before[part, 9 + axis])
        )
        total += shift * shift
    return total


@kernel
def displacement_of_parts(frames, before):
    """Largest displacement of any point of any part since *before* (P, 12) was taken, m; takes it anew.

    The displacement of a point is a convex function of where on the part it is, so that a corner of the box
    goes farthest.
    """
    rows, farthest_sq = reals_of(frames), 0.0
    for part in range(len(before)):
        # Rotation and translation, which follow each other, by two vectors that overlap.
        is_first_same = load(rows[part], 0) == load(before[part], 0)
        is_last_same = load(rows[part], LAST_EIGHT) == load(before[part], LAST_EIGHT)
        if bits(is_first_same & is_last_same) == ALL_LANES:
            continue
        for corner in range(8):
            x = frames[part].own_upper[0] if corner & 1 else frames[part].own_lower[0]
            y = frames[part].own_upper[1] if corner & 2 else frames[part].own_lower[1]
            z = frames[part].own_upper[2] if corner & 4 else frames[part].own_lower[2]
            farthest_sq = max(farthest_sq, _corner_displacement_sq(frames, before, part, x, y, z))
        for k in range(POSE_COLUMNS):
            before[part, k] = rows[part, k]
    return np.sqrt(farthest_sq) * (1.0 + 1e-12)
