"""Improvement of a binary tree by moving large subtrees to positions where they add the least surface area.

Top-down splitting considers one run at a time and cannot move faces elsewhere later. Here, a subtree is
removed with its parent, which is replaced by the sibling. The gain is the decrease in surface area of all
ancestors. The best position is found by a search from the root in the order of added area, which ends when no
position can be better.

Source: Bittner, Hapala, Havran 2013, "Fast insertion-based optimization of bounding volume hierarchies".
"""

import numpy as np

from proximity.kernels.layout import BOX_STRIDE
from proximity.kernels.tree.binned_sah import LINK_LEFT, LINK_RIGHT, NO_CHILD, half_area
from proximity.native import allocating_kernel, inlined, kernel
from proximity.native.simd import load, minimum, store

MAX_SEARCH = 1024
"""Maximum number of positions that wait in a search. If there are more, the best one found is used."""
REINSERTION_RATIO = 4
"""One of this many subtrees is reinserted. The largest ones are chosen, as they matter most."""
MIN_REINSERTIONS = 4096
"""Minimum number of reinsertions, if the tree is large enough."""


@inlined
def _joint_area(boxes, one, box):
    """Return half the surface area of the box around a node and another box."""
    return half_area(minimum(load(boxes, BOX_STRIDE * one), box))


@inlined
def _mend_upward(boxes, links, parents, node):
    """Update the boxes of *node* and all its ancestors so that they fit their children."""
    while node >= 0:
        left, right = np.int64(links[node, LINK_LEFT]), np.int64(links[node, LINK_RIGHT])
        store(
            boxes, BOX_STRIDE * node, minimum(load(boxes, BOX_STRIDE * left), load(boxes, BOX_STRIDE * right))
        )
        node = np.int64(parents[node])


@inlined
def _replace_child(links, parents, old, new):
    """Make *new* a child of the parent of *old*, in the place of *old*."""
    parent = np.int64(parents[old])
    links[parent, LINK_LEFT if links[parent, LINK_LEFT] == old else LINK_RIGHT] = new
    parents[new] = parent


@inlined
def _wait(keys, nodes, count, key, node):
    """Push an entry onto a heap."""
    at = count
    while at > 0 and keys[(at - 1) >> 1] > key:
        keys[at], nodes[at] = keys[(at - 1) >> 1], nodes[(at - 1) >> 1]
        at = (at - 1) >> 1
    keys[at], nodes[at] = key, node


@inlined
def _take_least(keys, nodes, count):
    """Remove the least entry from a heap of *count* entries."""
    key, node = keys[count - 1], nodes[count - 1]
    at = 0
    while True:
        child = 2 * at + 1
        if child + 1 < count - 1 and keys[child + 1] < keys[child]:
            child += 1
        if child >= count - 1 or keys[child] >= key:
            break
        keys[at], nodes[at] = keys[child], nodes[child]
        at = child
    keys[at], nodes[at] = key, node


@kernel
def _best_position(boxes, links, parents, moved, beside, keys, nodes):
    """Return the node next to which the removed subtree *moved* adds the least surface area.

    *beside*: its former sibling. *keys*, *nodes*: (`MAX_SEARCH`,), scratch memory.
    """
    box = load(boxes, BOX_STRIDE * moved)
    own = half_area(box)
    best, position = _joint_area(boxes, beside, box), beside
    above = np.int64(parents[beside])
    while above >= 0:
        best += _joint_area(boxes, above, box) - half_area(load(boxes, BOX_STRIDE * above))
        above = np.int64(parents[above])
    # Keys: increase of the surface area of a position's ancestors.
    keys[0], nodes[0] = 0.0, 0
    count = 1
    while count:
        gained, node = keys[0], np.int64(nodes[0])
        _take_least(keys, nodes, count)
        count -= 1
        if gained + own >= best:
            break
        joint = _joint_area(boxes, node, box)
        if gained + joint < best and node != 0:
            best, position = gained + joint, node
        gained += joint - half_area(load(boxes, BOX_STRIDE * node))
        if gained + own < best and links[node, LINK_LEFT] != NO_CHILD and count + 2 <= MAX_SEARCH:
            _wait(keys, nodes, count, gained, links[node, LINK_LEFT])
            _wait(keys, nodes, count + 1, gained, links[node, LINK_RIGHT])
            count += 2
    return position


@allocating_kernel
def _at_rank(values, rank):
    """Return the number of a given rank among *values* (N,), float32 and not negative, by radix selection.

    Such numbers have the order of their bits. Each pass selects by eight bits, from the highest on.
    """
    keys = values.view(np.uint32)
    counts = np.empty(256, np.int64)
    prefix, left = np.uint32(0), np.int64(rank)
    for shift in (24, 16, 8, 0):
        counts[:] = 0
        for i in range(len(keys)):
            if (keys[i] >> (shift + 7)) >> 1 == prefix:
                counts[(keys[i] >> shift) & 255] += 1
        digit = 0
        while left >= counts[digit]:
            left -= counts[digit]
            digit += 1
        prefix = np.uint32((prefix << 8) | digit)
    for i in range(len(keys)):
        if keys[i] == prefix:
            return values[i]
    return values[0]  # unreachable: some value has that rank


@allocating_kernel
def improve(boxes, links):
    """Move the largest subtrees of a binary tree to where they add the least surface area.

    The tree is from `binned_sah.halve`. Afterwards, children may precede their parents. The root stays node
    0.
    """
    count = len(links)
    parents = np.full(count, NO_CHILD, np.int32)
    areas = np.empty(count, np.float32)
    for node in range(count):
        areas[node] = half_area(load(boxes, BOX_STRIDE * node)) + np.float32(0.0)  # clears the sign of zero
        if links[node, LINK_LEFT] != NO_CHILD:
            parents[links[node, LINK_LEFT]] = node
            parents[links[node, LINK_RIGHT]] = node
    wanted = min(count, max(count // REINSERTION_RATIO, MIN_REINSERTIONS))
    least = _at_rank(areas, count - wanted)
    keys, nodes = np.empty(MAX_SEARCH, np.float32), np.empty(MAX_SEARCH, np.int32)
    for node in range(1, count):
        parent = np.int64(parents[node])
        if areas[node] < least or parent == 0:
            continue
        sibling = np.int64(links[parent, LINK_RIGHT if links[parent, LINK_LEFT] == node else LINK_LEFT])
        _replace_child(links, parents, parent, sibling)
        _mend_upward(boxes, links, parents, np.int64(parents[sibling]))
        position = _best_position(boxes, links, parents, node, sibling, keys, nodes)
        # The parent moves with it.
        _replace_child(links, parents, position, parent)
        links[parent, LINK_LEFT], links[parent, LINK_RIGHT] = position, node
        parents[position], parents[node] = parent, parent
        _mend_upward(boxes, links, parents, parent)
