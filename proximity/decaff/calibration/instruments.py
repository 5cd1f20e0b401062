"""Interface of what a calibration measures with: the hand's potentiometer, and the drum's encoder and motor.

A laboratory's own instruments, the simulated glove and a person who types numbers stand behind it alike.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np


@dataclass(frozen=True, slots=True, eq=False)
class DrumRecord:
    """Samples of a drum that was swung; N of them, positive away from the finger."""

    times: np.ndarray  # (N,) s, increasing; each torque was commanded then, and each angle read
    commanded: np.ndarray  # (N,) N m at the drum
    angles: np.ndarray  # (N,) rad of the drum
    torques: np.ndarray  # (N,) N m at the drum, by the motor's current


class DrumPort(Protocol):
    """Drum with an encoder, perhaps with a motor that takes torques at a fixed rate."""

    rate: float  # Hz, of torques; 0: it cannot be swung

    def angle(self) -> float:
        """Return the angle that the encoder reads, rad."""

    def newest_angle(self) -> float:
        """Return the angle right now, rad, to be shown; nan where nobody may be asked meanwhile."""

    def swing(self, torques: np.ndarray) -> DrumRecord:
        """Command torques, N m at the drum, one a sample, then none; return what was read meanwhile."""


class HandPort(Protocol):
    """Potentiometer of the glove on a hand."""

    def counts(self) -> np.ndarray:
        """Return readings of a moment, (K,) float64; one where only one is known."""

    def newest_counts(self) -> float:
        """Return the counts right now, to be shown; nan where nobody may be asked meanwhile."""

    def latency(self) -> tuple[float, float]:
        """Return the latency that a step test finds, s, and how finely it was sampled, s."""


@dataclass(frozen=True, slots=True)
class Instruments:
    """What a calibration measures with."""

    name: str  # readings of other instruments are never mixed with these
    hand: HandPort
    drum: DrumPort
    is_simulated: bool = False  # for practice

    def live(self) -> dict[str, str]:
        """Return what is read right now, by names, with units."""
        read = {
            "potentiometer": (self.hand.newest_counts(), "{:.0f} counts"),
            "drum": (self.drum.newest_angle(), "{:.3f} rad"),
        }
        return {name: shown.format(value) for name, (value, shown) in read.items() if math.isfinite(value)}
