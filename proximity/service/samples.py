"""What an input tells of fingers: arrays made once, a row a finger, nan where nothing is known."""

from typing import Any, Protocol

import numpy as np

LONG_AGO = -(2**62)
"""ns; instant of a finger that never had a pose."""


class Samples(Protocol):
    """What the loop needs to know of them: whether a finger is there, and since when."""

    pose_ns: np.ndarray  # (N,) int64, instants

    @property
    def values(self) -> np.ndarray:
        """What is known of each finger first, (N, C) float64; nan in the first column: nothing is."""

    def take_rest(self, given: Any, rows: Any) -> None:
        """Copy what *given* says beside values and instants, of some rows (a slice, or a mask)."""


class Hands:
    """Poses of fingers.

    Parameters
    ----------
    count : int
        Of fingers.
    """

    positions: np.ndarray  # (N, 3) float64, m, scene's frame; nan: not tracked
    pose_ns: np.ndarray  # (N,) int64, ns, instants of the positions
    velocities: np.ndarray | None  # (N, 3) float64, m/s; nan: to be estimated
    paths: np.ndarray | None  # (N, K, 3) float64, m, scene's frame; first corner nan: no path
    bends: np.ndarray | None  # (N,) float64, on the path; nan: the nearest place

    def __init__(self, count: int) -> None:
        self.positions = np.full((count, 3), np.nan)
        self.pose_ns = np.full(count, LONG_AGO, np.int64)
        self.velocities = self.paths = self.bends = None

    @property
    def values(self) -> np.ndarray:
        """The positions."""
        return self.positions

    def take_rest(self, given: "Hands", rows: Any) -> None:
        """Copy velocities, paths and bends of some fingers.

        What was reported once and is not any more becomes nan.

        Parameters
        ----------
        given : Hands
            Of as many fingers.
        rows : slice or (N,) mask
            Which of them.
        """
        self.velocities = _taken(self.velocities, given.velocities, rows)
        self.paths = _taken(self.paths, given.paths, rows)
        self.bends = _taken(self.bends, given.bends, rows)


def _taken(kept: np.ndarray | None, given: np.ndarray | None, rows: Any) -> np.ndarray | None:
    if given is None:
        if kept is not None:
            kept[rows] = np.nan
        return kept
    if kept is None or kept.shape != given.shape:
        kept = np.full(given.shape, np.nan)
    kept[rows] = given[rows]
    return kept
