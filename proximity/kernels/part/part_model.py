"""The arrays of a model of one part: how long they are, where they lie, and all of them except the sign.

`plan_part` builds the tree and computes the length of ``reals`` and ``words``; the caller allocates them;
`fill_part` fills them; `sign_choice` adds the sign. Every array starts at a cache line. Space for a sign grid
is planned always, since a sign is chosen by means of the filled arrays.
"""

import numpy as np

from proximity.kernels.geometry.local_frame import frame_of_box
from proximity.kernels.geometry.rows import copy_numbers
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    BOX_STRIDE,
    CELLS_PER_WORD,
    FACES_SHIFT,
    LANES,
    MOMENT_STRIDE,
    NO_GRID,
    NODE_STRIDE,
    ORIENTED_STRIDE,
    ModelArrays,
)
from proximity.kernels.mesh.faces import add_corner_normals
from proximity.kernels.scene.parts.part_trees import begin_moving, choose_frame
from proximity.kernels.scene.parts.placement import update_box
from proximity.kernels.sign.inside_grid import cells_wanted, grid_size
from proximity.kernels.sign.winding_number import fill_moments
from proximity.kernels.stack_arrays import rows_of_three, stack_f64
from proximity.kernels.thresholds import OBLIQUE, SMALLEST_SHARE
from proximity.kernels.tree.builder import build_tree, face_boxes, fill_blocks
from proximity.kernels.tree.normal_slab import fill_slabs
from proximity.kernels.tree.oriented_box import fill_oriented_boxes
from proximity.native import allocating_kernel, entry, kernel

BLOCK_ROW, CORNERS, NORMALS, REALS_END = range(4)
NODE_ROW, SLOT_FACES, MOMENTS, BOX_ROW, FACES, NEIGHBORS, GRID, NOTES, SCENE_GRID, WORDS_END = range(4, 14)
"""Rows of the table of arrays: those in ``reals``, their end, those in ``words``, their end."""
REALS_PER_LINE, WORDS_PER_LINE = 8, 16
"""Numbers in a cache line."""
EMPTY_NODES = 1
"""Nodes behind those of the part: a scene of one part has an empty node, see `scene.part_trees`."""


@allocating_kernel
def arrays_of(part):
    """Return the start and end of each array of a part alone, from its counts: (14, 2) int64.

    The space of the grid and of the empty node lies behind the end of their rows.
    """
    corners, faces = 3 * part.corner_count, 3 * part.face_count
    table, end = np.zeros((WORDS_END + 1, 2), np.int64), np.int64(0)
    table[BLOCK_ROW, 1], table[CORNERS, 1], table[NORMALS, 1] = (
        BLOCK_STRIDE * part.block_count,
        corners,
        corners,
    )
    table[NODE_ROW, 1], table[SLOT_FACES, 1] = NODE_STRIDE * part.node_count, LANES * part.block_count
    table[MOMENTS, 1], table[BOX_ROW, 1] = MOMENT_STRIDE * part.node_count, ORIENTED_STRIDE * part.block_count
    table[FACES, 1], table[NEIGHBORS, 1], table[NOTES, 1] = faces, faces, part.block_count
    for array in range(len(table)):
        line = REALS_PER_LINE if array <= REALS_END else WORDS_PER_LINE
        table[array, 0] = 0 if array == NODE_ROW else (end + line - 1) // line * line
        end = table[array, 1] = table[array, 0] + table[array, 1]
        if array == NODE_ROW:
            end += NODE_STRIDE * EMPTY_NODES
        if array == GRID:
            end += grid_words(part)
    return table


@kernel
def grid_words(part):
    """Words of a part's grid."""
    return (part.grid_x * part.grid_y * part.grid_z + CELLS_PER_WORD - 1) // CELLS_PER_WORD


@allocating_kernel
def open_grid(frames, parts):
    """Write into the part's row where its sign grid lies, and how fine it is."""
    extent = stack_f64(3)
    for axis in range(3):
        centre, scale = frames[0].centre[axis], frames[0].scale
        frames[0].grid_lower[axis] = (frames[0].own_lower[axis] - centre) * scale
        extent[axis] = (frames[0].own_upper[axis] - centre) * scale - frames[0].grid_lower[axis]
    frames[0].grid_rate, parts[0].grid_x, parts[0].grid_y, parts[0].grid_z = grid_size(
        extent, cells_wanted(parts[0].face_count)
    )
    parts[0].grid = arrays_of(parts[0])[GRID, 0]


@kernel
def close_grid(frames, parts):
    """Write into the part's row that it has no sign grid."""
    parts[0].grid, parts[0].grid_x, parts[0].grid_y, parts[0].grid_z = NO_GRID, 0, 0, 0
    frames[0].grid_rate = 0.0
    for axis in range(3):
        frames[0].grid_lower[axis] = 0.0


