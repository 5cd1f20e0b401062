"""Server of pages, with files over HTTP and a live connection for each page that has a token.

It runs in one thread with `asyncio`. The caller handles the messages on live connections.
"""

import asyncio
import contextlib
import json
import logging
import math
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from proximity.web.server.access import HELD_UP, HELLO_S, MAX_BYTES, WRONG_TOKEN, Access, UnfitError
from proximity.web.server.page_files import PageFiles

LIVE = "/live"
"""Path of the live connection."""
WITHOUT_TOKEN = "The address has no token: open the address that was printed."
MAX_DIGITS = 20
"""Maximum length of a whole number in a document, including its sign. It suffices for 64 bits."""
LOGGER = logging.getLogger("proximity.web")
QUIET = logging.getLogger("proximity.web.connections")
"""Logger of the WebSocket library, whose messages are not shown. It reports connections without a request as
failures, although browsers open such connections."""
QUIET.addHandler(logging.NullHandler())
QUIET.propagate = False
REASONS = {
    200: "OK",
    403: "Forbidden",
    404: "Not Found",
    421: "Misdirected Request",
}

SHOWN = "/shown/"
"""Prefix of the paths of page contents, which require the token in the header of a request."""

Meet = Callable[[ServerConnection, str], Awaitable[None]]
"""Function that is called with an accepted connection and its token. It returns when the connection ends."""


class PageServer:
    """Serves files and live connections.

    *meet*: function that is called with each accepted live connection. *shown*: contents that require a
    token, by name.
    """

    def __init__(
        self, access: Access, files: PageFiles, meet: Meet, shown: Mapping[str, bytes] | None = None
    ) -> None:
        self.access, self._files, self._meet, self._shown = access, files, meet, shown or {}
        self.refused: dict[str, int] = {}  # number of refusals by reason

    async def listen(self, host: str, port: int, ssl: Any = None) -> Server:
        """Start listening. The caller closes the returned server."""
        return await serve(
            self._page,
            host,
            port,
            ssl=ssl,
            process_request=self._request,
            compression=None,
            max_size=MAX_BYTES,
            max_queue=64,
            open_timeout=HELLO_S,
            logger=QUIET,
            server_header=None,
        )

    def count_refused(self, what: str) -> None:
        """Count a refused page or request by its reason."""
        self.refused[what] = self.refused.get(what, 0) + 1

    async def refuse(self, connection: ServerConnection, code: int, sentence: str) -> None:
        """Close a connection because of an error of its page. Log the first occurrence of each sentence."""
        if sentence not in self.refused:
            LOGGER.warning("a page is disconnected: %s", sentence)
        self.count_refused(sentence)
        with contextlib.suppress(ConnectionClosed):
            await connection.close(code, sentence[:120])

    def _request(self, connection: ServerConnection, request: Request) -> Response | None:
        del connection
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        path = request.path.partition("?")[0]
        is_live = path == LIVE
        if len(hosts) > 1 or len(origins) > 1:
            return self._answer(403, b"A header occurs twice.")
        refusal = self.access.refusal(
            hosts[0] if hosts else None, origins[0] if origins else None, is_live=is_live
        )
        if refusal is not None:
            self.count_refused(refusal[1])
            return self._answer(refusal[0], refusal[1].encode())
        if is_live:
            return None
        if path.startswith(SHOWN):
            return self._answer_shown(request)
        found = self._files.get(path)
        if found is None:
            return self._answer(404, b"There is no such file.")
        kind, content = found
        return self._answer(200, content, {"Content-Type": kind, "Content-Encoding": "gzip"})

    def _answer_shown(self, request: Request) -> Response:
        if self.access.token_of(request.headers.get("Authorization", "").removeprefix("Bearer ")) is None:
            self.count_refused("wrong token")
            return self._answer(403, WITHOUT_TOKEN.encode())
        answer = self._shown.get(request.path.removeprefix(SHOWN))
        if answer is None:
            return self._answer(404, b"There is nothing of that name.")
        return self._answer(200, answer, {"Content-Type": "application/octet-stream"})

    def _answer(self, status: int, body: bytes, more: dict[str, str] | None = None) -> Response:
        headers = Headers({"Content-Type": "text/plain; charset=utf-8"} | self._files.headers | (more or {}))
        headers["Content-Length"] = str(len(body))
        headers["Connection"] = "close"
        return Response(status, REASONS[status], headers, body)

    async def _page(self, connection: ServerConnection) -> None:
        try:
            async with asyncio.timeout(HELLO_S):
                given = document(await connection.recv()).get("hello")
        except TimeoutError:  # for example while a browser without a GPU renders its first picture
            self.count_refused("no token in time")
            await connection.close(HELD_UP, "the page did not send its token in time")
            return
        except (ConnectionClosed, UnfitError):
            given = None
        token = self.access.token_of(given)
        if token is None:
            self.count_refused("wrong token")
            await connection.close(WRONG_TOKEN, WITHOUT_TOKEN)
            return
        await self._meet(connection, token)


def document(data: str | bytes) -> dict[str, Any]:
    """Return the JSON object that a page has sent.

    Raise an error unless its numbers are finite and its texts can be encoded.
    """
    try:
        found = json.loads(data, parse_int=_whole, parse_float=_finite, parse_constant=_finite)
        if "\\u" in str(data):  # only an escape can encode half of a surrogate pair
            json.dumps(found, ensure_ascii=False).encode()
    except UnicodeEncodeError as unfit:
        raise UnfitError("a text has half of a surrogate pair") from unfit
    except (ValueError, RecursionError) as unfit:
        raise UnfitError("a text is not a JSON document") from unfit
    if not isinstance(found, dict):
        raise UnfitError("a document is not an object")
    return found


def _whole(text: str) -> int:
    if len(text) > MAX_DIGITS:
        raise UnfitError(f"a number has {len(text)} digits, expected at most {MAX_DIGITS}")
    return int(text)


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise UnfitError("a number is not finite")
    return number
