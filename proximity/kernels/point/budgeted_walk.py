"""The closest-point walk within a budget of steps, with a certified lower bound when it is spent.

It starts depth first, like the walk without a budget, which is the shortest search in most cases. A walk
that has not ended after an eighth of its budget, or a few steps, has met one of the points where any exact
search opens everything (the centre of a ball): from there on it opens, sweep by sweep, what has the smallest
bounds, and follows one of them down to a leaf, so that the gap between the bounds closes from both sides.

What waits is kept in *workspace* (float32): three planes of `MOST_WAITING` numbers: a squared distance below
which nothing in the subtree lies, in the scene's scaled frame whatever the subtree's own; its reference
(int32 bits); and the part in whose frame it is, or the scene's row.

Tried and dropped (2026-11): see the figures beside `SWEEP_SHARE`.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.box import LARGEST_BOUND, LARGEST_REST, SHRINK_FAR, point_boxes_distance_sq
from proximity.kernels.geometry.frames import (
    to_local,
)
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    ENTRY,
    FRAME_SCALE,
    LANES,
    NODE_CHILDREN,
    NODE_STRIDE,
    PART_IS_FUSED,
    PART_MOMENTS,
    PART_NODE_COUNT,
    PART_ROOT,
    SCENE_ENTRIES,
    STACK_SIZE,
)
from proximity.kernels.point.walk import best_of_block, slot_distance_sq
from proximity.kernels.sign.winding_number import MOMENT_STRIDE
from proximity.kernels.tree.normal_slab import SMALLEST_BOUND, slabs_distance_sq
from proximity.kernels.tree.traversal import nearer_in_block
from proximity.native import inlined, kernel
from proximity.native.simd import (
    bits,
    compress,
    count_bits,
    fma,
    horizontal_min,
    load,
    load_int,
    lowest_lane,
    maximum,
    minimum,
    narrow,
    prefetch,
    select,
    splat,
    splat32,
    store,
    trailing_zeros,
    widen,
)

MOST_SWEPT_STEPS = 4096
"""Steps of a budget that are taken in sweeps at most; the rest goes depth first."""
MOST_WAITING = 4 * STACK_SIZE + (LANES - 1) * MOST_SWEPT_STEPS + 4 * LANES
WORKSPACE_SIZE = 3 * MOST_WAITING
DEEP_DIVISOR = 8
"""Share of a budget, as a divisor, that goes depth first."""
FEWEST_DEEP_STEPS = 16
"""Steps that go depth first at least, of budgets of twice as many: mostly that is all it takes. Looking ahead
with 40 steps, ticks are some 10 % shorter at p99 than with an eighth of them, contacts reported as early."""
SWEEP_SHARE = 0.08
"""Share of the gap between the bounds that one sweep closes; more where that would open few. At the centre of
a ball of 82 k faces 800 steps leave bounds 0.4 % apart with 0.02 to 0.3 (0.02 takes a fifth longer), 0.8 %
with 1, and 100 % depth first."""
SWEEP_RATIO = 16
"""A sweep looks through all that waits, so it should open at least one in so many."""
FAR_OUT = 2.0**40
"""Part sizes from which on squares are taken in float64. Up to there a coordinate beyond 2 that is rounded to
float32 puts a gap off by 2^-23 of itself at most: `BOUND_SHRINK` makes up for it; up to 2 the boxes do."""
BOUND_SHRINK = 1.0 - 2.0**-19
"""Factor on a computed float32 bound: makes up for its roundings, twice over."""
DOWN = 1.0 - 2.0**-50
"""Factor on a lower bound in float64: makes up for a few roundings, as of a root and a division."""


@inlined
def _query_in(frames, parts, part, point):
    """A point of the scene's frame as seen from *part*: x, y, z, `factor_of`, and whether it is far out."""
    x, y, z = point
    px, py, pz = to_local(frames, parts, part, x, y, z)
    # Not far where it is NaN: nothing is opened then, in float32.
    is_far = abs(px) > FAR_OUT or abs(py) > FAR_OUT or abs(pz) > FAR_OUT
    return px, py, pz, factor_of(frames, part), is_far


