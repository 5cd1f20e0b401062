"""Assembly of separate parts into the model of one scene.

There are five steps, between which the caller allocates memory. `write_part_row` writes the rows of each
part, `copy_nodes` collects their nodes, `plan_scene` builds the tree over the parts and plans the layout,
`copy_part` copies the arrays of each part, and `finish_scene` writes the remaining arrays.
"""

import numpy as np

from proximity.kernels.geometry.rows import copy_numbers
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    FOLDED_AT,
    LANES,
    MOMENT_STRIDE,
    NO_GRID,
    NODE_CHILDREN,
    NODE_STRIDE,
    ORIENTED_STRIDE,
    REGION_COPIES,
    SIGN_NONE,
    ModelArrays,
)
from proximity.kernels.scene.inside.part_grid import cells_of_part
from proximity.kernels.scene.parts.part_trees import (
    begin_moving,
    choose_frame,
    copy_offsets,
    static_tree,
    write_static,
)
from proximity.kernels.scene.parts.placement import update_box, write_pose
from proximity.kernels.sign.inside_grid import grid_size, grid_words
from proximity.kernels.stack_arrays import stack_f64
from proximity.native import allocating_kernel, entry, inlined, kernel

SPARE = 1.25
"""Capacity of the static tree, as a multiple of its first size.

Opening other parts may need a larger tree.
"""
LINE_REALS, LINE_WORDS = 8, 16
"""Number of reals and number of words in a cache line, to which each array is aligned."""
CELLS_PER_PART = 64
"""Number of cells per part in the grid over a scene.

For 118 touching parts, 16 times as many bring no gain.
"""
MAX_CELLS = 2**18
LONGEST = 4
"""Maximum average number of parts listed per cell.

If a scene has more, the grid gets fewer and larger cells.
"""
CELLS_OF_ONE = 64
"""Upper bound of the number of cells in a grid for which one cell was requested."""


@inlined
def _on_line(count, line):
    """Round *count* up to whole cache lines."""
    return (count + line - 1) // line * line


@entry(ModelArrays, "int, Frame[:], Part[:], int, float64[:, 4], float")
def write_part_row(source, row, frames, parts, to, matrix, rounding):
    """Copy a row of *source* to row *to* of a new model, at another pose. Call it in the order of the rows.

    *matrix*: (4, 4), the pose. *rounding*: error up to which a rotation is used as given.
    """
    frames[to], parts[to] = source.frames[row], source.parts[row]
    parts[to].root = parts[to - 1].root + parts[to - 1].node_count if to else 0
    parts[to].first_block = parts[to - 1].first_block + parts[to - 1].block_count if to else 0
    write_pose(frames, to, matrix, rounding)
    update_box(frames, parts, to)


@entry(ModelArrays, "int, float32[:], Part[:], int")
def copy_nodes(source, row, nodes, parts, to):
    """Copy the nodes of a row of *source* into the *nodes* of all parts, and renumber them."""
    first, target, words = NODE_STRIDE * source.parts[row].root, NODE_STRIDE * parts[to].root, source.words
    numbers, copies = words.view(np.int32), nodes.view(np.int32)
    node_shift = parts[to].root - source.parts[row].root
    block_shift = parts[to].first_block - source.parts[row].first_block
    copy_numbers(numbers, first, copies, target, NODE_STRIDE * parts[to].node_count)
    for node in range(parts[to].node_count):
        for lane in range(LANES):
            at = NODE_STRIDE * node + lane
            if words[first + at] <= words[first + at + 24]:
                child = numbers[first + at + NODE_CHILDREN]
                copies[target + at + NODE_CHILDREN] = (
                    child + node_shift if child >= 0 else child - block_shift
                )


