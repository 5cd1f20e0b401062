"""Faces of a body that pass through, lie on, or are turned by other faces of it.

Where no edge of a surface passes through another face of it, nor lies on one, every piece of surface that
hangs together has the inside on one side throughout. So the curves in which a body meets itself, and a look
at each piece between them, tell over which faces the normal of the nearest one may tell the wrong side. There
the winding number is asked instead, as over folded faces.

A curve in which two plane regions meet is straight, and ends at the rim of one of them. So edges between
faces in one plane need not be looked at, unless others have met something: of a lid that is tessellated into
a fan those would be long, and beside each other.

Source: Möller 1997, "A fast triangle-triangle intersection test": triangles that are not in one plane meet
only where an edge of one passes through the other.
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
"""Faces of a piece of surface that are looked at where the first one is not right; what most say counts."""
MOST_BLOCKS = 512
"""Blocks that are looked at for each face, on average: of usual bodies about six are. Of those where it would
be more, all faces count as passing through others."""


@inlined
def _in_plane(reals, base, px, py, pz, qx, qy, qz, depth):
    """Which of the eight triangles at *base* have both *p* and *q* in their plane: bits."""
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
    """Mark the faces of a block that the edge meets; whether any was met, and blocks looked at, so far."""
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
    """Mark the faces that the edge between two corners passes through or, where it is creased, lies on.

    Returns whether there is any, and how many blocks were looked at.
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
    """Mark every face that meets another; either the flat edges or the others are taken, each once.

    Of each face those edges that are *candidates*, see `edge_candidates`. Returns whether there is any, and
    how many blocks may still be looked at.
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
    """Write the faces that hang together with *first* by faces not seen yet; how many."""
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
    """Whether a face of a piece, and most of some, do not have the outside above and the inside below."""
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
    """Return which slots have faces that meet others, or lie on the wrong side of such, a bit each.

    (blocks,) uint8, and with them the faces next to these. The arguments are those of
    `folded_faces.folded_faces`.
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
        corners, faces, neighbors, slot_faces, tree, candidates, depth, MOST_BLOCKS * len(faces), False,
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
