"""Conservative advancement: how far a sphere can follow a path without contact.

A sphere whose distance to every surface is at least *c* can advance by *c*, less the motion of the parts
toward it, without contact. The path is cut into such steps, each certified by one closest-point query. The
steps shrink near the contact, and no surface is passed through, however thin. The nearest face after the last
step gives the expected contact.

Each query gives a *ball* without any surface in it, which is stored. At the next tick the path of the finger
has moved a little and leads through the same balls, so that most steps need no query.

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

MAX_STEPS = 24
TOUCH = 1e-5
"""m: a smaller distance is a contact; a tenth of the bias that an operator would feel."""
NEAR = 0.01
"""The plane of the nearest face is accepted within this share of the distance covered."""
BALL_COUNT = 16
"""Balls per finger; a new one overwrites the oldest. With 8, repeated queries cost 15 % of a tick."""
BALLS_SIZE = 5 * BALL_COUNT + 1
"""Size of a finger's array of balls: x, y, z, m; radius, m, negative for none; displacement of the parts when
each was found, m; and the index of the oldest."""
WORTH = 0.25
"""Least remaining share of its initial clearance with which a ball is used."""
EXACT_WITHIN = 1e-3
"""m of clearance below which queries are exact: they are short near a surface, and each step counts along a
grazing path."""
STEEP = 0.5
"""Least cosine of the angle of incidence at which the plane of the nearest face is accepted."""


class Path(NamedTuple):
    """A polyline with a non-decreasing parameter at each corner: s, or m along it."""

    corners: np.ndarray  # (K, 3) float64, m, scene's frame
    parameters: np.ndarray  # (K,) float64


class Sphere(NamedTuple):
    """A sphere that follows a path, and the stored balls around it."""

    radius: float  # m
    speed: float  # maximum, m per unit of the path's parameter
    balls: np.ndarray  # (BALLS_SIZE,) float64, of the finger
    displacement: float  # m, of the parts up to now


class Advance(NamedTuple):
    """Result of an advancement of a sphere along a path."""

    free: float  # parameter up to which the path is certified free
    expected: float  # parameter of the expected contact; inf if none on this path
    part: int  # part of the face in contact, or nearest last
    slot: int  # slot of that face
    steps: int  # nodes and leaves visited


@inlined
def point_on_path(path, parameter, vectors):
    """Fill *vectors* (6,) with the point of a path at *parameter*, and the path's direction per unit."""
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
    """Fill *out* (3,) with the unit vector, scene's frame, from a closest point to its query point."""
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
    """Return the least clearance of a sphere at a point, from its balls; negative if a query is needed."""
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
    """Store a ball: no surface is nearer to the point than *clear*, m. Overwrites the oldest."""
    balls = sphere.balls
    ball = int(balls[5 * BALL_COUNT])
    balls[ball], balls[ball + BALL_COUNT], balls[ball + 2 * BALL_COUNT] = x, y, z
    balls[ball + 3 * BALL_COUNT], balls[ball + 4 * BALL_COUNT] = clear, sphere.displacement
    balls[5 * BALL_COUNT] = (ball + 1) % BALL_COUNT


@inlined
def _free_until(parameter, clearance, rate, faster):
    """Return the parameter up to which a clearance lasts, or at which a faster part may arrive."""
    if rate > 0.0:
        return min(parameter + clearance / rate * DOWN, faster)
    return faster if clearance > 0.0 else parameter


@inlined
def advance_conservatively(
    model, path, sphere, drift, start, clearance, part, slot, tolerance, stride, budget, scratch
):
    """Advance a sphere along its path from the parameter *start*; return an `Advance`.

    At *start* every surface is at least *clearance* m away. *drift*: a `Drift`, of surfaces toward the
    sphere. *part*, *slot*: a face to start from. *tolerance*: the share of a clearance by which a query may
    fall short. No query begins after *stride* steps; all together take at most *budget*. Fills the first six
    of the scratch vectors as `point_on_path` does, and the last three with the outward direction of the last
    face found.
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
    for _ in range(MAX_STEPS):
        if not free < end:
            return Advance(end, np.inf, part, slot, work)
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
        if work >= stride:
            break
        # Surfaces beyond this distance now are not reached before the end.
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
    """Return the gap between the sphere and a face, m, and the rate at which the path closes it."""
    vectors = scratch.vectors
    point = vectors[0], vectors[1], vectors[2]
    gap = fill_closest(model, part, slot, point, scratch.closest)
    outward_of(model, part, scratch.closest, vectors[6:9])
    closing = -dot(vectors[6], vectors[7], vectors[8], vectors[3], vectors[4], vectors[5])
    return max(gap - sphere.radius, 0.0), closing


@kernel
def touches(model, point, radius, part, slot, budget, workspace):
    """Test whether a sphere at *point* (x, y, z) certainly touches a surface; return also the steps taken.

    *part*, *slot*: a face to start from, best the one expected in contact.
    """
    # Any face within the radius is enough: with a tolerance of the whole distance the first found ends the
    # search.
    limit = radius * model.frames[len(model.frames) - 1].scale
    _, _, slot, _, work = nearest_from_face(
        model, point, part, slot, limit * limit, (1.0, 0.0), budget, workspace
    )
    return slot >= 0, work
