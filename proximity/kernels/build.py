"""Boxes to tree: an eight-wide bounding volume hierarchy by binned surface area heuristic.

A node starts as one run of faces; the run with the largest box is split in two until the node has eight
children or every run fits a leaf. So the wide tree is made directly, without a binary one before it.
Faces are moved within one array of numbers; a leaf is a run of at most eight of them.

Source: Wald 2007, "On fast construction of SAH-based bounding volume hierarchies" (bins); Wald, Benthin,
Boulos 2008, "Getting rid of packets" (wide nodes by repeatedly opening the largest child).
"""

import numpy as np

from proximity.kernels.box import BOX_MARGIN, round_down, round_up
from proximity.kernels.compiling import inlined, kernel, maker
from proximity.kernels.layout import BLOCK_STRIDE, CHILDREN, LANES, MAX_DEPTH, NO_FACE, NODE_STRIDE

BIN_COUNT = 16
BALANCED_DEPTH = MAX_DEPTH - 16
"""From this level on runs are halved by count: sixteen more levels, each at least four-fold, end any mesh."""


@kernel
def face_boxes(vertices, faces, lower, upper):
    """Fill float32 boxes (F, 3) that contain each face with a margin; rounded outward."""
    for face in range(len(faces)):
        for axis in range(3):
            a = vertices[faces[face, 0], axis]
            b = vertices[faces[face, 1], axis]
            c = vertices[faces[face, 2], axis]
            lower[face, axis] = round_down(min(a, b, c)) - BOX_MARGIN
            upper[face, axis] = round_up(max(a, b, c)) + BOX_MARGIN


@inlined
def _half_area(box):
    """Half the surface of the box (lower xyz, upper xyz)."""
    dx, dy, dz = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return dx * (dy + dz) + dy * dz


@inlined
def _clear(box):
    for axis in range(3):
        box[axis] = np.inf
        box[axis + 3] = -np.inf


@inlined
def _grow(box, lower, upper, face):
    for axis in range(3):
        box[axis] = min(box[axis], lower[face, axis])
        box[axis + 3] = max(box[axis + 3], upper[face, axis])


@inlined
def _grow_by_box(box, other):
    for axis in range(3):
        box[axis] = min(box[axis], other[axis])
        box[axis + 3] = max(box[axis + 3], other[axis + 3])


@kernel
def _run_box(order, first, count, lower, upper, box):
    """The box of a run of faces."""
    _clear(box)
    for position in range(first, first + count):
        _grow(box, lower, upper, order[position])


