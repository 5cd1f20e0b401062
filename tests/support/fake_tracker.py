"""A tracker by formulas, for tests of recordings: exact distances from the scene, simple predictions.

*spoil* is called with the contacts and the number of each tick, and may change them.
"""

import numpy as np

from proximity.message import CONTACT, ContactFlag


class FakeTracker:
    """Exact within the working range, skipped beyond; the velocity is the difference of two poses."""

    def __init__(
        self,
        scene,
        *,
        fingers=5,
        radius=0.007,
        period=0.001,
        latency=0.001,
        budget=None,
        working_range=0.12,
        spoil=None,
    ):
        self.scene, self.radius, self.latency, self.working_range = scene, radius, latency, working_range
        self.settings = {"fingers": fingers, "period": period, "budget": budget}
        self.contacts = np.zeros(fingers, dtype=CONTACT)
        self.spoil = spoil
        self.last = np.full((fingers, 3), np.nan)
        self.last_ns = 0
        self.ticks = []

    def tick(self, positions, t_pose_ns, now_ns):
        assert positions.shape == self.last.shape and positions.flags.carray
        self.ticks.append((t_pose_ns, now_ns))
        found = self.contacts
        found[...] = np.zeros((), dtype=CONTACT)
        found["finger"] = np.arange(len(found))
        found["pose_ns"], found["age_ns"] = t_pose_ns, now_ns - t_pose_ns
        found["position"] = positions
        is_tracked = np.isfinite(positions).all(axis=1)
        hits = self.scene.closest(positions)
        distance = hits.signed_distance - self.radius
        is_near = is_tracked & (distance <= self.working_range)
        is_far = is_tracked & ~is_near
        for name in ("signed_distance", "lower", "upper"):
            found[name] = np.where(is_tracked, distance, np.nan)
        found["lower"] -= np.where(is_far, 0.01, 0.0)
        found["lower"][~is_tracked], found["upper"][~is_tracked] = -np.inf, np.inf
        found["part"] = hits.part
        seconds = max(t_pose_ns - self.last_ns, 1) * 1e-9
        velocity = (positions - self.last) / seconds
        is_predicted = np.isfinite(velocity).all(axis=1)
        found["velocity"] = velocity
        found["predicted_ns"] = now_ns + round(self.latency * 1e9)
        ahead = positions + velocity * (found["predicted_ns"][0] - t_pose_ns) * 1e-9
        predicted = self.scene.closest(ahead).signed_distance - self.radius
        found["predicted_distance"] = predicted
        found["predicted_lower"], found["predicted_upper"] = predicted - 0.001, predicted + 0.001
        speed = np.linalg.norm(velocity, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            found["time_to_contact_lower"] = np.where(distance <= 0.0, 0.0, distance / speed)
        found["flags"] = (
            is_tracked * int(ContactFlag.TRACKED)
            + is_near * int(ContactFlag.EXACT | ContactFlag.IN_RANGE)
            + is_far * int(ContactFlag.SKIPPED)
            + is_predicted * int(ContactFlag.PREDICTED)
        )
        if self.spoil is not None:
            self.spoil(found, len(self.ticks))
        self.last, self.last_ns = positions.copy(), t_pose_ns
        return found
