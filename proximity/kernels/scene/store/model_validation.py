"""Validation of a model from a file. Every index is checked before a traversal follows it.

A traversal checks no bounds, and its stack is large enough only for trees of limited depth. Every reference
is therefore validated once, here. The number of a child must be above its parent's, every node and every leaf
must be reached once, and no tree may be deeper than `DEEPEST`, so that every traversal ends. The ends of the
arrays of each part have been validated before: they are within the arrays and do not overlap.

Each function returns the kind of the first defect, or `SOUND`, and fills *fault* (int64, `FAULT_SIZE`) with
the part and up to three numbers for its message.
"""

import numpy as np

from proximity.kernels.geometry.box import FAR
from proximity.kernels.geometry.frames import part_of_slot
from proximity.kernels.layout import (
    ALL_LANES,
    BLOCK_STRIDE,
    CELLS_PER_WORD,
    ENTRY,
    FOLDED_AT,
    LANES,
    MAX_DEPTH,
    MOMENT_STRIDE,
    NO_FACE,
    NO_GRID,
    NODE_STRIDE,
    ORIENTED_STRIDE,
)
from proximity.kernels.nodes import child_at, lower_along, upper_along
from proximity.kernels.traverse.ignored_parts import part_of_node
from proximity.native import entry, inlined, kernel
from proximity.native.simd import absolute, bits, load, load_int, splat, splat32

DEEPEST = MAX_DEPTH // 2
"""Maximum number of levels of a part's tree, and of the static tree above it. Both together fit the stack."""
MAX_LOCAL = 1.0 + 2.0**-40
"""Bound of local coordinates and of components of unit normals, which is 1 plus rounding."""
MIN_NEIGHBOR = -2
"""Smallest number that marks a missing neighbour."""
FAULT_SIZE = 4

(
    SOUND, BAD_BOX, BAD_CHILD_NODE, BAD_CHILD_BLOCK, TOO_DEEP, NOT_REACHED, NOT_IN_A_ROW, BAD_NOTE,
    BAD_SLOT, FACE_TWICE, FACE_MISSING, BAD_TRIANGLE, BAD_CORNER_ID, BAD_NEIGHBOR, BAD_CORNER, BAD_NORMAL,
    BAD_MOMENT, BAD_CELL, BAD_SCENE_CHILD, COVERED_TWICE, NOT_COVERED, BAD_VERTEX_ID, BAD_CORNER_ORDER,
    BAD_VERTEX, BAD_LIST, BAD_LISTED_PART, BAD_ORIENTED_BOX,
) = range(27)  # fmt: skip


@inlined
def note_fault(fault, kind, part, first, second, third):
    fault[0], fault[1], fault[2], fault[3] = part, first, second, third
    return kind


@inlined
def _lanes(words, base):
    """Return two masks of the lanes of the node at word *base*: lanes with a valid box, and empty lanes."""
    used, unused = np.int64(ALL_LANES), np.int64(ALL_LANES)
    for axis in range(3):
        lower, upper = lower_along(words, base, axis), upper_along(words, base, axis)
        is_near = (lower >= splat32(np.float32(-FAR))) & (upper <= splat32(np.float32(FAR)))
        used &= bits(is_near & (lower <= upper))
        unused &= bits((lower == splat32(np.float32(np.inf))) & (upper == splat32(np.float32(-np.inf))))
    return used, unused


@entry("float32[:], Part[:], int32[:], int32[:], int32[:], uint8[:], int64[:] -> int")
def fault_in_trees(words, parts, firsts, counts, levels, reached, fault):
    """Validate the trees of all parts.

    *firsts*, *counts* receive the first block and the number of blocks below each node. *levels*: (N,) int32,
    scratch memory. *reached*: (B,) uint8, zeros.
    """
    for part in range(len(parts) - 1):
        kind = _fault_in_tree(words, parts, part, firsts, counts, levels, reached, fault)
        if kind != SOUND:
            return kind
    return SOUND


