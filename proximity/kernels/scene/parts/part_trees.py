"""The trees over the parts of a scene: their layout in the words, and how they are built and updated.

After the nodes of the parts, a scene has one empty node, `STATIC_COPIES` copies of a tree over the parts that
are not dynamic, and `REGION_COPIES` copies of the *region* that changes when parts move, which is the super
node and the dynamic tree. Updates write to the next copy, so that running queries read unchanged memory. A
scene of one part has only the empty node.
"""

import numpy as np

from proximity.kernels.geometry.local_frame import frame_of_box
from proximity.kernels.layout import (
    ENTRIES_SHIFT,
    LANES,
    NEVER,
    NODE_PARTS,
    NODE_STRIDE,
    REGION_COPIES,
    STATIC_COPIES,
    DynamicParts,
)
from proximity.kernels.scene.parts.dynamic_tree import bring_up_to_date
from proximity.kernels.scene.parts.static_tree import gather_entries, name_leaves, thin_out
from proximity.kernels.stack_arrays import stack_f64
from proximity.kernels.thresholds import MOVING_MARGIN, SMALLEST_REACH
from proximity.kernels.tree.builder import build_tree
from proximity.kernels.tree.collapse import clear_node
from proximity.native import allocating_kernel, entry, inlined, kernel
from proximity.native.simd import load_int

ENTRIES_PER_PART = 32
MIN_ENTRIES = 256
"""Minimum number of entries into which large parts are opened in a scene's tree.

With 32 entries per part, rays and points take 0.97 of the time that they take with 16, on 118 touching parts
of 43 k faces. 64 bring no gain, and building a tree over 120 parts takes 12 ms instead of 9.
"""
NO_NODE = -1
"""Marks an empty static tree, which has no root."""


# --- layout ----------------------------------------------------------------------------------------------


@entry("Part[:], int -> int, int, int")
def copy_offsets(parts, copy):
    """Return where a copy of the static tree and a copy of the region are.

    The result is the root of the static tree, the first word of its entries, and the super node. A scene of
    one part has only the last, which is the empty node.
    """
    scene = len(parts) - 1
    first, capacity = parts[scene].first_node, parts[scene].static_capacity
    if capacity == 0:
        return first, NODE_STRIDE * first, first
    entry_words = 2 * (LANES * capacity + scene)
    static_nodes = capacity + (entry_words + NODE_STRIDE - 1) // NODE_STRIDE
    # A super node, and the levels below it for the case that all parts are dynamic.
    region_nodes, count = np.int64(1), np.int64(scene)
    while count >= LANES:
        count = (count + LANES - 1) // LANES
        region_nodes += count
    root = first + 1 + copy * static_nodes
    region = first + 1 + STATIC_COPIES * static_nodes + copy * region_nodes
    return root, NODE_STRIDE * (root + capacity), region


@entry("Part[:] -> int, int")
def copies_in_use(parts):
    """Return which copies of the region and of the static tree a model uses. An unknown copy gives -1."""
    row = parts[len(parts) - 1]
    moving, static = np.int64(-1), np.int64(-1 if row.static_capacity else 0)
    for copy in range(REGION_COPIES):
        _, entries, region = copy_offsets(parts, copy)
        if region == row.super_node and moving < 0:
            moving = copy
        if entries == row.entries and copy < STATIC_COPIES and row.static_capacity:
            static = copy
    return moving, static


# --- the static tree -------------------------------------------------------------------------------------


