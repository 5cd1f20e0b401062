"""Step of a drum under the load of a finger at a known position."""

import numpy as np

from proximity.decaff.drum.drum_kernels import DRIVE_POSITION, push_drum, serve
from proximity.native import entry


@entry("float64[:], float64[:], float64[:], float64[:], float, float, int, int, float -> float")
def serve_against(
    drum: np.ndarray,
    servo: np.ndarray,
    drive: np.ndarray,
    command: np.ndarray,
    finger: float,
    stiffness: float,
    samples: int,
    steps: int,
    step: float,
) -> float:
    """Serve a command for so many samples of *steps* each, and return the force on the finger, N.

    The finger stays where it is; its pad gives way where the drum stands before it.
    """
    contact = max(0.0, stiffness * (finger - drive[DRIVE_POSITION]))
    for _ in range(samples):
        serve(drum, servo, drive, command, contact)
        for _ in range(steps):
            contact = max(0.0, stiffness * (finger - drive[DRIVE_POSITION]))
            push_drum(drum, drive, contact, step)
    return contact
