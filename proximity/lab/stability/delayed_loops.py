"""Stability limits from delay alone, without sampling: a mass, a finger, a position-controlled handle.

Each loop is lost where its phase has turned half round while its gain is still one.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from proximity.checks import not_negative, positive
from proximity.decaff.drum.sampled_mass import ROOT_TOLERANCE, Gains
from proximity.lab.paper.spring_damper import SpringDamper

SMALL_TURN = 1e-9  # rad, where a bracket begins: at rest every loop is in phase
HOLD_AND_COMPUTING = 1.5  # periods from a position to the middle of its force


def pure_delay_boundary(mass: float, delay: float, count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Return the edge of the stable region of a wall felt late: stiffness (count,), N/m, and damping, N·s/m.

    *count*: how many points, from no stiffness and no damping to no stiffness and the largest damping.
    """
    turn = np.linspace(0.0, 0.5 * math.pi, count)
    unit = positive("mass", mass, "kilograms") / positive("delay", delay, "seconds")
    cosine = np.where(turn < 0.5 * math.pi, np.cos(turn), 0.0)  # at a right angle, but for rounding
    return unit / delay * turn**2 * cosine, unit * turn * np.sin(turn)


def pure_delay_limit(mass: float, delay: float) -> Gains:
    """Return the largest stiffness of a wall felt late by a free mass, and its damping: u tan u = 2."""
    unit = positive("mass", mass, "kilograms") / positive("delay", delay, "seconds")
    turn = brentq(lambda u: u * math.sin(u) - 2.0 * math.cos(u), 0.0, 0.5 * math.pi, xtol=ROOT_TOLERANCE)
    return Gains(unit / delay * turn**2 * math.cos(turn), unit * turn * math.sin(turn))


@dataclass(frozen=True, slots=True)
class SpringLimit:
    """Stiffness at which a finger becomes unstable against a delayed spring."""

    stiffness: float  # N/m
    frequency_hz: float  # of the shaking


def delayed_spring_limit(finger: SpringDamper, delay: float) -> SpringLimit:
    """Return the stiffness up to which a finger rests on a spring that it feels late.

    *finger*: held by a hand that stands still; with damping.

    Notes
    -----
    Source: m s² + c s + k + K exp(-s tau) = 0 on the imaginary axis.
    """
    positive("delay", delay, "seconds")
    damping = positive("damping", finger.damping, "newton seconds a metre")

    def out_of_phase(turn: float) -> float:
        omega = turn / delay
        rest = finger.mass * omega**2 - finger.stiffness
        return rest * math.sin(turn) - damping * omega * math.cos(turn)

    limit, resonance = SpringLimit(math.inf, 0.0), _resonance(finger)
    start, omega = 0.0, -1.0
    # A finger that resonates may be lost at a later turn than the first; beyond that it gives way less.
    while omega < resonance:
        turn = brentq(out_of_phase, start + SMALL_TURN, start + math.pi, xtol=ROOT_TOLERANCE)
        omega = turn / delay
        stiffness = math.hypot(finger.mass * omega**2 - finger.stiffness, damping * omega)
        if stiffness < limit.stiffness:
            limit = SpringLimit(stiffness, omega / (2.0 * math.pi))
        start += 2.0 * math.pi
    return limit


def _resonance(finger: SpringDamper) -> float:
    """Frequency at which the finger gives way most, rad/s; 0 if that is at rest."""
    if finger.mass == 0.0:
        return 0.0
    squared = finger.stiffness / finger.mass - 0.5 * (finger.damping / finger.mass) ** 2
    return math.sqrt(max(squared, 0.0))


ARM = SpringDamper(stiffness=500.0, damping=20.0, mass=2.0)
"""Of an operator who holds a handle; assumed."""


@dataclass(frozen=True, slots=True)
class PositionedHandle:
    """A handle that is moved to where a simulated compliance would be: Kazerooni's kind of display.

    All assumed. The text gives no more than a limit of 3 ms on the period.
    """

    arm: SpringDamper = ARM
    stiffness: float = 200.0  # N/m, that is shown
    damping: float = 20.0  # N·s/m, that is shown
    bandwidth_hz: float = 10.0  # of the position loop, twice a first-order lag

    def __post_init__(self) -> None:
        positive("stiffness", self.stiffness, "newtons a metre")
        not_negative("damping", self.damping, "newton seconds a metre")
        positive("bandwidth_hz", self.bandwidth_hz, "hertz")

    @property
    def slowest_period(self) -> float:
        """Period from which on arm and handle shake, s; 0 if they do at any, inf if at none."""
        lag = np.array([1.0 / (2.0 * math.pi * self.bandwidth_hz), 1.0])
        arm = np.array([self.arm.mass, self.arm.damping, self.arm.stiffness])
        shown = np.polymul(np.polymul(lag, lag), [self.damping, self.stiffness])
        if np.roots(np.polyadd(shown, arm)).real.max() >= 0.0:
            return 0.0
        # Where the gain is one.
        crossed = np.roots(np.polysub(_squared_modulus(arm), _squared_modulus(shown)))
        omega = np.sqrt(crossed[(np.abs(crossed.imag) < 1e-9 * np.abs(crossed)) & (crossed.real > 0.0)].real)
        phase = np.angle(np.polyval(arm, 1j * omega) / np.polyval(shown, 1j * omega))
        return float(np.min((math.pi + phase) / omega, initial=math.inf)) / HOLD_AND_COMPUTING


def _squared_modulus(polynomial: np.ndarray) -> np.ndarray:
    """Squared modulus of a polynomial in s on the imaginary axis, in powers of the squared frequency."""
    power = len(polynomial) - 1
    mirrored = polynomial * (-1.0) ** np.arange(power, -1, -1)
    even = np.polymul(polynomial, mirrored)[::2]  # in s², highest first
    return even * (-1.0) ** np.arange(len(even) - 1, -1, -1)
