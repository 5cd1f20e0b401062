"""Search for the closest surface to a point that has moved a little, starting from the last answer.

A search ends at a *frontier*. It consists of opened nodes, whose children are unopened nodes or leaves. For
each of these children a plane is stored that separates it from the query. The plane is perpendicular to the
connection between the query and the nearest point of the child at the time the plane was made. The distance
to the plane is a lower bound and, after a small move, a tight one: the neglected terms are of second order.
The next search tests eight planes at a time and opens the children that may be nearer than the previous
nearest face. Not all planes are tested: the least excess of a node's planes over the reach gives the
displacement at which they must be tested again.

Five recorded fingers near a bumpy ring of 90 k even triangles take 10 steps a tick instead of 199 (p50), and
half the time. Ten fingers near a gear of 118 bodies take 55 steps instead of 243, which is no faster. Near
plane faces a walk takes 7 steps a finger and is as fast. Parts with separate frames are walked, without gain.

Tried and dropped (2026-11): distances reduced by the displacement since, instead of planes. Being of first
order, they opened twice as many nodes near plane faces as a walk from the root.

Sources: Li & Chen 1998, "Incremental 3D collision detection with hierarchical data structures" (the
frontier). Supporting planes as lower bounds of the distance to a convex set are textbook.
"""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.box import nearest_in_boxes
from proximity.kernels.geometry.frames import is_alone, part_of_slot, to_local
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import BLOCK_STRIDE, ENTRY, LANES, NODE_STRIDE
from proximity.kernels.nodes import child_at, corner_at, corners_of_block, lower_at, upper_at
from proximity.kernels.point.budgeted_walk import NO_TOLERANCE, best_known, factor_of, nearest_with_budget
from proximity.kernels.point.walk import nearer_in_block
from proximity.native import inlined, kernel
from proximity.native.simd import (
    bits,
    fma,
    horizontal_min,
    load,
    load_int,
    maximum,
    minimum,
    select,
    splat,
    splat32,
    square_root,
    store,
    trailing_zeros,
)

FRONTIER_CAPACITY = 112
"""Maximum number of nodes of a frontier. If more are needed, the search starts again at the root."""
DUE_WORD = FRONTIER_CAPACITY // 2
"""Number of nodes per word of due bits."""
FRONTIER_GROUP = 4 * LANES
"""Numbers per node for the planes of its children: x, y, z of the direction, and offset.

They are stored first.
"""
FRONTIER_X, FRONTIER_Y, FRONTIER_Z, FRONTIER_OFFSET = 0, LANES, 2 * LANES, 3 * LANES
FRONTIER_DUE = FRONTIER_GROUP * FRONTIER_CAPACITY
"""Offset of one number per node, the displacement at which its planes must be tested again.

Up to this displacement, the planes of its unopened children are out of reach.
"""
FRONTIER_NODES = FRONTIER_DUE + FRONTIER_CAPACITY
"""Offset of one number per node, which is the number of the node."""
FRONTIER_TRAVEL = FRONTIER_NODES + FRONTIER_CAPACITY
"""Offset of the point's accumulated displacement since the frontier began, and of its last position.

Both are in the frame of the tree.
"""
FRONTIER_LIMIT = FRONTIER_TRAVEL + 4
"""Offset of the number of nodes at which the frontier is rebuilt, so that it stays small."""
FRONTIER_SIZE = FRONTIER_LIMIT + 1
FRONTIER_BEGINS = -1
"""Count of a frontier that has not been built yet."""
LONG_WALK = 20
"""Number of steps below which a walk is as fast as testing a frontier."""
MAX_NODES = 2**24
"""Maximum number of a node, up to which float32 represents integers exactly."""
FARTHEST_POINT = 1e3
"""Distance, in part sizes, beyond which float32 cannot distinguish the planes."""
MAX_TRAVEL = np.float32(2.0)
"""Displacement, in part sizes, after which the frontier is rebuilt because it may no longer save time."""
FLOAT32_ROUNDING = 2.0**-19
"""Several times the rounding error of float32 results, both relative and in part sizes."""
SMALLEST_LENGTH_SQ = np.float32(1e-30)
"""Squared lengths below this have no usable direction."""
NONE, ONE, INFINITE = np.float32(0.0), np.float32(1.0), np.float32(np.inf)
BEHIND_NONE = np.float32(-np.inf)
"""Plane offset of a child that is a node of the frontier. Such a plane is always out of reach."""
CLOSING_SHARE = np.float32(0.49)
"""Share of a plane's excess over the reach that the point may move before the plane is tested again.

It is half, because the nearest face may recede as the plane approaches, less the rounding of the sum.
"""


