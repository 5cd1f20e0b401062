"""Simulation of a chain of links that presses its tip against a plane: motion, impulses and their sums.

The plane pushes like a spring and a damper and never pulls. What the tip is shown of that may come late, or
be sampled and held, as by a simulated wall: then a contact gives back more energy than it took.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from proximity.checks import not_negative, positive
from proximity.errors import ArgumentError
from proximity.lab.multibody import contact_kernels as kernels
from proximity.lab.multibody.finger_chain import PlanarFinger, joint_torques

MAX_STEPS = 2_000_000
"""Some 300 MB of states for a finger of three links."""
WHOLE = 1e-6
"""Of a step: how far a lag may be off whole steps, which is rounding."""


class Shown(IntEnum):
    """Transmission of the plane's force to the tip."""

    AT_ONCE = kernels.SHOWN_AT_ONCE
    LATE = kernels.SHOWN_LATE
    """A lag later."""
    HELD = kernels.SHOWN_HELD
    """Sampled once a lag, and held until the next sample."""
    HELD_ON_SLOPE = kernels.SHOWN_HELD_ON_SLOPE
    """Held with half of the last difference added (Ellis): what the force will be amid the interval."""


@dataclass(frozen=True, slots=True)
class Plane:
    """A plane that yields; stiffness and damping are assumed."""

    stiffness: float = 2000.0  # N/m
    damping: float = 2.0  # N s/m
    normal: tuple[float, float] = (0.0, 1.0)  # unit, towards the finger
    offset: float | None = None  # m, normal · tip where it touches; None: where the tip is at first

    def __post_init__(self) -> None:
        not_negative("stiffness", self.stiffness, "newtons a metre")
        not_negative("damping", self.damping, "newton seconds a metre")
        if not abs(np.hypot(*self.normal) - 1.0) <= 1e-9:
            raise ArgumentError(f"the normal of a plane is {self.normal!r}, expected length 1")


@dataclass(frozen=True, slots=True, eq=False)
class Pressing:
    """Result of a press; S instants, n links. Impulses are joint torques integrated over time."""

    finger: PlanarFinger
    times: np.ndarray  # (S,) s
    angles: np.ndarray  # (S, n) rad, of the joints
    rates: np.ndarray  # (S, n) rad/s
    force: np.ndarray  # (S,) N, shown to the tip along the normal
    contact_impulse: np.ndarray  # (n,) N m s, of that force
    damping_impulse: np.ndarray  # (n,) N m s, of D q'
    static_impulse: np.ndarray  # (n,) N m s, of P
    geometric_impulse: np.ndarray  # (n,) N m s, of 1/2 q'ᵀ (dM/dq) q'
    work: float  # J, of the force on the tip
    loss: float  # J, in the dampers

    def momentum_residual(self) -> np.ndarray:
        """Return what the momentum changed by beyond the impulses, (n,), N m s: the integrator's error."""
        before, after = (self.finger.momentum(self.angles[k], self.rates[k]) for k in (0, -1))
        forces = self.contact_impulse - self.damping_impulse - self.static_impulse
        return after - before - forces - self.geometric_impulse

    def energy_residual(self) -> float:
        """Return what the energy has changed by beyond work and loss, J: the integrator's error."""
        before, after = self._energy(0), self._energy(-1)
        return after - before - self.work + self.loss

    def energy_ratio(self) -> float:
        """Return the kinetic energy at the end over that at the start: above 1 the plane was active."""
        before, after = (self.finger.kinetic_energy(self.angles[k], self.rates[k]) for k in (0, -1))
        return after / before

    def _energy(self, k: int) -> float:
        kinetic = self.finger.kinetic_energy(self.angles[k], self.rates[k])
        return kinetic + self.finger.potential_energy(self.angles[k])


def press(
    finger: PlanarFinger,
    angles: ArrayLike,
    rates: ArrayLike,
    plane: Plane | None = None,
    *,
    duration: float = 0.030,
    step: float = 1e-6,
    shown: Shown = Shown.AT_ONCE,
    lag: float = 0.0,
) -> Pressing:
    """Let a finger move freely from *angles* and *rates* on, its tip against a plane.

    *step*: of the integrator, classical Runge-Kutta of fourth order. Where contact begins or ends amid a step
    the error is of that step. *lag*: by how much it is late, or how long it is held; whole steps. Not used
    where it is shown at once.
    """
    plane = Plane() if plane is None else plane
    positive("step", step, "seconds")
    steps = positive("duration", duration, "seconds") / step
    if not 0.5 < steps < MAX_STEPS + 0.5:
        raise ArgumentError(f"{duration:g} s in steps of {step:g} s are {steps:g}, expected 1 to {MAX_STEPS}")
    count = round(steps)
    n = len(finger.lengths)
    states = np.zeros((count + 1, (2 + kernels.INTEGRALS) * n + 2))
    states[0, :n], states[0, n : 2 * n] = _start("angles", angles, n), _start("rates", rates, n)
    forces = np.zeros(count + 1)
    chain = _chain(finger)
    table = np.array([plane.stiffness, plane.damping, *plane.normal, 0.0])
    # By the kernel's own sum, so that a tip at the plane is there to the bit.
    height = kernels.tip_height(chain, states[0], table)[0]
    table[kernels.PLANE_OFFSET] = height if plane.offset is None else plane.offset
    kernels.press(chain, table, int(shown), _steps(shown, lag, step), step, states, forces)
    if not np.isfinite(states[-1]).all():
        raise ArgumentError(f"the motion diverges in steps of {step:g} s, expected shorter ones")
    return _reported(finger, states, forces, step)


def _start(name: str, values: ArrayLike, n: int) -> np.ndarray:
    """Initial state of the links themselves."""
    array = np.asarray(values, np.float64)
    if array.shape != (n,) or not np.isfinite(array).all():
        raise ArgumentError(f"{name} are {array.tolist()}, expected {n} finite numbers, one per joint")
    return np.cumsum(array)


def _steps(shown: Shown, lag: float, step: float) -> int:
    if shown == Shown.AT_ONCE:
        return 1
    steps = lag / step
    if not (steps > 0.5 and abs(steps - round(steps)) <= WHOLE * max(1.0, steps)):
        raise ArgumentError(f"a lag of {lag:g} s, expected one or more whole steps of {step:g} s")
    return round(steps)


def _chain(finger: PlanarFinger) -> np.ndarray:
    """The finger as kernels take it."""
    rows = (
        finger.gravity * finger.moments(),
        finger.lengths,
        finger.stiffnesses,
        finger.rest_angles,
        finger.dampings,
    )
    return np.vstack([finger.coupling(), *rows])


def _reported(finger: PlanarFinger, states: np.ndarray, forces: np.ndarray, step: float) -> Pressing:
    """The states, reported in joints' angles."""
    n = len(finger.lengths)
    links = states[:, : 2 * n].reshape(-1, 2, n)
    joints = np.diff(links, axis=2, prepend=0.0)
    contact, damping, static, geometric = joint_torques(states[-1, 2 * n : -2].reshape(-1, n))
    return Pressing(
        finger=finger,
        times=step * np.arange(len(states)),
        angles=joints[:, 0],
        rates=joints[:, 1],
        force=forces,
        contact_impulse=contact,
        damping_impulse=damping,
        static_impulse=static,
        geometric_impulse=geometric,
        work=float(states[-1, -2]),
        loss=float(states[-1, -1]),
    )
