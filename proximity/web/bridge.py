"""The bridge between pages and a service: files over HTTP, frames down, poses and moves up.

One thread, `asyncio`. It computes no distances. Text sent to a page is a JSON document with few keys; binary
data are messages of `proximity.message`, identified by their first four bytes.
"""

import asyncio
import contextlib
import json
import time
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from proximity.web.page_inbox import HeldUpError, PageClock
from proximity.web.server.access import HELD_UP, TOO_MUCH, UNFIT, Access, Allowance, UnfitError
from proximity.web.server.page_files import PageFiles
from proximity.web.server.page_server import PageServer, document
from proximity.web.sources import LiveFrames, LoggedFrames, Shown

LOOK_S = 0.001
"""Time between two polls for a new frame, while a page is connected."""
IDLE_LOOK_S = 0.05
MAX_PAGES = 8
LATEST_MS = 1e12
"""Maximum of a page's clock."""
MAX_IN_FLIGHT = 2
"""Frames sent without an acknowledgement: a slow page skips, and never lags."""
ANSWER_GAP_S = 0.004
"""Time between two frames of new poses; 250 a second are more than any display shows."""
IDLE_GAP_S = 0.012
"""Time between two frames of the same poses."""


class PageClient:
    """A page, and the tasks that send to it."""

    def __init__(self, connection: Any) -> None:
        self.connection = connection
        self.clock, self.allowance = PageClock(), Allowance()
        self.feeds = False
        self._frame: bytes | None = None  # the newest that waits
        self._in_flight = 0
        self._sent_s = 0.0
        self._ready = asyncio.Event()

    def offer(self, data: bytes, *, is_answer: bool) -> None:
        """Queue a frame to send, unless too many are under way; it replaces an older one.

        *is_answer*: whether it has new poses: it is sent sooner.
        """
        now = time.monotonic()
        if now - self._sent_s >= (ANSWER_GAP_S if is_answer else IDLE_GAP_S):
            self._frame = data
            self._ready.set()

    def acknowledge(self) -> None:
        """Count a frame as shown by the page."""
        self._in_flight = max(self._in_flight - 1, 0)
        self._ready.set()

    async def send_frames(self) -> None:
        """Send offered frames until the connection is closed."""
        while True:
            await self._ready.wait()
            self._ready.clear()
            data, self._frame = self._frame, None
            if data is None:
                continue
            if self._in_flight >= MAX_IN_FLIGHT:
                self._frame = data  # or a newer one, after an acknowledgement
                continue
            self._in_flight += 1
            self._sent_s = time.monotonic()
            await self.connection.send(data)

    async def send(self, **what: Any) -> None:
        """Send a document."""
        await self.connection.send(json.dumps(what, ensure_ascii=False))


