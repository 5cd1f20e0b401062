"""NumPy version of the loop's handling of moving parts; its frames match bit for bit."""

import numpy as np

from proximity.message import ContactFlag
from proximity.service import TrackedContacts
from proximity.service.inputs.part_prediction import HOLD_NS, VisibleParts, turns

DOWN, UP = 1.0 - 1e-12, 1.0 + 1e-12
TRACKED, PREDICTED, EXACT, BOUNDED, FOUND = (
    np.uint32(ContactFlag[name]) for name in ("TRACKED", "PREDICTED", "EXACT", "BOUNDED", "CONTACT_FOUND")
)  # NumPy integers: operations with an IntFlag take ten times as long


class ContactsInPython(TrackedContacts):
    """Contacts of a tracker whose parts move by messages, computed by Python in every tick."""

    is_ticked_by_loop = False
    _moving = None

    def fill(self, contacts, samples, now_ns):
        scene = self.tracker.scene
        if self.changes is not None:
            self.changes.apply(scene)
        if self.moves is not None:
            moved, epoch = self.moves.take(scene, now_ns), scene.epoch
            if moved or self._moving is None or epoch != self._moving.epoch:
                self._moving = MovingParts(scene, self.moves.reported())
            self._moving.put(scene, now_ns, samples)
        super().fill(contacts, samples, now_ns)
        if self._moving is not None:
            self._moving.widen(contacts)

    @property
    def is_late(self):
        return self._moving is not None and bool((self._moving.is_silent & ~self._moving.is_hidden).any())


class MovingParts:
    """Parts with velocities, placed at successive times."""

    def __init__(self, scene, reported):
        visible = VisibleParts(scene)
        moving = {name: part for name, part in reported.items() if part.is_moving and name in visible.names}
        self.epoch, self._names, parts = scene.epoch, list(moving), list(moving.values())
        self._matrices = np.reshape([part.matrix for part in parts], (-1, 4, 4))
        self._velocities = np.reshape([part.velocity for part in parts], (-1, 3))
        self._turning = np.reshape([part.turning for part in parts], (-1, 3))
        self._pose_ns = np.array([part.pose_ns for part in parts], np.int64)
        self._ends_ns = self._pose_ns + HOLD_NS
        _, self.is_hidden, radii = visible.rows_of(self._names)
        self._turn_rates = np.linalg.norm(self._turning, axis=1)
        self._across, self._back = turns(self._matrices[:, :3, :3], self._turning, self._turn_rates)
        self._top_speeds = np.linalg.norm(self._velocities, axis=1) + self._turn_rates * radii
        self.is_silent, self._all_stand = np.zeros(len(parts), bool), not parts

    def put(self, scene, now_ns, samples):
        """Move parts to the newest pose time of the fingers; silent parts stay at their last pose."""
        if self._all_stand:
            return
        is_there = np.isfinite(samples.positions).all(axis=1)
        instant_ns = int(samples.pose_ns[is_there].max()) if is_there.any() else now_ns
        self.is_silent = self._ends_ns <= now_ns
        self._instants = np.minimum(instant_ns, self._ends_ns)
        self._instants[self.is_silent] = self._ends_ns[self.is_silent]
        seconds, matrices = 1e-9 * (self._instants - self._pose_ns), self._matrices.copy()
        matrices[:, :3, 3] += self._velocities * seconds[:, None]
        angles = (self._turn_rates * seconds)[:, None, None]
        matrices[:, :3, :3] += np.sin(angles) * self._across + (1.0 - np.cos(angles)) * self._back
        goes, self._all_stand = ~self.is_silent[:, None], bool(self.is_silent.all())
        scene.move_many(self._names, matrices, self._velocities * goes, self._turning * goes)

    def widen(self, contacts):
        """Widen bounds by the motion of parts between the finger's time and their own."""
        found = ~self.is_hidden
        if not found.any():
            return
        instants, is_silent, speeds = self._instants[found], self.is_silent[found], self._top_speeds[found]
        flags, pose_ns, then_ns = contacts["flags"], contacts["pose_ns"], contacts["predicted_ns"]
        is_tracked = (flags & TRACKED) != 0
        off_ns = np.abs(np.where(is_tracked, pose_ns, 0)[:, None] - instants) * is_tracked[:, None]
        lead_ns = np.where(is_tracked, then_ns - pose_ns, 0)[:, None] * is_silent
        error = 1e-9 * (off_ns * speeds).max(axis=1) * UP
        error_then = 1e-9 * ((off_ns + lead_ns) * speeds).max(axis=1) * UP
        for prefix, wider in (("", error), ("predicted_", error_then)):
            contacts[f"{prefix}lower"] -= wider
            contacts[f"{prefix}upper"] += wider
        is_off = error_then > 0.0
        flags[is_off & ((flags & EXACT) != 0)] ^= EXACT | BOUNDED
        flags[is_off] &= ~FOUND
        contacts["contact_bend_error"][is_off] += np.inf  # nan stays nan
        speed = np.linalg.norm(contacts["velocity"][is_off], axis=1) + speeds.max()
        free = np.maximum(contacts["lower"][is_off], 0.0) * DOWN / speed
        free[(flags[is_off] & PREDICTED) == 0] = 0.0
        contacts["time_to_contact_lower"][is_off] = np.minimum(
            contacts["time_to_contact_lower"][is_off], free
        )
