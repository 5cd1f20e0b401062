"""Choice of the sign method of a part, which is checked by sampling. See `scene.sign` for the methods.

Source: Bærentzen & Aanæs 2005 (pseudo-normals), Jacobson et al. 2013 (winding numbers).
"""

import numpy as np

from proximity.kernels.layout import (
    FOLDED_AT,
    LANES,
    REASON_AGREES,
    REASON_DISAGREES,
    REASON_MANY_FACES,
    REASON_NO_AREA,
    REASON_OPEN,
    REASON_SMALL_HOLES,
    SIGN_PSEUDONORMAL,
    SIGN_WINDING,
    ModelArrays,
)
from proximity.kernels.part.part_model import open_grid, tables_of
from proximity.kernels.part.sign_samples import FACE_SAMPLE_COUNT, face_samples, surface_samples
from proximity.kernels.ray.self_intersections import passing_faces
from proximity.kernels.scene.queries.point_queries import signed_alone
from proximity.kernels.sign.folded_faces import beside_thin_faces, folded_faces, slots_of
from proximity.kernels.sign.inside_grid import build_grid, grid_words, uncertain_points
from proximity.kernels.sign.winding_number import winding_number
from proximity.kernels.thresholds import CONTACT_DEPTH
from proximity.native import allocating_kernel, entry, kernel

SAMPLE_NEAR, SAMPLE_FAR = 1e-6, 3e-2
"""Distances of samples from the surface, in sizes of the part.

The first is just at the surface. At the second, other faces may be nearer.
"""
CLEAR_TURNS = 0.95
"""Winding number just below an open surface that must be exceeded for it to have an inside."""
CLEAR_SHARE = 0.95
"""Share of the area on which `CLEAR_TURNS` must be exceeded.

A sheet, a hemisphere or a box without its lid fails.
"""
SURFACE_SHARE = 1e-9
"""Distance from the surface, in sizes of the part, within which rounding makes the side arbitrary."""
MAX_UNCLEAR_TURNS = 0.2
"""Largest difference between a winding number and the nearest integer for which the side is defined."""


@entry(ModelArrays, "bool, bool -> int, int, int, int, int, float", makes_arrays=True)
def choose_sign(model, is_watertight, is_balanced):
    """Choose the sign of a part, and write it with its folded faces and its sign grid. Return the reason.

    *model*: filled by `part_model.fill_part`. *is_watertight*: every edge has two faces with opposite
    directions. *is_balanced*: every edge has equal numbers of forward and backward half-edges.

    Six numbers are returned: ``REASON_...``; how many points were compared, and how many of them contradict
    pseudo-normals; how many faces are thin or next to thin ones, and how many others are folded or cross
    others; and the share of the surface below which the winding number is clear.
    """
    reals, words, frames, parts = model
    corners, faces, neighbors, slot_faces = tables_of(model)
    samples, none = surface_samples(corners, faces), np.int64(0)
    if len(samples) == 0:
        return REASON_NO_AREA, none, none, none, none, 0.0
    if is_watertight:
        _fill_grid(model)
        parts[0].sign = SIGN_PSEUDONORMAL
        moments = parts[0].moments
        beside = beside_thin_faces(corners, faces, slot_faces, CONTACT_DEPTH * _size(frames))
        folded = beside | folded_faces(corners, faces, neighbors, slot_faces, reals, words, 0, moments)
        asked, against = _contradictions(model, samples, beside, folded)
        if against == 0:
            folded |= passing_faces(corners, faces, neighbors, slot_faces, reals, words, 0, moments)
            _write_folded(words, parts, folded)
            thin_count = _bit_count(beside)
            return REASON_AGREES, asked, none, thin_count, _bit_count(folded) - thin_count, 0.0
        parts[0].sign = SIGN_WINDING
        _write_folded(words, parts, np.zeros_like(folded))
        return REASON_DISAGREES, asked, against, none, none, 0.0
    if is_balanced:
        _fill_grid(model)
        parts[0].sign = SIGN_WINDING
        return REASON_MANY_FACES, none, none, none, none, 0.0
    share = _clear_share(model, samples)
    if share >= CLEAR_SHARE:
        parts[0].sign = SIGN_WINDING
        return REASON_SMALL_HOLES, none, none, none, none, share
    return REASON_OPEN, none, none, none, none, share


@entry(ModelArrays, "int, bool, int32[:]", makes_arrays=True)
def restore_sign(model, sign, has_grid, folded):
    """Write a sign that is already known. *folded*: the faces near which the winding number decides."""
    _, words, _, parts = model
    _, faces, _, slot_faces = tables_of(model)
    marks = np.zeros(len(faces), np.bool_)
    for face in folded:
        marks[face] = True
    parts[0].sign = sign
    _write_folded(words, parts, slots_of(marks, slot_faces))
    if has_grid:
        _fill_grid(model)


@kernel
def _size(frames):
    """Return the longest side of the part's box in the local frame."""
    extent = 0.0
    for axis in range(3):
        extent = max(extent, frames[0].own_upper[axis] - frames[0].own_lower[axis])
    return extent * frames[0].scale


@allocating_kernel
def _grid_lower(frames):
    lower = np.empty(3)
    for axis in range(3):
        lower[axis] = frames[0].grid_lower[axis]
    return lower


