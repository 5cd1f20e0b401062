"""Faces that pass through others of the same body, and those that lie where these put them.

Where no edge of a surface passes through another face of it, every piece of surface that hangs together has
the inside on one side throughout. So the curves in which a body meets itself, and a look at each piece
between them, tell over which faces the normal of the nearest one may tell the wrong side. There the winding
number is asked instead, as over folds.

Not seen: faces of two pieces that lie in one plane and overlap, with no edge that passes through. The
samples of `sign` look for those.

Source: Möller 1997, "A fast triangle-triangle intersection test": triangles that are not in one plane meet
only where an edge of one passes through the other.
"""

from math import frexp, ldexp, sqrt

import numpy as np

from proximity.kernels.compiling import inlined, kernel, maker
from proximity.kernels.descent import NOTHING_WAITS, descend, next_open
from proximity.kernels.folds import faces_wrong, marked_slots
from proximity.kernels.layout import BLOCK_STRIDE, LANES, NODE_STRIDE, STACK_SIZE, STACKS_SIZE
from proximity.kernels.memory import words_here
from proximity.kernels.ray import (
    SLAB_MARGIN,
    aim_and_view,
    bound_of_parameter,
    open_boxes,
    ray_triangle_sides,
)
from proximity.kernels.triangle import cross, dot
from proximity.simd import bits, load, load_int, maximum, minimum, splat, splat32, trailing_zeros

DEPTH = 1e-10
"""How far the ends of an edge must be off a face to both sides, in sizes of the part, for the edge to pass
through: less is contact, give or take rounding. What is thinner is no face."""
VOTES = 5
"""Faces of a piece of surface that are looked at where the first one is not right; what most say counts."""
MOST_BLOCKS = 512
"""Blocks that are looked at for each face, on average: of usual bodies about six are. Of those where it would
be more, all faces count as passing through others."""


@inlined
def _passing(reals, base, view, length):
    """Which of the eight triangles at *base* an edge, up to a little more than its end, passes or touches."""
    axis, px, py, pz, lean_x, lean_y, pace = view
    z = np.int64(axis)
    x, y, z = 8 * ((z + 1) % 3), 8 * ((z + 2) % 3), 8 * z
    u, v, w, height = ray_triangle_sides(
        splat(px), splat(py), splat(pz), splat(lean_x), splat(lean_y),
        load(reals, base + x), load(reals, base + y), load(reals, base + z),
        load(reals, base + 24 + x), load(reals, base + 24 + y), load(reals, base + 24 + z),
        load(reals, base + 48 + x), load(reals, base + 48 + y), load(reals, base + 48 + z),
    )  # fmt: skip
    zero = splat(0.0)
    is_hit = (minimum(u, minimum(v, w)) >= zero) | (maximum(u, maximum(v, w)) <= zero)
    hits = bits(is_hit)
    if hits:
        parameters = height / (u + v + w) * splat(pace)
        hits = bits(is_hit & (parameters >= zero) & (parameters <= splat(length)))
    return hits


@inlined
def _has_corner(faces, face, corner):
    return faces[face, 0] == corner or faces[face, 1] == corner or faces[face, 2] == corner


@kernel
def _reaches_through(corners, faces, face, start, end, depth):
    """Whether an edge that meets a face goes on beyond it, on both sides, by more than contact does."""
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    ax, ay, az = corners[a, 0], corners[a, 1], corners[a, 2]
    bx, by, bz = corners[b, 0] - ax, corners[b, 1] - ay, corners[b, 2] - az
    cx, cy, cz = corners[c, 0] - ax, corners[c, 1] - ay, corners[c, 2] - az
    nx, ny, nz = cross(bx, by, bz, cx, cy, cz)
    longest_sq = max(dot(bx, by, bz, bx, by, bz), dot(cx, cy, cz, cx, cy, cz))
    length_sq = dot(nx, ny, nz, nx, ny, nz)
    if not length_sq > depth * depth * longest_sq:
        return False
    least = depth * sqrt(length_sq)
    first = dot(nx, ny, nz, corners[start, 0] - ax, corners[start, 1] - ay, corners[start, 2] - az)
    last = dot(nx, ny, nz, corners[end, 0] - ax, corners[end, 1] - ay, corners[end, 2] - az)
    return min(first, last) < -least and max(first, last) > least


