"""Connected components by union-find, which includes the relative orientation of nodes.

The link of a node is twice the number of a connected node, plus one if their orientations are opposite; a
root links to itself. The root of a component is its lowest node.
"""

import numpy as np

from proximity.native import allocating_kernel, kernel


@allocating_kernel
def unlinked(count):
    """Return links for nodes that are not connected, (count,) int64."""
    links = np.empty(count, np.int64)
    for node in range(count):
        links[node] = 2 * node
    return links


@kernel
def root_of(links, node):
    """Return twice the root of a node, plus one if their orientations are opposite.

    The path to it is halved.
    """
    at = 2 * node
    while links[at >> 1] != at & ~1:
        link = links[at >> 1]
        link = links[link >> 1] ^ (link & 1)
        links[at >> 1] = link
        at = link ^ (at & 1)
    return at


@kernel
def join(links, one, other, is_crossed):
    """Connect two nodes, with opposite orientations if *is_crossed* is 1.

    Return False if this is a contradiction.
    """
    first, last = root_of(links, one), root_of(links, other) ^ is_crossed
    low, high = min(first >> 1, last >> 1), max(first >> 1, last >> 1)
    if low == high:
        return first == last
    links[high] = 2 * low + ((first ^ last) & 1)
    return True


@allocating_kernel
def component_labels(links):
    """Return the component of each node, (N,) int64, and the number of components.

    Components are numbered in the order of their lowest nodes.
    """
    labels, found = np.empty(len(links), np.int64), 0
    for node in range(len(links)):
        root = root_of(links, node) >> 1
        if root == node:
            labels[node] = found
            found += 1
        else:
            labels[node] = labels[root]
    return labels, found
