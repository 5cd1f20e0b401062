"""Energy change of a stopping finger that is caused by an error of the displayed force.

The energy is a square of the momentum, so an impulse that is off by a share changes it by a linear and a
quadratic part of that share.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from proximity.checks import positive
from proximity.lab.multibody.finger_chain import PlanarFinger


@dataclass(frozen=True, slots=True)
class ImpulseLaw:
    """Kinetic energy of a finger from whose momentum a share of an impulse is taken: three coefficients."""

    energy: float  # J, with nothing taken
    linear: float  # J a share
    quadratic: float  # J a share squared

    def after(self, share: ArrayLike) -> np.ndarray:
        """Return the energy with so much of the impulse taken, (...), J.

        *share*: (...).
        """
        part = np.asarray(share, np.float64)
        return self.energy + part * (self.linear + part * self.quadratic)


def impulse_law(finger: PlanarFinger, angles: ArrayLike, rates: ArrayLike, impulse: ArrayLike) -> ImpulseLaw:
    """Return ``1/2 (p - s I)ᵀ M⁻¹ (p - s I)`` as a function of the share s."""
    blow, speed = np.asarray(impulse, np.float64), np.asarray(rates, np.float64)
    return ImpulseLaw(
        finger.kinetic_energy(angles, speed),
        float(-speed @ blow),  # p M⁻¹ is q'
        float(0.5 * blow @ np.linalg.solve(finger.mass_matrix(angles), blow)),
    )


def stopped_energy(force: float, damping: float, spring: float, mass: float) -> float:
    """Return the energy of a mass that these impulses stop, J: ``(I + C + K)² / (2 m)``, equation (22).

    *force*, *damping*, *spring*: time integrals I of the contact force, C of the damper's, K of the spring's:
    all decelerate.
    """
    return (force + damping + spring) ** 2 / (2.0 * positive("mass", mass, "kilograms"))
