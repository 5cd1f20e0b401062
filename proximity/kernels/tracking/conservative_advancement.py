"""Conservative advancement: how far a sphere can follow a path without touching anything.

From a position where every surface is at least *c* away from the sphere it can go on for *c*, less what the
parts move toward it, and touch nothing. So the path is cut into steps, each of which is certified by one
closest-point query; near the contact the steps shrink to what is left. Nothing is ever passed through,
however thin. Beyond the last step the nearest face shows where the touch is to be expected.

What a query finds is kept: a *ball* without any surface in it. At the next tick the finger is a little beside
where it was, its path leads through the same balls, and most steps need no query.

A position on a path is given by its *parameter*: seconds, or metres along the path.

Source: Mirtich 1996, "Impulse-based dynamic simulation of rigid body systems" (conservative advancement).
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from proximity.kernels.geometry.frames import direction_to_scene, rounding_at
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import LANES
from proximity.kernels.point.budgeted_walk import DOWN
from proximity.kernels.scene.queries.distance_bounds import fill_closest, nearest_from_face
from proximity.kernels.tracking.part_drift import part_travel
from proximity.native import inlined, kernel
from proximity.native.simd import horizontal_min, load, minimum, select, splat, square_root

MOST_STEPS = 24
TOUCH = 1e-5
"""m: nearer than this is a touch; a tenth of what an operator would feel as a bias."""
NEAR = 0.01
"""Share of the distance covered that may be left to the nearest face's plane."""
BALL_COUNT = 16
"""That a finger keeps; the oldest goes first. Fewer are asked for anew more often: 8 cost 15 % of a tick."""
BALLS_SIZE = 5 * BALL_COUNT + 1
"""Numbers of a finger's balls: their x, y, z, m; radius, m, negative for none; how far parts had moved when
each was found, m; and the number of the oldest."""
WORTH = 0.25
"""Share of what a ball gave when it was found that it must still give to be taken."""
EXACT_WITHIN = 1e-3
"""m of clearance that are found whole: walks to a surface nearby are short, and where it is grazed each step
counts."""
STEEP = 0.5
"""Cosine from which on that plane is believed so."""


class Path(NamedTuple):
    """A polyline with a parameter at each corner, which falls nowhere: s, or m along it."""

    corners: np.ndarray  # (K, 3) float64, m, scene's frame
    parameters: np.ndarray  # (K,) float64


class Sphere(NamedTuple):
    """A sphere that follows a path, and what is known of its surroundings."""

    radius: float  # m
    speed: float  # m a unit of the path's parameter, at most
    balls: np.ndarray  # (BALLS_SIZE,) float64, of the finger
    displacement: float  # m, by which parts have moved up to now


class Advance(NamedTuple):
    """Result of an advancement: how far the sphere gets on its path."""

    free: float  # parameter up to which it touches nothing, for certain
    expected: float  # parameter at which it will touch; inf if not on this path
    part: int  # of the face that it then touches, or was nearest to last
    slot: int  # of that face
    steps: int  # nodes and leaves visited


@inlined
def point_on_path(path, parameter, vectors):
    """Fill *vectors* (6,) with the point of a path at *parameter*, and the path's direction a unit."""
    corners, parameters = path.corners, path.parameters
    k = 0
    while k < len(parameters) - 2 and parameters[k + 1] <= parameter:
        k += 1
    span = parameters[k + 1] - parameters[k]
    share = (parameter - parameters[k]) / span if span > 0.0 else 0.0
    for axis in range(3):
        step = corners[k + 1, axis] - corners[k, axis]
        vectors[axis] = corners[k, axis] + share * step
        vectors[3 + axis] = step / span if span > 0.0 else 0.0


@inlined
def outward_of(model, part, closest, out):
    """Fill *out* (3,) with the unit direction, scene's frame, from a closest point to its query."""
    length = closest.length
    factor = 1.0 / length if length > 1e-150 else 0.0
    out[0], out[1], out[2] = direction_to_scene(
        model.frames,
        model.parts,
        part,
        closest.arm[0] * factor,
        closest.arm[1] * factor,
        closest.arm[2] * factor,
    )


@inlined
def _clearance_in_balls(sphere, x, y, z):
    """Least clearance of a sphere at a point, by its balls; negative where a query is needed."""
    balls = sphere.balls
    nearest = splat(np.inf)
    for first in range(0, BALL_COUNT, LANES):
        dx = splat(x) - load(balls, first)
        dy = splat(y) - load(balls, first + BALL_COUNT)
        dz = splat(z) - load(balls, first + 2 * BALL_COUNT)
        off = square_root(dot(dx, dy, dz, dx, dy, dz)) + (
            splat(sphere.displacement) - load(balls, first + 4 * BALL_COUNT)
        )
        full = load(balls, first + 3 * BALL_COUNT) - splat(sphere.radius)
        left = full - off * splat(1.0 + 1e-12)
        is_worth = left >= splat(WORTH) * full
        nearest = minimum(nearest, select(is_worth, splat(0.0) - left, splat(1.0)))
    return -horizontal_min(nearest)


