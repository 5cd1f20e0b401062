"""Samples of fingers received as messages: poses, with paths or of gloves, and measured distances."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from proximity.core.receiver_state import UNIT_ERROR
from proximity.message import GLOVE_POSES, MEASURED, PATH_POSES, POSES, Kind, Surface
from proximity.service.inputs.gloves import GloveChoices, is_rotation, points_on
from proximity.service.inputs.inbox import Inbox
from proximity.service.samples import FingerPoses, Measurements, Samples


class MessageInput:
    """Samples of fingers, as messages of some kinds at an address.

    A message may omit fingers: they keep their last report. *kinds*: `POSES` and `PATH_POSES`, with *gloves*
    also `GLOVE_POSES`; or `MEASURED` alone.
    """

    is_over = False

    def __init__(
        self,
        address: str,
        count: int,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        gloves: GloveChoices | None = None,
        is_measured: bool = False,
    ) -> None:
        self._readers: dict[Kind, Callable[[np.ndarray], Samples]] = {
            POSES: self._read_poses,
            PATH_POSES: self._read_poses,
        }
        if is_measured:
            self._readers = {MEASURED: self._read_measurements}
        elif gloves is not None:
            self._readers[GLOVE_POSES] = self._read_gloves
        self.address = address
        self._inbox = Inbox(address, tuple(self._readers), clock)
        self._gloves, self._everybody = gloves, np.arange(count)
        # Each message replaces their arrays by views.
        self._poses, self._measured = FingerPoses(0), Measurements(0)

    @property
    def notes(self) -> list[str]:
        """Sentences on messages that were lost, refused or left out."""
        return self._inbox.notes

    def poll(self, now_ns: int) -> Iterator[Samples]:
        """Yield arrived samples, oldest first; each is overwritten by the next."""
        for kind, records, offset_ns in self._inbox.messages():
            fingers: np.ndarray | None = None  # all, in order, the usual case
            if not np.array_equal(records["finger"], self._everybody):
                is_served = records["finger"] < len(self._everybody)
                if not is_served.all():
                    what = "measurements" if kind is MEASURED else "poses"
                    self._leave_out(f"{what} of fingers that are not served", ~is_served)
                    records = records[is_served]
                fingers = records["finger"].astype(np.int64)
            samples = self._readers[kind](records)
            samples.fingers = fingers
            samples.pose_ns = records["measured_ns" if kind is MEASURED else "pose_ns"] + offset_ns
            yield samples

    def wait(self, timeout: float) -> None:
        """Wait until a message may have arrived, or for *timeout* seconds."""
        self._inbox.wait(timeout)

    def loop_end(self) -> dict[str, Any] | None:
        """Return the data with which the loop itself receives poses; None: only this can."""
        return self._inbox.loop_end() if tuple(self._readers) == (POSES, PATH_POSES) else None

    def close(self) -> None:
        """Close the address."""
        self._inbox.close()

    def _read_poses(self, records: np.ndarray) -> FingerPoses:
        """Return positions of fingertips; a pose without a path ends the previous path."""
        poses = self._poses
        poses.positions = np.ascontiguousarray(records["position"])
        poses.velocities, poses.bends = records["velocity"], records["bend"]
        poses.paths = records["corners"] if "corners" in (records.dtype.names or ()) else None
        return poses

    def _read_gloves(self, records: np.ndarray) -> FingerPoses:
        """Return fingertips, bends and paths, from the calibrations of the gloves."""
        assert self._gloves is not None
        poses, fingers = self._poses, records["finger"]
        is_placed = np.isfinite(records["translation"]).all(axis=1)
        is_turn = is_rotation(records["rotation"])
        self._leave_out("rotations that are invalid", is_placed & ~is_turn)
        bends = self._gloves.bend(fingers, records["bend"], records["counts"])
        self._leave_out(
            "counts outside the calibration (calibrate again)",
            np.isnan(bends) & np.isfinite(records["counts"]),
        )
        knuckles = np.where((is_placed & is_turn)[:, None], records["translation"], np.nan)
        rotations = np.where(is_turn[:, None, None], records["rotation"], np.nan)
        poses.paths, poses.bends = self._gloves.paths(fingers, rotations, knuckles), bends
        poses.positions, poses.velocities = points_on(poses.paths, bends), None
        return poses

    def _read_measurements(self, records: np.ndarray) -> Measurements:
        """Return distances; impossible values become unknown, as a whole frame would be refused for them."""
        positions, normals = records["position"], records["normal"]
        is_partial = ~np.isfinite(positions).all(axis=1) & ~np.isnan(positions).all(axis=1)
        self._leave_out("positions that are not finite", is_partial)
        positions[is_partial] = np.nan
        with np.errstate(over="ignore", invalid="ignore"):
            is_skewed = np.abs((normals * normals).sum(axis=1) - 1.0) > UNIT_ERROR
        self._leave_out("normals that are not of unit length", is_skewed)
        normals[is_skewed] = np.nan
        records["surface"][records["surface"] > max(Surface)] = Surface.UNKNOWN
        measured = self._measured
        measured.records, measured.distances = records, np.array(records["signed_distance"][:, None])
        measured.record_bytes = records.view(np.uint8).reshape(len(records), records.itemsize)
        return measured

    def _leave_out(self, what: str, which: np.ndarray) -> None:
        if which.any():
            self._inbox.leave_out(what, int(which.sum()))
