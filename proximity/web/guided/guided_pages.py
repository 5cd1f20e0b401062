"""Server of guided pages, in a thread of the program that asks.

The person's page answers; watching pages see the same and numbers of their own, and can stop. What is to be
shown is kept by topics, and every page is sent the topics that are newer than what it has.
"""

import asyncio
import json
import queue
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from proximity.errors import MissingLibraryError, ServiceError
from proximity.system.extras import needed
from proximity.web.guided.steps import Answer, FieldError, Step
from proximity.web.server.access import LOOPBACK, TOO_MUCH, UNFIT, Access, Allowance, UnfitError, new_token
from proximity.web.server.page_files import PageFiles

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection

PAGE = Path(__file__).parent / "page"
LOOK_S = 0.01  # between two looks for something new to be sent
GONE_S = 5.0  # for so long a page may be away, as while it is loaded again
END_S = 1.0  # within that pages are told that it is over
MOST_PAGES = 8
ELSEWHERE = 4409  # code with which a page is closed when another takes its place


class PageLeftError(Exception):
    """The person's page was closed and did not come back."""


class StoppedError(Exception):
    """Somebody pressed the emergency stop."""


class GuidedPages:
    """Pages that a program leads, from the beginning to the end of a ``with`` block.

    *has_stop*: whether the person's page has an emergency stop, too; watching pages always have one.
    *on_stop*: is called once at an emergency stop, at once and by the thread of the server: it must be quick.
    *port*: where to listen on this machine; 0: any that is free.

    Notes
    -----
    Thread: `show` and `say` may be called by any; the others by one.
    """

    ending = "This is over. You can close the page."
    """What pages say at the end."""

    def __init__(
        self,
        title: str,
        *,
        has_stop: bool = False,
        on_stop: Callable[[], object] | None = None,
        port: int = 0,
    ) -> None:
        self.stopped = threading.Event()  # set by the emergency stop; clear it, to go on
        self._on_stop, self._port = on_stop, port
        self._failure: Exception | None = None
        self._tokens = new_token(), new_token()  # of the person's page, and of those that watch
        self._shown, self._due = (0, Step(title)), float("inf")
        self._answers: queue.SimpleQueue[tuple[int, Answer] | None] = queue.SimpleQueue()
        self._topics: dict[str, tuple[int, Any]] = {}  # what is to be shown, with its version
        self._tell("welcome", {"title": title, "has_stop": has_stop})
        self._tell("step", self._shown[1].document(0))
        self._person: ServerConnection | None = None
        self._left_s: float | None = None  # when the person's page went
        self._watching = 0
        self._begun, self._over = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="guided pages", daemon=True)

    def __enter__(self) -> "GuidedPages":
        self._thread.start()
        self._begun.wait()
        if self._failure is not None:
            raise self._failure
        return self

    def __exit__(self, *unused: object) -> None:
        self._tell("end", self.ending)
        self._over.set()
        self._thread.join()

    @property
    def url(self) -> str:
        """Address of the person's page, with its token."""
        return f"http://{LOOPBACK[0]}:{self._port}/#token={self._tokens[0]}"

    @property
    def watch_url(self) -> str:
        """Address of the pages that watch and stop."""
        return f"http://{LOOPBACK[0]}:{self._port}/#token={self._tokens[1]}"

    def present(self, step: Step) -> None:
        """Show a step, and go on; `wait` takes its answer.

        *step*: takes the place of the one before, whose answer no longer counts.
        """
        number = self._shown[0] + 1
        self._shown = number, step
        self._due = time.monotonic() + step.seconds if step.seconds is not None else float("inf")
        self._tell("stopped", self.stopped.is_set())
        self._tell("notice", "")
        self._tell("step", step.document(number))

    def wait(self, timeout: float | None = None) -> Answer | None:
        """Wait for the answer to the step that is shown; None: there is none yet.

        *timeout*: how long to wait; None: until there is one.
        """
        ends = float("inf") if timeout is None else time.monotonic() + timeout
        while True:
            self._check()
            now = time.monotonic()
            with suppress(queue.Empty):
                answered = self._answers.get(timeout=max(min(ends - now, self._due - now, 0.1), 0.0))
                if answered is not None and answered[0] == self._shown[0]:
                    return answered[1]
                continue
            if time.monotonic() >= self._due:
                return Answer("", {}, self._shown[1].seconds or 0.0)
            if time.monotonic() >= ends:
                return None

    def ask(self, step: Step) -> Answer:
        """Show a step, and wait for its answer; raises what `wait` raises.

        *step*: with buttons, or with a time that ends it.
        """
        self.present(step)
        answer = self.wait()
        assert answer is not None, "without a timeout there is an answer"
        return answer

    def show(self, numbers: Mapping[str, str], watched: Mapping[str, str] | None = None) -> None:
        """Show live numbers, which stay until others take their place."""
        self._tell("live", dict(numbers))
        if watched is not None:
            self._tell("watched", dict(watched))

    def say(self, sentence: str) -> None:
        """Show a sentence until the next step."""
        self._tell("notice", sentence)

    def _tell(self, topic: str, content: Any) -> None:
        version, before = self._topics.get(topic, (0, None))
        if content != before:
            self._topics[topic] = version + 1, content

    def _check(self) -> None:
        if self.stopped.is_set():
            raise StoppedError("the emergency stop was pressed") from self._failure
        left = self._left_s
        if left is not None and time.monotonic() > left + GONE_S:
            raise PageLeftError("the page was closed")

    # The thread of the server

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except MissingLibraryError as missing:
            self._failure = missing
        except OSError as unfit:
            self._failure = ServiceError(f"no page can be served at port {self._port} ({unfit.strerror})")
        finally:
            self._begun.set()

    async def _serve(self) -> None:
        with needed("the page needs", "web"):
            from proximity.web.server.page_server import PageServer

        self._server = PageServer(Access(self._tokens, frozenset()), PageFiles(PAGE, {}), self._meet)
        listening = await self._server.listen(LOOPBACK[0], self._port)
        self._port = listening.sockets[0].getsockname()[1]
        self._server.access = Access.of(self._tokens, LOOPBACK, self._port, is_secure=False)
        self._begun.set()
        while not self._over.is_set():
            await asyncio.sleep(LOOK_S)
        ends = time.monotonic() + END_S
        while (self._person is not None or self._watching) and time.monotonic() < ends:
            await asyncio.sleep(LOOK_S)
        listening.close()
        await listening.wait_closed()

    async def _meet(self, connection: "ServerConnection", token: str) -> None:
        is_watching = token == self._tokens[1]
        if self._watching >= MOST_PAGES and is_watching:
            await self._server.refuse(connection, TOO_MUCH, f"there are {MOST_PAGES} pages connected already")
            return
        if is_watching:
            self._watching += 1
        else:
            self._person, self._left_s = connection, None
        sending = asyncio.create_task(self._send(connection, is_watching=is_watching))
        try:
            await self._take(connection)
        finally:
            sending.cancel()
            if is_watching:
                self._watching -= 1
            elif self._person is connection:
                self._person, self._left_s = None, time.monotonic()

    async def _send(self, connection: "ServerConnection", *, is_watching: bool) -> None:
        """Send what is new, until the connection is closed or all is over."""
        sent: dict[str, int] = {}
        while "end" not in sent:
            if not is_watching and self._person is not connection:
                await connection.close(ELSEWHERE, "the page was opened elsewhere")
            for topic, (version, content) in tuple(self._topics.items()):
                if sent.get(topic) != version and (is_watching or topic != "watched"):
                    sent[topic] = version
                    if topic == "welcome":
                        content = {**content, "is_watching": is_watching}
                    await connection.send(json.dumps({topic: content}, ensure_ascii=False))
            await asyncio.sleep(LOOK_S)
        await connection.close()

    async def _take(self, connection: "ServerConnection") -> None:
        """Take what a page sends, until its connection is closed."""
        from websockets.exceptions import ConnectionClosed

        from proximity.web.server.page_server import document

        allowance = Allowance()
        with suppress(ConnectionClosed):
            async for data in connection:
                try:
                    asked = document(data) if allowance.allows(len(data)) else {}
                    if "stop" in asked:
                        self._stop()
                    elif "answer" in asked and connection is self._person:
                        await self._answer(connection, asked["answer"])
                    else:
                        raise UnfitError("a page may answer and stop, and no more than a person can")
                except UnfitError as unfit:
                    await self._server.refuse(connection, UNFIT, str(unfit))

    async def _answer(self, connection: "ServerConnection", given: Any) -> None:
        number, step = self._shown
        if not isinstance(given, dict):
            raise UnfitError("an answer is no object")
        if given.get("number") != number:
            return  # under way when the next step came
        try:
            self._answers.put((number, step.answer(given)))
        except FieldError as unfit:
            await connection.send(json.dumps({"refused": str(unfit)}))

    def _stop(self) -> None:
        if self.stopped.is_set():
            return
        self.stopped.set()
        try:
            if self._on_stop is not None:
                self._on_stop()
        except Exception as failure:
            self._failure = failure
        self._answers.put(None)
        self._tell("stopped", True)
