"""Nodes of eight children, written one lane at a time."""

import numpy as np

from proximity.kernels.layout import LANES, NODE_CHILDREN, NODE_STRIDE
from proximity.native import entry, inlined, kernel
from proximity.native.simd import horizontal_min, load, splat32, store


@inlined
def write_lane(words, base, lane, box, reference):
    """Write a child of the node at word *base*: its box, lower and upper, and what it is."""
    for axis in range(3):
        words[base + 8 * axis + lane] = box[axis]
        words[base + 24 + 8 * axis + lane] = box[axis + 3]
    words.view(np.int32)[base + NODE_CHILDREN + lane] = reference


@entry("float32[:], int")
def clear_node(words, node):
    """Make all lanes of a node unused."""
    base = NODE_STRIDE * node
    for k in range(0, NODE_STRIDE, LANES):
        filling = np.inf if k < 24 else (-np.inf if k < NODE_CHILDREN else 0.0)
        store(words, base + k, splat32(np.float32(filling)))


@kernel
def node_box(words, node, box):
    """The box around all children of a node; unused lanes add nothing."""
    base = NODE_STRIDE * node
    for axis in range(3):
        box[axis] = horizontal_min(load(words, base + 8 * axis))
        box[axis + 3] = -horizontal_min(-load(words, base + 24 + 8 * axis))


@inlined
def clear_box(box):
    """Make a box one that contains nothing."""
    for axis in range(3):
        box[axis], box[axis + 3] = np.inf, -np.inf
