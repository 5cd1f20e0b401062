"""Interface of a transport: an outlet and an inlet for bytes; waiting by polling for libraries without it."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from proximity.system.extras import installation


class Outlet(Protocol):
    """The sending end of a transport."""

    def send(self, data: np.ndarray) -> None:
        """Send one message, (size,) uint8, to any listeners, without waiting for them.

        Raises `PublishError` if it cannot be sent at all; a missing listener is not an error.
        """

    def close(self) -> None:
        """Close the address; idempotent."""


class Inlet(Protocol):
    """The receiving end of a transport."""

    shares_clock: bool
    """True if the sender uses this machine's monotonic clock."""

    def receive(self, buffer: np.ndarray) -> int:
        """Receive the next message, oldest first, into *buffer* (uint8); return its size, or `NOTHING`.

        A message larger than *buffer* is truncated; its full size is returned. Messages of other senders than
        the address names are dropped and counted in `refused`. Raises `PublishError` if receiving is
        impossible.
        """

    refused: int
    """Messages dropped because of their senders."""

    is_keyed: bool
    """True if only messages verified by a key are received."""

    unverified: int
    """Messages dropped because the key does not verify them."""

    def wait(self, timeout: float) -> bool:
        """Wait until a message may have arrived, *timeout* seconds at most; False if certainly none came."""

    def close(self) -> None:
        """Close the address; idempotent."""


NOTHING = -1
"""No message is waiting."""
SHORTEST_NAP = 50e-6
"""s: minimum delay of a frame; the system adds the same again."""
LONGEST_NAP = 1e-3
"""s, after a long silence."""
NAP_SHARE = 0.125
"""Share of the time waited already: a long wait tolerates more delay, and releases the core."""


@dataclass(frozen=True, slots=True)
class Transport:
    """A scheme's functions that open its two ends."""

    module: str  # imported on first use
    is_installed_by: str  # what to install if the module's library is missing


TRANSPORTS = {
    "mailbox": Transport("proximity.transport.in_process", ""),
    "shm": Transport("proximity.transport.shared_memory", ""),
    "udp": Transport("proximity.transport.udp", ""),
    "ws": Transport("proximity.transport.websocket", installation("web")),
    "zenoh": Transport("proximity.transport.zenoh", installation("zenoh")),
}


def wait_until(is_there: Callable[[], bool], timeout: float) -> bool:
    """Poll until *is_there* returns True, or for *timeout* seconds; return its last result.

    Polls once even without a timeout.
    """
    began = time.monotonic()
    while not is_there():
        waited = time.monotonic() - began
        if waited >= timeout:
            return False
        nap = min(max(NAP_SHARE * waited, SHORTEST_NAP), LONGEST_NAP)
        time.sleep(min(nap, timeout - waited))
    return True
