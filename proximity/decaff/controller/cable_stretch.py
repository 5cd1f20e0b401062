"""Stretch of the cable between finger and drum, which a controller makes up for while the drum is touched."""

import math
from dataclasses import dataclass

from proximity.decaff.arguments import positive


@dataclass(frozen=True, slots=True)
class CableRule:
    """Cable whose stretch is made up for: none, unless its stiffness is given.

    A stiffness that is too small moves the drum too far; one that is too large, not far enough.
    """

    stiffness: float = math.inf  # N/m at the fingertip; inf: no stretch is made up for
    smoothing: float = 2.0  # Hz, of two low-passes of the force; 10 Hz with a force sensor, no more without

    def __post_init__(self) -> None:
        positive("stiffness", self.stiffness, "newtons a metre", may_be_infinite=True)
        positive("smoothing", self.smoothing, "hertz")


class CableStretch:
    """Stretch of the cable, sample by sample.

    Parameters
    ----------
    rule : CableRule
        Of the cable.
    most_force : float, N
        That counts at most.
    """

    metres: float
    """By which the drum is brought nearer."""

    def __init__(self, rule: CableRule, most_force: float) -> None:
        self._rule, self._most_force = rule, most_force
        self.forget()

    def forget(self) -> None:
        """Start anew, without a stretch."""
        self._once = self._twice = self.metres = 0.0

    def take(self, force: float, elapsed: float, *, may_grow: bool) -> None:
        """Take in another sample.

        Parameters
        ----------
        force : float, N
            That presses finger and drum together; nan: none is known.
        elapsed : float, s
            Since the last one.
        may_grow : bool
            Whether the drum may come nearer.
        """
        share = -math.expm1(-2.0 * math.pi * self._rule.smoothing * elapsed)
        self._once += share * ((force if math.isfinite(force) else 0.0) - self._once)
        self._twice += share * (self._once - self._twice)
        stretch = min(max(self._twice, 0.0), self._most_force) / self._rule.stiffness
        self.metres = stretch if may_grow else min(stretch, self.metres)
