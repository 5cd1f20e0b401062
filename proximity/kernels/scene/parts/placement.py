"""Validation of the poses of parts, and computation of the boxes that follow from them."""

from math import isfinite

import numpy as np

from proximity.kernels.geometry.box import BOX_MARGIN, round_down, round_up
from proximity.kernels.layout import FRAME, field_at
from proximity.kernels.stack_arrays import reals_of, stack_f64_rows
from proximity.kernels.tree.collapse import clear_box
from proximity.native import entry, inlined, kernel
from proximity.native.simd import lane, load, maximum, minimum

BOX_AT = field_at(FRAME, "box_lower")
MAX_ROTATION_STEPS = 4
"""Maximum number of Newton steps towards the nearest rotation. Each step squares the error."""


@inlined
def _off_exact(matrix):
    """Return how much the rotation of a (4, 4) matrix deviates from orthonormal rows, or inf for nan."""
    off = 0.0
    for i in range(3):
        for j in range(i + 1):
            total = -1.0 if i == j else 0.0
            for k in range(3):
                total += matrix[i, k] * matrix[j, k]
            off = max(off, abs(total)) if isfinite(total) else np.inf
    return off


@inlined
def is_rigid(matrix, tolerance, farthest):
    """Test whether a (4, 4) matrix is a rigid transform.

    *tolerance*: limit of the error of the rotation. *farthest*: limit of each coordinate of the translation.
    """
    is_affine = matrix[3, 0] == 0.0 and matrix[3, 1] == 0.0 and matrix[3, 2] == 0.0 and matrix[3, 3] == 1.0
    for axis in range(3):
        is_affine = is_affine and abs(matrix[axis, 3]) <= farthest
    # `_off_exact` tests that the rows are orthonormal; the triple product excludes reflections.
    x = matrix[0, 1] * matrix[1, 2] - matrix[0, 2] * matrix[1, 1]
    y = matrix[0, 2] * matrix[1, 0] - matrix[0, 0] * matrix[1, 2]
    z = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
    is_right_handed = x * matrix[2, 0] + y * matrix[2, 1] + z * matrix[2, 2] > 0.0
    return is_affine and is_right_handed and _off_exact(matrix) <= tolerance


@entry("float64[:, 4, 4], float64[:, 3], float64[:, 3], float, float, float -> int")
def first_unfit(matrices, velocities, angular_velocities, tolerance, farthest, fastest):
    """Return the first row of an invalid move, or -1 if all are valid.

    *matrices* (K, 4, 4) must be rigid within *tolerance* and translate by at most *farthest*. Velocities (K,
    3), or none (0, 3), must be at most *fastest* along each axis.
    """
    for k in range(len(matrices)):
        is_fit = is_rigid(matrices[k], tolerance, farthest)
        for axis in range(3):
            if len(velocities):
                is_fit = is_fit and abs(velocities[k, axis]) <= fastest
            if len(angular_velocities):
                is_fit = is_fit and abs(angular_velocities[k, axis]) <= fastest
        if not is_fit:
            return k
    return -1


@kernel
def write_pose(frames, row, matrix, rounding):
    """Write a pose into a row. Return whether it differs from the previous one.

    A rotation with an error above *rounding* is replaced by the nearest exact one, by Newton's iteration. One
    step reduces an error of 1e-9 to rounding, and two steps suffice for single precision.
    """
    is_other = False
    for i in range(3):
        is_other = is_other or frames[row].translation[i] != matrix[i, 3]
        for j in range(3):
            is_other = is_other or frames[row].rotation[3 * i + j] != matrix[i, j]
    if not is_other:
        return False
    turn, steps = stack_f64_rows(4, 4), 0
    for i in range(3):
        for j in range(3):
            turn[i, j] = matrix[i, j]
    while _off_exact(turn) > rounding and steps < MAX_ROTATION_STEPS:
        _step_to_rotation(turn)
        steps += 1
    for i in range(3):
        frames[row].translation[i] = matrix[i, 3]
        for j in range(3):
            frames[row].rotation[3 * i + j] = turn[i, j]
    return True


@kernel
def _step_to_rotation(turn):
    """Apply one step of Newton's iteration towards the rotation nearest to a (4, 4) matrix."""
    before = stack_f64_rows(4, 4)
    for i in range(3):
        for j in range(3):
            before[i, j] = turn[i, j]
    for i in range(3):
        for j in range(3):
            value = 1.5 * before[i, j]
            for k in range(3):
                product = 0.0
                for m in range(3):
                    product += before[i, m] * before[k, m]
                value -= 0.5 * product * before[k, j]
            turn[i, j] = value


