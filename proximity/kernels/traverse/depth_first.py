"""Depth-first loops over trees, as factories of inlined kernels.

A walk descends into one child of a node and pushes the other open ones. *best* is a tuple: the float32 limit
for bounds, then the query's best answer. A query is three functions:

- ``open_children(words, base, query, reach)``: bounds of the node at *base*, a secondary sort key, and the
  mask of children within *reach*;
- ``leaf(reals, reference, query, best)``: *best* updated with the block ``~reference``;
- ``into_part(model, part, start, query, best, stacks)``, for scenes: *best* updated with the subtree at the
  reference *start* of a part with a separate frame.

*stacks* (float32) holds `STACK_SIZE` bounds, then `STACK_SIZE` references (int32 bits), twice: for a part's
tree and, from `SCENE_STACKS` on, for the scene's.
"""

import numpy as np

from proximity.kernels.layout import BLOCK_STRIDE, ENTRY, NODE_STRIDE, STACK_SIZE
from proximity.kernels.nodes import child_at, children_of, fetch_block, fetch_node
from proximity.kernels.traverse.ignored_parts import heed_all
from proximity.native import inlined, kernel
from proximity.native.simd import (
    bits,
    compress,
    count_bits,
    fma,
    load_int,
    lowest_lane,
    nearest_lane,
    splat32,
    store,
)

EXIT_WEIGHT = np.float32(2.0**-3)
"""Weight of the exit parameter relative to the entry parameter; values from 2^-2 to 2^-6 perform equally."""
SCENE_STACKS = 2 * STACK_SIZE
EMPTY = -1
"""Position on an empty stack."""


@inlined
def push(words, base, bounds, which, stacks, at):
    """Push children of the node at *base*; return the new end of the stack."""
    store(stacks, at, compress(bounds, which))
    store(stacks, at + STACK_SIZE, compress(children_of(words, base), which))
    return at + count_bits(bits(which))


@inlined
def _pop(stacks, bottom, at, reach):
    """Pop entries down to one whose bound is not above *reach*; return its position, or `EMPTY`."""
    while at > bottom:
        at -= 1
        if stacks[at] <= reach:
            return at
    return EMPTY


@inlined
def to_nearest(_, words, base, bounds, __, is_open, stacks, at):
    """Descend into the open child of the node at *base* with the lowest bound; push the other open ones.

    Returns its reference, and *at*. The others are not sorted: that cost more than it saved.
    """
    nearest, it = lowest_lane(bounds)
    at = push(words, base, bounds, is_open & ~it, stacks, at)
    return child_at(words, base + nearest), at


@inlined
def in_order(reals, words, base, bounds, leaving, is_open, stacks, at):
    """Descend as `to_nearest` does, with boxes exited at *leaving*; the second nearest child is popped next.

    A ray that has hit a face seldom needs the others: in a gear it visits 8 % fewer nodes and 15 % fewer
    blocks. Points gain 1 and 2 %, less than it costs. A full sort, by a sorting network, is not faster.

    Boxes that share a plane have equal entry parameters, and the ray would start in all of them: the one with
    the smaller exit parameter comes first (in a gear, 9 % fewer blocks and 2 % fewer nodes).

    The next child is prefetched: saves 5 to 14 % of the time, most in large parts. Prefetching at the leaf
    before it saves 1 to 9 %.
    """
    order = fma(leaving, splat32(EXIT_WEIGHT), bounds)
    nearest, it = nearest_lane(order, is_open)
    others = is_open & ~it
    next_lane, second = nearest_lane(order, others)
    _fetch_child(reals, words, base, next_lane if bits(others) else nearest)
    at = push(words, base, bounds, others & ~second, stacks, at)
    at = push(words, base, bounds, others & second, stacks, at)
    return child_at(words, base + nearest), at


@inlined
def _fetch_child(reals, words, base, lane):
    """Prefetch a child as node and as block; a branch would cost more."""
    reference = child_at(words, base + lane)
    fetch_node(words, NODE_STRIDE * max(reference, 0))
    fetch_block(reals, BLOCK_STRIDE * max(~reference, 0))


