"""Write frames to a log without waiting for the disk: the loop fills a ring, a thread empties it."""

import logging
import threading
from contextlib import suppress
from typing import Any, Protocol

import numpy as np

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


class LogWriter:
    """Appends frames to a log, in a thread of its own.

    *log*: asked from that thread only, until it is closed. *depth*: frames that wait at most, if they are no
    larger than `MOST_RING_BYTES` together; those beyond are lost, and counted.
    """

    written: int  # frames appended
    failed: int  # frames that the log refused
    lost: int  # frames that found no room

    def __init__(self, log: Log, size: int, depth: int = DEPTH) -> None:
        self.written = self.failed = self.lost = 0
        self.first_failure = ""
        self._log = log
        self._rows = np.empty((min(depth, max(MOST_RING_BYTES // size, FEWEST)), size), np.uint8)
        self._rows.fill(0)  # here, and not page by page in the loop
        self._head = self._tail = 0  # frames put in, and taken out
        self._is_closing = False
        # Held while there is nothing to do: to let go of it wakes the writer, and costs the loop the least.
        self._idle = threading.Lock()
        self._idle.acquire()
        self._thread = threading.Thread(target=self._write_all, name="frame log", daemon=True)
        self._thread.start()

    @property
    def notes(self) -> list[str]:
        """Sentences on frames that were not written, and why."""
        notes = []
        if self.failed:
            notes.append(f"{self.failed} frames were not logged, first: {self.first_failure}")
        if self.lost:
            notes.append(f"{self.lost} frames were not logged: the log was slower than the service")
        return notes

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
        self._thread.join(CLOSE_TIMEOUT)
        if self._thread.is_alive():
            self.lost += self._head - self._tail
            LOGGER.warning("the log does not respond: it is abandoned")

    def _write_all(self) -> None:
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
        try:
            self._log.close()
        except Exception as failure:
            self._count(failure)

    def _append(self, data: np.ndarray) -> None:
        try:
            self._log.append(data)
            self.written += 1
        except Exception as failure:
            self.failed += 1
            self._count(failure)

    def _count(self, failure: Exception) -> None:
        if not self.first_failure:
            self.first_failure = str(failure)
            LOGGER.warning("frames cannot be logged: %s", failure)
