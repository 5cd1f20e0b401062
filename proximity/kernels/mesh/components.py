"""Connected components of a graph, by union and find."""

import numpy as np

from proximity.native import entry, kernel


@kernel
def _root(parents, node):
    """The lowest node known to be connected with *node*; paths there are halved."""
    while parents[node] != node:
        parents[node] = parents[parents[node]]
        node = parents[node]
    return node


@entry("int, int64[:], int64[:] -> int32[:]", makes_arrays=True)
def connected(count, one, other):
    """Return labels (count,) int32 of nodes that the links *one* to *other* (L,) int64 connect.

    They count from 0 and rise with the lowest node of each component.
    """
    parents = np.arange(count)
    for link in range(len(one)):
        first, last = _root(parents, one[link]), _root(parents, other[link])
        parents[max(first, last)] = min(first, last)
    labels = np.empty(count, np.int32)
    found = 0
    for node in range(count):
        root = _root(parents, node)
        if root == node:
            labels[node] = found
            found += 1
        else:
            labels[node] = labels[root]
    return labels
