"""Poses of parts: checked and written, with the boxes that follow from them."""

from math import isfinite

import numpy as np

from proximity.kernels.geometry.box import BOX_MARGIN, round_down, round_up
from proximity.kernels.layout import (
    FRAME_ANGULAR_VELOCITY,
    FRAME_BOX_LOWER,
    FRAME_BOX_UPPER,
    FRAME_CENTRE,
    FRAME_COLUMNS,
    FRAME_OWN_LOWER,
    FRAME_OWN_UPPER,
    FRAME_ROTATION,
    FRAME_SCALE,
    FRAME_TRANSLATION,
    FRAME_VELOCITY,
    LANES,
    PART_COLUMNS,
    PART_IS_DYNAMIC,
    PART_IS_FUSED,
    PART_IS_HIDDEN,
    PART_IS_TURNED,
)
from proximity.kernels.tree.wide_node import clear_box
from proximity.native import entry, inlined, kernel
from proximity.native.simd import lane, load, maximum, minimum, store


@inlined
def _off_exact(matrix):
    """Distance of the rotation in a (4, 4) matrix, times its transpose, from the identity; nan is far."""
    off = 0.0
    for i in range(3):
        for j in range(i + 1):
            total = -1.0 if i == j else 0.0
            for k in range(3):
                total += matrix[i, k] * matrix[j, k]
            off = max(off, abs(total)) if isfinite(total) else np.inf
    return off


@inlined
def _is_rigid(matrix, tolerance, farthest):
    """Whether a (4, 4) matrix turns and shifts, and does nothing else."""
    is_affine = matrix[3, 0] == 0.0 and matrix[3, 1] == 0.0 and matrix[3, 2] == 0.0 and matrix[3, 3] == 1.0
    for axis in range(3):
        is_affine = is_affine and abs(matrix[axis, 3]) <= farthest
    # Rows that are orthonormal: the third is the cross product of the others, or its opposite.
    x = matrix[0, 1] * matrix[1, 2] - matrix[0, 2] * matrix[1, 1]
    y = matrix[0, 2] * matrix[1, 0] - matrix[0, 0] * matrix[1, 2]
    z = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
    is_right_handed = x * matrix[2, 0] + y * matrix[2, 1] + z * matrix[2, 2] > 0.0
    return is_affine and is_right_handed and _off_exact(matrix) <= tolerance


@entry("float64[:, 4, 4], float64[:, 3], float64[:, 3], float, float, float -> int")
def first_unfit(matrices, velocities, angular_velocities, tolerance, farthest, fastest):
    """The first row that cannot be used, or -1.

    *matrices* (K, 4, 4) must be rigid within *tolerance* and shift by no more than *farthest*; velocities
    (K, 3), or none (0, 3), must be no more than *fastest* along each axis.
    """
    for k in range(len(matrices)):
        is_fit = _is_rigid(matrices[k], tolerance, farthest)
        for axis in range(3):
            if len(velocities):
                is_fit = is_fit and abs(velocities[k, axis]) <= fastest
            if len(angular_velocities):
                is_fit = is_fit and abs(angular_velocities[k, axis]) <= fastest
        if not is_fit:
            return k
    return -1


@kernel
def _write_pose(frames, row, matrix, rounding):
    """Write a pose into a row, unless it is there already; whether it was not.

    A rotation that is off by more than *rounding* is replaced by the nearest exact one: one step of Newton's
    iteration, after which nothing but rounding is left of an error of 1e-9.
    """
    is_other = False
    for i in range(3):
        is_other = is_other or frames[row, FRAME_TRANSLATION + i] != matrix[i, 3]
        for j in range(3):
            is_other = is_other or frames[row, FRAME_ROTATION + 3 * i + j] != matrix[i, j]
    if not is_other:
        return False
    is_off = _off_exact(matrix) > rounding
    for i in range(3):
        frames[row, FRAME_TRANSLATION + i] = matrix[i, 3]
        for j in range(3):
            value = matrix[i, j]
            if is_off:
                value = 1.5 * matrix[i, j]
                for k in range(3):
                    product = 0.0
                    for m in range(3):
                        product += matrix[i, m] * matrix[k, m]
                    value -= 0.5 * product * matrix[k, j]
            frames[row, FRAME_ROTATION + 3 * i + j] = value
    return True


