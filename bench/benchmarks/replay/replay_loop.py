"""The loop of a replay: every instant of a recording is one timed tick."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from proximity.message import CONTACT
from proximity.recording import NANOSECONDS, Recording

REHEARSAL = 3  # ticks before the first timed one: kernels are loaded, caches filled


class Ticking(Protocol):
    """Interface of ticks, as of a tracker."""

    def tick(self, positions: np.ndarray, t_pose_ns: int, now_ns: int) -> np.ndarray:
        """Return a contact for each finger, in an array that the next tick overwrites."""


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Answers of a tracker to a recording, T ticks of N fingers, with their durations."""

    recording: Recording  # at the rate of the ticks
    contacts: np.ndarray  # (T, N) CONTACT
    wall_ns: np.ndarray  # (T,) int64, from call to answer
    compute_ns: np.ndarray  # (T,) int64, processor time of this thread in them


def replay(make_tracker: Callable[[], Ticking], recording: Recording, *, latency: float = 0.001) -> Replay:
    """Run a tracker over a recording as fast as possible.

    *make_tracker*: makes a tracker for the recording's fingers; called twice, the first is for rehearsal.
    *recording*: in the frame of the scene, at the rate of the ticks; see `Recording.resampled`.
    """
    shape = recording.positions.shape[:2]
    contacts = np.zeros(shape, dtype=CONTACT)
    wall_ns, compute_ns = np.zeros((2, shape[0]), dtype=np.int64)
    latency_ns = round(latency * NANOSECONDS)
    times_ns = recording.times_ns.tolist()
    positions = recording.positions.copy()  # writeable, as kernels require

    rehearsed = make_tracker()
    for tick in range(min(REHEARSAL, len(times_ns))):
        rehearsed.tick(positions[tick], times_ns[tick], times_ns[tick] + latency_ns)

    tracker = make_tracker()
    for tick, (pose_ns, points) in enumerate(zip(times_ns, positions, strict=True)):
        thread_started = time.thread_time_ns()
        started = time.perf_counter_ns()
        found = tracker.tick(points, pose_ns, pose_ns + latency_ns)
        ended = time.perf_counter_ns()
        compute_ns[tick] = time.thread_time_ns() - thread_started
        wall_ns[tick] = ended - started
        contacts[tick] = found
    return Replay(recording, contacts, wall_ns, compute_ns)
