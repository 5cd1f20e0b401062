"""The distance service inside a simulation, by the simulation's clock.

All of it is the service's code except the loop that waits for deadlines. Its input is a finger of the closed
loop: poses for a tracker, or measurements of a far end's sensor. Its messages arrive after a latency and in
order; their bytes are validated like those of any transport.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from proximity.checks import not_negative
from proximity.errors import ArgumentError
from proximity.lab.engine.finger_placement import PlacedFinger
from proximity.message import PATH_CORNERS, Surface
from proximity.service.contact_source import ContactSource, TrackedContacts
from proximity.service.loop import Service
from proximity.service.samples import FingerPoses, Measurements
from proximity.service.sensed_contacts import SensedContacts
from proximity.system.time_units import NS_PER_S
from proximity.tracker.tracker import Tracker
from proximity.transport import Outlet, Publisher
from proximity.transport.link import NOTHING


class TrackedFinger:
    """Poses of a finger and its path, for a tracker."""

    def __init__(
        self, finger: PlacedFinger, contact_source: TrackedContacts, corners: int = PATH_CORNERS
    ) -> None:
        self.contact_source: ContactSource = contact_source
        self._finger = finger
        self._poses = FingerPoses(1)
        self._poses.paths, self._poses.bends = finger.corners(corners)[None], np.zeros(1)

    def samples(self, now_ns: int, bend: float, bend_rate: float, force: float) -> FingerPoses:
        """Return the pose."""
        poses = self._poses
        poses.positions[0] = self._finger.point(bend)
        poses.pose_ns[0] = now_ns
        assert poses.bends is not None
        poses.bends[0] = bend
        return poses


class ExactAnswers(TrackedContacts):
    """A tracker's contacts, with the true position of contact, known from the start."""

    def __init__(self, tracker: Tracker, contact_bend: float) -> None:
        super().__init__(tracker)
        self._contact_bend = contact_bend

    def fill(self, contacts: np.ndarray, samples: FingerPoses, now_ns: int) -> None:
        """Tick, and write the true bend at contact."""
        super().fill(contacts, samples, now_ns)
        contacts["contact_bend"], contacts["contact_bend_error"] = self._contact_bend, 0.0


class MeasuredFinger:
    """Measurements of a sensor at a far end whose finger moves like this one: teleoperation."""

    def __init__(self, finger: PlacedFinger, latency: float) -> None:
        self.contact_source: ContactSource = SensedContacts(1, latency=latency)
        self._finger = finger
        self._measured = Measurements(1)

    def samples(self, now_ns: int, bend: float, bend_rate: float, force: float) -> Measurements:
        """Return the measurement."""
        measured, finger = self._measured, self._finger
        measured.pose_ns[0] = now_ns
        measured.distances[0, 0] = np.nan
        if not np.isfinite(bend):
            return measured
        point, record = finger.point(bend), measured.records[0]
        hit = finger.scene.closest(point)
        measured.distances[0, 0] = float(hit.signed_distance) - finger.glove.finger.pad_radius
        record["measured_ns"], record["signed_distance"] = now_ns, measured.distances[0, 0]
        record["position"], record["normal"] = point, hit.gradient
        record["velocity"] = record["approach_speed"] = np.nan
        record["bend"], record["bend_rate"] = bend, bend_rate
        record["surface"], record["force"], record["force_is_valid"] = Surface.RIGID, force, True
        return measured


Feed = TrackedFinger | MeasuredFinger
"""Source of a service's samples of a finger, and of the answers to them."""


class SimulatedService:
    """Ticks when called, and publishes; it is the clock and the input of its loop."""

    is_over, skipped_ns = False, 0
    address = "simulation"

    def __init__(self, feed: Feed, outlet: Outlet, period: float) -> None:
        source = feed.contact_source
        source.is_ticked_by_loop = False  # paths may have any number of corners
        self._feed, self._now_ns = feed, 0
        self._known: dict[str, Any] = {}
        self.notes: list[str] = []
        self._loop = Service(source, self, [Publisher(outlet, self.address)], period=period, clock=self)

    def tick(self, now_ns: int, **known: Any) -> None:
        """Make a frame from the given state."""
        self._now_ns, self._known = now_ns, known
        self._loop.step(now_ns)

    def now_ns(self) -> int:
        """Return the instant of the tick."""
        return self._now_ns

    def sleep_until(self, due_ns: int) -> None:
        """Return immediately: ticks are triggered by calls."""

    def poll(self, now_ns: int) -> tuple[FingerPoses | Measurements]:
        """Return the known state."""
        return (self._feed.samples(now_ns, **self._known),)

    def close(self) -> None:
        """No-op."""


DRAWS = 1024  # latencies drawn together
SEED = 7

Latency = float | Sequence[float]
"""s: a constant, or a sample of measured ones, from which each message draws one."""


class DelayedLink:
    """Both ends of the transport; as an outlet and as an inlet of `proximity.transport`."""

    shares_clock = True
    refused = 0
    is_keyed, unverified = False, 0

    def __init__(
        self, latency: Latency, clock: Callable[[], int], silences: Iterable[tuple[int, int]] = ()
    ) -> None:
        self._latencies_ns = _latencies_ns(latency)
        self._clock, self._silences = clock, tuple(silences)
        self._rng = np.random.default_rng(SEED)
        self._drawn: list[int] = []
        self._in_flight: deque[tuple[int, np.ndarray]] = deque()
        self._last_ns = -(2**62)

    def send(self, data: np.ndarray) -> None:
        """Send one message."""
        now_ns = self._clock()
        self._last_ns = max(self._last_ns, now_ns + self._next_ns())
        if not any(first <= now_ns <= last for first, last in self._silences):
            self._in_flight.append((self._last_ns, data.copy()))

    def receive(self, buffer: np.ndarray) -> int:
        """Copy the oldest arrived message into the buffer; return its size."""
        if not self._in_flight or self._in_flight[0][0] > self._clock():
            return NOTHING
        data = self._in_flight.popleft()[1]
        size = min(len(data), len(buffer))
        buffer[:size] = data[:size]
        return len(data)

    def wait(self, timeout: float) -> bool:
        """Return whether a message is under way: a simulation does not wait."""
        return bool(self._in_flight)

    def close(self) -> None:
        """No-op."""

    def _next_ns(self) -> int:
        if len(self._latencies_ns) == 1:
            return self._latencies_ns[0]
        if not self._drawn:
            self._drawn = self._rng.choice(self._latencies_ns, DRAWS).tolist()
        return self._drawn.pop()


def _latencies_ns(latency: Latency) -> list[int]:
    values = list(latency) if isinstance(latency, Sequence) else [latency]
    if not values:
        raise ArgumentError("no latency is given, expected seconds")
    return [math.floor(NS_PER_S * not_negative("latency", value, "seconds") + 0.5) for value in values]
