"""Transport ``mailbox:NAME``, which holds the latest messages in this process, for library users and tests.

Any number of threads write and read. A slow reader sees only the newest message of each kind. A box exists
while one of its ends is open or referenced.
"""

import threading
from weakref import WeakValueDictionary

import numpy as np

from proximity.transport.address import Address
from proximity.transport.link import NOTHING

KIND_BYTES = 4
KINDS_BEGIN = b"DEC"
"""First bytes of a message that has a kind. All messages with other first bytes count as one kind."""


class _Box:
    """The latest message of each kind with its number, and the number of all messages.

    The first four bytes of a message identify its kind.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.changed = threading.Condition(self.lock)
        self.waiting = 0  # number of inlets that wait for a change
        self.latest: dict[bytes, tuple[int, bytes]] = {}
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
    """Puts messages into the box of a given name."""

    def __init__(self, address: Address) -> None:
        address.check_options()
        self._box = _box(address.location)

    def send(self, data: np.ndarray) -> None:
        """Replace the message of the same kind in the box."""
        box, message = self._box, data.tobytes()
        kind = message[:KIND_BYTES] if message.startswith(KINDS_BEGIN) else b""
        with box.lock:
            box.count += 1
            box.latest[kind] = box.count, message
            if box.waiting:
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
        with box.lock:
            new = [latest for latest in box.latest.values() if latest[0] > self._seen]
            if not new:
                self._seen = box.count
                return NOTHING
            self._seen, message = min(new)
        size = min(len(message), len(buffer))
        buffer[:size] = np.frombuffer(message, np.uint8, size)
        return len(message)

    def wait(self, timeout: float) -> bool:
        """Wait for a message that this inlet has not received yet."""
        box = self._box
        with box.lock:
            box.waiting += 1
            try:
                return box.changed.wait_for(lambda: box.count != self._seen, timeout)
            finally:
                box.waiting -= 1

    def close(self) -> None:
        """Return without an effect, because an inlet has no resources."""


open_outlet = MailboxOutlet
open_inlet = MailboxInlet
