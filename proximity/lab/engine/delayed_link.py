"""Simulated transport: a message arrives after a latency, by the simulation's clock.

Whoever reads examines the bytes as those of any other transport. Messages do not overtake each other.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from proximity.checks import not_negative
from proximity.errors import ArgumentError
from proximity.system.time_units import NS_PER_S
from proximity.transport.link import NOTHING

DRAWS = 1024  # latencies that are drawn at once
SEED = 7

Latency = float | Sequence[float]
"""s: one that is always the same, or a sample of measured ones, of which each message has one at random."""


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
        """Take one message."""
        now_ns = self._clock()
        self._last_ns = max(self._last_ns, now_ns + self._next_ns())
        if not any(first <= now_ns <= last for first, last in self._silences):
            self._in_flight.append((self._last_ns, data.copy()))

    def receive(self, buffer: np.ndarray) -> int:
        """Hand over the oldest message that has arrived."""
        if not self._in_flight or self._in_flight[0][0] > self._clock():
            return NOTHING
        data = self._in_flight.popleft()[1]
        size = min(len(data), len(buffer))
        buffer[:size] = data[:size]
        return len(data)

    def wait(self, timeout: float) -> bool:
        """Say whether anything is under way: in a simulation nobody waits."""
        return bool(self._in_flight)

    def close(self) -> None:
        """Do nothing."""

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
