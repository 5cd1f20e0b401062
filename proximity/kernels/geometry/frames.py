"""Transformation of points and directions between the scene's frame and the local frame of a part."""

import numpy as np

from proximity.kernels.layout import FOLDED_AT, FRAME, LANES, field_at
from proximity.kernels.thresholds import MILLIMETRES_FROM, MILLIMETRES_TO
from proximity.native import inlined
from proximity.native.simd import like, load_each, load_int, maximum, minimum

ROTATION_AT, TRANSLATION_AT = field_at(FRAME, "rotation"), field_at(FRAME, "translation")
CENTRE_AT, SCALE_AT = field_at(FRAME, "centre"), field_at(FRAME, "scale")
ROUNDED_UP = 1.0 + 1e-12
ROUNDED_DOWN = 1.0 - 1e-12
"""Factors that cover the rounding of lengths, times and speeds."""
LENGTH_ROUNDING = 1e-13
"""Bound of the rounding error of distances and displacements, both relative and in sizes of the scene."""


FARTHEST_LOCAL = 1e100
"""Limit to which local coordinates are clamped. The direction stays, and the square does not overflow."""


@inlined
def looks_like_millimetres(frames, distance):
    """Test whether a point at this distance, m, may have been given in millimetres."""
    last, size_sq = len(frames) - 1, 0.0
    for axis in range(3):
        edge = frames[last].box_upper[axis] - frames[last].box_lower[axis]
        size_sq += edge * edge
    times_sq = distance * distance
    return (
        distance > 0.0
        and MILLIMETRES_FROM * MILLIMETRES_FROM * size_sq < times_sq
        and times_sq < MILLIMETRES_TO * MILLIMETRES_TO * size_sq
    )


@inlined
def can_be_asked(frames, parts, x, y, z):
    """Test whether a point is finite, and so near that squares of its distances do not overflow."""
    reach = FARTHEST_LOCAL / frames[len(parts) - 1].scale
    return abs(x) <= reach and abs(y) <= reach and abs(z) <= reach


@inlined
def is_alone(parts):
    """Test whether the scene has only one part, which is not hidden. Queries then need no tree over parts."""
    return len(parts) == 2 and not parts[0].is_hidden


@inlined
def ignores_some(parts):
    """Whether rows say of parts that they are hidden which the trees over parts have."""
    return parts[len(parts) - 1].is_hidden != 0


@inlined
def direction_to_local(frames, parts, part, x, y, z):
    """Rotate a direction from the scene's frame to the frame of *part*.

    *x y z*: scalars or vectors of eight.
    """
    if parts[part].is_turned:
        return (
            _along(frames, part, 0, x, y, z),
            _along(frames, part, 1, x, y, z),
            _along(frames, part, 2, x, y, z),
        )
    return x, y, z


@inlined
def _along(frames, part, column, x, y, z):
    turn = frames[part].rotation
    return like(turn[column], x) * x + like(turn[column + 3], y) * y + like(turn[column + 6], z) * z


@inlined
def direction_to_scene(frames, parts, part, x, y, z):
    """Rotate a direction from the frame of *part* to the scene's frame."""
    if parts[part].is_turned:
        turn = frames[part].rotation
        return (
            turn[0] * x + turn[1] * y + turn[2] * z,
            turn[3] * x + turn[4] * y + turn[5] * z,
            turn[6] * x + turn[7] * y + turn[8] * z,
        )
    return x, y, z


@inlined
def turned_by_frames(frame_reals, offsets, at, x, y, z):
    """Rotate eight directions from the parts' frames to the scene's, as `direction_to_scene`."""
    return (
        _along_row(frame_reals, offsets, at, 0, x, y, z),
        _along_row(frame_reals, offsets, at, 3, x, y, z),
        _along_row(frame_reals, offsets, at, 6, x, y, z),
    )


@inlined
def _along_row(frame_reals, offsets, at, row, x, y, z):
    return (
        load_each(frame_reals, offsets, at, ROTATION_AT + row) * x
        + load_each(frame_reals, offsets, at, ROTATION_AT + row + 1) * y
        + load_each(frame_reals, offsets, at, ROTATION_AT + row + 2) * z
    )


@inlined
def to_local(frames, parts, part, x, y, z):
    """Transform a point from the scene's frame to the local frame of *part*.

    *x y z*: scalars or vectors of eight.
    """
    dx = x - like(frames[part].translation[0], x)
    dy = y - like(frames[part].translation[1], y)
    dz = z - like(frames[part].translation[2], z)
    dx, dy, dz = direction_to_local(frames, parts, part, dx, dy, dz)
    scale = like(frames[part].scale, x)
    return (
        _pull_in((dx - like(frames[part].centre[0], x)) * scale),
        _pull_in((dy - like(frames[part].centre[1], y)) * scale),
        _pull_in((dz - like(frames[part].centre[2], z)) * scale),
    )


@inlined
def rounding_at(frames, x, y, z):
    """Return a bound, m, of the rounding error of a distance from a point in the scene's frame."""
    return LENGTH_ROUNDING * (1.0 / frames[len(frames) - 1].scale + abs(x) + abs(y) + abs(z))


@inlined
def _pull_in(value):
    # This order keeps NaN.
    return minimum(like(FARTHEST_LOCAL, value), maximum(like(-FARTHEST_LOCAL, value), value))


@inlined
def turn_to_scene(frames, parts, part, source, at, target, to):
    """Rotate a direction from the part's frame to the scene's frame. Write it to *target* from *to* on."""
    x, y, z = direction_to_scene(frames, parts, part, source[at], source[at + 1], source[at + 2])
    target[to], target[to + 1], target[to + 2] = x, y, z


@inlined
def to_scene(frames, parts, part, source, at, target, to):
    """Transform a point from the part's local frame to the scene's frame.

    Write it to *target* from *to* on.
    """
    for axis in range(3):
        target[to + axis] = source[at + axis] / frames[part].scale + frames[part].centre[axis]
    turn_to_scene(frames, parts, part, target, to, target, to)
    for axis in range(3):
        target[to + axis] += frames[part].translation[axis]


@inlined
def part_of_slot(words, parts, slot):
    """Return the part that a slot belongs to."""
    scene = len(parts) - 1
    if scene == 1:
        return np.int64(0)
    return np.int64(load_int(words, parts[scene].block_notes + slot // LANES) & (2**FOLDED_AT - 1))


@inlined
def velocity_at(frame, x, y, z):
    """Return the velocity, m/s, of a part at a point in the scene's frame."""
    rx, ry, rz = x - frame.translation[0], y - frame.translation[1], z - frame.translation[2]
    wx, wy, wz = frame.angular_velocity[0], frame.angular_velocity[1], frame.angular_velocity[2]
    return (
        frame.velocity[0] + wy * rz - wz * ry,
        frame.velocity[1] + wz * rx - wx * rz,
        frame.velocity[2] + wx * ry - wy * rx,
    )
