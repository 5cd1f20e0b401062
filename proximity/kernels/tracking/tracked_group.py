"""Motion of a group of parts: velocities from two poses, and the poses of the other parts."""

from math import atan2, sqrt
from typing import NamedTuple

import numpy as np

from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.stack_arrays import stack_f64, stack_f64_rows
from proximity.kernels.tracking.tracked_records import HELD_SETTINGS as HELD_SETTINGS  # for the signature
from proximity.native import bundle, entry, kernel

MAX_STEP_NS = 100_000_000
"""Maximum time between two poses from which a velocity is computed."""
LINEAR_GIVEN, ANGULAR_GIVEN = 1, 2


class GroupMotion(NamedTuple):
    """A group of parts and its newest motion."""

    settings: np.ndarray  # (1,) HELD_SETTINGS
    offsets: np.ndarray  # (G, 4, 4) float64: poses relative to the first part
    last_pose: np.ndarray  # (4, 4) float64, of the first part
    given: np.ndarray  # (2, 3) float64, m/s and rad/s: of the first part
    matrices: np.ndarray  # (G, 4, 4) float64, of all parts; the first is given
    velocities: np.ndarray  # (G, 3) float64, m/s
    angular_velocities: np.ndarray  # (G, 3) float64, rad/s


bundle(
    GroupMotion,
    settings="HeldSettings[:]",
    offsets="float64[:, 4, 4]",
    last_pose="float64[:, 4]",
    given="float64[:, 3]",
    matrices="float64[:, 4, 4]",
    velocities="float64[:, 3]",
    angular_velocities="float64[:, 3]",
)


@entry("Frame[:], int64[:], float64[:, 4, 4]")
def relate_group(frames, own, offsets):
    """Fill the poses of the parts of a group relative to the first."""
    first = frames[own[0]]
    for k in range(len(own)):
        frame = frames[own[k]]
        for i in range(3):
            offsets[k, 3, i], offsets[k, i, 3] = 0.0, 0.0
            for j in range(3):
                offsets[k, i, j] = 0.0
                for m in range(3):
                    offsets[k, i, j] += first.rotation[3 * m + i] * frame.rotation[3 * m + j]
                offsets[k, i, 3] += first.rotation[3 * j + i] * (frame.translation[j] - first.translation[j])
        offsets[k, 3, 3] = 1.0


@entry("float64[:, 4], float64[:, 4], int, float64[:, 3] -> bool")
def velocities_between(before, pose, elapsed_ns, velocities):
    """Fill velocity and angular velocity, (2, 3), between two poses.

    Return False if the poses are too far apart in time.
    """
    if not 0 < elapsed_ns <= MAX_STEP_NS:
        return False
    seconds, turn = 1e-9 * elapsed_ns, stack_f64(9)
    for i in range(3):
        velocities[0, i] = (pose[i, 3] - before[i, 3]) / seconds
        for j in range(3):
            turn[3 * i + j] = 0.0
            for k in range(3):
                turn[3 * i + j] += pose[i, k] * before[j, k]
    x, y, z = 0.5 * (turn[7] - turn[5]), 0.5 * (turn[2] - turn[6]), 0.5 * (turn[3] - turn[1])
    sine = sqrt(dot(x, y, z, x, y, z))
    angle = atan2(sine, 0.5 * (turn[0] + turn[4] + turn[8] - 1.0))
    rate = angle / sine / seconds if sine > 0.0 else 0.0
    velocities[1, 0], velocities[1, 1], velocities[1, 2] = rate * x, rate * y, rate * z
    return True


@entry(GroupMotion, "int, int")
def move_group(group, pose_ns, known):
    """Fill the poses and velocities of all parts from the pose of the first one.

    *known*: bits of the given velocities; the others are computed from the last two poses.
    """
    option, velocities, given = group.settings[0], stack_f64_rows(2, 3), group.given
    is_found = False
    if option.has_last:
        elapsed = pose_ns - option.last_ns
        is_found = velocities_between(group.last_pose, group.matrices[0], elapsed, velocities)
    for row in range(2):
        for k in range(3):
            if known >> row & 1:
                velocities[row, k] = given[row, k]
            elif not is_found:
                velocities[row, k] = 0.0
    option.is_predicted = 1 if is_found or known & LINEAR_GIVEN else 0
    if option.has_last == 0 or pose_ns > option.last_ns:
        option.has_last, option.last_ns = 1, pose_ns
        for i in range(4):
            for j in range(4):
                group.last_pose[i, j] = group.matrices[0, i, j]
    for number in range(len(group.matrices)):
        if number > 0:
            _follow_first(group, number)
        arm = stack_f64(3)
        for k in range(3):
            arm[k] = group.matrices[number, k, 3] - group.matrices[0, k, 3]
        turning = velocities[1, 0], velocities[1, 1], velocities[1, 2]
        x, y, z = cross(*turning, arm[0], arm[1], arm[2])
        group.velocities[number, 0] = velocities[0, 0] + x
        group.velocities[number, 1] = velocities[0, 1] + y
        group.velocities[number, 2] = velocities[0, 2] + z
        for k in range(3):
            group.angular_velocities[number, k] = velocities[1, k]


@kernel
def _follow_first(group, number):
    """Fill the pose of another part of the group."""
    pose, offset, to = group.matrices[0], group.offsets[number], group.matrices[number]
    for i in range(3):
        for j in range(4):
            to[i, j] = pose[i, 3] if j == 3 else 0.0
            for k in range(3):
                to[i, j] += pose[i, k] * offset[k, j]
        to[3, i] = 0.0
    to[3, 3] = 1.0
