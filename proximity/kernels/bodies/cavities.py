"""Nesting of closed shells: which shells bound the same body, and how they are oriented.

A shell with material inside has a positive volume, a cavity a negative one. The sign of a shell is compared
with that of the enclosing shell, so that a hollow body exported inside out is flipped as a whole. A shell
with the same orientation as the body around it is a separate body (an insert, or a part that overlaps
another): the file contains no other information. A shell with small holes counts as closed.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from proximity.kernels.geometry.local_frame import frame_of_box
from proximity.kernels.geometry.rows import copy_numbers
from proximity.kernels.layout import BLOCK_STRIDE, BOX_STRIDE, FACES_SHIFT, LANES, MOMENT_STRIDE, NODE_STRIDE
from proximity.kernels.mesh.edges import sort_run
from proximity.kernels.mesh.faces import shell_boxes
from proximity.kernels.sign.winding_number import fill_moments, winding_number
from proximity.kernels.tree.builder import build_tree, face_boxes, fill_blocks
from proximity.native import allocating_kernel, kernel

NEARLY_CLOSED = 0.8
"""Minimum share of a shell's area on which the winding number must be clear on both sides.

If the share is smaller, a shell with holes has no inside. The limit is lower than for a sign, so that
cavities are considered in every outer shell that has a sign.
"""
UNCLEAR_TURNS = 0.1
"""Largest difference between a clear winding number and an integer."""
SAMPLE_COUNT = 64
"""Number of samples on both sides of a shell with holes. They are distributed by area."""
VOTE_COUNT = 5
"""Number of faces that decide whether a shell is inside another."""
BESIDE = 2.0**-20
"""Distance of samples on both sides of a face, relative to the size of the shell.

