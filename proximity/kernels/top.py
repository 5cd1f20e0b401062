"""The static tree over the parts of a scene that stand still, as opened subtrees.

Parts of an assembly overlap: a tree of whole parts would send a query into many of them. So large parts are
opened until every *entry*, a subtree of a part, is small compared with the scene, and the tree is built
over entries.

Source: Benthin, Woop, Wald, Áfra 2017, "Improved two-level BVHs using partial re-braiding".
"""

import numpy as np

from proximity.kernels.box import BOX_MARGIN, round_down, round_up
from proximity.kernels.compiling import inlined, kernel, maker
from proximity.kernels.layout import (
    CENTRE,
    CHILDREN,
    ENTRY,
    IS_FUSED,
    IS_HIDDEN,
    IS_LOOSE,
    LANES,
    NO_PART,
    NODE_STRIDE,
    ROOT,
    ROTATION,
    SCALE,
    TRANSLATION,
)
from proximity.kernels.scene import last_up_to, part_of_slot
from proximity.kernels.wide_node import clear_box, node_box, write_lane
from proximity.simd import load_int


@kernel
def scene_box(frames, part, scene, lower, upper, box):
    """Box in the scene's scaled frame, widened and rounded outward, of a box in a part's local frame.

    *lower*, *upper*: (3,) float64. *box*: (6,) float32.
    """
    for axis in range(3):
        middle, half = frames[part, TRANSLATION + axis], 0.0
        for other in range(3):
            low = lower[other] / frames[part, SCALE] + frames[part, CENTRE + other]
            high = upper[other] / frames[part, SCALE] + frames[part, CENTRE + other]
            turn = frames[part, ROTATION + 3 * axis + other]
            middle += turn * (0.5 * low + 0.5 * high)
            half += abs(turn) * (0.5 * high - 0.5 * low)
        low = (middle - half - frames[scene, CENTRE + axis]) * frames[scene, SCALE]
        high = (middle + half - frames[scene, CENTRE + axis]) * frames[scene, SCALE]
        box[axis] = round_down(low) - BOX_MARGIN
        box[axis + 3] = round_up(high) + BOX_MARGIN


@kernel
def _lane_box(words, frames, part, base, k, scene, lower, upper, box):
    """The same for the child in lane *k* of the node at *base*."""
    for axis in range(3):
        lower[axis] = words[base + 8 * axis + k]
        upper[axis] = words[base + 24 + 8 * axis + k]
    scene_box(frames, part, scene, lower, upper, box)


@maker
def gather_entries(words, frames, parts, target):
    """Return boxes (E, 6) float32 and references (E, 2) int32 (part, reference) of about *target* entries.

    Parts that are loose or hidden have none.
    """
    scene = len(parts) - 1
    lower, upper, box = np.empty(3), np.empty(3), np.empty(6, np.float32)
    # Children of all roots first: their surfaces set the size from which on an entry is small.
    capacity = LANES * scene + 2 * target
    waiting_boxes = np.empty((capacity, 6), np.float32)
    waiting = np.empty((capacity, 2), np.int32)
    count = 0
    total = 0.0
    for part in range(scene):
        if parts[part, IS_LOOSE] or parts[part, IS_HIDDEN]:
            continue
        base = NODE_STRIDE * parts[part, ROOT]
        for k in range(LANES):
            if words[base + k] <= words[base + 24 + k]:
                _lane_box(words, frames, part, base, k, scene, lower, upper, box)
                waiting_boxes[count] = box
                waiting[count, 0] = part
                waiting[count, 1] = load_int(words, base + CHILDREN + k)
                total += _half_area(box)
                count += 1
    small = total / target
    boxes = np.empty((capacity, 6), np.float32)
    references = np.empty((capacity, 2), np.int32)
    done = 0
    while count:
        count -= 1
        part, reference = np.int64(waiting[count, 0]), np.int64(waiting[count, 1])
        box[:] = waiting_boxes[count]
        if reference < 0 or _half_area(box) <= small or done + count + LANES >= capacity:
            boxes[done] = box
            references[done] = waiting[count]
            done += 1
            continue
        base = NODE_STRIDE * reference
        for k in range(LANES):
            if words[base + k] <= words[base + 24 + k]:
                _lane_box(words, frames, part, base, k, scene, lower, upper, box)
                waiting_boxes[count] = box
                waiting[count, 0] = part
                waiting[count, 1] = load_int(words, base + CHILDREN + k)
                count += 1
    return boxes[:done].copy(), references[:done].copy()


