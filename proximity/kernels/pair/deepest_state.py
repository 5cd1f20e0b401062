"""State, distances to the outer part and box queries shared by both searches for the deepest point."""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.layout import CELL_CROSSED, CELL_INSIDE, NO_SLOT
from proximity.kernels.nodes import boxes_of, corners_at, offset_of
from proximity.kernels.pair.triangles import between
from proximity.kernels.point.walk import NOTHING_SEEN, closest_in_part, slot_distance_sq
from proximity.kernels.scene.inside.containment import state_in_part
from proximity.kernels.sign.side import signed_of_slot
from proximity.kernels.stack_arrays import stack_arrays_of
from proximity.native import inlined, record
from proximity.native.simd import select, splat32

CAPACITY = 512
"""Capacity for waiting pieces or boxes."""
WIDENING = np.float32(2.0**-20)
"""Padding of boxes, local units, for rounding to float32."""
DEEPEST_SEARCH = record(
    "DeepestSearch",
    best="f8",  # outer part's local frame, as all below: depth of the deepest point found
    position="(3,)f8",
    bound="f8",  # largest bound of resolved pieces and boxes
    steps="i8",
)
stack_search, _ = stack_arrays_of(DEEPEST_SEARCH)


@inlined
def nearest_outer(model, outer, p, known, workspace):
    """Return the distance to the outer surface and its nearest slot; *known*: a slot nearby, or none."""
    best_sq = np.inf
    if known != NO_SLOT:
        best_sq = slot_distance_sq(model.reals, known, *p)
    root = model.parts[outer].root
    found_sq, slot = closest_in_part(model, outer, root, p, best_sq, known, NOTHING_SEEN, workspace.stacks)
    return sqrt(found_sq), slot


@inlined
def contains(model, part, p, slot, workspace):
    """Test whether a part contains *p*, with known nearest triangle."""
    state = state_in_part(model, part, p)
    return (
        signed_of_slot(model, part, slot, p, workspace.closest[0]) < 0.0
        if state == CELL_CROSSED
        else state == CELL_INSIDE
    )


@inlined
def goal_of(state, limits):
    """Return the bound at which a piece is resolved; *limits*: relative and absolute (local) gap."""
    return state.best * (1.0 + limits[0]) + limits[1]


@inlined
def keep_deeper(state, depth, p):
    """Record a point inside both parts if it is the deepest so far."""
    state.steps += 1
    if depth > state.best:
        state.best = depth
        state.position[0], state.position[1], state.position[2] = p


@inlined
def _meets_box(words, base, box):
    """Return the mask of a node's children that meet a box: lower and upper corners, float32."""
    lower, upper = boxes_of(words, base)
    is_met = (lower[0] <= splat32(box[1][0])) & (upper[0] >= splat32(box[0][0]))
    is_met = is_met & (lower[1] <= splat32(box[1][1])) & (upper[1] >= splat32(box[0][1]))
    return is_met & (lower[2] <= splat32(box[1][2])) & (upper[2] >= splat32(box[0][2]))


@inlined
def open_meeting(words, base, query, reach):
    """Open the children of a node that meet the box of a query."""
    is_met = _meets_box(words, base, query[0])
    bounds = select(is_met, splat32(np.float32(0.0)), splat32(np.float32(np.inf)))
    return bounds, bounds, bounds <= splat32(reach)


@inlined
def widened_box(lower, upper, margin):
    """Return a box in float32, padded by a margin and for rounding."""
    return (
        (
            np.float32(lower[0] - margin) - WIDENING,
            np.float32(lower[1] - margin) - WIDENING,
            np.float32(lower[2] - margin) - WIDENING,
        ),
        (
            np.float32(upper[0] + margin) + WIDENING,
            np.float32(upper[1] + margin) + WIDENING,
            np.float32(upper[2] + margin) + WIDENING,
        ),
    )


@inlined
def distance_to_slot(reals, slot, p):
    """Return the distance to one triangle."""
    return sqrt(slot_distance_sq(reals, slot, *p))


@inlined
def normal_of_slot(reals, slot):
    """Return the unit normal of a triangle; 0 if it has no area."""
    a, b, c = corners_at(reals, offset_of(slot))
    x, y, z = cross(*between(a, b), *between(a, c))
    length = sqrt(dot(x, y, z, x, y, z))
    return (x / length, y / length, z / length) if length > 0.0 else (0.0, 0.0, 0.0)