@kernel
def _split(order, first, count, lower, upper, bin_boxes, bin_counts, centre_box, right_costs):
    """Reorder a run so that its first part and its rest make good children; return the first part's length.

    The cost of a side is its surface times the blocks it fills. Where all centroids coincide, or no plane
    separates anything, the run is cut in the middle.
    """
    for axis in range(3):
        centre_box[axis] = np.inf
        centre_box[axis + 3] = -np.inf
    for position in range(first, first + count):
        face = order[position]
        for axis in range(3):
            centre = lower[face, axis] + upper[face, axis]
            centre_box[axis] = min(centre_box[axis], centre)
            centre_box[axis + 3] = max(centre_box[axis + 3], centre)

    for axis in range(3):
        for b in range(BIN_COUNT):
            bin_counts[axis, b] = 0
            _clear(bin_boxes[axis, b])
    scale_x = _bin_scale(centre_box, 0)
    scale_y = _bin_scale(centre_box, 1)
    scale_z = _bin_scale(centre_box, 2)
    for position in range(first, first + count):
        face = order[position]
        b = _bin(lower, upper, face, 0, centre_box[0], scale_x)
        bin_counts[0, b] += 1
        _grow(bin_boxes[0, b], lower, upper, face)
        b = _bin(lower, upper, face, 1, centre_box[1], scale_y)
        bin_counts[1, b] += 1
        _grow(bin_boxes[1, b], lower, upper, face)
        b = _bin(lower, upper, face, 2, centre_box[2], scale_z)
        bin_counts[2, b] += 1
        _grow(bin_boxes[2, b], lower, upper, face)

    best_cost = np.float32(np.inf)
    best_axis = -1
    best_bin = 0
    box = centre_box[6:12]
    for axis in range(3):
        if not centre_box[axis + 3] > centre_box[axis]:
            continue
        _clear(box)
        number = 0
        for b in range(BIN_COUNT - 1, 0, -1):
            number += bin_counts[axis, b]
            _grow_by_box(box, bin_boxes[axis, b])
            right_costs[b] = _half_area(box) * ((number + 7) // 8) if number else np.inf
        _clear(box)
        number = 0
        for b in range(BIN_COUNT - 1):
            number += bin_counts[axis, b]
            _grow_by_box(box, bin_boxes[axis, b])
            if number == 0:
                continue
            cost = _half_area(box) * ((number + 7) // 8) + right_costs[b + 1]
            if cost < best_cost:
                best_cost, best_axis, best_bin = cost, axis, b
    if best_axis < 0:
        return count // 2

    scale = scale_x if best_axis == 0 else (scale_y if best_axis == 1 else scale_z)
    left = first
    right = first + count - 1
    while left <= right:
        face = order[left]
        if _bin(lower, upper, face, best_axis, centre_box[best_axis], scale) <= best_bin:
            left += 1
        else:
            order[left] = order[right]
            order[right] = face
            right -= 1
    return left - first


@inlined
def _bin_scale(centre_box, axis):
    extent = centre_box[axis + 3] - centre_box[axis]
    return np.float32(BIN_COUNT * 0.9999) / extent if extent > 0.0 else np.float32(0.0)


@inlined
def _bin(lower, upper, face, axis, start, scale):
    return min(np.int32((lower[face, axis] + upper[face, axis] - start) * scale), BIN_COUNT - 1)


@maker
def build_tree(lower, upper):
    """Return nodes (float32, flat), the face order (int32) and each block's first position (int32).

    *lower*, *upper* are (F, 3) float32 boxes of faces, F >= 1. Child references lie in the nodes as int32
    bits; see `layout`.
    """
    count = len(lower)
    order = np.arange(count).astype(np.int32)
    capacity = max(16, count // 16)
    nodes = np.empty(capacity * NODE_STRIDE, np.float32)
    block_capacity = max(16, count // 4)
    block_first = np.empty(block_capacity + 1, np.int32)
    block_count = 0
    node_count = 0

    bin_boxes = np.empty((3, BIN_COUNT, 6), np.float32)
    bin_counts = np.empty((3, BIN_COUNT), np.int32)
    centre_box = np.empty(12, np.float32)
    right_costs = np.empty(BIN_COUNT, np.float32)
    run_first = np.empty(LANES, np.int64)
    run_count = np.empty(LANES, np.int64)
    run_box = np.empty((LANES, 6), np.float32)
    # Waiting runs: first, count, depth, and where in the nodes the reference to them belongs.
    waiting = np.empty((MAX_DEPTH * LANES, 4), np.int64)
    waiting[0] = (0, count, 0, -1)
    waiting_count = 1
    while waiting_count:
        waiting_count -= 1
        first, number, depth, reference_at = waiting[waiting_count]
        if number <= LANES and reference_at >= 0:
            if block_count == block_capacity:
                block_capacity *= 2
                grown = np.empty(block_capacity + 1, np.int32)
                grown[:block_count] = block_first[:block_count]
                block_first = grown
            nodes.view(np.int32)[reference_at] = ~block_count
            block_first[block_count] = first
            block_count += 1
            continue

        # Open the run with the largest box until there are eight, or none is too long for a leaf.
        run_first[0], run_count[0], runs = first, number, 1
        _run_box(order, first, number, lower, upper, run_box[0])
        while runs < LANES:
            largest = -1
            largest_size = -1.0
            for run in range(runs):
                size = np.float64(_half_area(run_box[run]))
                if depth >= BALANCED_DEPTH:
                    size = np.float64(run_count[run])
                is_longer = size == largest_size and run_count[run] > run_count[largest]
                if run_count[run] > LANES and (size > largest_size or is_longer):
                    largest, largest_size = run, size
            if largest < 0:
                break
            start, length = run_first[largest], run_count[largest]
            if depth >= BALANCED_DEPTH:
                left = length // 2
            else:
                left = _split(
                    order, start, length, lower, upper, bin_boxes, bin_counts, centre_box, right_costs
                )
            # The new run goes next to its other half: runs, and so blocks, stay in the order of faces.
            for run in range(runs, largest + 1, -1):
                run_first[run], run_count[run] = run_first[run - 1], run_count[run - 1]
                run_box[run] = run_box[run - 1]
            run_count[largest] = left
            run_first[largest + 1], run_count[largest + 1] = start + left, length - left
            _run_box(order, start, left, lower, upper, run_box[largest])
            _run_box(order, start + left, length - left, lower, upper, run_box[largest + 1])
            runs += 1

        if node_count == capacity:
            capacity *= 2
            grown_nodes = np.empty(capacity * NODE_STRIDE, np.float32)
            grown_nodes[: node_count * NODE_STRIDE] = nodes[: node_count * NODE_STRIDE]
            nodes = grown_nodes
        base = node_count * NODE_STRIDE
        if reference_at >= 0:
            nodes.view(np.int32)[reference_at] = node_count
        node_count += 1
        for k in range(NODE_STRIDE):
            nodes[base + k] = 0.0
        for run in range(LANES):
            for axis in range(3):
                nodes[base + 8 * axis + run] = run_box[run, axis] if run < runs else np.inf
                nodes[base + 24 + 8 * axis + run] = run_box[run, axis + 3] if run < runs else -np.inf
        # Last in, first out: the first run is done next, and lies next in memory.
        for run in range(runs - 1, -1, -1):
            waiting[waiting_count] = (
                run_first[run],
                run_count[run],
                depth + 1,
                base + CHILDREN + run,
            )
            waiting_count += 1
    block_first[block_count] = count
    return nodes[: node_count * NODE_STRIDE].copy(), order, block_first[: block_count + 1].copy()


@kernel
def fill_blocks(vertices, faces, order, block_first, blocks, face_of_slot):
    """Put the corners of every leaf's faces into eight-lane blocks; unused lanes are NaN."""
    for block in range(len(block_first) - 1):
        first = block_first[block]
        number = block_first[block + 1] - first
        for lane in range(LANES):
            slot = LANES * block + lane
            base = BLOCK_STRIDE * block + lane
            if lane >= number:
                face_of_slot[slot] = NO_FACE
                for k in range(9):
                    blocks[base + 8 * k] = np.nan
                continue
            face = order[first + lane]
            face_of_slot[slot] = face
            for corner in range(3):
                for axis in range(3):
                    blocks[base + 8 * (3 * corner + axis)] = vertices[faces[face, corner], axis]
