"""Order of rays in which neighbours enter the scene's box close together.

Nodes and blocks are then still in the cache from the previous ray, and branches are predicted better. A few
hundred cells suffice: they perform like the finest curve (2026-11: 0.88 of the walk's time near 43 k faces,
0.78 near 304 k; with thousands of cells 0.87, 0.78), so one counting pass is the whole sort.
"""

import numpy as np

from proximity.kernels.geometry.morton_order import sort_by_digit
from proximity.kernels.geometry.rows import columns, columns_from
from proximity.kernels.layout import LANES, ModelArrays
from proximity.kernels.stack_arrays import stack_f64, stack_i64
from proximity.native import allocating_kernel, entry, inlined
from proximity.native.simd import maximum, minimum, select, splat, store

MAX_HALVINGS = 9
"""Maximum number of splits of the box, each across its longest side: 512 cells."""
RAYS_OF_CELL = 8
"""Minimum average rays per cell, since counting in cells has a cost."""
ROUND_TO_WHOLE = 1.5 * 2.0**52
"""Adding and subtracting this rounds a number to an integer."""


@entry(ModelArrays, "float64[:, 3], float64[:, 3] -> int64[:]", makes_arrays=True)
def ray_order(model, origins, directions):
    """Return the rows of rays (N, 3), sorted by the cell of the scene's box that they enter first.

    Rays that start inside or miss the box use the origin, clamped to the box. Rows of one cell keep their
    order; cells are ordered by recursive halving.
    """
    frames = model.frames
    scene = len(frames) - 1
    lower, upper = frames[scene].box_lower, frames[scene].box_upper
    sides = np.empty(3)
    for axis in range(3):
        sides[axis] = upper[axis] - lower[axis]
    counts, ranks = _halve(sides, len(origins))
    rates = np.empty(3)
    for axis in range(3):
        rates[axis] = 1.0 / sides[axis] if sides[axis] > 0.0 else 0.0
    keys = _ranks_of_cells(origins, directions, lower, upper, rates, counts, ranks)
    rows, order = np.empty(len(origins), np.int64), np.empty(len(origins), np.int64)
    for row in range(len(origins)):
        rows[row] = row
    sort_by_digit(keys, np.uint32(0), np.empty(len(ranks), np.int64), rows, order)
    return order


@allocating_kernel
def _halve(sides, row_count):
    """Split a box with sides (3,) into cells, according to the number of rays.

    *sides* become those of the cells. Returns the number of cells along x, y and z, and the rank of each.
    """
    halvings = 0
    while halvings < MAX_HALVINGS and (RAYS_OF_CELL << halvings) < row_count:
        halvings += 1
    counts, axes = np.ones(3, np.int64), np.empty(halvings, np.int64)
    for i in range(halvings):
        axis = 0
        for other in range(1, 3):
            axis = other if sides[other] > sides[axis] else axis
        axes[i] = axis
        sides[axis] *= 0.5
        counts[axis] *= 2
    ranks, steps = np.zeros(1 << halvings, np.uint32), np.ones(3, np.int64)
    steps[1], steps[2] = counts[0], counts[0] * counts[1]
    for i in range(halvings):
        # From the last split on: the half that a cell is in.
        step = steps[axes[halvings - 1 - i]]
        for cell in range(len(ranks)):
            ranks[cell] |= np.uint32(((cell // step) & 1) << i)
        steps[axes[halvings - 1 - i]] *= 2
    return counts, ranks


@allocating_kernel
def _ranks_of_cells(origins, directions, lower, upper, rates, counts, ranks):
    """Return the rank of each ray's cell; a ray that is not finite is in some cell."""
    row_count = len(origins)
    found = np.empty(row_count, np.uint32)
    stride_y, stride_z = float(counts[0]), float(counts[0] * counts[1])
    offsets, numbers = stack_i64(LANES), stack_f64(LANES)
    for at in range(0, row_count, LANES):
        x, y, z = columns_from(origins, at, offsets)
        dx, dy, dz = columns(directions, offsets, 0)
        enter_x, enter_y = _enters(x, dx, lower[0], upper[0]), _enters(y, dy, lower[1], upper[1])
        enter = maximum(maximum(enter_x, enter_y), _enters(z, dz, lower[2], upper[2]))
        number = (
            _cell(x + enter * dx, lower[0], rates[0], counts[0])
            + _cell(y + enter * dy, lower[1], rates[1], counts[1]) * splat(stride_y)
            + _cell(z + enter * dz, lower[2], rates[2], counts[2]) * splat(stride_z)
        )
        store(numbers, 0, number)
        for k in range(min(LANES, row_count - at)):
            found[at + k] = ranks[np.int64(numbers[k])]
    return found


@inlined
def _enters(o, direction, lower, upper):
    """Return the parameters at which one coordinate of eight rays reaches the box; 0 if it does not."""
    near = select(direction > splat(0.0), splat(lower), splat(upper)) - o
    return select(near * direction > splat(0.0), near / direction, splat(0.0))


@inlined
def _cell(coordinate, lower, rate, count):
    """Return the cell number along one axis, below *count*; 0 for nan."""
    along = (coordinate - splat(lower)) * splat(rate)
    whole = ((along - splat(0.5)) + splat(ROUND_TO_WHOLE)) - splat(ROUND_TO_WHOLE)
    return minimum(maximum(whole, splat(0.0)), splat(count - 1.0))
