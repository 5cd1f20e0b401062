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
from proximity.kernels.entries import contains_corner
from proximity.kernels.layout import NO_FACE, NO_PART, NO_SLOT, columns_of
from proximity.kernels.tracking import tracked_motion, tracked_records, tracked_tick
from proximity.pose import Pose, velocities_between
from proximity.scene.model.assembly import Model
from proximity.scene.penetration import PenetrationSearch
from proximity.scene.scene import Scene
from proximity.tracker.tracker_arguments import LONGEST_LATENCY, as_nanoseconds

HORIZON = 0.25
"""s"""
LEAST_DEPTH_TOLERANCE = 0.01
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
        if count > tracked_tick.MOST_RECORDS:
            raise ArgumentError(f"connections is {count}, expected 1 to {tracked_tick.MOST_RECORDS}")
        settings = np.zeros(1, tracked_records.HELD_SETTINGS)
        settings["working_range"] = positive("working_range", working_range, "metres", may_be_infinite=True)
        settings["tolerance"] = not_negative("tolerance", tolerance, "shares")
        settings["latency"] = not_negative("latency", latency, "seconds", most=LONGEST_LATENCY)
        settings["horizon"] = positive("horizon", horizon, "seconds")
        settings["budget"] = 0 if budget is None else whole("budget", budget)
        settings["group"] = len(self._names)
        self._settings = settings
        self.connections = np.zeros(count, CONNECTION)
        self._offsets = self._offsets_in_group()
        entries = tracked_records.FRONTIER_ENTRIES
        self._frontiers = np.empty(entries), np.empty((entries, 3), np.int32)
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
        self._last_pose: tuple[int, Pose] | None = None
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
        is_predicted = True
        if pose is not None:
            is_predicted = self._move(Pose.of(pose), pose_ns, velocity, angular_velocity)
        elif velocity is not None or angular_velocity is not None:
            raise ArgumentError("velocities are given without a pose: set them where the parts are moved")
        return self._follow(self._scene.snapshot(), pose_ns, now, is_predicted)

    def _follow(self, model: Model, pose_ns: int, now_ns: int, is_predicted: bool) -> np.ndarray:
        """Run `tick` for a model whose parts are at their poses already."""
        self._settings["pose_ns"], self._settings["now_ns"] = pose_ns, now_ns
        self._settings["is_predicted"] = is_predicted
        is_moved = model is not self._last_model()
        if model.epoch != self._epoch:
            self._adopt(model)
        tracked_tick.follow_parts(model.packed, self._packed, is_moved)
        if self._settings["unsure"][0]:
            if self._decide_inside(model):
                tracked_tick.follow_parts(model.packed, self._packed, False)
            else:
                self._forbid_motion()
        elif self._settings["opening"][0] and not self._comes_free(model):
            self._forbid_motion()
        self._last_model = weakref.ref(model)
        for record in self.connections:
            if record["depth"] == np.inf:
                self._measure_depth(model, record)
        return self.connections

    def _forbid_motion(self) -> None:
        """Set the time without contact to zero."""
        self._settings["free_time"] = self.connections["time_to_contact_lower"] = 0.0

    def _comes_free(self, model: Model) -> bool:
        """Return whether a small displacement frees the touching parts: whether they touch from outside."""
        for pair in self._pairs[self._pairs["is_opening"] != 0]:
            search = self._penetration_search(model, pair)
            if search is None or not pair["normal"].any():
                return False
            frame = model.frames[pair["own"]]
            length = tracked_motion.SLIP * float(np.linalg.norm(frame["own_upper"] - frame["own_lower"]))
            search.look_along(pair["normal"], 0.5, length)
            if search.depth > length:
                return False
        return True

    def _surface_faces(self, model: Model, rows: Iterable[Any]) -> dict[int, np.ndarray] | None:
        """Return one face of each surface of some parts; None if shapes have changed since the model."""
        try:
            faces = {int(row): self._scene.part(model.names[row]).solid.surface_faces for row in rows}
        except SceneError:
            return None
        return faces if self._scene.epoch == model.epoch else None

    def _penetration_search(self, model: Model, pair: Any) -> PenetrationSearch | None:
        """Return a search for a direction out of the other part of a pair; None if shapes have changed."""
        own, other = int(pair["own"]), int(pair["other"])
        faces = self._surface_faces(model, (own, other))
        if faces is None:
            return None
        budget = int(self._settings["budget"][0])
        return PenetrationSearch(model, own, other, (faces[own], faces[other]), budget)

    def _measure_depth(self, model: Model, record: Any) -> None:
        """Measure the displacement that frees a part of another, in the last direction or a new one."""
        pairs = self._pairs
        row = np.flatnonzero((pairs["own"] == record["own_part"]) & (pairs["other"] == record["part"]))[0]
        pair = pairs[row].copy()
        search = self._penetration_search(model, pair)
        if search is None:
            return
        tolerance = max(float(self._settings["tolerance"][0]), LEAST_DEPTH_TOLERANCE)
        if pair["normal"].any():
            search.look_along(pair["normal"], tolerance, float(pair["depth"]))
            search.follow_normals(tolerance)
        else:
            search.search(tolerance)
        record["depth"], record["depth_lower"] = search.depth, search.lower
        record["work"] += search.steps
        if search.depth > 0.0:
            record["normal"] = pairs["normal"][row] = search.direction
            pairs["depth"][row] = search.depth

    def _offsets_in_group(self) -> list[Pose]:
        """Return the poses of the tracked parts relative to the first."""
        poses = [self._scene.part(name).pose for name in self._names]
        return [poses[0].inverse @ pose for pose in poses]

    def _move(self, pose: Pose, pose_ns: int, velocity: Any, angular_velocity: Any) -> bool:
        """Move the tracked parts; return whether their velocities are known."""
        linear, angular = velocity, angular_velocity
        is_known = velocity is not None and angular_velocity is not None
        if not is_known:
            found = velocities_between(self._last_pose, pose, pose_ns)
            is_known = found is not None or velocity is not None
            before, turning = found or (np.zeros(3), np.zeros(3))
            linear = before if velocity is None else velocity
            angular = turning if angular_velocity is None else angular_velocity
        if self._last_pose is None or pose_ns > self._last_pose[0]:
            self._last_pose = pose_ns, pose
        if len(self._names) == 1:
            self._scene.move(self._names[0], pose, velocity=linear, angular_velocity=angular)
            return is_known
        poses = [pose @ offset for offset in self._offsets]
        arms = np.array([each.translation - pose.translation for each in poses])
        self._scene.move_many(
            self._names,
            poses,
            np.asarray(linear, float) + np.cross(np.asarray(angular, float), arms),
            np.broadcast_to(np.asarray(angular, float), arms.shape),
        )
        return is_known

    def _adopt(self, model: Model) -> None:
        """Switch to a model that has other parts or faces than the last."""
        missing = [name for name in self._names if name not in model.names]
        if missing:
            raise SceneError(f"the tracked part {missing[0]!r} is not in the scene any more")
        own = [model.names.index(name) for name in self._names]
        count = len(model.names)
        is_rest = model.parts["is_hidden"][:count] == 0
        is_rest[own] = False
        rest = np.flatnonzero(is_rest)
        pairs = np.zeros(len(rest) * len(own), tracked_records.HELD_PAIR)
        pairs["own"], pairs["other"] = np.tile(own, len(rest)), np.repeat(rest, len(own))
        pairs["slots"], pairs["lower"], pairs["upper"], pairs["is_unsure"] = NO_SLOT, -1.0, np.inf, 1
        pairs["frontier"] = -1
        self._pairs = pairs
        frontiers = min(max(len(pairs), tracked_records.FEWEST_FRONTIERS), tracked_records.MOST_FRONTIERS)
        self._settings["frontier_count"], self._settings["next_frontier"] = frontiers, 0
        self._settings["frontier_length"] = tracked_records.FRONTIER_ENTRIES // frontiers
        before = np.array(columns_of(model.frames)[:count, : tracked_motion.POSE_SIZE])
        arrays = tracked_records.HeldArrays(
            self._settings, pairs, self.connections, before, np.zeros(count), *self._frontiers
        )
        self.connections["part"], self.connections["face"] = NO_PART, NO_FACE
        self._packed, self._arrays, self._epoch = native.packed(arrays), arrays, model.epoch
        self._last_model = lambda: None

    def _decide_inside(self, model: Model) -> bool:
        """Decide whether one part is inside the other, for surfaces that may have met and do not cross.

        Returns False if shapes have changed since the model was taken: the next tick decides then.
        """
        pairs, point = self._pairs, np.empty(3)
        rows = np.flatnonzero(pairs["is_undecided"])
        faces = self._surface_faces(model, {row for name in ("own", "other") for row in pairs[name][rows]})
        if faces is None:
            return False
        for row in rows:
            own, other = int(pairs["own"][row]), int(pairs["other"][row])
            pairs["is_inside"][row] = next(
                (
                    inside
                    for inside, inner, outer in (
                        (tracked_records.OWN_INSIDE, own, other),
                        (tracked_records.OTHER_INSIDE, other, own),
                    )
                    if contains_corner(model.packed, outer, inner, faces[inner], point)
                ),
                0,
            )
            pairs["is_unsure"][row] = pairs["lower"][row] <= 0.0
        return True

    def __reduce__(self) -> tuple[Any, ...]:
        raise ArgumentError(
            "a tracker cannot be copied, because its state depends on its ticks: make a new one of its scene"
        )

    def __repr__(self) -> str:
        return f"PartTracker({self.scene!r}, {', '.join(map(repr, self._names))})"


def follow(tracker: PartTracker, model: Model, pose_ns: int, now_ns: int, is_predicted: bool) -> np.ndarray:
    """Run `PartTracker.tick` for a model whose parts are at their poses of *pose_ns*."""
    return tracker._follow(model, pose_ns, now_ns, is_predicted)