@allocating_kernel
def _fill_grid(model):
    """Classify the cells of the part's sign grid and write them."""
    reals, words, frames, parts = model
    corners, faces, _, _ = tables_of(model)
    open_grid(frames, parts)
    part = parts[0]
    packed = build_grid(
        corners, faces, _grid_lower(frames), frames[0].grid_rate, part.grid_x, part.grid_y, part.grid_z,
        reals, words, 0, part.moments,
    )  # fmt: skip
    cells = words.view(np.uint32)
    for k in range(len(packed)):
        cells[part.grid + k] = packed[k]


@kernel
def _write_folded(words, parts, folded):
    """Write masks of the folded faces into the notes on blocks. *folded*: (blocks,) uint8."""
    numbers = words.view(np.int32)
    for block in range(len(folded)):
        numbers[parts[0].block_notes + block] = np.int64(folded[block]) << FOLDED_AT


@kernel
def _bit_count(marks):
    """Return the number of bits that are set in *marks*."""
    count = np.int64(0)
    for slot in range(LANES * len(marks)):
        count += (marks[slot // LANES] >> (slot % LANES)) & 1
    return count


@allocating_kernel
def _contradictions(model, samples, beside, folded):
    """Return how many points were compared, and at how many of them the two methods disagree about the side.

    *beside*: (blocks,) uint8, the slots with faces next to thin ones. *folded*: (blocks,) uint8, the slots
    that use the winding number.

    Notes
    -----
    A surface without self-intersections has winding number 0 just above it and 1 just below.
    Self-intersection curves divide any other surface into regions, and in some of them this fails everywhere:
    one sample per region suffices. Regions that are some cells wide are found by checking the sign grid next
    to all faces. Regions of small faces are found by sampling the faces next to cells without a side.
    """
    _, words, frames, parts = model
    corners, faces, _, slot_faces = tables_of(model)
    part, size, no_sides = parts[0], _size(frames), np.zeros(0, np.bool_)
    uncertain, is_inside, is_clear = uncertain_points(
        corners, faces, _grid_lower(frames), frames[0].grid_rate, part.grid_x, part.grid_y, part.grid_z,
        words[part.grid : part.grid + grid_words(part)].view(np.uint32),
    )  # fmt: skip
    for face in range(len(faces)):
        is_clear[face] = is_clear[face] and len(faces) > FACE_SAMPLE_COUNT
    # Folded faces have already been checked, and use the winding number.
    for slot in range(len(slot_faces)):
        if (folded[slot // LANES] >> (slot % LANES)) & 1:
            is_clear[slot_faces[slot]] = True
    above = _beside_surface(face_samples(corners, faces, is_clear), SAMPLE_NEAR * size)
    asked = 4 * len(samples) + len(above) + len(uncertain)
    # Folds are not left out here, because a surface with many of them intersects itself.
    _write_folded(words, parts, beside)
    against = np.int64(0)
    for offset in (-SAMPLE_NEAR, SAMPLE_NEAR, -SAMPLE_FAR, SAMPLE_FAR):
        against += _differing(model, _beside_surface(samples, offset * size), no_sides)
    _write_folded(words, parts, folded)
    against += _differing(model, above, no_sides) + _differing(model, uncertain, is_inside)
    return asked, against


@allocating_kernel
def _beside_surface(samples, offset):
    """Return the points at a distance above surface samples, (N, 3)."""
    points = np.empty((len(samples), 3))
    for row in range(len(samples)):
        for axis in range(3):
            points[row, axis] = samples[row, axis] + offset * samples[row, 3 + axis]
    return points


@allocating_kernel
def _differing(model, points, is_inside):
    """Count the local points at which the sign of the part's distances differs from the winding number.

    *is_inside*: (N,), sides from the sign grid, or (0,). If given, the winding number is computed only at
    points whose sign contradicts them.
    """
    _, _, frames, _ = model
    world, distances, count, size = np.empty_like(points), np.empty((len(points), 1)), 0, _size(frames)
    scale = frames[0].scale
    for row in range(len(points)):
        for axis in range(3):
            centre = frames[0].centre[axis]
            world[row, axis] = points[row, axis] / scale + centre
            # Far from the origin this rounds; both methods get the rounded point.
            points[row, axis] = (world[row, axis] - centre) * scale
    signed_alone(model, world, distances)
    for row in range(len(points)):
        signed = distances[row, 0]
        if abs(signed) * scale <= SURFACE_SHARE * size or (
            len(is_inside) and is_inside[row] == (signed < 0.0)
        ):
            continue
        turns = _turns(model, points, row)
        is_clear = (
            abs(turns - np.rint(turns)) <= MAX_UNCLEAR_TURNS and abs(turns - 0.5) <= 0.5 + MAX_UNCLEAR_TURNS
        )
        count += not is_clear or (signed < 0.0) != (turns > 0.5)
    return count


@kernel
def _turns(model, points, row):
    """Return the winding number of the part around a local point."""
    reals, words, _, parts = model
    return winding_number(reals, words, 0, parts[0].moments, points[row, 0], points[row, 1], points[row, 2])


@allocating_kernel
def _clear_share(model, samples):
    """Return the share of the area at which the winding number is near 1 just below and near 0 just above."""
    step, clear_count = SAMPLE_NEAR * _size(model.frames), 0
    below, above = _beside_surface(samples, -step), _beside_surface(samples, step)
    for row in range(len(samples)):
        is_below = _turns(model, below, row) > CLEAR_TURNS
        clear_count += is_below and _turns(model, above, row) < 1.0 - CLEAR_TURNS
    return clear_count / len(samples)
