"""A coarse grid of cells that are entirely inside, entirely outside, or crossed by the surface.

A scene tests many parts for containment, usually by one lookup in this grid. The grid is in the local frame
of the part and moves with it. It has two bits per cell, so sixteen cells per word. Only parts whose winding
number is an integer have a grid: in other parts, inside and outside may also change away from faces.
"""

import numpy as np

from proximity.kernels.geometry.rows import copy_row
from proximity.kernels.layout import (
    CELL_CROSSED,
    CELL_INSIDE,
    CELL_OUTSIDE,
    CELL_UNKNOWN,
    CELLS_PER_WORD,
    NO_GRID,
)
from proximity.kernels.mesh.positions import fetch_corners
from proximity.kernels.sign.winding_number import winding_number
from proximity.native import entry, inlined, kernel
from proximity.native.simd import load_int

CELL_SLACK = 1e-6
"""Distance, in cells, up to which a face counts as crossing a cell.

It is larger than all rounding of a lookup.
"""
SAMPLE_PITCH = 2.0
"""Distance, in cells, of the samples of a face in `uncertain_points`, along its longest side and across."""
SAMPLE_CLEARANCE = 1.0 + 4.0 * CELL_SLACK
"""Distance of samples from a face, in cells along its normal. The face does not cross the cells there."""
MAX_POINTS = 1024
"""Maximum number of points that `uncertain_points` returns. It must be even."""
CELLS_PER_FACE = 64
MIN_CELLS = 512
MAX_GRID = 2**18
"""Approximate maximum number of cells of a grid."""
MAX_ASPECT = 64.0
"""Maximum aspect ratio of the box for which a grid is sized."""
ORIGIN = 0.0, 0.0, 0.0


@entry("float64[:], int -> float, int, int, int")
def grid_size(extent, wanted):
    """Return the cells per unit of length of a grid over a box, and the numbers of cells along x, y and z.

    *extent*: (3,), sides of the box. *wanted*: approximate total number of cells.
    """
    least = max(extent[0], extent[1], extent[2]) / MAX_ASPECT
    volume = max(extent[0], least) * max(extent[1], least) * max(extent[2], least)
    if not volume > 0.0:
        return 1.0, 1, 1, 1
    rate = (wanted / volume) ** (1.0 / 3.0)
    return (
        rate,
        np.int64(np.floor(extent[0] * rate)) + 1,
        np.int64(np.floor(extent[1] * rate)) + 1,
        np.int64(np.floor(extent[2] * rate)) + 1,
    )


@inlined
def grid_words(part):
    """Return the number of words of a part's grid, or 0 if it has none."""
    cells = part.grid_x * part.grid_y * part.grid_z
    return (cells + CELLS_PER_WORD - 1) // CELLS_PER_WORD if part.grid != NO_GRID else np.int64(0)


@kernel
def cells_wanted(face_count):
    """Return the approximate number of cells that a part's grid should have."""
    return min(max(CELLS_PER_FACE * face_count, MIN_CELLS), MAX_GRID)


