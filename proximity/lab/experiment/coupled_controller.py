"""Coupled wall on a contact drum: what DECAFF is compared with, displayed by the same device.

The drum waits at the surface, as for any deformable part; from the touch on it presses with a spring and a
damper on positions that are some latency old, whether or not that is passive. What a traditional device has
beside, its motor that the finger carries in free motion, is missing. Frames, faults, limits and the emergency
stop are the drum controller's own.
"""

import math
from collections import deque
from dataclasses import replace

from proximity.decaff.controller.controller import FingerController
from proximity.decaff.controller.controller_states import DrumAction, Observation, Trust
from proximity.decaff.controller.drum_limits import Limits
from proximity.decaff.drum.drum_command import DriveMode
from proximity.decaff.glove.finger_path import FingerPath
from proximity.system.time_units import S_PER_NS


class CoupledController(FingerController):
    """A controller whose deformable surfaces answer late, with gains of their own.

    *damping*: of the wall, on the difference of two samples.
    """

    def __init__(
        self,
        path: FingerPath,
        rate: float,
        limits: Limits,
        *,
        stiffness: float,
        damping: float,
        latency: float,
    ) -> None:
        super().__init__(path, rate, limits=limits)
        self._stiffness, self._damping, self._latency_ns = stiffness, damping, round(latency / S_PER_NS)
        self._depths: deque[tuple[int, float]] = deque()  # ns of the sample, m past the surface
        self._served = 0.0  # N, of the last sample

    def step(self, seen: Observation) -> DrumAction:
        """Return what the drum shall do: where its own law would be served, the wall's force."""
        action = super().step(seen)
        if action.mode is DriveMode.FORCE:
            force = min(self._wall_force(seen.sample_ns), self._limits.continuous_force, action.force_cap)
            # Where it is uncertain no force grows.
            self._served = force if self.trust is Trust.FRESH else min(force, self._served)
            action = replace(action, force=self._served, torque=self._drum.motor_torque(self._served))
        known = self.known
        if math.isfinite(known.finger) and math.isfinite(known.target):
            self._depths.append((seen.sample_ns, float(known.finger - known.target)))
        return action

    def _wall_force(self, sample_ns: int) -> float:
        depths, known_ns = self._depths, sample_ns - self._latency_ns
        while len(depths) > 2 and depths[2][0] <= known_ns:
            depths.popleft()
        if len(depths) < 2 or depths[1][0] > known_ns:
            return 0.0
        (before_ns, before), (at_ns, depth) = depths[0], depths[1]
        if not depth > 0.0:
            return 0.0
        speed = (depth - before) / (S_PER_NS * (at_ns - before_ns))
        incidence = float(self.frames.location.incidence) if self.frames.has_location else 1.0
        return max(0.0, incidence**2 * (self._stiffness * depth + self._damping * speed))
