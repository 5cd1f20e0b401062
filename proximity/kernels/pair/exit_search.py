"""The way out of two parts in each other: a direction along which the first one soon comes free."""

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
"""Times that the direction follows the surface at which a part comes free."""
BEYOND = 0.4
"""Of the tolerance: so much beyond the depth expected parts should be apart."""
MIN_GAIN = 0.25
"""Of the tolerance: for less a direction is not turned."""
ROUGH = 0.1
"""Tolerance while directions are compared."""
AXES = 7
"""Directions that are compared, both ways: the axes of both parts, and the line between their middles."""

stack_depths, _ = stack_arrays_of(DEPTH_ANSWER)


@entry(ModelArrays, "int, int, int32[:], int32[:], float64[:], float, int, ExitAnswer[:]")
def find_exit(model, first, second, faces, other_faces, direction, tolerance, budget, answers):
    """Fill the way of the first part out of the second; (1,).

    *faces*, *other_faces*: one of each of their surfaces. *direction*: scene's frame; 0: any that is short.
    *tolerance*: share of the depth by which its bounds may differ. *budget*: steps; 0: as many as it takes.
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
    """Forget the way."""
    best.depth, best.lower, best.steps = np.inf, 0.0, 0
    for k in range(3):
        best.direction[k] = best.normal[k] = 0.0


@kernel
def try_direction(model, pair, direction, tolerance, expected, best):
    """Keep a direction if the depth along it is less than along the best so far; return whether it is.

    *pair*: parts, one face of each surface of either, and the budget. *expected*: depth, m, that the first
    probe exceeds by a little.
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
    for k in range(3):  # which may be the direction
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
    """Compare the axes of both parts and the line between their middles, sorted by coordinates."""
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
    """Insert a direction among sorted ones that differ; return how many they are."""
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
    """Whether a row is before a direction, -1, the same, 0, or behind it, 1."""
    for k in range(3):
        if axes[row, k] != direction[k]:
            return -1 if axes[row, k] < direction[k] else 1
    return 0


@kernel
def follow_normals(model, pair, tolerance, best):
    """Turn the direction to the normal at which the part comes free, while that makes the depth less."""
    normal = stack_f64(3)
    for _ in range(MAX_EXIT_TURNS):
        for k in range(3):
            normal[k] = best.normal[k]
        x, y, z = vector(normal)
        # The share of the depth that turning saves, about.
        gain = 1.0 - dot(x, y, z, *vector(best.direction))
        is_zero = x == 0.0 and y == 0.0 and z == 0.0
        if is_zero or gain < MIN_GAIN * tolerance:
            break
        if not try_direction(model, pair, normal, tolerance, best.depth, best):
            break
