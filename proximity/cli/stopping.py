"""Ctrl-C and SIGTERM as an ordinary end: what runs until it is told to stop still says what it did."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

SIGNALS = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # a system has some of them
    if hasattr(signal, name)
]


@dataclass(slots=True)
class Stop:
    """Whether the program was told to stop."""

    is_told: bool = False


@contextmanager
def until_told() -> Iterator[Stop]:
    """Take the first Ctrl-C or SIGTERM within the block for a wish to stop; a second one acts as usual.

    To be used in the main thread, which signals reach.
    """
    stop = Stop()
    usual = {number: signal.getsignal(number) for number in SIGNALS}

    def restore() -> None:
        for number, handler in usual.items():
            # None: a handler that was not made in Python, and cannot be put back from here
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

    def tell(number: int, frame: FrameType | None) -> None:
        del number, frame
        stop.is_told = True
        restore()

    for number, handler in usual.items():
        if handler is not signal.SIG_IGN:  # as nohup wishes
            signal.signal(number, tell)
    try:
        yield stop
    finally:
        restore()
