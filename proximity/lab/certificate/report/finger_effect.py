"""What a latency means at the finger: how deep a wall is entered, and how wrong force and energy are then.

A simulated wall is entered by speed times delay before it answers. Where the finger's motion is
prescribed, the force at rest is then too high, equation (10), and the operator's work too large, equation
(15). The finger is the paper's, the press assumed.
"""

import math
from dataclasses import dataclass

from proximity.lab.paper.energies import energy_excess
from proximity.lab.paper.trajectories import Press
from proximity.lab.paper.walls import FINGER, steady_excess, total_delay

SPEEDS = (0.1, 0.5, 1.0)
"""m/s, of fingers that meet a wall."""


@dataclass(frozen=True, slots=True)
class Felt:
    """A press on a wall that answers late."""

    speed: float  # m/s
    penetration: float  # m
    force_error: float  # N, of 0.8 N at rest
    energy_error: float  # J


def felt(delay: float, speed: float) -> Felt:
    """Return what a delay means for a finger of that speed."""
    penetration, press = speed * delay, Press(speed=speed)
    return Felt(
        speed,
        penetration,
        steady_excess(press.depth, penetration, FINGER, FINGER),
        energy_excess(press, penetration, FINGER).total,
    )


def delay_of(period: float, busy: float) -> float:
    """Return the delay, at worst, of a force that is computed every period, s: equation (11).

    A finger that touches just after a tick is noticed a period later, and answered when that is computed.

    *busy*: from when a tick is due until its answer; beyond a period, ticks are left out.
    """
    return total_delay(period * max(1, math.ceil(busy / period)), busy)
