"""Parts that a walk over a scene skips although they are in the trees over parts.

A query or a finger may ignore parts. It then passes rows of ``parts`` in which these are marked as hidden,
and the scene's row is marked as having such parts. In the trees over parts, each child of a node is another
node of these trees or belongs to one part: the walk closes the children of ignored parts.
"""

import numpy as np

from proximity.kernels.geometry.frames import part_of_slot
from proximity.kernels.layout import ENTRY, LANES, NODE_STRIDE
from proximity.kernels.nodes import child_at
from proximity.kernels.stack_arrays import stack_f32
from proximity.native import inlined, kernel
from proximity.native.simd import bits, load, load_int, splat32, trailing_zeros


@inlined
def part_of_node(parts, node):
    """Return the part of a node. It is the last part whose root does not follow the node."""
    # Branchless binary search: the comparisons are unpredictable.
    low, count = np.int64(0), np.int64(len(parts) - 1)
    while count > 1:
        half = count // 2
        low += half if parts[low + half].root <= node else 0
        count -= half
    return low


@inlined
def part_of_child(words, parts, reference, entries_at):
    """Return the part of a leaf of the trees over parts: of an entry, or of a node or block of a part."""
    if reference >= 0:
        return part_of_node(parts, reference)
    if ~reference < ENTRY:
        return part_of_slot(words, parts, LANES * ~reference)
    return np.int64(load_int(words, entries_at + 2 * (~reference - ENTRY)))


@kernel
def _find_ignored(words, parts, node, opened, distances):
    """Fill *distances* (`LANES`,): inf for *opened* children of ignored parts, 0 for the others."""
    scene = len(parts) - 1
    for k in range(LANES):
        distances[k] = 0.0
    while opened:
        k = trailing_zeros(opened)
        opened &= opened - 1
        reference = np.int64(child_at(words, NODE_STRIDE * node + k))
        if reference < parts[scene].first_node:
            part = part_of_child(words, parts, reference, parts[scene].entries)
            if parts[part].is_hidden:
                distances[k] = np.inf


@inlined
def heed_all(tables, reference, bounds, is_open):
    """Return the bounds of the children of a node, and the mask of open ones, unchanged."""
    return bounds, is_open


@inlined
def heed_some(model, reference, bounds, is_open):
    """Return the same, with the children of ignored parts closed: their bounds are inf."""
    _, words, _, parts = model
    if reference < parts[len(parts) - 1].first_node:
        return bounds, is_open
    distances = stack_f32(LANES)
    _find_ignored(words, parts, reference, bits(is_open), distances)
    added = load(distances, 0)
    return bounds + added, is_open & (added == splat32(np.float32(0.0)))
