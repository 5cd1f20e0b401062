"""Contacts of a tracked part: its nearest connections to other parts, at the instant of its newest pose.

`MovesInput` reads the poses for the scene. They are also applied to a copy of the scene's frames, so that all
parts have one instant, independently of the fingers' loop.
"""

import weakref
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np

from proximity.kernels.entries import move_parts, velocities_between
from proximity.kernels.layout import NO_PART
from proximity.message import CONTACT, ContactFlag, Mode, Source, Surface
from proximity.pose import ROUNDING
from proximity.scene.model.assembly import Model, finished
from proximity.scene.scene import Scene
from proximity.service.description import PartLabels
from proximity.service.inputs.part_prediction import HOLD_NS, ReportedMotion, pose_at
from proximity.service.samples import FingerPoses, Samples
from proximity.tracker.part_tracker import CONNECTION, ConnectionFlag, PartTracker, follow
from proximity.transport import forget

SAME = [name for name in CONTACT.names or () if name in (CONNECTION.names or ()) and name != "flags"]
"""Fields that a contact shares with a connection."""
# As NumPy numbers: an operation with an IntFlag takes ten times as long.
ALWAYS, EXACT, BOUNDED, INSIDE, CROSSING = (
    np.uint32(flag)
    for flag in (
        ContactFlag.TRACKED | ContactFlag.SIGNED, ContactFlag.EXACT, ContactFlag.BOUNDED, ContactFlag.INSIDE,
        ConnectionFlag.CROSSING,
    )
)  # fmt: skip
RETRACT, POSITION, FORCE, DEFORMABLE = map(int, (Mode.RETRACT, Mode.POSITION, Mode.FORCE, Surface.DEFORMABLE))
SAME_FLAGS = np.uint32(
    ContactFlag.PREDICTED | ContactFlag.EXACT | ContactFlag.SKIPPED | ContactFlag.IN_RANGE
    | ContactFlag.INSIDE | ContactFlag.PART_CHANGED
)  # fmt: skip
ROUNDED_UP = 1.0 + 1e-12


