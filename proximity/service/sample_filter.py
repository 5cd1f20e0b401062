"""Filter of samples: none from the future, none older than the last, none too old."""

import logging
from collections.abc import Callable

import numpy as np

from proximity.kernels.tracking.motion import BACKWARDS, FUTURE, TOO_OLD, USABLE
from proximity.message.envelope import MAX_FUTURE_NS
from proximity.message.instant_advice import FROM_FUTURE, OUT_OF_ORDER, on_backwards, on_future, on_too_old
from proximity.service import finger_kernels
from proximity.service.samples import Samples
from proximity.system.time_units import NS_PER_MS

LOGGER = logging.getLogger("proximity.service")
LOST_HANDS = "poses of hands whose fingers are all at one place"
NEVER_NS = np.int64(-(2**63))


class SampleFilter:
    """Keeps, in *kept*, the newest sample of each finger that may be used; *origin* is for the log."""

    future: int  # samples left out because they are from the future
    backwards: int  # … because they are older than the one before
    too_old: int  # … because they are worth nothing when they come
    lost: int  # … because all fingers of their hand are at one place

    def __init__(self, kept: Samples, stale_after_ns: int, origin: str = "input") -> None:
        self.kept = kept
        self.future = self.backwards = self.too_old = self.lost = 0
        self._origin = origin
        self._stale_after_ns = stale_after_ns
        self._refused_ns = np.full(len(kept.pose_ns), NEVER_NS)
        self._defects = np.zeros(len(kept.pose_ns), np.uint8)

    @property
    def notes(self) -> list[str]:
        """A sentence on hands that were lost."""
        return [f"{self._origin}: {self.lost} {LOST_HANDS} are not used"] if self.lost else []

    def start(self, now_ns: int) -> None:
        """Forget all; a finger is unseen since as long as samples are worth something."""
        self.kept.pose_ns[:] = now_ns - self._stale_after_ns
        self.kept.values[:, 0] = np.nan

    def admit(self, newer: Samples, now_ns: int) -> None:
        """Take what may be used of new samples, which are only read.

        One that is left out stays out, and is counted once, also where it is given again.
        """
        kept, defects = self.kept, self._defects
        finger_kernels.admit(
            kept.pose_ns, kept.values, newer.pose_ns, newer.values, self._refused_ns, defects,
            now_ns - self._stale_after_ns, now_ns + MAX_FUTURE_NS,
        )  # fmt: skip
        if not defects.any():
            kept.take_rest(newer, slice(None))
            return
        ahead_ns, too_old = (
            newer.pose_ns - now_ns,
            f"poses older than {self._stale_after_ns / NS_PER_MS:g} ms",
        )
        self.future += self._left_out(FUTURE, self.future, FROM_FUTURE, on_future, ahead_ns)
        self.too_old += self._left_out(TOO_OLD, self.too_old, too_old, on_too_old, -ahead_ns)
        back_ns = kept.pose_ns - newer.pose_ns
        self.backwards += self._left_out(BACKWARDS, self.backwards, OUT_OF_ORDER, on_backwards, back_ns)
        self.lost += self._left_out(finger_kernels.LOST, self.lost, LOST_HANDS, _on_lost, ahead_ns)
        kept.take_rest(newer, defects == USABLE)

    def _left_out(
        self, defect: int, before: int, what: str, advice: Callable[[int], str], off_ns: np.ndarray
    ) -> int:
        """How many samples have that defect; only the first of each is logged, not to make a flood."""
        off_ns = off_ns[self._defects == defect]
        if len(off_ns) and not before:
            LOGGER.warning("%s: %s are not used (%s)", self._origin, what, advice(int(off_ns.max())))
        return len(off_ns)

    def expire(self, now_ns: int) -> None:
        """Forget what is too old."""
        finger_kernels.expire(self.kept.pose_ns, self.kept.values, now_ns - self._stale_after_ns)


def _on_lost(_: int) -> str:
    return "the hand is lost there: send nan"
