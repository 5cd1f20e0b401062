"""Compute positions and paths of gloved fingers from the pose of the knuckle and the measured bend.

The calibrations come as arrays with a row for each finger; other modules read them from files.
"""

from dataclasses import dataclass

import numpy as np

from proximity.decaff.glove.finger_path import MAX_BEND, MIN_BEND

ROTATION_ERROR = 1e-3
"""Maximum difference of a rotation times its transpose from the identity. It permits the rounding of a sender
that stores float32 or multiplies many rotations. Assumed."""


@dataclass(frozen=True, slots=True, eq=False)
class GloveChoices:
    """Calibrations of N fingers: the path of each fingertip, and the bend at each potentiometer count."""

    corners: np.ndarray  # (N, K, 3), m; frame: origin at the knuckle, x along the flat finger, y dorsal
    counts: np.ndarray  # (N, M) float64, increasing
    bends: np.ndarray  # (N, M) float64, bends at the counts

    def bend(self, rows: np.ndarray, reported: np.ndarray, counts: np.ndarray) -> np.ndarray:
        """Return the bends of some fingers, (F,).

        A reported bend is returned, else the bend at the potentiometer count, or nan without either. *rows*:
        (F,) int, numbers of the fingers. *reported*, *counts*: (F,), nan where unknown.
        """
        bends = np.array(reported, np.float64)
        for i in np.flatnonzero(np.isnan(bends)):
            row = rows[i]
            bends[i] = np.interp(counts[i], self.counts[row], self.bends[row], left=np.nan, right=np.nan)
        bends[~((bends >= MIN_BEND) & (bends <= MAX_BEND))] = np.nan
        return bends

    def paths(self, rows: np.ndarray, rotations: np.ndarray, knuckles: np.ndarray) -> np.ndarray:
        """Return the paths of some fingertips in the world frame, (F, K, 3), m.

        *rows*: (F,) int, numbers of the fingers. *rotations*: (F, 3, 3). *knuckles*: (F, 3) positions in the
        world, m.
        """
        return np.einsum("fij,fkj->fki", rotations, self.corners[rows]) + knuckles[:, None, :]


def points_on(paths: np.ndarray, bends: np.ndarray) -> np.ndarray:
    """Return the points of polylines at given bends, (F, 3).

    *paths*: (F, K, 3) m; their corners are at equally spaced bends from 0 to 1. The first and last segment
    are extended for bends beyond.
    """
    last = paths.shape[1] - 1
    along = last * bends
    first = np.clip(np.nan_to_num(np.floor(along)), 0, last - 1).astype(np.intp)
    row = np.arange(len(paths))
    start = paths[row, first]
    return np.asarray(start + (along - first)[:, None] * (paths[row, first + 1] - start))


def is_rotation(rotations: np.ndarray) -> np.ndarray:
    """Return which of the matrices are rotations, (F,) bool.

    *rotations*: (F, 3, 3).
    """
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        is_right_handed = (np.cross(rotations[:, 0], rotations[:, 1]) * rotations[:, 2]).sum(axis=1) > 0.0
    return np.asarray((off <= ROTATION_ERROR) & is_right_handed)