@entry("Frame[:], Part[:], float64[:], float -> bool")
def choose_frame(frames, parts, centre, scale):
    """Write a scene frame that contains all parts, and mark the parts that are in the same frame.

    The frame of *centre* and *scale* is used if all parts are within its reach, because parts in one frame
    can be traversed as one tree. Otherwise a frame with a margin for motion is chosen. Return False, without
    changes, if the parts are too far apart for any frame.
    """
    scene = len(parts) - 1
    own, lower, upper = stack_f64(3), stack_f64(3), stack_f64(3)
    reach = 0.0
    for axis in range(3):
        lower[axis], upper[axis] = np.inf, -np.inf
        for part in range(scene):
            lower[axis] = min(lower[axis], frames[part].box_lower[axis])
            upper[axis] = max(upper[axis], frames[part].box_upper[axis])
        own[axis] = centre[axis]
        low, high = (lower[axis] - centre[axis]) * scale, (upper[axis] - centre[axis]) * scale
        reach = max(reach, abs(low), abs(high))
    if scene > 1 and not SMALLEST_REACH <= reach <= 1.0:
        scale = MOVING_MARGIN * frame_of_box(lower, upper, own)
        if not scale > 0.0:
            return False
    for axis in range(3):
        for other in range(3):
            frames[scene].rotation[3 * axis + other] = 1.0 if axis == other else 0.0
        frames[scene].translation[axis], frames[scene].centre[axis] = 0.0, own[axis]
    frames[scene].scale = scale
    note_fused(frames, parts)
    return True


@entry("Frame[:], Part[:]")
def note_fused(frames, parts):
    """Mark the parts that are in the scene's frame, and whether all parts are."""
    scene = len(parts) - 1
    all_fused = True
    for part in range(scene):
        is_alike = not parts[part].is_dynamic and frames[part].scale == frames[scene].scale
        for k in range(9):
            is_alike = is_alike and frames[part].rotation[k] == frames[scene].rotation[k]
        for axis in range(3):
            is_alike = is_alike and frames[part].translation[axis] == frames[scene].translation[axis]
            is_alike = is_alike and frames[part].centre[axis] == frames[scene].centre[axis]
        parts[part].is_fused = is_alike
        all_fused = all_fused and is_alike
    parts[scene].all_fused = scene == 1 or all_fused


@entry("float32[:], Frame[:], Part[:], int -> float32[:], int32[:, :]", makes_arrays=True)
def static_tree(words, frames, parts, first_node):
    """Return the nodes and the entries of a tree over the parts that are neither dynamic nor hidden.

    *first_node*: the number of its first node.
    """
    scene, still_count = len(parts) - 1, 0
    for part in range(scene):
        still_count += not parts[part].is_dynamic and not parts[part].is_hidden
    if scene == 1 or still_count == 0:
        return np.zeros(0, np.float32), np.zeros((0, 2), np.int32)
    boxes, gathered = gather_entries(words, frames, parts, max(MIN_ENTRIES, ENTRIES_PER_PART * still_count))
    nodes, order, _ = build_tree(boxes, ENTRIES_SHIFT)
    entries = np.empty((len(order), 2), np.int32)
    for k in range(len(order)):
        entries[k, 0], entries[k, 1] = gathered[order[k], 0], gathered[order[k], 1]
    name_leaves(nodes, entries, parts, first_node)
    return nodes, entries


@entry("float32[:], Part[:], int, float32[:], int32[:, :] -> bool")
def write_static(words, parts, copy, nodes, entries):
    """Write a copy of a static tree, and its fields in the scene's row. Return whether it fits.

    A scene of one part has no static tree.
    """
    scene, node_count = len(parts) - 1, len(nodes) // NODE_STRIDE
    capacity = parts[scene].static_capacity
    if capacity == 0:
        return True
    if node_count > capacity or len(entries) > LANES * capacity:
        return False
    root, at, _ = copy_offsets(parts, copy)
    for k in range(len(nodes)):
        words[NODE_STRIDE * root + k] = nodes[k]
    numbers = words.view(np.int32)
    for k in range(len(entries)):
        numbers[at + 2 * k], numbers[at + 2 * k + 1] = entries[k, 0], entries[k, 1]
    parts[scene].entry_count, parts[scene].static_node_count = len(entries), node_count
    parts[scene].static_root = root if node_count else NO_NODE
    write_dynamic_entries(words, parts, at)
    return True


@entry("float32[:], Frame[:], Part[:], int -> bool", makes_arrays=True)
def make_static(words, frames, parts, copy):
    """Rebuild the static tree, and also the scene's frame if parts have left it.

    Return whether the tree fits.
    """
    scene, centre = len(parts) - 1, np.empty(3)
    for axis in range(3):
        centre[axis] = frames[scene].centre[axis]
    if not choose_frame(frames, parts, centre, frames[scene].scale):
        return False
    root, _, _ = copy_offsets(parts, copy)
    nodes, entries = static_tree(words, frames, parts, root)
    return write_static(words, parts, copy, nodes, entries)