@inlined
def _part_of_child(words, parts, reference, entries_at):
    """The part that a leaf of the static tree is of: an entry, or a part's own node or block."""
    if reference >= 0:
        return last_up_to(parts, ROOT, reference)
    if ~reference < ENTRY:
        return part_of_slot(parts, LANES * ~reference, np.int64(NO_PART))
    return np.int64(load_int(words, entries_at + 2 * (~reference - ENTRY)))


@maker
def thin_out(words, parts, first, count, target, entries_at):
    """Copy a static tree of *count* nodes from node *first* to node *target*, without parts that have left.

    Those are loose or hidden now. Boxes become tight again. Returns whether anything is left.
    """
    numbers = words.view(np.int32)
    box = np.empty(6, np.float32)
    # Children have higher numbers than their parents.
    for node in range(count - 1, -1, -1):
        base = NODE_STRIDE * (target + node)
        numbers[base : base + NODE_STRIDE] = numbers[NODE_STRIDE * (first + node) :][:NODE_STRIDE]
        for lane in range(LANES):
            if not words[base + lane] <= words[base + 24 + lane]:
                continue
            reference = np.int64(numbers[base + CHILDREN + lane])
            if first <= reference < first + count:
                reference += target - first
                node_box(words, reference, box)
            else:
                part = _part_of_child(words, parts, reference, entries_at)
                if not parts[part, IS_LOOSE] and not parts[part, IS_HIDDEN]:
                    continue
                clear_box(box)
            write_lane(words, base, lane, box, reference)
    node_box(words, target, box)
    return box[0] <= box[3]


@kernel
def _half_area(box):
    dx, dy, dz = np.float64(box[3] - box[0]), np.float64(box[4] - box[1]), np.float64(box[5] - box[2])
    return dx * (dy + dz) + dy * dz


@kernel
def _leaf(position, order, references, parts):
    """What stands in a node for the entry at *position*."""
    part, reference = references[order[position], 0], references[order[position], 1]
    return np.int64(reference) if parts[part, IS_FUSED] else ~(ENTRY + position)


@maker
def open_leaves(nodes, order, block_first, boxes, references, parts, first_node):
    """Return the nodes of a tree over entries with every leaf made a node of its own entries.

    Nodes are numbered from *first_node* on. An entry of a part in the scene's own frame is its subtree
    itself; another is ``~(ENTRY + position in order)``.
    """
    node_count = len(nodes) // NODE_STRIDE
    block_count = len(block_first) - 1
    opened = np.zeros((node_count + block_count) * NODE_STRIDE, np.float32)
    opened[: len(nodes)] = nodes
    numbers = opened.view(np.int32)
    used = node_count
    for node in range(node_count):
        for k in range(LANES):
            at = NODE_STRIDE * node + CHILDREN + k
            if not nodes[NODE_STRIDE * node + k] <= nodes[NODE_STRIDE * node + 24 + k]:
                continue
            if numbers[at] >= 0:
                numbers[at] += first_node
                continue
            block = ~numbers[at]
            first, end = block_first[block], block_first[block + 1]
            if end - first == 1:
                numbers[at] = _leaf(first, order, references, parts)
                continue
            numbers[at] = first_node + used
            base = NODE_STRIDE * used
            used += 1
            for lane in range(LANES):
                for axis in range(3):
                    inside = first + lane < end
                    opened[base + 8 * axis + lane] = boxes[order[first + lane], axis] if inside else np.inf
                    opened[base + 24 + 8 * axis + lane] = (
                        boxes[order[first + lane], axis + 3] if inside else -np.inf
                    )
                if first + lane < end:
                    numbers[base + CHILDREN + lane] = _leaf(first + lane, order, references, parts)
    return opened[: used * NODE_STRIDE].copy()
