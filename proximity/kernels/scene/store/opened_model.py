"""Validation of a model from a file, and computation of its derived values.

Derived values are computed again, which costs less than a comparison and gives the same bits. They are the
boxes of parts, the scene's row, and the tree over dynamic parts.

The tables are validated first, because they locate trees and meshes (`model_validation`). Each function
returns the kind of the first defect, or `SOUND`, and fills *fault* as there. The part is `NO_PART` if the
defect belongs to no single part.
"""

from math import frexp

import numpy as np

from proximity.kernels.contact_record import SURFACE_DEFORMABLE, SURFACE_RIGID
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    CELLS_PER_WORD,
    ENTRY,
    FOLDED_AT,
    FRAME_COLUMNS,
    LANES,
    MOMENT_STRIDE,
    NO_GRID,
    NO_PART,
    NODE_STRIDE,
    ORIENTED_STRIDE,
    PART,
    REGION_COPIES,
    SIGN_WINDING,
    field_at,
)
from proximity.kernels.scene.parts.part_trees import (
    NO_NODE,
    copies_in_use,
    copy_offsets,
    dynamic_parts,
    note_fused,
    write_dynamic_entries,
    write_moving,
)
from proximity.kernels.scene.parts.placement import is_rigid, update_box
from proximity.kernels.scene.store.model_validation import (
    MAX_LOCAL,
    SOUND,
    fault_in_lists,
    fault_in_parts,
    fault_in_static_tree,
    fault_in_trees,
    note_fault,
)
from proximity.kernels.stack_arrays import reals_of, stack_f64_rows, stack_i64
from proximity.kernels.thresholds import MAX_COORDINATE
from proximity.kernels.tree.collapse import clear_node
from proximity.native import allocating_kernel, entry, inlined, kernel

MAX_PARTS = 2**FOLDED_AT
MAX_GRID_CELLS = 2.0**31
SMALLEST_SCALE, MAX_SCALE = 2.0**-510, 2.0**510
"""Range of the scales of local frames. Its wide margin keeps squares within float64."""
GRID_AT, STATIC_ROOT_AT = field_at(PART, "grid"), field_at(PART, "static_root")

(
    BAD_PART_COUNT, BAD_TREE_COUNT, BAD_NUMBER, BAD_FLAG, BAD_SIGN, EMPTY_PART, BAD_NODE_RUN, BAD_BLOCK_RUN,
    BAD_TABLE, BAD_TREES_START, BAD_FACE_COUNT, BAD_CAPACITY, BAD_EMPTY_NODE, BAD_REGION, BAD_ENTRIES,
    BAD_STATIC_ROOT, BAD_STATIC_SIZE, TOO_MANY_BLOCKS, BAD_REALS, BAD_WORDS, EMPTY_GRID, LARGE_GRID,
    BAD_FRAME_COUNT, NOT_FINITE, BAD_SCALE, FAR_FRAME, BAD_OWN_BOX, BAD_RATE, BAD_POSE, BAD_VELOCITY,
    BAD_SURFACE,
) = range(100, 131)  # fmt: skip
BAD_ORDER, BEYOND_FRAME = 140, 141


@entry(
    "float64[:], float32[:], Frame[:], Part[:], int64[:, :], int, float, float, float, int64[:] -> int",
    makes_arrays=True,
)
def complete_model(reals, words, frames, parts, columns, count, tolerance, farthest, fastest, fault):
    """Validate a model of *count* parts and compute its derived values.

    Return the kind of its first defect, or `SOUND`. *columns*: the table *parts* as numbers. Poses,
    velocities and hidden parts are taken from the rows, if a move within *tolerance*, *farthest* and
    *fastest* (see `placement.first_unfit`) could have written them. *fault*: see `model_validation`.
    """
    kind = fault_in_rows(reals, words, frames, parts, columns, count, fault)
    if kind == SOUND:
        kind = fault_in_motions(frames, tolerance, farthest, fastest, fault)
    if kind != SOUND:
        return kind
    node_count, block_count, max_faces = np.int64(0), np.int64(0), np.int64(0)
    for part in range(count):
        node_count += parts[part].node_count
        block_count += parts[part].block_count
        max_faces = max(max_faces, parts[part].face_count)
    firsts, counts, levels = (
        np.empty(node_count, np.int32),
        np.empty(node_count, np.int32),
        np.zeros(node_count, np.int32),
    )
    seen = np.zeros(block_count, np.uint8)
    kind = fault_in_trees(words, parts, firsts, counts, levels, seen, fault)
    if kind == SOUND:
        kind = fault_in_parts(reals, words, parts, np.empty(max_faces, np.uint8), fault)
    if kind == SOUND:
        kind = _complete_trees(words, frames, parts, firsts, counts, fault)
    return kind


