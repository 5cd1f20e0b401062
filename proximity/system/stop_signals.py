"""Ctrl-C and SIGTERM as a request to stop, so that a loop can report before it ends."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

SIGNALS = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # a system has some of them
    if hasattr(signal, name)
]


@contextmanager
def stopped_by_signals(stop: threading.Event | None = None) -> Iterator[threading.Event]:
    """Set an event at the first signal within the block, and yield it; a second signal acts as usual.

    Signals reach the main thread; in other threads the block has no effect. *stop*: the event; by default a
    new one.
    """
    stop = threading.Event() if stop is None else stop
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    usual = {number: signal.getsignal(number) for number in SIGNALS}

    def restore() -> None:
        for number, handler in usual.items():
            # None: a handler that was not set from Python, and cannot be restored
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

    def request_stop(number: int, frame: FrameType | None) -> None:
        del number, frame
        # First: another signal while the event is being set would wait for it, in this thread, forever.
        restore()
        stop.set()

    for number, handler in usual.items():
        if handler is not signal.SIG_IGN:  # as nohup wishes
            signal.signal(number, request_stop)
    try:
        yield stop
    finally:
        restore()


def stop_at_input(stop: threading.Event, descriptor: int = 0) -> threading.Thread:
    """Set *stop* when a file has data to read, or ends; return the waiting thread."""

    def wait() -> None:
        with suppress(OSError):  # it is not open
            os.read(descriptor, 1)
        stop.set()

    waiting = threading.Thread(target=wait, daemon=True)
    waiting.start()
    return waiting
