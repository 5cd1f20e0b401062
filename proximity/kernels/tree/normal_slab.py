"""Normal slabs: bounds of a node's faces along their mean normal, tight where boxes are not.

A box around a tilted or curved patch is nearer to a point than the patch, by about the patch's size: from the
centre of a ball all boxes look too near. The slab between two planes across the patch's area normal misses by
the patch's sagitta only, which falls with the square of its size.

The two numbers of each child, the least and the largest scalar product of a corner with the child's area
normal, lie in ``moments`` behind those of `winding_number`. They take a second memory access a node, and are
read only by walks that do not find an end.
"""

import numpy as np

from proximity.kernels.geometry.box import round_down, round_up
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    CORNER_STRIDE,
    LANES,
    MOMENT_AREA_NORMAL,
    MOMENT_SLAB_LARGEST,
    MOMENT_SLAB_LEAST,
    MOMENT_STRIDE,
    NODE_STRIDE,
)
from proximity.kernels.nodes import child_at, corner_at, is_used, load_points
from proximity.native import entry, inlined, kernel
from proximity.native.simd import (
    horizontal_min,
    load,
    maximum,
    minimum,
    narrow,
    select,
    splat,
    widen,
)

SLAB_ROUNDING = 1e-12
"""Rounding of scalar products of local coordinates, at most, in lengths of the normal."""
SHRINK_SLAB = 1.0 - 2.0**-22
"""Makes up for what is rounded in computing a float32 bound."""
SMALLEST_BOUND = 2.0**-96
"""A bound below it counts as 0: the smallest float32 numbers have few bits, and rounding may raise them."""


@entry("float32[:], float64[:], int, int, float32[:], int", makes_arrays=True)
def fill_slabs(words, reals, root, node_count, moments, moments_at):
    """Fill the slabs of a tree of *node_count* nodes from *root* on; its moments are there.

    *moments*, *moments_at*: the array that has the moments, and where those of node 0 are or would be. A
    child's number is above its parent's; the leaves below a node have numbers in a row.
    """
    ends = np.empty((node_count, 2), np.int64)
    for node in range(root + node_count - 1, root - 1, -1):
        base, at, own = NODE_STRIDE * node, moments_at + MOMENT_STRIDE * node, node - root
        ends[own, 0], ends[own, 1] = np.int64(2**62), np.int64(-1)
        for k in range(LANES):
            moments[at + MOMENT_SLAB_LEAST + k], moments[at + MOMENT_SLAB_LARGEST + k] = 0.0, 0.0
            if not is_used(words, base + k):
                continue
            child = child_at(words, base + k)
            first = ends[child - root, 0] if child >= 0 else ~child
            last = ends[child - root, 1] if child >= 0 else ~child
            ends[own, 0], ends[own, 1] = min(ends[own, 0], first), max(ends[own, 1], last)
            nx, ny, nz = corner_at(moments, at + MOMENT_AREA_NORMAL + k, 0)
            nx, ny, nz = np.float64(nx), np.float64(ny), np.float64(nz)
            least, largest = _extent(reals, first, last, nx, ny, nz)
            slack = SLAB_ROUNDING * (abs(nx) + abs(ny) + abs(nz))
            moments[at + MOMENT_SLAB_LEAST + k] = round_down(least - slack)
            moments[at + MOMENT_SLAB_LARGEST + k] = round_up(largest + slack)


@kernel
def _extent(reals, first, last, nx, ny, nz):
    """Least and largest scalar product of *n* with a corner in the blocks from *first* to *last*."""
    x, y, z = splat(nx), splat(ny), splat(nz)
    least, largest = splat(np.inf), splat(-np.inf)
    for block in range(first, last + 1):
        for corner in range(3):
            along = dot(x, y, z, *load_points(reals, BLOCK_STRIDE * block + CORNER_STRIDE * corner))
            # An unused lane is NaN, which neither comparison lets in.
            least = select(along < least, along, least)
            largest = select(along > largest, along, largest)
    return horizontal_min(least), -horizontal_min(splat(0.0) - largest)


@inlined
def slabs_distance_sq(words, at, x, y, z, factor):
    """Squared distances (float32x8), times *factor*, below which nothing in the children of a node lies.

    *at*: the node's moments. *x y z*: float64x8 splats of the point. A child without a mean normal gives 0.
    """
    nx, ny, nz = load_points(words, at + MOMENT_AREA_NORMAL)
    nx, ny, nz = widen(nx), widen(ny), widen(nz)
    along = dot(nx, ny, nz, x, y, z)
    gap = maximum(
        widen(load(words, at + MOMENT_SLAB_LEAST)) - along,
        along - widen(load(words, at + MOMENT_SLAB_LARGEST)),
    )
    normal_sq = dot(nx, ny, nz, nx, ny, nz)
    squares = gap * gap / normal_sq * splat(SHRINK_SLAB * factor)
    # NaN, as of 0 / 0, fails the comparison as well.
    is_beyond = (gap > splat(0.0)) & (squares > splat(SMALLEST_BOUND))
    return narrow(minimum(select(is_beyond, squares, splat(0.0)), splat(3.3e38)))