@inlined
def _bounds(words, base, query):
    """Squared distances (float32x8) below which nothing in the children of a node lies, in the scene's scale.

    *query*: see `_query_in`. Unused lanes give inf, or NaN in a part that is too small for bounds.
    """
    px, py, pz, factor, is_far = query
    if is_far:
        wide_x, wide_y, wide_z = splat(px), splat(py), splat(pz)
        zero = splat(0.0)
        gap_x = maximum(
            maximum(widen(load(words, base)) - wide_x, wide_x - widen(load(words, base + 24))), zero
        )
        gap_y = maximum(
            maximum(widen(load(words, base + 8)) - wide_y, wide_y - widen(load(words, base + 32))), zero
        )
        gap_z = maximum(
            maximum(widen(load(words, base + 16)) - wide_z, wide_z - widen(load(words, base + 40))), zero
        )
        wide = fma(gap_x, gap_x, fma(gap_y, gap_y, gap_z * gap_z)) * splat(SHRINK_FAR * BOUND_SHRINK * factor)
        wide = select(wide > splat(SMALLEST_BOUND), wide, zero)
        return narrow(select(wide < splat(np.inf), minimum(wide, splat(LARGEST_REST)), wide))
    x, y, z = splat32(np.float32(px)), splat32(np.float32(py)), splat32(np.float32(pz))
    shrunk = np.float32(BOUND_SHRINK * factor if factor > SMALLEST_BOUND else 0.0)
    return point_boxes_distance_sq(words, base, x, y, z) * splat32(shrunk)


@inlined
def open_up_to(best_sq):
    """The float32 number, at or above *best_sq*, up to which a bound may hide something nearer."""
    return min(np.float32(best_sq * (1.0 + 2.0**-22)), LARGEST_BOUND)


@inlined
def near_enough_sq(best_sq, best_slot, tolerance, exact_within):
    """The squared distance from which on nothing more is looked for: a little below the best found.

    *tolerance*: the share of the distance beyond *exact_within* that may be missed; 0 for an exact search.
    """
    enough_sq = best_sq
    if tolerance > 0.0 and best_slot >= 0:
        best = sqrt(best_sq)
        if best > exact_within:
            enough = best - tolerance * (best - exact_within)
            enough_sq = enough * enough * DOWN
    return enough_sq


@inlined
def factor_of(frames, part):
    """Factor from squared local lengths of *part* to the scene's scale: a power of two."""
    ratio = frames[len(frames) - 1, FRAME_SCALE] / frames[part, FRAME_SCALE]
    return ratio * ratio


@inlined
def known_sq(reals, frames, parts, part, slot, x, y, z):
    """Squared distance from a point of the scene's frame to one triangle, in the scene's scaled frame."""
    px, py, pz = to_local(frames, parts, part, x, y, z)
    return slot_distance_sq(reals, slot, px, py, pz) * factor_of(frames, part)


@inlined
def best_known(reals, frames, parts, part, slot, x, y, z):
    """The same to the nearest triangle of the block that *slot* is in; and its slot."""
    px, py, pz = to_local(frames, parts, part, x, y, z)
    best_sq, slot = best_of_block(reals, slot, px, py, pz)
    return best_sq * factor_of(frames, part), slot


@inlined
def _step_into(words, parts, reference, part):
    """The subtree that an entry of the tree over parts stands for, and the row in whose frame it is."""
    entry = parts[len(parts) - 1, SCENE_ENTRIES] + 2 * (~reference - ENTRY)
    owner = np.int64(load_int(words, entry))
    return np.int64(load_int(words, entry + 1)), part if parts[owner, PART_IS_FUSED] else owner


@inlined
def _wait(workspace, at, bounds, references, part, which):
    """Leave subtrees waiting, those of eight that *which* says; the position behind them."""
    store(workspace, at, compress(bounds, which))
    store(workspace, at + MOST_WAITING, compress(references, which))
    store(workspace, at + 2 * MOST_WAITING, splat32(np.float32(part)))
    return at + count_bits(bits(which))


@inlined
def _nearer_in_leaf(reals, reference, query, best_sq, best_slot):
    """`nearer_in_block`, of squared distances in the scene's scaled frame."""
    px, py, pz, factor, _ = query
    lanes = splat(px), splat(py), splat(pz)
    found_sq, best_slot = nearer_in_block(reals, ~reference, lanes, best_sq / factor, best_slot)
    return found_sq * factor, best_slot