@inlined
def _plane_of_block(reals, base, px, py, pz):
    """Return a plane that has all triangles of a block behind it, at nearly their distance from *p*."""
    wide_x, wide_y, wide_z = splat(px), splat(py), splat(pz)
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners_of_block(reals, base)
    to_a = dot(wide_x - ax, wide_y - ay, wide_z - az, wide_x - ax, wide_y - ay, wide_z - az)
    to_b = dot(wide_x - bx, wide_y - by, wide_z - bz, wide_x - bx, wide_y - by, wide_z - bz)
    to_c = dot(wide_x - cx, wide_y - cy, wide_z - cz, wide_x - cx, wide_y - cy, wide_z - cz)
    least = minimum(to_a, minimum(to_b, to_c))
    is_used = least < splat(np.inf)
    min_sq = horizontal_min(select(is_used, least, splat(np.inf)))
    if not SMALLEST_LENGTH_SQ < min_sq < np.inf:
        return 0.0, 0.0, 0.0, 0.0
    # The nearest corner; triangles share corners.
    corner, nearest = 0, bits(to_a <= splat(min_sq))
    if not nearest:
        corner, nearest = 1, bits(to_b <= splat(min_sq))
    if not nearest:
        corner, nearest = 2, bits(to_c <= splat(min_sq))
    x, y, z = corner_at(reals, base + trailing_zeros(nearest), corner)
    share = 1.0 / sqrt(min_sq)
    gx = np.float64(np.float32((px - x) * share))
    gy = np.float64(np.float32((py - y) * share))
    gz = np.float64(np.float32((pz - z) * share))
    wide_x, wide_y, wide_z = splat(gx), splat(gy), splat(gz)
    farthest = maximum(
        dot(wide_x, wide_y, wide_z, ax, ay, az),
        maximum(dot(wide_x, wide_y, wide_z, bx, by, bz), dot(wide_x, wide_y, wide_z, cx, cy, cz)),
    )
    return gx, gy, gz, -horizontal_min(select(is_used, -farthest, splat(np.inf)))


@inlined
def _plane_of_box(words, position, qx, qy, qz):
    """Return the plane of a child's box as seen from *q*, and the distance of the box.

    The plane is given by its direction and offset.
    """
    at_x = min(max(qx, lower_at(words, position, 0)), upper_at(words, position, 0))
    at_y = min(max(qy, lower_at(words, position, 1)), upper_at(words, position, 1))
    at_z = min(max(qz, lower_at(words, position, 2)), upper_at(words, position, 2))
    gx, gy, gz = qx - at_x, qy - at_y, qz - at_z
    length_sq = gx * gx + gy * gy + gz * gz
    length = np.float32(sqrt(length_sq))
    share = ONE / length if length_sq > SMALLEST_LENGTH_SQ else NONE
    gx, gy, gz = gx * share, gy * share, gz * share
    offset = gx * at_x + gy * at_y + gz * at_z
    return gx, gy, gz, offset, length


@inlined
def _reach(best_sq, slack):
    """Return the largest computed distance of a plane whose child may be as near as the best face."""
    return np.float32(sqrt(best_sq) * (1.0 + FLOAT32_ROUNDING) + slack)


@inlined
def _keep_node(words, node, frontier, count, vx, vy, vz):
    """Append a node to a frontier, with the planes of the boxes of its children."""
    base, at = NODE_STRIDE * node, FRONTIER_GROUP * count
    at_x, at_y, at_z = nearest_in_boxes(words, base, vx, vy, vz)
    gap_x, gap_y, gap_z = vx - at_x, vy - at_y, vz - at_z
    gap_sq = fma(gap_x, gap_x, fma(gap_y, gap_y, gap_z * gap_z))
    # Unused lanes become NaN: they are never opened.
    share = select(gap_sq > splat32(SMALLEST_LENGTH_SQ), splat32(ONE) / square_root(gap_sq), splat32(NONE))
    gap_x, gap_y, gap_z = gap_x * share, gap_y * share, gap_z * share
    store(frontier, at + FRONTIER_X, gap_x)
    store(frontier, at + FRONTIER_Y, gap_y)
    store(frontier, at + FRONTIER_Z, gap_z)
    store(frontier, at + FRONTIER_OFFSET, fma(gap_x, at_x, fma(gap_y, at_y, gap_z * at_z)))
    frontier[FRONTIER_NODES + count] = node


