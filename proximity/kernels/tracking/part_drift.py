"""Velocities of parts, and the *drift*: a speed that no surface exceeds.

A part counts only from the earliest time at which it can arrive. Each finger gathers the moving parts that
may come near within its horizon, each with the gap between its box and the finger: only a few, however many
parts move elsewhere. Also computes the displacement of the parts since the previous tick.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from proximity.kernels.geometry.frames import ROUNDED_DOWN, ROUNDED_UP
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import ALL_LANES, FRAME, LANES, field_at
from proximity.kernels.nodes import load_points
from proximity.kernels.stack_arrays import reals_of
from proximity.native import inlined, kernel, record
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

EIGHT_MOVERS = record(
    "EightMovers",
    velocity=f"({3 * LANES},)f8",  # m/s, of the part's origin
    turn=f"({LANES},)f8",  # m/s, bound of the speed from rotation about the origin
    lower=f"({3 * LANES},)f8",  # m, scene's frame: of the part's box
    upper=f"({3 * LANES},)f8",
    near_gap=f"({LANES},)f8",  # m between a finger and the box of a gathered part
    near_speed=f"({LANES},)f8",  # its maximum speed relative to a velocity, per unit of the path's parameter
)
"""Eight parts that may move, and eight parts gathered by a finger."""
SIX_LANES = 2**6 - 1

MAX_COMINGS = 8
"""Successively faster parts that are distinguished; beyond this number the bound is not tight."""
AT_ONCE = 1e-12
"""s or m: an arrival within this interval counts as now, so that each step from arrival to arrival
advances."""

POSE_COLUMNS = 12
"""Size of a part's pose: rotation and translation, the first fields of a row of ``frames``."""
VELOCITY_AT = field_at(FRAME, "velocity")
LAST_EIGHT = POSE_COLUMNS - LANES


class Movers(NamedTuple):
    """The parts of a scene that have a velocity."""

    rows: np.ndarray  # EIGHT_MOVERS, as `gather_movers` fills them
    moving_count: int
    any_stands: bool  # whether some part has no velocity


class Drift(NamedTuple):
    """Bounds on the speed of surfaces toward a point of a path, per unit of the path's parameter."""

    rows: np.ndarray  # EIGHT_MOVERS, as `gather_near` fills them
    near_count: int
    least: float  # m per unit, of parts that are near from the start


