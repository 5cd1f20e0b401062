"""Force of a deformable surface, limited to what a sampled drum can display (docs/guide/drums.md).

Only physical damping counts: the drum's, and that of the pad of the finger that leans on it. The servo's own
damping is sampled and late, as the surface is, and takes no energy for sure.
"""

import math

from proximity.decaff.controller.compiled import in_c
from proximity.decaff.controller.passivity import required_damping
from proximity.decaff.controller.settings import ControllerSettings

DELAY_SAMPLES = 1  # what the servo computes acts a sample later, beside the motor's latency


class SurfaceLaw:
    """``F = k delta + b delta'``, never pulling, within the bound of passivity of drum and pad together."""

    def __init__(self, settings: ControllerSettings, drum_damping: float = 0.0) -> None:
        self._period, self._drum = 1.0 / settings.rate, drum_damping  # N s/m, the drum's own
        self._delay = DELAY_SAMPLES + math.ceil(settings.drum.motor.latency / self._period - 1e-9)
        self._settings = settings.record()[1][0]

    def displayed(self, stiffness: float, damping: float) -> tuple[float, float]:
        """Return what is displayed of a surface's stiffness, N/m, and damping, N s/m."""
        displayed = in_c("displayed")(self._settings, stiffness, damping)
        return displayed[0], displayed[1]

    def lacking(self, stiffness: float, damping: float) -> float:
        """Return the damping that the drum alone lacks to display a surface passively, N s/m; 0: none."""
        k, b = self.displayed(stiffness, damping)
        return max(0.0, required_damping(k, b, self._period, self._delay) - self._drum)