@inlined
def cell_state(words, at, lower, rate, counts, p):
    """Return the state of the cell that contains *p*, or `CELL_OUTSIDE` if the point is beyond the grid."""
    nx, ny, nz = counts
    fx, fy, fz = (p[0] - lower[0]) * rate, (p[1] - lower[1]) * rate, (p[2] - lower[2]) * rate
    if not (fx >= 0.0 and fy >= 0.0 and fz >= 0.0 and fx < nx and fy < ny and fz < nz):
        return CELL_OUTSIDE
    cell = (np.int64(fz) * ny + np.int64(fy)) * nx + np.int64(fx)
    return (load_int(words, at + cell // CELLS_PER_WORD) >> (2 * (cell % CELLS_PER_WORD))) & 3


@inlined
def _reach(states, first, end, stack, waiting):
    """Push a cell of each run of unknown cells from *first* to *end* on the *stack*. Return its size."""
    was_unknown = False
    for cell in range(first, end):
        is_unknown = states[cell] == CELL_UNKNOWN
        if is_unknown and not was_unknown:
            stack[waiting] = cell
            waiting += 1
        was_unknown = is_unknown
    return waiting


@kernel
def _spread(states, seed, state, nx, ny, nz, stack):
    """Set the state of a cell and of all cells that are connected to it without crossed cells between.

    Whole runs along x are set. Each cell of a run pushes at most four others.
    """
    stack[0] = seed
    waiting = 1
    while waiting:
        waiting -= 1
        first = np.int64(stack[waiting])
        if states[first] != CELL_UNKNOWN:
            continue
        row, end = first // nx, first + 1
        while first > nx * row and states[first - 1] == CELL_UNKNOWN:
            first -= 1
        while end < nx * (row + 1) and states[end] == CELL_UNKNOWN:
            end += 1
        for cell in range(first, end):
            states[cell] = state
        if row % ny > 0:
            waiting = _reach(states, first - nx, end - nx, stack, waiting)
        if row % ny < ny - 1:
            waiting = _reach(states, first + nx, end + nx, stack, waiting)
        if row >= ny:
            waiting = _reach(states, first - nx * ny, end - nx * ny, stack, waiting)
        if row < ny * (nz - 1):
            waiting = _reach(states, first + nx * ny, end + nx * ny, stack, waiting)


@entry(
    "float64[:, 3], int32[:, 3], float64[:], float, int, int, int, float64[:], float32[:], int, "
    "int -> uint32[:]",
    makes_arrays=True,
)
def build_grid(corners, faces, lower, rate, nx, ny, nz, reals, words, root, moments):
    """Return the packed states of a grid of cells, uint32.

    There are *nx ny nz* cells of size 1/*rate* from *lower* on. *corners*: (V, 3), *faces*: (F, 3), in the
    local frame. *reals*, *words*, *root*, *moments*: the part's tree.
    """
    states = np.full(nx * ny * nz, np.uint8(CELL_UNKNOWN))
    cell = np.empty(6, np.int64)
    size = np.array([nx, ny, nz])
    v = np.empty((3, 3))
    normal = np.empty(3)
    for face in range(len(faces)):
        fetch_corners(corners, faces, face)
        for corner in range(3):
            for axis in range(3):
                v[corner, axis] = (corners[faces[face, corner], axis] - lower[axis]) * rate
        for axis in range(3):
            low, high = min(v[0, axis], v[1, axis], v[2, axis]), max(v[0, axis], v[1, axis], v[2, axis])
            cell[axis] = min(max(np.int64(np.floor(low - CELL_SLACK)), 0), size[axis] - 1)
            cell[axis + 3] = min(max(np.int64(np.floor(high + CELL_SLACK)), 0), size[axis] - 1)
        for axis in range(3):
            j, k = (axis + 1) % 3, (axis + 2) % 3
            normal[axis] = (v[1, j] - v[0, j]) * (v[2, k] - v[0, k]) - (v[1, k] - v[0, k]) * (
                v[2, j] - v[0, j]
            )
        reach = (0.5 + CELL_SLACK) * (abs(normal[0]) + abs(normal[1]) + abs(normal[2]))
        for iz in range(cell[2], cell[5] + 1):
            for iy in range(cell[1], cell[4] + 1):
                for ix in range(cell[0], cell[3] + 1):
                    height = (
                        normal[0] * (ix + 0.5 - v[0, 0])
                        + normal[1] * (iy + 0.5 - v[0, 1])
                        + normal[2] * (iz + 0.5 - v[0, 2])
                    )
                    if abs(height) <= reach:
                        states[(iz * ny + iy) * nx + ix] = CELL_CROSSED

    # Connected cells that are not crossed are on one side: one winding number classifies all of them.
    stack = np.empty(4 * nx * ny * nz + 1, np.int32)
    for seed in range(nx * ny * nz):
        if states[seed] != CELL_UNKNOWN:
            continue
        ix, iy, iz = seed % nx, (seed // nx) % ny, seed // (nx * ny)
        turns = winding_number(
            reals,
            words,
            root,
            moments,
            lower[0] + (ix + 0.5) / rate,
            lower[1] + (iy + 0.5) / rate,
            lower[2] + (iz + 0.5) / rate,
        )
        state = CELL_INSIDE if turns > 0.5 else CELL_OUTSIDE
        _spread(states, seed, state, nx, ny, nz, stack)

    packed = np.zeros((len(states) + CELLS_PER_WORD - 1) // CELLS_PER_WORD, np.uint32)
    for index in range(len(states)):
        packed[index // CELLS_PER_WORD] |= np.uint32(states[index]) << np.uint32(2 * (index % CELLS_PER_WORD))
    return packed


@entry(
    "float64[:, 3], int32[:, 3], float64[:], float, int, int, int, "
    "uint32[:] -> float64[:, 3], bool[:], bool[:]",
    makes_arrays=True,
)
def uncertain_points(corners, faces, lower, rate, nx, ny, nz, grid):
    """Return points that a face and the grid classify differently, and the faces that are clear.

    Each face is sampled every `SAMPLE_PITCH` cells on both sides, at a distance at which it crosses no
    sampled cell. The points are (N, 3), local, at most `MAX_POINTS` and spread evenly. A second array, (N,)
    bool, states whether the grid classifies them as inside; a difference is correct if another face is in
    between. The third array, (F,) bool, marks clear faces, which have on each side a sampled cell that is not
    crossed. *grid*: from `build_grid`, with the same other arguments.
    """
    points, is_inside = np.empty((MAX_POINTS, 3)), np.empty(MAX_POINTS, np.bool_)
    is_clear = np.zeros(len(faces), np.bool_)
    count, met, stride = 0, 0, 1
    v = np.empty((3, 3))
    normal, point = np.empty(3), np.empty(3)
    for face in range(len(faces)):
        fetch_corners(corners, faces, face)
        for corner in range(3):
            for axis in range(3):
                v[corner, axis] = (corners[faces[face, corner], axis] - lower[axis]) * rate
        longest_sq, a = -1.0, 0
        for corner in range(3):
            other = (corner + 1) % 3
            x, y, z = v[other, 0] - v[corner, 0], v[other, 1] - v[corner, 1], v[other, 2] - v[corner, 2]
            length_sq = x * x + y * y + z * z
            if length_sq > longest_sq:
                longest_sq, a = length_sq, corner
        b, c = (a + 1) % 3, (a + 2) % 3
        area_sq = 0.0
        for axis in range(3):
            j, k = (axis + 1) % 3, (axis + 2) % 3
            normal[axis] = (v[b, j] - v[a, j]) * (v[c, k] - v[a, k]) - (v[b, k] - v[a, k]) * (
                v[c, j] - v[a, j]
            )
            area_sq += normal[axis] * normal[axis]
        if not area_sq > 0.0:
            is_clear[face] = True
            continue
        step = SAMPLE_CLEARANCE * (abs(normal[0]) + abs(normal[1]) + abs(normal[2])) / area_sq
        rows = np.int64(np.sqrt(area_sq / longest_sq) / SAMPLE_PITCH) + 1
        is_clear_above = is_clear_below = False
        for row in range(rows):
            to_c = (row + 1.0 / 3.0) / rows
            columns = np.int64((1.0 - to_c) * np.sqrt(longest_sq) / SAMPLE_PITCH) + 1
            for column in range(columns):
                to_b = (1.0 - to_c) * (column + 0.5) / columns
                for side in (1.0, -1.0):
                    for axis in range(3):
                        offset = to_b * (v[b, axis] - v[a, axis]) + to_c * (v[c, axis] - v[a, axis])
                        point[axis] = v[a, axis] + offset + side * step * normal[axis]
                    state = cell_state(grid, 0, ORIGIN, 1.0, (nx, ny, nz), point)
                    if state == CELL_CROSSED:
                        continue
                    is_clear_above = is_clear_above or side > 0.0
                    is_clear_below = is_clear_below or side < 0.0
                    if (state == CELL_INSIDE) == (side < 0.0):
                        continue
                    met += 1
                    if met % stride != 0:
                        continue
                    if count == MAX_POINTS:
                        count, stride = count // 2, 2 * stride
                        for kept in range(count):
                            copy_row(points, 2 * kept + 1, points, kept)
                            is_inside[kept] = is_inside[2 * kept + 1]
                    for axis in range(3):
                        points[count, axis] = lower[axis] + point[axis] / rate
                    is_inside[count] = state == CELL_INSIDE
                    count += 1
        is_clear[face] = is_clear_above and is_clear_below
    return points[:count].copy(), is_inside[:count].copy(), is_clear
