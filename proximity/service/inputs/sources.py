"""Sources of poses: the interface of an input, and a recording."""

from collections.abc import Iterable
from typing import Protocol, runtime_checkable

import numpy as np

from proximity.errors import ServiceError
from proximity.kernels.tracking.motion import MAX_GAP_NS
from proximity.recording import Recording
from proximity.service.samples import Samples
from proximity.system.time_units import NS_PER_S


class PoseInput(Protocol):
    """An input of samples.

    Where it has ``loop_end()`` or ``loop_recording()`` that return something, the loop takes poses from there
    by itself; otherwise it is a `PolledInput`.
    """

    is_over: bool
    """Whether nothing will come any more."""
    address: str
    """Where samples come from, for messages."""

    @property
    def notes(self) -> list[str]:
        """Sentences for the report: what was refused or failed, and how often."""

    def close(self) -> None:
        """Give back what is open."""


@runtime_checkable
class PolledInput(PoseInput, Protocol):
    """An input that a thread polls; its methods neither wait nor raise.

    Where it has ``wait(timeout)`` it is polled when poses come, which wake the loop; otherwise twice in each
    period.
    """

    def poll(self, now_ns: int) -> Iterable[Samples]:
        """Give the samples that are new since the poll before, oldest first; each is used before the next."""


class RecordingInput:
    """A recording that the loop plays: each pose has its recorded instant, counted from the first tick on.

    To serve a recording as fast as it can be computed, give the service a `SkippingClock`.

    *recording*: in the frame of the scene. At its own instants, or `Recording.resampled` to those of the
    ticks. *latency*: how old a pose is when it comes in. *repeat*: begin anew after the end. Between, the
    hand is away for a tenth of a second: from the last pose to the first it has not moved, and no velocity
    may say so.
    """

    is_over = False  # the loop knows

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
        """What the loop of a service has to know to play it."""
        return {
            "times_ns": self._times_ns.ctypes.data,
            "positions": self._positions.ctypes.data,
            "rows": len(self._times_ns),
            "latency_ns": self._latency_ns,
            "round_ns": self._round_ns if self._repeat else 0,
        }

    def close(self) -> None:
        """Do nothing."""


def _with_nobody_at_the_end(times_ns: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and positions with one more instant, a step as there are others after the last: no finger."""
    steps = np.diff(times_ns)
    end_ns = times_ns[-1] + (int(np.median(steps)) if len(steps) else NS_PER_S)
    nobody = np.full((1, *positions.shape[1:]), np.nan)
    return np.append(times_ns, end_ns), np.concatenate([positions, nobody])