@inlined
def _keep_plane(frontier, at, plane):
    """Store the direction and the offset of the plane of one child."""
    frontier[at + FRONTIER_X], frontier[at + FRONTIER_Y] = plane[0], plane[1]
    frontier[at + FRONTIER_Z], frontier[at + FRONTIER_OFFSET] = plane[2], plane[3]


@inlined
def _keep_point(frontier, travel, qx, qy, qz):
    """Store the position of the point and its accumulated displacement."""
    frontier[FRONTIER_TRAVEL], frontier[FRONTIER_TRAVEL + 1] = travel, qx
    frontier[FRONTIER_TRAVEL + 2], frontier[FRONTIER_TRAVEL + 3] = qy, qz


@inlined
def _travel_since(frontier, qx, qy, qz, slack):
    """Return an upper bound of the displacement that the point has accumulated since the frontier began."""
    sx, sy, sz = (
        qx - frontier[FRONTIER_TRAVEL + 1],
        qy - frontier[FRONTIER_TRAVEL + 2],
        qz - frontier[FRONTIER_TRAVEL + 3],
    )
    travel = frontier[FRONTIER_TRAVEL] + np.float32(sqrt(sx * sx + sy * sy + sz * sz))
    return travel * np.float32(1.0 + FLOAT32_ROUNDING) + np.float32(slack)


@inlined
def _begin_frontier(words, root, frontier, vx, vy, vz):
    """Build a frontier that has only the root."""
    for k in range(0, FRONTIER_CAPACITY, LANES):
        store(frontier, FRONTIER_DUE + k, splat32(INFINITE))
    _keep_node(words, root, frontier, 0, vx, vy, vz)


@inlined
def _due_nodes(frontier, count, travel):
    """Return a mask of the nodes that are due. It has two words, the first of them for `DUE_WORD` nodes."""
    due, also_due = np.int64(0), np.int64(0)
    if travel <= MAX_TRAVEL:
        for k in range(0, min(count, DUE_WORD), LANES):
            due |= bits(load(frontier, FRONTIER_DUE + k) <= splat32(travel)) << k
        for k in range(DUE_WORD, count, LANES):
            also_due |= bits(load(frontier, FRONTIER_DUE + k) <= splat32(travel)) << (k - DUE_WORD)
    return due, also_due


@inlined
def _next_due(due, also_due, fresh):
    """Return the next node to test, and the updated arguments.

    It is a node that is due or, if there is none, the next new node *fresh*.
    """
    if due:
        return np.int64(trailing_zeros(due)), due & (due - 1), also_due, fresh
    if also_due:
        return np.int64(DUE_WORD + trailing_zeros(also_due)), due, also_due & (also_due - 1), fresh
    return fresh, due, also_due, fresh + 1


@inlined
def _away(frontier, node, vx, vy, vz):
    """Return the distances to the planes of a node's children.

    They are inf for children in the frontier itself.
    """
    at = FRONTIER_GROUP * node
    away = fma(load(frontier, at + FRONTIER_Z), vz, -load(frontier, at + FRONTIER_OFFSET))
    return fma(load(frontier, at + FRONTIER_X), vx, fma(load(frontier, at + FRONTIER_Y), vy, away))


@inlined
def _better_plane(reals, block, p, plane):
    """Return the plane of a block or the plane of its box, whichever is farther from *p*.

    *plane*: the plane of the box.
    """
    px, py, pz = p
    gx, gy, gz, offset = _plane_of_block(reals, block, px, py, pz)
    length = gx * px + gy * py + gz * pz - offset
    if length > plane[4]:
        return np.float32(gx), np.float32(gy), np.float32(gz), np.float32(offset), np.float32(length)
    return plane


@inlined
def _look_into_leaf(reals, reference, seen, p, best_sq, slot, plane):
    """Update the best face in the same way as `nearer_in_block`. Return also the plane to store.

    A block that is *seen* is not searched again.
    """
    px, py, pz = p
    if reference != seen:
        lanes = splat(px), splat(py), splat(pz)
        best_sq, slot = nearer_in_block(reals, ~reference, lanes, best_sq, slot)
    # In the nearest face's block no plane is out of reach.
    if slot // LANES != ~reference:
        plane = _better_plane(reals, BLOCK_STRIDE * ~reference, p, plane)
    return best_sq, slot, plane


