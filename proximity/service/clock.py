"""Clocks of the service's loop.

All times are whole nanoseconds of one monotonic clock, the one that frames are stamped with.
"""

import time
from typing import Protocol

from proximity.system.time_units import NS_PER_S


class Clock(Protocol):
    """A clock that the loop reads and waits on."""

    @property
    def skipped_ns(self) -> int:
        """Time by which it is ahead of the clock that subscribers read, ns."""

    def stopwatch_ns(self) -> int:
        """Return what durations are measured by, ns: it runs even where the clock stands still."""

    def now_ns(self) -> int:
        """Return the present instant, ns."""

    def sleep_until(self, due_ns: int) -> None:
        """Return at that instant, or at once where it is past; never before."""


class MonotonicClock:
    """The system's monotonic clock, as ``time.monotonic_ns`` and C's ``CLOCK_MONOTONIC`` read it.

    *spin*: sleep until that long before the instant, and look at the clock without pause from then on. It
    makes up for a system that wakes late, and keeps a core busy meanwhile.
    """

    skipped_ns = 0

    def __init__(self, spin: float = 0.0) -> None:
        self._spin_ns = round(NS_PER_S * spin)
        self.now_ns = self.stopwatch_ns = time.monotonic_ns

    def sleep_until(self, due_ns: int) -> None:
        """Sleep, then spin."""
        now_ns = time.monotonic_ns
        wakes_ns = due_ns - self._spin_ns
        left = wakes_ns - now_ns()
        while left > 0:
            time.sleep(1e-9 * left)
            left = wakes_ns - now_ns()
        while now_ns() < due_ns:
            pass


class SkippingClock:
    """A clock that stands still while a tick is computed, and jumps to the next: as fast as it goes.

    For recordings: each tick is there, none is late, and every run answers the same. The loop takes
    ``skipped_ns`` off all times that it publishes, so that a frame is as old to its subscribers as its poses
    were to the tick.
    """

    def __init__(self) -> None:
        self._now_ns = time.monotonic_ns()
        self.stopwatch_ns = time.monotonic_ns

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
