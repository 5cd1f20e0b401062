"""Bounds of the signed distance of one point of a scene, within a budget of steps.

With a sufficient budget both bounds are the signed distance of `point_queries`: the smallest over all parts;
inside, the part with the largest depth counts. Otherwise one bound is the nearest surface found, and
the other the smallest bound of the nodes not visited. The sign does not need the nearest face: it follows
from sign grid and winding number.
"""

from math import sqrt

import numpy as np

from proximity.kernels.contact_record import BOUNDED, EXACT, INSIDE, SIGNED
from proximity.kernels.geometry.closest_feature import (
    closest_on_edges,
    over_face,
    read_corners,
)
from proximity.kernels.geometry.frames import ignores_some, is_alone, part_of_slot, to_local
from proximity.kernels.layout import (
    CELL_CROSSED,
    CELL_INSIDE,
    CELL_OUTSIDE,
    NO_GRID,
    NO_PART,
    NO_SLOT,
    SIGN_NONE,
    SIGN_WINDING,
)
from proximity.kernels.point.budgeted_walk import (
    DOWN,
    NO_TOLERANCE,
    known_sq,
    nearest_of_heeded,
    nearest_with_budget,
)
from proximity.kernels.scene.inside.containment import state_in_part
from proximity.kernels.scene.inside.part_grid import containing_bits, lowest_part, sought, turns_of
from proximity.kernels.sign.side import closest_of_slot, is_inside_by_winding, signed_of_slot
from proximity.native import inlined, kernel

MIN_DEPTH_STEPS = 8
"""Minimum for each further part that may contain the point, once the budget is used up."""
SPARE_DEPTH_STEPS = 64
"""Limit for all of them together. Beyond it, the depth in parts that certainly contain the point is bounded
by their boxes."""


@inlined
def nearest_from_face(model, point, part, slot, limit_sq, tolerance, budget, workspace):
    """Apply `nearest_with_budget` to the whole scene, from a known face, if any; return also the part.

    *model*: its four arrays; *point*: (x, y, z). *limit_sq*, and the length in *tolerance*: in the scene's
    scaled frame; surfaces beyond the limit are not visited.
    """
    _, words, _, parts = model
    best_sq = limit_sq
    if slot >= 0:
        slot_sq = known_sq(model, part, slot, point)
        if slot_sq <= limit_sq:
            best_sq = slot_sq
        else:
            slot = np.int64(NO_SLOT)
    walk_row = np.int64(0) if is_alone(parts) else len(parts) - 1
    start, best = parts[walk_row].root, (best_sq, slot)
    if ignores_some(parts):
        best_sq, slot, lower_sq, work = nearest_of_heeded(
            model, start, walk_row, point, best, tolerance, budget, workspace
        )
    else:
        best_sq, slot, lower_sq, work = nearest_with_budget(
            model, start, walk_row, point, best, tolerance, budget, workspace
        )
    if slot >= 0:
        part = part_of_slot(words, parts, slot)
    return best_sq, part, slot, lower_sq, work


@inlined
def beyond_all(frames, x, y, z):
    """Return a distance, m, within which there is a face: that of the scene box's farthest corner."""
    scene = len(frames) - 1
    total = 0.0
    for axis in range(3):
        value = x if axis == 0 else (y if axis == 1 else z)
        gap = max(abs(value - frames[scene].box_lower[axis]), abs(frames[scene].box_upper[axis] - value))
        total += gap * gap
    return sqrt(total) * (1.0 + 1e-12)


@inlined
def fill_closest(model, part, slot, point, closest):
    """Fill *closest* (local frame of *part*) with the closest point of a triangle; return its distance, m.

    Fills the same as `closest_on_triangle` except the weights; the point is as exact as the query position.
    """
    px, py, pz = to_local(model.frames, model.parts, part, point[0], point[1], point[2])
    read_corners(model.reals, slot, closest)
    is_over, height = over_face(closest, px, py, pz)
    if is_over:
        closest.length = abs(height)
        for axis in range(3):
            closest.arm[axis] = closest.normal[axis] * height
    else:
        closest_on_edges(px, py, pz, closest)
    arm, point = closest.arm, closest.point
    point[0], point[1], point[2] = px - arm[0], py - arm[1], pz - arm[2]
    return closest.length / model.frames[part].scale


