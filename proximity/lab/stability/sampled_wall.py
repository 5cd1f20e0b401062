"""Stable stiffness and damping of the sampled wall of equation (1) on a free mass.

A mass feels a force that is held for a period and was computed from positions some samples old; the damping
is from the difference of two of them. Equation (1) itself has one sample of delay. The same formulas bound
a position servo, as that of the drum: a servo is such a wall.

With a = k T²/2m and b = B T/2m the characteristic polynomial is z^(d+1) (z-1)² + (z+1) ((a+b) z - b). It
has roots at exp(±2jh) for a = 2 tan²h cos((2d+2)h), b = tan h sin((2d+2)h) - a/2; the stable region is what
this curve and a = 0 enclose for h from 0 to pi/(4(d+1)).
"""

import math
from enum import StrEnum

import numpy as np

from proximity.checks import finite, positive, whole
from proximity.decaff.drum.sampled_mass import (
    Gains,
    SampledMass,
    damping_window,
    edge_at,
    root_between,
)


class Verdict(StrEnum):
    """Why a sampled wall is stable or not: what Love and Book say destabilises it."""

    STABLE = "stable"
    TOO_STIFF = "too stiff for any damping"
    TOO_LITTLE_DAMPING = "too little damping"
    TOO_MUCH_DAMPING = "too much damping"


def boundary(device: SampledMass, count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Return the edge of the stable region: stiffness (count,), N/m, and damping (count,), N·s/m.

    *count*: how many points, from no stiffness and no damping to no stiffness and the largest damping.
    """
    half_angle = np.linspace(0.0, device.last_half_angle, whole("count", count, 2))
    a, b = edge_at(device, half_angle)
    return a * device.stiffness_unit, b * device.damping_unit


def largest_damping(device: SampledMass) -> float:
    """Return the largest damping of a stable wall, of a stiffness near zero, N·s/m."""
    return math.tan(device.last_half_angle) * device.damping_unit


def verdict(device: SampledMass, gains: Gains) -> Verdict:
    """Return whether a wall is stable, and if not, what is wrong with it."""
    low, high = damping_window(device, gains.stiffness)
    damping = finite("damping", gains.damping, "newton seconds a metre")
    if math.isnan(low):
        return Verdict.TOO_STIFF
    if damping <= low:
        return Verdict.TOO_LITTLE_DAMPING
    return Verdict.TOO_MUCH_DAMPING if damping >= high else Verdict.STABLE


def slowest_period(mass: float, gains: Gains, delay_samples: int = 1) -> float:
    """Return the period up to which a wall is stable, s: with any damping, sampling faster restores it."""
    stiffness = positive("stiffness", gains.stiffness, "newtons a metre")
    damping = positive("damping", gains.damping, "newton seconds a metre")
    device = SampledMass(mass, 1.0, delay_samples)
    # a/b² does not depend on the period; along the edge it falls from infinity to zero.
    ratio = 2.0 * mass * stiffness / damping**2

    # From near its start, where a = 2h² and b = (2d+1)h².
    start = min(0.1 * math.sqrt(2.0 / ratio) / (2 * delay_samples + 1), 0.1 * device.last_half_angle)

    def left(half_angle: float) -> float:
        a, b = edge_at(device, half_angle)
        return float(a - ratio * b**2)

    b = edge_at(device, root_between(left, start, device.last_half_angle))[1]
    return float(b) * 2.0 * mass / damping
