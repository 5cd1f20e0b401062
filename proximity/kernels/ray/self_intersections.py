"""Faces of a body that cross, lie on, or are flipped relative to its other faces.

If no edge of a surface crosses or lies on another face of it, the inside is on one side of each connected
component throughout. The self-intersection curves, with a sample of each component between them, so identify
the faces over which the normal of the nearest face may give the wrong side. Over these, as over folded faces,
the winding number decides.

The intersection of two plane regions is straight and ends at the rim of one of them. Edges between coplanar
faces are therefore tested only if other edges intersect a face: in a lid tessellated as a fan they are long
and close to each other.

Source: Möller 1997, "A fast triangle-triangle intersection test": triangles that are not coplanar meet only
where an edge of one crosses the other.
"""

import numpy as np

from proximity.kernels.geometry.triangle import dot
from proximity.kernels.layout import BLOCK_STRIDE, LANES, STACKS_SIZE
from proximity.kernels.ray.edge_candidates import note_candidates, planes_of_block
from proximity.kernels.ray.edge_contact import (
    EDGE_CREASED,
    EDGE_FLAT,
    edge_ray,
    has_corner,
    kind_of_edge,
    lies_on,
    reaches_through,
)
from proximity.kernels.ray.walk import (
    SLAB_MARGIN,
    aim_and_view,
    bound_of_parameter,
    hits_in_block,
    open_boxes,
)
from proximity.kernels.sign.folded_faces import faces_wrong, marked_slots
from proximity.kernels.stack_arrays import stack_f32
from proximity.kernels.thresholds import CONTACT_DEPTH
from proximity.kernels.traverse.depth_first import depth_first, in_blocks
from proximity.native import entry, inlined, kernel
from proximity.native.simd import absolute, bits, splat, splat32, square_root, trailing_zeros

VOTES = 5
"""Faces sampled of each component; the majority counts."""
MAX_BLOCKS = 512
"""Maximum average number of blocks per face: usual bodies need about six. Beyond it all faces count as
crossing."""


@inlined
def _in_plane(reals, base, px, py, pz, qx, qy, qz, depth):
    """Return the mask of the eight triangles at *base* whose planes contain both *p* and *q*."""
    (ax, ay, az), (nx, ny, nz) = planes_of_block(reals, base)
    most = splat(depth) * square_root(dot(nx, ny, nz, nx, ny, nz))
    first = absolute(dot(nx, ny, nz, splat(px) - ax, splat(py) - ay, splat(pz) - az))
    last = absolute(dot(nx, ny, nz, splat(qx) - ax, splat(qy) - ay, splat(qz) - az))
    return bits((first <= most) & (last <= most))


@inlined
def _open_children(words, base, query, reach):
    return open_boxes(words, base, query[0][0], splat32(np.float32(0.0)), reach)


@inlined
def _mark_in_leaf(reals, reference, query, best):
    """Mark the faces of a block that the edge meets; return whether any was met, and the blocks visited."""
    (_, view), (start, end, length, kind, depth), (p, q), (corners, faces, slot_faces, marks) = query
    reach, is_met, blocks = best
    base, first = BLOCK_STRIDE * ~reference, LANES * ~reference
    passed, lain = hits_in_block(reals, base, view, length), 0
    if kind == EDGE_CREASED:
        lain = _in_plane(reals, base, p[0], p[1], p[2], q[0], q[1], q[2], depth)
    met = passed | lain
    while met:
        lane = trailing_zeros(met)
        met &= met - 1
        face = slot_faces[first + lane]
        shared = has_corner(faces, face, start) + has_corner(faces, face, end)
        if (lain >> lane) & 1:
            is_on = shared < 2 and lies_on(corners, faces, face, start, end, depth)
        else:
            is_on = shared == 0 and reaches_through(corners, faces, face, start, end, depth)
        if is_on:
            marks[face] = is_met = True
    return reach, is_met, blocks + 1


_walk_edge = depth_first(_open_children, in_blocks(_mark_in_leaf))