@inlined
def nearest_with_budget(
    model, start, part, point, best_sq, best_slot, tolerance, exact_within, budget, workspace
):
    """The nearest surface of a subtree to a point of the scene's frame, as far as *budget* steps tell.

    *model*: its four arrays; *point*: (x, y, z). *start*: the reference to walk from, in the frame of *part*
    (the scene's row for the tree over parts). *best_sq* (scene's scaled frame) and *best_slot*: what is known
    already; nothing farther is looked at. *tolerance*, *exact_within* (scaled as well): see
    `near_enough_sq`. A step is a node or a leaf. Returns the smallest squared distance found, its slot, the
    squared distance below which nothing lies (where the search has ended, that of the best, or with a
    tolerance what is near enough to it), and the steps taken.
    """
    reals, words, frames, parts = model
    query = _query_in(frames, parts, part, point)
    best32 = open_up_to(near_enough_sq(best_sq, best_slot, tolerance, exact_within))
    deep_end = max(
        budget // DEEP_DIVISOR,
        FEWEST_DEEP_STEPS if budget >= 2 * FEWEST_DEEP_STEPS else 0,
        budget - MOST_SWEPT_STEPS,
    )
    work = 0
    at = 0
    reference = start
    while True:
        work += 1
        if reference >= 0:
            base = NODE_STRIDE * reference
            bounds = _bounds(words, base, query)
            is_open = bounds <= splat32(best32)
            if bits(is_open):
                nearest, it = lowest_lane(bounds)
                left = is_open
                if work < deep_end:
                    left = is_open & ~it
                at = _wait(workspace, at, bounds, load(words, base + NODE_CHILDREN), part, left)
                if work < deep_end:
                    reference = load_int(words, base + NODE_CHILDREN + nearest)
                    continue
        elif ~reference < ENTRY:
            best_sq, best_slot = _nearer_in_leaf(reals, reference, query, best_sq, best_slot)
            best32 = open_up_to(near_enough_sq(best_sq, best_slot, tolerance, exact_within))
        else:
            work -= 1
            reference, owner = _step_into(words, parts, reference, part)
            if owner != part:
                part = owner
                query = _query_in(frames, parts, part, point)
            continue
        if work >= deep_end:
            return _sweep(
                model, point, best_sq, best_slot, tolerance, exact_within, at, work, budget, workspace
            )
        while at > 0:
            at -= 1
            if workspace[at] <= best32:
                break
        else:
            return best_sq, best_slot, near_enough_sq(best_sq, best_slot, tolerance, exact_within), work
        reference = load_int(workspace, at + MOST_WAITING)
        if np.int64(workspace[at + 2 * MOST_WAITING]) != part:
            part = np.int64(workspace[at + 2 * MOST_WAITING])
            query = _query_in(frames, parts, part, point)


@inlined
def _keep_open(workspace, count, best32):
    """Drop what waits beyond *best32*; return how many are left, and the smallest bound of them."""
    store(workspace, count, splat32(np.float32(np.inf)))
    smallest = splat32(np.float32(np.inf))
    kept = 0
    for i in range(0, count, LANES):
        bounds, references, tags = (
            load(workspace, i),
            load(workspace, i + MOST_WAITING),
            load(workspace, i + 2 * MOST_WAITING),
        )
        is_open = bounds <= splat32(best32)
        store(workspace, kept, compress(bounds, is_open))
        store(workspace, kept + MOST_WAITING, compress(references, is_open))
        store(workspace, kept + 2 * MOST_WAITING, compress(tags, is_open))
        kept += count_bits(bits(is_open))
        smallest = minimum(smallest, bounds)
    return kept, horizontal_min(smallest)


@inlined
def _fetch(reals, words, reference):
    """Have a node or a leaf brought from memory, while something else is done."""
    if reference >= 0:
        for line in range(4):
            prefetch(words, NODE_STRIDE * reference + 16 * line)
    elif ~reference < ENTRY:
        for line in range(9):
            prefetch(reals, BLOCK_STRIDE * ~reference + 8 * line)


