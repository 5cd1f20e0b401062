"""Traversal within a budget of steps: depth first at the beginning, then smallest bounds first.

Depth first is the shortest search in most cases. A walk that takes longer than an eighth of its budget, or a
few steps, has met a point where every exact search opens the whole tree (the centre of a ball). From there
on, sweep by sweep, it opens the subtrees with the smallest bounds and follows one of them down to a leaf, so
that the gap between the bounds closes from both sides.

Waiting subtrees are in *workspace* (float32), three planes of `MAX_WAITING` numbers: a lower bound of the
squared distance, always in the scene's scaled frame; the reference (int32 bits); and the part whose frame it
is in, or the scene's row.

Tried and dropped (2026-11): see the figures at `SWEEP_SHARE`.
"""

import numpy as np

from proximity.kernels.layout import ENTRY, LANES, NODE_STRIDE, STACK_SIZE
from proximity.kernels.nodes import child_at, children_of
from proximity.kernels.traverse.depth_first import fetch
from proximity.kernels.traverse.ignored_parts import heed_all
from proximity.native import inlined, kernel
from proximity.native.simd import (
    bits,
    compress,
    count_bits,
    horizontal_min,
    load,
    load_int,
    lowest_lane,
    minimum,
    splat32,
    store,
    trailing_zeros,
)

MAX_SWEPT_STEPS = 4096
"""Maximum steps of a budget that are taken in sweeps; the others go depth first."""
MAX_WAITING = 4 * STACK_SIZE + (LANES - 1) * MAX_SWEPT_STEPS + 4 * LANES
WORKSPACE_SIZE = 3 * MAX_WAITING
DEEP_DIVISOR = 8
"""Divisor of a budget giving the steps that go depth first."""
MIN_DEEP_STEPS = 16
"""Minimum number of depth-first steps, for budgets of at least twice that: mostly they suffice. Predictions
with 40 steps have some 10 % shorter ticks at p99 than with an eighth of them, and report contacts as
early."""
SWEEP_SHARE = 0.08
"""Share of the gap between the bounds that one sweep covers; more if that would open few subtrees. At the
centre of a ball of 82 k faces 800 steps leave bounds 0.4 % apart with 0.02 to 0.3 (0.02 takes a fifth
longer), 0.8 % with 1, and 100 % depth first."""
SWEEP_RATIO = 16
"""A sweep scans all waiting subtrees, so it should open at least one in this many."""


@inlined
def _push(workspace, at, bounds, references, part, which):
    """Append the subtrees of eight lanes selected by *which*; return the end position."""
    store(workspace, at, compress(bounds, which))
    store(workspace, at + MAX_WAITING, compress(references, which))
    store(workspace, at + 2 * MAX_WAITING, splat32(np.float32(part)))
    return at + count_bits(bits(which))


@inlined
def _step_into(words, parts, reference, part):
    """Return the subtree of an entry of the tree over parts, and the row of its frame."""
    entry = parts[len(parts) - 1].entries + 2 * (~reference - ENTRY)
    owner = np.int64(load_int(words, entry))
    return np.int64(load_int(words, entry + 1)), part if parts[owner].is_fused else owner


@inlined
def _keep_open(workspace, count, reach):
    """Drop waiting subtrees beyond *reach*; return the number left and their smallest bound."""
    store(workspace, count, splat32(np.float32(np.inf)))
    smallest = splat32(np.float32(np.inf))
    kept = 0
    for i in range(0, count, LANES):
        bounds, references, tags = (
            load(workspace, i),
            load(workspace, i + MAX_WAITING),
            load(workspace, i + 2 * MAX_WAITING),
        )
        is_open = bounds <= splat32(reach)
        store(workspace, kept, compress(bounds, is_open))
        store(workspace, kept + MAX_WAITING, compress(references, is_open))
        store(workspace, kept + 2 * MAX_WAITING, compress(tags, is_open))
        kept += count_bits(bits(is_open))
        smallest = minimum(smallest, bounds)
    return kept, horizontal_min(smallest)


@inlined
def _nearest_waiting(workspace, first, end):
    """Return the position of the smallest bound among the subtrees from *first* up to *end*."""
    nearest = first
    for k in range(first + 1, end):
        if workspace[k] < workspace[nearest]:
            nearest = np.int64(k)
    return nearest


