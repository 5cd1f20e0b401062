"""Distances of fingers that a sensor measured, received as messages."""

from typing import Any

import numpy as np

from proximity.message import MEASURED, MEASUREMENT, Surface
from proximity.message.contact import UNIT_ERROR
from proximity.service.inputs.reception import Reception, rows_of
from proximity.service.samples import LONG_AGO


class Measurements:
    """Distances of fingers, and what a sensor knows beside them."""

    distances: np.ndarray  # (N, 1) float64, m; nan: nothing was measured
    pose_ns: np.ndarray  # (N,) int64, ns, instants of the measurements
    records: np.ndarray  # (N,) MEASUREMENT: all that was reported

    def __init__(self, count: int) -> None:
        self.distances = np.full((count, 1), np.nan)
        self.pose_ns = np.full(count, LONG_AGO, np.int64)
        self.records = np.zeros(count, MEASUREMENT)
        # Copying records field by field takes fifty times as long.
        self._bytes = self.records.view(np.uint8).reshape(count, -1)

    @property
    def values(self) -> np.ndarray:
        """The distances."""
        return self.distances

    def take_rest(self, newer: "Measurements", rows: Any) -> None:
        """Copy all else that was reported of some fingers.

        *rows*: (N,) mask.
        """
        self._bytes[rows] = newer._bytes[rows]


class SensorInput:
    """Distances of fingers, as `MEASURED` messages at an address.

    A message need not tell all fingers: of the others, what was reported last is still true.
    """

    is_over = False

    def __init__(self, address: str, count: int) -> None:
        self.address = address
        self._reception = Reception(address, [MEASURED])
        self._count = count
        self._measured = Measurements(count)

    @property
    def notes(self) -> list[str]:
        """Sentences on messages that were lost, refused or left out."""
        return self._reception.notes

    def poll(self, now_ns: int) -> Measurements | None:
        """Return the newest measurement of each finger; None where no message came."""
        has_come = False
        for _, records, offset_ns in self._reception.messages():
            has_come = True
            self._take(records, offset_ns)
        return self._measured if has_come else None

    def close(self) -> None:
        """Give the address back."""
        self._reception.close()

    def _take(self, records: np.ndarray, offset_ns: int) -> None:
        measured = self._measured
        rows, chosen = rows_of(records["finger"], self._count)
        if chosen is not None:
            self._reception.leave_out("measurements of fingers that are not served", int((~chosen).sum()))
            records = records[chosen]
        measured.distances[rows, 0] = records["signed_distance"]
        measured.pose_ns[rows] = records["measured_ns"] + offset_ns
        measured.records[rows] = records
        self._correct(measured.records)

    def _correct(self, records: np.ndarray) -> None:
        """Make unknown what cannot be: a whole frame would be refused because of it."""
        positions, normals = records["position"], records["normal"]
        is_nowhere = ~np.isfinite(positions).all(axis=1) & ~np.isnan(positions).all(axis=1)
        if is_nowhere.any():
            positions[is_nowhere] = np.nan
            self._reception.leave_out("positions that are not finite", int(is_nowhere.sum()))
        with np.errstate(over="ignore", invalid="ignore"):
            is_skewed = np.abs((normals * normals).sum(axis=1) - 1.0) > UNIT_ERROR
        if is_skewed.any():
            normals[is_skewed] = np.nan
            self._reception.leave_out("normals that are not of unit length", int(is_skewed.sum()))
        records["surface"][records["surface"] > max(Surface)] = Surface.UNKNOWN
