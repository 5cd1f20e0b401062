"""Parts that a walk over a scene leaves out, though the trees over parts have them.

Who asks may ignore parts that others do not: then rows of ``parts`` are handed over that say of these parts
that they are hidden, and the scene's row that there are such. A walk looks at the children of a node of the
trees over parts, of which each is such a node itself or of one part. So nothing below an ignored part is
opened, however near it is.
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
    """The part that a node is of: the last whose root is not behind it."""
    # Halving without a branch, which nobody could predict.
    low, count = np.int64(0), np.int64(len(parts) - 1)
    while count > 1:
        half = count // 2
        low += half if parts[low + half].root <= node else 0
        count -= half
    return low


@inlined
def part_of_child(words, parts, reference, entries_at):
    """The part that a leaf of the trees over parts is of: an entry, or a part's own node or block."""
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
    """Bounds of the children of a node, and which are open: as they are."""
    return bounds, is_open


@inlined
def heed_some(model, reference, bounds, is_open):
    """The same, without the children of parts that are ignored: their bounds are inf."""
    _, words, _, parts = model
    if reference < parts[len(parts) - 1].first_node:
        return bounds, is_open
    distances = stack_f32(LANES)
    _find_ignored(words, parts, reference, bits(is_open), distances)
    added = load(distances, 0)
    return bounds + added, is_open & (added == splat32(np.float32(0.0)))
