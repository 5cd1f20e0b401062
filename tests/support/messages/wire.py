"""Frames, a manual clock, and a wire for arbitrary bytes."""

from collections import deque

import numpy as np

from proximity.message import FRAME, ContactFlag, Message, Mode, State, Surface
from proximity.transport import Subscriber
from proximity.transport.link import NOTHING

MS = 1_000_000
NOW = 7_000_000_000_000
"""Start time of manual clocks, ns."""
KNOWN = ContactFlag.TRACKED | ContactFlag.PREDICTED | ContactFlag.EXACT | ContactFlag.SIGNED
SESSION = 1_700_000_000_000_000_000


class Clock:
    """A clock that shows the time set."""

    def __init__(self, now=NOW):
        self.now = now

    def __call__(self):
        return self.now


class Wire:
    """An inlet that returns the bytes put in."""

    refused = 0
    is_keyed, unverified = False, 0

    def __init__(self, shares_clock=True):
        self.shares_clock = shares_clock
        self.waiting = deque()
        self.is_closed = False
        self.waits = []

    def put(self, data):
        """Append received bytes."""
        self.waiting.append(bytes(data))

    def receive(self, room):
        if not self.waiting:
            return NOTHING
        data = self.waiting.popleft()
        room[: len(data)] = np.frombuffer(data, np.uint8)[: len(room)]
        return len(data)

    def wait(self, timeout):
        self.waits.append(timeout)
        return bool(self.waiting)

    def close(self):
        self.is_closed = True


def frame(now=NOW, count=5, *, age=MS, distance=0.05, state=State.OK, valid_for=20 * MS):
    """A frame of fingers at rest, 50 mm from a part at rest, published at *now*."""
    message = Message(FRAME, count)
    header, contacts = message.header, message.records
    header["pose_ns"], header["start_ns"], header["publish_ns"] = now - age, now, now
    header["valid_until_ns"], header["period_ns"], header["state"] = now - age + valid_for, MS, state
    contacts["finger"], contacts["flags"] = np.arange(count), KNOWN
    contacts["pose_ns"], contacts["age_ns"], contacts["predicted_ns"] = now - age, age, now + MS
    for name in ("signed_distance", "lower", "upper"):
        contacts[name] = contacts[f"predicted_{name.removeprefix('signed_')}"] = distance
    contacts["time_to_contact"], contacts["time_to_contact_lower"] = np.inf, 0.25
    contacts["normal"], contacts["surface"], contacts["mode"] = (0, 0, 1), Surface.RIGID, Mode.RETRACT
    return message


def sealed(message, sequence=0, session=SESSION):
    """Bytes of a message with a sequence number."""
    return message.seal(session, sequence).tobytes()


class Reader:
    """A subscriber with a wire and a manual clock."""

    def __init__(self, shares_clock=True, **settings):
        self.clock, self.wire = Clock(), Wire(shares_clock)
        self.subscriber = Subscriber(self.wire, "wire:", clock=self.clock, **settings)
        self.sequence = 0

    def send(self, message, session=SESSION):
        """Deliver a frame."""
        self.wire.put(sealed(message, self.sequence, session))
        self.sequence += 1

    def read(self, after=0):
        """Read *after* ns later."""
        self.clock.now += after
        return self.subscriber.read()

    @property
    def flawed(self):
        return dict(self.subscriber.counts.flawed)


def with_frame(**settings):
    """A reader that has received a frame."""
    reader = Reader()
    reader.send(frame(**settings))
    return reader


def is_silent(contacts):
    """Test whether no finger has a distance."""
    return bool(
        (contacts["lower"] == -np.inf).all()
        and (contacts["upper"] == np.inf).all()
        and np.isnan(contacts["signed_distance"]).all()
        and (contacts["flags"] == 0).all()
        and (contacts["time_to_contact_lower"] == 0.0).all()
        and (contacts["mode"] == Mode.HOLD).all()
    )
