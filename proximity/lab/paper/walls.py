"""Forces that a finger feels on a real wall, and on a traditional simulated wall.

The motion of the finger is given in advance. Walls differ in the permitted motion, the delay, and the spring
and damper (equations 2 to 15). The numbers of equations are those of the paper.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from proximity.checks import not_negative
from proximity.errors import ArgumentError
from proximity.lab.paper.trajectories import Motion, Press

TOUCHING = 1e-15  # m, distance that counts as contact, within rounding of the instant


@dataclass(frozen=True, slots=True)
class SpringDamper:
    """A spring and a damper in parallel, with the mass that moves with them."""

    stiffness: float  # N/m; inf: rigid
    damping: float  # N·s/m; inf: rigid
    mass: float = 0.0  # kg

    def __post_init__(self) -> None:
        not_negative("stiffness", self.stiffness, "newtons a metre", may_be_infinite=True)
        not_negative("damping", self.damping, "newton seconds a metre", may_be_infinite=True)
        not_negative("mass", self.mass, "kilograms")


FINGER = SpringDamper(stiffness=200.0, damping=6.0, mass=0.010)
"""Pad of the paper's finger. Its mass is assumed."""


def in_series(first: SpringDamper, second: SpringDamper) -> SpringDamper:
    """Return the paper's equivalent of two spring-dampers in series, equation (8), with the first one's mass.

    It is exact only if damping over stiffness is the same in both. Otherwise only its stiffness is right, for
    slow motions.
    """
    return SpringDamper(
        _harmonic(first.stiffness, second.stiffness), _harmonic(first.damping, second.damping), first.mass
    )


def _harmonic(one: float, other: float) -> float:
    return 0.0 if one == 0.0 or other == 0.0 else 1.0 / (1.0 / one + 1.0 / other)


class Convention(StrEnum):
    """Convention for the force of equation (2), whose printed signs fit no single convention."""

    NEWTON = "newton"  # applied by the hand: m x'' + c x' + k x
    PAD = "pad"  # exchanged by skin and wall: c x' + k x
    PRINTED = "printed"  # the magnitude of the printed form: -m x'' + c x' + k x


INERTIA_SIGN = {Convention.NEWTON: 1.0, Convention.PAD: 0.0, Convention.PRINTED: -1.0}


def contact_force(
    motion: Motion, contact: SpringDamper, convention: str = Convention.NEWTON, *, can_pull: bool = False
) -> np.ndarray:
    """Return the force on a finger with a given motion by equations (2) and (7), N."""
    inertia = contact.mass * _inertia_sign(convention) * motion.acceleration
    force = inertia + contact.damping * motion.velocity + contact.stiffness * motion.position
    return np.where(motion.position > TOUCHING, force if can_pull else np.maximum(force, 0.0), 0.0)


def steady_excess(
    deflection: float, penetration: float, finger: SpringDamper, equivalent: SpringDamper
) -> float:
    """Return the excess of the force at rest on a wall that is penetrated further, equation (10), N."""
    return equivalent.stiffness * (deflection + penetration) - finger.stiffness * deflection


def spring_energy(stiffness: float, deflection: float) -> float:
    """Return the energy of a deflected spring, J."""
    return 0.5 * stiffness * deflection**2


def damping_loss(damping: float, speed: float, depth: float, factor: float) -> float:
    """Return the energy dissipated by a damper while a finger stops, J."""
    return factor * damping * speed * depth


def energy_excess(press: Press, penetration: float, finger: SpringDamper, *, factor: float = 0.5) -> float:
    """Return the excess energy of a press on a penetrated wall by equations (13) to (15), J.

    *factor*: mean speed over the path as a share of the initial speed, which depends on the deceleration. It
    is 1/2 for an exponential approach, as in the paper, 2/3 for a constant deceleration, and 26/35 for a
    `Press`.
    """
    depth, deep = press.depth, press.depth + penetration
    spring = spring_energy(finger.stiffness, deep) - spring_energy(finger.stiffness, depth)
    return spring + (
        damping_loss(finger.damping, press.speed, deep, factor)
        - damping_loss(finger.damping, press.speed, depth, factor)
    )


def total_delay(sensing: float, display: float, period: float = 0.0) -> float:
    """Return the delay of a simulated force by equation (11), plus half of its hold period, s."""
    return sensing + display + 0.5 * period


@dataclass(frozen=True, slots=True)
class TraditionalWall:
    """A wall that acts through a spring-damper after penetration and with a delay.

    It is that of FIG 3 and equations (7) to (11).
    """

    equivalent: SpringDamper = FINGER  # of finger and wall in series, (8)
    penetration: float = 0.0  # m, x_s: additional depth of the finger beyond that on the real wall
    delay: float = 0.0  # s, see `total_delay`

    def __post_init__(self) -> None:
        not_negative("penetration", self.penetration, "metres")
        not_negative("delay", self.delay, "seconds")

    def force(self, times: ArrayLike, press: Press, convention: str = Convention.NEWTON) -> np.ndarray:
        """Return the force on the finger, (...), N."""
        motion = press.deeper(self.penetration).at(np.asarray(times, np.float64) - self.delay)
        return contact_force(motion, self.equivalent, convention)


def _inertia_sign(convention: str) -> float:
    try:
        return INERTIA_SIGN[Convention(convention)]
    except ValueError:
        raise ArgumentError(
            f"no convention {convention!r}, expected one of {', '.join(Convention)}"
        ) from None
