"""Prediction of moving parts from their last reported pose, and how much it widens the bounds.

A part is reported where it was at an instant, and how fast it went. At another instant it is where its
velocities have taken it: the origin along a line, the part turned about its origin. A part of which nothing
more is reported is carried on for `HOLD_NS` and stands from then on, but nobody knows that it does.
"""

from collections.abc import KeysView, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from proximity.message import ContactFlag
from proximity.message.contact import BOUNDED_BIT, PREDICTED_BIT, TRACKED_BIT
from proximity.scene.scene import Scene
from proximity.system.time_units import NS_PER_S

HOLD_NS = NS_PER_S // 10
"""How long a part is believed to have the velocity that was given, unless it is reported again."""
NEVER = 2**63 - 1

_EXACT = np.uint32(ContactFlag.EXACT)
_CONTACT_FOUND = np.uint32(ContactFlag.CONTACT_FOUND)
_ROUNDED_DOWN, _ROUNDED_UP = 1.0 - 1e-12, 1.0 + 1e-12


class ReportedMotion(NamedTuple):
    """The last reported motion of a part."""

    matrix: np.ndarray  # (4, 4) float64, m, world_from_part at pose_ns
    velocity: np.ndarray  # (3,) float64, m/s, of its origin
    turning: np.ndarray  # (3,) float64, rad/s, about its origin
    pose_ns: int
    is_moving: bool = True  # False: both velocities are zero
    is_known: bool = True  # False: velocities were not given


def pose_at(reported: ReportedMotion, instant_ns: int) -> np.ndarray:
    """Where a part is at an instant, (4, 4); it is carried on for no longer than `HOLD_NS`."""
    matrix, off_ns = reported.matrix.copy(), min(instant_ns - reported.pose_ns, HOLD_NS)
    if reported.is_moving and off_ns:
        matrix[:3, 3] += 1e-9 * off_ns * reported.velocity
        rates = np.linalg.norm(reported.turning[None], axis=1)
        across, back = turns(matrix[None, :3, :3], reported.turning[None], rates)
        angle = 1e-9 * off_ns * rates[0]
        matrix[:3, :3] += np.sin(angle) * across[0] + (1.0 - np.cos(angle)) * back[0]
    return matrix