@entry("Frame[:], Part[:], int")
def update_box(frames, parts, row):
    """Compute the box of a row in the scene's frame from its pose and its own box.

    Whether the pose has a rotation is stored, too.
    """
    is_turned, is_shifted = False, False
    for i in range(3):
        is_shifted = is_shifted or frames[row].translation[i] != 0.0
        for j in range(3):
            is_turned = is_turned or frames[row].rotation[3 * i + j] != (1.0 if i == j else 0.0)
    parts[row].is_turned = is_turned
    for axis in range(3):
        if not is_turned and not is_shifted:
            frames[row].box_lower[axis] = frames[row].own_lower[axis]
            frames[row].box_upper[axis] = frames[row].own_upper[axis]
            continue
        # Relative to the centre, so that a part far from its origin has a tight box.
        middle, half = frames[row].translation[axis], 0.0
        for other in range(3):
            turn = frames[row].rotation[3 * axis + other]
            lower, upper = frames[row].own_lower[other], frames[row].own_upper[other]
            middle += turn * (0.5 * lower + 0.5 * upper)
            half += abs(turn) * (0.5 * upper - 0.5 * lower)
        frames[row].box_lower[axis] = middle - half
        frames[row].box_upper[axis] = middle + half


@entry(
    "Frame[:], Part[:], int64[:], int, int64[:], float64[:, 4, 4], float64[:, 3], float64[:, 3], float -> int"
)
def move_parts(frames, parts, versions, version, rows, matrices, velocities, angular_velocities, rounding):
    """Write poses and velocities of parts. Return the number of parts that became dynamic.

    *rows*: the parts, which get the *version*. With velocities (0, 3), all velocities are zero. A part whose
    pose does not change does not become dynamic.
    """
    freed = 0
    for k in range(len(rows)):
        row = rows[k]
        versions[row] = version
        if write_pose(frames, row, matrices[k], rounding):
            update_box(frames, parts, row)
            freed += not parts[row].is_dynamic
            parts[row].is_dynamic, parts[row].is_fused = 1, 0
        for axis in range(3):
            frames[row].velocity[axis] = velocities[k, axis] if len(velocities) else 0.0
            frames[row].angular_velocity[axis] = (
                angular_velocities[k, axis] if len(angular_velocities) else 0.0
            )
    return freed


@kernel
def box_in_scene(frames, parts, part, box):
    """Write the box of a part in the scene's scaled frame to *box*, (6,) float32.

    The box is widened. It is empty for a hidden part.
    """
    scene = len(parts) - 1
    scale = frames[scene].scale
    for axis in range(3):
        centre = frames[scene].centre[axis]
        box[axis] = round_down((frames[part].box_lower[axis] - centre) * scale) - BOX_MARGIN
        box[axis + 3] = round_up((frames[part].box_upper[axis] - centre) * scale) + BOX_MARGIN
    if parts[part].is_hidden:
        clear_box(box)


@kernel
def update_scene_box(frames, parts):
    """Compute the box of the scene from those of all parts. Return its reach in the scene's local frame.

    With a reach above 1 it does not fit that frame. A single part moves the scene's frame with it, and the
    reach is 0.
    """
    scene = len(parts) - 1
    reach = 0.0
    # The upper corner is stored after the lower one.
    rows = reals_of(frames)
    least = most = load(rows[0], BOX_AT)
    for part in range(1, scene):
        box = load(rows[part], BOX_AT)
        least, most = minimum(least, box), maximum(most, box)
    for axis in range(3):
        lower, upper = lane(least, axis), lane(most, 3 + axis)
        frames[scene].box_lower[axis] = frames[scene].own_lower[axis] = lower
        frames[scene].box_upper[axis] = frames[scene].own_upper[axis] = upper
        if scene == 1:
            frames[scene].centre[axis] = frames[0].centre[axis] + frames[0].translation[axis]
            frames[scene].scale = frames[0].scale
        centre, scale = frames[scene].centre[axis], frames[scene].scale
        reach = max(reach, abs(lower - centre) * scale, abs(upper - centre) * scale)
    return reach if scene > 1 else 0.0


@kernel
def copy_rows(frames, parts, versions, since, to_frames, to_parts):
    """Copy the scene's row, and all rows whose version is above *since*."""
    scene = len(parts) - 1
    for row in range(scene + 1):
        if row == scene or versions[row] > since:
            to_frames[row] = frames[row]
            to_parts[row] = parts[row]
