"""Limits of a drum's controller: speeds, forces, and how long a frame is trusted (docs/guide/drums.md)."""

import math
from dataclasses import dataclass, fields

from proximity.checks import positive
from proximity.system.time_units import NS_PER_MS

TOUCH_GAP = 30e-6  # m, of finger or link and drum: nearer is touching; assumed
RELEASE_GAP = 1e-3  # m, farther is released; assumed


@dataclass(frozen=True, slots=True)
class Limits:
    """Ages, speeds, forces and lengths, all by our own rules: the paper gives none."""

    fresh_ns: int = 20 * NS_PER_MS  # of a pose: younger, all is normal
    stale_ns: int = 100 * NS_PER_MS  # older, nothing is known
    future_ns: int = 5 * NS_PER_MS  # in the future: farther, the frame is wrong
    freeze_ns: int = 250 * NS_PER_MS  # in contact, nothing known: so long nothing changes
    ramp_ns: int = 250 * NS_PER_MS  # then the force limit goes to nothing
    watchdog_ns: int = 10 * NS_PER_MS  # between two samples of the servo
    touch_gap: float = TOUCH_GAP  # m
    release_gap: float = RELEASE_GAP  # m
    touch_force: float = 0.05  # N
    gone_force: float = 0.1  # N: with less, a drum that froze retracts
    standoff: float = 5e-3  # m, from a finger that began inside; assumed
    max_speed: float = 3.0  # m/s, of whatever moves: a contact that comes nearer faster is a jump
    object_speed: float = 0.5  # m/s, v_obj_max of old frames; assumed
    speed_error: float = 0.05  # eps of old frames, times the finger's speed; assumed
    late_speed: float = 0.05  # m/s, of a drum that comes late
    late_force: float = 1.0  # N
    late_gap: float = 0.3e-3  # m, that counts as being there; assumed
    near_gap: float = 2e-3  # m: nearer, the energy of a bump is limited
    near_energy: float = 1e-3  # J
    continuous_force: float = 10.0  # N, at the fingertip
    peak_force: float = 20.0  # N
    force_time: float = 1.0  # s, over which a force is continuous; assumed
    follow_speed: float = 1e-3  # m/s: slower, a part that is touched is at rest; assumed

    def __post_init__(self) -> None:
        for field in fields(self):
            positive(field.name, getattr(self, field.name), _unit(field.name))

    def near_speed(self, mass: float) -> float:
        """Return how fast drum and finger may come together, m/s."""
        return math.sqrt(2.0 * self.near_energy / mass)


def _unit(name: str) -> str:
    for ending, unit in (
        ("_ns", "nanoseconds"),
        ("_gap", "metres"),
        ("_force", "newtons"),
        ("_speed", "metres a second"),
        ("_energy", "joules"),
        ("_time", "seconds"),
        ("_error", "shares"),
    ):
        if name.endswith(ending):
            return unit
    return "metres"
