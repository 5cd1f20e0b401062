"""Rule by which a controller makes up for the stretch of the cable while the drum is touched."""

import math
from dataclasses import dataclass

from proximity.checks import positive


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
