"""Compiled loops around single kernels: a call from Python would take longer than the kernel.

Each fills one number a call, so that the compiler cannot omit it and answers can be compared: row i of
*queries* is answered at row i of *bases*. The ``plain_`` ones call the textbook formulas (`yardstick`), eight
times for eight lanes.
"""

import numba
import numpy as np

from benchmarks.gate.yardstick import box_distance_sq, box_entry, triangle_distance_sq, triangle_entry
from proximity.kernels.geometry.box import point_boxes_distance_sq
from proximity.kernels.geometry.triangle import point_block_distance_sq, point_triangle_distance_sq
from proximity.kernels.layout import STACKS_SIZE
from proximity.kernels.ray.walk import SLAB_MARGIN, aim_and_view, first_in_block, look_along, open_boxes
from proximity.kernels.segment.walk import segment_block_distance_sq
from proximity.kernels.sign.winding_number import winding_number
from proximity.kernels.stack_arrays import stack_f32
from proximity.kernels.traverse.depth_first import to_nearest
from proximity.native import kernel
from proximity.native.simd import bits, horizontal_min, select, splat, splat32

plain = numba.njit(cache=True, nogil=True, error_model="numpy")


@kernel
def triangle_loop(reals, bases, queries, found):
    """Squared distance of a point to one triangle, the first of a block."""
    for i in range(len(bases)):
        b = bases[i]
        found[i] = point_triangle_distance_sq(
            (queries[i, 0], queries[i, 1], queries[i, 2]),
            (reals[b], reals[b + 8], reals[b + 16]),
            (reals[b + 24], reals[b + 32], reals[b + 40]),
            (reals[b + 48], reals[b + 56], reals[b + 64]),
        )


@kernel
def block_loop(reals, bases, queries, found):
    """Smallest squared distance of a point to the eight triangles of a block."""
    for i in range(len(bases)):
        p = splat(queries[i, 0]), splat(queries[i, 1]), splat(queries[i, 2])
        found[i] = horizontal_min(point_block_distance_sq(reals, bases[i], p))


@kernel
def ray_block_loop(reals, bases, queries, found):
    """First hit of a ray among the eight triangles of a block; inf where there is none."""
    for i in range(len(bases)):
        view = look_along(
            queries[i, 0], queries[i, 1], queries[i, 2], queries[i, 3], queries[i, 4], queries[i, 5]
        )
        found[i], _, _, _, _ = first_in_block(reals, bases[i], view, 0.0, np.inf)


@kernel
def segment_block_loop(reals, bases, plans, found):
    """Smallest squared distance of a planned segment to the eight triangles of a block."""
    for i in range(len(bases)):
        found[i] = horizontal_min(segment_block_distance_sq(reals, bases[i], plans[i]))


@kernel
def boxes_loop(words, bases, queries, found):
    """Smallest bound of a point to the eight boxes of a node."""
    for i in range(len(bases)):
        x, y, z = np.float32(queries[i, 0]), np.float32(queries[i, 1]), np.float32(queries[i, 2])
        bounds = point_boxes_distance_sq(words, bases[i], splat32(x), splat32(y), splat32(z))
        found[i] = horizontal_min(bounds)


@kernel
def ray_boxes_loop(words, bases, queries, found):
    """Smallest bound of a ray to the eight boxes of a node; inf where it enters none."""
    for i in range(len(bases)):
        aim, _ = aim_and_view(
            queries[i, 0],
            queries[i, 1],
            queries[i, 2],
            queries[i, 3],
            queries[i, 4],
            queries[i, 5],
            SLAB_MARGIN,
        )
        zero, best32 = splat32(np.float32(0.0)), np.float32(np.inf)
        bounds, _, is_open = open_boxes(words, bases[i], aim, zero, best32)
        found[i] = horizontal_min(select(is_open, bounds, splat32(np.float32(np.inf))))


@kernel
def node_loop(words, bases, queries, found):
    """A step of a traversal: bounds of a node, nearest child taken, the others pushed; their number."""
    stacks = stack_f32(STACKS_SIZE)
    best32 = splat32(np.float32(1.0))
    for i in range(len(bases)):
        x, y, z = np.float32(queries[i, 0]), np.float32(queries[i, 1]), np.float32(queries[i, 2])
        bounds = point_boxes_distance_sq(words, bases[i], splat32(x), splat32(y), splat32(z))
        is_open = bounds <= best32
        waiting = np.int64(-1)
        if bits(is_open):
            _, waiting = to_nearest(words, words, bases[i], bounds, bounds, is_open, stacks, np.int64(0))
        found[i] = waiting


@kernel
def winding_loop(reals, words, root, moments, queries, found):
    """Winding number of a part about a point."""
    for i in range(len(queries)):
        found[i] = winding_number(reals, words, root, moments, queries[i, 0], queries[i, 1], queries[i, 2])


@plain
def plain_triangle_loop(corners, queries, found):
    """*corners*: (N, 8, 9); the first triangle of each row."""
    for i in range(len(corners)):
        found[i] = triangle_distance_sq(queries[i, 0], queries[i, 1], queries[i, 2], corners[i, 0])


@plain
def plain_block_loop(corners, queries, found):
    """The nearest of eight triangles."""
    for i in range(len(corners)):
        best = np.inf
        for k in range(8):
            one_sq = triangle_distance_sq(queries[i, 0], queries[i, 1], queries[i, 2], corners[i, k])
            best = min(best, one_sq)
        found[i] = best


@plain
def plain_ray_block_loop(corners, queries, found):
    """The first hit of eight triangles."""
    for i in range(len(corners)):
        best, row = np.inf, queries[i]
        for k in range(8):
            best = min(best, triangle_entry(row[0], row[1], row[2], row[3], row[4], row[5], corners[i, k]))
        found[i] = best


@plain
def plain_boxes_loop(boxes, queries, found):
    """*boxes*: (N, 8, 6); the nearest of eight."""
    for i in range(len(boxes)):
        best = np.inf
        for k in range(8):
            best = min(best, box_distance_sq(queries[i, 0], queries[i, 1], queries[i, 2], boxes[i, k]))
        found[i] = best


@plain
def plain_ray_boxes_loop(boxes, queries, found):
    """The first of eight boxes that a ray enters."""
    for i in range(len(boxes)):
        best, row = np.inf, queries[i]
        rate_x, rate_y, rate_z = 1.0 / row[3], 1.0 / row[4], 1.0 / row[5]
        for k in range(8):
            best = min(best, box_entry(row[0], row[1], row[2], rate_x, rate_y, rate_z, boxes[i, k]))
        found[i] = best


@plain
def plain_node_loop(boxes, queries, found):
    """A step of a traversal: boxes nearer than 1, the nearest taken; how many are pushed."""
    bounds, waiting = np.empty(8), np.empty(8, np.int64)
    for i in range(len(boxes)):
        count, nearest = 0, -1
        for k in range(8):
            bounds[k] = box_distance_sq(queries[i, 0], queries[i, 1], queries[i, 2], boxes[i, k])
            if bounds[k] <= 1.0 and (nearest < 0 or bounds[k] < bounds[nearest]):
                nearest = k
        for k in range(8):
            if bounds[k] <= 1.0 and k != nearest:
                waiting[count] = k
                count += 1
        found[i] = count if nearest >= 0 else -1
