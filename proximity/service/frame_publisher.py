"""Outputs of a service: publishers, of which some may fail while others go on, and a log.

The loop never waits for the disk: it fills a ring, and a thread empties it.
"""

import logging
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from typing import Any, Protocol

import numpy as np

from proximity.errors import PublishError
from proximity.message import Message
from proximity.transport import Publisher

LOGGER = logging.getLogger("proximity.service")
DEPTH = 4096
"""Frames that wait at most: what a disk that stands still for four seconds delays at 1 kHz."""
MOST_RING_BYTES = 1 << 26
"""That they take at most: of a skin of thousands, 4096 frames would be gigabytes. Eight wait in any case."""
FEWEST = 8
CLOSE_TIMEOUT = 5.0
"""s that the last frames have to be written."""


class Log(Protocol):
    """A log to which frames are appended."""

    def append(self, data: np.ndarray) -> Any:
        """Append one frame, (size,) uint8; may raise."""

    def close(self) -> None:
        """Finish."""


class LogThread:
    """What a thread that appends frames to a log counts and says, wherever it takes the frames from."""

    def __init__(self, log: Log) -> None:
        self.written = 0  # frames appended
        self.failed = 0  # frames that the log refused
        self.lost = 0  # frames that found no room
        self._first_failure = ""
        self._log = log
        self._is_closing = False
        self._thread = threading.Thread(target=self._write_all, name="frame log", daemon=True)

    @property
    def notes(self) -> list[str]:
        """Sentences on frames that were not written, and why."""
        notes = []
        if self.failed:
            notes.append(f"{self.failed} frames were not logged, first: {self._first_failure}")
        if self.lost:
            notes.append(f"{self.lost} frames were not logged: the log was slower than the service")
        return notes

    def _write_all(self) -> None:
        """Append what comes until closing, and what is there then; the work of the thread."""
        self._append_all()
        try:
            self._log.close()
        except Exception as failure:
            self._count(failure)

    def _append_all(self) -> None:
        raise NotImplementedError

    def _append(self, data: np.ndarray) -> None:
        try:
            self._log.append(data)
            self.written += 1
        except Exception as failure:
            self.failed += 1
            self._count(failure)

    def _count(self, failure: Exception) -> None:
        if not self._first_failure:
            self._first_failure = str(failure)
            LOGGER.warning("frames cannot be logged: %s", failure)

    def _has_ended(self) -> bool:
        """Wait until all is written, some seconds at most; whether it is."""
        self._thread.join(CLOSE_TIMEOUT)
        if self._thread.is_alive():
            LOGGER.warning("the log does not respond: it is abandoned")
            return False
        return True


class LogWriter(LogThread):
    """Appends frames to a log, in a thread of its own.

    *log*: asked from that thread only, until it is closed. *depth*: frames that wait at most, if they are no
    larger than `MOST_RING_BYTES` together; those beyond are lost, and counted.
    """

    def __init__(self, log: Log, size: int, depth: int = DEPTH) -> None:
        super().__init__(log)
        self._rows = np.empty((min(depth, max(MOST_RING_BYTES // size, FEWEST)), size), np.uint8)
        self._rows.fill(0)  # here, and not page by page in the loop
        self._head = self._tail = 0  # frames put in, and taken out
        # Held while there is nothing to do: to let go of it wakes the writer, and costs the loop the least.
        self._idle = threading.Lock()
        self._idle.acquire()
        self._thread.start()

    def put(self, data: np.ndarray) -> None:
        """Keep a frame until `wake`; never waits."""
        head = self._head
        if head - self._tail >= len(self._rows):
            self.lost += 1
            return
        self._rows[head % len(self._rows)] = data
        self._head = head + 1

    def wake(self) -> None:
        """Have what was put in written: takes some microseconds, and the other thread wants its turn then."""
        if self._idle.locked():
            with suppress(RuntimeError):  # another thread was first
                self._idle.release()

    def close(self) -> None:
        """Wait until all is written, some seconds at most, and close the log."""
        self._is_closing = True
        self.wake()
        if not self._has_ended():
            self.lost += self._head - self._tail

    def _append_all(self) -> None:
        while True:
            # Asked first: nothing is put in afterwards, so what is found then is all.
            is_closing = self._is_closing
            if self._tail == self._head:
                if is_closing:
                    break
                self._idle.acquire()
                continue
            self._append(self._rows[self._tail % len(self._rows)])
            self._tail += 1


class FramePublisher:
    """Publishes each frame at all addresses, and logs it as the first publisher has sealed it."""

    failures: dict[str, int]  # frames that an address did not take

    def __init__(self, publishers: Sequence[Publisher], log: Log | None, size: int) -> None:
        self.failures = {publisher.address: 0 for publisher in publishers}
        self._publishers = list(publishers)
        self._first_failures: dict[str, str] = {}
        self._undescribed: dict[str, str] = {}
        self._log = None if log is None else LogWriter(log, size)
        self._session, self._unsent = time.time_ns(), 0  # of a log alone

    @property
    def log_written(self) -> int:
        """Frames that the log has."""
        return 0 if self._log is None else self._log.written

    @property
    def log_lost(self) -> int:
        """Frames that it should have, and has not."""
        return 0 if self._log is None else self._log.failed + self._log.lost

    @property
    def notes(self) -> list[str]:
        """Sentences on frames that were not published or logged, and why."""
        notes = [
            f"{address}: {self.failures[address]} frames were not published, first: {failure}"
            for address, failure in list(self._first_failures.items())
        ]
        notes += [
            f"{address}: names of parts and fingers were not published, first: {failure}"
            for address, failure in list(self._undescribed.items())
        ]
        return notes + ([] if self._log is None else self._log.notes)

    def publish(self, message: Message) -> None:
        """Publish a frame, and keep it until `flush_log`."""
        log = self._log
        if log is not None and not self._publishers:
            # A log alone: numbered as a publisher would.
            log.put(message.seal(self._session, self._unsent))
            self._unsent += 1
        for publisher in self._publishers:
            try:
                publisher.publish(message)
            except PublishError as failure:
                self._count(publisher.address, failure)
            if log is not None:
                log.put(message.data)
                log = None

    def publish_description(self, message: Message) -> None:
        """Publish a message of the description: it is not logged, and sent again within a second."""
        for publisher in self._publishers:
            try:
                publisher.publish(message)
            except PublishError as failure:
                if publisher.address not in self._first_failures:  # with frames it is counted
                    self._undescribed.setdefault(publisher.address, str(failure))

    def flush_log(self) -> None:
        """Wake the writer of the log, at the end of a tick."""
        if self._log is not None:
            self._log.wake()

    def close(self) -> None:
        """Close publishers and log."""
        with ExitStack() as stack:
            for publisher in self._publishers:
                stack.callback(publisher.close)
            if self._log is not None:
                stack.callback(self._log.close)

    def _count(self, address: str, failure: PublishError) -> None:
        self.failures[address] += 1
        if address not in self._first_failures:
            self._first_failures[address] = str(failure)
            LOGGER.warning("a frame cannot be published: %s", failure)