@allocating_kernel
def _complete_trees(words, frames, parts, firsts, counts, fault):
    """Validate the trees over parts, and compute their derived values.

    *firsts*, *counts*: from `fault_in_trees`.
    """
    scene = len(parts) - 1
    for part in range(scene):
        update_box(frames, parts, part)
    for axis in range(3):
        for other in range(3):
            frames[scene].rotation[3 * axis + other] = 1.0 if axis == other else 0.0
        frames[scene].translation[axis] = 0.0
    parts[scene].is_turned, parts[scene].is_dynamic, parts[scene].is_hidden = 0, 0, 0
    note_fused(frames, parts)
    clear_node(words, parts[scene].first_node)
    if parts[scene].static_capacity:
        levels = np.zeros(parts[scene].static_node_count, np.int32)
        covered = np.zeros(parts[scene - 1].first_block + parts[scene - 1].block_count, np.uint8)
        kind = fault_in_static_tree(words, parts, firsts, counts, levels, covered, fault)
        if kind != SOUND:
            return kind
        _, static = copies_in_use(parts)
        _, at, _ = copy_offsets(parts, static)
        write_dynamic_entries(words, parts, at)
    kind = fault_in_lists(words, parts, fault)
    if kind != SOUND:
        return kind
    rows, order = dynamic_parts(words, parts)
    if len(order) != len(rows):
        return note_fault(fault, BAD_ORDER, NO_PART, 0, 0, 0)
    reach = write_moving(words, frames, parts, parts[scene].super_node, rows, order, 0)
    return SOUND if reach <= 1.0 else note_fault(fault, BEYOND_FRAME, NO_PART, 0, 0, 0)


# --- the tables: ends of arrays, and frames ---


@inlined
def _of_all(fault, kind, first, second):
    return note_fault(fault, kind, NO_PART, first, second, 0)


@entry("float64[:], float32[:], Frame[:], Part[:], int64[:, :], int, int64[:] -> int")
def fault_in_rows(reals, words, frames, parts, columns, count, fault):
    """Validate the tables of a model of *count* parts. *columns*: the table *parts* as numbers."""
    scene, largest = len(parts) - 1, max(len(reals), len(words))
    if not 0 < count < MAX_PARTS:
        return _of_all(fault, BAD_PART_COUNT, count, MAX_PARTS - 1)
    if scene != count:
        return _of_all(fault, BAD_TREE_COUNT, count, scene)
    # Excludes overflow in the sums and products below; columns that may be -1 have a separate minimum.
    for row in range(len(parts)):
        for k in range(columns.shape[1]):
            least = NO_GRID if k == GRID_AT else NO_NODE if k == STATIC_ROOT_AT and row == scene else 0
            if not least <= columns[row, k] <= largest:
                return _of_all(fault, BAD_NUMBER, largest, 0)
    for row in range(len(parts)):
        x, y, z = parts[row].grid_x, parts[row].grid_y, parts[row].grid_z
        if not float(x) * float(y) * float(z) < MAX_GRID_CELLS:
            return _of_all(fault, LARGE_GRID, 0, 0)
    kind = _fault_in_parts_rows(parts, fault)
    if kind == SOUND:
        kind = _fault_in_scene_row(parts, fault)
    if kind == SOUND:
        kind = _fault_in_runs(len(reals), len(words), parts, fault)
    return fault_in_frames(frames, parts, fault) if kind == SOUND else kind