@entry("float32[:], Frame[:], Part[:] -> float32[:], int32[:, :], int, int", makes_arrays=True)
def plan_scene(nodes, frames, parts):
    """Build the tree over the parts, and plan the layout of the model.

    Return the nodes and the entries of the tree, and the numbers of reals and words of the model. The number
    of reals is 0 if the parts are too far apart for one frame. The scene's row and the layout are written.
    """
    scene, largest, widest, oblique = len(parts) - 1, 0, -1.0, np.int64(0)
    node_count, block_count, face_count = np.int64(0), np.int64(0), np.int64(0)
    for part in range(scene):
        node_count += parts[part].node_count
        block_count += parts[part].block_count
        face_count += parts[part].face_count
        oblique += parts[part].block_count if parts[part].is_oblique else 0
        extent = 0.0
        for axis in range(3):
            extent = max(extent, frames[part].own_upper[axis] - frames[part].own_lower[axis])
        if extent > widest:
            largest, widest = part, extent
    centre = np.empty(3)
    for axis in range(3):
        centre[axis] = frames[largest].centre[axis]
    parts[scene].is_oblique, parts[scene].face_count = 2 * oblique >= block_count, face_count
    # The frame of the largest part: parts in one frame can be traversed as one tree.
    if not choose_frame(frames, parts, centre, frames[largest].scale):
        return np.zeros(0, np.float32), np.zeros((0, 2), np.int32), np.int64(0), np.int64(0)
    static, entries = static_tree(nodes, frames, parts, node_count + 1)
    parts[scene].first_node, parts[scene].static_capacity = node_count, 0
    if scene > 1:
        static_count = max(len(static), _tree_over_all(nodes, frames, parts)) // NODE_STRIDE
        parts[scene].static_capacity = np.int64(SPARE * static_count) + LANES
    _, _, node_end = copy_offsets(parts, REGION_COPIES)
    reals, words = lay_out(parts, max(node_end, node_count + 1), _plan_lists(frames, parts))
    return static, entries, reals, words


@allocating_kernel
def _tree_over_all(nodes, frames, parts):
    """Return the length that the static tree would have over all parts, or 0 if none is dynamic or hidden."""
    scene, count = len(parts) - 1, 0
    flags = np.empty((scene, 2), np.int64)
    for part in range(scene):
        flags[part, 0], flags[part, 1] = parts[part].is_dynamic, parts[part].is_hidden
        count += flags[part, 0] + flags[part, 1]
        parts[part].is_dynamic = parts[part].is_hidden = 0
    length = len(static_tree(nodes, frames, parts, 0)[0]) if count else 0
    for part in range(scene):
        parts[part].is_dynamic, parts[part].is_hidden = flags[part, 0], flags[part, 1]
    return length


@kernel
def lay_out(parts, node_end, list_space):
    """Write the offsets of all arrays that follow node *node_end*. Return the numbers of reals and words.

    The arrays have the order of `clear_gaps`, and each is aligned to a cache line.
    """
    scene = len(parts) - 1
    blocks = parts[scene - 1].first_block + parts[scene - 1].block_count
    real = _on_line(BLOCK_STRIDE * blocks, LINE_REALS)
    slot_faces = _on_line(NODE_STRIDE * node_end, LINE_WORDS)
    moments = slot_faces + _on_line(LANES * blocks, LINE_WORDS)
    boxes = moments + _on_line(MOMENT_STRIDE * parts[scene].first_node, LINE_WORDS)
    word = boxes + _on_line(ORIENTED_STRIDE * blocks, LINE_WORDS)
    for part in range(scene):
        row = parts[part]
        corner_reals = _on_line(3 * row.corner_count, LINE_REALS)
        row.corners, row.corner_normals = real, real + corner_reals
        real += 2 * corner_reals
        face_words = _on_line(3 * row.face_count, LINE_WORDS)
        row.faces, row.neighbors = word, word + face_words
        word += 2 * face_words
        row.grid = word if row.grid != NO_GRID else NO_GRID
        word += _on_line(grid_words(row), LINE_WORDS)
    for each in range(scene + 1):
        parts[each].slot_faces, parts[each].moments, parts[each].block_boxes = slot_faces, moments, boxes
        parts[each].block_notes = word
    parts[scene].grid = word + _on_line(blocks, LINE_WORDS)
    return real, parts[scene].grid + _on_line(list_space, LINE_WORDS)


