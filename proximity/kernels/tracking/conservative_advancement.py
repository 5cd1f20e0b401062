"""Conservative advancement: how far a sphere can go on its way and touch nothing, and where it will touch.

From a place where every surface is at least *c* away from the sphere it can go on for *c*, less what the
parts move toward it, and touch nothing. So the way is cut into steps, each of which is certified by one
closest-point query; near the contact the steps shrink to what is left. Nothing is ever passed through,
however thin. Beyond the last step the nearest face tells where the touch is to be expected.

What a query finds is kept: a *ball* without any surface in it. At the next tick the finger is a little beside
where it was, its way leads through the same balls, and most steps need no query.

A way is a polyline with a number at each corner, the *stage*: seconds, or metres along a path.

Source: Mirtich 1996, "Impulse-based dynamic simulation of rigid body systems" (conservative advancement).
"""

from math import sqrt

import numpy as np

from proximity.kernels.compiler import inlined, kernel
from proximity.kernels.geometry.closest_feature import ARM, LENGTH
from proximity.kernels.geometry.frames import (
    direction_to_scene,
    rounding_at,
)
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import LANES, SCALE
from proximity.kernels.point.budgeted_walk import DOWN
from proximity.kernels.scene.distance_bounds import fill_witness, nearest_from_face
from proximity.kernels.tracking.part_drift import drift_until
from proximity.simd import horizontal_min, load, minimum, select, splat, square_root

MOST_STEPS = 24
TOUCH = 1e-5
"""m: nearer than this is a touch; a tenth of what an operator would feel as a bias."""
NEAR = 0.01
"""Share of the way gone that may be left to the nearest face's plane."""
BALLS = 16
"""That a finger keeps; the oldest goes first. Fewer are asked for anew more often: 8 cost 15 % of a tick."""
BALLS_SIZE = 5 * BALLS + 1
"""Of a finger's row of balls: their x, y, z, m; radius, m, negative for none; how far parts had moved when
each was found, m; and the number of the oldest."""
WORTH = 0.25
"""Share of what a ball gave when it was found that it must still give to be taken."""
EXACT_WITHIN = 1e-3
"""m of clearance that are found whole: walks to a surface nearby are short, and where it is grazed each step
counts."""
STEEP = 0.5
"""Cosine from which on that plane is believed so."""


@inlined
def place_on(way, stages, count, stage, place):
    """Fill *place* (6,) with the place on a way at *stage*, and the way's direction a unit of stage."""
    k = 0
    while k < count - 2 and stages[k + 1] <= stage:
        k += 1
    span = stages[k + 1] - stages[k]
    share = (stage - stages[k]) / span if span > 0.0 else 0.0
    for axis in range(3):
        step = way[k + 1, axis] - way[k, axis]
        place[axis] = way[k, axis] + share * step
        place[3 + axis] = step / span if span > 0.0 else 0.0


@inlined
def outward_of(frames, parts, part, witness, out):
    """Fill *out* (3,) with the unit direction, scene's frame, from the surface to the point of a witness."""
    length = witness[LENGTH]
    factor = 1.0 / length if length > 1e-150 else 0.0
    x, y, z = direction_to_scene(
        frames,
        parts,
        part,
        witness[ARM] * factor,
        witness[ARM + 1] * factor,
        witness[ARM + 2] * factor,
    )
    out[0], out[1], out[2] = x, y, z


@inlined
def _room_in_balls(balls, way_of_parts, x, y, z, radius):
    """How far a sphere is at least from every surface, by the balls; negative where they do not tell well."""
    nearest = splat(np.inf)
    for first in range(0, BALLS, LANES):
        dx = splat(x) - load(balls, first)
        dy = splat(y) - load(balls, first + BALLS)
        dz = splat(z) - load(balls, first + 2 * BALLS)
        off = square_root(dot(dx, dy, dz, dx, dy, dz)) + (
            splat(way_of_parts) - load(balls, first + 4 * BALLS)
        )
        full = load(balls, first + 3 * BALLS) - splat(radius)
        left = full - off * splat(1.0 + 1e-12)
        is_worth = left >= splat(WORTH) * full
        nearest = minimum(nearest, select(is_worth, splat(0.0) - left, splat(1.0)))
    return -horizontal_min(nearest)


@inlined
def _keep_ball(balls, way_of_parts, x, y, z, clear):
    ball = int(balls[5 * BALLS])
    balls[ball], balls[ball + BALLS], balls[ball + 2 * BALLS] = x, y, z
    balls[ball + 3 * BALLS], balls[ball + 4 * BALLS] = clear, way_of_parts
    balls[5 * BALLS] = (ball + 1) % BALLS


