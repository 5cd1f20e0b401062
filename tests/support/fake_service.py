"""Fakes for tests of the service: a manual clock, scripted inputs and contacts, recording outlets."""

import numpy as np

from proximity.errors import PublishError
from proximity.message import CONTACT, FRAME, ContactFlag, Source, State, parts_of
from proximity.service import FingerPoses, Service
from proximity.service.samples import NewestSamples
from proximity.transport import Publisher, forget

MS = 1_000_000
PERIOD_NS = MS
TRACKED = ContactFlag.TRACKED


class ManualClock:
    """A clock that advances by sleeping and `spend`; each sleep takes one of *oversleeps*."""

    skipped_ns = 0

    def __init__(self, now_ns=1000 * MS, oversleeps=()):
        self.now = now_ns
        self.oversleeps = list(oversleeps)
        self.sleeps = []

    def now_ns(self):
        return self.now

    def sleep_until(self, due_ns):
        self.sleeps.append(due_ns)
        late = self.oversleeps.pop(0) if self.oversleeps else 0
        self.now = max(self.now, due_ns) + late

    def spend(self, duration_ns):
        self.now += duration_ns


class ScriptedInput:
    """Return the result of *poll*, called with the poll number and the time; None for no samples."""

    notes = ()
    address = "script:"

    def __init__(self, poll, over_after=None):
        self._poll, self._over_after = poll, over_after
        self.polls = 0
        self.is_over = self.is_closed = False

    def poll(self, now_ns):
        told = self._poll(self.polls, now_ns)
        self.polls += 1
        self.is_over = self.polls == self._over_after
        return () if told is None else (told,)

    def close(self):
        self.is_closed = True


class FakeAnswers:
    """Report each finger that has a position as tracked, at a distance equal to its x.

    *during* is called with the number of each tick.
    """

    source = Source.GEOMETRY
    is_ticked_by_loop = False
    refused = 0, 0, 0
    is_late = False

    def __init__(self, count=2, during=lambda tick: None, epoch=0):
        self.count, self.epoch = count, epoch
        self.notes = []
        self.during = during
        self.ticks = self.rehearsals = 0
        self.seen = []  # (positions, pose_ns, now_ns) of each tick
        self.is_closed = False

    def new_samples(self):
        return FingerPoses(self.count)

    def rehearse(self):
        self.rehearsals += 1

    def fill(self, contacts, poses, now_ns):
        self.seen.append((poses.positions.copy(), poses.pose_ns.copy(), now_ns))
        forget(contacts)
        is_tracked = np.isfinite(poses.positions).all(axis=1)
        contacts["finger"] = np.arange(self.count)
        contacts["pose_ns"], contacts["age_ns"] = poses.pose_ns, now_ns - poses.pose_ns
        contacts["predicted_ns"] = now_ns + MS
        contacts["position"] = poses.positions
        for name in ("signed_distance", "lower", "upper"):
            contacts[name][is_tracked] = poses.positions[is_tracked, 0]
        contacts["flags"] = np.where(is_tracked, int(TRACKED), 0)
        self.during(self.ticks)
        self.ticks += 1

    def close(self):
        self.is_closed = True


class KeepingOutlet:
    """Keep copies of all messages, or refuse those whose numbers are in *refused*."""

    def __init__(self, refused=()):
        self.sent, self.count, self.refused = [], 0, refused
        self.is_closed = False

    def send(self, data):
        self.count += 1
        if self.count - 1 in self.refused:
            raise PublishError("keeping: no room")
        self.sent.append(data.copy())

    def close(self):
        self.is_closed = True

    @property
    def headers(self):
        return [parts_of(data, FRAME)[0] for data in self.sent]

    @property
    def records(self):
        return [parts_of(data, FRAME)[1] for data in self.sent]

    @property
    def states(self):
        return [State(int(header["state"])) for header in self.headers]


def publisher(outlet, address="keeping:"):
    return Publisher(outlet, address)


def hands_at(positions, pose_ns, velocities=None):
    """Finger poses from arrays; *pose_ns* is common or per finger."""
    poses = FingerPoses(len(positions))
    poses.positions[...] = positions
    poses.pose_ns[...] = pose_ns
    poses.velocities = velocities
    return poses


def steady(poll, now_ns):
    """Two fingers, tracked at every tick."""
    return hands_at([[0.1, 0, 0], [0.2, 0, 0]], now_ns)


def serve(
    poll=steady, *, during=lambda tick: None, ticks=10, clock=None, over_after=None, answers=None, **settings
):
    """Run a service of two fingers on fakes; return report, outlet, contact source and clock."""
    clock = clock or ManualClock()
    outlet = KeepingOutlet()
    answers = answers or FakeAnswers(during=during)
    settings.setdefault("period", 1e-9 * PERIOD_NS)
    service = Service(answers, ScriptedInput(poll, over_after), [publisher(outlet)], clock=clock, **settings)
    return service.run(tick_count=ticks), outlet, answers, clock


class SteppedLoop:
    """A service stepped tick by tick, with poses given per tick or taken from *pose_input*."""

    def __init__(self, source, begin_ns, pose_input=None):
        self.outlet, self.clock, self.poses = KeepingOutlet(), ManualClock(begin_ns), None
        given = pose_input or ScriptedInput(lambda *_: self.poses)
        self.service = Service(source, given, [publisher(self.outlet)], period=0.001, clock=self.clock)

    def tick(self, now_ns, poses=None):
        """Run one tick and return its contacts."""
        self.clock.now, self.poses = now_ns, poses
        self.service.step(now_ns)
        return self.outlet.records[-1]

    @property
    def is_late(self):
        """Test whether the reports of a moving part stopped."""
        return bool(self.service._loop.is_late)

    def part(self, name):
        """The pose and velocities of a part in the loop."""
        source = self.service._sources.current
        frames, names = source._model[2], source.contacts.tracker.scene.snapshot().names
        return frames[names.index(name)]


class QueueInlet:
    """The receiving end of a transport that returns the messages put into it, in order."""

    def __init__(self, shares_clock=True):
        self.shares_clock, self.refused = shares_clock, 0
        self.is_keyed, self.unverified = False, 0
        self.queue, self.is_closed = [], False

    def put(self, message, session=1, sequence=None):
        """Seal a message and queue it; the default sequence is the next number."""
        self.sequence = getattr(self, "sequence", -1) + 1 if sequence is None else sequence
        self.queue.append(message.seal(session, self.sequence).copy())

    def receive(self, room):
        if not self.queue:
            return -1
        data = self.queue.pop(0)
        if isinstance(data, Exception):
            raise data
        size = min(len(data), len(room))
        room[:size] = data[:size]
        return len(data)

    def wait(self, timeout):
        return bool(self.queue)

    def close(self):
        self.is_closed = True


class Newest:
    """The newest samples of an input as a service keeps them, with a maximum age of ten seconds."""

    def __init__(self, source, samples, now_ns):
        self.source, self.newest = source, NewestSamples(samples, 10_000 * MS)
        self.newest.start(now_ns)

    def poll(self, now_ns):
        """The newest samples; None without new ones."""
        came = [self.newest.update(samples, now_ns) for samples in self.source.poll(now_ns)]
        return self.newest.samples if came else None

    @property
    def notes(self):
        return self.source.notes


def filled(source, samples, now_ns):
    """Contacts that a source computes from samples."""
    contacts = np.zeros(source.count, CONTACT)
    source.fill(contacts, samples, now_ns)
    return contacts


def polled(source, now_ns):
    """The single samples record of a poll; None if there is none."""
    (samples,) = tuple(source.poll(now_ns)) or (None,)
    return samples