@inlined
def _depth_in_box(frames, part, x, y, z, is_open):
    """Return the largest depth, m, of a contained point: the distance to the nearest side of the part's box.

    For an open part it is that to the farthest corner: a path through a hole leaves the box without a face.
    """
    nearest, total = np.inf, 0.0
    for axis in range(3):
        value = x if axis == 0 else (y if axis == 1 else z)
        lower, upper = frames[part].box_lower[axis], frames[part].box_upper[axis]
        rounding = 1e-15 * (abs(lower) + abs(upper) + abs(value))
        above, below = abs(upper - value) + rounding, abs(value - lower) + rounding
        nearest = min(nearest, above, below)
        total += max(above, below) ** 2
    return (sqrt(total) if is_open else nearest) * (1.0 + 1e-12)


@kernel
def _depth_in(model, other, point, budget, workspace, closest):
    """Test whether *other* contains a point; return also bounds of its depth, m, slot and steps.

    *budget*: 0 to visit faces only if containment needs them.
    """
    _, _, frames, parts = model
    x, y, z = point
    p = to_local(frames, parts, other, x, y, z)
    state = state_in_part(model, other, p)
    if state == CELL_OUTSIDE:
        return False, 0.0, 0.0, np.int64(NO_SLOT), np.int64(0)
    if state == CELL_INSIDE:
        if budget == 0:
            most = _depth_in_box(frames, other, x, y, z, parts[other].grid == NO_GRID)
            return True, 0.0, most, np.int64(NO_SLOT), np.int64(1)
    else:
        budget = max(budget, MIN_DEPTH_STEPS)
    best_sq, slot, lower_sq, work = nearest_with_budget(
        model, parts[other].root, other, point, (np.inf, np.int64(NO_SLOT)), NO_TOLERANCE, budget, workspace
    )
    is_exact = lower_sq >= best_sq
    is_inside = True
    if state == CELL_CROSSED:
        if is_exact:
            is_inside = signed_of_slot(model, other, slot, p, closest) < 0.0
        else:
            is_inside, steps = is_inside_by_winding(model, other, p)
            work += steps
    scale = frames[len(parts) - 1].scale
    upper = sqrt(best_sq) / scale
    lower = upper if is_exact else sqrt(lower_sq) / scale * DOWN
    if slot == NO_SLOT:
        upper = beyond_all(frames, x, y, z)
    return is_inside, lower, upper, slot, work


@kernel
def is_in_box_with_holes(model, point):
    """Test whether a point is in the box of a part with holes, where the sign may change without a face."""
    search = sought(model, point)
    for turn in range(turns_of(model.parts, search)):
        containing, at = containing_bits(model, search, turn, point)
        while containing:
            part = lowest_part(model, at, containing)
            containing &= containing - 1
            if model.parts[part].sign == SIGN_WINDING and model.parts[part].grid == NO_GRID:
                return True
    return False


@kernel
def may_pass_hole(frames, parts, x, y, z, reach):
    """Test whether the box of a part with holes is within *reach* of a point."""
    for part in range(len(parts) - 1):
        if parts[part].sign != SIGN_WINDING or parts[part].grid != NO_GRID or parts[part].is_hidden:
            continue
        is_near = True
        for axis in range(3):
            value = x if axis == 0 else (y if axis == 1 else z)
            gap = max(frames[part].box_lower[axis] - value, value - frames[part].box_upper[axis])
            is_near &= not gap > reach
        if is_near:
            return True
    return False


