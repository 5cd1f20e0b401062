"""Response of a press: forces and positions, instant by instant."""

from dataclasses import dataclass

import numpy as np

from proximity.lab.paper.trajectories import Intent
from proximity.lab.simulation import press_kernels
from proximity.lab.simulation.hand import Hand


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Response of a press on a wall; N steps. Arrays are views of one record."""

    hand: Hand
    press: Intent
    step: float  # s
    zero: int  # row of the contact
    record: np.ndarray  # (RECORD_SIZE, N), rows of `finger_kernels`

    @property
    def times(self) -> np.ndarray:
        """(N,) s, from the contact."""
        return self.step * (np.arange(self.record.shape[1]) - self.zero)

    @property
    def force(self) -> np.ndarray:
        """(N,) N, of the pad on the finger."""
        return self.record[press_kernels.RECORD_FORCE]

    @property
    def finger(self) -> np.ndarray:
        """(N,) m."""
        return self.record[press_kernels.RECORD_FINGER]

    @property
    def finger_speed(self) -> np.ndarray:
        """(N,) m/s."""
        return self.record[press_kernels.RECORD_FINGER_SPEED]

    @property
    def link(self) -> np.ndarray:
        """(N,) m, of what meets the drum."""
        return self.record[press_kernels.RECORD_LINK]

    @property
    def thimble(self) -> np.ndarray:
        """(N,) m, of what the pad presses on: the near end of the cable, or the link where there is none."""
        return self.record[press_kernels.RECORD_THIMBLE]

    @property
    def drum(self) -> np.ndarray:
        """(N,) m."""
        return self.record[press_kernels.RECORD_DRUM]

    @property
    def contact(self) -> np.ndarray:
        """(N,) N, of wall or drum on the link."""
        return self.record[press_kernels.RECORD_CONTACT]