@entry(
    "float64[:, 3], int32[:, 3], float64[:], Frame[:], Part[:] -> float32[:], int32[:], int32[:], int, int",
    makes_arrays=True,
)
def plan_part(corners, faces, frame, frames, parts):
    """Build a part's tree and fill its rows; return the tree and how many reals and words its arrays take.

    The tree: nodes, order of faces, first position of each leaf, as `build_tree` returns them. No reals: the
    part is too far from its origin or too small, and nothing is filled. *corners* (K, 3) m, *faces* (F, 3) of
    *corners*. *frame* (4,): centre and scale of a frame to share, used if the part is not small in it; no
    frame: zeros. *frames*, *parts*: two rows of zeros, of the part and of the scene.
    """
    lower, upper, centre = stack_f64(3), stack_f64(3), stack_f64(3)
    extent, scale = 0.0, frame[3]
    for axis in range(3):
        lower[axis] = upper[axis] = corners[0, axis]
        for corner in range(len(corners)):
            lower[axis] = min(lower[axis], corners[corner, axis])
            upper[axis] = max(upper[axis], corners[corner, axis])
        extent, centre[axis] = max(extent, upper[axis] - lower[axis]), frame[axis]
    if not extent * scale >= SMALLEST_SHARE:
        scale = frame_of_box(lower, upper, centre)
    if not scale > 0.0:
        return np.zeros(0, np.float32), np.zeros(0, np.int32), np.zeros(0, np.int32), 0, 0
    local, boxes = np.empty_like(corners), np.empty(BOX_STRIDE * len(faces), np.float32)
    _to_local(corners, centre, scale, local)
    face_boxes(local, faces, boxes)
    nodes, order, block_first = build_tree(boxes, FACES_SHIFT)

    parts[0].node_count, parts[0].block_count = len(nodes) // NODE_STRIDE, len(block_first) - 1
    parts[0].corner_count, parts[0].face_count = len(corners), len(faces)
    for axis in range(3):
        frames[0].rotation[4 * axis], frames[0].centre[axis] = 1.0, centre[axis]
        frames[0].own_lower[axis], frames[0].own_upper[axis] = lower[axis], upper[axis]
    frames[0].scale = scale
    open_grid(frames, parts)
    table = arrays_of(parts[0])
    for row in range(2):
        parts[row].slot_faces, parts[row].moments = table[SLOT_FACES, 0], table[MOMENTS, 0]
        parts[row].block_boxes, parts[row].block_notes = table[BOX_ROW, 0], table[NOTES, 0]
    parts[0].corners, parts[0].corner_normals = table[CORNERS, 0], table[NORMALS, 0]
    parts[0].faces, parts[0].neighbors = table[FACES, 0], table[NEIGHBORS, 0]
    parts[1].first_node, parts[1].face_count = parts[0].node_count, len(faces)
    parts[1].grid = table[SCENE_GRID, 0]
    update_box(frames, parts, 0)
    choose_frame(frames, parts, centre, scale)
    return nodes, order, block_first, table[REALS_END, 0], table[WORDS_END, 0]


@kernel
def _to_local(corners, centre, scale, local):
    """Fill the positions of corners in a local frame."""
    for corner in range(len(corners)):
        for axis in range(3):
            local[corner, axis] = (corners[corner, axis] - centre[axis]) * scale


@allocating_kernel
def tables_of(model):
    """Return local corners, faces, neighbours, and faces of slots of a part alone, in its memory."""
    reals, words, _, parts = model
    part, numbers = parts[0], words.view(np.int32)
    return (
        rows_of_three(reals, part.corners, part.corner_count),
        rows_of_three(numbers, part.faces, part.face_count),
        rows_of_three(numbers, part.neighbors, part.face_count),
        numbers[part.slot_faces : part.slot_faces + LANES * part.block_count],
    )


@entry(
    ModelArrays,
    "float32[:], int32[:], int32[:], float64[:, 3], int32[:, 3], int32[:, 3]",
    makes_arrays=True,
)
def fill_part(model, nodes, order, block_first, corners, faces, neighbors):
    """Fill the arrays of a part; afterwards it has no sign.

    *model*: ``reals`` and ``words`` as long as `plan_part` returned, with the rows that it filled. *nodes*,
    *order*, *block_first*: the tree that it returned. *neighbors* (F, 3): the face across each edge, or
    negative.
    """
    reals, words, frames, parts = model
    part, table, centre = parts[0], arrays_of(parts[0]), stack_f64(3)
    # The gaps, and the space of the grid, are zero, so that equal parts are equal in memory.
    for array in range(BLOCK_ROW, REALS_END):
        reals[table[array, 1] : table[array + 1, 0]] = 0.0
    for array in range(NODE_ROW, WORDS_END):
        words[table[array, 1] : table[array + 1, 0]] = 0.0
    words[part.block_notes : part.block_notes + part.block_count] = 0.0
    copy_numbers(nodes, 0, words, 0, len(nodes))
    local, kept_faces, kept_neighbors, slot_faces = tables_of(model)
    for axis in range(3):
        centre[axis] = frames[0].centre[axis]
    _to_local(corners, centre, frames[0].scale, local)
    for face in range(len(faces)):
        for k in range(3):
            kept_faces[face, k], kept_neighbors[face, k] = faces[face, k], neighbors[face, k]
    blocks = reals[: table[BLOCK_ROW, 1]]
    fill_blocks(local, kept_faces, order, block_first, blocks, slot_faces)
    reals[table[NORMALS, 0] : table[NORMALS, 1]] = 0.0
    add_corner_normals(local, kept_faces, rows_of_three(reals, part.corner_normals, part.corner_count))
    fill_moments(words, blocks, part.node_count, words[part.moments : table[MOMENTS, 1]])
    fill_slabs(words, blocks, 0, part.node_count, words, part.moments)
    share = fill_oriented_boxes(blocks, words[part.block_boxes : table[BOX_ROW, 1]])
    parts[0].is_oblique = parts[1].is_oblique = share <= OBLIQUE
    begin_moving(words, frames, parts)
    close_grid(frames, parts)
