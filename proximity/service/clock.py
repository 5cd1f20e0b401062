"""Clocks that a service's loop is driven by in place of the system's.

All times are whole nanoseconds of one monotonic clock, the one that frames are stamped with.
"""

import time
from typing import Protocol


class Clock(Protocol):
    """A clock that the loop is driven by, tick by tick, in place of the system's."""

    @property
    def skipped_ns(self) -> int:
        """Time by which it is ahead of the clock that subscribers read, ns."""

    def now_ns(self) -> int:
        """Return the present instant, ns."""

    def sleep_until(self, due_ns: int) -> None:
        """Return at that instant, or at once where it is past; never before."""


class SkippingClock:
    """A clock that stands still while a tick is computed, and jumps to the next: as fast as it goes.

    For recordings: each tick is there, none is late, and every run answers the same. The loop takes
    ``skipped_ns`` off all times that it publishes, so that a frame is as old to its subscribers as its poses
    were to the tick.
    """

    def __init__(self) -> None:
        self._now_ns = time.monotonic_ns()

    @property
    def skipped_ns(self) -> int:
        """Time by which it is ahead of the clock that subscribers read, ns."""
        return self._now_ns - time.monotonic_ns()

    def now_ns(self) -> int:
        """Return the instant that it stands at, ns."""
        return self._now_ns

    def sleep_until(self, due_ns: int) -> None:
        """Jump."""
        self._now_ns = max(self._now_ns, due_ns)
