"""Search for the closest point within a budget of steps.

If the budget ends the search, the result has a certified lower bound. See `traverse.best_first` for the order
in which nodes are opened.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.box import (
    MAX_BOUND,
    MAX_REST,
    SHRINK_FAR,
    point_boxes_distance_sq,
    wide_gaps_sq,
)
from proximity.kernels.geometry.frames import to_local
from proximity.kernels.layout import MOMENT_STRIDE, NODE_STRIDE
from proximity.kernels.point.walk import best_of_block, nearer_in_block, slot_distance_sq
from proximity.kernels.traverse.best_first import best_first
from proximity.kernels.traverse.ignored_parts import heed_some
from proximity.kernels.tree.normal_slab import SMALLEST_BOUND, slabs_distance_sq
from proximity.native import inlined
from proximity.native.simd import maximum, minimum, narrow, select, splat, splat32

NO_TOLERANCE = 0.0, 0.0
"""Tolerance of an exact search, see `_target_sq`."""
FAR_OUT = 2.0**40
"""Distance, in part sizes, from which on squares are computed in float64.

Below, rounding a coordinate beyond 2 to float32 changes a gap by at most 2^-23 of itself, which
`BOUND_SHRINK` covers. Up to 2, the padding of the boxes covers it.
"""
BOUND_SHRINK = 1.0 - 2.0**-19
"""Factor on a computed float32 bound. It covers twice the rounding of the bound."""
DOWN = 1.0 - 2.0**-50
"""Factor on a lower bound in float64. It covers a few roundings, such as those of a root and a division."""


@inlined
def _query_in(frames, parts, part, point):
    """Return a point of the scene in the frame of *part*.

    The result is x, y, z, the `factor_of` the part, and whether the point is far.
    """
    x, y, z = point
    px, py, pz = to_local(frames, parts, part, x, y, z)
    # NaN counts as near: float32 bounds then open no node.
    is_far = abs(px) > FAR_OUT or abs(py) > FAR_OUT or abs(pz) > FAR_OUT
    return px, py, pz, factor_of(frames, part), is_far


@inlined
def _bounds(words, base, query):
    """Return lower bounds (float32x8) of squared distances to a node's children, in the scene's scale.

    *query*: see `_query_in`. Unused lanes give inf, or NaN in a part that is too small for bounds.
    """
    px, py, pz, factor, is_far = query
    if is_far:
        wide = wide_gaps_sq(words, base, splat(px), splat(py), splat(pz))
        wide = wide * splat(SHRINK_FAR * BOUND_SHRINK * factor)
        wide = select(wide > splat(SMALLEST_BOUND), wide, splat(0.0))
        return narrow(select(wide < splat(np.inf), minimum(wide, splat(MAX_REST)), wide))
    x, y, z = splat32(np.float32(px)), splat32(np.float32(py)), splat32(np.float32(pz))
    shrunk = np.float32(BOUND_SHRINK * factor if factor > SMALLEST_BOUND else 0.0)
    return point_boxes_distance_sq(words, base, x, y, z) * splat32(shrunk)


@inlined
def _prune_bound(target_sq):
    """Return the float32 limit for bounds of subtrees to open. It is not below *target_sq*."""
    return min(np.float32(target_sq * (1.0 + 2.0**-22)), MAX_BOUND)


@inlined
def _target_sq(best, tolerance):
    """Return the squared distance at which the search ends. It is a little below the best one found.

    *tolerance*: permitted relative error of the distance, 0 for an exact search; and a length (scene's scaled
    frame) within which the search is exact.
    """
    best_sq, best_slot = best
    share, exact_within = tolerance
    target_sq = best_sq
    if share > 0.0 and best_slot >= 0:
        length = sqrt(best_sq)
        if length > exact_within:
            enough = length - share * (length - exact_within)
            target_sq = enough * enough * DOWN
    return target_sq


@inlined
def factor_of(frames, part):
    """Return the factor from squared local lengths of *part* to the scene's scale. It is a power of two."""
    ratio = frames[len(frames) - 1].scale / frames[part].scale
    return ratio * ratio


@inlined
def known_sq(model, part, slot, point):
    """Return the squared distance from a point in the scene's frame to one triangle, in the scene's scale."""
    reals, _, frames, parts = model
    px, py, pz = to_local(frames, parts, part, point[0], point[1], point[2])
    return slot_distance_sq(reals, slot, px, py, pz) * factor_of(frames, part)


@inlined
def best_known(model, part, slot, point):
    """Return the squared distance to the nearest triangle in the block of *slot*, and its slot.

    The distance is that of `known_sq`.
    """
    reals, _, frames, parts = model
    px, py, pz = to_local(frames, parts, part, point[0], point[1], point[2])
    best_sq, slot = best_of_block(reals, slot, px, py, pz)
    return best_sq * factor_of(frames, part), slot


@inlined
def _nearer_in_leaf(reals, reference, query, best):
    """Return the result of `nearer_in_block`, but with squared distances in the scene's scaled frame."""
    px, py, pz, factor, _ = query
    lanes = splat(px), splat(py), splat(pz)
    found_sq, slot = nearer_in_block(reals, ~reference, lanes, best[0] / factor, best[1])
    return found_sq * factor, slot


@inlined
def _bounds_with_slabs(words, parts, reference, query, above):
    """Return the tightest lower bounds of the squared distances to a node's children.

    They are the maximum of the box bounds (`_bounds`), the slab bounds, and the node's own bound *above*. The
    order of the operations keeps NaN and inf in unused lanes.
    """
    bounds = maximum(splat32(above), _bounds(words, NODE_STRIDE * reference, query))
    # Nodes of the trees over parts follow those of the parts, and have no slabs.
    scene = len(parts) - 1
    if reference < parts[scene - 1].root + parts[scene - 1].node_count:
        px, py, pz, factor, _ = query
        at = parts[scene].moments + MOMENT_STRIDE * reference
        bounds = maximum(slabs_distance_sq(words, at, splat(px), splat(py), splat(pz), factor), bounds)
    return bounds


_FUNCTIONS = _query_in, _bounds, _bounds_with_slabs, _nearer_in_leaf, _target_sq, _prune_bound
_walk, _walk_heeded = best_first(*_FUNCTIONS), best_first(*_FUNCTIONS, heed_some)


@inlined
def nearest_with_budget(model, start, part, point, best, tolerance, budget, workspace):
    """Find the surface of a subtree that is nearest to a point in the scene's frame, within *budget* steps.

    *point*: (x, y, z). *start*: first reference, in the frame of *part*, which is the scene's row for the
    tree over parts. *best*: initial squared distance (scene's scaled frame) and slot; farther triangles are
    pruned. *tolerance*: see `_target_sq`. Return the smallest squared distance found, its slot, a lower bound
    of the squared distance, and the number of steps. After a complete search, the lower bound is the distance
    found, or less by the tolerance.
    """
    (best_sq, slot), lower_sq, work = _walk(model, start, part, point, best, tolerance, budget, workspace)
    return best_sq, slot, lower_sq, work


@inlined
def nearest_of_heeded(model, start, part, point, best, tolerance, budget, workspace):
    """The same of a scene of which some parts are ignored."""
    (best_sq, slot), lower_sq, work = _walk_heeded(
        model, start, part, point, best, tolerance, budget, workspace
    )
    return best_sq, slot, lower_sq, work