class HeldContacts:
    """Connections of a part, or of several that move as one, as contacts.

    *scene*: returns the scene served at present. *reported*: returns the last motions of parts, those of
    *parts* among them; the newest pose of the first one counts. *deforming*: entered while shapes must not
    change. *options*: of a `PartTracker`.

    Notes
    -----
    A record is a connection: ``finger`` is its number, ``point_on_finger`` is on the tracked part, and
    ``position`` and ``velocity`` are the origin of the tracked part and the velocity at that point. Without a
    pose for 100 ms the part is not TRACKED.
    """

    source = Source.HELD
    is_ticked_by_loop = False
    refused = 0, 0, 0

    def __init__(
        self,
        scene: Callable[[], Scene],
        reported: Callable[[], dict[str, ReportedMotion]],
        parts: Sequence[str],
        *,
        deforming: AbstractContextManager[Any] | None = None,
        **options: Any,
    ) -> None:
        self._scene, self._reported, self.parts, self._options = scene, reported, tuple(parts), options
        self._deforming = nullcontext() if deforming is None else deforming
        self._tracker = PartTracker(scene(), self.parts, **options)
        self.count = len(self._tracker.connections)
        unknown = np.zeros(self.count, CONTACT)
        forget(unknown)
        unknown["finger"], unknown["source"] = np.arange(self.count), self.source
        unknown["force"] = unknown["stiffness"] = unknown["damping"] = 0.0
        self._unknown = unknown.view(np.uint8)
        self.notes: list[str] = []
        self.epoch = 0
        self.is_late = False
        self._model: Model | None = None
        self._snapshot: Callable[[], Model | None] = lambda: None  # from which it was made
        self._is_gone = False
        self._leader: ReportedMotion | None = None  # the newest motion of the first part
        self._velocities: tuple[np.ndarray, np.ndarray] | None = None  # of it; None: not known

    def labels(self) -> PartLabels:
        """Return names of the scene's parts, and which are hidden."""
        model = self._model or self._scene().snapshot()
        return model.names, model.parts["is_hidden"][: len(model.names)] != 0

    def new_samples(self) -> Samples:
        """Return empty samples: poses come with the moves."""
        return FingerPoses(0)

    def rehearse(self) -> None:
        """Find all connections at the part's present pose; the tracker is reset afterwards."""
        self._tracker.tick(None, 0, 0)
        self._tracker.reset()

    def fill(self, contacts: np.ndarray, samples: Any, now_ns: int) -> None:
        """Write the connections at the instant of the newest pose, with all parts at that instant."""
        contacts.view(np.uint8)[:] = self._unknown
        motions, scene = self._reported(), self._scene()
        leader = motions.get(self.parts[0])
        is_held = leader is not None and now_ns - leader.pose_ns <= HOLD_NS
        if not self._has_parts(scene) or leader is None or not is_held:
            self.is_late = False
            return
        is_same = leader is self._leader
        self._follow_leader(leader)
        with self._deforming:
            snapshot = scene.snapshot()
            if self._model is None or snapshot.epoch != self._model.epoch or scene is not self._tracker.scene:
                self._renew(scene)
            if self._model is None or not is_same or self._snapshot() is not snapshot:
                self._model = self._placed(snapshot, motions, leader)
                self._snapshot = weakref.ref(snapshot)
            found = follow(self._tracker, self._model, leader.pose_ns, now_ns, self._velocities is not None)
        self._write(contacts, found, self._model)
        self._widen(contacts, motions, now_ns)

    def close(self) -> None:
        """No-op."""

    def _has_parts(self, scene: Scene) -> bool:
        """Return whether all parts are in the scene; their first absence is noted."""
        names = scene.snapshot().names
        gone = [name for name in self.parts if name not in names]
        if gone and not self._is_gone:
            self.notes.append(f"the held part {gone[0]!r} was removed: its contacts are now unknown")
        self._is_gone = bool(gone)
        return not gone

    def _renew(self, scene: Scene) -> None:
        """Switch to a scene with other parts or faces."""
        self.epoch += 1
        if scene is not self._tracker.scene:
            self._tracker = PartTracker(scene, self.parts, **self._options)

    def _follow_leader(self, leader: ReportedMotion) -> None:
        """Update the velocities of the first part: the reported ones, or from its last two poses."""
        if leader is self._leader:
            return
        before, self._leader = self._leader, leader
        if leader.is_known:
            self._velocities = leader.velocity, leader.turning
        elif before is not None:
            found, elapsed_ns = np.empty((2, 3)), leader.pose_ns - before.pose_ns
            is_known = velocities_between(before.matrix, leader.matrix, elapsed_ns, found)
            self._velocities = (found[0], found[1]) if is_known else None

    def _placed(self, model: Model, motions: dict[str, ReportedMotion], leader: ReportedMotion) -> Model:
        """Return the model with all moving parts at the instant of the leader's pose."""
        frames, parts = model.frames.copy(), model.parts.copy()
        names = [
            name
            for name in model.names
            if name in motions and (name in self.parts or motions[name].is_moving)
        ]
        matrices = np.array([pose_at(motions[name], leader.pose_ns) for name in names])
        velocities = np.array([motions[name].velocity for name in names])
        turning = np.array([motions[name].turning for name in names])
        own = np.array([name in self.parts for name in names])
        linear, angular = self._velocities or (np.zeros(3), np.zeros(3))
        velocities[own] = linear + _cross(angular, matrices[own, :3, 3] - leader.matrix[:3, 3])
        turning[own] = angular
        rows = np.array([model.names.index(name) for name in names])
        move_parts(
            frames, parts, np.zeros(len(parts), np.int64), 0, rows, matrices, velocities, turning,
            2.0 * ROUNDING,
        )  # fmt: skip
        return finished(model.reals, model.words, frames, parts, model.epoch, model.names)

    def _write(self, contacts: np.ndarray, found: np.ndarray, model: Model) -> None:
        """Write connections as contacts; unknown fields get the values that readers of frames expect."""
        for name in SAME:
            contacts[name] = found[name]
        contacts["signed_distance"], contacts["point_on_finger"] = found["distance"], found["point_on_own"]
        flags = found["flags"] & SAME_FLAGS | ALWAYS
        flags[(found["flags"] & CROSSING) != 0] |= INSIDE
        allowed = found["lower"] * (1.0 + self._options.get("tolerance", 0.0)) * ROUNDED_UP
        flags[(found["upper"] > allowed) | (found["part"] == NO_PART)] |= BOUNDED
        contacts["flags"] = flags
        contacts["normal"][~found["normal"].any(axis=1)] = np.nan
        for name, value in (("predicted_distance", found["distance"]), ("time_to_contact", np.inf)):
            contacts[name] = np.where(np.isnan(contacts[name]), value, contacts[name])
        self._write_motion(contacts, found, model)

    def _write_motion(self, contacts: np.ndarray, found: np.ndarray, model: Model) -> None:
        """Write velocities of both ends, and the response of the other part to contact."""
        frames, other = model.frames, found["part"]
        own = np.where(found["own_part"] < 0, model.names.index(self.parts[0]), found["own_part"])
        contacts["position"] = frames["translation"][own]
        contacts["velocity"] = _velocity_at(frames, own, found["point_on_own"])
        contacts["part_velocity"] = _velocity_at(frames, other, found["point_on_part"])
        is_met = other != NO_PART
        for name in ("surface", "stiffness", "damping"):
            contacts[name] = frames[name][other] * is_met
        is_near = (contacts["time_to_contact"] < np.inf) | (found["upper"] <= 0.0)
        is_soft = contacts["surface"] == DEFORMABLE
        contacts["mode"] = np.where(is_near, np.where(is_soft, FORCE, POSITION), RETRACT)

    def _widen(self, contacts: np.ndarray, motions: dict[str, ReportedMotion], now_ns: int) -> None:
        """Widen bounds by the possible displacement of other parts that are no longer reported."""
        assert self._model is not None, "it was placed"
        silent = [
            (row, motions[name])
            for row, name in enumerate(self._model.names)
            if name in motions and name not in self.parts and motions[name].is_moving
            and now_ns > motions[name].pose_ns + HOLD_NS and not self._model.parts["is_hidden"][row]
        ]  # fmt: skip
        self.is_late = bool(silent)
        if not silent:
            return
        error = max(
            1e-9 * (now_ns - motion.pose_ns) * _top_speed(motion, self._model.frames[row])
            for row, motion in silent
        )
        contacts["flags"] = contacts["flags"] & ~EXACT | BOUNDED
        for lower, upper in (("lower", "upper"), ("predicted_lower", "predicted_upper")):
            contacts[lower] = np.maximum(contacts[lower] - error, 0.0)
            contacts[upper] += error
        contacts["time_to_contact_lower"] = 0.0


