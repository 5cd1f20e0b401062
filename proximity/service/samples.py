"""Samples of fingers from inputs, and the newest usable sample of each finger.

Arrays have a row for each finger, which is nan if unknown.
"""

import logging
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from proximity.core.receiver_state import AHEAD_NS
from proximity.errors import ServiceError
from proximity.kernels.tracking.motion import BACKWARDS, FUTURE, TOO_OLD, USABLE
from proximity.message import (
    MAX_RECORDS,
    MEASURED,
    MEASUREMENT,
    PATH_CORNERS,
    PATH_POSES,
    POSES,
    Message,
)
from proximity.message.instant_advice import FROM_FUTURE, OUT_OF_ORDER, on_backwards, on_future, on_too_old
from proximity.service import finger_kernels
from proximity.system.time_units import NS_PER_MS

LOGGER = logging.getLogger("proximity.service")
LOST_HANDS = "poses of hands whose fingers are all at one place"
LONG_AGO = -(2**62)
"""Instant of a finger that has not had any pose, ns."""
NEVER_NS = np.int64(-(2**63))


class Samples:
    """Values of some fingers, their instants, and optional data."""

    VALUES: ClassVar[str]
    OPTIONAL: ClassVar[tuple[str, ...]]
    """Names of arrays that may be None. They have a row for each finger."""
    pose_ns: np.ndarray  # (N,) int64, instants
    fingers: np.ndarray | None = None  # (N,) int64, numbers of the fingers; None: all, in order

    @property
    def values(self) -> np.ndarray:
        """Values, (N, C) float64, C-ordered. The first column is nan where they are unknown."""
        values: np.ndarray = getattr(self, self.VALUES)
        return values

    def message(self) -> Message:
        """Return the samples as a message."""
        raise NotImplementedError

    def copy_optional(self, newer: "Samples", fingers: slice | np.ndarray, rows: slice | np.ndarray) -> None:
        """Copy optional arrays of newer samples.

        The *rows* of newer samples are copied to *fingers* of these, or nan where nothing was reported.
        """
        for name in self.OPTIONAL:
            kept, given = getattr(self, name), getattr(newer, name)
            if given is None:
                if kept is not None:
                    kept[fingers] = np.nan
                continue
            shape = (len(self.pose_ns), *given.shape[1:])
            if kept is None or kept.shape != shape:
                if not np.isfinite(given).any():
                    continue
                kept = np.full(shape, np.nan, given.dtype)
                setattr(self, name, kept)
            kept[fingers] = given[rows]


class FingerPoses(Samples):
    """Poses of fingers, with optional velocities, paths and bends."""

    VALUES = "positions"
    OPTIONAL = ("velocities", "paths", "bends")
    positions: np.ndarray  # (N, 3) float64, m, scene's frame; nan: not tracked
    velocities: np.ndarray | None  # (N, 3) float64, m/s; nan: to be estimated
    paths: np.ndarray | None  # (N, K, 3) float64, m, scene's frame; first corner nan: no path
    bends: np.ndarray | None  # (N,) float64, bend on the path; nan: that of the nearest position

    def __init__(self, count: int) -> None:
        self.positions = np.full((count, 3), np.nan)
        self.pose_ns = np.full(count, LONG_AGO, np.int64)
        self.velocities = self.paths = self.bends = None

    def message(self) -> Message:
        """Return the poses as a message of `POSES`, or of `PATH_POSES` if they have paths."""
        count = len(self.pose_ns)
        message = Message(POSES if self.paths is None else PATH_POSES, count)
        records = message.records
        records["finger"] = np.arange(count) if self.fingers is None else self.fingers
        records["pose_ns"], records["position"] = self.pose_ns, self.positions
        records["velocity"] = np.nan if self.velocities is None else self.velocities
        records["bend"] = np.nan if self.bends is None else self.bends
        if self.paths is not None:
            if self.paths.shape[1] != PATH_CORNERS:
                raise ServiceError(f"paths have {self.paths.shape[1]} corners, expected {PATH_CORNERS}")
            records["corners"] = self.paths
        return message


