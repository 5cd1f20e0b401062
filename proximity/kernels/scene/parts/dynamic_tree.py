"""The tree over dynamic parts, which move separately. It is rewritten at every move.

If a part is dynamic, the root of the scene is a *super node*. Its first lane is the static tree over all
other parts, which does not change; the other lanes are the dynamic tree. The leaves of the dynamic tree are
entries, one per part, stored after those of the static tree. Dynamic parts are in Morton order, which is
updated a little at every move. So nodes stay small wherever the parts move, and a move costs O(number of
dynamic parts).
"""

import numpy as np

from proximity.kernels.layout import ENTRY, LANES, NODE_PARTS, NODE_STRIDE, DynamicParts
from proximity.kernels.scene.parts.placement import box_in_scene, copy_rows, update_scene_box
from proximity.kernels.stack_arrays import stack_f32
from proximity.kernels.tree.collapse import clear_node, node_box, write_lane
from proximity.native import entry, inlined, kernel

CURVE_CELLS = 2**20
"""Number of cells along each axis of the local cube, for the Morton order."""


@inlined
def _spread(cell):
    """Insert two zeros between adjacent bits of a 21-bit number."""
    cell = (cell | (cell << 32)) & 0x1F00000000FFFF
    cell = (cell | (cell << 16)) & 0x1F0000FF0000FF
    cell = (cell | (cell << 8)) & 0x100F00F00F00F00F
    cell = (cell | (cell << 4)) & 0x10C30C30C30C30C3
    return (cell | (cell << 2)) & 0x1249249249249249


@kernel
def _curve_key(box):
    """Return the Morton code of the centre of a box. Empty boxes come last."""
    key = np.int64(0)
    if not box[0] <= box[3]:
        return np.int64(2**62)
    for axis in range(3):
        middle = 0.5 * (np.float64(box[axis]) + np.float64(box[axis + 3]))
        cell = np.int64(min(max((middle + 1.0) * (0.5 * CURVE_CELLS), 0.0), CURVE_CELLS - 1.0))
        key |= _spread(cell) << axis
    return key


@kernel
def _mend_order(boxes, dynamic, order, keys, steps):
    """Sort *order*, which has positions in *dynamic*, by Morton code.

    It is an insertion sort with at most *steps* swaps.
    """
    for i in range(len(dynamic)):
        keys[i] = _curve_key(boxes[dynamic[i]])
    for i in range(1, len(order)):
        index = order[i]
        at = i
        while at > 0 and steps > 0 and keys[order[at - 1]] > keys[index]:
            order[at] = order[at - 1]
            at -= 1
            steps -= 1
        order[at] = index


@kernel
def _write_child(words, node, lane, i, below, boxes, dynamic, order, first_entry, box):
    """Write child *i* of a level of the dynamic tree.

    It is node *below* + *i*, or a dynamic part if *below* is negative.
    """
    if below >= 0:
        node_box(words, below + i, box)
        write_lane(words, NODE_STRIDE * node, lane, box, below + i)
    else:
        index, base = order[i], NODE_STRIDE * node
        write_lane(words, base, lane, boxes[dynamic[index]], ~(ENTRY + first_entry + index))
        words.view(np.int32)[base + NODE_PARTS + lane] = dynamic[index]


@kernel
def write_dynamic(words, region, static_root, boxes, dynamic, order, first_entry):
    """Write the super node at node *region*, and the dynamic tree after it.

    *static_root*: a node, or -1. *dynamic*: (L,), the parts. *order*: (L,), their positions in Morton order.
    """
    box = stack_f32(6)
    used, below, count = region + 1, -1, len(dynamic)
    while count > LANES - 1:
        node_count = (count + LANES - 1) // LANES
        for n in range(node_count):
            clear_node(words, used + n)
            for i in range(LANES * n, min(LANES * n + LANES, count)):
                _write_child(
                    words, used + n, i - LANES * n, i, below, boxes, dynamic, order, first_entry, box
                )
        below, count = used, node_count
        used += node_count
    clear_node(words, region)
    if static_root >= 0:
        node_box(words, static_root, box)
        write_lane(words, NODE_STRIDE * region, 0, box, static_root)
    for i in range(count):
        _write_child(words, region, 1 + i, i, below, boxes, dynamic, order, first_entry, box)


@entry(
    "float32[:], Frame[:], Part[:], int64[:], int, float32[:, :]",
    DynamicParts,
    "int, int, int, Frame[:], Part[:] -> float",
)
def bring_up_to_date(
    words, frames, parts, versions, published, boxes, dynamic, steps, region, since, to_frames, to_parts
):
    """Update a copy of the state to the present poses. Return the reach of the parts.

    If the reach is above 1, the parts do not fit the scene's frame, and the copy is unchanged. *versions*: (P
    + 1,) int64, when each row was changed. *boxes*: (P, 6) float32, valid at version *published*. The copy is
    *to_frames*, *to_parts* and node *region* of *words*, and is valid at version *since*. *dynamic*: see
    `DynamicParts`; its order is updated by up to *steps* swaps.
    """
    rows, order, keys = dynamic
    scene = len(parts) - 1
    reach = update_scene_box(frames, parts)
    if scene > 1:
        if not reach <= 1.0:
            return reach
        for part in rows:
            if versions[part] > published:
                box_in_scene(frames, parts, part, boxes[part])
        _mend_order(boxes, rows, order, keys, steps)
        write_dynamic(words, region, parts[scene].static_root, boxes, rows, order, parts[scene].entry_count)
    # A scene without dynamic parts starts at the static tree directly.
    is_static = scene > 1 and len(rows) == 0 and parts[scene].static_root >= 0
    parts[scene].root = parts[scene].static_root if is_static else region
    parts[scene].super_node, parts[scene].dynamic_count = region, len(rows)
    copy_rows(frames, parts, versions, since, to_frames, to_parts)
    return reach
