"""Instruments whose readings are typed, or whose counts are received as messages."""

import time
from collections.abc import Callable, Sequence

import numpy as np

from proximity.decaff.calibration.instruments import DrumRecord
from proximity.errors import DecaffError
from proximity.message import GLOVE_POSES
from proximity.service.inputs.inbox import Inbox

LISTENING_S, SILENCE_S, LOOK_S = 0.2, 5.0, 0.005


class TypedInstruments:
    """Instruments of hand and drum whose readings the user types.

    *address*: address of `GLOVE_POSES` messages that contain the counts; None: counts are typed.
    """

    rate = 0.0  # Hz: a chirp cannot be typed
    numbers: Callable[[Sequence[str]], list[float]]
    """Function that returns a number for each question. It is set before the first reading."""

    def __init__(self, address: str | None, finger: int) -> None:
        self._finger = finger
        self._reception = None if address is None else Inbox(address, [GLOVE_POSES], is_timed=False)

    def counts(self) -> np.ndarray:
        """Return typed counts, or those received in the next `LISTENING_S`."""
        if self._reception is None:
            return np.array(self.numbers(["counts of the potentiometer"]))
        self._arrived()  # discards counts from before the hand was still
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
        """Return the latency and the sample time that the user types, s."""
        latency, sampled = self.numbers(
            ["latency of the glove by your step test, in ms", "time between samples of the step test, in ms"]
        )
        return 1e-3 * latency, 1e-3 * sampled

    def angle(self) -> float:
        """Return the angle of the drum that the user types, rad."""
        return self.numbers(["angle of the drum's encoder, in radians"])[0]

    def swing(self, torques: np.ndarray) -> DrumRecord:
        """Raise an error, since only a motor can swing a drum."""
        raise DecaffError("the swing of a drum cannot be typed, expected a motor")

    def _arrived(self) -> list[float]:
        """Return the counts of this finger received since the last call."""
        found: list[float] = []
        if self._reception is not None:
            for _, records, _ in self._reception.messages():
                counts = records["counts"][records["finger"] == self._finger]
                found += counts[np.isfinite(counts)].tolist()
        return found
