"""The log of a loop of compiled code: a thread reads the frames in a mailbox of its own and appends them."""

import time

import numpy as np

from proximity.service.frame_publisher import DEPTH, FEWEST, MOST_RING_BYTES, Log, LogThread
from proximity.transport.link import NOTHING
from proximity.transport.shared_memory import PrivateMailbox

LOG_NAP = 0.005
"""s between two looks at the frames to be logged: to be woken by each would cost the loop 5 µs a frame."""


class MailboxLog(LogThread):
    """Appends the frames of a loop of compiled code to a log, in a thread of its own.

    *size*: of a frame.
    """

    def __init__(self, log: Log, size: int) -> None:
        super().__init__(log)
        self._frame = np.zeros(size, np.uint8)
        ring = 1 << (min(DEPTH * (size + 32), MOST_RING_BYTES) - 1).bit_length()
        self._mailbox = PrivateMailbox(max(ring, 1 << (FEWEST * size).bit_length()))
        self.writer = self._mailbox.writer
        self._thread.start()

    def close(self, published: int) -> None:
        """Wait until all is written, some seconds at most; those missing of *published* frames are lost."""
        self._is_closing = True
        self._has_ended()
        self.lost = max(published - self.written - self.failed, 0)

    def _append_all(self) -> None:
        while True:
            is_closing = self._is_closing  # asked first: nothing is put in afterwards
            if self._mailbox.receive(self._frame) != NOTHING:
                self._append(self._frame)
            elif is_closing:
                break
            else:
                time.sleep(LOG_NAP)