For a face that lies on another shell, one sample is inside and one is outside, so that the other faces
decide.
"""


class Shells(NamedTuple):
    """P shells of K faces."""

    points: np.ndarray  # (C, 3) float64
    corners: np.ndarray  # (K, 3) int32, rows of points
    order: np.ndarray  # (K,) int32, faces, grouped by shell
    starts: np.ndarray  # (P + 1,) int64, offsets in order
    boxes: np.ndarray  # (P, 6) float64, lower and upper bounds


class ShellTree(NamedTuple):
    """The tree of one shell, for computing its winding number."""

    centre: np.ndarray  # (3,) float64, of the local frame
    scale: float
    blocks: np.ndarray  # float64
    words: np.ndarray  # float32, nodes and then moments
    moments: int  # their offset in words


@allocating_kernel
def nest_shells(points, corners, labels, volumes, is_closed):
    """Return the shell whose body each shell belongs to, (P,), and whether each shell is flipped, (P,) bool.

    *points*: (C, 3). *corners*: (K, 3), the corners of each face as rows of *points*; each closed shell is
    oriented consistently. *labels*: (K,), the shell of each face, 0 .. P - 1; every shell has a face.
    *volumes*: (P,), signed, in any unit. *is_closed*: (P,), False for shells with holes. A shell without a
    volume, or with holes and without an inside, is a separate body and is never flipped.
    """
    count, is_any_negative = len(volumes), False
    body, is_turned = np.empty(count, np.int64), np.zeros(count, np.bool_)
    for shell in range(count):
        body[shell] = shell
        is_any_negative |= volumes[shell] < 0.0
    if not is_any_negative:
        return body, is_turned
    starts, order = rows_by_label(labels, count)
    shells = Shells(points, corners, order, starts, shell_boxes(points, corners, labels, count))
    sizes, sides = np.empty(count), np.empty(count, np.int64)
    for shell in range(count):
        sizes[shell], sides[shell] = abs(volumes[shell]), np.int64(np.sign(volumes[shell]))
    for shell in range(count):
        is_uncertain = not is_closed[shell] and sides[shell] != 0
        if is_uncertain and (sides[shell] < 0 or _is_nested(shells.boxes, sizes, shell)):
            sides[shell] = _clear_side(shells, shell)
    for shell in range(count):
        sizes[shell] = sizes[shell] if sides[shell] != 0 else 0.0
    rising, is_cavity = _rows_by_size(sizes), np.zeros(count, np.bool_)
    around = _smallest_around(shells, sizes, rising)
    # Largest first: a shell comes after those around it.
    for position in range(count - 1, -1, -1):
        shell = rising[position]
        outer = around[shell]
        if outer >= 0 and not is_cavity[outer] and sides[shell] != sides[outer]:
            is_cavity[shell], body[shell], is_turned[shell] = True, outer, is_turned[outer]
        else:
            is_turned[shell] = sides[shell] < 0
    return body, is_turned


@allocating_kernel
def rows_by_label(labels, count):
    """Group rows by their labels, 0 to *count* - 1.

    Return where each group starts, (count + 1,) int64, and the rows group by group, (K,) int32.
    """
    starts, order = np.zeros(count + 1, np.int64), np.empty(len(labels), np.int32)
    for row in range(len(labels)):
        starts[labels[row] + 1] += 1
    for label in range(count):
        starts[label + 1] += starts[label]
    ends = starts.copy()
    for row in range(len(labels)):
        order[ends[labels[row]]] = row
        ends[labels[row]] += 1
    return starts, order


@allocating_kernel
def _rows_by_size(sizes):
    """Return the rows of *sizes* (P,) in ascending order of size. Equal sizes keep their order."""
    count = len(sizes)
    keys, rows = sizes.copy(), np.empty(count, np.int32)
    for row in range(count):
        rows[row] = row
    sort_run(keys, rows, 0, count, np.empty(count), np.empty(count, np.int32))
    return rows


@kernel
def _is_within(boxes, inner, outer):
    """Test whether the boxes of two shells permit one to be inside the other."""
    for axis in range(3):
        if boxes[outer, axis] > boxes[inner, axis] or boxes[outer, 3 + axis] < boxes[inner, 3 + axis]:
            return False
    return True


@kernel
def _is_nested(boxes, sizes, shell):
    """Test whether the boxes permit a shell to be inside another one, or to enclose one."""
    for other in range(len(sizes)):
        is_other = other != shell and sizes[other] > 0.0
        if is_other and (_is_within(boxes, shell, other) or _is_within(boxes, other, shell)):
            return True
    return False


@allocating_kernel
def _smallest_around(shells, sizes, rising):
    """Return the smallest larger shell that encloses each shell, (P,) int64, or -1 if there is none.

    A shell of size 0 encloses none. Each tree is built once, and only if boxes permit nesting.
    """
    around, smaller_count = np.full(len(sizes), -1, np.int64), 0
    for position in range(len(sizes)):
        outer = rising[position]
        while sizes[rising[smaller_count]] < sizes[outer]:
            smaller_count += 1
        inner_count = 0
        for n in range(smaller_count):
            shell = rising[n]
            inner_count += sizes[shell] > 0.0 and around[shell] < 0 and _is_within(shells.boxes, shell, outer)
        if inner_count > 0:
            tree = _tree_of(shells, outer)
            for n in range(smaller_count):
                shell = rising[n]
                if sizes[shell] > 0.0 and around[shell] < 0 and _is_within(shells.boxes, shell, outer):
                    around[shell] = outer if _is_voted_within(shells, shell, tree) else -1
    return around


@kernel
def _is_voted_within(shells, shell, tree):
    """Test whether most samples next to some faces of a shell are inside another shell.

    *tree*: the tree of the other shell.
    """
    first, count = shells.starts[shell], shells.starts[shell + 1] - shells.starts[shell]
    total, sampled, last = 0.0, 0, -1
    for vote in range(VOTE_COUNT):
        chosen = np.int64(vote * ((count - 1) / (VOTE_COUNT - 1.0))) if vote < VOTE_COUNT - 1 else count - 1
        if chosen != last:
            above, below = _turns_beside(shells, shell, shells.order[first + chosen], tree)
            total += min(abs(above), 1.0) + min(abs(below), 1.0)
            sampled, last = sampled + 2, chosen
    return total > 0.5 * sampled


@allocating_kernel
def _clear_side(shells, shell):
    """Return on which side of its faces a shell with holes has its inside: 1 below, -1 above, 0 neither."""
    first, end = shells.starts[shell], shells.starts[shell + 1]
    reached, total = np.empty(end - first), 0.0
    for n in range(end - first):
        (nx, ny, nz), _ = _normal_and_middle(shells, shells.order[first + n])
        total += sqrt(nx * nx + ny * ny + nz * nz)
        reached[n] = total
    tree = _tree_of(shells, shell)
    outward, inward, n = 0, 0, 0
    for sample in range(SAMPLE_COUNT):
        while reached[n] < (sample + 0.5) / SAMPLE_COUNT * total:
            n += 1
        above, below = _turns_beside(shells, shell, shells.order[first + n], tree)
        whole_above, whole_below = np.rint(above), np.rint(below)
        if max(abs(above - whole_above), abs(below - whole_below)) < UNCLEAR_TURNS:
            outward += whole_below == 1.0 and whole_above == 0.0
            inward += whole_above == -1.0 and whole_below == 0.0
    if outward >= NEARLY_CLOSED * SAMPLE_COUNT:
        return 1
    return -1 if inward >= NEARLY_CLOSED * SAMPLE_COUNT else 0


@kernel
def _normal_and_middle(shells, face):
    """Return the centroid of a face, and its normal with a length of twice the area."""
    points = shells.points
    a, b, c = shells.corners[face, 0], shells.corners[face, 1], shells.corners[face, 2]
    ax, ay, az = points[a, 0], points[a, 1], points[a, 2]
    bx, by, bz = points[b, 0], points[b, 1], points[b, 2]
    cx, cy, cz = points[c, 0], points[c, 1], points[c, 2]
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    normal = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return normal, ((ax + bx + cx) / 3.0, (ay + by + cy) / 3.0, (az + bz + cz) / 3.0)


@kernel
def _turns_beside(shells, shell, face, tree):
    """Return the winding numbers of a tree's shell just above and just below a face of *shell*."""
    (nx, ny, nz), (x, y, z) = _normal_and_middle(shells, face)
    length, extent = sqrt(nx * nx + ny * ny + nz * nz), 0.0
    for axis in range(3):
        extent = max(extent, shells.boxes[shell, 3 + axis] - shells.boxes[shell, axis])
    length = length if length > 0.0 else 1.0
    step = BESIDE * extent
    dx, dy, dz = step * nx / length, step * ny / length, step * nz / length
    return _turns_at(tree, x + dx, y + dy, z + dz), _turns_at(tree, x - dx, y - dy, z - dz)


