"""Poses received as messages from another process or machine."""

import time
from collections.abc import Callable

import numpy as np

from proximity.message import GLOVE_POSES, PATH_CORNERS, PATH_POSES, POSES, Kind
from proximity.service.inputs.gloves import GloveChoices, is_rotation, points_on
from proximity.service.inputs.reception import Reception, rows_of
from proximity.service.samples import FingerPoses


class StreamInput:
    """Poses of fingers, as `POSES`, `PATH_POSES` and `GLOVE_POSES` messages at an address.

    A message need not tell all fingers: of the others, what was reported last is still true. Where several
    have come since the last poll, the newest counts. Without *gloves*, `GLOVE_POSES` are not expected.
    """

    is_over = False

    def __init__(
        self,
        address: str,
        count: int,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        gloves: GloveChoices | None = None,
    ) -> None:
        kinds = [POSES, PATH_POSES] if gloves is None else [POSES, PATH_POSES, GLOVE_POSES]
        self.address = address
        self._reception = Reception(address, kinds, clock)
        self._gloves = gloves
        self._count = count
        self._poses = FingerPoses(count)

    @property
    def notes(self) -> list[str]:
        """Sentences on messages that were lost, refused or left out."""
        return self._reception.notes

    def poll(self, now_ns: int) -> FingerPoses | None:
        """Return the newest pose of each finger; None where no message came."""
        has_come = False
        for kind, records, offset_ns in self._reception.messages():
            has_come = True
            self._take(kind, records, offset_ns)
        return self._poses if has_come else None

    def close(self) -> None:
        """Give the address back."""
        self._reception.close()

    def _take(self, kind: Kind, records: np.ndarray, offset_ns: int) -> None:
        poses = self._poses
        rows, chosen = rows_of(records["finger"], self._count)
        if chosen is not None:
            self._reception.leave_out("poses of fingers that are not served", int((~chosen).sum()))
            records = records[chosen]
        poses.pose_ns[rows] = records["pose_ns"] + offset_ns
        if kind is GLOVE_POSES:
            self._take_gloves(records, rows)
            return
        poses.positions[rows] = records["position"]
        if poses.velocities is not None or np.isfinite(records["velocity"]).any():
            if poses.velocities is None:
                poses.velocities = np.full((self._count, 3), np.nan)
            poses.velocities[rows] = records["velocity"]
        if poses.bends is not None or np.isfinite(records["bend"]).any():
            poses.bends = self._bends()
            poses.bends[rows] = records["bend"]
        if poses.paths is not None or kind is PATH_POSES:
            poses.paths = self._paths()
            # A pose without a path says that the one before does not hold any more.
            poses.paths[rows] = records["corners"] if kind is PATH_POSES else np.nan

    def _take_gloves(self, records: np.ndarray, rows: slice | np.ndarray) -> None:
        """Take tips, bends and paths as the gloves have them."""
        assert self._gloves is not None
        poses, fingers = self._poses, records["finger"]
        is_placed = np.isfinite(records["translation"]).all(axis=1)
        is_turn = is_rotation(records["rotation"])
        self._leave_out("rotations that are invalid", is_placed & ~is_turn)
        bends = self._gloves.bend(fingers, records["bend"], records["counts"])
        self._leave_out(
            "counts outside the calibration: calibrate again",
            np.isnan(bends) & np.isfinite(records["counts"]),
        )
        knuckles = np.where((is_placed & is_turn)[:, None], records["translation"], np.nan)
        rotations = np.where(is_turn[:, None, None], records["rotation"], np.nan)
        paths = self._gloves.paths(fingers, rotations, knuckles)
        poses.positions[rows] = points_on(paths, bends)
        poses.paths, poses.bends = self._paths(), self._bends()
        poses.paths[rows], poses.bends[rows] = paths, bends
        if poses.velocities is not None:
            poses.velocities[rows] = np.nan

    def _leave_out(self, what: str, which: np.ndarray) -> None:
        if which.any():
            self._reception.leave_out(what, int(which.sum()))

    def _paths(self) -> np.ndarray:
        """Room for paths, from the first one on."""
        paths = self._poses.paths
        return np.full((self._count, PATH_CORNERS, 3), np.nan) if paths is None else paths

    def _bends(self) -> np.ndarray:
        """Room for bends, from the first one on."""
        bends = self._poses.bends
        return np.full(self._count, np.nan) if bends is None else bends
