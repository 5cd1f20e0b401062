"""Model of the hand that presses: its intended motion, its stiffness, and the finger with its pad.

The hand's intent is a motion given in advance (`trajectories.Press`), through the wall's surface to a depth
that no hand reaches: springs and dampers lie between intent and finger, and between finger and surface.
Contact is at 0, at time 0; positions are positive into the wall.
"""

import math
from dataclasses import dataclass

from proximity.checks import not_negative, positive
from proximity.decaff.drum.drum_model import PAD_STIFFNESS
from proximity.lab.paper.trajectories import Press

STEADY_FORCE = 0.8  # N: a pad of 200 N/m pressed in by 4 mm
HOLD_TIME = 0.2  # s; assumed


@dataclass(frozen=True, slots=True)
class Hand:
    """Hand, finger and pad in a row: intent - (spring, damper) - finger - (spring, damper) - surface."""

    stiffness: float = 300.0  # N/m, of hand and arm; assumed
    damping: float = 3.0  # N s/m; assumed
    finger_mass: float = 0.010  # kg; assumed
    pad_stiffness: float = PAD_STIFFNESS
    pad_damping: float = 6.0  # N s/m, the paper's

    def __post_init__(self) -> None:
        positive("stiffness", self.stiffness, "newtons a metre")
        not_negative("damping", self.damping, "newton seconds a metre")
        positive("finger_mass", self.finger_mass, "kilograms")
        positive("pad_stiffness", self.pad_stiffness, "newtons a metre")
        not_negative("pad_damping", self.pad_damping, "newton seconds a metre")

    @property
    def series_stiffness(self) -> float:
        """Stiffness of hand and pad in series, N/m: force per displacement of the wall."""
        return 1.0 / (1.0 / self.stiffness + 1.0 / self.pad_stiffness)

    def steady_force(self, depth: float, wall_stiffness: float = math.inf) -> float:
        """Return the force at rest, N."""
        wall = positive("wall_stiffness", wall_stiffness, "newtons a metre", may_be_infinite=True)
        return not_negative("depth", depth, "metres") / (1.0 / self.series_stiffness + 1.0 / wall)

    def press(self, speed: float, *, hold: float = HOLD_TIME) -> Press:
        """Return the intent that comes at some speed and holds `STEADY_FORCE` against a rigid wall."""
        depth = STEADY_FORCE / self.series_stiffness
        rise = 2.0 * depth / positive("speed", speed, "metres a second")
        return Press(speed, depth, touch_time=0.0, release_time=rise + positive("hold", hold, "seconds"))
