"""Trackers of parts: at every tick, the shortest connections of a moving part to the others, with bounds."""

import operator
import weakref
from collections.abc import Callable, Iterable
from enum import IntFlag
from typing import Any

import numpy as np

from proximity import native
from proximity.checks import not_negative, positive, whole
from proximity.errors import ArgumentError, SceneError
from proximity.kernels import contact_record
from proximity.kernels.layout import NO_PART
from proximity.kernels.tracking import tracked_group, tracked_motion, tracked_records, tracked_tick
from proximity.kernels.traverse.dual_first import SIDE
from proximity.pose import Pose
from proximity.scene.model.assembly import Model
from proximity.scene.part import checked_velocity
from proximity.scene.scene import Scene
from proximity.tracker.tracker_arguments import LONGEST_LATENCY, as_nanoseconds

HORIZON = 0.25
"""s"""
CONNECTION = tracked_records.CONNECTION_RECORD
"""One connection of a tracked part; see `PartTracker.tick` for the fields."""


class ConnectionFlag(IntFlag):
    """Properties of a connection; a set of bits in ``connections["flags"]``."""

    PREDICTED = contact_record.PREDICTED
    """The velocities are known, so that predictions and times to contact are valid."""
    EXACT = contact_record.EXACT
    """lower = distance = upper."""
    BOUNDED = contact_record.BOUNDED
    """A tolerance or the budget ended the search: the bounds hold, the distance is the shortest found."""
    SKIPPED = contact_record.SKIPPED
    """The search was skipped: the bounds follow from the last one and from the motion since."""
    INSIDE = contact_record.INSIDE
    """One of the parts is inside the other. The distance is 0; both points are the point of the inner surface
    that is nearest to the outer surface."""
    IN_RANGE = contact_record.IN_RANGE
    """The distance is within the working range."""
    PART_CHANGED = contact_record.PART_CHANGED
    """The connection is to another part than at the tick before."""
    CROSSING = tracked_records.CROSSING_PARTS
    """The surfaces of the two parts meet, and they share volume. The distance is 0; both points are equal."""

    @classmethod
    def _missing_(cls, value: Any) -> Any:
        """Accept the NumPy integer of a record."""
        return super()._missing_(operator.index(value))