class VisibleParts:
    """Parts of a scene at one epoch: their names, which are hidden, and how far they reach."""

    epoch: int  # of the scene, when it was looked at

    def __init__(self, scene: Scene) -> None:
        model = scene.snapshot()
        self.epoch = model.epoch
        self._rows = {name: row for row, name in enumerate(model.names)}
        count = len(self._rows)
        self._is_hidden = model.parts["is_hidden"][:count] != 0
        corners = (
            model.frames["own_lower"][:count],
            model.frames["own_upper"][:count],
        )
        self._radii = np.linalg.norm(np.abs(corners).max(axis=0), axis=1)

    @property
    def names(self) -> KeysView[str]:
        """Names of the parts."""
        return self._rows.keys()

    def rows_of(self, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows of parts, whether they are hidden, and how far from their origins they reach, m, (M,) each."""
        rows = np.array([self._rows[name] for name in names], np.int64)
        return rows, self._is_hidden[rows], self._radii[rows]


class Carried:
    """Parts with velocities, at one instant after another; no more is reported of the *silent*."""

    names: list[str]
    is_silent: np.ndarray  # (M,) bool
    next_ns: int  # no other part falls silent before

    def __init__(
        self, reported: Mapping[str, ReportedMotion], silent: set[str], presence: VisibleParts
    ) -> None:
        self.names = list(reported)
        self.is_silent = np.array([name in silent for name in self.names])
        self._matrices = np.array([part.matrix for part in reported.values()])
        self._velocities = np.array([part.velocity for part in reported.values()])
        self._turning = np.array([part.turning for part in reported.values()])
        self._pose_ns = np.array([part.pose_ns for part in reported.values()], np.int64)
        self._ends_ns = self._pose_ns + HOLD_NS
        self._instants = self._pose_ns  # that the parts stand at
        self._is_known = False
        _, is_hidden, radii = presence.rows_of(self.names)
        self._is_found = ~is_hidden
        self._turn_rates: np.ndarray | None = None  # rad/s; None: no part turns
        self._top_speeds = np.linalg.norm(self._velocities, axis=1)  # m/s, of any point of each part
        if self._turning.any():
            self._turn_rates = np.linalg.norm(self._turning, axis=1)
            self._across, self._back = turns(self._matrices[:, :3, :3], self._turning, self._turn_rates)
            self._top_speeds += self._turn_rates * radii
        self._find_next()

    @property
    def is_late(self) -> bool:
        """Whether nothing more is reported of a part that questions find."""
        return bool((self.is_silent & self._is_found).any())

    def fall_silent(self, now_ns: int) -> list[str]:
        """Let parts stand whose motion was reported too long ago; the names of those that did not before."""
        is_over = (self._ends_ns <= now_ns) & ~self.is_silent
        self.is_silent |= is_over
        self._find_next()
        return [self.names[row] for row in np.flatnonzero(is_over)]

    def at(self, instant_ns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Matrices (M, 4, 4) and both velocities (M, 3) at an instant; None where all stand as they did."""
        if self._is_known:
            return None
        if self.is_silent.any():
            self._instants = np.where(self.is_silent, self._ends_ns, np.minimum(instant_ns, self._ends_ns))
        else:
            self._instants = np.minimum(instant_ns, self._ends_ns)
        seconds = 1e-9 * (self._instants - self._pose_ns)
        matrices = self._matrices.copy()
        matrices[:, :3, 3] += self._velocities * seconds[:, None]
        if self._turn_rates is not None:
            angles = (self._turn_rates * seconds)[:, None, None]
            matrices[:, :3, :3] += np.sin(angles) * self._across + (1.0 - np.cos(angles)) * self._back
        if not self.is_silent.any():
            return matrices, self._velocities, self._turning
        goes = ~self.is_silent[:, None]
        self._is_known = bool(self.is_silent.all())
        return matrices, self._velocities * goes, self._turning * goes

    def widen(self, contacts: np.ndarray, *, is_edited: bool = False) -> None:
        """Make contacts hold for parts that stand where they are at another instant than the finger's."""
        found = slice(None) if is_edited or self._is_found.all() else np.flatnonzero(self._is_found)
        instants, is_silent, speeds = self._instants[found], self.is_silent[found], self._top_speeds[found]
        pose_ns = contacts["pose_ns"]
        if (pose_ns[:, None] == instants).all() and not is_silent.any():
            return
        is_tracked = (contacts["flags"] & TRACKED_BIT) != 0
        off_ns = np.abs(np.where(is_tracked, pose_ns, 0)[:, None] - instants)
        off_ns[~is_tracked] = 0
        if not (off_ns.any() or is_silent.any()):
            return
        # A part that stands for the scene may go on: predictions do not know of it.
        lead_ns = np.where(is_tracked, contacts["predicted_ns"] - pose_ns, 0)[:, None] * is_silent
        error = 1e-9 * (off_ns * speeds).max(axis=1) * _ROUNDED_UP
        error_then = 1e-9 * ((off_ns + lead_ns) * speeds).max(axis=1) * _ROUNDED_UP
        contacts["lower"] -= error
        contacts["upper"] += error
        contacts["predicted_lower"] -= error_then
        contacts["predicted_upper"] += error_then
        _widen_the_rest(contacts, error_then > 0.0, speeds.max())

    def _find_next(self) -> None:
        self.next_ns = int(self._ends_ns[~self.is_silent].min(initial=NEVER))


def _widen_the_rest(contacts: np.ndarray, is_off: np.ndarray, fastest: float) -> None:
    """Promise no more of contacts than their widened bounds do, where those are wider."""
    flags = contacts["flags"]
    is_sure = is_off & ((flags & _EXACT) != 0)
    flags[is_sure] ^= _EXACT | BOUNDED_BIT
    flags[is_off] &= ~_CONTACT_FOUND
    contacts["contact_bend_error"][is_off] += np.inf  # what is nan stays so
    speed = np.linalg.norm(contacts["velocity"][is_off], axis=1) + fastest
    free = np.maximum(contacts["lower"][is_off], 0.0) * _ROUNDED_DOWN / speed
    free[(flags[is_off] & PREDICTED_BIT) == 0] = 0.0
    contacts["time_to_contact_lower"][is_off] = np.minimum(contacts["time_to_contact_lower"][is_off], free)


def turns(rotations: np.ndarray, turning: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Increments of rotations (M, 3, 3) that turn by an angle, twice (M, 3, 3).

    The sine of the angle times the first, and one less its cosine times the second (Rodrigues).
    """
    x, y, z = (turning / np.where(rates > 0.0, rates, 1.0)[:, None]).T
    cross = np.zeros((len(rates), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross -= cross.transpose(0, 2, 1)
    across = cross @ rotations
    return across, cross @ across