@kernel
def _fault_in_tree(words, parts, part, firsts, counts, levels, reached, fault):
    root, end = parts[part].root, parts[part].root + parts[part].node_count
    first_block = parts[part].first_block
    last_block = first_block + parts[part].block_count - 1
    # Reverse order: children are visited before their parent.
    inner = np.int64(0)
    for node in range(end - 1, root - 1, -1):
        base = NODE_STRIDE * node
        used, unused = _lanes(words, base)
        if used | unused != ALL_LANES:
            return note_fault(fault, BAD_BOX, part, node - root, 0, 0)
        first, last, count, level = np.int64(2**62), np.int64(-1), np.int64(0), np.int64(0)
        for lane in range(LANES):
            if not (used >> lane) & 1:
                continue
            child = child_at(words, base + lane)
            if child >= 0:
                # Negative: the child already has a parent.
                if not node < child < end or levels[child] < 0:
                    return note_fault(fault, BAD_CHILD_NODE, part, lane, node - root, child - root)
                first = min(first, np.int64(firsts[child]))
                last = max(last, np.int64(firsts[child]) + counts[child] - 1)
                count += counts[child]
                level = max(level, np.int64(levels[child]))
                levels[child] = -levels[child]
                inner += 1
            else:
                block = ~child
                if not first_block <= block <= last_block or reached[block]:
                    return note_fault(fault, BAD_CHILD_BLOCK, part, lane, node - root, block - first_block)
                reached[block] = 1
                first, last, count = min(first, block), max(last, block), count + 1
        if count == 0 or level >= DEEPEST:
            return note_fault(fault, TOO_DEEP if count else NOT_REACHED, part, node - root, DEEPEST, 0)
        if last - first + 1 != count:
            return note_fault(fault, NOT_IN_A_ROW, part, node - root, 0, 0)
        firsts[node], counts[node], levels[node] = first, count, level + 1
    if inner != end - root - 1 or counts[root] != parts[part].block_count:
        return note_fault(fault, NOT_REACHED, part, 0, 0, 0)
    return SOUND


@entry("float64[:], float32[:], Part[:], uint8[:], int64[:] -> int")
def fault_in_parts(reals, words, parts, seen, fault):
    """Validate the slots, faces, corners, moments and sign grids of all parts.

    *seen*: (F,) uint8, scratch memory, for the largest number of faces of a part.
    """
    for part in range(len(parts) - 1):
        for face in range(parts[part].face_count):
            seen[face] = 0
        kind = _fault_in_slots(reals, words, parts, part, seen, fault)
        if kind == SOUND:
            kind = _fault_in_faces(words, parts, part, fault)
        if kind == SOUND:
            kind = _fault_in_corners(reals, parts, part, fault)
        if kind == SOUND:
            kind = _fault_in_moments(words, parts, part, fault)
        if kind == SOUND:
            kind = _fault_in_grid(words, parts, part, fault)
        if kind != SOUND:
            return kind
    return SOUND


@inlined
def _is_box_near(words, at):
    """Test whether all numbers of an oriented box are finite and in the range of a local frame."""
    far = splat32(np.float32(FAR))
    return bits((absolute(load(words, at)) <= far) & (absolute(load(words, at + LANES)) <= far)) == ALL_LANES


@kernel
def _fault_in_slots(reals, words, parts, part, seen, fault):
    """Check that every face is in one slot, and that each lane has the triangle of its face.

    A lane without a face must have NaN.
    """
    first, face_count = parts[part].first_block, parts[part].face_count
    found = np.int64(0)
    for block in range(first, first + parts[part].block_count):
        if load_int(words, parts[part].block_notes + block) & (2**FOLDED_AT - 1) != part:
            return note_fault(fault, BAD_NOTE, part, block - first, 0, 0)
        used = np.int64(0)
        for lane in range(LANES):
            face = load_int(words, parts[part].slot_faces + LANES * block + lane)
            if face == NO_FACE:
                continue
            if not 0 <= face < face_count:
                return note_fault(fault, BAD_SLOT, part, LANES * (block - first) + lane, face, face_count)
            if seen[face]:
                return note_fault(fault, FACE_TWICE, part, LANES * (block - first) + lane, face, 0)
            seen[face] = 1
            found += 1
            used |= np.int64(1) << lane
        base = BLOCK_STRIDE * block
        row = load(reals, base)
        is_near, is_number = absolute(row) <= splat(MAX_LOCAL), row == row
        for k in range(8, BLOCK_STRIDE, LANES):
            row = load(reals, base + k)
            is_near = is_near & (absolute(row) <= splat(MAX_LOCAL))
            is_number = is_number | (row == row)
        if bits(is_near) != used or bits(is_number) != used:
            return note_fault(fault, BAD_TRIANGLE, part, block - first, 0, 0)
        if not _is_box_near(words, parts[part].block_boxes + ORIENTED_STRIDE * block):
            return note_fault(fault, BAD_ORIENTED_BOX, part, block - first, 0, 0)
    if found != face_count:
        return note_fault(fault, FACE_MISSING, part, found, face_count, 0)
    return SOUND


