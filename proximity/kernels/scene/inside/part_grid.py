"""The grid over a scene whose cells list the parts that may contain a point.

The cells of a coarse grid list the parts that are at their initial pose: those that have an inside and are
not entirely outside the cell. One or two lookups replace a test of all boxes. The lists never change: a
part that has moved since, or is hidden, is skipped, and moved parts are found by their boxes in the dynamic
tree.

The parts of a point are processed in *turns* of up to `LANES`: first the lists, then the dynamic tree.
"""

import numpy as np

from proximity.kernels.geometry.box import point_boxes_distance_sq
from proximity.kernels.geometry.frames import LENGTH_ROUNDING, ignores_some, to_local
from proximity.kernels.layout import CELLS_PER_WORD, LANES, NO_GRID, NODE_PARTS, NODE_STRIDE
from proximity.kernels.sign.inside_grid import CELL_SLACK
from proximity.native import entry, inlined, kernel
from proximity.native.simd import bits, load_int, splat32, trailing_zeros


@inlined
def list_of(words, frames, parts, x, y, z):
    """Return the first and the end word of the list of parts that may contain a point of the scene's frame.

    A single part has no list: its own row gives its sign grid.
    """
    scene = len(parts) - 1
    if scene == 1:
        return np.int64(0), np.int64(0)
    nx, ny, nz = parts[scene].grid_x, parts[scene].grid_y, parts[scene].grid_z
    rate = frames[scene].grid_rate
    fx = (x - frames[scene].grid_lower[0]) * rate
    fy = (y - frames[scene].grid_lower[1]) * rate
    fz = (z - frames[scene].grid_lower[2]) * rate
    # A scene without listed parts has no cells.
    if not (fx >= 0.0 and fy >= 0.0 and fz >= 0.0 and fx < nx and fy < ny and fz < nz):
        return np.int64(0), np.int64(0)
    base = parts[scene].grid
    at = base + (np.int64(fz) * ny + np.int64(fy)) * nx + np.int64(fx)
    return base + load_int(words, at), base + load_int(words, at + 1)


@inlined
def turns_of_list(first, last):
    """Return the number of turns of a list."""
    return (last - first + LANES - 1) // LANES


@inlined
def dynamic_turn_count(parts):
    """Return the number of turns of the dynamic parts."""
    return (parts[len(parts) - 1].dynamic_count + LANES - 1) // LANES


@inlined
def listed_bits(words, frames, parts, at, last, x, y, z):
    """Return as bits which of up to eight parts, listed from word *at*, may contain a point."""
    containing = np.int64(0)
    for lane in range(min(LANES, last - at)):
        part = load_int(words, at + lane)
        may_contain = parts[part].is_dynamic == 0 and parts[part].is_hidden == 0
        if parts[part].grid == NO_GRID:
            may_contain = may_contain and _is_in_box(frames, part, x, y, z)
        containing |= np.int64(may_contain) << lane
    return containing


@inlined
def _is_in_box(frames, part, x, y, z):
    return (
        frames[part].box_lower[0] <= x <= frames[part].box_upper[0]
        and frames[part].box_lower[1] <= y <= frames[part].box_upper[1]
        and frames[part].box_lower[2] <= z <= frames[part].box_upper[2]
    )


@inlined
def dynamic_bits(words, parts, turn, sx, sy, sz):
    """Return as bits which of up to eight dynamic parts have a point in their boxes, and the first's word.

    *sx sy sz*: float32x8 splats, scene's scaled frame.
    """
    scene = len(parts) - 1
    node, mask = parts[scene].super_node, np.int64(-1)
    if parts[scene].dynamic_count < LANES:
        mask ^= 1  # all are in the super node, next to the static tree
    else:
        node += 1 + turn
    base = NODE_STRIDE * node
    within = mask & bits(point_boxes_distance_sq(words, base, sx, sy, sz) <= splat32(np.float32(0.0)))
    if ignores_some(parts):
        left = within
        while left:
            part = load_int(words, base + NODE_PARTS + trailing_zeros(left))
            within &= ~(left & -left) if parts[part].is_hidden else np.int64(-1)
            left &= left - 1
    return within, base + NODE_PARTS


@inlined
def turns_of(parts, search):
    """Return the number of turns of all parts that may contain a point; *search*: from `sought`."""
    return np.int64(1) if len(parts) == 2 else turns_of_list(search[0], search[1]) + dynamic_turn_count(parts)


@inlined
def sought(model, point):
    """Return the arguments of `containing_bits` for a point: the ends of its list, and its splats."""
    _, words, frames, parts = model
    x, y, z = point
    first, last = list_of(words, frames, parts, x, y, z)
    sx, sy, sz = to_local(frames, parts, len(parts) - 1, x, y, z)
    return first, last, splat32(np.float32(sx)), splat32(np.float32(sy)), splat32(np.float32(sz))