@inlined
def _keep_ball(sphere, x, y, z, clear):
    """Keep that no surface is nearer to a point than *clear*, m, in place of the oldest ball."""
    balls = sphere.balls
    ball = int(balls[5 * BALL_COUNT])
    balls[ball], balls[ball + BALL_COUNT], balls[ball + 2 * BALL_COUNT] = x, y, z
    balls[ball + 3 * BALL_COUNT], balls[ball + 4 * BALL_COUNT] = clear, sphere.displacement
    balls[5 * BALL_COUNT] = (ball + 1) % BALL_COUNT


@inlined
def _free_until(parameter, clearance, rate, faster):
    """Parameter up to which a clearance lasts: until it is used up, or until a faster part may come."""
    if rate > 0.0:
        return min(parameter + clearance / rate * DOWN, faster)
    return faster if clearance > 0.0 else parameter


@inlined
def advance_conservatively(
    model, path, sphere, drift, start, clearance, part, slot, tolerance, budget, scratch
):
    """Advance a sphere on its path from the parameter *start* on; returns an `Advance`.

    At *start* it is *clearance* m away from everything. *drift*: of surfaces toward it, a `Drift`. *part*,
    *slot*: a face to start from. *tolerance*: share of a clearance that a step need not find. Fills the first
    six of the scratch vectors as `point_on_path` does, and the last three with the outward direction of the
    face found last.
    """
    end, speed, vectors = path.parameters[len(path.parameters) - 1], sphere.speed, scratch.vectors
    work = np.int64(0)
    expected = np.inf
    drift_at_end, _ = part_travel(drift, speed, end - start)
    if not speed + drift_at_end > 0.0:
        return Advance(end, expected, part, slot, work)
    scale = model.frames[len(model.frames) - 1].scale
    drift_now, faster = part_travel(drift, speed, 0.0)
    free = _free_until(start, clearance, speed + drift_now, start + faster)
    for _ in range(MOST_STEPS):
        if not free < end:
            return Advance(end, np.inf, part, slot, work)
        if work >= budget:
            break
        current = free
        point_on_path(path, current, vectors)
        x, y, z = vectors[0], vectors[1], vectors[2]
        elapsed = current - start
        drift_now, faster = part_travel(drift, speed, elapsed)
        rate = speed + drift_now
        known = _clearance_in_balls(sphere, x, y, z) - drift_now * elapsed
        if known > NEAR * speed * elapsed and known > TOUCH:
            free = _free_until(current, known, rate, start + faster)
            continue
        # What is farther than this at present is not reached before the end.
        limit = ((speed + drift_at_end) * (end - current) + sphere.radius + drift_at_end * elapsed) * scale
        best_sq, part, slot, lower_sq, steps = nearest_from_face(
            model, (x, y, z), part, slot, limit * limit * (1.0 + 1e-12),
            (tolerance, (sphere.radius + EXACT_WITHIN) * scale), budget - work, scratch.workspace,
        )  # fmt: skip
        work += steps
        clear = sqrt(lower_sq) / scale * DOWN
        _keep_ball(sphere, x, y, z, clear)
        if slot < 0 and lower_sq >= best_sq:
            return Advance(end, np.inf, part, slot, work)
        left = max(clear - sphere.radius - rounding_at(model.frames, x, y, z) - drift_now * elapsed, 0.0)
        free = _free_until(current, left, rate, start + faster)
        if slot < 0:
            continue
        gap, closing = _gap_and_closing(model, sphere, part, slot, scratch)
        expected = current + gap / closing if closing > 0.0 else np.inf
        if gap <= TOUCH:
            return Advance(free, min(expected, current + TOUCH / speed), part, slot, work)
        if (closing >= STEEP * speed and gap <= NEAR * speed * elapsed) or left <= 0.1 * TOUCH:
            break
    return Advance(free, max(expected, free) if expected < end else np.inf, part, slot, work)


@inlined
def _gap_and_closing(model, sphere, part, slot, scratch):
    """Gap between the sphere at the scratch point and a face, m, and the rate at which its path closes it."""
    vectors = scratch.vectors
    point = vectors[0], vectors[1], vectors[2]
    gap = fill_closest(model, part, slot, point, scratch.closest)
    outward_of(model, part, scratch.closest, vectors[6:9])
    closing = -dot(vectors[6], vectors[7], vectors[8], vectors[3], vectors[4], vectors[5])
    return max(gap - sphere.radius, 0.0), closing


@kernel
def touches(model, point, radius, part, slot, budget, workspace):
    """Whether a sphere at *point* (x, y, z) touches some surface for certain, and the steps it took to know.

    *part*, *slot*: a face to start from, which is best the one that is expected to be touched.
    """
    # Any face within the radius will do: with a tolerance of the whole distance the first found is enough.
    limit = radius * model.frames[len(model.frames) - 1].scale
    _, _, slot, _, work = nearest_from_face(
        model, point, part, slot, limit * limit, (1.0, 0.0), budget, workspace
    )
    return slot >= 0, work
