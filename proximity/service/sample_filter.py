"""Filter of samples: none from the future, none older than the last, none too old."""

import logging

import numpy as np

from proximity.message.envelope import MAX_FUTURE_NS
from proximity.message.instant_advice import on_backwards, on_future, on_too_old
from proximity.service import finger_kernels
from proximity.service.samples import Samples
from proximity.system.time_units import NS_PER_MS

LOGGER = logging.getLogger("proximity.service")
NEVER_NS = np.int64(-(2**63))


class SampleFilter:
    """Keeps the newest sample of each finger that may be used.

    Parameters
    ----------
    kept : Samples
        Room for them.
    stale_after_ns : int, ns
        Age from which a sample is worth nothing.
    origin : str
        Where samples come from, for the log.
    """

    future: int  # samples left out because they are from the future
    backwards: int  # … because they are older than the one before
    too_old: int  # … because they are worth nothing when they come

    def __init__(self, kept: Samples, stale_after_ns: int, origin: str = "input") -> None:
        self.kept = kept
        self.future = self.backwards = self.too_old = 0
        self._origin = origin
        self._stale_after_ns = stale_after_ns
        self._refused_ns = np.full(len(kept.pose_ns), NEVER_NS)
        self._taken = np.zeros(len(kept.pose_ns), np.uint8)
        self._mask = self._taken.view(bool)

    def start(self, now_ns: int) -> None:
        """Forget all; a finger is unseen since as long as samples are worth something.

        Parameters
        ----------
        now_ns : int, ns
            The present instant.
        """
        self.kept.pose_ns[:] = now_ns - self._stale_after_ns
        self.kept.values[:, 0] = np.nan

    def admit(self, newer: Samples, now_ns: int) -> None:
        """Take what may be used of new samples.

        Parameters
        ----------
        newer : Samples
            Of as many fingers as are kept; only read. One that is left out stays out, and is counted once,
            also where it is given again because something was reported of another finger.
        now_ns : int, ns
            The present instant.
        """
        kept, mask = self.kept, self._mask
        self._refuse_too_old(newer, now_ns)
        future, backwards = finger_kernels.admit(
            kept.pose_ns, kept.values, newer.pose_ns, newer.values, self._refused_ns, self._taken,
            now_ns + MAX_FUTURE_NS,
        )  # fmt: skip
        # Only the first of each: a warning at every message would be a flood.
        if future and not self.future:
            self._warn("poses from the future", on_future(int(newer.pose_ns[~mask].max()) - now_ns))
        if backwards and not self.backwards:
            is_back = ~mask & (newer.pose_ns < kept.pose_ns)
            back_ns = int((kept.pose_ns - newer.pose_ns)[is_back].max())
            self._warn("poses older than the one before", on_backwards(back_ns))
        self.future += future
        self.backwards += backwards
        kept.take_rest(newer, slice(None) if mask.all() else mask)

    def _refuse_too_old(self, newer: Samples, now_ns: int) -> None:
        """Have the kernel leave out, and count, the samples that are worth nothing when they come."""
        is_too_old = newer.pose_ns < now_ns - self._stale_after_ns
        if is_too_old.any():
            is_too_old &= np.isfinite(newer.values).all(axis=1)
            # One that was admitted when it was young has grown old here.
            is_too_old &= (newer.pose_ns != self.kept.pose_ns) & (newer.pose_ns != self._refused_ns)
            count = int(is_too_old.sum())
            if count and not self.too_old:
                age = now_ns - int(newer.pose_ns[is_too_old].max())
                self._warn(f"poses older than {self._stale_after_ns / NS_PER_MS:g} ms", on_too_old(age))
            self.too_old += count
            self._refused_ns[is_too_old] = newer.pose_ns[is_too_old]

    def _warn(self, what: str, advice: str) -> None:
        LOGGER.warning("%s: %s are not used (%s)", self._origin, what, advice)

    def expire(self, now_ns: int) -> None:
        """Forget what is too old.

        Parameters
        ----------
        now_ns : int, ns
            The present instant.
        """
        finger_kernels.expire(self.kept.pose_ns, self.kept.values, now_ns - self._stale_after_ns)
