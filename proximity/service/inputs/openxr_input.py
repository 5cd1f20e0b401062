"""Poses of ten fingertips from hands that OpenXR tracks."""

import threading
from collections.abc import Callable
from typing import Protocol

import numpy as np

from proximity.errors import ProximityError
from proximity.pose import Pose
from proximity.service.inputs.openxr_runtime import FINGERS, OpenXrHands
from proximity.service.samples import FingerPoses

PERIOD = 0.004  # s between looks: hands are tracked 30 to 120 times a second


class TrackedHands(Protocol):
    """A source of fingertips: `OpenXrHands`, or calls that were recorded."""

    is_over: bool
    """Whether nothing will come any more."""

    def tips(self) -> tuple[int, np.ndarray]:
        """Return an instant, ns, and the fingertips, (10, 3) m, y up; nan: not tracked."""

    def close(self) -> None:
        """Give back what is open."""


class OpenXrInput:
    """Fingertips of both hands, thumb to little finger, the left hand first.

    A thread looks every 4 ms, since a call into a runtime may take longer than a tick. Fingertips that are
    exactly where they were are no new sample: a runtime that repeats its last one would make fingers stand.

    *scene_from_openxr*: where the runtime's origin is in the scene, and how its axes are turned. *count*: of
    fingers that are served; more than ten are never tracked.
    """

    is_over: bool
    address = "OpenXR"

    def __init__(
        self, scene_from_openxr: Pose, count: int, *, open_hands: Callable[[], TrackedHands] = OpenXrHands
    ) -> None:
        self._scene_from_openxr = scene_from_openxr
        self.is_over = False
        self._hands = open_hands()
        self._poses = FingerPoses(count)
        self._rows = min(count, FINGERS)
        self._latest: tuple[int, np.ndarray] | None = None  # replaced as a whole by the thread
        self._failure_count, self._first_failure = 0, ""
        self._has_ended = threading.Event()
        self._thread = threading.Thread(target=self._look, name="openxr", daemon=True)
        self._thread.start()

    @property
    def notes(self) -> list[str]:
        """A sentence on calls that failed."""
        if not self._failure_count:
            return []
        return [f"OpenXR failed {self._failure_count} times, first: {self._first_failure}"]

    def poll(self, now_ns: int) -> FingerPoses | None:
        """Return the newest fingertips; None where there are no others than before."""
        latest, self._latest = self._latest, None
        if latest is None:
            return None
        pose_ns, positions = latest
        self._poses.pose_ns[: self._rows] = pose_ns
        self._poses.positions[: self._rows] = positions[: self._rows]
        return self._poses

    def close(self) -> None:
        """End the thread and the session."""
        self._has_ended.set()
        self._thread.join()
        self._hands.close()

    def _look(self) -> None:
        before = np.full((FINGERS, 3), np.inf)
        while not self._has_ended.wait(PERIOD) and not self._hands.is_over:
            try:
                pose_ns, tips = self._hands.tips()
            except ProximityError as failure:
                self._failure_count += 1
                self._first_failure = self._first_failure or str(failure)
                continue
            if not np.array_equal(tips, before, equal_nan=True):
                self._latest = pose_ns, self._scene_from_openxr.point(tips)
                before = tips
        self.is_over = True
