"""Sources of poses: the interface of an input, and the two that need no transport."""

import logging
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Protocol

import numpy as np

from proximity.checks import as_float64
from proximity.errors import ArgumentError, ProximityError, ServiceError
from proximity.kernels.tracking.motion import MAX_GAP_NS
from proximity.recording import Recording
from proximity.service.samples import FingerPoses, Samples
from proximity.system.time_units import NS_PER_S

LOGGER = logging.getLogger("proximity.service")


class PoseInput(Protocol):
    """An input of samples; its methods neither wait nor raise.

    Where it has ``wait(timeout)``, a thread waits there and polls it; otherwise each tick does. Where it has
    ``loop_end()`` that returns something, the loop takes poses from there by itself.
    """

    is_over: bool
    """Whether nothing will come any more: a recording that has ended."""
    address: str
    """Where samples come from, for messages."""

    @property
    def notes(self) -> list[str]:
        """Sentences for the report: what was refused or failed, and how often."""

    def poll(self, now_ns: int) -> Iterable[Samples]:
        """Give the samples that are new since the poll before, oldest first; each is used before the next."""

    def close(self) -> None:
        """Give back what is open."""


class RecordingInput:
    """A recording in real time: each pose has its recorded instant, counted from the first poll on.

    To serve a recording as fast as it can be computed, give the service a `SkippingClock`.

    *recording*: in the frame of the scene. At its own instants, or `Recording.resampled` to those of the
    ticks. *latency*: how old a pose is when it comes in. *repeat*: begin anew after the end. Between, the
    hand is away for a tenth of a second: from the last pose to the first it has not moved, and no velocity
    may say so.
    """

    is_over: bool

    def __init__(self, recording: Recording, *, latency: float = 0.0, repeat: bool = False) -> None:
        if not 0.0 <= latency <= 1.0:
            raise ServiceError(f"a recording with a latency of {latency!r} s, expected 0 to 1 s")
        self.is_over = False
        self.address = recording.path or "the recording"
        self.notes = [f"{recording.path or 'the recording'}: {note}" for note in recording.notes]
        self._times_ns = recording.times_ns - recording.times_ns[0]
        self._positions = recording.positions
        if repeat:
            self._times_ns, self._positions = _with_nobody_at_the_end(self._times_ns, self._positions)
        self._poses = FingerPoses(len(recording.fingers))
        self._latency_ns = round(NS_PER_S * latency)
        self._repeat = repeat
        self._row = -1  # the last one given
        self._start_ns: int | None = None  # instant of the first row
        self._round_ns = int(self._times_ns[-1]) + MAX_GAP_NS

    def poll(self, now_ns: int) -> Iterator[FingerPoses]:
        """Give the poses of the last instant that is past, unless they were given before."""
        if self._start_ns is None:
            self._start_ns = now_ns - self._latency_ns
        elapsed = now_ns - self._latency_ns - self._start_ns
        if self._repeat and elapsed >= self._round_ns:
            # All rounds that are past at once: there may have been a long pause.
            self._start_ns += elapsed // self._round_ns * self._round_ns
            elapsed %= self._round_ns
            self._row = -1
        row = self._row_at(elapsed)
        if row == self._row:
            return
        self._row = row
        self.is_over = not self._repeat and row == len(self._times_ns) - 1
        self._poses.positions[...] = self._positions[row]
        self._poses.pose_ns[...] = self._start_ns + self._times_ns.item(row)
        yield self._poses

    def close(self) -> None:
        """Do nothing."""

    def _row_at(self, elapsed_ns: int) -> int:
        """The last row that is not after that time; never one before the last one given."""
        row, times = self._row, self._times_ns
        # Mostly the next one, or none.
        while row + 1 < len(times) and times.item(row + 1) <= elapsed_ns:
            row += 1
        return row


def _with_nobody_at_the_end(times_ns: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and positions with one more instant, a step as there are others after the last: no finger."""
    steps = np.diff(times_ns)
    end_ns = times_ns[-1] + (int(np.median(steps)) if len(steps) else NS_PER_S)
    nobody = np.full((1, *positions.shape[1:]), np.nan)
    return np.append(times_ns, end_ns), np.concatenate([positions, nobody])


class CallableInput:
    """Poses from a callback, called once a tick with the present instant, ns.

    It returns positions, (N, 3) float64, m, of that very instant; or positions and their instants, one or
    (N,) int64, ns; or `FingerPoses`; or None where it has nothing new. What it raises is counted, and the
    loop goes on without a new pose. It must be quick: the tick waits for it.
    """

    is_over = False
    address = "the pose callback"

    def __init__(self, function: Callable[[int], Any], count: int) -> None:
        self.failures = 0
        self._function = function
        self._poses = FingerPoses(count)
        self._first_failure = ""

    @property
    def notes(self) -> list[str]:
        """Sentences on failures of the pose callback: how many, and the first one."""
        if not self.failures:
            return []
        return [f"the pose callback raised {self.failures} times, first: {self._first_failure}"]

    def poll(self, now_ns: int) -> Iterator[FingerPoses]:
        """Call the function."""
        try:
            reported = self._function(now_ns)
            poses = None if reported is None else self._checked(reported, now_ns)
        except Exception as failure:
            self._count(failure)
            return
        if poses is not None:
            yield poses

    def close(self) -> None:
        """Do nothing."""

    def _checked(self, reported: Any, now_ns: int) -> FingerPoses:
        poses = self._poses
        rest: tuple[Any, Any, Any] = None, None, None
        if isinstance(reported, FingerPoses):
            rest = _rest_of(reported, len(poses.positions))
            reported = reported.positions, reported.pose_ns
        positions, instants = (
            reported if isinstance(reported, tuple) and len(reported) == 2 else (reported, now_ns)
        )
        array = _shaped("positions", positions, poses.positions.shape)
        if np.asarray(instants).dtype.kind not in "iu":
            raise ArgumentError(f"instants are {instants!r}, expected whole nanoseconds")
        poses.pose_ns[...] = instants
        poses.positions[...] = array
        poses.velocities, poses.paths, poses.bends = rest
        return poses

    def _count(self, failure: Exception) -> None:
        self.failures += 1
        if self.failures == 1:
            kind = "" if isinstance(failure, ProximityError) else f"{type(failure).__name__}: "
            self._first_failure = f"{kind}{failure}"
            LOGGER.warning("the pose callback raised: %s", self._first_failure)


def _rest_of(reported: FingerPoses, count: int) -> tuple[Any, Any, Any]:
    """Velocities, paths and bends of so many fingers, as a tracker takes them: copies."""
    if len(reported.positions) != count:
        raise ArgumentError(f"poses of {len(reported.positions)} fingers, expected {count} fingers")
    velocities, paths, bends = reported.velocities, reported.paths, reported.bends
    if velocities is not None:
        velocities = _shaped("velocities", velocities, (count, 3))
    if paths is not None:
        shape = np.shape(paths)
        if len(shape) != 3 or shape[1] < 2:
            raise ArgumentError(f"paths have shape {shape}, expected ({count}, K, 3) with K of 2 or more")
        paths = _shaped("paths", paths, (count, shape[1], 3))
    if bends is not None:
        bends = _shaped("bends", bends, (count,))
    return velocities, paths, bends


def _shaped(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    array = as_float64(values, name, expected=f"numbers of shape {shape}")
    if array.shape != shape:
        raise ArgumentError(f"{name} have shape {array.shape}, expected {shape}")
    return array.copy()
