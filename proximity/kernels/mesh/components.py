"""Connected components by union and find, in which two nodes may run the same way or opposite ways.

A link of node n is twice the number of a node that it is connected with, and one more where the two run
opposite ways; a root links to itself. The root of a component is its lowest node.
"""

import numpy as np

from proximity.native import allocating_kernel, kernel


@allocating_kernel
def unlinked(count):
    """Return the links of nodes that are not connected, (count,) int64."""
    links = np.empty(count, np.int64)
    for node in range(count):
        links[node] = 2 * node
    return links


@kernel
def root_of(links, node):
    """Twice the root of a node, and one more where the node runs against it; paths there are halved."""
    at = 2 * node
    while links[at >> 1] != at & ~1:
        link = links[at >> 1]
        link = links[link >> 1] ^ (link & 1)
        links[at >> 1] = link
        at = link ^ (at & 1)
    return at


@kernel
def join(links, one, other, is_crossed):
    """Connect two nodes that run opposite ways if *is_crossed*, 0 or 1; False if they are known not to."""
    first, last = root_of(links, one), root_of(links, other) ^ is_crossed
    low, high = min(first >> 1, last >> 1), max(first >> 1, last >> 1)
    if low == high:
        return first == last
    links[high] = 2 * low + ((first ^ last) & 1)
    return True


@allocating_kernel
def component_labels(links):
    """Return the component of each node, (N,) int64, rising with its lowest node; and how many there are."""
    labels, found = np.empty(len(links), np.int64), 0
    for node in range(len(links)):
        root = root_of(links, node) >> 1
        if root == node:
            labels[node] = found
            found += 1
        else:
            labels[node] = labels[root]
    return labels, found
