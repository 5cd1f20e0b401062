"""Search for a direction with a short displacement that frees one part of another."""

from math import sqrt

import numpy as np

from proximity.kernels.answers import DEPTH_ANSWER
from proximity.kernels.geometry.rows import vector
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import ModelArrays
from proximity.kernels.pair.part_penetration import depth_along
from proximity.kernels.stack_arrays import stack_arrays_of, stack_f64, stack_f64_rows
from proximity.native import entry, kernel

MAX_EXIT_TURNS = 4
"""Number of times that the direction is set to the normal of the surface at which a part comes free."""
BEYOND = 0.4
"""Relative to the tolerance: the distance beyond the expected depth at which the parts should be apart."""
MIN_GAIN = 0.25
"""Relative to the tolerance: a direction is not turned for a smaller gain."""
ROUGH = 0.1
"""Tolerance while directions are compared."""
AXES = 7
"""Number of compared lines: the axes of both parts, and the line between their centres."""

stack_depths, _ = stack_arrays_of(DEPTH_ANSWER)


@entry(ModelArrays, "int, int, int32[:], int32[:], float64[:], float, int, ExitAnswer[:]")
def find_exit(model, first, second, faces, other_faces, direction, tolerance, budget, answers):
    """Fill the displacement that frees the first part of the second; (1,).

    *faces*, *other_faces*: one of each of their surfaces. *direction*: scene's frame; if it is 0, a short way
    is searched. *tolerance*: permitted relative gap of the bounds. *budget*: maximum steps; 0: no limit.
    """
    pair, best = (first, second, faces, other_faces, budget), answers[0]
    x, y, z = vector(direction)
    unit, length = stack_f64(3), sqrt(dot(x, y, z, x, y, z))
    begin_exit(best)
    if length > 0.0:
        unit[0], unit[1], unit[2] = x / length, y / length, z / length
        try_direction(model, pair, unit, tolerance, 0.0, best)
    else:
        search_exit(model, pair, tolerance, best)


@kernel
def begin_exit(best):
    """Reset the best direction."""
    best.depth, best.lower, best.steps = np.inf, 0.0, 0
    for k in range(3):
        best.direction[k] = best.normal[k] = 0.0


@kernel
def try_direction(model, pair, direction, tolerance, expected, best):
    """Measure the depth along a direction; if it is less than the best, store it and return True.

    *pair*: parts, one face of each surface of either, and the budget. *expected*: depth, m; the first probe
    is slightly beyond it.
    """
    first, second, faces, other_faces, budget = pair
    found, limit = stack_depths(1)[0], best.depth
    found.upper = expected * (1.0 + BEYOND * tolerance)
    steps = max(budget - best.steps, 1) if budget > 0 else 0
    depth_along(model, first, second, faces, other_faces, direction, limit, tolerance, steps, found)
    best.steps += found.steps
    if not found.upper < limit:
        return False
    best.depth, best.lower = found.upper + 0.0, found.lower
    for k in range(3):
        best.direction[k] = direction[k]
    for k in range(3):  # after the direction, which may be the same memory
        best.normal[k] = found.normal[k]
    return True


@kernel
def search_exit(model, pair, tolerance, best):
    """Search for a direction with a small depth."""
    _compare_axes(model, pair, best)
    follow_normals(model, pair, ROUGH, best)
    if best.depth < np.inf and best.depth - best.lower > tolerance * best.depth:
        depth, lower, direction = best.depth, best.lower, stack_f64(3)
        best.depth = np.inf
        for k in range(3):
            direction[k] = best.direction[k]
        try_direction(model, pair, direction, tolerance, np.inf, best)
        if best.depth > depth:
            best.depth, best.lower = depth, lower


@kernel
def _compare_axes(model, pair, best):
    """Compare the axes of both parts and the line between their centres, sorted by coordinates."""
    one, other = model.frames[pair[0]], model.frames[pair[1]]
    axes, direction, count = stack_f64_rows(14, 3), stack_f64(3), 0
    for number in range(2 * AXES):
        axis, sign = number % AXES, 1.0 if number < AXES else -1.0
        for k in range(3):
            if axis < 3:
                direction[k] = one.rotation[3 * k + axis]
            elif axis < 6:
                direction[k] = other.rotation[3 * k + axis - 3]
            else:
                direction[k] = 0.5 * (one.box_lower[k] + one.box_upper[k]) - 0.5 * (
                    other.box_lower[k] + other.box_upper[k]
                )
        x, y, z = vector(direction)
        length = sqrt(dot(x, y, z, x, y, z)) if axis == 6 else 1.0
        if length == 0.0:
            continue
        for k in range(3):
            direction[k] = sign * direction[k] / length + 0.0
        count = _insert(axes, count, direction)
    for row in range(count):
        for k in range(3):
            direction[k] = axes[row, k]
        try_direction(model, pair, direction, ROUGH, 0.0, best)


@kernel
def _insert(axes, count, direction):
    """Insert a direction into sorted ones unless it is among them; return their number."""
    at = 0
    while at < count and _compared(axes, at, direction) < 0:
        at += 1
    if at < count and _compared(axes, at, direction) == 0:
        return count
    for row in range(count, at, -1):
        for k in range(3):
            axes[row, k] = axes[row - 1, k]
    for k in range(3):
        axes[at, k] = direction[k]
    return count + 1


@kernel
def _compared(axes, row, direction):
    """Compare a row with a direction: -1 if it is before it, 0 if equal, 1 if after it."""
    for k in range(3):
        if axes[row, k] != direction[k]:
            return -1 if axes[row, k] < direction[k] else 1
    return 0


@kernel
def follow_normals(model, pair, tolerance, best):
    """Turn the direction to the normal at which the part comes free, while that reduces the depth."""
    normal = stack_f64(3)
    for _ in range(MAX_EXIT_TURNS):
        for k in range(3):
            normal[k] = best.normal[k]
        x, y, z = vector(normal)
        # Approximate relative reduction of the depth by turning.
        gain = 1.0 - dot(x, y, z, *vector(best.direction))
        is_zero = x == 0.0 and y == 0.0 and z == 0.0
        if is_zero or gain < MIN_GAIN * tolerance:
            break
        if not try_direction(model, pair, normal, tolerance, best.depth, best):
            break