@kernel
def nearest_from_last_answer(model, point, part, slot, frontier, count, budget, workspace):
    """Find the nearest surface of the whole scene to a point, starting from the last answer.

    *model*: its four arrays. *point*: (x, y, z), scene's frame. *part*, *slot*: a face, ideally the previous
    nearest one. *frontier*: (`FRONTIER_SIZE`,), that of the last search, with *count* nodes, or
    `FRONTIER_BEGINS`. The scene must not have changed since, except for the pose of a single part.

    Return the squared distance (scene's scaled frame), the part and the slot of the nearest face found. Then
    return whether it is exact, which is False if *budget* steps did not suffice; the count of the frontier,
    which is 0 if it must be discarded even after an exact answer; and the number of steps, at most *budget* +
    1.
    """
    reals, words, frames, parts = model
    walk_row = np.int64(0) if is_alone(parts) else len(parts) - 1
    factor = factor_of(frames, walk_row)
    x, y, z = point
    best_sq, slot = best_known(model, part, slot, point)
    best_sq, seen = best_sq / factor, ~(slot // LANES)
    p = px, py, pz = to_local(frames, parts, walk_row, x, y, z)
    size = abs(px) + abs(py) + abs(pz)
    slack = FLOAT32_ROUNDING * (1.0 + size)
    work = np.int64(0)
    if not size <= FARTHEST_POINT or parts[walk_row].root >= MAX_NODES:
        return best_sq * factor, part, slot, False, np.int64(0), work
    qx, qy, qz = np.float32(px), np.float32(py), np.float32(pz)
    vx, vy, vz = splat32(qx), splat32(qy), splat32(qz)

    travel = _travel_since(frontier, qx, qy, qz, slack)
    # Bits of due nodes, and the first node added in this search.
    due, also_due = _due_nodes(frontier, count, travel)
    begins, fresh = count <= 0 or not travel <= MAX_TRAVEL, count
    has_begun, is_found = False, True
    limit = np.int64(frontier[FRONTIER_LIMIT])
    while is_found:
        if begins:
            begins, has_begun = False, True
            due, also_due, fresh, travel = np.int64(0), np.int64(0), np.int64(0), NONE
            _begin_frontier(words, parts[walk_row].root, frontier, vx, vy, vz)
            count, limit = np.int64(1), np.int64(FRONTIER_CAPACITY)
            work += 1
        node, due, also_due, fresh = _next_due(due, also_due, fresh)
        if node >= count:
            break
        away, reach = _away(frontier, node, vx, vy, vz), _reach(best_sq, slack)
        # Tested children, and the least distance of their new planes.
        looked_at, least = np.int64(0), INFINITE
        while True:
            opened = bits(away <= splat32(reach)) & ~looked_at
            if not opened:
                break
            looked_at |= opened & -opened
            lane = trailing_zeros(opened)
            position = NODE_STRIDE * np.int64(frontier[FRONTIER_NODES + node]) + lane
            plane = _plane_of_box(words, position, qx, qy, qz)
            if plane[4] <= reach:
                if work >= budget:
                    is_found = False
                    break
                work += 1
                reference = np.int64(child_at(words, position))
                if reference >= 0:
                    if count >= limit or reference >= MAX_NODES:
                        begins, is_found = True, not has_begun
                        break
                    _keep_node(words, reference, frontier, count, vx, vy, vz)
                    count += 1
                    plane = plane[0], plane[1], plane[2], BEHIND_NONE, INFINITE
                elif ~reference < ENTRY:
                    best_sq, slot, plane = _look_into_leaf(reals, reference, seen, p, best_sq, slot, plane)
                else:
                    # A part with a separate frame is walked.
                    entry = parts[walk_row].entries + 2 * (~reference - ENTRY)
                    start, owner = np.int64(load_int(words, entry + 1)), np.int64(load_int(words, entry))
                    best_sq, slot, lower_sq, steps = nearest_with_budget(
                        model, start, owner, point, (best_sq, slot), NO_TOLERANCE, budget - work, workspace
                    )
                    work += steps
                    if lower_sq < best_sq:
                        is_found = False
                        break
                reach = _reach(best_sq, slack)
            _keep_plane(frontier, FRONTIER_GROUP * node + lane, plane)
            least = min(least, plane[4])
        least = min(least, horizontal_min(select(away > splat32(reach), away, splat32(INFINITE))))
        frontier[FRONTIER_DUE + node] = travel + CLOSING_SHARE * max(least - reach, NONE)
    if has_begun:
        frontier[FRONTIER_LIMIT] = min(2 * count + LANES, FRONTIER_CAPACITY)
    if not is_found or (has_begun and work < LONG_WALK):
        count = np.int64(0)
    _keep_point(frontier, travel, qx, qy, qz)
    return best_sq * factor, part_of_slot(words, parts, slot), slot, is_found, count, work
