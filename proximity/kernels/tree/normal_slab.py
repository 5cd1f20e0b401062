"""Normal slabs, which bound the faces of a node along their mean normal and are tight where boxes are not.

The box of a tilted or curved patch is nearer to a point than the patch, by about the size of the patch: from
the centre of a ball, all boxes appear too near. The slab between two planes perpendicular to the area normal
of the patch errs only by the sagitta of the patch, which decreases with the square of its size.

Each child has two numbers, the least and the largest scalar product of a corner with the area normal of the
child. They are in ``moments`` after those of `winding_number`. They need a second memory access per node, and
are read only by walks that take long.
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
"""Bound of the rounding of scalar products of local coordinates, relative to the length of the normal."""
SHRINK_SLAB = 1.0 - 2.0**-22
"""Factor that covers the rounding of a computed float32 bound."""
SMALLEST_BOUND = 2.0**-96
"""Smaller bounds count as 0. Denormal float32 numbers have few bits, and rounding may raise them."""


@entry("float32[:], float64[:], int, int, float32[:], int", makes_arrays=True)
def fill_slabs(words, reals, root, node_count, moments, moments_at):
    """Compute the slabs of a tree whose moments are known.

    The tree has *node_count* nodes from *root* on. *moments*, *moments_at*: the array of moments, and the
    offset in it of node 0. The number of a child is above its parent's; the leaves below a node are numbered
    consecutively.
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
    """Return the least and the largest scalar product of *n* with the corners of some blocks.

    *first*, *last*: the first and the last block.
    """
    x, y, z = splat(nx), splat(ny), splat(nz)
    least, largest = splat(np.inf), splat(-np.inf)
    for block in range(first, last + 1):
        for corner in range(3):
            along = dot(x, y, z, *load_points(reals, BLOCK_STRIDE * block + CORNER_STRIDE * corner))
            # An unused lane is NaN and fails both comparisons.
            least = select(along < least, along, least)
            largest = select(along > largest, along, largest)
    return horizontal_min(least), -horizontal_min(splat(0.0) - largest)


@inlined
def slabs_distance_sq(words, at, x, y, z, factor):
    """Return lower bounds (float32x8) of squared distances from a point to a node's children, times *factor*.

    *at*: the moments of the node. *x y z*: float64x8 splats of the point. A child without a mean normal gives
    0.
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
    # NaN from 0 / 0 fails the comparison as well.
    is_beyond = (gap > splat(0.0)) & (squares > splat(SMALLEST_BOUND))
    return narrow(minimum(select(is_beyond, squares, splat(0.0)), splat(3.3e38)))