@entry("float32[:], Part[:], int", makes_arrays=True)
def thin_static(words, parts, copy):
    """Write another copy of the static tree without the parts that have become dynamic or hidden."""
    scene = len(parts) - 1
    from_entries, root = parts[scene].entries, parts[scene].static_root
    target, at, _ = copy_offsets(parts, copy)
    if root != NO_NODE:
        is_left = thin_out(words, parts, root, parts[scene].static_node_count, target, from_entries)
        parts[scene].static_root = target if is_left else NO_NODE
    all_fused = True
    for part in range(scene):
        all_fused = all_fused and parts[part].is_fused != 0
    parts[scene].all_fused = all_fused
    numbers = words.view(np.int32)
    for k in range(2 * parts[scene].entry_count):
        numbers[at + k] = numbers[from_entries + k]
    write_dynamic_entries(words, parts, at)


@kernel
def write_dynamic_entries(words, parts, at):
    """Write one entry for each dynamic part after the entries of the static tree.

    *at*: the word at which the entries of the static tree start.
    """
    scene, numbers = len(parts) - 1, words.view(np.int32)
    to = at + 2 * parts[scene].entry_count
    for part in range(scene):
        if parts[part].is_dynamic:
            numbers[to], numbers[to + 1] = part, parts[part].root
            to += 2
    parts[scene].entries = at


# --- the dynamic tree ------------------------------------------------------------------------------------


@inlined
def _listed_dynamic(words, parts, count, k):
    """Return the part at position *k* of the Morton order in the dynamic tree of *count* parts."""
    region = parts[len(parts) - 1].super_node
    # Fewer than eight are in the super node, next to the static tree.
    node, lane = (region, k + 1) if count < LANES else (region + 1 + k // LANES, k % LANES)
    return np.int64(load_int(words, NODE_STRIDE * node + NODE_PARTS + lane))


@allocating_kernel
def dynamic_parts(words, parts):
    """Return the rows of the dynamic parts, and their permutation to the Morton order of the present tree.

    The permutation is empty if the tree does not have each of these parts once.
    """
    scene = len(parts) - 1
    rows, position_of = np.empty(scene, np.int64), np.full(scene, -1, np.int64)
    count = 0
    for part in range(scene):
        if parts[part].is_dynamic:
            rows[count], position_of[part] = part, count
            count += 1
    order = np.empty(count, np.int64)
    for k in range(count):
        part = _listed_dynamic(words, parts, count, k) if parts[scene].static_capacity else rows[k]
        if not 0 <= part < scene or position_of[part] < 0:
            return rows[:count].copy(), order[:0].copy()
        order[k], position_of[part] = position_of[part], -1
    return rows[:count].copy(), order


@allocating_kernel
def write_moving(words, frames, parts, region, rows, order, steps):
    """Write the boxes, the scene's row and the dynamic tree that follow from the poses.

    Return the reach of the parts. *rows*: the dynamic parts. *order*: their permutation to Morton order,
    which is updated by up to *steps* swaps.
    """
    versions, boxes = np.zeros(len(parts), np.int64), np.zeros((len(parts) - 1, 6), np.float32)
    dynamic = DynamicParts(rows, order, np.empty(len(rows), np.int64))
    return bring_up_to_date(
        words, frames, parts, versions, NEVER, boxes, dynamic, steps, region, NEVER, frames, parts
    )


@entry("float32[:], Frame[:], Part[:]", makes_arrays=True)
def begin_moving(words, frames, parts):
    """Clear the empty node of a new model, and write the first copy of its region."""
    scene, count = len(parts) - 1, 0
    rows = np.empty(scene, np.int64)
    for part in range(scene):
        rows[count] = part
        count += parts[part].is_dynamic != 0
    clear_node(words, parts[scene].first_node)
    _, _, region = copy_offsets(parts, 0)
    write_moving(words, frames, parts, region, rows[:count].copy(), np.arange(count), count * count)
