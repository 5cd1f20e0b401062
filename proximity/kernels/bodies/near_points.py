"""Pairs of near points, from a k-d tree."""

from math import sqrt

import numpy as np

from proximity.kernels.mesh.edges import sort_run
from proximity.kernels.stack_arrays import stack_f64, stack_i64
from proximity.native import allocating_kernel, kernel

NEAR_COUNT = 8
"""Number of neighbours stored for each point.

If more are at one position, they are found through one another.
"""
LEAF_SIZE = 8
STACK_LENGTH = 96
"""Length of the stack, enough for 2**31 points. Each level halves a run and pushes one half."""


@allocating_kernel
def near_pairs(points, reach):
    """Return the nearest neighbours of each point, (N, NEAR_COUNT) int32, and their distances.

    The nearest comes first; -1 fills the row if fewer are within *reach*. *points*: (N, 3).
    """
    order, axes, splits = _tree_over(points)
    near, distances = np.full((len(points), NEAR_COUNT), -1, np.int32), np.empty((len(points), NEAR_COUNT))
    for row in range(len(points)):
        count = _find_near(points, (order, axes, splits), row, reach, near[row], distances[row])
        for n in range(count):
            distances[row, n] = sqrt(distances[row, n])
    return near, distances


@allocating_kernel
def _tree_over(points):
    """Build a k-d tree by halving each run of points along its longest axis.

    Return the order of the points, and the axes and the cut coordinates, both by the position between two
    halves.
    """
    count = len(points)
    order, axes, splits = np.empty(count, np.int32), np.empty(count, np.int32), np.empty(count)
    keys, other_keys, other_rows = np.empty(count), np.empty(count), np.empty(count, np.int32)
    for row in range(count):
        order[row] = row
    stack, depth = stack_i64(STACK_LENGTH), 2
    stack[0], stack[1] = 0, count
    while depth > 0:
        depth -= 2
        first, end = stack[depth], stack[depth + 1]
        if end - first <= LEAF_SIZE:
            continue
        axis = _longest_axis(points, order, first, end)
        for position in range(first, end):
            keys[position] = points[order[position], axis]
        sort_run(keys, order, first, end, other_keys, other_rows)
        middle = (first + end) // 2
        axes[middle], splits[middle] = axis, keys[middle]
        stack[depth], stack[depth + 1], stack[depth + 2], stack[depth + 3] = first, middle, middle, end
        depth += 4
    return order, axes, splits


@kernel
def _longest_axis(points, order, first, end):
    longest, extent = 0, -1.0
    for axis in range(3):
        low, high = np.inf, -np.inf
        for position in range(first, end):
            value = points[order[position], axis]
            low, high = min(low, value), max(high, value)
        if high - low > extent:
            longest, extent = axis, high - low
    return longest


@kernel
def _find_near(points, tree, row, reach, near, distances_sq):
    """Write the nearest neighbours of a point and their squared distances. Return their number."""
    order, axes, splits = tree
    x, y, z, count = points[row, 0], points[row, 1], points[row, 2], 0
    stack, bounds, depth = stack_i64(STACK_LENGTH), stack_f64(STACK_LENGTH), 2
    stack[0], stack[1], bounds[0] = 0, len(order), 0.0
    while depth > 0:
        depth -= 2
        first, end = stack[depth], stack[depth + 1]
        if bounds[depth] > reach or (
            count == NEAR_COUNT and bounds[depth] * bounds[depth] > distances_sq[count - 1]
        ):
            continue  # prune
        if end - first > LEAF_SIZE:
            middle = (first + end) // 2
            axis = axes[middle]
            offset = points[row, axis] - splits[middle]
            # Push the farther half first, so that the nearer is popped next.
            for half in range(2):
                is_upper = (half == 0) != (offset >= 0.0)
                stack[depth] = middle if is_upper else first
                stack[depth + 1] = end if is_upper else middle
                bounds[depth] = abs(offset) if half == 0 else 0.0
                depth += 2
            continue
        for position in range(first, end):
            other = order[position]
            dx, dy, dz = points[other, 0] - x, points[other, 1] - y, points[other, 2] - z
            distance_sq = dx * dx + dy * dy + dz * dz
            if other == row or sqrt(distance_sq) > reach:
                continue
            if count == NEAR_COUNT and distance_sq >= distances_sq[count - 1]:
                continue
            at = count if count < NEAR_COUNT else count - 1
            count = at + 1
            while at > 0 and distances_sq[at - 1] > distance_sq:
                distances_sq[at], near[at] = distances_sq[at - 1], near[at - 1]
                at -= 1
            distances_sq[at], near[at] = distance_sq, other
    return count