@kernel
def _mark_met(corners, faces, slot_faces, tree, start, end, kind, depth, stacks, marks):
    """Mark the faces that the edge between two corners crosses or, if creased, lies on.

    Returns whether there is any, and the number of blocks visited.
    """
    reals, words, root = tree
    ox, oy, oz, dx, dy, dz, length = edge_ray(corners, start, end)
    if not length * max(abs(dx), abs(dy), abs(dz)) > depth:
        return False, np.int64(0)
    query = (
        aim_and_view(ox, oy, oz, dx, dy, dz, SLAB_MARGIN),
        (start, end, length, kind, depth),
        ((ox, oy, oz), (ox + length * dx, oy + length * dy, oz + length * dz)),
        (corners, faces, slot_faces, marks),
    )
    best = bound_of_parameter(length, 0.0), False, np.int64(0)
    _, is_met, blocks = _walk_edge((reals, words), root, 0, query, best, stacks)
    return is_met, blocks


@kernel
def _mark_meeting(
    corners, faces, neighbors, slot_faces, tree, candidates, depth, blocks_left, are_flat, stacks, marks
):
    """Mark every face that meets another, from either the flat edges or the others, each once.

    Tests the *candidates* of each face, see `edge_candidates`. Returns whether there is any, and the
    remaining number of blocks.
    """
    is_any = False
    for face in range(len(faces)):
        for k in range(3):
            other = neighbors[face, k]
            if 0 <= other < face or not (candidates[face] >> k) & 1:
                continue
            kind = kind_of_edge(corners, faces, face, other, depth)
            if (kind == EDGE_FLAT) != are_flat:
                continue
            start, end = faces[face, k], faces[face, (k + 1) % 3]
            is_met, blocks = _mark_met(
                corners, faces, slot_faces, tree, start, end, kind, depth, stacks, marks
            )
            blocks_left -= blocks
            if is_met:
                is_any = marks[face] = True
                if other >= 0:
                    marks[other] = True
        if blocks_left < 0:
            marks[:] = True
            return False, blocks_left
    return is_any, blocks_left


@kernel
def _gather_piece(neighbors, first, is_seen, piece):
    """Write the faces connected with *first* by unseen faces to *piece*; return their number."""
    piece[0], count, at = first, 1, 0
    is_seen[first] = True
    while at < count:
        face = piece[at]
        at += 1
        for k in range(3):
            other = neighbors[face, k]
            if other >= 0 and not is_seen[other]:
                is_seen[other] = True
                piece[count] = other
                count += 1
    return count


@kernel
def _is_turned(corners, faces, piece, count, reals, words, root, moments):
    """Test whether most sampled faces of a piece lack the outside above or the inside below."""
    votes = min(VOTES, count)
    against = 0
    for vote in range(votes):
        face = piece[(2 * vote + 1) * count // (2 * votes)]
        against += faces_wrong(corners, faces, face, reals, words, root, moments)
        if against == 0:
            return False
    return 2 * against > votes


@entry(
    "float64[:, 3], int32[:, 3], int32[:, 3], int32[:], float64[:], float32[:], int, int -> uint8[:]",
    makes_arrays=True,
)
def passing_faces(corners, faces, neighbors, slot_faces, reals, words, root, moments):
    """Return the mask of slots whose faces cross others, or are on the wrong side of crossing faces.

    (blocks,) uint8; neighbours are included. The arguments are those of `folded_faces.folded_faces`.
    """
    marks, depth = np.zeros(len(faces), np.bool_), 0.0
    for axis in range(3):
        low, high = corners[0, axis], corners[0, axis]
        for corner in range(len(corners)):
            low, high = min(low, corners[corner, axis]), max(high, corners[corner, axis])
        depth = max(depth, CONTACT_DEPTH * (high - low))
    stacks, candidates, tree = stack_f32(STACKS_SIZE), np.empty(len(faces), np.uint8), (reals, words, root)
    note_candidates(corners, faces, neighbors, slot_faces, reals, words, root, depth, candidates)
    is_any, blocks_left = _mark_meeting(
        corners, faces, neighbors, slot_faces, tree, candidates, depth, MAX_BLOCKS * len(faces), False,
        stacks, marks,
    )  # fmt: skip
    if is_any:
        _mark_meeting(
            corners, faces, neighbors, slot_faces, tree, candidates, depth, blocks_left, True, stacks, marks
        )
    is_seen, piece = marks.copy(), np.empty(len(faces), np.int64)
    for face in range(len(faces)):
        if not is_seen[face]:
            count = _gather_piece(neighbors, face, is_seen, piece)
            if _is_turned(corners, faces, piece, count, reals, words, root, moments):
                for k in range(count):
                    marks[piece[k]] = True
    return marked_slots(marks, neighbors, slot_faces)
