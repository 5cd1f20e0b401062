"""The nearest parts of a point: for each part its own closest point, the smallest signed distances first.

Parts that contain the point are found first, by the lists of `part_grid`. The walk over the tree of parts
then searches each subtree for a closer surface of its part: closer than the one already known, or than the
last part of a full list. In sorted batches a search starts from the faces found for the previous point.
"""

from typing import NamedTuple

import numpy as np

from proximity.kernels.answers import (
    POINT_ANSWER_BARYCENTRIC,
    POINT_ANSWER_FACE,
    POINT_ANSWER_FEATURE,
    POINT_ANSWER_GRADIENT,
    POINT_ANSWER_IS_SIGNED,
    POINT_ANSWER_PART,
    POINT_ANSWER_POINT,
    POINT_ANSWER_SIGNED_DISTANCE,
    POINT_ANSWER_WIDTH,
)
from proximity.kernels.geometry.box import bound_of, lanes_of_point, node_bounds_sq
from proximity.kernels.geometry.frames import can_be_asked, is_alone, to_local, to_scene, turn_to_scene
from proximity.kernels.layout import (
    CELL_OUTSIDE,
    ENTRY,
    NO_ROW,
    NO_SLOT,
    NODE_STRIDE,
    SIGN_NONE,
    STACK_SIZE,
    ModelArrays,
)
from proximity.kernels.point.answer_rows import SHORTEST_ARM
from proximity.kernels.point.walk import NOTHING_SEEN, best_of_block, closest_in_part
from proximity.kernels.scene.inside.chunk_tables import POINT_CHUNK, new_workspace, reset_recent
from proximity.kernels.scene.inside.containment import depth_in_part, state_in_part
from proximity.kernels.scene.inside.part_grid import containing_bits, lowest_part, sought, turns_of
from proximity.kernels.scene.queries.point_queries import (
    fetch_row,
    limit_of,
    reach_sq,
    row_of,
    write_nothing,
)
from proximity.kernels.sign.side import closest_of_slot, signed_of_slot
from proximity.kernels.traverse.depth_first import SCENE_STACKS, to_nearest
from proximity.kernels.traverse.ignored_parts import part_of_child
from proximity.native import entry, inlined, kernel
from proximity.native.simd import bits, load_int, splat32


class NearestParts(NamedTuple):
    """The nearest parts of a point found so far, in ascending order of the key, then of the part."""

    keys: np.ndarray  # (K,) float64, squared distance, scene's scaled frame; negative: of a depth
    slots: np.ndarray  # (K, 2) int64, part, and slot of its nearest triangle


@entry(
    ModelArrays,
    "float64[:, 3], int64[:], float64[:], float64[:], int64[:, 2], float64[:, 12] -> int",
)
def closest_parts_batch(model, points, order, limits, keys, slots, answers):
    """Fill answers, K rows a point, columns as in `answers`. *limits*, m: (1,) or (N,).

    *keys* (S,), *slots* (S, 2): scratch for as many parts as are reported for a point, at most K.
    """
    _, _, frames, parts = model
    choices, workspace, nearest = answers.view(np.int32), new_workspace(), NearestParts(keys, slots)
    reset_recent(workspace)
    rows, count = len(answers) // max(len(points), 1), np.int64(0)
    for i in range(len(order) if len(order) else len(points)):
        row = row_of(order, i)
        fetch_row(points, order, i + POINT_CHUNK)
        point, limit = (points[row, 0], points[row, 1], points[row, 2]), limit_of(limits, row)
        if not can_be_asked(frames, parts, point[0], point[1], point[2]):
            for k in range(rows):
                write_nothing(answers, choices, rows * row + k, np.nan)
            continue
        count = _find_parts(model, point, limit, nearest, count if len(order) else np.int64(0), workspace)
        for k in range(count):
            _write_part(model, point, limit, nearest, k, workspace.closest[0], answers, rows * row)
        for k in range(count, rows):
            write_nothing(answers, choices, rows * row + k, np.inf)
    return NO_ROW


