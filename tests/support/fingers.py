"""A finger followed by the motion kernels, pose after pose."""

import numpy as np

from proximity.kernels.tracking import motion

MS = 1_000_000  # ns
LIMITS = (motion.MAX_SPEED, motion.MAX_ACCELERATION)


class Finger:
    """One row between two others, which must stay as they are."""

    def __init__(self):
        self.reals = np.full((3, motion.MOTION_REALS), 7.0)
        self.ints = np.full((3, motion.MOTION_INTS), 7, dtype=np.int64)
        self.reals[1], self.ints[1] = 0.0, 0

    def see(self, t_ns, position, *, velocity=None, limits=LIMITS):
        """The bits that a pose gives."""
        x, y, z = (float(value) for value in position)
        if velocity is None:
            return motion.observe(self.reals, self.ints, 1, int(t_ns), x, y, z, *limits)
        vx, vy, vz = (float(value) for value in velocity)
        return motion.observe_with_velocity(self.reals, self.ints, 1, int(t_ns), x, y, z, vx, vy, vz, *limits)

    def see_all(self, times_ns, positions):
        return [self.see(t_ns, position) for t_ns, position in zip(times_ns, positions, strict=True)]

    def after(self, h, limits=LIMITS):
        """Displacement *h* seconds after the pose, and its bound."""
        *step, rho = motion.predict(self.reals, 1, float(h), *limits)
        return np.array(step), rho

    @property
    def velocity(self):
        return self.reals[1, motion.ESTIMATE_VELOCITY : motion.ESTIMATE_VELOCITY + 3]

    @property
    def velocity_error(self):
        return self.reals[1, motion.ESTIMATE_VELOCITY_ERROR]

    @property
    def state(self):
        return self.reals.tobytes() + self.ints.tobytes()
