"""Instruments that a person reads and whose numbers are asked for, or whose counts come in messages."""

import time
from collections.abc import Callable, Sequence

import numpy as np

from proximity.decaff.calibration.instruments import DrumRecord
from proximity.errors import DecaffError
from proximity.message import GLOVE_POSES
from proximity.service.inputs.inbox import Inbox

LISTENING_S, SILENCE_S, LOOK_S = 0.2, 5.0, 0.005


class TypedInstruments:
    """Hand and drum whose numbers a person gives; both ports at once.

    *address*: where `GLOVE_POSES` messages bring the counts; None: they are asked for, too.
    """

    rate = 0.0  # Hz: nobody types a chirp
    numbers: Callable[[Sequence[str]], list[float]]
    """Asks questions, and returns a number for each: set before anything is asked."""

    def __init__(self, address: str | None, finger: int) -> None:
        self._finger = finger
        self._reception = None if address is None else Inbox(address, [GLOVE_POSES], is_timed=False)

    def counts(self) -> np.ndarray:
        """Return counts that are asked for, or those that come for a moment from now on."""
        if self._reception is None:
            return np.array(self.numbers(["counts of the potentiometer"]))
        self._arrived()  # what came before the hand was still
        found: list[float] = []
        started = time.monotonic()
        ends = started + LISTENING_S
        while time.monotonic() < ends or not found:
            if time.monotonic() > started + SILENCE_S:
                raise DecaffError(
                    f"{self._reception.address}: no counts of finger {self._finger} for {SILENCE_S:g} s: "
                    "does the glove send glove_poses there?"
                )
            found += self._arrived()
            time.sleep(LOOK_S)
        return np.array(found)

    def latency(self) -> tuple[float, float]:
        """Return the latency that a person measured."""
        latency, sampled = self.numbers(
            ["latency of the glove by your step test, in ms", "time between samples of the step test, in ms"]
        )
        return 1e-3 * latency, 1e-3 * sampled

    def angle(self) -> float:
        """Return the drum's angle that a person reads."""
        return self.numbers(["angle of the drum's encoder, in radians"])[0]

    def swing(self, torques: np.ndarray) -> DrumRecord:
        """Refuse: only a motor swings a drum."""
        raise DecaffError("the swing of a drum cannot be typed, expected a motor")

    def _arrived(self) -> list[float]:
        """Counts of this finger that came since the last look."""
        found: list[float] = []
        if self._reception is not None:
            for _, records, _ in self._reception.messages():
                counts = records["counts"][records["finger"] == self._finger]
                found += counts[np.isfinite(counts)].tolist()
        return found
