"""One page that is connected: what it may do, and what is on its way to it."""

import asyncio
import json
import time
from typing import Any

from proximity.web.page_inbox import PageClock
from proximity.web.server.access import Allowance

MOST_IN_FLIGHT = 2
"""Frames that were sent and that the page has not said to have shown: a slow page skips, and never lags."""
ANSWER_GAP_S = 0.004
"""Between two frames of new poses; 250 a second are more than any screen shows."""
IDLE_GAP_S = 0.012
"""Between two frames of the same poses."""


class PageClient:
    """A page, and the tasks that send to it."""

    def __init__(self, connection: Any, number: int) -> None:
        self.connection, self.number = connection, number
        self.clock, self.allowance = PageClock(), Allowance()
        self.feeds = False
        self.slice_asked: Any = None  # the newest that waits
        self.is_measuring = False
        self._frame: bytes | None = None  # the newest that waits
        self._in_flight = 0
        self._sent_s = 0.0
        self._ready = asyncio.Event()

    def offer(self, data: bytes, *, is_answer: bool) -> None:
        """Have a frame sent, unless too many are on their way; a newer one takes its place.

        *is_answer*: whether it has new poses: it is sent sooner.
        """
        now = time.monotonic()
        if now - self._sent_s >= (ANSWER_GAP_S if is_answer else IDLE_GAP_S):
            self._frame = data
            self._ready.set()

    def acknowledge(self) -> None:
        """Take note that the page has shown a frame."""
        self._in_flight = max(self._in_flight - 1, 0)
        self._ready.set()

    async def send_frames(self) -> None:
        """Send frames as they are offered, until the connection is closed."""
        while True:
            await self._ready.wait()
            self._ready.clear()
            data, self._frame = self._frame, None
            if data is None:
                continue
            if self._in_flight >= MOST_IN_FLIGHT:
                self._frame = data  # or a newer one, when the page has shown one
                continue
            self._in_flight += 1
            self._sent_s = time.monotonic()
            await self.connection.send(data)

    async def send(self, **what: Any) -> None:
        """Send a document."""
        await self.connection.send(json.dumps(what, ensure_ascii=False))
