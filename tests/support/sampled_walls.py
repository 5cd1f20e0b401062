"""Stability of sampled walls by roots, and by a second discretisation, SciPy's."""

import numpy as np
from scipy.signal import cont2discrete

from proximity.decaff.drum.sampled_mass import characteristic, maximum_stiffness, spectral_radius


def is_stable(device, stiffness, damping):
    """Test whether disturbances decay, by the roots."""
    return spectral_radius(characteristic(device, stiffness, damping)) < 1.0


def stiffness_limit(device, damping):
    """Largest stable stiffness for wall dampings (...), N/m, by bisection; 0 if none is stable."""
    damping = np.asarray(damping, np.float64)
    low, high = np.zeros(damping.shape), np.full(damping.shape, 1.1 * maximum_stiffness(device).stiffness)
    for _ in range(60):
        middle = 0.5 * (low + high)
        stable = is_stable(device, middle, damping)
        low, high = np.where(stable, middle, low), np.where(stable, high, middle)
    return low


def stepped(mass, period, delay_samples, damping, stiffness, wall_stiffness, wall_damping):
    """State matrices of the sampled loop by SciPy's discretisation, stacked over the walls.

    *damping* and *stiffness* are the mass's own.
    """
    motion = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
    a, b = cont2discrete((motion, np.array([[0.0], [1.0 / mass]]), np.eye(2), np.zeros((2, 1))), period)[:2]
    # State: position, speed, past positions. The force comes from positions d and d + 1 samples ago.
    loop = np.zeros((*np.shape(wall_stiffness), delay_samples + 3, delay_samples + 3))
    loop[..., :2, :2] = a
    loop[..., 2, 0] = 1.0
    loop[..., range(3, delay_samples + 3), range(2, delay_samples + 2)] = 1.0
    now = 0 if delay_samples == 0 else delay_samples + 1
    difference = np.asarray(wall_damping) / period
    for column, gain in ((now, wall_stiffness + difference), (delay_samples + 2, -difference)):
        loop[..., :2, column] -= np.asarray(gain)[..., None] * b[:, 0]
    return loop


def stepped_radius(*numbers):
    """Spectral radius of `stepped`; below one, disturbances decay."""
    *own, stiffness, damping = numbers
    return np.abs(np.linalg.eigvals(stepped(*own, *np.broadcast_arrays(stiffness, damping)))).max(axis=-1)
