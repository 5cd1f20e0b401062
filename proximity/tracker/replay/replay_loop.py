"""The loop of a replay: every instant of a recording is one timed tick."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from proximity.errors import RecordingError
from proximity.message import CONTACT
from proximity.recording import NANOSECONDS, Recording

CHUNK = 500  # ticks between two looks of who waits
REHEARSAL = 3  # ticks before the first that is timed: kernels are loaded, caches filled
LARGEST_LOG_BYTES = 4 << 30


class Ticking(Protocol):
    """Anything that answers ticks, as a tracker does."""

    def tick(self, positions: np.ndarray, t_pose_ns: int, now_ns: int) -> np.ndarray:
        """Return a contact for each finger, in an array that the next tick overwrites."""


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Answers of a tracker to a recording, T ticks of N fingers, with their durations."""

    recording: Recording  # at the rate of the ticks
    contacts: np.ndarray  # (T, N) CONTACT
    wall_ns: np.ndarray  # (T,) int64, from call to answer
    compute_ns: np.ndarray  # (T,) int64, of those the processor spent on this thread


def replay(
    make_tracker: Callable[[], Ticking],
    recording: Recording,
    *,
    latency: float = 0.001,
    watch: Callable[[Sequence[range]], Iterable[range]] = iter,
) -> Replay:
    """Run a tracker over a recording as fast as it goes.

    *make_tracker*: makes a tracker for the recording's fingers; called twice, the first is for rehearsal.
    *recording*: in the frame of the scene, at the rate of the ticks; see `Recording.resampled`. *watch*: is
    given the ticks in ranges and passes them on, one by one: a progress bar.
    """
    if not 0.0 <= latency <= 1.0:
        raise RecordingError(f"a latency of {latency:g} s cannot be replayed, expected 0 to 1 s")
    shape = recording.positions.shape[:2]
    log_bytes = shape[0] * shape[1] * CONTACT.itemsize
    if log_bytes > LARGEST_LOG_BYTES:
        raise RecordingError(
            f"{recording.path}: {shape[0]} ticks of {shape[1]} fingers would make "
            f"{log_bytes / 2**30:.1f} GiB of contacts, "
            f"expected at most {LARGEST_LOG_BYTES >> 30} GiB: replay a shorter part of it"
        )
    contacts = np.zeros(shape, dtype=CONTACT)
    wall_ns, compute_ns = np.zeros((2, shape[0]), dtype=np.int64)
    latency_ns = round(latency * NANOSECONDS)
    times_ns = recording.times_ns.tolist()
    positions = recording.positions.copy()  # writeable, as kernels want arrays

    rehearsed = make_tracker()
    for tick in range(min(REHEARSAL, len(times_ns))):
        rehearsed.tick(positions[tick], times_ns[tick], times_ns[tick] + latency_ns)

    tracker = make_tracker()
    chunks = [range(first, min(first + CHUNK, len(times_ns))) for first in range(0, len(times_ns), CHUNK)]
    for chunk in watch(chunks):
        for tick in chunk:
            pose_ns, points = times_ns[tick], positions[tick]
            thread_started = time.thread_time_ns()
            started = time.perf_counter_ns()
            found = tracker.tick(points, pose_ns, pose_ns + latency_ns)
            ended = time.perf_counter_ns()
            compute_ns[tick] = time.thread_time_ns() - thread_started
            wall_ns[tick] = ended - started
            contacts[tick] = found
    return Replay(recording, contacts, wall_ns, compute_ns)
