"""The static tree over the parts of a scene that are not dynamic, built over subtrees of these parts.

Parts of an assembly overlap, and a query in a tree of whole parts would traverse many of them. Large parts
are therefore opened until every *entry*, which is a subtree of a part, is small compared with the scene. The
tree is built over these entries.

Source: Benthin, Woop, Wald, Áfra 2017, "Improved two-level BVHs using partial re-braiding".
"""

import numpy as np

from proximity.kernels.geometry.box import BOX_MARGIN, round_down, round_up
from proximity.kernels.geometry.rows import copy_numbers, copy_row
from proximity.kernels.layout import BOX_STRIDE, ENTRY, LANES, NODE_CHILDREN, NODE_STRIDE
from proximity.kernels.nodes import child_at, is_used, lower_at, upper_at
from proximity.kernels.stack_arrays import stack_f64
from proximity.kernels.traverse.ignored_parts import part_of_child
from proximity.kernels.tree.collapse import clear_box, node_box, write_lane
from proximity.native import entry, kernel


@kernel
def scene_box(frames, part, scene, lower, upper, box):
    """Transform a box from a part's local frame to the scene's scaled frame.

    It is widened and rounded outward. *lower*, *upper*: (3,) float64. *box*: (6,) float32, the result.
    """
    for axis in range(3):
        middle, half = frames[part].translation[axis], 0.0
        for other in range(3):
            low = lower[other] / frames[part].scale + frames[part].centre[other]
            high = upper[other] / frames[part].scale + frames[part].centre[other]
            turn = frames[part].rotation[3 * axis + other]
            middle += turn * (0.5 * low + 0.5 * high)
            half += abs(turn) * (0.5 * high - 0.5 * low)
        low = (middle - half - frames[scene].centre[axis]) * frames[scene].scale
        high = (middle + half - frames[scene].centre[axis]) * frames[scene].scale
        box[axis] = round_down(low) - BOX_MARGIN
        box[axis + 3] = round_up(high) + BOX_MARGIN


@kernel
def _add_children(words, frames, part, node, boxes, references, count):
    """Append the boxes and references of the children of a part's node. Return the new number of rows.

    *count*: the number of rows before.
    """
    lower, upper, base = stack_f64(3), stack_f64(3), NODE_STRIDE * node
    for k in range(LANES):
        if is_used(words, base + k):
            for axis in range(3):
                lower[axis] = lower_at(words, base + k, axis)
                upper[axis] = upper_at(words, base + k, axis)
            scene_box(frames, part, len(frames) - 1, lower, upper, boxes[count])
            references[count, 0], references[count, 1] = part, child_at(words, base + k)
            count += 1
    return count


@entry("float32[:], Frame[:], Part[:], int -> float32[:], int32[:, :]", makes_arrays=True)
def gather_entries(words, frames, parts, target):
    """Divide parts into about *target* entries. Return their boxes and references.

    An entry is a subtree. Its reference has the part and the node or block, (E, 2) int32; the boxes are (E *
    `BOX_STRIDE`,) float32. Dynamic and hidden parts have no entries.
    """
    scene = len(parts) - 1
    # Start with the children of all roots: their surface area sets the size below which an entry is small.
    capacity = LANES * scene + 2 * target
    waiting_boxes = np.empty((capacity, 6), np.float32)
    waiting = np.empty((capacity, 2), np.int32)
    count = 0
    total = 0.0
    for part in range(scene):
        if not parts[part].is_dynamic and not parts[part].is_hidden:
            count = _add_children(words, frames, part, parts[part].root, waiting_boxes, waiting, count)
    for k in range(count):
        total += _half_area(waiting_boxes[k])
    small = total / target
    boxes = np.zeros(capacity * BOX_STRIDE, np.float32)
    references = np.empty((capacity, 2), np.int32)
    done = 0
    while count:
        count -= 1
        part, reference, box = np.int64(waiting[count, 0]), np.int64(waiting[count, 1]), waiting_boxes[count]
        if reference < 0 or _half_area(box) <= small or done + count + LANES >= capacity:
            for axis in range(3):
                boxes[BOX_STRIDE * done + axis], boxes[BOX_STRIDE * done + 4 + axis] = (
                    box[axis],
                    -box[3 + axis],
                )
            copy_row(waiting, count, references, done)
            done += 1
            continue
        count = _add_children(words, frames, part, reference, waiting_boxes, waiting, count)
    return boxes[: BOX_STRIDE * done].copy(), references[:done].copy()


@entry("float32[:], Part[:], int, int, int, int -> bool", makes_arrays=True)
def thin_out(words, parts, first, count, target, entries_at):
    """Copy *count* nodes of a static tree from *first* to *target*, without the dynamic and hidden parts.

    The boxes are refitted. Return whether any part remains.
    """
    numbers = words.view(np.int32)
    box = np.empty(6, np.float32)
    # Children have higher numbers than their parents.
    for node in range(count - 1, -1, -1):
        base = NODE_STRIDE * (target + node)
        copy_numbers(numbers, NODE_STRIDE * (first + node), numbers, base, NODE_STRIDE)
        for lane in range(LANES):
            if not is_used(words, base + lane):
                continue
            reference = np.int64(child_at(words, base + lane))
            if first <= reference < first + count:
                reference += target - first
                node_box(words, reference, box)
            else:
                part = part_of_child(words, parts, reference, entries_at)
                if not parts[part].is_dynamic and not parts[part].is_hidden:
                    continue
                clear_box(box)
            write_lane(words, base, lane, box, reference)
    node_box(words, target, box)
    return box[0] <= box[3]


@kernel
def _half_area(box):
    dx, dy, dz = np.float64(box[3] - box[0]), np.float64(box[4] - box[1]), np.float64(box[5] - box[2])
    return dx * (dy + dz) + dy * dz


@entry("float32[:], int32[:, :], Part[:], int")
def name_leaves(nodes, entries, parts, first_node):
    """Replace the leaves of a tree over entries by references. Number its nodes from *first_node* on.

    An entry of a part in the scene's frame becomes the reference to its subtree. Any other entry becomes
    ``~(ENTRY + position)``.
    """
    for node in range(len(nodes) // NODE_STRIDE):
        for k in range(LANES):
            position = NODE_STRIDE * node + k
            if not is_used(nodes, position):
                continue
            reference = np.int64(child_at(nodes, position))
            if reference >= 0:
                reference += first_node
            elif parts[entries[~reference, 0]].is_fused:
                reference = np.int64(entries[~reference, 1])
            else:
                reference = ~(ENTRY + ~reference)
            nodes.view(np.int32)[position + NODE_CHILDREN] = reference
