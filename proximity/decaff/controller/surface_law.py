"""Force of a deformable surface, limited to what a sampled drum can display (docs/guide/drums.md).

Only physical damping counts: the drum's, and that of the pad of the finger that leans on it. The servo's own
damping is sampled and late, as the surface is, and takes no energy for sure.
"""

import math

from proximity.decaff.arguments import not_negative, positive
from proximity.decaff.controller.passivity import largest_passive_stiffness, required_damping

DAMPING_SHARE = 0.5  # of the physical damping that the surface's may take; assumed
PAD_DAMPING = 2.0  # N s/m, counted on of a fingertip's 6; assumed
DELAY_SAMPLES = 1  # what the servo computes acts a sample later


class SurfaceLaw:
    """``F = k delta + b delta'``, never pulling, within the bound of passivity of drum and pad together.

    Parameters
    ----------
    rate : float, Hz
        Of the servo.
    drum_damping : float, N s/m
        The drum's own, physical, at the fingertip; Coulomb friction is none.
    """

    def __init__(self, rate: float, drum_damping: float) -> None:
        self._period = 1.0 / positive("rate", rate, "hertz")
        self._drum = not_negative("drum_damping", drum_damping, "newton seconds a metre")
        self._own = self._drum + PAD_DAMPING
        self._asked = (0.0, 0.0)
        self._displayed = (0.0, 0.0)

    def displayed(self, stiffness: float, damping: float) -> tuple[float, float]:
        """Return the stiffness, N/m, and the damping, N s/m, that are displayed for those of a surface.

        Parameters
        ----------
        stiffness : float, N/m
            Of the surface; what is no number counts as nothing.
        damping : float, N s/m
            Of the surface, likewise.
        """
        asked = (_usable(stiffness), _usable(damping))
        if asked != self._asked:
            soft = min(asked[1], DAMPING_SHARE * self._own)
            most = largest_passive_stiffness(self._own, soft, self._period, DELAY_SAMPLES)
            self._asked, self._displayed = asked, (min(asked[0], most), soft)
        return self._displayed

    def lacking(self, stiffness: float, damping: float) -> float:
        """Return the damping that the drum alone lacks to display a surface passively, N s/m; 0: none.

        Parameters
        ----------
        stiffness, damping
            As of `displayed`.
        """
        k, b = self.displayed(stiffness, damping)
        return max(0.0, required_damping(k, b, self._period, DELAY_SAMPLES) - self._drum)

    def force(self, stiffness: float, damping: float, depth: float, speed: float, incidence: float) -> float:
        """Return the force along the finger's path, N.

        Parameters
        ----------
        stiffness, damping
            As of `displayed`.
        depth : float, m
            Of the finger beyond the position of contact, along its path.
        speed : float, m/s
            At which that grows.
        incidence : float
            Cosine between way and normal: it shortens the depth, and of the force only that share is along
            the way.
        """
        if not depth > 0.0:
            return 0.0
        k, b = self.displayed(stiffness, damping)
        return max(0.0, incidence * incidence * (k * depth + b * speed))


def _usable(number: float) -> float:
    return float(number) if math.isfinite(number) and number > 0.0 else 0.0
