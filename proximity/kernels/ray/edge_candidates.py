"""Edges of a body that may meet another of its faces: few; testing all edges exactly would take a second.

If all corners of a face are on one side of a triangle's plane, none of its edges meets that triangle. The
blocks near a block are listed once, and each of its faces is compared, eight triangles at a time, with those
blocks whose boxes it overlaps.
"""

import numpy as np

from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NODE_STRIDE, STACK_SIZE
from proximity.kernels.nodes import (
    boxes_of,
    child_at,
    corner_at,
    corners_of_block,
    is_used,
    lower_at,
    upper_at,
)
from proximity.kernels.ray.edge_contact import EDGE_CREASED, edge_ray, has_corner, kind_of_edge, lies_on
from proximity.kernels.ray.walk import hits_in_block, look_along
from proximity.kernels.stack_arrays import stack_i64
from proximity.native import inlined, kernel
from proximity.native.simd import bits, maximum, minimum, narrow, prefetch, splat, splat32, trailing_zeros

MAX_NEAR = 32
"""Maximum blocks listed for one. With more, such as next to long faces, marking all edges as candidates is
faster."""
SURELY_DEEP_SQ, SURELY_FLAT_SQ = 0.25, 4.0
"""Squared depths between which a corner counts as both in a plane and beyond it. The heights here differ by
rounding from those that decide, by a millionth of the depth."""
ALL_EDGES = 7
UNKNOWN = -1
"""Edge bits not yet computed."""


@kernel
def _list_near(words, root, position, stack, near):
    """List the positions of blocks whose boxes overlap that of the child at a position.

    Returns their number, or one more than `MAX_NEAR`.
    """
    low, high = _splat_box(words, position)
    stack[0] = root
    count, waiting = 0, 1
    while waiting:
        waiting -= 1
        node = NODE_STRIDE * stack[waiting]
        met = _overlapping(boxes_of(words, node), low, high)
        while met:
            child = node + trailing_zeros(met)
            met &= met - 1
            reference = child_at(words, child)
            if reference >= 0:
                stack[waiting] = reference
                waiting += 1
                continue
            if count == MAX_NEAR:
                return MAX_NEAR + 1
            near[count] = child
            count += 1
    return count


@inlined
def _splat_box(words, position):
    """Return the corners of the box at a position, in all lanes."""
    return (
        (splat32(lower_at(words, position, 0)), splat32(lower_at(words, position, 1)),
         splat32(lower_at(words, position, 2))),
        (splat32(upper_at(words, position, 0)), splat32(upper_at(words, position, 1)),
         splat32(upper_at(words, position, 2))),
    )  # fmt: skip


@inlined
def _overlapping(boxes, low, high):
    """Return the mask of eight boxes that overlap another."""
    (lx, ly, lz), (ux, uy, uz) = boxes
    return bits(
        (lx <= high[0]) & (ux >= low[0]) & (ly <= high[1]) & (uy >= low[1]) & (lz <= high[2]) & (uz >= low[2])
    )


@inlined
def _boxes_of_faces(reals, base):
    """Return the corners of the boxes of eight faces: the padding of other boxes exceeds their rounding."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners_of_block(reals, base)
    return (
        (narrow(minimum(minimum(ax, bx), cx)), narrow(minimum(minimum(ay, by), cy)),
         narrow(minimum(minimum(az, bz), cz))),
        (narrow(maximum(maximum(ax, bx), cx)), narrow(maximum(maximum(ay, by), cy)),
         narrow(maximum(maximum(az, bz), cz))),
    )  # fmt: skip


@inlined
def _height_over(nx, ny, nz, ax, ay, az, corner):
    """Return the heights of a corner above eight planes, times the lengths of their normals."""
    x, y, z = corner
    return dot(nx, ny, nz, splat(x) - ax, splat(y) - ay, splat(z) - az)


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
def _meeting(reals, position, planes, deep, flat):
    """Return the mask of triangles that a face may cross, and for each corner that of coplanar triangles."""
    (ax, ay, az), (nx, ny, nz) = planes
    h0 = _height_over(nx, ny, nz, ax, ay, az, corner_at(reals, position, 0))
    h1 = _height_over(nx, ny, nz, ax, ay, az, corner_at(reals, position, 1))
    h2 = _height_over(nx, ny, nz, ax, ay, az, corner_at(reals, position, 2))
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
        passed, flats = _meeting(reals, BLOCK_STRIDE * block + slot, planes, deep, flat)
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
    corners, faces, neighbors, slot_faces, reals, words, block, near, count, depth, candidates
):
    """Mark edges of a block's faces that may meet a face in the *count* nearby blocks."""
    creased = stack_i64(LANES)
    for slot in range(LANES):
        face = np.int64(slot_faces[LANES * block + slot])
        creased[slot] = UNKNOWN
        if face >= 0:
            candidates[face] = 0 if count <= MAX_NEAR else _owned_edges(neighbors, face)
    boxes = _boxes_of_faces(reals, BLOCK_STRIDE * block)
    for number in range(count if count <= MAX_NEAR else 0):
        low, high = _splat_box(words, near[number])
        met, other = _overlapping(boxes, low, high), ~child_at(words, near[number])
        if met:
            _compare_blocks(
                corners, faces, neighbors, slot_faces, reals, block, other, met, creased, depth, candidates
            )


@kernel
def note_candidates(corners, faces, neighbors, slot_faces, reals, words, root, depth, candidates):
    """Fill the mask of each face's edges that may meet another face, within *depth*: (F,) uint8.

    The other arguments are those of `self_intersections.passing_faces`.
    """
    stack, inner = stack_i64(STACK_SIZE), stack_i64(STACK_SIZE)
    near = stack_i64(MAX_NEAR)
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
            for slot in range(LANES * ~reference, LANES * ~reference + LANES):
                prefetch(neighbors, 3 * max(np.int64(slot_faces[slot]), 0))
            count = _list_near(words, root, base + lane, stack, near)
            _compare_block(
                corners, faces, neighbors, slot_faces, reals, words, ~reference, near, count, depth,
                candidates,
            )  # fmt: skip
