"""Interface of a source of poses, and a recording as a source."""

from collections.abc import Iterable
from typing import Protocol, runtime_checkable

import numpy as np

from proximity.errors import ServiceError
from proximity.kernels.tracking.motion import MAX_GAP_NS
from proximity.recording import Recording
from proximity.service.samples import Samples
from proximity.system.time_units import NS_PER_S


class PoseInput(Protocol):
    """Interface of a source of samples.

    If its ``loop_end()`` or ``loop_recording()`` exists and returns a value, the loop itself reads poses from
    there. Otherwise the source must be a `PolledInput`.
    """

    is_over: bool
    """True if no more samples will come."""
    address: str
    """Origin of the samples, for messages."""

    @property
    def notes(self) -> list[str]:
        """Sentences for the report on refused data and failures, with their counts."""

    def close(self) -> None:
        """Release open resources."""


@runtime_checkable
class PolledInput(PoseInput, Protocol):
    """Source of samples that a thread polls. Its methods neither wait nor raise errors.

    With a method ``wait(timeout)`` it is polled when poses arrive, which wake the loop. Without one it is
    polled twice in each period.
    """

    def poll(self, now_ns: int) -> Iterable[Samples]:
        """Yield the samples since the last poll, oldest first. The caller uses each one before the next."""


class RecordingInput:
    """Plays a recording in the loop, at the recorded times counted from the first tick.

    To serve a recording as fast as possible, give the service a `SkippingClock`.

    *recording*: a recording in the frame of the scene, at its own instants or resampled to those of the ticks
    by `Recording.resampled`. *latency*: age of a pose on arrival. *repeat*: whether to restart after the end.
    The hand is absent for a tenth of a second before a restart, so that no velocity is estimated from the
    last pose to the first.
    """

    is_over = False  # the loop detects the end itself

    def __init__(self, recording: Recording, *, latency: float = 0.0, repeat: bool = False) -> None:
        if not 0.0 <= latency <= 1.0:
            raise ServiceError(f"a recording with a latency of {latency!r} s, expected 0 to 1 s")
        self.address = recording.path or "the recording"
        self.notes = [f"{recording.path or 'the recording'}: {note}" for note in recording.notes]
        self._times_ns = recording.times_ns - recording.times_ns[0]
        self._positions = recording.positions
        if repeat:
            self._times_ns, self._positions = _with_nobody_at_the_end(self._times_ns, self._positions)
        self._times_ns = np.ascontiguousarray(self._times_ns, np.int64)
        self._positions = np.ascontiguousarray(self._positions, np.float64)
        self._latency_ns = round(NS_PER_S * latency)
        self._repeat = repeat
        self._round_ns = int(self._times_ns[-1]) + MAX_GAP_NS

    def loop_recording(self) -> dict[str, int]:
        """Return the data with which the loop of a service plays the recording."""
        return {
            "times_ns": self._times_ns.ctypes.data,
            "positions": self._positions.ctypes.data,
            "rows": len(self._times_ns),
            "latency_ns": self._latency_ns,
            "round_ns": self._round_ns if self._repeat else 0,
        }

    def close(self) -> None:
        """Return without an effect, because a recording has no resources."""


def _with_nobody_at_the_end(times_ns: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Append an instant at which all fingers are absent, one median time step after the last instant."""
    steps = np.diff(times_ns)
    end_ns = times_ns[-1] + (int(np.median(steps)) if len(steps) else NS_PER_S)
    nobody = np.full((1, *positions.shape[1:]), np.nan)
    return np.append(times_ns, end_ns), np.concatenate([positions, nobody])