@inlined
def _until(stage, clearance, rate, faster):
    """How far a clearance lets a sphere go: up to where it is used up, or where a faster part may come."""
    if rate > 0.0:
        return min(stage + clearance / rate * DOWN, faster)
    return faster if clearance > 0.0 else stage


@inlined
def advance(
    reals, words, frames, parts, way, stages, count, stage, clearance, radius, speed, movers, near, least,
    part, slot, ease, budget, balls, way_of_parts, room, witness, place,
):  # fmt: skip
    """How far a sphere gets on its way.

    *way* (K, 3), *stages* (K,), *count* of them in use: the way, m, and its stages. *speed*: m a unit of
    stage at most. *movers*, *near*, *least*: m a unit of stage that surfaces may move toward the sphere, see
    `drift_until`. It is at *stage*, *clearance* away from everything. *part*, *slot*: a face to start from.
    *ease*: share of a clearance that a step need not find. *balls* (`BALLS_SIZE`,): of the finger;
    *way_of_parts*: how far parts have moved, m. *place* (9,): scratch.

    Returns the stage up to which it touches nothing, for certain; the stage at which it will, or
    inf if not on this way; part and slot of the face it then touches or was nearest to last; the steps
    taken; and whether the touch is one: within `TOUCH`.
    """
    end = stages[count - 1]
    begin = stage
    work = np.int64(0)
    expected = np.inf
    drift_at_end, _ = drift_until(movers, near, least, speed, end - begin)
    if not speed + drift_at_end > 0.0:
        return end, expected, part, slot, work, False
    scale = frames[len(frames) - 1, SCALE]
    drift, faster = drift_until(movers, near, least, speed, 0.0)
    free = _until(stage, clearance, speed + drift, begin + faster)
    for _ in range(MOST_STEPS):
        if not free < end:
            return end, np.inf, part, slot, work, False
        if work >= budget:
            break
        stage = free
        place_on(way, stages, count, stage, place)
        gone = stage - begin
        drift, faster = drift_until(movers, near, least, speed, gone)
        rate = speed + drift
        known = _room_in_balls(balls, way_of_parts, place[0], place[1], place[2], radius) - drift * gone
        if known > NEAR * speed * gone and known > TOUCH:
            free = _until(stage, known, rate, begin + faster)
            continue
        # What is farther than this at present is not reached before the end.
        limit = ((speed + drift_at_end) * (end - stage) + radius + drift_at_end * gone) * scale
        best_sq, part, slot, lower_sq, steps = nearest_from_face(
            (reals, words, frames, parts), (place[0], place[1], place[2]), part, slot,
            limit * limit * (1.0 + 1e-12), ease, (radius + EXACT_WITHIN) * scale, budget - work, room,
        )  # fmt: skip
        work += steps
        clear = sqrt(lower_sq) / scale * DOWN
        _keep_ball(balls, way_of_parts, place[0], place[1], place[2], clear)
        if slot < 0 and lower_sq >= best_sq:
            return end, np.inf, part, slot, work, False
        rounding = rounding_at(frames, place[0], place[1], place[2])
        left = max(clear - radius - rounding - drift * gone, 0.0)
        free = _until(stage, left, rate, begin + faster)
        if slot < 0:
            continue
        gap = fill_witness(reals, words, parts, frames, part, slot, place[0], place[1], place[2], witness)
        gap = max(gap - radius, 0.0)
        closing = _closing(frames, parts, part, witness, place)
        expected = stage + gap / closing if closing > 0.0 else np.inf
        if gap <= TOUCH:
            return free, min(expected, stage + TOUCH / speed), part, slot, work, drift == 0.0
        if (closing >= STEEP * speed and gap <= NEAR * speed * gone) or left <= 0.1 * TOUCH:
            break
    return free, max(expected, free) if expected < end else np.inf, part, slot, work, False


@inlined
def _closing(frames, parts, part, witness, place):
    """Metres a unit of stage by which the way at *place* nears the face of a filled witness."""
    outward_of(frames, parts, part, witness, place[6:9])
    return -dot(place[6], place[7], place[8], place[3], place[4], place[5])


@kernel
def touches(reals, words, frames, parts, x, y, z, radius, part, slot, budget, room):
    """Whether a sphere at a point touches some surface for certain, and the steps it took to know."""
    # Any face within the radius tells: with an ease of all the distance the first that is found is enough.
    limit = radius * frames[len(frames) - 1, SCALE]
    _, _, slot, _, work = nearest_from_face(
        (reals, words, frames, parts), (x, y, z), part, slot, limit * limit, 1.0, 0.0, budget, room
    )
    return slot >= 0, work
