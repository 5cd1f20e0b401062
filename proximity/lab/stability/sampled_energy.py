"""Energy that a sampled wall adds to a mass that bounces off it once.

The wall is a spring whose force is held for a period, and late. Where in a period the mass enters is
chance: all entries are computed side by side. Between samples the motion is a parabola, so that nothing is
lost to integration.
"""

import math

import numpy as np

from proximity.checks import positive, whole
from proximity.lab.stability.sampled_laws import predicted_force


def bounce_energy_ratios(
    phase_step: float, *, delay_samples: int = 0, is_predicted: bool = False, entry_count: int = 100
) -> np.ndarray:
    """Return energy after a bounce over energy before, for entries spread over a period, (entry_count,).

    *phase_step*: natural frequency of mass and wall times the period: sqrt(K/m) T. *is_predicted*: whether
    each force is that of the slope predictor.
    """
    stiffness = positive("phase_step", phase_step, "radians") ** 2
    delay_samples = whole("delay_samples", delay_samples, 0)
    count = whole("entry_count", entry_count, 1)
    # From here on in units of the period, the mass, and the speed before the bounce.
    position = (np.arange(count) + 0.5) / count
    velocity = np.ones(count)
    waiting = [np.zeros(count)] * (delay_samples + 1)  # forces not yet shown, the oldest first
    while True:
        waiting.append(stiffness * np.maximum(position, 0.0))
        last, shown = waiting[0], waiting[1]
        force = predicted_force(shown, last) if is_predicted else shown
        del waiting[0]
        if (position <= 0.0).all() and not np.any(waiting) and not np.any(force):
            return velocity**2
        position = position + velocity - 0.5 * force
        velocity = velocity - force


def slow_energy_ratio(phase_step: float, delay_samples: int = 0) -> float:
    """Return what the energy's ratio tends to when sampling is fast: that of a negative damper.

    *phase_step*: natural frequency of mass and wall times the period.
    """
    return math.exp(math.pi * phase_step * (delay_samples + 0.5))
