"""Interface of a transport: an outlet and an inlet for bytes; waiting by polling where a library cannot."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from proximity.system.extras import installation


class Outlet(Protocol):
    """The sending end of a transport."""

    def send(self, data: np.ndarray) -> None:
        """Hand over one message, (size,) uint8, to whoever listens; never wait for them.

        Raises `PublishError` if it cannot be sent at all; that nobody listens is no error.
        """

    def close(self) -> None:
        """Give the address back; closing twice is once."""


class Inlet(Protocol):
    """The receiving end of a transport."""

    shares_clock: bool
    """Whether the sender's monotonic clock is ours: whether it is on this machine."""

    def receive(self, buffer: np.ndarray) -> int:
        """Take the next message that waits, oldest first, into *buffer* (uint8); its size, or `NOTHING`.

        Of a message larger than *buffer* only the beginning is taken; its size is returned all the same.
        Whatever is not from the sender that the address names is left out and counted in `refused`.
        Raises `PublishError` if nothing can be received at all.
        """

    refused: int
    """Messages left out because of whom they are from."""

    is_keyed: bool
    """Whether only messages that a key verifies are given."""

    unverified: int
    """Messages left out because the key does not verify them."""

    def wait(self, timeout: float) -> bool:
        """Wait until a message may be there, or that many seconds; False if surely none came."""

    def close(self) -> None:
        """Give the address back; closing twice is once."""


NOTHING = -1
"""No message waits."""
SHORTEST_NAP = 50e-6
"""s: a frame is seen that late at least; the system adds as much again."""
LONGEST_NAP = 1e-3
"""s, when nothing has come for long."""
NAP_SHARE = 0.125
"""Of the time waited so far: who has waited long does not mind a little more, and leaves the core alone."""


@dataclass(frozen=True, slots=True)
class Transport:
    """A scheme's functions that open its two ends."""

    module: str  # imported when it is first asked for
    is_installed_by: str  # what to install where the module's library is not there


TRANSPORTS = {
    "mailbox": Transport("proximity.transport.in_process", ""),
    "shm": Transport("proximity.transport.shared_memory", ""),
    "udp": Transport("proximity.transport.udp", ""),
    "ws": Transport("proximity.transport.websocket", installation("web")),
    "zenoh": Transport("proximity.transport.zenoh", installation("zenoh")),
}


def wait_until(is_there: Callable[[], bool], timeout: float) -> bool:
    """Look until something is there, or that many seconds; say whether it is.

    Looks once even where there is no time.
    """
    began = time.monotonic()
    while not is_there():
        waited = time.monotonic() - began
        if waited >= timeout:
            return False
        nap = min(max(NAP_SHARE * waited, SHORTEST_NAP), LONGEST_NAP)
        time.sleep(min(nap, timeout - waited))
    return True
