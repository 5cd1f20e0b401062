"""Transport ``ws://127.0.0.1:PORT``, to which web pages of the user connect by WebSockets (extra ``web``).

Both ends listen: published messages go to every connected page, and messages of pages are received here. Ends
of one process at one port and path share the connections, so that a page needs one WebSocket for frames and
poses: ``ws://127.0.0.1:8765`` in ``publish`` and in ``poses``.

Only this machine can connect. A browser sends the site of a page: pages of this machine may connect, and
those of ``?origin=https://HOST``. Other programs of this machine may connect as well, and are trusted.

Sending never waits: a page that does not read misses messages. The newest `BUFFER` messages of pages are kept
until they are received. Any thread may use an end, but only one at a time.
"""

import asyncio
import re
import threading
from collections import deque
from typing import Any, ClassVar

import numpy as np
from websockets.asyncio.server import Server, ServerConnection, broadcast, serve
from websockets.exceptions import ConnectionClosed
from websockets.typing import Origin

from proximity.errors import PublishError
from proximity.transport.address import Address
from proximity.transport.link import NOTHING

BUFFER = 64
"""Maximum number of messages that wait for a reader or for the pages. Beyond, the oldest are lost."""
MAX_MESSAGE = 1 << 21
UNREAD_BYTES = 1 << 17
"""Maximum number of bytes that wait for one page. Beyond, the page misses messages."""
TIMEOUT_S = 10.0
OF_THIS_MACHINE = re.compile(r"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?")
LOCATION = re.compile(r"(localhost|127\.0\.0\.1):(\d{1,5})(/[^?]*)?")


class _Site:
    """A port to which pages connect, shared by all its open ends, and the thread that serves it."""

    sites: ClassVar[dict[int, "_Site"]] = {}
    lock: ClassVar[threading.Lock] = threading.Lock()

    def __init__(self, address: Address, port: int) -> None:
        self.pages: dict[str, set[ServerConnection]] = {}  # connected pages by path
        self.inlets: dict[str, list[WebSocketInlet]] = {}
        self.end_count, self.origin, self._is_due = 0, address.options.get("origin"), False
        self._port, self._to_send = port, deque[tuple[str, bytes]](maxlen=BUFFER)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="pages", daemon=True)
        self._thread.start()
        try:
            self._server: Server = self._call(self._listen())
        except OSError as failure:
            self._stop()
            raise address.refuse(f"cannot listen there ({failure.strerror or failure})") from None

    def send(self, path: str, data: bytes) -> None:
        """Send a message to all pages connected at a path."""
        self._to_send.append((path, data))
        if not self._is_due:
            self._is_due = True
            self._loop.call_soon_threadsafe(self._send_all)

    def close(self) -> None:
        """Close all connections and the port."""
        self._call(self._end())
        self._stop()

    def _call(self, asked: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(asked, self._loop).result(TIMEOUT_S)

    def _stop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(TIMEOUT_S)
        self._loop.close()

    async def _listen(self) -> Server:
        named = [] if self.origin is None else [Origin(self.origin)]
        origins: list[Any] = [None, OF_THIS_MACHINE, *named]
        return await serve(
            self._take, "127.0.0.1", self._port, origins=origins, max_size=MAX_MESSAGE, compression=None
        )

    async def _end(self) -> None:
        self._server.close()
        await self._server.wait_closed()

    async def _take(self, page: ServerConnection) -> None:
        assert page.request is not None
        path = page.request.path.partition("?")[0]
        pages = self.pages.setdefault(path, set())
        pages.add(page)
        try:
            async for message in page:
                for inlet in self.inlets.get(path, ()):
                    inlet.offer(message if isinstance(message, bytes) else message.encode())
        except ConnectionClosed:
            pass
        finally:
            pages.discard(page)

    def _send_all(self) -> None:
        self._is_due = False  # reset first, so that later messages schedule another call
        while self._to_send:
            path, data = self._to_send.popleft()
            pages = self.pages.get(path, ())
            broadcast([page for page in pages if page.transport.get_write_buffer_size() < UNREAD_BYTES], data)


class _End:
    """A sending or receiving end at a port and a path."""

    def __init__(self, address: Address) -> None:
        address.check_options("origin")
        location = LOCATION.fullmatch(address.location)
        if location is None or not 0 < int(location[2]) < 1 << 16:
            raise address.refuse("expected ws://127.0.0.1:PORT or ws://127.0.0.1:PORT/PATH")
        self._text, self._port, self._path = address.text, int(location[2]), location[3] or "/"
        with _Site.lock:
            site = _Site.sites.get(self._port) or _Site(address, self._port)
            if site.origin != address.options.get("origin"):
                raise address.refuse(f"the port is open for pages of {site.origin or 'this machine'} already")
            _Site.sites[self._port] = site
            site.end_count += 1
        self._site: _Site | None = site

    def close(self) -> None:
        """Close this end. The last end of a port closes the port."""
        site, self._site = self._site, None
        if site is None:
            return
        with _Site.lock:
            site.end_count -= 1
            if not site.end_count:
                del _Site.sites[self._port]
                site.close()


class WebSocketOutlet(_End):
    """Sends messages to every connected page."""

    def send(self, data: np.ndarray) -> None:
        """Pass a message to the thread that serves the port."""
        if self._site is None:
            raise PublishError(f"{self._text}: is closed, it cannot send")
        self._site.send(self._path, data.tobytes())


class WebSocketInlet(_End):
    """Receives messages of all connected pages."""

    shares_clock = False
    refused = 0
    is_keyed, unverified = False, 0

    def __init__(self, address: Address) -> None:
        super().__init__(address)
        self._waiting: deque[bytes] = deque(maxlen=BUFFER)
        self._has_message = threading.Event()
        assert self._site is not None
        self._site.inlets.setdefault(self._path, []).append(self)

    def offer(self, message: bytes) -> None:
        """Store a message until it is received."""
        self._waiting.append(message)
        self._has_message.set()

    def receive(self, buffer: np.ndarray) -> int:
        """Receive the oldest stored message."""
        try:
            data = self._waiting.popleft()
        except IndexError:
            return NOTHING
        taken = min(len(data), len(buffer))
        buffer.data[:taken] = data[:taken]
        return len(data)

    def wait(self, timeout: float) -> bool:
        """Wait for a message."""
        if not self._waiting:
            self._has_message.clear()
            if not self._waiting:  # no message came before the flag was cleared
                self._has_message.wait(timeout)
        return bool(self._waiting)

    def close(self) -> None:
        """Close the end."""
        if self._site is not None:
            self._site.inlets[self._path].remove(self)
        super().close()


open_outlet = WebSocketOutlet
open_inlet = WebSocketInlet
