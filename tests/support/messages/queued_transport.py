"""A transport for tests that keeps every message until read: ``queue:NAME`` once registered."""

from collections import defaultdict, deque
from threading import Condition

import numpy as np

from proximity.transport.link import NOTHING, TRANSPORTS, Transport

_queues = defaultdict(deque)
_changed = Condition()


def register(monkeypatch):
    """Register ``queue:NAME`` for the duration of a test."""
    _queues.clear()
    monkeypatch.setitem(TRANSPORTS, "queue", Transport(__name__, ""))


class QueueOutlet:
    """Append messages to the queue."""

    def __init__(self, address):
        self._queue = _queues[address.location]

    def send(self, data):
        with _changed:
            self._queue.append(np.array(data))
            _changed.notify_all()

    def close(self):
        pass


class QueueInlet:
    """Take messages from the front of the queue."""

    shares_clock = True
    refused = 0
    is_keyed, unverified = False, 0

    def __init__(self, address):
        self._queue = _queues[address.location]

    def receive(self, room):
        if not self._queue:
            return NOTHING
        data = self._queue.popleft()
        room[: len(data)] = data
        return len(data)

    def wait(self, timeout):
        with _changed:
            return _changed.wait_for(lambda: len(self._queue) > 0, timeout)

    def close(self):
        pass


open_outlet = QueueOutlet
open_inlet = QueueInlet
