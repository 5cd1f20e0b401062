"""An operator who draws back from the force: FIG 5f, and the gain at which that becomes unstable.

Position follows the plan less a gain times the last force; the force follows from positions by differences.
The paper shows the growth and gives no gain.
"""

from dataclasses import dataclass

import numpy as np

from proximity.checks import not_negative, positive
from proximity.lab.paper.trajectories import Press
from proximity.lab.paper.walls import SpringDamper


@dataclass(frozen=True, slots=True, eq=False)
class Reaction:
    """Motion and force of an operator; N steps."""

    times: np.ndarray  # (N,) s
    position: np.ndarray  # (N,) m, positive into the wall
    force: np.ndarray  # (N,) N


def critical_gain(finger: SpringDamper, step: float) -> float:
    """Return the gain above which an operator who reacts one step late is unstable, m/N."""
    now, last, before = _weights(finger, positive("step", step, "seconds"))
    return 1.0 / (now - last + before)


def growth(finger: SpringDamper, gain: float, step: float) -> float:
    """Return by how much a disturbance grows in a step, while the finger stays in contact."""
    weights = _weights(finger, positive("step", step, "seconds"))
    return float(np.abs(np.roots([1.0, *(gain * weight for weight in weights)])).max())


def react(
    press: Press, finger: SpringDamper, gain: float, step: float, *, end: float, can_pull: bool = False
) -> Reaction:
    """Return what happens when the operator draws back from the force that was felt a step ago."""
    step, gain = positive("step", step, "seconds"), not_negative("gain", gain, "metres a newton")
    times = np.arange(int(end / step * (1.0 + 1e-12)) + 1) * step
    now, last, before = _weights(finger, step)
    planned = press.at(times).position.tolist()
    positions, forces = press.at([-2.0 * step, -step]).position.tolist(), [0.0]
    is_held = False
    for plan in planned:
        position = plan - gain * forces[-1]
        force = now * position + last * positions[-1] + before * positions[-2]
        is_held = is_held or (can_pull and position > 0.0)
        is_felt = is_held or (position > 0.0 and force > 0.0)
        positions.append(position)
        forces.append(force if is_felt else 0.0)
    return Reaction(times, np.array(positions[2:]), np.array(forces[1:]))


def _weights(finger: SpringDamper, step: float) -> tuple[float, float, float]:
    """Weights of the present, the last and the position before it, in the force by backward differences."""
    damping, inertia = finger.damping / step, finger.mass / step**2
    return finger.stiffness + damping + inertia, -damping - 2.0 * inertia, inertia