class Bridge:
    """Pages and their contents."""

    def __init__(self, shown: Shown, access: Access, files: PageFiles) -> None:
        self.server = PageServer(access, files, self._serve_page, shown.content)
        self._shown = shown
        self._clients: list[PageClient] = []
        self._tasks: set[asyncio.Task[Any]] = set()

    async def publish_frames(self) -> None:
        """Send frames of the service to pages, until cancelled; pages request those of a log."""
        frames = self._shown.frames
        while isinstance(frames, LiveFrames):
            await asyncio.sleep(LOOK_S if self._clients else IDLE_LOOK_S)
            for message in self._shown.others.messages():
                self._broadcast(message)
            new = frames.newest()
            if new is None:
                continue
            if new.is_new_run:
                self._shown.feed.resend()
            for client in self._clients:
                client.offer(new.data, is_answer=new.is_answer)

    async def _serve_page(self, connection: ServerConnection, token: str) -> None:
        if len(self._clients) >= MAX_PAGES:
            await connection.close(TOO_MUCH, f"there are {MAX_PAGES} pages connected already")
            return
        client = PageClient(connection)
        sending = asyncio.create_task(client.send_frames())
        try:
            await self._welcome(client)
            async for data in connection:
                self._receive(client, data)
        except ConnectionClosed:
            pass
        except HeldUpError as held_up:
            await self.server.refuse(connection, HELD_UP, str(held_up))
        except UnfitError as unfit:
            await self.server.refuse(connection, UNFIT, str(unfit))
        except _TooMuchError as flood:
            await self.server.refuse(connection, TOO_MUCH, str(flood))
        finally:
            sending.cancel()
            self._remove(client)
            with contextlib.suppress(asyncio.CancelledError, ConnectionClosed):
                await sending

    async def _welcome(self, client: PageClient) -> None:
        shown, feed = self._shown, self._shown.feed
        client.feeds = not any(other.feeds for other in self._clients)
        await client.send(
            welcome={
                "title": shown.title,
                "feeds": client.feeds,
                "may_pose": feed.may_pose,
                "may_move": feed.may_move,
                "may_hide": feed.may_hide,
                "finger_count": feed.count,
                "has_geometry": shown.scene is not None,
                **shown.about,
            }
        )
        for message in feed.state():
            await client.connection.send(message)
        self._clients.append(client)

    def _remove(self, client: PageClient) -> None:
        """Remove a page; its fingers are no longer tracked, and another page may feed."""
        if client not in self._clients:
            return
        self._clients.remove(client)
        if client.feeds:
            self._shown.feed.release()
            for other in self._clients[:1]:
                self._set_feeder(other)

    def _set_feeder(self, client: PageClient) -> None:
        for other in self._clients:
            if other.feeds != (other is client):
                other.feeds = other is client
                self._run_beside(other.send(feeds=other.feeds))

    def _receive(self, client: PageClient, data: str | bytes) -> None:
        if not client.allowance.allows(len(data)):
            raise _TooMuchError("too many messages")
        if isinstance(data, bytes):
            if not client.feeds:
                return  # sent before another page took over
            done = self._shown.feed.receive(data, client.clock)
            if done is not None:
                self._broadcast(done)
            return
        if data == "ok":
            client.acknowledge()
            return
        asked = document(data)
        if "clock" in asked:
            theirs, now_ns = _number(asked["clock"]), time.monotonic_ns()
            with contextlib.suppress(HeldUpError):  # only poses and moves must be recent
                client.clock.ahead_ns(round(1e6 * theirs), now_ns)
            self._run_beside(client.send(clock=theirs, now_ns=str(now_ns)))
        elif "feed" in asked:
            self._shown.feed.release()
            self._set_feeder(client)
        elif ("at_ms" in asked or "place" in asked) and isinstance(self._shown.frames, LoggedFrames):
            self._run_beside(self._show_logged(client, self._shown.frames, asked))
        else:
            raise UnfitError(f"a page may not request {', '.join(map(str, asked))[:60]!r}")

    async def _show_logged(self, client: PageClient, frames: LoggedFrames, asked: dict[str, Any]) -> None:
        try:
            place = frames.place_at(float(asked["at_ms"])) if "at_ms" in asked else int(asked["place"])
        except (TypeError, ValueError, OverflowError):
            return
        place = min(max(place, 0), frames.count - 1)
        await client.send(place=place, ms=frames.ms_at(place))
        await client.connection.send(frames.at(place))

    def _broadcast(self, data: bytes) -> None:
        for client in self._clients:
            self._run_beside(client.connection.send(data))

    def _run_beside(self, coroutine: Any) -> None:
        """Run a coroutine as a task; a disconnected page is not an error."""

        async def guarded() -> None:
            with contextlib.suppress(ConnectionClosed):
                await coroutine

        task = asyncio.ensure_future(guarded())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


class _TooMuchError(Exception):
    pass


def _number(given: Any) -> float:
    if isinstance(given, bool) or not isinstance(given, int | float) or not abs(given) < LATEST_MS:
        raise UnfitError("a request for the clock needs a number of milliseconds")
    return float(given)
