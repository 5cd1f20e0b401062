"""A better binary tree: the largest subtrees are taken out, each put back where it adds least surface.

Halving looks at one run at a time and never sees that a part of it would be better off elsewhere. A subtree
is taken out with its parent, whose other child takes its place; what all nodes on the way up lose in surface
is the gain. The best place is found by a search from the root that follows what adds least so far and ends
once no place can be better.

Source: Bittner, Hapala, Havran 2013, "Fast insertion-based optimization of bounding volume hierarchies".
"""

import numpy as np

from proximity.kernels.tree.binned_sah import LEFT, NO_CHILD, RECORD, RIGHT, half_area
from proximity.native import inlined, kernel, maker
from proximity.simd import load, minimum, store

LARGEST_SEARCH = 1024
"""Places that wait to be looked at; beyond them the search makes do with what it has found."""
SHARE = 4
"""One in so many subtrees is put elsewhere: the largest, on which most depends."""
FEWEST = 4096
"""So many in any case, if there are."""


@inlined
def _joint_area(boxes, one, box):
    """Half the surface of the box around node *one* and *box*."""
    return half_area(minimum(load(boxes, RECORD * one), box))


@inlined
def _mend_upward(boxes, links, parents, node):
    """Make the boxes from *node* up fit their children again."""
    while node >= 0:
        left, right = np.int64(links[node, LEFT]), np.int64(links[node, RIGHT])
        store(boxes, RECORD * node, minimum(load(boxes, RECORD * left), load(boxes, RECORD * right)))
        node = np.int64(parents[node])


@inlined
def _put_in_place(links, parents, old, new):
    """Have the parent of *old* refer to *new* instead."""
    parent = np.int64(parents[old])
    links[parent, LEFT if links[parent, LEFT] == old else RIGHT] = new
    parents[new] = parent


@inlined
def _wait(keys, nodes, count, key, node):
    """Add to a heap."""
    at = count
    while at > 0 and keys[(at - 1) >> 1] > key:
        keys[at], nodes[at] = keys[(at - 1) >> 1], nodes[(at - 1) >> 1]
        at = (at - 1) >> 1
    keys[at], nodes[at] = key, node


@inlined
def _take_least(keys, nodes, count):
    """Remove the least of a heap of *count*, which has been read; mend it."""
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
def _best_place(boxes, links, parents, moved, beside, keys, nodes):
    """The node beside which the subtree *moved*, which is out of the tree, adds least surface.

    *beside*: where it was. *keys*, *nodes*: (`LARGEST_SEARCH`,) scratch.
    """
    box = load(boxes, RECORD * moved)
    own = half_area(box)
    best, place = _joint_area(boxes, beside, box), beside
    above = np.int64(parents[beside])
    while above >= 0:
        best += _joint_area(boxes, above, box) - half_area(load(boxes, RECORD * above))
        above = np.int64(parents[above])
    # What the nodes above a place would gain.
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
            best, place = gained + joint, node
        gained += joint - half_area(load(boxes, RECORD * node))
        if gained + own < best and links[node, LEFT] != NO_CHILD and count + 2 <= LARGEST_SEARCH:
            _wait(keys, nodes, count, gained, links[node, LEFT])
            _wait(keys, nodes, count + 1, gained, links[node, RIGHT])
            count += 2
    return place


@maker
def _at_rank(values, rank):
    """Return what would be at that place if *values* (N,), float32 and not negative, were sorted.

    Such numbers are ordered as their bits are: eight of them a pass, from the highest on.
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
    return values[0]  # never: some value has that rank


@maker
def improve(boxes, links):
    """Put the largest subtrees of a binary tree where they add least; see `halving.halve`.

    Children are no longer behind their parents afterwards. The root stays node 0.
    """
    count = len(links)
    parents = np.full(count, NO_CHILD, np.int32)
    areas = np.empty(count, np.float32)
    for node in range(count):
        areas[node] = half_area(load(boxes, RECORD * node)) + np.float32(0.0)  # no zero with a sign
        if links[node, LEFT] != NO_CHILD:
            parents[links[node, LEFT]] = node
            parents[links[node, RIGHT]] = node
    wanted = min(count, max(count // SHARE, FEWEST))
    least = _at_rank(areas, count - wanted)
    keys, nodes = np.empty(LARGEST_SEARCH, np.float32), np.empty(LARGEST_SEARCH, np.int32)
    for node in range(1, count):
        parent = np.int64(parents[node])
        if areas[node] < least or parent == 0:
            continue
        sibling = np.int64(links[parent, RIGHT if links[parent, LEFT] == node else LEFT])
        _put_in_place(links, parents, parent, sibling)
        _mend_upward(boxes, links, parents, np.int64(parents[sibling]))
        place = _best_place(boxes, links, parents, node, sibling, keys, nodes)
        # The parent goes with it.
        _put_in_place(links, parents, place, parent)
        links[parent, LEFT], links[parent, RIGHT] = place, node
        parents[place], parents[node] = parent, parent
        _mend_upward(boxes, links, parents, parent)
