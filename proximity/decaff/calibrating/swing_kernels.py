"""Kernel that swings a drum by given torques: alone, or against the cable of a finger that is held.

Angles are those of the drum; positive is away from the finger, as are torques.
"""

import numpy as np

from proximity.decaff.drum.drum_kernels import slid
from proximity.native import entry

SWING_INERTIA = 0  # kg m²
SWING_FRICTION = 1  # N m, Coulomb
SWING_VISCOUS = 2  # N m s
SWING_STIFFNESS = 3  # N m/rad, of what the drum presses on below angle 0; 0: nothing there
SWING_DAMPING = 4  # N m s, of the same
SWING_SIZE = 5


@entry("float64[:], float64[:], int, float, float64[:]")
def swing(plant: np.ndarray, torques: np.ndarray, steps: int, step: float, angles: np.ndarray) -> None:
    """Angles of a drum that starts at rest at 0; *torques* are means over each step, *steps* to an angle.

    Leapfrog: exact under a constant torque, and without damping of its own against a spring.
    """
    angle = speed = 0.0
    for i in range(angles.shape[0]):
        angles[i] = angle
        for j in range(i * steps, (i + 1) * steps):
            angle += 0.5 * step * speed
            reaction = min(0.0, plant[SWING_STIFFNESS] * angle + plant[SWING_DAMPING] * speed)
            if plant[SWING_STIFFNESS] <= 0.0 or angle > 0.0:
                reaction = 0.0
            torque = torques[j] - plant[SWING_VISCOUS] * speed - reaction
            speed = slid(speed, torque, plant[SWING_FRICTION], plant[SWING_INERTIA], step)
            angle += 0.5 * step * speed