@kernel
def _find_parts(model, point, limit, nearest, known, workspace):
    """Fill the nearest parts of a point, and return their number.

    The first *known* entries are of another point: their triangles are upper bounds.
    """
    reals, _, frames, parts = model
    scene, count = len(parts) - 1, np.int64(0)
    limit_sq = reach_sq(limit * frames[scene].scale)
    for k in range(known):
        part, slot = nearest.slots[k, 0], nearest.slots[k, 1]
        px, py, pz = to_local(frames, parts, part, point[0], point[1], point[2])
        known_sq, slot = best_of_block(reals, slot, px, py, pz)
        known_sq /= _ratio_sq(frames, part)
        if known_sq <= limit_sq:
            count = _insert(nearest, count, count, known_sq, part, slot)
    search = sought(model, point)
    for turn in range(turns_of(parts, search)):
        containing, at = containing_bits(model, search, turn, point)
        while containing:
            part = lowest_part(model, at, containing)
            containing &= containing - 1
            p = to_local(frames, parts, part, point[0], point[1], point[2])
            state = state_in_part(model, part, p)
            if state != CELL_OUTSIDE:
                depth_sq, slot = depth_in_part(model, part, p, state, workspace)
                if slot >= 0:
                    depth = abs(signed_of_slot(model, part, slot, p, workspace.closest[0]))
                    if depth / frames[part].scale <= limit:
                        at_part, key = _position_of(nearest, count, part), -depth_sq / _ratio_sq(frames, part)
                        count = _insert(nearest, count, at_part, key, part, slot)
    return _walk(model, point, limit_sq, nearest, count, workspace.stacks)


@inlined
def _ratio_sq(frames, part):
    """Return the squared length, in the frame of a part, of the scene's scaled unit."""
    ratio = frames[part].scale / frames[len(frames) - 1].scale
    return ratio * ratio


@inlined
def _position_of(nearest, count, part):
    """Return the position of a part in the list, or *count*."""
    at = np.int64(0)
    while at < count and nearest.slots[at, 0] != part:
        at += 1
    return at


@inlined
def _is_before(key, part, other_key, other):
    """Test the order of two entries. Ties go to the lower part."""
    return key < other_key or (key == other_key and part < other)


@kernel
def _insert(nearest, count, at, key, part, slot):
    """Insert a part, or replace its entry at position *at* < *count* by a smaller key; return the count.

    A full list loses its last entry, or stays if that one is smaller.
    """
    keys, slots = nearest
    if at == len(keys):
        at -= 1
        if not _is_before(key, part, keys[at], slots[at, 0]):
            return count
    count = max(count, at + 1)
    while at > 0 and _is_before(key, part, keys[at - 1], slots[at - 1, 0]):
        keys[at], slots[at, 0], slots[at, 1] = keys[at - 1], slots[at - 1, 0], slots[at - 1, 1]
        at -= 1
    keys[at], slots[at, 0], slots[at, 1] = key, part, slot
    return count


@inlined
def _reach(nearest, count, limit_sq):
    """Return the squared distance within which another part would be reported; negative: none."""
    return min(nearest.keys[count - 1], limit_sq) if count == len(nearest.keys) else limit_sq


@kernel
def _walk(model, point, limit_sq, nearest, count, stacks):
    """Update the list by all surfaces that are near enough, and return the count."""
    reals, words, frames, parts = model
    scene = len(parts) - 1
    if is_alone(parts):
        return _search_subtree(model, np.int64(0), parts[0].root, point, limit_sq, nearest, count, stacks)
    x, y, z = to_local(frames, parts, scene, point[0], point[1], point[2])
    lanes, at, reference = lanes_of_point(x, y, z), SCENE_STACKS, parts[scene].root
    while _reach(nearest, count, limit_sq) >= 0.0:
        reach = bound_of(_reach(nearest, count, limit_sq), lanes[2])
        if reference >= parts[scene].first_node:
            base = NODE_STRIDE * reference
            bounds = node_bounds_sq(words, base, lanes)
            is_open = bounds <= splat32(reach)
            if bits(is_open):
                reference, at = to_nearest(reals, words, base, bounds, bounds, is_open, stacks, at)
                continue
        else:
            entries, start = parts[scene].entries, np.int64(reference)
            part = part_of_child(words, parts, reference, entries)
            if reference < 0 and ~reference >= ENTRY:
                start = np.int64(load_int(words, entries + 2 * (~reference - ENTRY) + 1))
            if not parts[part].is_hidden:
                count = _search_subtree(model, part, start, point, limit_sq, nearest, count, stacks)
                reach = bound_of(_reach(nearest, count, limit_sq), lanes[2])
        at -= 1
        while at >= SCENE_STACKS and not stacks[at] <= reach:
            at -= 1
        if at < SCENE_STACKS:
            break
        reference = load_int(stacks, at + STACK_SIZE)
    return count


