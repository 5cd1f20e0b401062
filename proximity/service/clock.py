"""Clocks that a service keeps its appointments by.

All times are whole nanoseconds of one monotonic clock, the one that frames are stamped with.
"""

import time
from typing import Protocol

SECOND = 1_000_000_000
"""ns."""


class Clock(Protocol):
    """What the loop asks for the time, and waits by."""

    skipped_ns: int
    """How far it is ahead of the clock that subscribers read."""

    def now_ns(self) -> int:
        """Return the present instant, ns."""

    def sleep_until(self, due_ns: int) -> None:
        """Return at that instant, or at once where it is past; never before."""


class MonotonicClock:
    """The system's monotonic clock, as ``time.monotonic_ns`` and C's ``CLOCK_MONOTONIC`` read it.

    Parameters
    ----------
    spin : float, s
        Sleep until that long before the instant, and look at the clock without pause from then on. It makes
        up for a system that wakes late, and keeps a core busy meanwhile.
    """

    skipped_ns = 0

    def __init__(self, spin: float = 0.0) -> None:
        self._spin_ns = round(SECOND * spin)
        self.now_ns = time.monotonic_ns

    def sleep_until(self, due_ns: int) -> None:
        """Sleep, then spin.

        Parameters
        ----------
        due_ns : int, ns
            The instant.
        """
        now_ns = time.monotonic_ns
        wakes_ns = due_ns - self._spin_ns
        left = wakes_ns - now_ns()
        while left > 0:
            time.sleep(1e-9 * left)
            left = wakes_ns - now_ns()
        while now_ns() < due_ns:
            pass


class SkippingClock:
    """A clock whose waits take no time: it jumps to the instant instead. For recordings, as fast as it goes.

    What is computed takes as long as it takes. The loop takes ``skipped_ns`` off all times that it publishes,
    so that a frame is as old to its subscribers as its poses were to the tick.
    """

    skipped_ns: int

    def __init__(self) -> None:
        self.skipped_ns = 0

    def now_ns(self) -> int:
        """Return the present instant, ns, all waits counted."""
        return time.monotonic_ns() + self.skipped_ns

    def sleep_until(self, due_ns: int) -> None:
        """Jump.

        Parameters
        ----------
        due_ns : int, ns
            The instant.
        """
        self.skipped_ns += max(due_ns - self.now_ns(), 0)
