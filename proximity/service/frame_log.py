"""Log of a service: the loop never waits for the disk, it fills a ring, which a thread empties."""

import logging
import threading
import time
from typing import Any, Protocol

import numpy as np

from proximity.transport.link import NOTHING
from proximity.transport.shared_memory import PrivateMailbox

LOGGER = logging.getLogger("proximity.service")
DEPTH = 4096
"""Maximum number of waiting frames: those of a disk that blocks for four seconds at 1 kHz."""
CLOSE_TIMEOUT = 5.0
"""s, time to write the last frames."""
LOG_NAP = 0.005
"""s between two polls for frames to log: waking for each would cost the loop 5 µs a frame."""


class Log(Protocol):
    """A log to which frames are appended."""

    def append(self, data: np.ndarray) -> Any:
        """Append one frame, (size,) uint8; may raise."""

    def close(self) -> None:
        """Close the log."""


class FrameLogThread:
    """Writes the frames that a loop puts into a mailbox of this process to a log, in a separate thread.

    *log*: used from that thread only, until it is closed. *size*: of a frame. *depth*: maximum number of
    waiting frames, within a limit of their total size; further ones are lost, and counted.
    """

    def __init__(self, log: Log, size: int, depth: int = DEPTH) -> None:
        self.written = 0  # frames appended
        self.failed = 0  # frames that the log refused
        self.lost = 0  # frames for which the ring was full
        self._first_failure = ""
        self._log = log
        self._is_closing = False
        self._frame = np.zeros(size, np.uint8)
        self._mailbox = PrivateMailbox(size, depth)
        self.writer = self._mailbox.writer
        self._thread = threading.Thread(target=self._write_all, name="frame log", daemon=True)
        self._thread.start()

    @property
    def notes(self) -> list[str]:
        """Sentences on frames that were not written, with the reasons."""
        notes = []
        if self.failed:
            notes.append(f"{self.failed} frames were not logged, first: {self._first_failure}")
        if self.lost:
            notes.append(f"{self.lost} frames were not logged: the log was slower than the service")
        return notes

    def close(self, published: int) -> None:
        """Wait until all is written, some seconds at most; missing ones of *published* frames are lost."""
        self._is_closing = True
        self._thread.join(CLOSE_TIMEOUT)
        if self._thread.is_alive():
            LOGGER.warning("the log does not respond: it is abandoned")
        self.lost = max(published - self.written - self.failed, 0)

    def _write_all(self) -> None:
        """Append frames until closing, and the remaining ones; the work of the thread."""
        while True:
            is_closing = self._is_closing  # read first: no frame is put in afterwards
            if self._mailbox.receive(self._frame) != NOTHING:
                self._append(self._frame)
            elif is_closing:
                break
            else:
                time.sleep(LOG_NAP)
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
        if not self._first_failure:
            self._first_failure = str(failure)
            LOGGER.warning("frames cannot be logged: %s", failure)
