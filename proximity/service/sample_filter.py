"""Which samples may be used: none from the future, none older than what is known, none too old."""

import numpy as np

from proximity.kernels.tracking import finger_rows
from proximity.service.samples import Samples

AHEAD_NS = 5_000_000
"""A pose farther in the future than this is a mistake (PAPER 10)."""


class Gate:
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

    def admit(self, given: Samples, now_ns: int) -> None:
        """Take what may be used of new samples.

        Parameters
        ----------
        given : Samples
            Of as many fingers as are kept. A sample that is left out is overwritten by the one kept: whoever
            gives them again, since something was reported of another finger, does not give that one again.
        now_ns : int, ns
            The present instant.
        """
        kept = self.kept
        future, backwards = finger_rows.admit(
            kept.pose_ns, kept.values, given.pose_ns, given.values, self._taken, now_ns + AHEAD_NS
        )
        self.future += future
        self.backwards += backwards
        if not (future or backwards):
            kept.take_rest(given, slice(None))
            return
        kept.take_rest(given, self._mask)
        is_left_out = ~self._mask
        given.pose_ns[is_left_out] = kept.pose_ns[is_left_out]
        given.values[is_left_out] = kept.values[is_left_out]
        given.take_rest(kept, is_left_out)

    def expire(self, now_ns: int) -> None:
        """Forget what is too old.

        Parameters
        ----------
        now_ns : int, ns
            The present instant.
        """
        finger_rows.expire(self.kept.pose_ns, self.kept.values, now_ns - self._stale_after_ns)