@kernel
def _search_subtree(model, part, start, point, limit_sq, nearest, count, stacks):
    """Update the entry of a part by the subtree *start* of its tree, and return the count."""
    _, _, frames, parts = model
    at, slot = _position_of(nearest, count, part), np.int64(NO_SLOT)
    best_sq, ratio_sq = _reach(nearest, count, limit_sq), _ratio_sq(frames, part)
    if at < count:
        best_sq, slot = nearest.keys[at], nearest.slots[at, 1]
    if best_sq < 0.0:
        return count  # its depth is known
    p = to_local(frames, parts, part, point[0], point[1], point[2])
    found_sq, found = closest_in_part(model, part, start, p, best_sq * ratio_sq, slot, NOTHING_SEEN, stacks)
    return count if found == slot else _insert(nearest, count, at, found_sq / ratio_sq, part, found)


@kernel
def _write_answer(frames, parts, part, face, feature, inside, closest, limit, answers, choices, row):
    """Write the result for a closest feature, in the scene's frame."""
    length = closest.length
    distance = length / frames[part].scale
    if not distance <= limit:
        write_nothing(answers, choices, row, np.inf)
        return
    answers[row, POINT_ANSWER_SIGNED_DISTANCE] = -distance if inside else distance
    for k in range(3):
        answers[row, POINT_ANSWER_BARYCENTRIC + k] = closest.weights[k]
    to_scene(frames, parts, part, closest.point, 0, closest.point, 0)
    for axis in range(3):
        answers[row, POINT_ANSWER_POINT + axis] = closest.point[axis]
    # A shorter connection has no usable direction; the pseudo-normal stays, as on the surface.
    if length > SHORTEST_ARM:
        factor = -1.0 / length if inside else 1.0 / length
        for axis in range(3):
            closest.normal[axis] = closest.arm[axis] * factor
    turn_to_scene(frames, parts, part, closest.normal, 0, closest.normal, 0)
    for axis in range(3):
        answers[row, POINT_ANSWER_GRADIENT + axis] = closest.normal[axis]
    choices[row, POINT_ANSWER_PART] = part
    choices[row, POINT_ANSWER_FACE] = face
    choices[row, POINT_ANSWER_FEATURE] = feature
    choices[row, POINT_ANSWER_IS_SIGNED] = parts[part].sign != SIGN_NONE


@kernel
def _write_part(model, point, limit, nearest, k, closest, answers, first):
    """Write the answer of the *k*-th part, and sort it into the rows from *first* on, by signed distance.

    Distances differ from the keys by rounding.
    """
    _, _, frames, parts = model
    choices, words, row = answers.view(np.int32), answers.view(np.int64), first + k
    part, slot = nearest.slots[k, 0], nearest.slots[k, 1]
    p = to_local(frames, parts, part, point[0], point[1], point[2])
    face, feature, inside = closest_of_slot(model, part, slot, p, closest)
    inside = inside or nearest.keys[k] < 0.0
    _write_answer(frames, parts, part, face, feature, inside, closest, limit, answers, choices, row)
    while row > first and _is_before(
        answers[row, POINT_ANSWER_SIGNED_DISTANCE],
        choices[row, POINT_ANSWER_PART],
        answers[row - 1, POINT_ANSWER_SIGNED_DISTANCE],
        choices[row - 1, POINT_ANSWER_PART],
    ):
        for column in range(POINT_ANSWER_WIDTH):
            word = words[row, column]
            words[row, column] = words[row - 1, column]
            words[row - 1, column] = word
        row -= 1