@kernel
def _fault_in_faces(words, parts, part, fault):
    corner_count, face_count = parts[part].corner_count, parts[part].face_count
    for k in range(3 * face_count):
        corner, neighbor = (
            load_int(words, parts[part].faces + k),
            load_int(words, parts[part].neighbors + k),
        )
        if not 0 <= corner < corner_count:
            return note_fault(fault, BAD_CORNER_ID, part, k // 3, corner, corner_count)
        if not MIN_NEIGHBOR <= neighbor < face_count:
            return note_fault(fault, BAD_NEIGHBOR, part, k // 3, neighbor, face_count)
    return SOUND


@kernel
def _fault_in_corners(reals, parts, part, fault):
    for k in range(3 * parts[part].corner_count):
        if not abs(reals[parts[part].corners + k]) <= MAX_LOCAL:
            return note_fault(fault, BAD_CORNER, part, k // 3, 0, 0)
        if not abs(reals[parts[part].corner_normals + k]) <= MAX_LOCAL:
            return note_fault(fault, BAD_NORMAL, part, k // 3, 0, 0)
    return SOUND


@kernel
def _fault_in_moments(words, parts, part, fault):
    root = parts[part].root
    for node in range(root, root + parts[part].node_count):
        at = parts[part].moments + MOMENT_STRIDE * node
        finite = np.int64(ALL_LANES)
        for k in range(0, MOMENT_STRIDE, LANES):
            finite &= bits(absolute(load(words, at + k)) < splat32(np.float32(np.inf)))
        if finite != ALL_LANES:
            return note_fault(fault, BAD_MOMENT, part, node - root, 0, 0)
    return SOUND


@kernel
def _fault_in_grid(words, parts, part, fault):
    """Check that no cell has the unknown state, which has both bits set."""
    at = parts[part].grid
    if at == NO_GRID:
        return SOUND
    cells = parts[part].grid_x * parts[part].grid_y * parts[part].grid_z
    for k in range((cells + CELLS_PER_WORD - 1) // CELLS_PER_WORD):
        word = load_int(words, at + k)
        if word & (word >> 1) & 0x55555555:
            return note_fault(fault, BAD_CELL, part, CELLS_PER_WORD * k, 0, 0)
    return SOUND


@entry("float32[:], Part[:], int64[:] -> int")
def fault_in_lists(words, parts, fault):
    """Validate the lists of the grid over the scene. They are the last array in *words*."""
    scene = len(parts) - 1
    base = parts[scene].grid
    cells = parts[scene].grid_x * parts[scene].grid_y * parts[scene].grid_z
    if cells == 0:
        return SOUND
    size, last = len(words) - base, cells + 1
    for cell in range(cells):
        first, end = load_int(words, base + cell), load_int(words, base + cell + 1)
        if first != last or not first <= end <= size:
            return note_fault(fault, BAD_LIST, scene, cell, 0, 0)
        before, last = np.int64(-1), end
        for at in range(first, end):
            part = load_int(words, base + at)
            if not before < part < scene:
                return note_fault(fault, BAD_LISTED_PART, scene, cell, part, scene)
            before = part
    return SOUND


@inlined
def _root_of_child(words, parts, reference):
    """Return the part and the reference of a leaf of the static tree.

    The part is -1 if the reference is invalid.
    """
    scene = len(parts) - 1
    if reference >= 0:
        is_node = reference < parts[scene].first_node
        return part_of_node(parts, reference) if is_node else np.int64(-1), reference
    number = ~reference
    if number < ENTRY:
        end = parts[scene - 1].first_block + parts[scene - 1].block_count
        return part_of_slot(words, parts, LANES * number) if number < end else np.int64(-1), reference
    if number - ENTRY >= parts[scene].entry_count:
        return np.int64(-1), reference
    at = parts[scene].entries + 2 * (number - ENTRY)
    part, reference = np.int64(load_int(words, at)), np.int64(load_int(words, at + 1))
    if not 0 <= part < scene:
        return np.int64(-1), reference
    node, block = reference - parts[part].root, ~reference - parts[part].first_block
    is_own = 0 <= node < parts[part].node_count if reference >= 0 else 0 <= block < parts[part].block_count
    return part if is_own else np.int64(-1), reference


@entry("float32[:], Part[:], int32[:], int32[:], int32[:], uint8[:], int64[:] -> int")
def fault_in_static_tree(words, parts, firsts, counts, levels, covered, fault):
    """Validate the tree over static parts. Each of their blocks must be below it exactly once.

    *firsts*, *counts*: from `fault_in_trees`. *levels*: (N,), *covered*: (B,), zeros, for N nodes and B
    blocks.
    """
    scene = len(parts) - 1
    root = parts[scene].static_root
    node_count = len(levels) if root >= 0 else 0
    if node_count:
        levels[0] = 1
    for node in range(node_count):
        base = NODE_STRIDE * (root + node)
        used, unused = _lanes(words, base)
        if used | unused != ALL_LANES:
            return note_fault(fault, BAD_BOX, scene, node, 0, 0)
        if used and (levels[node] == 0 or levels[node] > DEEPEST):
            return note_fault(fault, TOO_DEEP if levels[node] else NOT_REACHED, scene, node, DEEPEST, 0)
        for lane in range(LANES):
            if not (used >> lane) & 1:
                continue
            reference = np.int64(child_at(words, base + lane))
            if root <= reference < root + node_count:
                child = reference - root
                if child <= node or levels[child]:
                    return note_fault(fault, BAD_SCENE_CHILD, scene, lane, node, reference)
                levels[child] = levels[node] + 1
                continue
            part, start = _root_of_child(words, parts, reference)
            if part < 0 or parts[part].is_dynamic or parts[part].is_hidden:
                return note_fault(fault, BAD_SCENE_CHILD, scene, lane, node, reference)
            if ~reference < ENTRY and not parts[part].is_fused:
                return note_fault(fault, BAD_SCENE_CHILD, scene, lane, node, reference)
            first, count = (firsts[start], counts[start]) if start >= 0 else (np.int32(~start), np.int32(1))
            for block in range(first, first + count):
                if covered[block]:
                    return note_fault(fault, COVERED_TWICE, part, lane, node, 0)
                covered[block] = 1
    return _fault_in_cover(parts, covered, fault)


@kernel
def _fault_in_cover(parts, covered, fault):
    for part in range(len(parts) - 1):
        if parts[part].is_dynamic or parts[part].is_hidden:
            continue
        first = parts[part].first_block
        for block in range(first, first + parts[part].block_count):
            if not covered[block]:
                return note_fault(fault, NOT_COVERED, part, block - first, 0, 0)
    return SOUND


@entry("float32[:], Part[:], int, float64[:, 3], int32[:, 3], float, int32[:], int64[:] -> int")
def fault_in_mesh(words, parts, part, vertices, faces, largest, corners, fault):
    """Compare the faces of a part with those of its source mesh.

    *vertices*: (V, 3) float64, *faces*: (F, 3) int32. Vertices at one position are one corner, and corners
    are numbered in the order of their first vertices, because deformation depends on it. *corners*: (V,)
    int32, scratch memory.
    """
    vertex_count, faces_at = len(vertices), parts[part].faces
    for vertex in range(vertex_count):
        corners[vertex] = -1
    for face in range(len(faces)):
        for k in range(3):
            vertex = np.int64(faces[face, k])
            if not 0 <= vertex < vertex_count:
                return note_fault(fault, BAD_VERTEX_ID, part, face, vertex, vertex_count)
            corner = load_int(words, faces_at + 3 * face + k)
            if corners[vertex] >= 0 and corners[vertex] != corner:
                return note_fault(fault, BAD_CORNER_ORDER, part, vertex, corner, 0)
            corners[vertex] = corner
    known = np.int64(0)
    for vertex in range(vertex_count):
        corner = np.int64(corners[vertex])
        if corner > known:
            return note_fault(fault, BAD_CORNER_ORDER, part, vertex, corner, 0)
        known += corner == known
        for axis in range(3):
            if corner >= 0 and not abs(vertices[vertex, axis]) <= largest:
                return note_fault(fault, BAD_VERTEX, part, vertex, 0, 0)
    if known != parts[part].corner_count:
        return note_fault(fault, BAD_CORNER_ORDER, part, vertex_count, known, 0)
    return SOUND
