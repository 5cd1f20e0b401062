"""Filter of samples: none from the future, none older than the last, none too old."""

import numpy as np

from proximity.message.envelope import MAX_FUTURE_NS
from proximity.service import finger_kernels
from proximity.service.samples import Samples

NEVER_NS = np.int64(-(2**63))


class SampleFilter:
    """Keeps the newest sample of each finger that may be used.

    Parameters
    ----------
    kept : Samples
        Room for them.
    stale_after_ns : int, ns
        Age from which a sample is worth nothing.
    """

    future: int  # samples left out because they are from the future
    backwards: int  # … because they are older than the one before

    def __init__(self, kept: Samples, stale_after_ns: int) -> None:
        self.kept = kept
        self.future = self.backwards = 0
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
        kept = self.kept
        future, backwards = finger_kernels.admit(
            kept.pose_ns, kept.values, newer.pose_ns, newer.values, self._refused_ns, self._taken,
            now_ns + MAX_FUTURE_NS,
        )  # fmt: skip
        self.future += future
        self.backwards += backwards
        kept.take_rest(newer, slice(None) if self._mask.all() else self._mask)

    def expire(self, now_ns: int) -> None:
        """Forget what is too old.

        Parameters
        ----------
        now_ns : int, ns
            The present instant.
        """
        finger_kernels.expire(self.kept.pose_ns, self.kept.values, now_ns - self._stale_after_ns)
