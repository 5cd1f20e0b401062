"""Nodes of eight children, written one lane at a time; see `layout`."""

import numpy as np

from proximity.kernels.compiling import inlined, kernel
from proximity.kernels.layout import CHILDREN, LANES, NODE_STRIDE


@inlined
def write_lane(words, base, lane, box, reference):
    """Write a child of the node at word *base*: its box, lower and upper, and what it is."""
    for axis in range(3):
        words[base + 8 * axis + lane] = box[axis]
        words[base + 24 + 8 * axis + lane] = box[axis + 3]
    words.view(np.int32)[base + CHILDREN + lane] = reference


@kernel
def clear_node(words, node):
    """Make all lanes of a node unused."""
    base = NODE_STRIDE * node
    for k in range(NODE_STRIDE):
        words[base + k] = np.inf if k < 24 else (-np.inf if k < CHILDREN else 0.0)


@kernel
def node_box(words, node, box):
    """The box around all children of a node; unused lanes add nothing."""
    base = NODE_STRIDE * node
    for axis in range(3):
        lower, upper = np.float32(np.inf), np.float32(-np.inf)
        for lane in range(LANES):
            lower = min(lower, words[base + 8 * axis + lane])
            upper = max(upper, words[base + 24 + 8 * axis + lane])
        box[axis], box[axis + 3] = lower, upper


@inlined
def clear_box(box):
    """Make a box one that contains nothing."""
    for axis in range(3):
        box[axis], box[axis + 3] = np.inf, -np.inf
