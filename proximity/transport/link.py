"""Interface of a transport, whose two ends send and receive bytes, and a wait by polling."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from proximity.system.extras import installation


class Outlet(Protocol):
    """The sending end of a transport."""

    def send(self, data: np.ndarray) -> None:
        """Send a message, (size,) uint8, to all listeners without waiting for them.

        Raises `PublishError` if it cannot be sent at all. A missing listener is not an error.
        """

    def close(self) -> None:
        """Close the address. Closing again has no effect."""


class Inlet(Protocol):
    """The receiving end of a transport."""

    shares_clock: bool
    """True if the sender uses this machine's monotonic clock."""

    def receive(self, buffer: np.ndarray) -> int:
        """Copy the oldest waiting message into *buffer* (uint8). Return its size, or `NOTHING`.

        A message larger than *buffer* is truncated, but its full size is returned. Messages from other
        senders than the address permits are dropped and counted in `refused`. Raises `PublishError` if
        receiving is impossible.
        """

    refused: int
    """Number of messages dropped because of their senders."""

    is_keyed: bool
    """True if only messages that a key verifies are received."""

    unverified: int
    """Number of messages dropped because the key does not verify them."""

    def wait(self, timeout: float) -> bool:
        """Wait until a message may have arrived, but at most *timeout* seconds.

        Return False only if no message has arrived.
        """

    def close(self) -> None:
        """Close the address. Closing again has no effect."""


NOTHING = -1
"""Result of `receive` if no message is waiting."""
SHORTEST_NAP = 50e-6
"""Minimum time between two polls, s. The system adds the same delay again."""
MAX_NAP = 1e-3
"""Maximum time between two polls, after a long silence, s."""
NAP_SHARE = 0.125
"""Time between two polls as a share of the time already waited. A long wait tolerates more delay and releases
the core."""


@dataclass(frozen=True, slots=True)
class Transport:
    """Module that opens the two ends of a transport."""

    module: str  # imported on first use
    is_installed_by: str  # command that installs the library of the module


TRANSPORTS = {
    "mailbox": Transport("proximity.transport.in_process", ""),
    "shm": Transport("proximity.transport.shared_memory", ""),
    "udp": Transport("proximity.transport.udp", ""),
    "ws": Transport("proximity.transport.websocket", installation("web")),
    "zenoh": Transport("proximity.transport.zenoh", installation("zenoh")),
}


def wait_until(is_there: Callable[[], bool], timeout: float) -> bool:
    """Poll until *is_there* returns True or *timeout* seconds have passed. Return its last result.

    It is called at least once, even with a timeout of zero.
    """
    began = time.monotonic()
    while not is_there():
        waited = time.monotonic() - began
        if waited >= timeout:
            return False
        nap = min(max(NAP_SHARE * waited, SHORTEST_NAP), MAX_NAP)
        time.sleep(min(nap, timeout - waited))
    return True