def best_first(query_in, node_bounds, close_bounds, leaf, target, reach_of, heed=heed_all):
    """Return a walk within a budget, for squared distances in the scene's scaled frame.

    - ``query_in(frames, parts, part, point)``: the query in the frame of a part, passed to the others;
    - ``node_bounds(words, base, query)``: float32 bounds of a node's children;
    - ``close_bounds(words, parts, reference, query, above)``: tighter bounds, at least the node's bound
      *above*;
    - ``leaf(reals, reference, query, best)``: *best* updated with a block; *best*: squared distance, slot;
    - ``target(best, tolerance)``: the squared distance at which the search ends;
    - ``reach_of(target_sq)``: the float32 limit for bounds of subtrees to open.
    - ``heed``: see `ignored_parts`.

    The walk returns the best, a lower bound of the squared distance, and the steps taken. A step is a node or
    a leaf.
    """

    @kernel
    def sweep(model, point, best, tolerance, count, work, budget, workspace):
        """Continue from the *count* subtrees waiting in *workspace*."""
        reals, words, frames, parts = model
        part = np.int64(-1)
        query = query_in(frames, parts, len(parts) - 1, point)
        share = SWEEP_SHARE
        while True:
            target_sq = target(best, tolerance)
            reach = reach_of(target_sq)
            count, lowest = _keep_open(workspace, count, reach)
            lower_sq = min(np.float64(lowest), target_sq)
            if count == 0:
                return best, target_sq, work
            if work >= budget or count + LANES > MAX_WAITING - 2 * LANES:
                return best, lower_sq, work
            gap = min(best[0], 4.0 * lower_sq + 1.0) - lower_sq
            threshold = max(np.float32(lower_sq + share * gap), lowest)
            end, before = count, work
            # The first subtree opened is followed down to a leaf, which lowers the upper bound.
            follows, following = True, np.int64(-1)
            for first in range(0, end, LANES):
                chosen = bits(load(workspace, first) <= splat32(threshold))
                if first + LANES > end:
                    # Children appended in this sweep wait for the next.
                    chosen &= (1 << (end - first)) - 1
                left = chosen
                while left:
                    fetch(reals, words, load_int(workspace, first + trailing_zeros(left) + MAX_WAITING))
                    left &= left - 1
                while (
                    (chosen or following >= 0) and work < budget and count + LANES <= MAX_WAITING - 2 * LANES
                ):
                    if following >= 0:
                        i, following = following, np.int64(-1)
                    else:
                        i = first + trailing_zeros(chosen)
                        chosen &= chosen - 1
                    reference = np.int64(load_int(workspace, i + MAX_WAITING))
                    tag = np.int64(workspace[i + 2 * MAX_WAITING])
                    if reference < 0 and ~reference >= ENTRY:
                        reference, tag = _step_into(words, parts, reference, tag)
                    if tag != part:
                        part = tag
                        query = query_in(frames, parts, part, point)
                    above = workspace[i]
                    workspace[i] = np.float32(np.inf)
                    work += 1
                    if reference < 0:
                        best = leaf(reals, reference, query, best)
                        reach = reach_of(target(best, tolerance))
                        follows = False
                        continue
                    bounds = close_bounds(words, parts, reference, query, above)
                    references = children_of(words, NODE_STRIDE * reference)
                    bounds, is_open = heed(model, reference, bounds, bounds <= splat32(reach))
                    opened = _push(workspace, count, bounds, references, part, is_open)
                    follows = follows and opened > count
                    if follows:
                        following = _nearest_waiting(workspace, count, opened)
                    count = opened
            share = 2.0 * share if SWEEP_RATIO * (work - before) < end else SWEEP_SHARE

    @(inlined if heed is heed_all else kernel)
    def walk(model, start, part, point, best, tolerance, budget, workspace):
        """Walk from the reference *start*, in the frame of *part* (the scene's row: the tree over parts)."""
        reals, words, frames, parts = model
        query = query_in(frames, parts, part, point)
        reach = reach_of(target(best, tolerance))
        deep_end = max(
            budget // DEEP_DIVISOR,
            MIN_DEEP_STEPS if budget >= 2 * MIN_DEEP_STEPS else 0,
            budget - MAX_SWEPT_STEPS,
        )
        work, at = 0, 0
        reference = start
        while True:
            work += 1
            if reference >= 0:
                base = NODE_STRIDE * reference
                bounds = node_bounds(words, base, query)
                bounds, is_open = heed(model, reference, bounds, bounds <= splat32(reach))
                if bits(is_open):
                    nearest, it = lowest_lane(bounds)
                    left = is_open
                    if work < deep_end:
                        left = is_open & ~it
                    at = _push(workspace, at, bounds, children_of(words, base), part, left)
                    if work < deep_end:
                        reference = child_at(words, base + nearest)
                        continue
            elif ~reference < ENTRY:
                best = leaf(reals, reference, query, best)
                reach = reach_of(target(best, tolerance))
            else:
                work -= 1
                reference, owner = _step_into(words, parts, reference, part)
                if owner != part:
                    part = owner
                    query = query_in(frames, parts, part, point)
                continue
            if work >= deep_end:
                return sweep(model, point, best, tolerance, at, work, budget, workspace)
            while at > 0:
                at -= 1
                if workspace[at] <= reach:
                    break
            else:
                return best, target(best, tolerance), work
            reference = load_int(workspace, at + MAX_WAITING)
            if np.int64(workspace[at + 2 * MAX_WAITING]) != part:
                part = np.int64(workspace[at + 2 * MAX_WAITING])
                query = query_in(frames, parts, part, point)

    return walk
