"""Ends of the loop that only Python can serve: mailboxes in this process, and their threads."""

import logging
import threading
import time
from contextlib import AbstractContextManager, nullcontext

import numpy as np

from proximity.errors import PublishError
from proximity.message import DESCRIPTION, FRAME, MEASURED, PATH_POSES
from proximity.message.description import MAX_LABELS
from proximity.message.envelope import unpack_prefix
from proximity.service.inputs.sources import PolledInput
from proximity.service.realtime import RealTime, sharp_timers
from proximity.transport import Publisher
from proximity.transport.link import NOTHING
from proximity.transport.publisher import outlet_of
from proximity.transport.shared_memory import PrivateMailbox

LOGGER = logging.getLogger("proximity.service")
APART = 4e-4
"""s between two polls: a flood of invalid messages must not occupy a core."""
LOOK = 0.02
"""s between two checks of these threads for the end."""


class Worker:
    """A thread that repeats a piece of work until it is closed."""

    failure: BaseException | None = None  # that ended it

    def __init__(self) -> None:
        self._is_closing = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self, real_time: RealTime | None) -> None:
        """Start; with priority if the loop has it."""
        prior = nullcontext() if real_time is None else real_time.beside()
        self._thread = threading.Thread(target=self._run, args=(prior,), name="beside the loop", daemon=True)
        self._thread.start()

    def _run(self, prior: AbstractContextManager[None]) -> None:
        try:
            with sharp_timers(), prior:
                while not self._is_closing.is_set():
                    self._work()
        except BaseException as failure:
            self.failure = failure

    def close(self) -> None:
        """End the thread."""
        self._is_closing.set()
        if self._thread is not None:
            self._thread.join()

    def _work(self) -> None:
        """Wait for new work, and do it; the work of the thread."""
        raise NotImplementedError


class PoseBridge(Worker):
    """Puts the poses of an input into a mailbox read by the loop.

    *count*: of fingers. *period_ns*: of ticks; an input that cannot wait is polled twice in each.
    """

    def __init__(self, pose_input: PolledInput, count: int, period_ns: int) -> None:
        super().__init__()
        self._input = pose_input
        self._nap = APART if self.waits else max(0.5e-9 * period_ns, APART)
        self._mailbox = PrivateMailbox(max(PATH_POSES.size(count), MEASURED.size(count)))
        self._publisher = Publisher(self._mailbox, "")
        self.reader = self._mailbox.reader

    @property
    def waits(self) -> bool:
        """True if its thread can wait for poses; otherwise it polls."""
        return hasattr(self._input, "wait")

    def poll(self, now_ns: int) -> None:
        """Write new poses to the mailbox."""
        for samples in self._input.poll(now_ns):
            self._publisher.publish(samples.message())

    def _work(self) -> None:
        if self.waits:
            self._input.wait(LOOK)  # type: ignore[attr-defined]
        self.poll(time.monotonic_ns())
        time.sleep(self._nap)


class FrameBridge(Worker):
    """Sends sealed frames from a mailbox written by the loop, by the outlet of a publisher.

    *size*: of a frame.
    """

    def __init__(self, publisher: Publisher, size: int) -> None:
        super().__init__()
        self.failures = 0  # frames that were not sent
        self.notes: list[str] = []
        self.first_failure = ""
        self._publisher, self._outlet = publisher, outlet_of(publisher)
        self._sent = 0  # frames, including failed ones
        self._buffer = np.zeros(max(size, DESCRIPTION.size(MAX_LABELS)), np.uint8)
        self._mailbox = PrivateMailbox(len(self._buffer))
        self.writer = self._mailbox.writer

    def send_all(self) -> None:
        """Send all frames in the mailbox."""
        while (size := self._mailbox.receive(self._buffer)) != NOTHING:
            data = self._buffer[:size]
            is_frame = unpack_prefix(data.data)[0] == FRAME.magic
            self._sent += is_frame
            try:
                self._outlet.send(data)
            except PublishError as failure:
                self._count(str(failure), is_frame=is_frame)

    def send_rest(self, published: int) -> None:
        """End the thread, and send the rest; missing ones of *published* frames were overwritten."""
        self.close()
        self.send_all()
        overtaken = published - self._sent
        if overtaken > 0:
            self._sent, self.failures = published, self.failures + overtaken
            self.notes.append(f"{self._publisher.address}: {overtaken} frames were overtaken by others")

    def _work(self) -> None:
        if self._mailbox.wait(LOOK):
            self.send_all()

    def _count(self, failure: str, *, is_frame: bool) -> None:
        address = self._publisher.address
        self.failures += is_frame
        if is_frame and not self.first_failure:
            self.first_failure = failure
            LOGGER.warning("a frame cannot be published: %s", failure)
        elif not is_frame and not self.first_failure and not self.notes:
            self.notes.append(f"{address}: names of parts and fingers were not published, first: {failure}")