class Measurements(Samples):
    """Measured distances of fingers, and further measurements of a sensor."""

    VALUES = "distances"
    OPTIONAL = ("record_bytes",)
    distances: np.ndarray  # (N, 1) float64, m; nan: not measured
    records: np.ndarray  # (N,) MEASUREMENT: the full report
    record_bytes: np.ndarray  # view of the records, whose copy is fifty times as fast as field by field

    def __init__(self, count: int) -> None:
        self.distances = np.full((count, 1), np.nan)
        self.pose_ns = np.full(count, LONG_AGO, np.int64)
        self.records = np.zeros(count, MEASUREMENT)
        self.record_bytes = self.records.view(np.uint8).reshape(count, MEASUREMENT.itemsize)

    def message(self) -> Message:
        """Return the measurements as a message of `MEASURED`."""
        count = len(self.pose_ns)
        message = Message(MEASURED, count)
        message.records[:] = self.records
        message.records["finger"] = np.arange(count) if self.fingers is None else self.fingers
        message.records["measured_ns"] = self.pose_ns
        return message


class NewestSamples:
    """Collects the newest usable sample of each finger.

    *samples*: where they are stored. *origin*: name of the input for the log.
    """

    future: int  # number of unused samples from the future
    backwards: int  # … older than the previous one
    too_old: int  # … too old on arrival
    lost: int  # … of a hand whose fingers all have one position

    def __init__(self, samples: Samples, stale_after_ns: int, origin: str = "input") -> None:
        count = len(samples.pose_ns)
        self.samples = samples
        self.future = self.backwards = self.too_old = self.lost = 0
        self._origin = origin
        self._stale_after_ns = stale_after_ns
        self._refused_ns = np.full(count, NEVER_NS)
        self._all, self._row_of = np.arange(count), np.arange(count)
        self._defects = np.zeros(max(count, MAX_RECORDS), np.uint8)

    @property
    def notes(self) -> list[str]:
        """Sentences on hands that were lost."""
        return [f"{self._origin}: {self.lost} {LOST_HANDS} are not used"] if self.lost else []

    @property
    def refused(self) -> tuple[int, int, int]:
        """Numbers of unused samples: from the future, older than the previous one, and too old."""
        return self.future, self.backwards, self.too_old

    def start(self, now_ns: int) -> None:
        """Set all fingers to unknown, with instants that are as old as samples may be."""
        self.samples.pose_ns[:] = now_ns - self._stale_after_ns
        self.samples.values[:, 0] = np.nan

    def update(self, given: Samples, now_ns: int) -> None:
        """Copy the usable samples of *given*.

        A refused sample is counted only once, even if it is given again.
        """
        newest = self.samples
        fingers = self._all if given.fingers is None else given.fingers
        defects = self._defects[: len(fingers)]
        finger_kernels.update_newest(
            newest.pose_ns, newest.values, self._refused_ns, self._row_of, fingers, given.pose_ns,
            given.values, defects, now_ns - self._stale_after_ns, now_ns + AHEAD_NS,
        )  # fmt: skip
        if not defects.any():
            every = slice(None)
            newest.copy_optional(given, every if given.fingers is None else fingers, every)
            return
        ahead_ns = given.pose_ns - now_ns
        back_ns = newest.pose_ns[fingers] - given.pose_ns
        too_old = f"poses older than {self._stale_after_ns / NS_PER_MS:g} ms"
        self.future += self._count(defects == FUTURE, self.future, FROM_FUTURE, on_future, ahead_ns)
        self.too_old += self._count(defects == TOO_OLD, self.too_old, too_old, on_too_old, -ahead_ns)
        self.backwards += self._count(
            defects == BACKWARDS, self.backwards, OUT_OF_ORDER, on_backwards, back_ns
        )
        self.lost += self._count(defects == finger_kernels.LOST, self.lost, LOST_HANDS, on_lost, ahead_ns)
        is_usable = defects == USABLE
        newest.copy_optional(given, fingers[is_usable], is_usable)

    def drop_stale(self, now_ns: int) -> None:
        """Set the fingers whose newest sample is too old to unknown."""
        finger_kernels.drop_stale(self.samples.pose_ns, self.samples.values, now_ns - self._stale_after_ns)

    def _count(
        self, which: np.ndarray, before: int, what: str, advice: Callable[[int], str], off_ns: np.ndarray
    ) -> int:
        """Return the number of samples with a defect. Log only the first one, to avoid a flood."""
        if which.any() and not before:
            LOGGER.warning("%s: %s are not used (%s)", self._origin, what, advice(int(off_ns[which].max())))
        return int(which.sum())


def on_lost(_: int) -> str:
    """Return advice to a sender that gives all fingers of a lost hand one position."""
    return "the hand is lost there: send nan"