class NoPoses:
    """Input of a service whose contact source reads its poses from the moves at *address*."""

    is_over = False

    def __init__(self, address: str) -> None:
        self.address = address
        self.notes: list[str] = []

    def poll(self, now_ns: int) -> Iterable[Samples]:
        """Yield no samples."""
        return ()

    def close(self) -> None:
        """No-op: the moves belong to another service."""


def _velocity_at(frames: np.ndarray, rows: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return velocities of parts at points, (N, 3), m/s; for a point of nan that of the origin."""
    velocities, turning = frames["velocity"][rows], frames["angular_velocity"][rows]
    if turning.any():
        arms = np.where(np.isnan(points), 0.0, points - frames["translation"][rows])
        velocities += _cross(turning, arms)
    return velocities


def _cross(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return cross products of rows; `numpy.cross` takes ten times as long."""
    ahead, behind = [1, 2, 0], [2, 0, 1]
    return left[..., ahead] * right[..., behind] - left[..., behind] * right[..., ahead]


def _top_speed(motion: ReportedMotion, frame: Any) -> float:
    """Return the largest speed of a point of a part, m/s."""
    reach = np.linalg.norm(np.maximum(np.abs(frame["own_lower"]), np.abs(frame["own_upper"])))
    return float(np.linalg.norm(motion.velocity) + np.linalg.norm(motion.turning) * reach) * ROUNDED_UP
