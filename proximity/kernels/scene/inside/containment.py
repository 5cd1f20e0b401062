"""The parts of a scene that contain a point, and the depth in them.

The signed distance of a scene is the smallest over its parts: exact outside; inside, the part with the
largest depth counts.

A point in an inside cell of a part's sign grid is inside for *certain*. Only parts that may contain it are
then searched, each for its own nearest surface, which saves the longer traversal for the nearest surface of
all parts. For other points the nearest surface is found first, and then the depth in the other parts whose
surface passes through their cell.
"""

from typing import NamedTuple

import numpy as np

from proximity.kernels.geometry.frames import to_local, to_scene
from proximity.kernels.layout import (
    CELL_CROSSED,
    CELL_INSIDE,
    CELL_OUTSIDE,
    CELL_UNKNOWN,
    LANES,
    NO_GRID,
    NO_PART,
    NO_SLOT,
    SIGN_NONE,
    ModelArrays,
)
from proximity.kernels.point.walk import NOTHING_SEEN, best_of_block, closest_in_part
from proximity.kernels.scene.inside.chunk_tables import RECENT_PARTS
from proximity.kernels.scene.inside.part_grid import (
    containing_bits,
    dynamic_bits,
    dynamic_turn_count,
    list_of,
    listed_bits,
    lowest_part,
    sought,
    turns_of,
    turns_of_list,
)
from proximity.kernels.sign.inside_grid import cell_state
from proximity.kernels.sign.side import is_inside_by_winding, signed_of_slot
from proximity.kernels.stack_arrays import stack_f64
from proximity.native import entry, inlined, kernel
from proximity.native.simd import load_int, splat32, trailing_zeros

CLEAR = 2.0**-41
"""Distance, relative to the coordinates, beyond which a point is clear of a surface."""


class Surfaces(NamedTuple):
    """The surfaces of all parts, each searched when it is needed for the first time."""

    faces: np.ndarray  # (2 F,) int32: one of each surface, and space for a search
    ranges: np.ndarray  # (P + 1, 2) int64: first of a part's, and how many; -1: not searched


@inlined
def _state_in_grid(model, part, p):
    """Return the state of the cell of a part's sign grid that contains *p*, local."""
    frame, row = model.frames[part], model.parts[part]
    counts = row.grid_x, row.grid_y, row.grid_z
    return cell_state(model.words, row.grid, frame.grid_lower, frame.grid_rate, counts, p)


@inlined
def state_in_part(model, part, p):
    """Return `CELL_INSIDE`, `CELL_OUTSIDE` or `CELL_CROSSED` (undecided) for *p*, local."""
    if model.parts[part].sign == SIGN_NONE:
        return CELL_OUTSIDE
    if model.parts[part].grid != NO_GRID:
        return _state_in_grid(model, part, p)
    is_inside, _ = is_inside_by_winding(model, part, p)
    return CELL_INSIDE if is_inside else CELL_OUTSIDE


