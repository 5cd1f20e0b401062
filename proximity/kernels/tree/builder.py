"""Building of an eight-wide bounding volume hierarchy over boxes.

Runs of faces are split down to the size of a leaf (`binned_sah`), large subtrees are reinserted
(`reinsertion`), and the binary tree is collapsed to an eight-wide one (`collapse`).
"""

import numpy as np

from proximity.kernels.geometry.box import BOX_MARGIN, round_down, round_up
from proximity.kernels.layout import BLOCK_STRIDE, BOX_STRIDE, CORNER_STRIDE, ENTRIES_SHIFT, LANES, NO_FACE
from proximity.kernels.mesh.positions import AHEAD, fetch_corners
from proximity.kernels.tree.binned_sah import halve
from proximity.kernels.tree.collapse import widen_tree
from proximity.kernels.tree.reinsertion import improve
from proximity.native import entry
from proximity.native.simd import prefetch


@entry("float64[:, 3], int32[:, 3], float32[:]")
def face_boxes(vertices, faces, boxes):
    """Write the packed box of each face, float32, with padding.

    See `binned_sah` for the form of a packed box.
    """
    for face in range(len(faces)):
        fetch_corners(vertices, faces, face)
        at = BOX_STRIDE * face
        boxes[at + 3], boxes[at + 7] = 0.0, 0.0
        for axis in range(3):
            a = vertices[faces[face, 0], axis]
            b = vertices[faces[face, 1], axis]
            c = vertices[faces[face, 2], axis]
            boxes[at + axis] = round_down(min(a, b, c)) - BOX_MARGIN
            boxes[at + 4 + axis] = -(round_up(max(a, b, c)) + BOX_MARGIN)


@entry("float32[:], int -> float32[:], int32[:], int32[:]", makes_arrays=True)
def build_tree(boxes, leaf_shift):
    """Build an eight-wide tree over boxes.

    Return the nodes (float32, flat), the order of faces (int32), and the first position of each leaf in it
    (int32). *boxes*: (F * `BOX_STRIDE`,) float32, F >= 1; they are reordered. A leaf has at most ``2 **
    leaf_shift`` faces. Child references are int32 bits in the nodes, see `layout`. Leaves are numbered in the
    order of faces.
    """
    order = np.empty(len(boxes) // BOX_STRIDE, np.int32)
    for face in range(len(order)):
        order[face] = face
    tree, links = halve(boxes, order, leaf_shift)
    if leaf_shift != ENTRIES_SHIFT:
        # Not for trees over entries, which are built at run time: it saves 2 % of the steps, but takes a
        # third of the time.
        improve(tree, links)
    return widen_tree(tree, links, order)


@entry("float64[:, 3], int32[:, 3], int32[:], int32[:], float64[:], int32[:]")
def fill_blocks(vertices, faces, order, block_first, blocks, face_of_slot):
    """Copy the corners of the faces of each leaf into a block of eight lanes. Unused lanes are NaN."""
    for block in range(len(block_first) - 1):
        first = block_first[block]
        number = block_first[block + 1] - first
        for lane in range(LANES):
            slot = LANES * block + lane
            base = BLOCK_STRIDE * block + lane
            if lane >= number:
                face_of_slot[slot] = NO_FACE
                for k in range(9):
                    blocks[base + LANES * k] = np.nan
                continue
            face = order[first + lane]
            if first + lane + 2 * AHEAD < len(order):
                prefetch(faces, 3 * np.int64(order[first + lane + 2 * AHEAD]))
                for k in range(3):
                    prefetch(vertices, 3 * np.int64(faces[order[first + lane + AHEAD], k]))
            face_of_slot[slot] = face
            for corner in range(3):
                for axis in range(3):
                    blocks[base + CORNER_STRIDE * corner + LANES * axis] = vertices[faces[face, corner], axis]
