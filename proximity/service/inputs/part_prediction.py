"""Predict the poses of moving parts from their last reported poses.

The reported velocities are assumed to be constant: the origin moves along a line, and the part rotates about
its origin. A part that is no longer reported is extrapolated for `HOLD_NS` and then stops, but its state is
unknown.
"""

from collections.abc import KeysView, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from proximity.scene.scene import Scene
from proximity.system.time_units import NS_PER_S

HOLD_NS = NS_PER_S // 10
"""Time for which a reported velocity is valid, unless the part is reported again."""


class ReportedMotion(NamedTuple):
    """The last reported motion of a part."""

    matrix: np.ndarray  # (4, 4) float64, m, world_from_part at pose_ns
    velocity: np.ndarray  # (3,) float64, m/s, of its origin
    turning: np.ndarray  # (3,) float64, rad/s, about its origin
    pose_ns: int
    is_moving: bool = True  # False if both velocities are zero
    is_known: bool = True  # False if the velocities were not given


def pose_at(reported: ReportedMotion, instant_ns: int) -> np.ndarray:
    """Return the pose of a part at an instant, (4, 4). It is extrapolated for at most `HOLD_NS`."""
    matrix, off_ns = reported.matrix.copy(), min(instant_ns - reported.pose_ns, HOLD_NS)
    if reported.is_moving and off_ns:
        matrix[:3, 3] += 1e-9 * off_ns * reported.velocity
        rates = np.linalg.norm(reported.turning[None], axis=1)
        across, back = turns(matrix[None, :3, :3], reported.turning[None], rates)
        angle = 1e-9 * off_ns * rates[0]
        matrix[:3, :3] += np.sin(angle) * across[0] + (1.0 - np.cos(angle)) * back[0]
    return matrix


class VisibleParts:
    """Names, visibility and extents of the parts of a scene at one epoch."""

    def __init__(self, scene: Scene) -> None:
        model = scene.snapshot()
        self._rows = {name: row for row, name in enumerate(model.names)}
        count = len(self._rows)
        self._is_hidden = model.parts["is_hidden"][:count] != 0
        corners = (
            model.frames["own_lower"][:count],
            model.frames["own_upper"][:count],
        )
        self._radii = np.linalg.norm(np.abs(corners).max(axis=0), axis=1)

    @property
    def names(self) -> KeysView[str]:
        """Names of the parts."""
        return self._rows.keys()

    def rows_of(self, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the rows of M parts, whether each is hidden, and their extents.

        The extent is the largest distance of the box from the part's origin, m.
        """
        rows = np.array([self._rows[name] for name in names], np.int64)
        return rows, self._is_hidden[rows], self._radii[rows]


def write_motions(
    table: np.ndarray, parts: VisibleParts, motions: Mapping[str, ReportedMotion], number: int
) -> None:
    """Write motions of *parts* into a `loop_records.MOTION` table.

    *number* is the number of this report.
    """
    rows, is_hidden, radii = parts.rows_of(list(motions))
    for name in ("matrix", "velocity", "turning", "pose_ns", "is_moving"):
        values = np.array([getattr(motion, name) for motion in motions.values()])
        table[name][rows] = values.reshape(len(rows), *table.dtype[name].shape)
    velocity, turning = table["velocity"][rows], table["turning"][rows]
    rates = np.linalg.norm(turning, axis=1)
    rotations = table["matrix"][rows].reshape(-1, 4, 4)[:, :3, :3]
    for name, turn in zip(("across", "back"), turns(rotations, turning, rates), strict=True):
        table[name][rows] = turn.reshape(-1, 9)
    table["turn_rate"][rows], table["is_hidden"][rows] = rates, is_hidden
    table["top_speed"][rows] = np.linalg.norm(velocity, axis=1) + rates * radii
    table["ends_ns"][rows] = table["pose_ns"][rows] + HOLD_NS
    table["number"][rows] = number


def turns(rotations: np.ndarray, turning: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two arrays (M, 3, 3) from which increments of rotations by an angle are computed.

    By Rodrigues' formula the increment is sin(angle) times the first array plus (1 - cos(angle)) times the
    second. *rotations*: (M, 3, 3). *turning*: (M, 3) angular velocities, and *rates* (M,) their lengths.
    """
    x, y, z = (turning / np.where(rates > 0.0, rates, 1.0)[:, None]).T
    cross = np.zeros((len(rates), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross -= cross.transpose(0, 2, 1)
    across = cross @ rotations
    return across, cross @ across