@kernel
def _mark_passed(corners, faces, slot_faces, reals, words, root, start, end, depth, stacks, marks):
    """Mark the faces that the edge between two corners passes through; whether there is any, and the blocks
    that were looked at."""
    ox, oy, oz = corners[start, 0], corners[start, 1], corners[start, 2]
    dx, dy, dz = corners[end, 0] - ox, corners[end, 1] - oy, corners[end, 2] - oz
    most = max(abs(dx), abs(dy), abs(dz))
    if not most > depth:
        return False, 0
    _, power = frexp(most)
    length, share = ldexp(1.0, power), ldexp(1.0, -power)
    aim, view = aim_and_view(ox, oy, oz, dx * share, dy * share, dz * share, SLAB_MARGIN)
    best32, zero32 = bound_of_parameter(length, 0.0), splat32(np.float32(0.0))
    is_passing, blocks = False, 0
    at, reference = 0, root
    while True:
        if reference >= 0:
            base = NODE_STRIDE * reference
            bounds, is_open = open_boxes(words, base, aim, zero32, best32)
            if bits(is_open):
                reference, at = descend(words, base, bounds, is_open, stacks, at)
                continue
        else:
            blocks += 1
            hits = _passing(reals, BLOCK_STRIDE * ~reference, view, length)
            while hits:
                face = slot_faces[LANES * ~reference + trailing_zeros(hits)]
                hits &= hits - 1
                if _has_corner(faces, face, start) or _has_corner(faces, face, end):
                    continue
                if _reaches_through(corners, faces, face, start, end, depth):
                    marks[face] = is_passing = True
        at = next_open(stacks, 0, at, best32)
        if at == NOTHING_WAITS:
            return is_passing, blocks
        reference = load_int(stacks, at + STACK_SIZE)


@kernel
def _mark_passing(corners, faces, neighbors, slot_faces, reals, words, root, depth, stacks, marks):
    """Mark every face that passes through another, or another through it; every edge is taken once."""
    blocks_left = MOST_BLOCKS * len(faces)
    for face in range(len(faces)):
        for k in range(3):
            other = neighbors[face, k]
            if 0 <= other < face:
                continue
            start, end = faces[face, k], faces[face, (k + 1) % 3]
            is_passing, blocks = _mark_passed(
                corners, faces, slot_faces, reals, words, root, start, end, depth, stacks, marks
            )
            if is_passing:
                marks[face] = True
                if other >= 0:
                    marks[other] = True
            blocks_left -= blocks
        if blocks_left < 0:
            marks[:] = True
            return


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


@maker
def passing_faces(corners, faces, neighbors, slot_faces, reals, words, root, moments):
    """Return which slots have faces that pass through others, or lie on the wrong side of such, a bit each.

    (blocks,) uint8, and with them the faces next to these. The arguments are those of `folds.folded_faces`.
    """
    marks, depth = np.zeros(len(faces), np.bool_), 0.0
    for axis in range(3):
        depth = max(depth, DEPTH * (corners[:, axis].max() - corners[:, axis].min()))
    stacks = words_here(STACKS_SIZE)
    _mark_passing(corners, faces, neighbors, slot_faces, reals, words, root, depth, stacks, marks)
    is_seen, piece = marks.copy(), np.empty(len(faces), np.int64)
    for face in range(len(faces)):
        if not is_seen[face]:
            count = _gather_piece(neighbors, face, is_seen, piece)
            if _is_turned(corners, faces, piece, count, reals, words, root, moments):
                for k in range(count):
                    marks[piece[k]] = True
    return marked_slots(marks, neighbors, slot_faces)
