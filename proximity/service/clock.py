"""Clocks that can drive a service's loop instead of the system clock.

All times are whole nanoseconds of one monotonic clock, which also stamps the frames.
"""

import time
from typing import Protocol


class Clock(Protocol):
    """A clock that drives the loop tick by tick instead of the system clock."""

    @property
    def skipped_ns(self) -> int:
        """Lead of this clock over the subscribers' clock, ns."""

    def now_ns(self) -> int:
        """Return the present instant, ns."""

    def sleep_until(self, due_ns: int) -> None:
        """Return when the clock has reached *due_ns*, or immediately if that instant has passed."""


class SkippingClock:
    """A clock that stops while a tick is computed and then jumps to the next tick.

    It serves recordings as fast as possible: no tick is missed or late, and every run gives the same answers.
    The loop subtracts ``skipped_ns`` from all published times, so that a frame is as old to its subscribers
    as its poses were to the tick.
    """

    def __init__(self) -> None:
        self._now_ns = time.monotonic_ns()

    @property
    def skipped_ns(self) -> int:
        """Lead of this clock over the subscribers' clock, ns."""
        return self._now_ns - time.monotonic_ns()

    def now_ns(self) -> int:
        """Return the present instant, ns."""
        return self._now_ns

    def sleep_until(self, due_ns: int) -> None:
        """Advance the clock to *due_ns* without waiting."""
        self._now_ns = max(self._now_ns, due_ns)