@kernel
def clear_gaps(model):
    """Write zeros between the arrays of `lay_out`, so that equal models have equal memory."""
    reals, words, _, parts = model
    scene = len(parts) - 1
    blocks = parts[scene - 1].first_block + parts[scene - 1].block_count
    _clear(words, NODE_STRIDE * parts[scene].first_node, parts[scene].slot_faces)
    _clear(words, parts[scene].slot_faces + LANES * blocks, parts[scene].moments)
    _clear(words, parts[scene].moments + MOMENT_STRIDE * parts[scene].first_node, parts[scene].block_boxes)
    word, real = parts[scene].block_boxes + ORIENTED_STRIDE * blocks, BLOCK_STRIDE * blocks
    for part in range(scene):
        row, corner_reals = parts[part], 3 * parts[part].corner_count
        _clear(reals, real, row.corners)
        _clear(reals, row.corners + corner_reals, row.corner_normals)
        real = row.corner_normals + corner_reals
        _clear(words, word, row.faces)
        _clear(words, row.faces + 3 * row.face_count, row.neighbors)
        word = row.neighbors + 3 * row.face_count
        if row.grid != NO_GRID:
            _clear(words, word, row.grid)
            word = row.grid + grid_words(row)
    _clear(reals, real, len(reals))
    _clear(words, word, parts[scene].block_notes)
    _clear(words, parts[scene].block_notes + blocks, parts[scene].grid)


@inlined
def _clear(numbers, first, end):
    for k in range(first, end):
        numbers[k] = 0.0


@inlined
def grid_at(row):
    """Return the offset of a part's sign grid."""
    return row.neighbors + _on_line(3 * row.face_count, LINE_WORDS)


# --- the grid over the parts -----------------------------------------------------------------------------


@inlined
def _is_listed(parts, part):
    return parts[part].sign != SIGN_NONE and not parts[part].is_dynamic


@kernel
def _listed_count(parts):
    count = np.int64(0)
    for part in range(len(parts) - 1):
        count += _is_listed(parts, part)
    return count


@inlined
def _list_space(cells, count):
    """Return the maximum number of entries in the lists of a grid over *count* parts."""
    return max(LONGEST * cells, CELLS_OF_ONE * count)


@kernel
def _plan_lists(frames, parts):
    """Choose the grid over the parts that have an inside. Return the maximum number of words of its lists."""
    count = _listed_count(parts)
    cells = _choose_cells(frames, parts, min(CELLS_PER_PART * count, MAX_CELLS))
    return cells + 1 + _list_space(cells, count) if cells else cells


@kernel
def _choose_cells(frames, parts, wanted):
    """Write a grid of about *wanted* cells to the scene's row.

    Return its number of cells, or 0 if none is needed.
    """
    scene = len(parts) - 1
    lower, extent, row = frames[scene].grid_lower, stack_f64(3), parts[scene]
    if scene == 1 or wanted == 0:
        lower[0] = lower[1] = lower[2] = frames[scene].grid_rate = 0.0
        row.grid_x = row.grid_y = row.grid_z = 0
        return row.grid_x
    for axis in range(3):
        lower[axis], upper = np.inf, -np.inf
        for part in range(scene):
            if _is_listed(parts, part):
                lower[axis] = min(lower[axis], frames[part].box_lower[axis])
                upper = max(upper, frames[part].box_upper[axis])
        extent[axis] = upper - lower[axis]
    frames[scene].grid_rate, row.grid_x, row.grid_y, row.grid_z = grid_size(extent, wanted)
    return row.grid_x * row.grid_y * row.grid_z


