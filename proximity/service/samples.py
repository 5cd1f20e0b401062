"""Samples that an input gives of fingers: preallocated arrays, a row a finger, nan where nothing is known."""

from typing import Any, Protocol

import numpy as np

LONG_AGO = -(2**62)
"""ns; instant of a finger that never had a pose."""


class Samples(Protocol):
    """The part of samples that the loop needs: values and their instants."""

    pose_ns: np.ndarray  # (N,) int64, instants

    @property
    def values(self) -> np.ndarray:
        """First values of each finger, (N, C) float64; nan in the first column: nothing is known."""

    def take_rest(self, newer: Any, rows: Any) -> None:
        """Copy what *newer* says beside values and instants, of some rows (a slice, or a mask)."""


class FingerPoses:
    """Poses of fingers."""

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

    def take_rest(self, newer: "FingerPoses", rows: Any) -> None:
        """Copy velocities, paths and bends of some fingers.

        What was reported once and is not any more becomes nan.

        *rows*: (N,) mask.
        """
        self.velocities = _taken(self.velocities, newer.velocities, rows)
        self.paths = _taken(self.paths, newer.paths, rows)
        self.bends = _taken(self.bends, newer.bends, rows)


def _taken(kept: np.ndarray | None, newer: np.ndarray | None, rows: Any) -> np.ndarray | None:
    if newer is None:
        if kept is not None:
            kept[rows] = np.nan
        return kept
    if kept is None or kept.shape != newer.shape:
        kept = np.full(newer.shape, np.nan)
    kept[rows] = newer[rows]
    return kept
