"""Treat Ctrl-C and SIGTERM as requests to stop, so that a loop can report before it ends."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

SIGNALS = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # each system has some of them
    if hasattr(signal, name)
]


@contextmanager
def stopped_by_signals(stop: threading.Event | None = None) -> Iterator[threading.Event]:
    """Yield an event that is set by the first signal during the block. A second signal acts as usual.

    Signals reach only the main thread; in other threads the block has no effect. *stop*: event to use instead
    of a new one.
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
        # Restored first: another signal during `set` would wait in this thread for its lock, forever.
        restore()
        stop.set()

    for number, handler in usual.items():
        if handler is not signal.SIG_IGN:  # keep signals ignored that were ignored, as under nohup
            signal.signal(number, request_stop)
    try:
        yield stop
    finally:
        restore()


def stop_at_input(stop: threading.Event, descriptor: int = 0) -> threading.Thread:
    """Set *stop* when a file has data to read or ends. Return the thread that waits for this."""

    def wait() -> None:
        with suppress(OSError):  # the file is not open
            os.read(descriptor, 1)
        stop.set()

    waiting = threading.Thread(target=wait, daemon=True)
    waiting.start()
    return waiting