@kernel
def _fault_in_parts_rows(parts, fault):
    """Validate the numbers of each part. Nodes and blocks of successive parts must be adjacent."""
    scene, nodes, blocks = len(parts) - 1, np.int64(0), np.int64(0)
    for row in range(scene):
        part = parts[row]
        if part.is_dynamic > 1 or part.is_hidden > 1:
            return _of_all(fault, BAD_FLAG, 0, 0)
        if part.sign > SIGN_WINDING:
            return _of_all(fault, BAD_SIGN, 0, 0)
        if part.node_count == 0 or part.block_count == 0 or part.face_count == 0 or part.corner_count == 0:
            return _of_all(fault, EMPTY_PART, 0, 0)
        if part.root != nodes:
            return _of_all(fault, BAD_NODE_RUN, 0, 0)
        if part.first_block != blocks:
            return _of_all(fault, BAD_BLOCK_RUN, 0, 0)
        nodes += part.node_count
        blocks += part.block_count
    for row in range(1, len(parts)):
        part, first = parts[row], parts[0]
        is_alike = part.slot_faces == first.slot_faces and part.moments == first.moments
        if not is_alike or part.block_boxes != first.block_boxes or part.block_notes != first.block_notes:
            return _of_all(fault, BAD_TABLE, 0, 0)
    return SOUND


@kernel
def _fault_in_scene_row(parts, fault):
    """Validate the last row, whose fields describe the trees over parts."""
    scene, faces = len(parts) - 1, np.int64(0)
    row = parts[scene]
    for part in range(scene):
        faces += parts[part].face_count
    if row.first_node != parts[scene - 1].root + parts[scene - 1].node_count:
        return _of_all(fault, BAD_TREES_START, 0, 0)
    if row.face_count != faces:
        return _of_all(fault, BAD_FACE_COUNT, row.face_count, 0)
    if (row.static_capacity > 0) != (scene > 1):
        return _of_all(fault, BAD_CAPACITY, row.static_capacity, scene)
    if row.static_capacity == 0:
        return SOUND if row.super_node == row.first_node else _of_all(fault, BAD_EMPTY_NODE, 0, 0)
    moving, static = copies_in_use(parts)
    if moving < 0:
        return _of_all(fault, BAD_REGION, 0, 0)
    if static < 0:
        return _of_all(fault, BAD_ENTRIES, 0, 0)
    root, _, _ = copy_offsets(parts, static)
    if row.static_root != NO_NODE and row.static_root != root:
        return _of_all(fault, BAD_STATIC_ROOT, 0, 0)
    has_nodes = row.static_root == NO_NODE or row.static_node_count > 0
    fits = row.static_node_count <= row.static_capacity and row.entry_count <= LANES * row.static_capacity
    if not has_nodes or not fits:
        note_fault(fault, SOUND, NO_PART, row.static_node_count, row.entry_count, row.static_capacity)
        return BAD_STATIC_SIZE
    return SOUND


@inlined
def _follow(ends, which, start, size):
    """Test whether a run begins after the previous run of its array, and store its end."""
    is_behind = start >= ends[which]
    ends[which] = start + size
    return is_behind


