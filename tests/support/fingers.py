"""A finger tracked by the motion kernels, pose by pose."""

import numpy as np

from proximity.kernels.tracking import motion

MS = 1_000_000  # ns
LIMITS = (motion.MAX_SPEED, motion.MAX_ACCELERATION)


class Finger:
    """A motion row between two guard rows."""

    def __init__(self):
        self.motions = np.full((3, motion.ESTIMATES), 7, motion.ESTIMATE)
        self.motions[1] = 0

    def see(self, t_ns, position, *, velocity=None, limits=LIMITS):
        """Flags returned for a pose."""
        x, y, z = (float(value) for value in position)
        if velocity is None:
            return motion.observe(self.motions, 1, int(t_ns), x, y, z, *limits)
        vx, vy, vz = (float(value) for value in velocity)
        return motion.observe_with_velocity(self.motions, 1, int(t_ns), x, y, z, (vx, vy, vz), *limits)

    def see_all(self, times_ns, positions):
        return [self.see(t_ns, position) for t_ns, position in zip(times_ns, positions, strict=True)]

    def after(self, h, limits=LIMITS):
        """Predicted displacement *h* seconds after the pose, and its error bound."""
        *step, rho = motion.predict(self.motions[1, 0], float(h), *limits)
        return np.array(step), rho

    @property
    def velocity(self):
        return self.motions["velocity"][1, 0]

    @property
    def velocity_error(self):
        return self.motions["velocity_error"][1, 0]

    @property
    def state(self):
        return self.motions.tobytes()