@kernel
def _deepest_containing(model, point, part, slot, nearest, work, budget, workspace, closest):
    """Return bounds of a point's depth, m: lower, upper by faces, and upper; -1 if not inside.

    *part*, *slot*, *nearest*: of the nearest face, as in `bounds_of_nearest`: whether it is
    exact, lower and upper bound of its distance, and `clear`. Returns also the part with the largest depth,
    the slot of its face, and the total steps.
    """
    _, _, frames, parts = model
    x, y, z = point
    is_exact, lower, upper, clear = nearest
    depth_lower, depth_upper, depth_by_box = -1.0, -1.0, -1.0
    enough = max(budget, work) + SPARE_DEPTH_STEPS
    deep_part, deep_slot = np.int64(NO_PART), np.int64(NO_SLOT)
    search = sought(model, point)
    for turn in range(turns_of(model.parts, search)):
        containing, at = containing_bits(model, search, turn, point)
        while containing:
            other = lowest_part(model, at, containing)
            containing &= containing - 1
            if parts[other].sign == SIGN_NONE:
                continue
            if other == part and is_exact and slot >= 0:
                p = to_local(frames, parts, part, x, y, z)
                _, _, is_inside = closest_of_slot(model, part, slot, p, closest)
                least, most, found = lower, upper, slot
            else:
                left = max(budget - work, MIN_DEPTH_STEPS) if work < enough else 0
                is_inside, least, most, found, steps = _depth_in(
                    model, other, point, left, workspace, closest
                )
                work += steps
                # The bounds over all surfaces also hold for this part, as does its known face; they may
                # differ by rounding, since the traversal used another frame.
                if other == part and slot >= 0 and upper < most:
                    most, found = upper, slot
                least = min(max(least, clear), most)
            if is_inside:
                depth_lower = max(depth_lower, least)
                if found == NO_SLOT:
                    depth_by_box = max(depth_by_box, most)
                    deep_part = other if deep_part == NO_PART else deep_part
                elif most > depth_upper:
                    depth_upper, deep_part, deep_slot = most, other, found
    return depth_lower, depth_upper, max(depth_upper, depth_by_box), deep_part, deep_slot, work


@inlined
def bounds_at(model, point, part, slot, is_outside, tolerance, exact_within, budget, workspace, closest):
    """Return bounds of the signed distance of a point of the scene's frame, m.

    *model*: its four arrays; *point*: (x, y, z). *part*, *slot*: a face to start from, or `NO_SLOT`.
    *is_outside*: True if it is known that no part contains the point. *tolerance*, *exact_within* (m): see
    `budgeted_walk`; only used if *is_outside*, other points are searched exactly within the budget. Returns
    the same as `bounds_of_nearest`.
    """
    _, _, frames, parts = model
    accuracy = tolerance if is_outside else 0.0, exact_within * frames[len(parts) - 1].scale
    nearest = nearest_from_face(model, point, part, slot, np.inf, accuracy, budget, workspace)
    return bounds_of_nearest(model, point, nearest, is_outside, budget, workspace, closest)


@inlined
def bounds_of_nearest(model, point, nearest, is_outside, budget, workspace, closest):
    """Return bounds of the signed distance, m, given the result *nearest* of `nearest_from_face`.

    Returns distance, lower and upper bound, a radius without any surface, part and slot of the
    reported face, bits (EXACT or BOUNDED, SIGNED, INSIDE), and the steps taken.
    """
    _, _, frames, parts = model
    x, y, z = point
    best_sq, part, slot, lower_sq, work = nearest
    scene = len(parts) - 1
    scale = frames[scene].scale
    is_exact = lower_sq >= best_sq
    upper = sqrt(best_sq) / scale
    if slot >= 0:
        careful = fill_closest(model, part, slot, point, closest)
        upper = careful if is_exact else max(careful, upper)
    elif not is_exact:
        upper = beyond_all(frames, x, y, z)
    lower = upper if is_exact else min(sqrt(lower_sq) / scale * DOWN, upper)
    clear = min(lower, sqrt(lower_sq) / scale) * DOWN

    depth_lower, depth_upper, depth_most = -1.0, -1.0, -1.0
    deep_part, deep_slot = np.int64(NO_PART), np.int64(NO_SLOT)
    if not is_outside:
        depth_lower, depth_upper, depth_most, deep_part, deep_slot, work = _deepest_containing(
            model, point, part, slot, (is_exact, lower, upper, clear), work, budget, workspace, closest
        )
        # The search in other parts has overwritten *closest*.
        if slot >= 0 and depth_lower < 0.0:
            fill_closest(model, part, slot, point, closest)
    bits = 0
    if depth_lower >= 0.0:
        part, slot = deep_part, deep_slot
        lower, upper = -depth_most, -depth_lower
        bits = SIGNED | INSIDE
        distance = lower
        if slot >= 0:
            fill_closest(model, part, slot, point, closest)
            distance = -depth_upper
    else:
        distance = upper
        if slot >= 0 and parts[part].sign != SIGN_NONE:
            bits = SIGNED
    bits |= EXACT if lower == upper else BOUNDED
    return distance, lower, upper, clear, part, slot, bits, work