@entry("float64[:, :], int64[:, :], int")
def update_box(frames, parts, row):
    """Fill a row's box in the scene's frame, and whether it is turned, from its pose and its own box."""
    is_turned, is_shifted = False, False
    for i in range(3):
        is_shifted = is_shifted or frames[row, FRAME_TRANSLATION + i] != 0.0
        for j in range(3):
            is_turned = is_turned or frames[row, FRAME_ROTATION + 3 * i + j] != (1.0 if i == j else 0.0)
    parts[row, PART_IS_TURNED] = is_turned
    for axis in range(3):
        if not is_turned and not is_shifted:
            frames[row, FRAME_BOX_LOWER + axis] = frames[row, FRAME_OWN_LOWER + axis]
            frames[row, FRAME_BOX_UPPER + axis] = frames[row, FRAME_OWN_UPPER + axis]
            continue
        # Around the middle, so that a part far from its own origin keeps a tight box.
        middle, half = frames[row, FRAME_TRANSLATION + axis], 0.0
        for other in range(3):
            turn = frames[row, FRAME_ROTATION + 3 * axis + other]
            lower, upper = frames[row, FRAME_OWN_LOWER + other], frames[row, FRAME_OWN_UPPER + other]
            middle += turn * (0.5 * lower + 0.5 * upper)
            half += abs(turn) * (0.5 * upper - 0.5 * lower)
        frames[row, FRAME_BOX_LOWER + axis] = middle - half
        frames[row, FRAME_BOX_UPPER + axis] = middle + half


@entry(
    "float64[:, :], int64[:, :], int64[:], int, int64[:], float64[:, 4, 4], float64[:, 3], "
    "float64[:, 3], float -> int",
)
def move_parts(frames, parts, versions, version, rows, matrices, velocities, angular_velocities, rounding):
    """Write poses and velocities of *rows* and mark them with *version*; how many have become dynamic.

    Velocities (0, 3) are zero for all. A part whose pose stays as it is does not become dynamic.
    """
    freed = 0
    for k in range(len(rows)):
        row = rows[k]
        versions[row] = version
        if _write_pose(frames, row, matrices[k], rounding):
            update_box(frames, parts, row)
            freed += not parts[row, PART_IS_DYNAMIC]
            parts[row, PART_IS_DYNAMIC], parts[row, PART_IS_FUSED] = 1, 0
        for axis in range(3):
            frames[row, FRAME_VELOCITY + axis] = velocities[k, axis] if len(velocities) else 0.0
            frames[row, FRAME_ANGULAR_VELOCITY + axis] = (
                angular_velocities[k, axis] if len(angular_velocities) else 0.0
            )
    return freed


@kernel
def box_in_scene(frames, parts, part, box):
    """The box of a part in the scene's scaled frame, (6,) float32, widened; of a hidden part: empty."""
    scene = len(parts) - 1
    scale = frames[scene, FRAME_SCALE]
    for axis in range(3):
        centre = frames[scene, FRAME_CENTRE + axis]
        box[axis] = round_down((frames[part, FRAME_BOX_LOWER + axis] - centre) * scale) - BOX_MARGIN
        box[axis + 3] = round_up((frames[part, FRAME_BOX_UPPER + axis] - centre) * scale) + BOX_MARGIN
    if parts[part, PART_IS_HIDDEN]:
        clear_box(box)


@kernel
def update_scene_box(frames, parts):
    """Fill the box of the scene's row from those of all parts; how far it reaches in the scene's local frame.

    A reach above 1 does not fit that frame. The only part of a scene takes the scene's frame along: 0.
    """
    scene = len(parts) - 1
    reach = 0.0
    # The upper corner follows the lower one.
    least = most = load(frames[0], FRAME_BOX_LOWER)
    for part in range(1, scene):
        box = load(frames[part], FRAME_BOX_LOWER)
        least, most = minimum(least, box), maximum(most, box)
    for axis in range(3):
        lower, upper = lane(least, axis), lane(most, FRAME_BOX_UPPER - FRAME_BOX_LOWER + axis)
        frames[scene, FRAME_BOX_LOWER + axis] = frames[scene, FRAME_OWN_LOWER + axis] = lower
        frames[scene, FRAME_BOX_UPPER + axis] = frames[scene, FRAME_OWN_UPPER + axis] = upper
        if scene == 1:
            frames[scene, FRAME_CENTRE + axis] = (
                frames[0, FRAME_CENTRE + axis] + frames[0, FRAME_TRANSLATION + axis]
            )
            frames[scene, FRAME_SCALE] = frames[0, FRAME_SCALE]
        centre, scale = frames[scene, FRAME_CENTRE + axis], frames[scene, FRAME_SCALE]
        reach = max(reach, abs(lower - centre) * scale, abs(upper - centre) * scale)
    return reach if scene > 1 else 0.0


@kernel
def copy_rows(frames, parts, versions, since, to_frames, to_parts):
    """Copy the rows with a version above *since*, and the scene's."""
    scene = len(parts) - 1
    for row in range(scene + 1):
        if row == scene or versions[row] > since:
            for column in range(0, FRAME_COLUMNS, LANES):
                store(to_frames[row], column, load(frames[row], column))
            for column in range(PART_COLUMNS):
                to_parts[row, column] = parts[row, column]
