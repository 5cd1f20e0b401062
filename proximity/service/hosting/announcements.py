"""Announcements while a service runs: the listener can neither delay the loop nor end it."""

import logging
import queue
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from logging.handlers import QueueHandler, QueueListener

# Not below the loop's logger: what cannot be announced would be announced again, for ever.
LOGGER = logging.getLogger("proximity.hosting")
LOOP_LOGGER = logging.getLogger("proximity.service")


def guarded(say: Callable[[str], None]) -> Callable[[str], None]:
    """Return what says the same, and logs instead of raising what goes wrong."""

    def announce(sentence: str) -> None:
        try:
            say(sentence)
        except Exception:  # a terminal that was closed, for example
            LOGGER.exception("this could not be announced: %s", sentence)

    return announce


@contextmanager
def warnings_of_loop_to(say: Callable[[str], None] | None) -> Iterator[None]:
    """Have what the loop warns of within the block said by a thread of its own.

    *say*: is given sentences; None: they are logged, and nothing else.
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
    """Passes records on as sentences."""

    def __init__(self, say: Callable[[str], None]) -> None:
        super().__init__(logging.WARNING)
        self._say = say

    def emit(self, record: logging.LogRecord) -> None:
        self._say(record.getMessage())
