"""A model out of a file: validated, and completed with what follows from its other numbers.

What follows is not believed but written again, which is less work than to compare it and leaves the same
bits: boxes of parts, the scene's row, and the tree over dynamic parts.
"""

import numpy as np

from proximity.kernels.layout import NO_PART
from proximity.kernels.scene.model_validation import (
    SOUND,
    fault_in_lists,
    fault_in_parts,
    fault_in_static_tree,
    fault_in_trees,
    note_fault,
)
from proximity.kernels.scene.part_trees import (
    copies_in_use,
    copy_offsets,
    dynamic_parts,
    note_fused,
    write_dynamic_entries,
    write_moving,
)
from proximity.kernels.scene.placement import update_box
from proximity.kernels.scene.row_validation import fault_in_motions, fault_in_rows
from proximity.kernels.tree.collapse import clear_node
from proximity.native import allocating_kernel, entry

BAD_ORDER, BEYOND_FRAME = 140, 141


@entry(
    "float64[:], float32[:], Frame[:], Part[:], int64[:, :], int, float, float, float, int64[:] -> int",
    makes_arrays=True,
)
def complete_model(reals, words, frames, parts, columns, count, tolerance, farthest, fastest, fault):
    """Validate a model of *count* parts and complete it; the kind of its first fault, or `SOUND`.

    *columns*: *parts*, as numbers. Poses, velocities and which parts are hidden are as the rows say, if a
    move (`placement.first_unfit`) within *tolerance*, *farthest* and *fastest* could have put them there.
    *fault*: see `model_validation`.
    """
    kind = fault_in_rows(reals, words, frames, parts, columns, count, fault)
    if kind == SOUND:
        kind = fault_in_motions(frames, tolerance, farthest, fastest, fault)
    if kind != SOUND:
        return kind
    node_count, block_count, most_faces = np.int64(0), np.int64(0), np.int64(0)
    for part in range(count):
        node_count += parts[part].node_count
        block_count += parts[part].block_count
        most_faces = max(most_faces, parts[part].face_count)
    firsts, counts, levels = (
        np.empty(node_count, np.int32),
        np.empty(node_count, np.int32),
        np.zeros(node_count, np.int32),
    )
    seen = np.zeros(block_count, np.uint8)
    kind = fault_in_trees(words, parts, firsts, counts, levels, seen, fault)
    if kind == SOUND:
        kind = fault_in_parts(reals, words, parts, np.empty(most_faces, np.uint8), fault)
    if kind == SOUND:
        kind = _complete_trees(words, frames, parts, firsts, counts, fault)
    return kind


@allocating_kernel
def _complete_trees(words, frames, parts, firsts, counts, fault):
    """The same for the trees over parts. *firsts*, *counts*: as `fault_in_trees` fills them."""
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
