"""Ctrl-C and SIGTERM as a wish to stop: what serves says STOPPING and what it has done before it ends."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # a system has some of them
    if hasattr(signal, name)
]


@contextmanager
def stopped_by_signals(stop: threading.Event) -> Iterator[None]:
    """Set *stop* at the first signal within the block; a second one acts as usual.

    Signals reach the main thread; in another one nothing is changed.

    Parameters
    ----------
    stop : threading.Event
        What is set.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    usual = {number: signal.getsignal(number) for number in SIGNALS}

    def restore() -> None:
        for number, handler in usual.items():
            # None: a handler that was not made in Python, and cannot be put back from here
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

    def tell(number: int, frame: FrameType | None) -> None:
        del number, frame
        stop.set()
        restore()

    for number, handler in usual.items():
        if handler is not signal.SIG_IGN:  # as nohup wishes
            signal.signal(number, tell)
    try:
        yield
    finally:
        restore()
