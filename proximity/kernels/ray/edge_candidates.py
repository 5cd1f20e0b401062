"""Edges of a body that may meet another of its faces: few; testing all edges exactly would take a second.

If all corners of a face are on one side of a triangle's plane, none of its edges meets that triangle. The
blocks near a block are listed once, and each of its faces is compared, eight triangles at a time, with those
blocks whose boxes it overlaps.
"""

import numpy as np

from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NODE_STRIDE, STACK_SIZE
from proximity.kernels.nodes import boxes_of, child_at, corners_of_block, is_used, lower_at, upper_at
from proximity.kernels.ray.edge_contact import EDGE_CREASED, edge_ray, has_corner, kind_of_edge, lies_on
from proximity.kernels.ray.walk import hits_in_block, look_along
from proximity.kernels.stack_arrays import stack_f32, stack_i64
from proximity.native import inlined, kernel
from proximity.native.simd import bits, maximum, minimum, splat, splat32, trailing_zeros

MAX_NEAR = 32
"""Maximum blocks listed for one. With more, such as next to long faces, marking all edges as candidates is
faster."""
NEAR_BOXES = 6 * MAX_NEAR
SURELY_DEEP_SQ, SURELY_FLAT_SQ = 0.25, 4.0
"""Squared depths between which a corner counts as both in a plane and beyond it. The heights here differ by
rounding from those that decide, by a millionth of the depth."""
ALL_EDGES = 7
UNKNOWN = -1
"""Edge bits not yet computed."""


