"""The log of a loop of compiled code: a thread reads the frames in a mailbox of its own and appends them."""

import logging
import threading
import time

import numpy as np

from proximity.service.frame_publisher import CLOSE_TIMEOUT, DEPTH, FEWEST, MOST_RING_BYTES, Log
from proximity.transport.link import NOTHING
from proximity.transport.shared_memory import PrivateMailbox

LOGGER = logging.getLogger("proximity.service")
LOG_NAP = 0.005
"""s between two looks at the frames to be logged: to be woken by each would cost the loop 5 µs a frame."""


class MailboxLog:
    """Appends the frames of a loop of compiled code to a log, in a thread of its own.

    *size*: of a frame.
    """

    def __init__(self, log: Log, size: int) -> None:
        self.written = self.failed = self.lost = 0
        self._first_failure = ""
        self._log, self._frame = log, np.zeros(size, np.uint8)
        ring = 1 << (min(DEPTH * (size + 32), MOST_RING_BYTES) - 1).bit_length()
        self._mailbox = PrivateMailbox(max(ring, 1 << (FEWEST * size).bit_length()))
        self.writer = self._mailbox.writer
        self._is_closing = False
        self._thread = threading.Thread(target=self._write_all, name="frame log", daemon=True)
        self._thread.start()

    @property
    def notes(self) -> list[str]:
        """Sentences on frames that were not written, and why."""
        notes = []
        if self.failed:
            notes.append(f"{self.failed} frames were not logged, first: {self._first_failure}")
        if self.lost > self.failed:
            notes.append(
                f"{self.lost - self.failed} frames were not logged: the log was slower than the service"
            )
        return notes

    def close(self, published: int) -> None:
        """Wait until all is written, some seconds at most; those missing of *published* frames are lost."""
        self._is_closing = True
        self._thread.join(CLOSE_TIMEOUT)
        if self._thread.is_alive():
            LOGGER.warning("the log does not respond: it is abandoned")
        self.lost = max(published - self.written, self.failed)

    def _write_all(self) -> None:
        while True:
            is_closing = self._is_closing  # asked first: nothing is put in afterwards
            if self._mailbox.receive(self._frame) != NOTHING:
                self._append()
            elif is_closing:
                break
            else:
                time.sleep(LOG_NAP)
        try:
            self._log.close()
        except Exception as failure:
            self._count(failure)

    def _append(self) -> None:
        try:
            self._log.append(self._frame)
            self.written += 1
        except Exception as failure:
            self.failed += 1
            self.lost += 1
            self._count(failure)

    def _count(self, failure: Exception) -> None:
        if not self._first_failure:
            self._first_failure = str(failure)
            LOGGER.warning("frames cannot be logged: %s", failure)