@inlined
def _nearest_waiting(workspace, first, end):
    """Position of the smallest bound among the subtrees that wait from *first* up to *end*."""
    nearest = first
    for k in range(first + 1, end):
        if workspace[k] < workspace[nearest]:
            nearest = np.int64(k)
    return nearest


@inlined
def _bounds_with_slabs(words, parts, reference, query, above):
    """`_bounds` of the node *reference*, or *above*, what is known of all of it, or by slabs: the greatest.

    In this order unused lanes stay NaN or inf.
    """
    bounds = maximum(splat32(above), _bounds(words, NODE_STRIDE * reference, query))
    # Nodes of the trees over parts come after those of the parts, and have no slabs.
    scene = len(parts) - 1
    if reference < parts[scene - 1, PART_ROOT] + parts[scene - 1, PART_NODE_COUNT]:
        px, py, pz, factor, _ = query
        at = parts[scene, PART_MOMENTS] + MOMENT_STRIDE * reference
        bounds = maximum(slabs_distance_sq(words, at, splat(px), splat(py), splat(pz), factor), bounds)
    return bounds


@kernel
def _sweep(model, point, best_sq, best_slot, tolerance, exact_within, count, work, budget, workspace):
    """Go on from what waits: *count* subtrees in *workspace*."""
    reals, words, frames, parts = model
    part = np.int64(-1)
    query = 0.0, 0.0, 0.0, 1.0, False
    share = SWEEP_SHARE
    while True:
        enough_sq = near_enough_sq(best_sq, best_slot, tolerance, exact_within)
        best32 = open_up_to(enough_sq)
        count, lowest = _keep_open(workspace, count, best32)
        lower_sq = min(np.float64(lowest), enough_sq)
        if count == 0:
            return best_sq, best_slot, enough_sq, work
        if work >= budget or count + LANES > MOST_WAITING - 2 * LANES:
            return best_sq, best_slot, lower_sq, work
        gap = min(best_sq, 4.0 * lower_sq + 1.0) - lower_sq
        threshold = max(np.float32(lower_sq + share * gap), lowest)
        end, before = count, work
        # The first that is opened is followed down to a leaf: that brings the other bound down.
        follows, following = True, np.int64(-1)
        for first in range(0, end, LANES):
            if first + LANES > end:
                # Children that were appended in this sweep wait for the next.
                chosen = bits(load(workspace, first) <= splat32(threshold)) & ((1 << (end - first)) - 1)
            else:
                chosen = bits(load(workspace, first) <= splat32(threshold))
            left = chosen
            while left:
                _fetch(reals, words, load_int(workspace, first + trailing_zeros(left) + MOST_WAITING))
                left &= left - 1
            while (chosen or following >= 0) and work < budget and count + LANES <= MOST_WAITING - 2 * LANES:
                if following >= 0:
                    i, following = following, np.int64(-1)
                else:
                    i = first + trailing_zeros(chosen)
                    chosen &= chosen - 1
                reference = np.int64(load_int(workspace, i + MOST_WAITING))
                tag = np.int64(workspace[i + 2 * MOST_WAITING])
                if reference < 0 and ~reference >= ENTRY:
                    reference, tag = _step_into(words, parts, reference, tag)
                if tag != part:
                    part = tag
                    query = _query_in(frames, parts, part, point)
                above = workspace[i]
                workspace[i] = np.float32(np.inf)
                work += 1
                if reference < 0:
                    best_sq, best_slot = _nearer_in_leaf(reals, reference, query, best_sq, best_slot)
                    best32 = open_up_to(near_enough_sq(best_sq, best_slot, tolerance, exact_within))
                    follows = False
                    continue
                bounds = _bounds_with_slabs(words, parts, reference, query, above)
                references = load(words, NODE_STRIDE * reference + NODE_CHILDREN)
                opened = _wait(workspace, count, bounds, references, part, bounds <= splat32(best32))
                follows = follows and opened > count
                if follows:
                    following = _nearest_waiting(workspace, count, opened)
                count = opened
        share = 2.0 * share if SWEEP_RATIO * (work - before) < end else SWEEP_SHARE