@kernel
def _list_near(words, root, position, stack, near, near_boxes):
    """List the blocks whose boxes overlap that of the child at a position; return their number, or too many.

    *near_boxes*: the sides of eight boxes at a time, as in nodes.
    """
    low_x, high_x = splat32(lower_at(words, position, 0)), splat32(upper_at(words, position, 0))
    low_y, high_y = splat32(lower_at(words, position, 1)), splat32(upper_at(words, position, 1))
    low_z, high_z = splat32(lower_at(words, position, 2)), splat32(upper_at(words, position, 2))
    stack[0] = root
    count, waiting = 0, 1
    while waiting:
        waiting -= 1
        node = NODE_STRIDE * stack[waiting]
        met = _overlapping(words, node, low_x, low_y, low_z, high_x, high_y, high_z)
        while met:
            child = trailing_zeros(met)
            met &= met - 1
            reference = child_at(words, node + child)
            if reference >= 0:
                stack[waiting] = reference
                waiting += 1
                continue
            if count == MAX_NEAR:
                return MAX_NEAR + 1
            near[count] = ~reference
            at = 6 * LANES * (count // LANES) + count % LANES
            for side in range(6):
                near_boxes[at + LANES * side] = words[node + LANES * side + child]
            count += 1
    return count


@inlined
def _overlapping(words, at, low_x, low_y, low_z, high_x, high_y, high_z):
    """Return the mask of the eight boxes at *at* that overlap a box."""
    (lx, ly, lz), (ux, uy, uz) = boxes_of(words, at)
    return bits(
        (lx <= high_x) & (ux >= low_x) & (ly <= high_y) & (uy >= low_y) & (lz <= high_z) & (uz >= low_z)
    )


@inlined
def _reached(corners, a, b, c, near_boxes, at):
    """Return the mask of eight boxes that a face overlaps.

    Their padding exceeds the rounding of the face's box.
    """
    low_x = min(corners[a, 0], corners[b, 0], corners[c, 0])
    low_y = min(corners[a, 1], corners[b, 1], corners[c, 1])
    low_z = min(corners[a, 2], corners[b, 2], corners[c, 2])
    high_x = max(corners[a, 0], corners[b, 0], corners[c, 0])
    high_y = max(corners[a, 1], corners[b, 1], corners[c, 1])
    high_z = max(corners[a, 2], corners[b, 2], corners[c, 2])
    return _overlapping(
        near_boxes, at, splat32(np.float32(low_x)), splat32(np.float32(low_y)), splat32(np.float32(low_z)),
        splat32(np.float32(high_x)), splat32(np.float32(high_y)), splat32(np.float32(high_z)),
    )  # fmt: skip


@inlined
def _height_over(nx, ny, nz, ax, ay, az, corners, corner):
    """Return the heights of a corner above eight planes, times the lengths of their normals."""
    return dot(
        nx, ny, nz, splat(corners[corner, 0]) - ax, splat(corners[corner, 1]) - ay,
        splat(corners[corner, 2]) - az,
    )  # fmt: skip


@inlined
def _owned_edges(neighbors, face):
    """Return the mask of a face's edges not shared with a neighbour of lower number."""
    edges = 0
    for k in range(3):
        if not 0 <= neighbors[face, k] < face:
            edges |= 1 << k
    return edges


@inlined
def _shared_edges(neighbors, face, other):
    """Return the mask of a face's edges shared with another face."""
    return (
        (neighbors[face, 0] == other)
        | (neighbors[face, 1] == other) << 1
        | (neighbors[face, 2] == other) << 2
    )


@kernel
def _creased_edges(corners, faces, neighbors, face, edges, depth):
    """Return the mask of the creased ones among a face's *edges* (bits)."""
    found = 0
    for k in range(3):
        is_asked = (edges >> k) & 1
        if is_asked and kind_of_edge(corners, faces, face, neighbors[face, k], depth) == EDGE_CREASED:
            found |= 1 << k
    return found


@kernel
def _edges_on(corners, faces, face, other, edges, depth):
    """Return the mask of a face's *edges* (bits) that lie on another face."""
    found = 0
    for k in range(3):
        start, end = faces[face, k], faces[face, (k + 1) % 3]
        shares_it = has_corner(faces, other, start) and has_corner(faces, other, end)
        if (edges >> k) & 1 and not shares_it and lies_on(corners, faces, other, start, end, depth):
            found |= 1 << k
    return found


@kernel
def _edges_through(corners, faces, slot_faces, reals, face, block, lanes, edges, depth):
    """Return the mask of a face's *edges* (bits) that cross a triangle in *lanes* (bits) of a block."""
    found = 0
    for k in range(3):
        if not (edges >> k) & 1:
            continue
        start, end = faces[face, k], faces[face, (k + 1) % 3]
        ox, oy, oz, dx, dy, dz, length = edge_ray(corners, start, end)
        if not length > depth:
            continue
        met = lanes & hits_in_block(reals, BLOCK_STRIDE * block, look_along(ox, oy, oz, dx, dy, dz), length)
        while met:
            other = slot_faces[LANES * block + trailing_zeros(met)]
            met &= met - 1
            if not has_corner(faces, other, start) and not has_corner(faces, other, end):
                found |= 1 << k
    return found


@inlined
def planes_of_block(reals, base):
    """Return a corner and a normal of each of eight triangles."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners_of_block(reals, base)
    normals = cross(bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az)
    return (ax, ay, az), normals


@inlined
def _meeting(corners, faces, face, planes, deep, flat):
    """Return the mask of triangles that a face may cross, and for each corner that of coplanar triangles."""
    (ax, ay, az), (nx, ny, nz) = planes
    h0 = _height_over(nx, ny, nz, ax, ay, az, corners, faces[face, 0])
    h1 = _height_over(nx, ny, nz, ax, ay, az, corners, faces[face, 1])
    h2 = _height_over(nx, ny, nz, ax, ay, az, corners, faces[face, 2])
    lowest, highest, zero = minimum(minimum(h0, h1), h2), maximum(maximum(h0, h1), h2), splat(0.0)
    passed = bits(
        (lowest <= zero) & (lowest * lowest >= deep) & (highest >= zero) & (highest * highest >= deep)
    )
    return passed, (bits(h0 * h0 <= flat), bits(h1 * h1 <= flat), bits(h2 * h2 <= flat))


@inlined
def _flat_edges(flats, lane):
    """Return the mask of a face's edges in the plane of a lane's triangle. *flats*: mask of each corner."""
    is_in0, is_in1, is_in2 = (flats[0] >> lane) & 1, (flats[1] >> lane) & 1, (flats[2] >> lane) & 1
    return (is_in0 & is_in1) | (is_in1 & is_in2) << 1 | (is_in2 & is_in0) << 2


@inlined
def _lanes_to_ask(neighbors, slot_faces, face, first, flats, owned):
    """Return the mask of triangles on which an owned edge of a face may lie without being an edge of both."""
    lain, asked = (flats[0] & flats[1]) | (flats[1] & flats[2]) | (flats[2] & flats[0]), 0
    while lain:
        lane = trailing_zeros(lain)
        lain &= lain - 1
        other, edges = slot_faces[first + lane], _flat_edges(flats, lane)
        if other != face and (edges == ALL_EDGES or edges & owned & ~_shared_edges(neighbors, face, other)):
            asked |= 1 << lane
    return asked


@kernel
def _edges_lying(corners, faces, neighbors, slot_faces, face, first, asked, flats, owned, creased, depth):
    """Return the mask of a face's edges that lie on triangles whose planes contain them.

    *first*: slot of the triangles; *asked*: bits of lanes; *flats*: mask of each corner. Also returns the
    mask of *creased* edges, or `UNKNOWN` if not needed yet.
    """
    edges = 0
    while asked and creased != 0:
        lane = trailing_zeros(asked)
        asked &= asked - 1
        other, flat_edges = slot_faces[first + lane], _flat_edges(flats, lane)
        if creased == UNKNOWN and flat_edges == ALL_EDGES:
            creased = _creased_edges(corners, faces, neighbors, face, owned, depth)
        flat_edges &= owned & creased & ~edges
        if flat_edges:
            edges |= _edges_on(corners, faces, face, other, flat_edges, depth)
    return edges, creased


@kernel
def _compare_blocks(
    corners, faces, neighbors, slot_faces, reals, block, other, met, creased, depth, candidates
):
    """Mark edges of the faces in slots *met* (bits) of a block that may meet a triangle of *other*.

    *creased* (8,) int64: for each slot the mask of creased edges, or `UNKNOWN`.
    """
    planes, first = planes_of_block(reals, BLOCK_STRIDE * other), LANES * other
    nx, ny, nz = planes[1]
    depth_sq = splat(depth * depth) * dot(nx, ny, nz, nx, ny, nz)
    deep, flat = splat(SURELY_DEEP_SQ) * depth_sq, splat(SURELY_FLAT_SQ) * depth_sq
    while met:
        slot = trailing_zeros(met)
        met &= met - 1
        face = np.int64(slot_faces[LANES * block + slot])
        owned = _owned_edges(neighbors, face)
        passed, flats = _meeting(corners, faces, face, planes, deep, flat)
        if passed:
            candidates[face] |= np.uint8(
                _edges_through(corners, faces, slot_faces, reals, face, other, passed, owned, depth)
            )
        asked = _lanes_to_ask(neighbors, slot_faces, face, first, flats, owned)
        if asked:
            found, creased[slot] = _edges_lying(
                corners, faces, neighbors, slot_faces, face, first, asked, flats, owned, creased[slot], depth
            )
            candidates[face] |= np.uint8(found)


@kernel
def _compare_block(
    corners, faces, neighbors, slot_faces, reals, block, near, near_boxes, count, depth, candidates
):
    """Mark edges of a block's faces that may meet a face in the *count* nearby blocks."""
    met, creased = stack_i64(MAX_NEAR), stack_i64(LANES)
    for number in range(min(count, MAX_NEAR)):
        met[number] = 0
    for slot in range(LANES):
        face = np.int64(slot_faces[LANES * block + slot])
        if face < 0:
            continue
        creased[slot], candidates[face] = UNKNOWN, 0
        if count > MAX_NEAR:
            candidates[face] = _owned_edges(neighbors, face)
            continue
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        for first in range(0, count, LANES):
            reached = _reached(corners, a, b, c, near_boxes, 6 * first)
            reached &= (1 << min(LANES, count - first)) - 1
            while reached:
                met[first + trailing_zeros(reached)] |= 1 << slot
                reached &= reached - 1
    for number in range(count if count <= MAX_NEAR else 0):
        _compare_blocks(
            corners, faces, neighbors, slot_faces, reals, block, near[number], met[number], creased, depth,
            candidates,
        )  # fmt: skip


@kernel
def note_candidates(corners, faces, neighbors, slot_faces, reals, words, root, depth, candidates):
    """Fill the mask of each face's edges that may meet another face, within *depth*: (F,) uint8.

    The other arguments are those of `self_intersections.passing_faces`.
    """
    stack, inner = stack_i64(STACK_SIZE), stack_i64(STACK_SIZE)
    near, near_boxes = stack_i64(MAX_NEAR), stack_f32(NEAR_BOXES)
    inner[0] = root
    waiting = 1
    while waiting:
        waiting -= 1
        base = NODE_STRIDE * inner[waiting]
        for lane in range(LANES):
            if not is_used(words, base + lane):
                continue
            reference = child_at(words, base + lane)
            if reference >= 0:
                inner[waiting] = reference
                waiting += 1
                continue
            count = _list_near(words, root, base + lane, stack, near, near_boxes)
            _compare_block(
                corners, faces, neighbors, slot_faces, reals, ~reference, near, near_boxes, count, depth,
                candidates,
            )  # fmt: skip
