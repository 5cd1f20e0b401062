"""Pass the messages of a running service to a listener, which can neither delay the loop nor end it."""

import logging
import queue
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from logging.handlers import QueueHandler, QueueListener

# Not a child of the loop's logger: a failed announcement would be announced again, forever.
LOGGER = logging.getLogger("proximity.hosting")
LOOP_LOGGER = logging.getLogger("proximity.service")


def guarded(say: Callable[[str], None]) -> Callable[[str], None]:
    """Return a function that calls *say* and logs its exceptions instead of raising them."""

    def announce(sentence: str) -> None:
        try:
            say(sentence)
        except Exception:  # for example because the terminal was closed
            LOGGER.exception("this could not be announced: %s", sentence)

    return announce


@contextmanager
def warnings_of_loop_to(say: Callable[[str], None] | None) -> Iterator[None]:
    """Pass warnings of the loop to *say* during the block, in a separate thread.

    *say*: function of a sentence; None: warnings are only logged.
    """
    if say is None:
        yield
        return
    waiting: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    handler, listener = QueueHandler(waiting), QueueListener(waiting, _AnnouncementHandler(say))
    handler.setLevel(logging.WARNING)
    LOOP_LOGGER.addHandler(handler)
    listener.start()
    try:
        yield
    finally:
        LOOP_LOGGER.removeHandler(handler)
        listener.stop()


class _AnnouncementHandler(logging.Handler):
    """Passes the message of each log record to a function."""

    def __init__(self, say: Callable[[str], None]) -> None:
        super().__init__(logging.WARNING)
        self._say = say

    def emit(self, record: logging.LogRecord) -> None:
        self._say(record.getMessage())
