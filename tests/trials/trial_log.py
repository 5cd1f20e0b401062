"""Log of a tracker trial, and the tally of the guarantees checked.

Only rounding is allowed. A distance has a relative error of `DISTANCE_ROUNDING`. The point and the surface
point are translated and rotated, which adds about eight roundings of the largest coordinate, each at most
half of 2^-52: `COORDINATE_ROUNDING` in total.
"""

from dataclasses import dataclass, field

import numpy as np
from ticking import steps_for_all

from proximity.message import ContactFlag

DISTANCE_ROUNDING = 1e-14
COORDINATE_ROUNDING = 4.0 * 2.0**-52
OURS = {name: np.uint32(flag) for name, flag in ContactFlag.__members__.items()}
SHOWN = 3  # violations of one guarantee per trial that are described in full
TOLD = (
    "flags", "lower", "signed_distance", "upper", "predicted_lower", "predicted_upper",
    "time_to_contact_lower", "time_to_contact", "bend", "bend_rate", "contact_bend", "contact_bend_error",
    "part", "face", "work", "velocity",
)  # fmt: skip


@dataclass(eq=False)
class Log:
    """Data of a trial, a row per finger and tick."""

    history: object
    course: object
    ticks: np.ndarray  # (M,)
    fingers: np.ndarray  # (M,)
    positions: np.ndarray  # (M, 3) m
    records: np.ndarray  # (M,) CONTACT
    true: np.ndarray  # (M,) m, signed distance of the centre
    adaptive_tolerance: np.ndarray  # (M,) relative width allowed between bounds for many fingers
    is_exact: np.ndarray  # (M,) predictions can be compared with the course
    start_ns: int
    paths: np.ndarray | None  # (M, K, 3)
    path_bends: np.ndarray | None  # (K,)
    radii: np.ndarray | None = None  # (M,) m
    working_range: float = 0.0
    tolerance: float = 0.0
    budget: int = 0
    max_speed: float = 0.0

    def has(self, *names):
        bits = np.uint32(sum(int(OURS[name]) for name in names))
        return (self.records["flags"] & bits) == bits

    def gap(self, rows, points, seconds, *, to_touch=True):
        """Clearance of the spheres of some rows if at *points*, *seconds* after their ticks."""
        distance = self.history.signed_distance(points, self.ticks[rows], seconds, to_touch=to_touch)
        return distance - self.radii[rows]

    def crowd_is_spent(self):
        """Test, per row, whether the fingers of its tick used up their common steps."""
        work = np.bincount(self.ticks, weights=self.records["work"])
        counts = np.bincount(self.ticks)
        steps = np.array([steps_for_all(self.budget, count) for count in counts])
        return (work >= steps)[self.ticks]

    def describe(self, row):
        """Format a row as text."""
        fields = ", ".join(f"{key} {self.records[key][row]!s}" for key in TOLD)
        return (
            f"tick {self.ticks[row]}, finger {self.fingers[row]} at {self.positions[row].tolist()}: "
            f"true {self.true[row] - self.radii[row]:.17g}; {fields}"
        )

    def room(self, lengths, points=None):
        """Allowed rounding error of a distance, m."""
        points = self.positions if points is None else points
        largest = np.nan_to_num(np.abs(points).max(axis=-1), posinf=0.0) + self.history.extent
        return DISTANCE_ROUNDING * np.abs(np.nan_to_num(lengths)) + COORDINATE_ROUNDING * largest


@dataclass
class Check:
    """Statistics of one guarantee: number of checks, violations, and the smallest margin."""

    count: int = 0
    broken_count: int = 0
    worst: float = -np.inf  # excess in allowances: at most 1
    closest: float = np.inf  # smallest margin above one allowance
    is_length: bool = True  # False: a yes-or-no condition


@dataclass
class Tally:
    """Checks by name, and the first violations."""

    checks: dict = field(default_factory=dict)
    broken: list = field(default_factory=list)

    def look(self, name, log, excess, allowance, rows=None, *, is_length=True):
        """Check *excess* <= *allowance* for each of *rows* (default all; a mask or row numbers)."""
        rows = np.arange(len(log.ticks)) if rows is None else rows
        rows = np.flatnonzero(rows) if rows.dtype == bool else rows
        excess, allowance = (
            np.broadcast_to(np.asarray(each, float), len(rows)) for each in (excess, allowance)
        )
        check = self.checks.setdefault(name, Check(is_length=is_length))
        check.count += len(rows)
        if not len(rows):
            return
        is_broken = ~(excess <= allowance)  # nan counts as broken
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(allowance > 0.0, excess / allowance, np.where(excess > 0.0, np.inf, -np.inf))
        check.worst = max(check.worst, float(np.nanmax(ratio, initial=-np.inf)))
        left = -excess[excess < -allowance]
        check.closest = min(check.closest, float(left.min(initial=np.inf)))
        check.broken_count += int(is_broken.sum())
        for place in np.flatnonzero(is_broken)[:SHOWN]:
            row = rows[place]
            self.broken.append(f"{name}: {log.describe(row)}; {excess[place]:.9g} > {allowance[place]:.3g}")

    def demand(self, name, log, is_so, rows=None):
        """Check a yes-or-no condition."""
        self.look(name, log, np.where(is_so, -1.0, 1.0), 0.0, rows, is_length=False)

    def add(self, other):
        """Add the tally of another trial."""
        for name, check in other.checks.items():
            own = self.checks.setdefault(name, Check(is_length=check.is_length))
            own.count += check.count
            own.broken_count += check.broken_count
            own.worst, own.closest = max(own.worst, check.worst), min(own.closest, check.closest)
        self.broken += other.broken
