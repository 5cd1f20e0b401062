"""Energies of a press, equations (5) and (12) to (15) of the paper, for any shape of the stop.

What the damper takes while a finger stops depends on how it stops: D = kappa c v x, with kappa the mean
over the way of the speed left, v(x)/v. The paper's 1/2 holds for an exponential approach alone.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.integrate import quad

from proximity.errors import ArgumentError
from proximity.lab.paper.trajectories import Press
from proximity.lab.paper.walls import SpringDamper, contact_force

QUADRATURE_POINTS = 8  # exact up to the power 15; power, of a motion of the fourth, has 7


class Stop(StrEnum):
    """Shape of a finger's stop."""

    EXPONENTIAL = "exponential"  # as in the paper's (12)
    CONSTANT_DECELERATION = "constant deceleration"
    QUINTIC = "quintic"  # as a `Press`


# The speed left at s, and the s at rest: time times first speed over depth.
_STOPS: dict[Stop, tuple[Callable[[float], float], float]] = {
    Stop.EXPONENTIAL: (lambda s: math.exp(-s), math.inf),
    Stop.CONSTANT_DECELERATION: (lambda s: 1.0 - s / 2.0, 2.0),
    Stop.QUINTIC: (lambda s: (1.0 - s / 2.0) ** 2 * (1.0 + s), 2.0),
}


def kappa(stop: str | Callable[[float], float], end: float = math.inf) -> float:
    """Return the factor of the damper's loss for a way of stopping."""
    if callable(stop):
        speed = stop
    else:
        try:
            speed, end = _STOPS[Stop(stop)]
        except ValueError:
            raise ArgumentError(f"no stop {stop!r}, expected one of {', '.join(Stop)}") from None
    depth = quad(speed, 0.0, end)[0]
    if not abs(depth - 1.0) < 1e-6:  # looser than quad, tighter than any mistake
        raise ArgumentError(f"the finger goes {depth:g} depths until it rests, expected 1")
    return float(quad(lambda s: speed(s) ** 2, 0.0, end, epsabs=1e-13, epsrel=1e-13)[0])


def kinetic_energy(mass: float, speed: float) -> float:
    """Return the energy of a mass that moves, J."""
    return 0.5 * mass * speed**2


def spring_energy(stiffness: float, deflection: float) -> float:
    """Return what a spring holds, J."""
    return 0.5 * stiffness * deflection**2


def damping_loss(damping: float, speed: float, depth: float, factor: float) -> float:
    """Return what a damper takes while a finger stops, J."""
    return factor * damping * speed * depth


@dataclass(frozen=True, slots=True)
class Balance:
    """Energy balance of a press from touch to rest, equation (5): kinetic + work = spring + loss."""

    kinetic: float  # J, at touch
    work: float  # J, that the hand does
    spring: float  # J, at rest
    loss: float  # J, in the damper

    @property
    def residual(self) -> float:
        """Residual of the balance, J."""
        return self.kinetic + self.work - self.spring - self.loss


def balance(press: Press, finger: SpringDamper) -> Balance:
    """Return where the energy of a press goes, each term integrated on its own."""
    nodes, weights = leggauss(QUADRATURE_POINTS)
    motion = press.at(press.touch_time + 0.5 * press.rise_time * (1.0 + nodes))
    weights = 0.5 * press.rise_time * weights
    applied = contact_force(motion, finger, can_pull=True)
    return Balance(
        kinetic=kinetic_energy(finger.mass, press.speed),
        work=float(weights @ (applied * motion.velocity)),
        spring=spring_energy(finger.stiffness, press.depth),
        loss=float(weights @ (finger.damping * np.square(motion.velocity))),
    )


@dataclass(frozen=True, slots=True)
class EnergyExcess:
    """Energy that a penetrated wall takes beyond the real one; extra work of the operator, J."""

    spring: float  # equation (13)
    damping: float  # equation (14a)
    linear: float  # part of the sum that grows with the penetration
    quadratic: float  # part that grows with its square

    @property
    def total(self) -> float:
        """Equations (14b) and (15), J."""
        return self.spring + self.damping


def energy_excess(
    press: Press,
    penetration: float,
    finger: SpringDamper,
    equivalent: SpringDamper | None = None,
    *,
    factor: float = 0.5,
) -> EnergyExcess:
    """Return how much more energy a press takes on a wall that is penetrated, equations (13) to (15)."""
    other = finger if equivalent is None else equivalent
    depth, speed = press.depth, press.speed
    deep = depth + penetration
    return EnergyExcess(
        spring=spring_energy(other.stiffness, deep) - spring_energy(finger.stiffness, depth),
        damping=damping_loss(other.damping, speed, deep, factor)
        - damping_loss(finger.damping, speed, depth, factor),
        linear=penetration * (other.stiffness * depth + factor * other.damping * speed),
        quadratic=spring_energy(other.stiffness, penetration),
    )


def quadratic_from(press: Press, finger: SpringDamper, *, factor: float = 0.5) -> float:
    """Return the penetration from which on the energy's excess is mostly quadratic in it, m."""
    return 2.0 * (press.depth + factor * finger.damping * press.speed / finger.stiffness)