class PartTracker:
    """The shortest connections of a moving part, or of a rigid group of parts, to the rest of a scene.

    Parameters
    ----------
    scene : Scene
        Its parts may be moved, added, removed, hidden or deformed between ticks.
    part : str or sequence of str
        Name of the part, or names of a rigid group: distances within it are not computed.
    connections : int
        Number of connections to return, at most one for each other part; 1 to 16.
    working_range : float, m
        Only bounds are computed for longer connections.
    tolerance : float
        Relative tolerance of the bounds of a connection. 0: exact at every tick.
    budget : int, optional
        Largest number of steps a tick (boxes opened, and groups of eight triangles compared), again for times
        to contact, and again for the depth of each connection. If it is exhausted, the bounds differ by more.
        None: no limit.
    latency : float, s
        Time from a tick until its answer is used, 0 to 1: predictions are for that instant.
    horizon : float, s
        Contacts are predicted up to this time ahead.

    Raises
    ------
    SceneError
        If a part does not exist.
    ArgumentError
        If an argument cannot be used; the message names it and the expected value.

    Notes
    -----
    Degenerate: distances are those of solids, 0 if surfaces cross or one part is inside another. Hidden parts
    are ignored, except for the tracked ones themselves.
    Cost: 10 to 60 µs for parts of 3 to 80 thousand faces; more if large surfaces are nearly parallel.
    Thread: a tick releases the interpreter lock. One thread ticks a tracker; any thread may move parts.
    Source: conservative advancement after Mirtich 1996.
    """

    connections: np.ndarray  # (K,) CONNECTION, overwritten by each tick

    def __init__(
        self,
        scene: Scene,
        part: str | Iterable[str],
        *,
        connections: int = 1,
        working_range: float = np.inf,
        tolerance: float = 0.0,
        budget: int | None = None,
        latency: float = 0.001,
        horizon: float = HORIZON,
    ) -> None:
        if not isinstance(scene, Scene):
            raise ArgumentError(f"a tracker looks at a Scene, not at a {type(scene).__name__}")
        self._scene = scene
        self._names = (part,) if isinstance(part, str) else tuple(part)
        if not self._names or len(set(self._names)) < len(self._names):
            raise ArgumentError(f"part is {part!r}, expected one name, or several that differ")
        count = whole("connections", connections)
        if count > tracked_tick.MAX_RECORDS:
            raise ArgumentError(f"connections is {count}, expected 1 to {tracked_tick.MAX_RECORDS}")
        settings = np.zeros(1, tracked_records.HELD_SETTINGS)
        settings["working_range"] = positive("working_range", working_range, "metres", may_be_infinite=True)
        settings["tolerance"] = not_negative("tolerance", tolerance, "shares")
        settings["latency"] = not_negative("latency", latency, "seconds", most=LONGEST_LATENCY)
        settings["horizon"] = positive("horizon", horizon, "seconds")
        settings["budget"] = 0 if budget is None else whole("budget", budget)
        self._settings = settings
        self.connections = np.zeros(count, CONNECTION)
        self._relate_group()
        entries = tracked_records.FRONTIER_ENTRIES
        sides = np.empty(SIDE * entries)
        self._frontiers = np.empty(entries), np.empty((entries, 3), np.int32), sides
        self._last_model: Callable[[], Model | None] = lambda: None
        self.reset()

    @property
    def scene(self) -> Scene:
        """The scene. Another scene needs another tracker."""
        return self._scene

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the tracked parts."""
        return self._names

    @property
    def epoch(self) -> int:
        """Epoch of the scene at the last tick, to which parts and faces refer; -1 before it."""
        return self._epoch

    @property
    def free_time(self) -> float:
        """Time from the pose, s, without contact at constant velocities; the horizon at most."""
        return float(self._settings["free_time"][0])

    def reset(self) -> None:
        """Reset the state: the next tick is treated as the first."""
        self._epoch = -1
        self._settings["has_last"] = 0
        self._last_model = lambda: None
        self.connections["part"] = NO_PART
        self._settings["free_time"] = 0.0

    def tick(
        self,
        pose: Any,
        t_pose_ns: int,
        now_ns: int,
        *,
        velocity: Any = None,
        angular_velocity: Any = None,
    ) -> np.ndarray:
        """Move the tracked part, or group, and return its shortest connections.

        Parameters
        ----------
        pose : Pose or (4, 4) array-like, or None
            Pose of the part, world_from_part; for a group that of the first part, which the others follow at
            their relative poses from when the tracker was made. None: the parts keep their poses and
            velocities in the scene.
        t_pose_ns : int, ns
            Instant of the pose, on the clock of *now_ns*.
        now_ns : int, ns
            Instant of the tick, as `time.monotonic_ns` gives it.
        velocity : (3,) float64, m/s, scene's frame
            Of the part's origin. Default: from the last two poses, if they are within 0.1 s.
        angular_velocity : (3,) float64, rad/s, scene's frame
            About the part's origin. Default: likewise.

        Returns
        -------
        (connections,) CONNECTION
            The shortest first. The same array at each tick: copy values needed after the next tick. Fields:

            - ``distance``, m: of the shortest connection found; inf if there is none in the working range;
            - ``lower``, ``upper``, m: bounds of the true distance to that part. In the first record ``lower``
              holds for all parts, and in a record without a connection for all parts that have no record;
            - ``point_on_own``, ``point_on_part``, m, scene's frame: its ends;
            - ``normal``: unit vector along which the tracked part moves away; 0 if there is none;
            - ``depth``, ``depth_lower``, m: upper and lower bound of the displacement along the normal that
              frees the tracked part of the other, if they cross, one is inside the other, or a budget left
              that open; else 0;
            - ``part``, ``own_part``, ``face``, ``own_face``: rows of `Scene.parts` and of their faces; -1;
            - ``approach_speed``, m/s: -d/dt of the distance; nan if velocities are not known;
            - ``predicted_ns``, ``predicted_distance``, ``predicted_lower``, ``predicted_upper``: at the
              instant of use, at constant velocities;
            - ``time_to_contact``, s from the pose: expected; 0 in contact, inf if none is expected within the
              horizon;
            - ``time_to_contact_lower``, s from the pose: lower bound at constant velocities, rotation
              included; the horizon at most. In the first record this holds for all parts. A contact that ends
              within the first 8 millionths of the part's size does not count, so that a part can leave;
            - ``flags``: a set of `ConnectionFlag`; ``work``: steps; ``pose_ns``, ``age_ns``.

        Raises
        ------
        SceneError
            If a tracked part is no longer in the scene.
        PoseError, ArgumentError
            If the pose, an instant or a velocity cannot be used.
        """
        pose_ns, now = as_nanoseconds(t_pose_ns), as_nanoseconds(now_ns)
        if pose is not None:
            self._move(Pose.of(pose), pose_ns, velocity, angular_velocity)
        elif velocity is not None or angular_velocity is not None:
            raise ArgumentError("velocities are given without a pose: set them where the parts are moved")
        else:
            self._settings["is_predicted"] = 1
        return self._follow(self._scene.snapshot(), pose_ns, now)

    def _relate_group(self) -> None:
        """Store the poses of the tracked parts relative to the first."""
        for name in self._names:
            self._scene.part(name)  # which names a similar one
        size, model = len(self._names), self._scene.snapshot()
        self._group = tracked_group.GroupMotion(
            self._settings,
            np.empty((size, 4, 4)),
            np.empty((4, 4)),
            np.empty((2, 3)),
            np.empty((size, 4, 4)),
            np.empty((size, 3)),
            np.empty((size, 3)),
        )
        self._packed_group = native.packed(self._group)
        tracked_group.relate_group(model.frames, self._rows_in(model), self._group.offsets)

    def _follow(self, model: Model, pose_ns: int, now_ns: int) -> np.ndarray:
        """Run `tick` for a model whose parts are at their poses already."""
        self._settings["pose_ns"], self._settings["now_ns"] = pose_ns, now_ns
        is_moved = model is not self._last_model()
        if model.epoch != self._epoch:
            self._adopt(model)
        tracked_tick.follow_parts(model.packed, self._packed, is_moved)
        self._last_model = weakref.ref(model)
        return self.connections

    def _move(self, pose: Pose, pose_ns: int, velocity: Any, angular_velocity: Any) -> None:
        """Move the tracked parts; velocities that are not given follow from the last two poses."""
        group, known, name = self._group, 0, self._names[0]
        if velocity is not None:
            group.given[0] = checked_velocity(name, velocity, "velocity", "m/s")
            known |= tracked_group.LINEAR_GIVEN
        if angular_velocity is not None:
            group.given[1] = checked_velocity(name, angular_velocity, "angular_velocity", "rad/s")
            known |= tracked_group.ANGULAR_GIVEN
        group.matrices[0] = pose.matrix
        tracked_group.move_group(self._packed_group, pose_ns, known)
        velocities = group.velocities, group.angular_velocities
        if len(self._names) == 1:
            linear, angular = velocities[0][0], velocities[1][0]
            self._scene.move(name, pose, velocity=linear, angular_velocity=angular)
        else:
            self._scene.move_many(self._names, group.matrices, *velocities)

    def _rows_in(self, model: Model) -> np.ndarray:
        """Return the rows of the tracked parts."""
        missing = [name for name in self._names if name not in model.names]
        if missing:
            raise SceneError(f"the tracked part {missing[0]!r} is not in the scene any more")
        return np.array([model.names.index(name) for name in self._names], np.int64)

    def _adopt(self, model: Model) -> None:
        """Switch to a model that has other parts or faces than the last."""
        own, count = self._rows_in(model), len(model.names)
        is_rest = model.parts["is_hidden"][:count] == 0
        is_rest[own] = False
        arrays = tracked_records.HeldArrays(
            self._settings,
            np.zeros(int(is_rest.sum()) * len(own), tracked_records.HELD_PAIR),
            self.connections,
            np.zeros((count, tracked_motion.POSE_SIZE)),
            np.zeros(count),
            *self._frontiers,
            own,
            np.empty(2 * int(model.parts["face_count"][:count].sum()), np.int32),
            np.empty((count + 1, 2), np.int64),
        )
        self._packed, self._arrays, self._epoch = native.packed(arrays), arrays, model.epoch
        tracked_tick.adopt_rows(model.packed, self._packed)
        self._last_model = lambda: None

    def __reduce__(self) -> tuple[Any, ...]:
        raise ArgumentError(
            "a tracker cannot be copied, because its state depends on its ticks: make a new one of its scene"
        )

    def __repr__(self) -> str:
        return f"PartTracker({self.scene!r}, {', '.join(map(repr, self._names))})"


def follow(tracker: PartTracker, model: Model, pose_ns: int, now_ns: int, is_predicted: bool) -> np.ndarray:
    """Run `PartTracker.tick` for a model whose parts are at their poses of *pose_ns*."""
    tracker._settings["is_predicted"] = is_predicted
    return tracker._follow(model, pose_ns, now_ns)