@kernel
def _turns_at(tree, x, y, z):
    centre, scale = tree.centre, tree.scale
    x, y, z = (x - centre[0]) * scale, (y - centre[1]) * scale, (z - centre[2]) * scale
    return winding_number(tree.blocks, tree.words, 0, tree.moments, x, y, z)


@allocating_kernel
def _tree_of(shells, shell):
    first, count = shells.starts[shell], shells.starts[shell + 1] - shells.starts[shell]
    centre, local, faces = np.empty(3), np.empty((3 * count, 3)), np.empty((count, 3), np.int32)
    scale = frame_of_box(shells.boxes[shell, :3], shells.boxes[shell, 3:], centre)
    for n in range(count):
        for k in range(3):
            faces[n, k] = 3 * n + k
            corner = shells.corners[shells.order[first + n], k]
            for axis in range(3):
                local[3 * n + k, axis] = (shells.points[corner, axis] - centre[axis]) * scale
    boxes = np.empty(BOX_STRIDE * count, np.float32)
    face_boxes(local, faces, boxes)
    nodes, order, block_first = build_tree(boxes, FACES_SHIFT)
    block_count, node_count = len(block_first) - 1, len(nodes) // NODE_STRIDE
    blocks, slot_faces = np.empty(BLOCK_STRIDE * block_count), np.empty(LANES * block_count, np.int32)
    fill_blocks(local, faces, order, block_first, blocks, slot_faces)
    words = np.empty(node_count * (NODE_STRIDE + MOMENT_STRIDE), np.float32)
    copy_numbers(nodes.view(np.int32), 0, words.view(np.int32), 0, len(nodes))
    fill_moments(nodes, blocks, node_count, words[len(nodes) :])
    return ShellTree(centre, scale, blocks, words, len(nodes))
