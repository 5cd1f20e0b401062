"""Transport ``mailbox:NAME``, which holds the latest messages in this process, for library users and tests.

Any number of threads write and read. A slow reader sees only the newest message of each kind. A box exists
while one of its ends is open or referenced.
"""

import threading
from operator import attrgetter
from weakref import WeakValueDictionary

import numpy as np

from proximity.transport.address import Address
from proximity.transport.link import NOTHING

KIND_BYTES = 4
KINDS_BEGIN = b"DEC"
"""First bytes of a message that has a kind. All messages with other first bytes count as one kind."""


class _Latest:
    """The latest message of one kind, and the number of messages in the box when it was written."""

    def __init__(self) -> None:
        self.data = np.zeros(0, np.uint8)
        self.size = 0
        self.count = 0


class _Box:
    """The latest message of each kind, and the number of all messages.

    The first four bytes of a message identify its kind.
    """

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.latest: dict[bytes, _Latest] = {}
        self.count = 0


_boxes: WeakValueDictionary[str, _Box] = WeakValueDictionary()
_lock = threading.Lock()


def _box(name: str) -> _Box:
    with _lock:
        box = _boxes.get(name)
        if box is None:
            box = _boxes[name] = _Box()
        return box


_count_of = attrgetter("count")


class MailboxOutlet:
    """Puts messages into the box of a given name."""

    def __init__(self, address: Address) -> None:
        address.check_options()
        self._box = _box(address.location)

    def send(self, data: np.ndarray) -> None:
        """Replace the message of the same kind in the box."""
        box, magic = self._box, bytes(data[:KIND_BYTES])
        kind = magic if magic.startswith(KINDS_BEGIN) else b""
        with box.changed:
            latest = box.latest.get(kind)
            if latest is None:
                latest = box.latest[kind] = _Latest()
            if len(latest.data) < len(data):
                latest.data = np.empty(len(data), np.uint8)
            latest.data[: len(data)] = data
            latest.size = len(data)
            box.count += 1
            latest.count = box.count
            box.changed.notify_all()

    def close(self) -> None:
        """Return without an effect, so that the last messages stay for later readers."""


class MailboxInlet:
    """Reads messages from the box of a given name."""

    shares_clock = True
    refused = 0
    is_keyed, unverified = False, 0

    def __init__(self, address: Address) -> None:
        address.check_options()
        self._box = _box(address.location)
        self._seen = 0

    def receive(self, buffer: np.ndarray) -> int:
        """Copy the oldest message in the box that this inlet has not received yet."""
        box = self._box
        if box.count == self._seen:  # an atomic read, since the lock would double the cost
            return NOTHING
        with box.changed:
            new = [latest for latest in box.latest.values() if latest.count > self._seen]
            if not new:
                self._seen = box.count
                return NOTHING
            oldest = min(new, key=_count_of)
            self._seen = oldest.count
            size = min(oldest.size, len(buffer))
            buffer[:size] = oldest.data[:size]
            return oldest.size

    def wait(self, timeout: float) -> bool:
        """Wait for a message that this inlet has not received yet."""
        with self._box.changed:
            return self._box.changed.wait_for(lambda: self._box.count != self._seen, timeout)

    def close(self) -> None:
        """Return without an effect, because an inlet has no resources."""


open_outlet = MailboxOutlet
open_inlet = MailboxInlet