@inlined
def nothing_ahead(reals, words, stacks, bottom, at, reach):
    """Prefetch no memory."""


@inlined
def fetch_ahead(reals, words, stacks, bottom, at, reach):
    """Prefetch the next entry of the stack, if still within reach, before a leaf is processed.

    Points take 0.85 to 0.95 of the time if a part is larger than the nearer caches; else the same.
    """
    if at > bottom and stacks[at - 1] <= reach:
        fetch(reals, words, load_int(stacks, at - 1 + STACK_SIZE))


@inlined
def fetch(reals, words, reference):
    """Prefetch a node or a leaf."""
    if reference >= 0:
        fetch_node(words, NODE_STRIDE * reference)
    elif ~reference < ENTRY:
        fetch_block(reals, BLOCK_STRIDE * ~reference)


def depth_first(open_children, at_leaf, descend=to_nearest, heed=heed_all):
    """Return a walk from the reference *start* over a stack that begins at *bottom*; it returns the best.

    *at_leaf*: made by `in_blocks` or `in_blocks_and_parts`. *heed*: see `ignored_parts`; a walk that skips
    parts is a separate function, so that other walks do not pay for it. *tables*: the model, or its reals and
    words.
    """

    @(inlined if heed is heed_all else kernel)
    def walk(tables, start, bottom, query, best, stacks):
        reals, words = tables[0], tables[1]
        reference, at = start, bottom
        while True:
            if reference >= 0:
                base = NODE_STRIDE * reference
                bounds, leaving, is_open = open_children(words, base, query, best[0])
                bounds, is_open = heed(tables, reference, bounds, is_open)
                if bits(is_open):
                    reference, at = descend(reals, words, base, bounds, leaving, is_open, stacks, at)
                    continue
            else:
                best, reference, is_passed = at_leaf(tables, reference, query, best, stacks, bottom, at)
                if is_passed:
                    continue
            at = _pop(stacks, bottom, at, best[0])
            if at == EMPTY:
                return best
            reference = load_int(stacks, at + STACK_SIZE)

    return walk


def in_blocks(leaf, ahead=nothing_ahead):
    """Return the leaf function for a part's tree: it updates the best."""

    @inlined
    def at_leaf(tables, reference, query, best, stacks, bottom, at):
        ahead(tables[0], tables[1], stacks, bottom, at, best[0])
        return leaf(tables[0], reference, query, best), reference, False

    return at_leaf


def in_blocks_and_parts(leaf, into_part, ahead=nothing_ahead):
    """Return the leaf function for a scene's tree, whose leaves are blocks or parts.

    The walk continues into parts in the scene's frame; the others have a separate walk.
    """
    in_block = in_blocks(leaf, ahead)

    @inlined
    def at_leaf(model, reference, query, best, stacks, bottom, at):
        if ~reference < ENTRY:
            return in_block(model, reference, query, best, stacks, bottom, at)
        _, words, _, parts = model
        entry = parts[len(parts) - 1].entries + 2 * (~reference - ENTRY)
        part, start = load_int(words, entry), load_int(words, entry + 1)
        if parts[part].is_fused:
            return best, start, True
        return into_part(model, part, start, query, best, stacks), reference, False

    return at_leaf


def through_all(open_children, leaf):
    """Return a walk over one part's tree that adds up a *total* of any type, without bounds.

    ``open_children(words, node, query, total)`` returns the total with the node's contribution, and the mask
    of children to walk; ``leaf`` is as above. *stack* (float32) holds `STACK_SIZE` references.
    """

    @inlined
    def walk(reals, words, root, query, total, stack):
        reference, waiting = root, 0
        while True:
            if reference < 0:
                total = leaf(reals, reference, query, total)
            else:
                total, is_open = open_children(words, reference, query, total)
                children = children_of(words, NODE_STRIDE * reference)
                store(stack, waiting, compress(children, is_open))
                waiting += count_bits(bits(is_open))
            if waiting == 0:
                return total
            waiting -= 1
            reference = load_int(stack, waiting)

    return walk
