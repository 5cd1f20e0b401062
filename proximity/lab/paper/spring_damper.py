"""A spring beside a damper, and two such in series: equation (8) of the paper, and the exact solution."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from proximity.checks import not_negative


@dataclass(frozen=True, slots=True)
class SpringDamper:
    """A spring and a damper side by side, with the mass that moves with them."""

    stiffness: float  # N/m; inf: rigid
    damping: float  # N·s/m; inf: rigid
    mass: float = 0.0  # kg

    def __post_init__(self) -> None:
        not_negative("stiffness", self.stiffness, "newtons a metre", may_be_infinite=True)
        not_negative("damping", self.damping, "newton seconds a metre", may_be_infinite=True)
        not_negative("mass", self.mass, "kilograms")

    @property
    def damping_ratio(self) -> float:
        """Damping over the critical one; inf without mass or spring."""
        critical = 2.0 * math.sqrt(self.stiffness * self.mass)
        return self.damping / critical if critical > 0.0 else math.inf

    def dynamic_stiffness(self, s: ArrayLike) -> np.ndarray:
        """Return force over displacement without the mass, N/m, complex."""
        return self.stiffness + self.damping * np.asarray(s, np.complex128)


FINGER = SpringDamper(stiffness=200.0, damping=6.0, mass=0.010)
"""The paper's pad; its mass is assumed."""
RIGID = SpringDamper(math.inf, math.inf)


def in_series(first: SpringDamper, second: SpringDamper) -> SpringDamper:
    """Return the one spring-damper that the paper puts for two in a row, equation (8); mass of the first.

    It is exact only where damping over stiffness is the same in both: the stiffness is right when slow, the
    damping when fast. See `series_stiffness`.
    """
    return SpringDamper(
        _harmonic(first.stiffness, second.stiffness), _harmonic(first.damping, second.damping), first.mass
    )


def series_stiffness(first: SpringDamper, second: SpringDamper, s: ArrayLike) -> np.ndarray:
    """Return force over displacement of two spring-dampers in a row, exactly, N/m, complex."""
    one, other = first.dynamic_stiffness(s), second.dynamic_stiffness(s)
    return one * other / (one + other)


def slow_series_damping(first: SpringDamper, second: SpringDamper) -> float:
    """Return the damping of two spring-dampers in a row when they move slowly, N·s/m; (8) gives another."""
    weighted = first.damping * second.stiffness**2 + second.damping * first.stiffness**2
    return weighted / (first.stiffness + second.stiffness) ** 2


def _harmonic(one: float, other: float) -> float:
    return 0.0 if one == 0.0 or other == 0.0 else 1.0 / (1.0 / one + 1.0 / other)
