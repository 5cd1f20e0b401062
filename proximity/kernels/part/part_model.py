"""Arrays of a model of one part: their lengths, offsets and values, except those of the sign.

`plan_part` builds the tree and computes the lengths of ``reals`` and ``words``. The caller allocates them,
`fill_part` fills them, and `sign_choice` adds the sign. Every array starts at a cache line. Space for a sign
grid is always planned, because the choice of the sign needs the filled arrays.
"""

import numpy as np

from proximity.kernels.geometry.local_frame import frame_of_box
from proximity.kernels.geometry.rows import copy_numbers
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    BOX_STRIDE,
    FACES_SHIFT,
    LANES,
    MOMENT_STRIDE,
    NO_GRID,
    NODE_STRIDE,
    ORIENTED_STRIDE,
    ModelArrays,
)
from proximity.kernels.mesh.faces import add_corner_normals
from proximity.kernels.scene.parts.assembly import clear_gaps, grid_at, lay_out
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

EMPTY_NODES = 1
"""Number of nodes after those of the part.

A scene of one part has an empty node, see `scene.parts.part_trees`.
"""


@kernel
def open_grid(frames, parts):
    """Write the offset and the resolution of the sign grid into the row of the part."""
    extent = stack_f64(3)
    for axis in range(3):
        centre, scale = frames[0].centre[axis], frames[0].scale
        frames[0].grid_lower[axis] = (frames[0].own_lower[axis] - centre) * scale
        extent[axis] = (frames[0].own_upper[axis] - centre) * scale - frames[0].grid_lower[axis]
    frames[0].grid_rate, parts[0].grid_x, parts[0].grid_y, parts[0].grid_z = grid_size(
        extent, cells_wanted(parts[0].face_count)
    )
    parts[0].grid = grid_at(parts[0])


@kernel
def close_grid(frames, parts):
    """Mark the row of a part as having no sign grid."""
    parts[0].grid, parts[0].grid_x, parts[0].grid_y, parts[0].grid_z = NO_GRID, 0, 0, 0
    frames[0].grid_rate = 0.0
    for axis in range(3):
        frames[0].grid_lower[axis] = 0.0


@entry(
    "float64[:, 3], int32[:, 3], float64[:], Frame[:], Part[:] -> float32[:], int32[:], int32[:], int, int",
    makes_arrays=True,
)
def plan_part(corners, faces, frame, frames, parts):
    """Build the tree of a part and fill its rows. Return the tree and the lengths of ``reals`` and ``words``.

    The tree is returned as by `build_tree`: nodes, order of faces, first position of each leaf. If the part
    is too far from its origin or too small, the lengths are zero and the rows are not filled. *corners*: (K,
    3) m. *faces*: (F, 3), rows of *corners*. *frame*: (4,), centre and scale of a frame to share, or zeros;
    it is used unless the part is small in it. *frames*, *parts*: two rows of zeros, for the part and the
    scene.
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
    parts[1].first_node, parts[1].face_count = parts[0].node_count, len(faces)
    reals, words = lay_out(parts, parts[0].node_count + EMPTY_NODES, 0)
    update_box(frames, parts, 0)
    choose_frame(frames, parts, centre, scale)
    return nodes, order, block_first, reals, words


@kernel
def _to_local(corners, centre, scale, local):
    """Transform corners to a local frame and write them to *local*."""
    for corner in range(len(corners)):
        for axis in range(3):
            local[corner, axis] = (corners[corner, axis] - centre[axis]) * scale


@allocating_kernel
def tables_of(model):
    """Return views of the local corners, faces, neighbours and faces of slots in a model of one part."""
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
    """Fill the arrays of a part, except its sign.

    *model*: has the rows that `plan_part` filled, and ``reals`` and ``words`` of the lengths that it
    returned. *nodes*, *order*, *block_first*: the tree that it returned. *neighbors*: (F, 3), the face across
    each edge, or negative.
    """
    reals, words, frames, parts = model
    part, centre = parts[0], stack_f64(3)
    close_grid(frames, parts)
    clear_gaps(model)
    words[part.block_notes : part.block_notes + part.block_count] = 0.0
    copy_numbers(nodes, 0, words, 0, len(nodes))
    local, kept_faces, kept_neighbors, slot_faces = tables_of(model)
    for axis in range(3):
        centre[axis] = frames[0].centre[axis]
    _to_local(corners, centre, frames[0].scale, local)
    for face in range(len(faces)):
        for k in range(3):
            kept_faces[face, k], kept_neighbors[face, k] = faces[face, k], neighbors[face, k]
    blocks = reals[: BLOCK_STRIDE * part.block_count]
    fill_blocks(local, kept_faces, order, block_first, blocks, slot_faces)
    reals[part.corner_normals : part.corner_normals + 3 * part.corner_count] = 0.0
    add_corner_normals(local, kept_faces, rows_of_three(reals, part.corner_normals, part.corner_count))
    moments_end = part.moments + MOMENT_STRIDE * part.node_count
    fill_moments(words, blocks, part.node_count, words[part.moments : moments_end])
    fill_slabs(words, blocks, 0, part.node_count, words, part.moments)
    boxes_end = part.block_boxes + ORIENTED_STRIDE * part.block_count
    share = fill_oriented_boxes(blocks, words[part.block_boxes : boxes_end])
    parts[0].is_oblique = parts[1].is_oblique = share <= OBLIQUE
    begin_moving(words, frames, parts)
