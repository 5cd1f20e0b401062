"""``mailbox:NAME``: the latest message inside this process, for library users and tests.

Any number of threads write and read; who reads too seldom sees the newest only. A box is there as long as
somebody has it open, or keeps an end that was closed.
"""

import threading
from weakref import WeakValueDictionary

import numpy as np

from proximity.transport.address import Address
from proximity.transport.link import NOTHING


class _Box:
    """A message, and how many have been put here."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.data = np.zeros(0, np.uint8)
        self.size = 0
        self.count = 0


_boxes: WeakValueDictionary[str, _Box] = WeakValueDictionary()
_lock = threading.Lock()


def _box(name: str) -> _Box:
    with _lock:
        box = _boxes.get(name)
        if box is None:
            box = _boxes[name] = _Box()
        return box


class MailboxOutlet:
    """Puts messages into the box of that name."""

    def __init__(self, address: Address) -> None:
        address.check_options()
        self._box = _box(address.location)

    def send(self, data: np.ndarray) -> None:
        """Replace what is in the box."""
        box = self._box
        with box.changed:
            if len(box.data) < len(data):
                box.data = np.empty(len(data), np.uint8)
            box.data[: len(data)] = data
            box.size = len(data)
            box.count += 1
            box.changed.notify_all()

    def close(self) -> None:
        """Do nothing: the last message stays for who comes late."""


class MailboxInlet:
    """Looks into the box of that name."""

    shares_clock = True
    refused = 0
    is_keyed, unverified = False, 0

    def __init__(self, address: Address) -> None:
        address.check_options()
        self._box = _box(address.location)
        self._seen = 0

    def receive(self, buffer: np.ndarray) -> int:
        """Copy what is in the box, if it was not seen before."""
        box = self._box
        if (
            box.count == self._seen
        ):  # an int: read as a whole without the lock, which costs as much as all else
            return NOTHING
        with box.changed:
            self._seen = box.count
            size = min(box.size, len(buffer))
            buffer[:size] = box.data[:size]
            return box.size

    def wait(self, timeout: float) -> bool:
        """Wait for another message than the last one seen."""
        with self._box.changed:
            return self._box.changed.wait_for(lambda: self._box.count != self._seen, timeout)

    def close(self) -> None:
        """Do nothing."""


open_outlet = MailboxOutlet
open_inlet = MailboxInlet
