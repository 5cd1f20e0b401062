"""Bends that come with poses of fingers without a path: the value, and its rate of change."""

import numpy as np

from proximity.kernels.tracking.motion import (
    ESTIMATE,
    ESTIMATES,
    MAX_ACCELERATION,
    MAX_SPEED,
    PREDICTED,
    observe,
)
from proximity.message import ContactFlag

METRES_A_BEND = 0.2
"""That a fingertip goes from flat hand to fist, about: what is known of noise and acceleration of
fingertips in metres holds of bends by it."""


class Bends:
    """Follows the bends of fingers from pose to pose."""

    def __init__(self, count: int) -> None:
        self._motions = np.zeros((count, ESTIMATES), ESTIMATE)

    def forget(self) -> None:
        """Start anew."""
        self._motions[:] = 0

    def write(self, contacts: np.ndarray, bends: np.ndarray, pose_ns: np.ndarray) -> None:
        """Write bend and bend rate at the pose's instant, of fingers that are tracked and are on no path.

        *contacts*: (N,) CONTACT. *bends*: as they came with the poses; nan: not reported. *pose_ns*: (N,),
        ns.
        """
        is_tracked = contacts["flags"] & (ContactFlag.TRACKED | ContactFlag.ON_PATH) == ContactFlag.TRACKED
        for i in np.flatnonzero(is_tracked & np.isfinite(bends)).tolist():
            bend = bends.item(i)
            status = observe(
                self._motions, i, pose_ns.item(i), METRES_A_BEND * bend, 0.0, 0.0, MAX_SPEED,
                MAX_ACCELERATION,
            )  # fmt: skip
            contacts["bend"][i] = bend
            if status & PREDICTED:
                contacts["bend_rate"][i] = self._motions["velocity"].item(i, 0, 0) / METRES_A_BEND