@kernel
def _fault_in_runs(real_count, word_count, parts, fault):
    """Check that the arrays of all parts are in the order of the layout, in bounds and without overlap."""
    scene, ends = len(parts) - 1, stack_i64(2)
    last = parts[scene - 1]
    nodes, blocks = last.root + last.node_count, last.first_block + last.block_count
    if blocks >= ENTRY:
        return _of_all(fault, TOO_MANY_BLOCKS, blocks, 0)
    _, _, end_node = copy_offsets(parts, REGION_COPIES)
    row = parts[scene]
    ends[0] = BLOCK_STRIDE * blocks
    ends[1] = NODE_STRIDE * (end_node if row.static_capacity else nodes + 1)
    is_right = _follow(ends, 1, row.slot_faces, LANES * blocks)
    is_right = _follow(ends, 1, row.moments, MOMENT_STRIDE * nodes) and is_right
    is_right = _follow(ends, 1, row.block_boxes, ORIENTED_STRIDE * blocks) and is_right
    is_right_in_reals = True
    for k in range(scene):
        part = parts[k]
        is_right_in_reals = _follow(ends, 0, part.corners, 3 * part.corner_count) and is_right_in_reals
        is_right_in_reals = _follow(ends, 0, part.corner_normals, 3 * part.corner_count) and is_right_in_reals
        is_right = _follow(ends, 1, part.faces, 3 * part.face_count) and is_right
        is_right = _follow(ends, 1, part.neighbors, 3 * part.face_count) and is_right
        if part.grid != NO_GRID:
            cells = part.grid_x * part.grid_y * part.grid_z
            if cells == 0:
                return _of_all(fault, EMPTY_GRID, 0, 0)
            size = (cells + CELLS_PER_WORD - 1) // CELLS_PER_WORD
            is_right = _follow(ends, 1, part.grid, size) and is_right
    cells = row.grid_x * row.grid_y * row.grid_z
    is_right = _follow(ends, 1, row.block_notes, blocks) and is_right
    is_right = _follow(ends, 1, row.grid, cells + 1 if cells else np.int64(0)) and is_right
    if not is_right_in_reals or ends[0] > real_count:
        return _of_all(fault, BAD_REALS, real_count, 0)
    return SOUND if is_right and ends[1] <= word_count else _of_all(fault, BAD_WORDS, word_count, 0)


# --- frames ----------------------------------------------------------------------------------------------


@kernel
def fault_in_frames(frames, parts, fault):
    """Validate local frames, the boxes in them, and the sizes of grid cells."""
    scene, numbers = len(parts) - 1, reals_of(frames)
    if len(frames) != len(parts):
        return _of_all(fault, BAD_FRAME_COUNT, len(frames), scene)
    for row in range(len(frames)):
        for k in range(FRAME_COLUMNS):
            if not abs(numbers[row, k]) < np.inf:
                return _of_all(fault, NOT_FINITE, k, row)
        scale = frames[row].scale
        if not SMALLEST_SCALE <= scale <= MAX_SCALE or frexp(scale)[0] != 0.5:
            return _of_all(fault, BAD_SCALE, 0, 0)
        for axis in range(3):
            centre = frames[row].centre[axis]
            lower, upper = frames[row].own_lower[axis], frames[row].own_upper[axis]
            if abs(centre) > 2.0 * MAX_COORDINATE:
                return _of_all(fault, FAR_FRAME, 0, 0)
            reach = max(abs((lower - centre) * scale), abs((upper - centre) * scale))
            if row < scene and not (lower <= upper and reach <= MAX_LOCAL):
                return _of_all(fault, BAD_OWN_BOX, 0, 0)
        cells = parts[row].grid_x * parts[row].grid_y * parts[row].grid_z
        has_grid = cells > 0 and (row == scene or parts[row].grid != NO_GRID)
        if has_grid and not frames[row].grid_rate > 0.0:
            return _of_all(fault, BAD_RATE, 0, 0)
    return SOUND


@kernel
def fault_in_motions(frames, tolerance, farthest, fastest, fault):
    """Check that poses, velocities, stiffness and damping have values that a move could have written."""
    matrix = stack_f64_rows(4, 4)
    matrix[:] = 0.0
    matrix[3, 3] = 1.0
    for row in range(len(frames) - 1):
        frame, is_slow = frames[row], True
        for axis in range(3):
            matrix[axis, 3] = frame.translation[axis]
            for other in range(3):
                matrix[axis, other] = frame.rotation[3 * axis + other]
            is_slow = is_slow and abs(frame.velocity[axis]) <= fastest
            is_slow = is_slow and abs(frame.angular_velocity[axis]) <= fastest
        if not is_rigid(matrix, tolerance, farthest):
            return _of_all(fault, BAD_POSE, row, 0)
        if not is_slow:
            return _of_all(fault, BAD_VELOCITY, row, 0)
        is_soft = frame.surface == SURFACE_DEFORMABLE and frame.stiffness > 0.0 and frame.damping >= 0.0
        is_hard = frame.surface == SURFACE_RIGID and frame.stiffness == 0.0 and frame.damping == 0.0
        if not is_soft and not is_hard:
            return _of_all(fault, BAD_SURFACE, row, 0)
    return SOUND