@inlined
def depth_in_part(model, part, p, state, workspace):
    """Return the squared local depth and the slot if *p*, local, is inside *part*; otherwise `NO_SLOT`.

    *state*: `CELL_INSIDE` or `CELL_CROSSED`, from `state_in_part`.
    """
    reals, _, frames, parts = model
    px, py, pz = p
    # A crossed cell usually has the surface within its diagonal, but faces passing next to it may have marked
    # it.
    rate = frames[part].grid_rate
    reach_sq = np.inf if state == CELL_INSIDE else 3.001 / (rate * rate)
    slot, seen = np.int64(NO_SLOT), np.int64(NOTHING_SEEN)
    recent, last = workspace.recent, part % RECENT_PARTS
    if recent[last, 0] == part:
        known_sq, known = best_of_block(reals, recent[last, 1], px, py, pz)
        if known_sq <= reach_sq:
            reach_sq, slot, seen = known_sq, known, ~(known // LANES)
    root, stacks = parts[part].root, workspace.stacks
    found_sq, slot = closest_in_part(model, part, root, p, reach_sq, slot, seen, stacks)
    if slot == NO_SLOT:
        found_sq, slot = closest_in_part(model, part, root, p, np.inf, slot, NOTHING_SEEN, stacks)
    if slot >= 0:
        recent[last, 0], recent[last, 1] = part, slot
        if state == CELL_CROSSED:
            signed = signed_of_slot(model, part, slot, p, workspace.closest[0])
            if not signed < 0.0:
                slot = np.int64(NO_SLOT)
    return found_sq, slot


@kernel
def is_contained(model, point, workspace):
    """Test whether some part contains a point of the scene's frame, (x, y, z)."""
    _, _, frames, parts = model
    x, y, z = point
    search = sought(model, point)
    is_inside = False
    for turn in range(turns_of(parts, search)):
        containing, at = containing_bits(model, search, turn, point)
        while containing and not is_inside:
            part = lowest_part(model, at, containing)
            containing &= containing - 1
            p = to_local(frames, parts, part, x, y, z)
            state = state_in_part(model, part, p)
            is_inside = state == CELL_INSIDE
            if state == CELL_CROSSED:
                _, slot = depth_in_part(model, part, p, state, workspace)
                is_inside = slot >= 0
    return is_inside


@inlined
def note_candidates(model, chunk, candidates):
    """Collect the pairs of a point and a part that may contain it, of the first turn; return their number.

    No pair has the state `CELL_OUTSIDE`.
    """
    _, words, frames, parts = model
    points, rows, count = chunk
    certain, lists, pairs, _ = candidates
    pair_count = 0
    for k in range(count):
        row = rows[k]
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        certain[k] = 0
        lists[k, 0], lists[k, 1] = list_of(words, frames, parts, x, y, z)
        at = lists[k, 0]
        containing = listed_bits(words, frames, parts, at, lists[k, 1], x, y, z)
        while containing:
            part = np.int64(load_int(words, at + trailing_zeros(containing)))
            containing &= containing - 1
            state = np.int64(CELL_UNKNOWN)
            if parts[part].grid != NO_GRID:
                p = to_local(frames, parts, part, x, y, z)
                state = np.int64(_state_in_grid(model, part, p))
            pairs[pair_count, 0], pairs[pair_count, 1], pairs[pair_count, 2] = k, part, state
            # Branchless: the state is unpredictable.
            pair_count += state != CELL_OUTSIDE
            certain[k] |= state == CELL_INSIDE
    return pair_count


@inlined
def deepest_of_certain(model, chunk, candidates, pair_count, found, workspace):
    """Find the part with the largest depth for points that are certainly inside.

    The first *pair_count* pairs are those of `note_candidates`. Pairs of other points are moved to the
    beginning, and their number is returned. Fills nearest, depths and deeper of the certain points, and
    `NO_PART` in deeper of the others.
    """
    certain, pairs = candidates.certain, candidates.pairs
    nearest, depths, deeper, _ = found
    for k in range(chunk.point_count):
        deeper[k, 0], deeper[k, 1] = NO_PART, NO_SLOT
        if certain[k]:
            depths[k] = -1.0
    left = 0
    for i in range(pair_count):
        k, part, state = pairs[i, 0], pairs[i, 1], pairs[i, 2]
        if certain[k]:
            _ask_for_depth(model, chunk, k, part, state, found, workspace)
            nearest[k, 0], nearest[k, 1] = deeper[k, 0], deeper[k, 1]
        else:
            pairs[left, 0], pairs[left, 1], pairs[left, 2] = k, part, state
            left += 1
    return left


@kernel
def deepest_of_chunk(model, chunk, candidates, pair_count, found, workspace):
    """Find the part with the largest depth for points whose nearest surface is known.

    Depths are at least 0 if the nearest part contains the point, or another certainly does. A part with a
    larger depth replaces depth, part and slot. The first *pair_count* pairs are those that
    `deepest_of_certain` has moved to the beginning.

    All points of the chunk take each turn together, which leaves few dependent steps.
    """
    _, words, frames, parts = model
    points, rows, count = chunk
    _, lists, pairs, positions = candidates
    nearest = found.nearest
    scene = len(parts) - 1
    turns, dynamic_turns = np.int64(0), dynamic_turn_count(parts)
    for i in range(pair_count):
        k, part = pairs[i, 0], pairs[i, 1]
        if part != nearest[k, 0]:
            _ask_for_depth(model, chunk, k, part, pairs[i, 2], found, workspace)
    for k in range(count):
        turns = max(turns, turns_of_list(lists[k, 0], lists[k, 1]))
        if dynamic_turns:
            row = rows[k]
            x, y, z = to_local(frames, parts, scene, points[row, 0], points[row, 1], points[row, 2])
            positions[k, 0], positions[k, 1], positions[k, 2] = np.float32(x), np.float32(y), np.float32(z)
    for turn in range(1, turns):
        pair_count = 0
        for k in range(count):
            row = rows[k]
            at = lists[k, 0] + LANES * turn
            containing = listed_bits(
                words, frames, parts, at, lists[k, 1], points[row, 0], points[row, 1], points[row, 2]
            )
            pair_count = _add_pairs(words, at, containing, k, nearest[k, 0], pairs, pair_count)
        _deepest_of_pairs(model, chunk, pairs, pair_count, found, workspace)
    for turn in range(dynamic_turns):
        pair_count = 0
        for k in range(count):
            sx, sy, sz = splat32(positions[k, 0]), splat32(positions[k, 1]), splat32(positions[k, 2])
            containing, at = dynamic_bits(words, parts, turn, sx, sy, sz)
            pair_count = _add_pairs(words, at, containing, k, nearest[k, 0], pairs, pair_count)
        _deepest_of_pairs(model, chunk, pairs, pair_count, found, workspace)


@inlined
def _add_pairs(words, at, containing, k, nearest, pairs, pair_count):
    """Add the pairs of point *k* with parts other than the *nearest*; return the number of pairs."""
    while containing:
        part = np.int64(load_int(words, at + trailing_zeros(containing)))
        containing &= containing - 1
        pairs[pair_count, 0], pairs[pair_count, 1] = k, part
        # Branchless: the comparison is unpredictable.
        pair_count += part != nearest
    return pair_count


@kernel
def _deepest_of_pairs(model, chunk, pairs, pair_count, found, workspace):
    """Update depths from pairs whose cell states are not known; see `deepest_of_chunk`."""
    _, _, frames, parts = model
    points, rows, _ = chunk
    left = 0
    for i in range(pair_count):
        k, part = pairs[i, 0], pairs[i, 1]
        row = rows[k]
        p = to_local(frames, parts, part, points[row, 0], points[row, 1], points[row, 2])
        state = state_in_part(model, part, p)
        pairs[left, 0], pairs[left, 1], pairs[left, 2] = k, part, state
        left += state != CELL_OUTSIDE
    for i in range(left):
        _ask_for_depth(model, chunk, pairs[i, 0], pairs[i, 1], pairs[i, 2], found, workspace)


@inlined
def _ask_for_depth(model, chunk, k, part, state, found, workspace):
    """Update the depth of point *k* if a part contains it more deeply than the present one."""
    _, _, frames, parts = model
    points, rows, _ = chunk
    _, depths, deeper, _ = found
    row = rows[k]
    p = to_local(frames, parts, part, points[row, 0], points[row, 1], points[row, 2])
    if state == CELL_UNKNOWN:
        state = np.int64(state_in_part(model, part, p))
        if state == CELL_OUTSIDE:
            return
    depth_sq, slot = depth_in_part(model, part, p, state, workspace)
    if slot >= 0:
        ratio = frames[part].scale / frames[len(parts) - 1].scale
        depth_sq /= ratio * ratio
        is_lower = depth_sq == depths[k] and deeper[k, 0] != NO_PART and part < deeper[k, 0]
        if depth_sq > depths[k] or is_lower:
            depths[k], deeper[k, 0], deeper[k, 1] = depth_sq, part, slot


# --- parts inside other parts, and their connected surfaces ---


@entry(ModelArrays, "int, int32[:], int32[:] -> int")
def surface_faces(model, part, waiting, faces):
    """Fill the first face of each surface that is connected across edges; return the number of surfaces.

    *waiting*, *faces*: (F,), F faces of the part; *faces* is also the mark of visited faces.
    """
    row = model.parts[part]
    for face in range(row.face_count):
        faces[face] = 0
    count = 0
    for first in range(row.face_count):
        if faces[first]:
            continue
        left, faces[first], waiting[0] = 1, 1, first
        while left:
            left -= 1
            at = row.neighbors + 3 * waiting[left]
            for edge in range(3):
                face = load_int(model.words, at + edge)
                if face >= 0 and not faces[face]:
                    faces[face], waiting[left] = 1, face
                    left += 1
        # All faces up to *first* are marked, and no longer read.
        faces[count] = first + 1
        count += 1
    for k in range(count):
        faces[k] -= 1
    return count


@inlined
def _is_in_box(frame, point):
    """Test whether a point of the scene's frame is in the box of a part."""
    return (
        frame.box_lower[0] <= point[0] <= frame.box_upper[0]
        and frame.box_lower[1] <= point[1] <= frame.box_upper[1]
        and frame.box_lower[2] <= point[2] <= frame.box_upper[2]
    )


@kernel
def is_deep(model, part, p, margin, workspace):
    """Test whether *p*, in a part's local frame, is inside the part by more than *margin*."""
    state = state_in_part(model, part, p)
    if state == CELL_OUTSIDE or (state == CELL_INSIDE and model.parts[part].grid != NO_GRID):
        return state == CELL_INSIDE
    depth_sq, slot = depth_in_part(model, part, p, state, workspace)
    return slot >= 0 and depth_sq > margin * margin


@kernel
def contained_corner(model, part, inner, faces, shift, point, workspace):
    """Test whether a part contains another's surfaces, displaced by *shift*, given that none cross.

    *faces*: one per surface of the other part; one of its corners, or its centroid, must be clear of this
    part's surface. *point*: filled with the one that is inside, (3,) m, scene's frame.
    """
    reals, words, frames, parts = model
    if parts[part].sign == SIGN_NONE:
        return False
    local, middle, margin = stack_f64(3), stack_f64(3), 0.0
    for axis in range(3):
        margin = max(margin, abs(frames[inner].box_lower[axis]), abs(frames[inner].box_upper[axis]))
    margin = CLEAR * (1.0 + margin * frames[part].scale)
    for k in range(len(faces)):
        middle[0] = middle[1] = middle[2] = 0.0
        for number in range(4):
            corner = load_int(words, parts[inner].faces + 3 * faces[k] + number % 3)
            for axis in range(3):
                middle[axis] += reals[parts[inner].corners + 3 * corner + axis] / 3.0 if number < 3 else 0.0
                local[axis] = reals[parts[inner].corners + 3 * corner + axis] if number < 3 else middle[axis]
            to_scene(frames, parts, inner, local, 0, point, 0)
            for axis in range(3):
                point[axis] += shift[axis]
            p = to_local(frames, parts, part, point[0], point[1], point[2])
            if _is_in_box(frames[part], point) and is_deep(model, part, p, margin, workspace):
                return True
    return False


@kernel
def assign_surfaces(parts, surfaces):
    """Assign each part its space in *surfaces*, as many faces as it has; none is filled."""
    start = 0
    for part in range(len(parts)):
        surfaces.ranges[part, 0], surfaces.ranges[part, 1] = start, -1
        start += parts[part].face_count if part < len(parts) - 1 else 0


@kernel
def surface_range(model, part, surfaces):
    """Return the range of one face per surface of a part; the first call searches them."""
    start, count = surfaces.ranges[part, 0], model.parts[part].face_count
    if surfaces.ranges[part, 1] < 0:
        waiting = surfaces.ranges[len(model.parts) - 1, 0]
        surfaces.ranges[part, 1] = surface_faces(
            model, part, surfaces.faces[waiting : waiting + count], surfaces.faces[start : start + count]
        )
    return start, start + surfaces.ranges[part, 1]


@inlined
def surfaces_of_pair(model, first, second, surfaces):
    """Return one face of each surface of two parts, searched at the first call."""
    start, end = surface_range(model, first, surfaces)
    other, other_end = surface_range(model, second, surfaces)
    return surfaces.faces[start:end], surfaces.faces[other:other_end]
