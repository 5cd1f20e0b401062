"""Accessors of nodes and blocks; `layout` describes their format.

*base*: offset of a node in ``words``, or of a block in ``reals``. *position*: offset of one child of a node,
``base + lane``, or of one triangle of a block. Vectors have eight lanes.
"""

from proximity.kernels.layout import (
    BLOCK_STRIDE,
    CORNER_STRIDE,
    LANES,
    NODE_CHILDREN,
    NODE_STRIDE,
    NODE_UPPER,
)
from proximity.native import inlined
from proximity.native.simd import load, load_int, prefetch, store, widen


@inlined
def load_points(numbers, base):
    """Load x, y and z of eight points, stored consecutively from *base* on."""
    return load(numbers, base), load(numbers, base + LANES), load(numbers, base + 2 * LANES)


@inlined
def store_points(numbers, base, x, y, z):
    """Store x, y and z of eight points in the order of `load_points`."""
    store(numbers, base, x)
    store(numbers, base + LANES, y)
    store(numbers, base + 2 * LANES, z)


@inlined
def boxes_of(words, base):
    """Load the lower and upper corners, (x, y, z) each, of the eight boxes of a node."""
    return load_points(words, base), load_points(words, base + NODE_UPPER)


@inlined
def wide_boxes_of(words, base):
    """Load the eight boxes of a node as float64."""
    (lx, ly, lz), (ux, uy, uz) = boxes_of(words, base)
    return (widen(lx), widen(ly), widen(lz)), (widen(ux), widen(uy), widen(uz))


@inlined
def lower_along(words, base, axis):
    """Load the lower bounds of the eight boxes of a node along an axis."""
    return load(words, base + LANES * axis)


@inlined
def upper_along(words, base, axis):
    """Load the upper bounds of the eight boxes of a node along an axis."""
    return load(words, base + NODE_UPPER + LANES * axis)


@inlined
def used_lanes(words, base):
    """Return the mask of the lanes of a node that have children."""
    return load(words, base) <= load(words, base + NODE_UPPER)


@inlined
def children_of(words, base):
    """Load the child references of a node: int32 bits."""
    return load(words, base + NODE_CHILDREN)


@inlined
def is_used(words, position):
    """Test whether there is a child at a position."""
    return words[position] <= words[position + NODE_UPPER]


@inlined
def lower_at(words, position, axis):
    """Return the lower bound of one child's box along an axis."""
    return words[position + LANES * axis]


@inlined
def upper_at(words, position, axis):
    """Return the upper bound of one child's box along an axis."""
    return words[position + NODE_UPPER + LANES * axis]


@inlined
def child_at(words, position):
    """Return the reference of one child."""
    return load_int(words, position + NODE_CHILDREN)


@inlined
def offset_of(slot):
    """Return the offset in ``reals`` of the triangle at a slot."""
    return BLOCK_STRIDE * (slot // LANES) + slot % LANES


@inlined
def corner_at(reals, position, k):
    """Return corner *k* of one triangle, (x, y, z)."""
    at = position + CORNER_STRIDE * k
    return reals[at], reals[at + LANES], reals[at + 2 * LANES]


@inlined
def corners_at(reals, position):
    """Return the three corners of one triangle, (x, y, z) each."""
    return corner_at(reals, position, 0), corner_at(reals, position, 1), corner_at(reals, position, 2)


@inlined
def turned_corners_of_block(reals, base, i, j, k):
    """Load the corners of the eight triangles of a block, with axes in the order *i*, *j*, *k*."""
    x, y, z = base + LANES * i, base + LANES * j, base + LANES * k
    b, c = CORNER_STRIDE, 2 * CORNER_STRIDE
    return (
        (load(reals, x), load(reals, y), load(reals, z)),
        (load(reals, x + b), load(reals, y + b), load(reals, z + b)),
        (load(reals, x + c), load(reals, y + c), load(reals, z + c)),
    )


@inlined
def fetch_node(words, base):
    """Prefetch a node."""
    for line in range(0, NODE_STRIDE, 2 * LANES):
        prefetch(words, base + line)


@inlined
def fetch_block(reals, base):
    """Prefetch a block."""
    for line in range(0, BLOCK_STRIDE, LANES):
        prefetch(reals, base + line)


@inlined
def corners_of_block(reals, base):
    """Load the corners of the eight triangles of a block, (x, y, z) each."""
    return (
        load_points(reals, base),
        load_points(reals, base + CORNER_STRIDE),
        load_points(reals, base + 2 * CORNER_STRIDE),
    )
