"""Forces that a finger feels on a real wall, on a traditional simulated wall, and on the DECAFF drum.

The motion of the finger is given in advance; what differs is the motion that the wall lets it make, when it
answers, and with which spring and damper (the paper's equations 2 to 11 and 16). Numbers of equations are
the paper's.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import lfilter

from proximity.checks import not_negative, positive
from proximity.errors import ArgumentError
from proximity.lab.paper.spring_damper import FINGER, SpringDamper
from proximity.lab.paper.trajectories import Motion, Press

TOUCHING = 1e-15  # m: nearer to the surface is at it but for rounding of the instant
YIELD_STEP = 20e-6  # s, of the pad on a drum that yields; the motion between is taken as straight


class Convention(StrEnum):
    """Convention by which the paper's equation (2) is read: its signs fit no single one."""

    NEWTON = "newton"  # what the hand applies: m x'' + c x' + k x
    PAD = "pad"  # what the skin and the wall exchange: c x' + k x
    PRINTED = "printed"  # the magnitude of the printed form: -m x'' + c x' + k x


INERTIA_SIGN = {Convention.NEWTON: 1.0, Convention.PAD: 0.0, Convention.PRINTED: -1.0}


def contact_force(
    motion: Motion, contact: SpringDamper, convention: str = Convention.NEWTON, *, can_pull: bool = False
) -> np.ndarray:
    """Return the force on a finger whose motion is known, equations (2) and (7), N."""
    inertia = contact.mass * _inertia_sign(convention) * motion.acceleration
    force = inertia + contact.damping * motion.velocity + contact.stiffness * motion.position
    return np.where(motion.position > TOUCHING, force if can_pull else np.maximum(force, 0.0), 0.0)


def steady_force(advance: float, *stiffnesses: float) -> float:
    """Return the force at rest of springs in a row that a hand compresses together, N.

    Of hand, finger and wall, when the hand means to go *advance* beyond the surface: always less than of
    hand and finger alone. The paper's (9) gives more, because it prescribes how far the finger goes.
    """
    return advance / sum(
        1.0 / positive("stiffness", each, "N/m", may_be_infinite=True) for each in stiffnesses
    )


def steady_excess(
    deflection: float, penetration: float, finger: SpringDamper, equivalent: SpringDamper
) -> float:
    """Return by how much a wall that is entered further is felt too strong at rest, equation (10), N."""
    return equivalent.stiffness * (deflection + penetration) - finger.stiffness * deflection


def total_delay(sensing: float, display: float, period: float = 0.0) -> float:
    """Return the delay of a simulated force, equation (11), and half the period for which it is held, s."""
    return sensing + display + 0.5 * period


@dataclass(frozen=True, slots=True)
class RealWall:
    """A rigid wall that is there, FIG 2: the pad alone gives way."""

    finger: SpringDamper = FINGER

    def force(self, times: ArrayLike, press: Press, convention: str = Convention.NEWTON) -> np.ndarray:
        """Return the force on the finger, (...), N."""
        return contact_force(press.at(times), self.finger, convention)


@dataclass(frozen=True, slots=True)
class TraditionalWall:
    """A wall that acts through a spring-damper, when it is penetrated, and late: FIG 3, (7) to (11)."""

    equivalent: SpringDamper = FINGER  # of finger and wall, see `spring_damper.in_series`
    penetration: float = 0.0  # m, x_s: by how much deeper the finger goes than on the real wall
    delay: float = 0.0  # s, see `total_delay`

    def __post_init__(self) -> None:
        not_negative("penetration", self.penetration, "metres")
        not_negative("delay", self.delay, "seconds")

    def force(self, times: ArrayLike, press: Press, convention: str = Convention.NEWTON) -> np.ndarray:
        """Return the force on the finger, (...), N."""
        motion = press.deeper(self.penetration).at(np.asarray(times, np.float64) - self.delay)
        return contact_force(motion, self.equivalent, convention)


@dataclass(frozen=True, slots=True)
class DecaffWall:
    """The drum, in place before the finger comes, FIG 4: the finger meets a thing, not a law.

    A drum that does not yield keeps x_s the same before and after, equation (16), and its force is the real
    wall's. One that yields is a spring behind the pad.
    """

    finger: SpringDamper = FINGER
    drum_stiffness: float = math.inf  # N/m, of drum, servo and transmission

    def __post_init__(self) -> None:
        positive("drum_stiffness", self.drum_stiffness, "newtons a metre", may_be_infinite=True)

    @property
    def yield_share(self) -> float:
        """Share of the finger's advance at rest that the drum gives way: how much too weak the force is."""
        return self.finger.stiffness / (self.finger.stiffness + self.drum_stiffness)

    def force(self, times: ArrayLike, press: Press, convention: str = Convention.NEWTON) -> np.ndarray:
        """Return the force on the finger, (...), N."""
        motion = press.at(times)
        if math.isinf(self.drum_stiffness):
            return contact_force(motion, self.finger, convention)
        pressed = np.interp(np.asarray(times, np.float64), *self._pad_force(press))
        force = self.finger.mass * _inertia_sign(convention) * motion.acceleration + pressed
        return np.where(motion.position > TOUCHING, np.maximum(force, 0.0), 0.0)

    def _pad_force(self, press: Press) -> tuple[np.ndarray, np.ndarray]:
        """Instants from touch to loss, and what pad and drum exchange at them: c p' + k p = K (x - p)."""
        count = 2 + math.ceil((press.loss_time - press.touch_time) / YIELD_STEP)
        times = np.linspace(press.touch_time, press.loss_time, count)
        position = press.at(times).position
        gain = self.drum_stiffness / (self.finger.stiffness + self.drum_stiffness)
        rate = (self.finger.stiffness + self.drum_stiffness) * (times[1] - times[0])
        if self.finger.damping == 0.0:
            return times, self.drum_stiffness * (1.0 - gain) * position
        # The exact step of a first-order lag whose input is a straight line.
        rate /= self.finger.damping
        kept, mean = math.exp(-rate), -math.expm1(-rate) / rate
        deflection = lfilter([gain * (1.0 - mean), gain * (mean - kept)], [1.0, -kept], position)
        return times, self.drum_stiffness * (position - deflection)


def _inertia_sign(convention: str) -> float:
    try:
        return INERTIA_SIGN[Convention(convention)]
    except ValueError:
        raise ArgumentError(
            f"no convention {convention!r}, expected one of {', '.join(Convention)}"
        ) from None
