"""Checks of what a caller says about the motion and stiffness of parts."""

from typing import Any

import numpy as np

from proximity.checks import as_float64, is_ready, not_negative, positive
from proximity.errors import ArgumentError, PoseError
from proximity.pose import Pose, quaternion_hint
from proximity.scene.model.scene_state import FARTHEST_MOVE, FASTEST_MOVE, first_unfit_move

NO_VELOCITIES = np.zeros((0, 3))
"""Stands for zero velocities of all parts that are moved."""


def checked_moves(
    names: list[str], poses: Any, velocities: Any, angular_velocities: Any
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return matrices (K, 4, 4) and both velocities (K, 3), or (0, 3), for parts of those names.

    *poses*: (K, 4, 4) array-like, or a list of Pose; *velocities*, *angular_velocities*: (K, 3) array-like,
    or None.
    """
    matrices = _as_matrices(names, poses)
    linear = _as_velocities(names, velocities, "velocities")
    angular = _as_velocities(names, angular_velocities, "angular_velocities")
    row = first_unfit_move(matrices, linear, angular)
    if row >= 0:
        # Each is looked at alone, which finds the sentence to say.
        matrices = np.array([checked_matrix(*each) for each in zip(names, matrices, strict=True)])
        for name, velocity in zip(names, linear, strict=False):
            checked_velocity(name, velocity, "velocity", "m/s")
        for name, velocity in zip(names, angular, strict=False):
            checked_velocity(name, velocity, "angular_velocity", "rad/s")
    return matrices, linear, angular


def checked_move(
    name: str, pose: Any, velocity: Any, angular_velocity: Any
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what `checked_moves` returns, for one part.

    *pose*: (4, 4) array-like; *velocity*, *angular_velocity*: (3,) array-like.
    """
    linear = checked_velocity(name, velocity, "velocity", "m/s").reshape(1, 3)
    angular = checked_velocity(name, angular_velocity, "angular_velocity", "rad/s").reshape(1, 3)
    matrix = pose.matrix if isinstance(pose, Pose) else pose
    if not isinstance(matrix, np.ndarray) or matrix.shape != (4, 4) or matrix.dtype.kind != "f":
        matrix = checked_matrix(name, pose)
    matrices = np.array(matrix, np.float64, order="C").reshape(1, 4, 4)
    if first_unfit_move(matrices, linear, angular) >= 0:
        matrices = np.ascontiguousarray(checked_matrix(name, pose)).reshape(1, 4, 4)
    return matrices, linear, angular


def checked_matrix(name: str, pose: Any) -> np.ndarray:
    """Return a pose as a (4, 4) matrix.

    *pose*: (4, 4) array-like.
    """
    try:
        pose = Pose.of(pose)
    except PoseError as unfit:
        raise PoseError(f"part {name!r}: {unfit}") from unfit
    distance = float(np.abs(pose.translation).max())
    if not distance <= FARTHEST_MOVE:
        raise PoseError(
            f"part {name!r} would be moved by {distance:.3g} m, which is farther than can be computed with"
        )
    return np.asarray(pose.matrix)


def checked_velocity(name: str, velocity: Any, what: str, unit: str) -> np.ndarray:
    """Return a velocity as (3,) float64, a copy.

    *velocity*: (3,) array-like.
    """
    expected = f"3 finite numbers, {unit}"
    array = as_float64(velocity, f"entries of {what} of part {name!r}", expected=expected)
    if array.shape != (3,):
        raise ArgumentError(f"{what} of part {name!r} has shape {array.shape}, expected {expected}")
    if not np.isfinite(array).all():
        raise ArgumentError(f"{what} of part {name!r} is {array.tolist()}, expected {expected}")
    if np.abs(array).max() > FASTEST_MOVE:
        most = f"at most {FASTEST_MOVE:g} {unit} along each axis"
        raise ArgumentError(f"{what} of part {name!r} is {array.tolist()}, expected {most}")
    return array.copy()


def checked_surface(name: str, stiffness: Any, damping: Any) -> tuple[float | None, float]:
    """Return stiffness, N/m, None of a rigid part, and damping, N s/m.

    *damping*: at least 0, and 0 of a rigid part.
    """
    damping = not_negative(f"damping of part {name!r}", damping, "N s/m")
    if stiffness is not None:
        unit = "N/m, or None for a rigid part"
        return positive(f"stiffness of part {name!r}", stiffness, unit), damping
    if damping:
        raise ArgumentError(f"part {name!r} is rigid (no stiffness), but has a damping of {damping:g} N s/m")
    return None, 0.0


def _as_matrices(names: list[str], poses: Any) -> np.ndarray:
    if is_ready(poses, (len(names), 4, 4)):
        return np.asarray(poses)
    if isinstance(poses, (list, tuple)) and any(isinstance(pose, Pose) for pose in poses):
        if len(poses) != len(names):
            raise PoseError(
                f"there are {len(poses)} poses for {len(names)} parts, expected one for each part"
            )
        return np.array([checked_matrix(*each) for each in zip(names, poses, strict=True)])
    expected = f"numbers of shape ({len(names)}, 4, 4)"
    matrices = as_float64(poses, "entries of poses", expected=expected)
    if not names and not matrices.size:
        return matrices.reshape(0, 4, 4)
    if matrices.shape != (len(names), 4, 4):
        raise PoseError(
            f"poses have shape {matrices.shape}, expected ({len(names)}, 4, 4): one for each part named"
            + quaternion_hint(matrices)
        )
    return matrices


def _as_velocities(names: list[str], velocities: Any, what: str) -> np.ndarray:
    if velocities is None:
        return NO_VELOCITIES
    if is_ready(velocities, (len(names), 3)):
        return np.asarray(velocities)
    expected = f"numbers of shape ({len(names)}, 3)"
    array = as_float64(velocities, f"entries of {what}", expected=expected)
    if array.shape != (len(names), 3):
        raise ArgumentError(
            f"{what} have shape {array.shape}, expected ({len(names)}, 3): one for each part named"
        )
    return array