@allocating_kernel
def _write_lists(words, frames, parts):
    """Write the lists of the grid over the parts, and return where they end."""
    scene, count = len(parts) - 1, _listed_count(parts)
    wanted = min(CELLS_PER_PART * count, MAX_CELLS)
    cell_count = _choose_cells(frames, parts, wanted)
    if cell_count == 0:
        return parts[scene].grid
    listed, ends = np.empty(_list_space(cell_count, count), np.int32), np.zeros(scene, np.int64)
    limit = LONGEST * cell_count if wanted > 1 else len(listed)
    while not _collect_cells(words, frames, parts, limit, listed, ends):
        wanted = max(wanted // 8, 1)
        cell_count = _choose_cells(frames, parts, wanted)
        limit = LONGEST * cell_count if wanted > 1 else len(listed)
    numbers, base = words.view(np.int32), parts[scene].grid
    total = ends[scene - 1]
    for cell in range(cell_count + 1):
        numbers[base + cell] = cell_count + 1
    for k in range(total):
        numbers[base + listed[k] + 1] += 1
    for cell in range(cell_count):
        numbers[base + cell + 1] += numbers[base + cell] - (cell_count + 1)
    to = np.empty(cell_count, np.int64)
    for cell in range(cell_count):
        to[cell] = base + numbers[base + cell]
    k = np.int64(0)
    for part in range(scene):
        while k < ends[part]:
            numbers[to[listed[k]]] = part
            to[listed[k]] += 1
            k += 1
    return base + cell_count + 1 + total


@allocating_kernel
def _collect_cells(words, frames, parts, limit, listed, ends):
    """Write the cells of each part one after another, and the end of each part's cells.

    Return whether their number is within *limit*.
    """
    scene, total = len(parts) - 1, np.int64(0)
    lower = np.empty(3)
    for axis in range(3):
        lower[axis] = frames[scene].grid_lower[axis]
    for part in range(scene):
        if _is_listed(parts, part):
            first = max(parts[part].grid, 0)
            grid = words.view(np.uint32)[first : first + grid_words(parts[part])]
            cells = cells_of_part(
                frames, parts, part, grid, lower, frames[scene].grid_rate,
                parts[scene].grid_x, parts[scene].grid_y, parts[scene].grid_z,
            )  # fmt: skip
            if total + len(cells) > limit:
                return False
            for k in range(len(cells)):
                listed[total + k] = cells[k]
            total += len(cells)
        ends[part] = total
    return True


# --- copying ---------------------------------------------------------------------------------------------


@entry(ModelArrays, "int", ModelArrays, "int")
def copy_part(source, row, target, to):
    """Copy the arrays of a row of *source*, except its nodes, to their places in a planned model."""
    old, new = source.parts[row], target.parts[to]
    blocks, slots = new.block_count, LANES * new.block_count
    copy_numbers(
        source.reals,
        BLOCK_STRIDE * old.first_block,
        target.reals,
        BLOCK_STRIDE * new.first_block,
        BLOCK_STRIDE * blocks,
    )
    copy_numbers(source.reals, old.corners, target.reals, new.corners, 3 * new.corner_count)
    copy_numbers(source.reals, old.corner_normals, target.reals, new.corner_normals, 3 * new.corner_count)
    numbers, copies = source.words.view(np.int32), target.words.view(np.int32)
    copy_numbers(
        numbers,
        old.slot_faces + LANES * old.first_block,
        copies,
        new.slot_faces + LANES * new.first_block,
        slots,
    )
    copy_numbers(
        numbers, old.moments + MOMENT_STRIDE * old.root, copies, new.moments + MOMENT_STRIDE * new.root,
        MOMENT_STRIDE * new.node_count,
    )  # fmt: skip
    copy_numbers(
        numbers, old.block_boxes + ORIENTED_STRIDE * old.first_block,
        copies, new.block_boxes + ORIENTED_STRIDE * new.first_block, ORIENTED_STRIDE * blocks,
    )  # fmt: skip
    copy_numbers(numbers, old.faces, copies, new.faces, 3 * new.face_count)
    copy_numbers(numbers, old.neighbors, copies, new.neighbors, 3 * new.face_count)
    copy_numbers(numbers, old.grid, copies, new.grid, grid_words(new))
    for block in range(blocks):
        note = numbers[old.block_notes + old.first_block + block]
        copies[new.block_notes + new.first_block + block] = note >> FOLDED_AT << FOLDED_AT | to


@entry(ModelArrays, "float32[:], float32[:], int32[:, :]", makes_arrays=True)
def finish_scene(model, nodes, static, entries):
    """Write the nodes, the trees over the parts and the grid over them into a planned model.

    The gaps between arrays become 0.
    """
    _, words, frames, parts = model
    copy_numbers(nodes.view(np.int32), 0, words.view(np.int32), 0, len(nodes))
    clear_gaps(model)
    _clear(words, _write_lists(words, frames, parts), len(words))
    assert write_static(words, parts, 0, static, entries)
    begin_moving(words, frames, parts)