def movers_workspace(part_count):
    """Allocate a table of movers for *part_count* parts."""
    return np.zeros(part_count // LANES + 2, EIGHT_MOVERS)


@kernel
def gather_movers(frames, parts, movers):
    """Fill the rows of parts that have a velocity; return their number, and whether any part has none."""
    rows, count, stands = reals_of(frames), 0, False
    for part in range(len(parts) - 1):
        # Linear and angular velocity are six adjacent numbers; the two lanes after them are masked.
        is_still = bits(load(rows[part], VELOCITY_AT) == splat(0.0)) & SIX_LANES == SIX_LANES
        if (is_still and stands) or parts[part].is_hidden:
            continue
        if is_still:
            stands = True
            continue
        mover, k, arm_sq, turn_sq = movers[count // LANES], count % LANES, 0.0, 0.0
        for axis in range(3):
            arm = max(abs(frames[part].own_lower[axis]), abs(frames[part].own_upper[axis]))
            arm_sq += arm * arm
            turn_sq += frames[part].angular_velocity[axis] * frames[part].angular_velocity[axis]
            mover.velocity[LANES * axis + k] = frames[part].velocity[axis]
            mover.lower[LANES * axis + k] = frames[part].box_lower[axis]
            mover.upper[LANES * axis + k] = frames[part].box_upper[axis]
        mover.turn[k] = sqrt(arm_sq) * sqrt(turn_sq)
        count += 1
    for k in range(count, count + LANES):
        for axis in range(3):
            movers[k // LANES].lower[LANES * axis + k % LANES] = np.inf
    return count, stands


@inlined
def _gaps(mover, axis, x):
    """Return the gaps between a coordinate and eight boxes along one axis; 0 inside."""
    below = load(mover.lower, LANES * axis) - splat(x)
    above = splat(x) - load(mover.upper, LANES * axis)
    return maximum(maximum(below, above), splat(0.0))


@kernel
def gather_near(movers, velocity, point, off, speed, unit, extent):
    """Gather the parts that may come near a point; return their number, and the speed of the fastest part.

    *velocity*, m/s, and *point*, m: (x, y, z). The point moves by at most *speed* m per unit of the path's
    parameter, parts by their velocities relative to *velocity*; a unit lasts *unit* seconds, and the horizon
    is *extent* units. A part counts if it can come within *off* m of the point. The fastest, m per unit, is
    over all moving parts at any distance.
    """
    rows = movers.rows
    x, y, z = point
    ux, uy, uz = velocity
    near = 0
    fastest = splat(0.0)
    for first in range(0, movers.moving_count, LANES):
        mover = rows[first // LANES]
        gap_x, gap_y, gap_z = _gaps(mover, 0, x), _gaps(mover, 1, y), _gaps(mover, 2, z)
        gaps = square_root(dot(gap_x, gap_y, gap_z, gap_x, gap_y, gap_z)) * splat(ROUNDED_DOWN) - splat(off)
        vx, vy, vz = load_points(mover.velocity, 0)
        vx, vy, vz = vx - splat(ux), vy - splat(uy), vz - splat(uz)
        speeds = square_root(dot(vx, vy, vz, vx, vy, vz)) + load(mover.turn, 0)
        speeds = speeds * splat(unit * ROUNDED_UP)
        speeds = select(gaps < splat(np.inf), speeds, splat(0.0))
        fastest = maximum(fastest, speeds)
        coming = bits(gaps <= (splat(speed) + speeds) * splat(extent * ROUNDED_UP))
        while coming:
            k = trailing_zeros(coming)
            coming &= coming - 1
            rows[near // LANES].near_gap[near % LANES] = lane(gaps, k)
            rows[near // LANES].near_speed[near % LANES] = lane(speeds, k)
            near += 1
    for k in range(near, near + LANES):
        row = rows[k // LANES]
        row.near_gap[k % LANES], row.near_speed[k % LANES] = np.inf, 0.0
    return near, -horizontal_min(splat(0.0) - fastest)


@inlined
def part_travel(drift, speed, elapsed):
    """Return the drift, m per unit, up to *elapsed* units, and the unit from which a faster part may arrive.

    *speed*: m per unit, of the point, as passed to `gather_near`.
    """
    near, least = drift.near_count, drift.least
    if near == 0:
        return least, np.inf
    soon = elapsed * ROUNDED_UP + AT_ONCE
    fastest = splat(least)
    for first in range(0, near, LANES):
        gaps, speeds = _near_at(drift.rows[first // LANES])
        has_come = gaps <= (splat(speed) + speeds) * splat(soon)
        fastest = maximum(fastest, select(has_come, speeds, splat(least)))
    fastest_now = -horizontal_min(splat(0.0) - fastest)
    coming = splat(np.inf)
    for first in range(0, near, LANES):
        gaps, speeds = _near_at(drift.rows[first // LANES])
        comes = gaps / (splat(speed) + speeds)
        coming = minimum(coming, select(speeds > splat(fastest_now), comes, splat(np.inf)))
    return fastest_now, horizontal_min(coming) * ROUNDED_DOWN


@inlined
def _near_at(row):
    """Return the gaps, m, and speeds, m per unit, of eight gathered parts."""
    return load(row.near_gap, 0), load(row.near_speed, 0)


@inlined
def contact_free_time(drift, speed, clearance):
    """Return the time, in units, in which no surface *clearance* m away is reached; see `part_travel`."""
    free = 0.0
    for _ in range(MAX_COMINGS):
        fastest, faster = part_travel(drift, speed, free)
        rate = speed + fastest
        left = clearance / rate * ROUNDED_DOWN if rate > 0.0 else (np.inf if clearance > 0.0 else 0.0)
        if left <= faster:
            return max(free, left)
        free = faster
    return free


@inlined
def _corner_displacement_sq(frames, before, part, x, y, z):
    """Return the squared displacement of a point of a part from its pose *before* to the present one, m²."""
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
    """Return the largest displacement of any part since the poses *before* (P, 12), m; update them.

    The displacement of a point is a convex function of its position, so a corner of the box has the largest.
    """
    rows, farthest_sq = reals_of(frames), 0.0
    for part in range(len(before)):
        # Compare the twelve numbers of the pose with two overlapping vectors.
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