@inlined
def containing_bits(model, search, turn, point):
    """Return as bits which of up to eight parts may contain a point, and the first's word.

    *point*: of the scene's frame; *search*: from `sought`. `lowest_part` reads the part of the lowest bit.
    """
    _, words, frames, parts = model
    first, last, sx, sy, sz = search
    x, y, z = point
    if len(parts) == 2:
        return np.int64(parts[0].is_hidden == 0), np.int64(0)
    lists = turns_of_list(first, last)
    if turn < lists:
        at = first + LANES * turn
        return listed_bits(words, frames, parts, at, last, x, y, z), at
    return dynamic_bits(words, parts, turn - lists, sx, sy, sz)


@inlined
def lowest_part(model, at, containing):
    """Return the part of the lowest bit of *containing*; *at*: from `containing_bits`."""
    if len(model.parts) == 2:
        return np.int64(0)
    return np.int64(load_int(model.words, at + trailing_zeros(containing)))


@entry("Frame[:], Part[:], int, uint32[:], float64[:], float, int, int, int -> int32[:]", makes_arrays=True)
def cells_of_part(frames, parts, part, grid, lower, rate, nx, ny, nz):
    """Return the cells (int32, ascending) of a grid over the scene in which a part may contain a point.

    *lower* (3,), m, *rate*, cells per metre: of that grid. *grid* (uint32): the part's sign grid; without
    one, the cells that intersect its box.
    """
    size = np.array([nx, ny, nz])
    first, count = np.empty(3, np.int64), np.empty(3, np.int64)
    for axis in range(3):
        low = np.floor((frames[part].box_lower[axis] - lower[axis]) * rate - CELL_SLACK)
        high = np.floor((frames[part].box_upper[axis] - lower[axis]) * rate + CELL_SLACK)
        first[axis] = np.int64(min(max(low, 0.0), size[axis] - 1.0))
        count[axis] = np.int64(min(max(high, 0.0), size[axis] - 1.0)) - first[axis] + 1
    cells = np.empty(count[0] * count[1] * count[2], np.int32)
    found = 0
    half = np.empty(3)
    for own in range(3):
        half[own] = 0.0
        for axis in range(3):
            half[own] += abs(frames[part].rotation[3 * axis + own]) * (0.5 + CELL_SLACK) / rate
    for iz in range(first[2], first[2] + count[2]):
        for iy in range(first[1], first[1] + count[1]):
            for ix in range(first[0], first[0] + count[0]):
                cells[found] = (iz * ny + iy) * nx + ix
                x, y, z = (
                    lower[0] + (ix + 0.5) / rate,
                    lower[1] + (iy + 0.5) / rate,
                    lower[2] + (iz + 0.5) / rate,
                )
                found += len(grid) == 0 or _is_occupied(frames, parts, part, grid, x, y, z, half)
    return cells[:found].copy()


@kernel
def _is_occupied(frames, parts, part, grid, x, y, z, half):
    """Test whether a part's sign grid has a cell that is not outside within *half* (3,), m, of a point."""
    px, py, pz = to_local(frames, parts, part, x, y, z)
    scale = frames[part].scale
    reach = abs(x) + abs(y) + abs(z)
    for axis in range(3):
        reach += abs(frames[part].translation[axis]) + abs(frames[part].centre[axis])
    slack = LENGTH_ROUNDING * (reach + 1.0 / scale)
    rate = frames[part].grid_rate
    low_x, high_x = _range(
        px - frames[part].grid_lower[0], (half[0] + slack) * scale, rate, parts[part].grid_x
    )
    low_y, high_y = _range(
        py - frames[part].grid_lower[1], (half[1] + slack) * scale, rate, parts[part].grid_y
    )
    low_z, high_z = _range(
        pz - frames[part].grid_lower[2], (half[2] + slack) * scale, rate, parts[part].grid_z
    )
    for iz in range(low_z, high_z):
        for iy in range(low_y, high_y):
            row = (iz * parts[part].grid_y + iy) * parts[part].grid_x
            if _any_in_row(grid, row + low_x, row + high_x):
                return True
    return False


@inlined
def _range(coordinate, half, rate, count):
    """Return the range of cells that an interval along an axis covers."""
    low = np.floor((coordinate - half) * rate - CELL_SLACK)
    high = np.floor((coordinate + half) * rate + CELL_SLACK) + 1.0
    return np.int64(min(max(low, 0.0), np.float64(count))), np.int64(min(max(high, 0.0), np.float64(count)))


@inlined
def _any_in_row(grid, first, last):
    """Test whether a cell from *first* up to *last* is not outside, the state that is zero."""
    for word in range(first // CELLS_PER_WORD, (last + CELLS_PER_WORD - 1) // CELLS_PER_WORD):
        low = max(first - word * CELLS_PER_WORD, 0)
        high = min(last - word * CELLS_PER_WORD, CELLS_PER_WORD)
        if np.int64(grid[word]) & ((np.int64(1) << (2 * high)) - (np.int64(1) << (2 * low))):
            return True
    return False
