"""Log of a service, written by a thread so that the loop never waits for the disk.

The loop puts frames into a ring in memory, which the thread empties.
"""

import logging
import threading
import time
from typing import Any, Protocol

import numpy as np

from proximity.transport.link import NOTHING
from proximity.transport.shared_memory import PrivateMailbox

LOGGER = logging.getLogger("proximity.service")
DEPTH = 4096
"""Maximum number of waiting frames, which suffices for a disk that blocks for four seconds at 1 kHz."""
CLOSE_TIMEOUT = 5.0
"""Maximum time to write the last frames, s."""
LOG_NAP = 0.005
"""Time between two polls for frames to log, s. Waking for each frame would cost the loop 5 µs."""


class Log(Protocol):
    """Interface of a log to which frames are appended."""

    def append(self, data: np.ndarray) -> Any:
        """Append a frame, (size,) uint8. An implementation may raise an error."""

    def close(self) -> None:
        """Close the log."""


class FrameLogThread:
    """Thread that appends the frames in a mailbox of this process to a log.

    *log*: used only by this thread until it is closed. *size*: size of a frame. *depth*: maximum number of
    waiting frames; the total size is also limited. Frames beyond are lost and counted.
    """

    def __init__(self, log: Log, size: int, depth: int = DEPTH) -> None:
        self.written = 0  # number of appended frames
        self.failed = 0  # number of frames that the log refused
        self.lost = 0  # number of frames for which the ring was full
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
        """Wait until all frames are written, but only some seconds.

        Frames missing from *published* are counted as lost.
        """
        self._is_closing = True
        self._thread.join(CLOSE_TIMEOUT)
        if self._thread.is_alive():
            LOGGER.warning("the log does not respond: it is abandoned")
        self.lost = max(published - self.written - self.failed, 0)

    def _write_all(self) -> None:
        """Append frames until the log is closed, then the remaining ones. It runs in the thread."""
        while True:
            is_closing = self._is_closing  # read before the mailbox is emptied: no frame is put in afterwards
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
