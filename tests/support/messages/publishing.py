"""Frames published from a thread of the test."""

import contextlib
import threading
from collections.abc import Callable, Iterator

from proximity.message import Message
from proximity.transport import open_publisher


@contextlib.contextmanager
def publishing(address: str, make: Callable[[], Message], every_s: float = 0.005) -> Iterator[None]:
    """Publish the results of *make* repeatedly until the block ends."""
    over = threading.Event()

    def publish() -> None:
        with open_publisher(address) as publisher:
            while not over.wait(every_s):
                publisher.publish(make())

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
