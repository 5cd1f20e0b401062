"""Scenes answered by the library in C, with the interface of `proximity.Scene`."""

import ctypes
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from proximity import (
    ArgumentError,
    Clearance,
    FileVersionError,
    MeshError,
    MeshFormatError,
    NotWatertightError,
    Part,
    PoseError,
    ProximityError,
    Relation,
    Scene,
)
from proximity.clients.c_package import library_path
from proximity.message import CONTACT
from proximity.scene.penetration import Penetration
from proximity.scene.queries.results import ClosestPoints, RayHits, SegmentHits
from proximity.tracker.part_tracker import CONNECTION

BAD_ARGUMENT, BAD_FILE, BAD_POSE, NO_INSIDE, BAD_VERSION, BAD_MESH = 1, 4, 5, 6, 9, 10
ERRORS = {
    BAD_ARGUMENT: ArgumentError,
    BAD_FILE: MeshFormatError,
    BAD_POSE: PoseError,
    NO_INSIDE: NotWatertightError,
    BAD_VERSION: FileVersionError,
    BAD_MESH: MeshError,
}
WIDTHS = {"closest": 12, "cast": 11, "closest_to_segments": 12}
ALIGNMENT = 8
CLEARANCE = np.dtype(
    [
        ("lower", "f8"),
        ("distance", "f8"),
        ("point_on_first", "f8", 3),
        ("point_on_second", "f8", 3),
        ("face_on_first", "i4"),
        ("face_on_second", "i4"),
        ("relation", "i4"),
        ("unused", "i4"),
    ]
)
"""``proximity_clearance_answer``."""


class Error(ctypes.Structure):
    """``proximity_error``."""

    _fields_ = (("code", ctypes.c_int32), ("sentence", ctypes.c_char * 508))


class Settings(ctypes.Structure):
    """``proximity_tracker_settings``."""

    _fields_ = (
        *((name, ctypes.c_double) for name in ("radius", "latency", "working_range", "tolerance", "horizon")),
        *((name, ctypes.c_double) for name in ("max_speed", "max_acceleration")),
        ("budget", ctypes.c_int64),
    )


class PartSettings(ctypes.Structure):
    """``proximity_part_tracker_settings``."""

    _fields_ = (
        *((name, ctypes.c_double) for name in ("working_range", "tolerance", "latency", "horizon")),
        ("budget", ctypes.c_int64),
    )


class Paths(ctypes.Structure):
    """``proximity_paths``."""

    _fields_ = (
        ("corners", ctypes.c_void_p),
        ("corner_count", ctypes.c_size_t),
        ("path_bends", ctypes.c_void_p),
        ("bends", ctypes.c_void_p),
    )


class LibraryScene:
    """A compiled scene answered by the library; parts are found by name."""

    def __init__(
        self, source: Path | np.ndarray | None = None, instructions: str = "", path: Path | None = None
    ) -> None:
        self._library = ctypes.CDLL(str(path or library_path()))
        self._library.proximity_part_name.restype = ctypes.c_char_p
        self._library.proximity_instructions.restype = ctypes.c_char_p
        self._scene = ctypes.c_void_p()
        self._source = source  # bytes are to stay
        if source is None:
            self.call("new_scene", ctypes.byref(self._scene))
        elif isinstance(source, np.ndarray):
            address, size = ctypes.c_void_p(source.ctypes.data), ctypes.c_size_t(source.nbytes)
            self.call("open_bytes", address, size, ctypes.byref(self._scene))
        else:
            self.call("open", ctypes.c_char_p(str(source).encode()), ctypes.byref(self._scene))
        if instructions:
            self.call("use_instructions", self._scene, instructions.encode())

    @classmethod
    def of_mesh(cls, vertices: Any, faces: Any, name: str = "mesh", instructions: str = "") -> "LibraryScene":
        """The scene of the bodies of a mesh."""
        scene = cls(instructions=instructions)
        points, rows = np.array(vertices, np.float64, order="C"), np.array(faces, np.int32, order="C")
        counts = ctypes.c_size_t(len(points)), ctypes.c_size_t(len(rows))
        given = _address(points), counts[0], _address(rows), counts[1]
        made = ctypes.c_void_p()
        scene.call("from_mesh", name.encode(), *given, ctypes.byref(made))
        scene.close()
        scene._scene = made
        if instructions:
            scene.call("use_instructions", made, instructions.encode())
        return scene

    def add(self, other: "LibraryScene", matrix: Any = None) -> int:
        """Add copies of the parts of another scene; the number of the first."""
        first, pose = ctypes.c_int32(), None if matrix is None else np.array(matrix, np.float64)
        at = None if pose is None else _address(pose)
        self.call("add_scene", self._scene, other._scene, at, ctypes.byref(first))
        return first.value

    def remove(self, name: str) -> None:
        """Remove a part."""
        self.call("remove", self._scene, self._part(name))

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function that returns an error number."""
        error = Error()
        code = getattr(self._library, f"proximity_{name}")(*arguments, ctypes.byref(error))
        if code:
            assert error.code == code
            raise ERRORS.get(code, ProximityError)(error.sentence.decode())

    def close(self) -> None:
        """Close the scene."""
        self._library.proximity_close(self._scene)
        self._scene = ctypes.c_void_p()

    __del__ = close

    @property
    def instructions(self) -> str:
        """Set of instructions in use."""
        return str(self._library.proximity_instructions(self._scene).decode())

    @property
    def names(self) -> list[str]:
        """The names of all parts."""
        count = self._library.proximity_part_count(self._scene)
        found = (self._library.proximity_part_name(self._scene, part) for part in range(count))
        return [name.decode("utf-8", "surrogatepass") for name in found]

    @property
    def sign_reasons(self) -> list[str | None]:
        """Why each part has its sign; None for those of a file."""
        self._library.proximity_sign_reason.restype = ctypes.c_char_p
        found = [self._library.proximity_sign_reason(self._scene, part) for part in range(len(self.names))]
        return [None if reason is None else reason.decode() for reason in found]

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the box around all parts, m."""
        corners = np.empty((2, 3))
        self._library.proximity_bounds(self._scene, _address(corners[0]), _address(corners[1]))
        return corners[0], corners[1]

    def pose(self, name: str) -> np.ndarray:
        """Return the pose of a part, (4, 4)."""
        matrix = np.empty((4, 4))
        self.call("pose", self._scene, self._part(name), _address(matrix))
        return matrix

    def move_many(self, names: list[str], matrices: Any, speeds: Any = None, turns: Any = None) -> None:
        """Set poses of parts."""
        rows = np.array([self._part(name) for name in names], np.int32)
        given = [None if each is None else np.array(each, np.float64) for each in (matrices, speeds, turns)]
        addresses = [None if each is None else _address(each) for each in given]
        self.call("move", self._scene, _address(rows), ctypes.c_size_t(len(rows)), *addresses)

    def post(self, name: str, matrix: Any, pose_ns: int, speed: Any = None, turn: Any = None) -> None:
        """Post the pose of a part for the next tick."""
        given = [None if each is None else np.array(each, np.float64) for each in (matrix, speed, turn)]
        pose, *velocities = (None if each is None else _address(each) for each in given)
        self.call("post", self._scene, self._part(name), pose, ctypes.c_int64(pose_ns), *velocities)

    def take(self, instant_ns: int) -> None:
        """Move parts to their posted poses."""
        self.call("take", self._scene, ctypes.c_int64(instant_ns))

    def hide(self, name: str, is_hidden: bool = True) -> None:
        """Hide a part, or show it."""
        self.call("hide", self._scene, self._part(name), int(is_hidden))

    def show(self, name: str) -> None:
        """Show a part again."""
        self.hide(name, False)

    def _part(self, name: str) -> int:
        return int(self._library.proximity_find_part(self._scene, name.encode("utf-8", "surrogatepass")))

    # --- queries, as in `proximity.scene.queries` ---

    def _ask(
        self, name: str, *given: Any, ignore: Any = None, limit: float | None = None, dtype: type = np.float64
    ) -> np.ndarray:
        width = WIDTHS.get(name, 1)
        rows = [np.array(each, np.float64, order="C") for each in given]
        table = np.empty((*rows[0].shape[:-1], width), dtype)
        arguments = [_address(each) for each in rows] + [ctypes.c_size_t(rows[0].size // 3)]
        arguments += [] if limit is None else [ctypes.c_double(limit)]
        if ignore is not None:
            ignored = np.array([self._part(part) for part in ignore], np.int32)
            name, arguments = (
                f"{name}_without",
                [*arguments, _address(ignored), ctypes.c_size_t(len(ignored))],
            )
        self.call(name, self._scene, *arguments, _address(table))
        return table

    def _record(self, record: Any, name: str, *given: Any, **how: Any) -> Any:
        record._table = self._ask(name, *given, **how)
        return record

    def closest(
        self, points: Any, *, max_distance: float = np.inf, workers: int = 1, ignore: Any = None
    ) -> ClosestPoints:
        return self._record(ClosestPoints(), "closest", points, limit=max_distance, ignore=ignore)

    def signed_distance(self, points: Any, *, workers: int = 1, ignore: Any = None) -> Any:
        return self._ask("signed_distance", points, ignore=ignore)[..., 0][()]

    def distance(self, points: Any, *, workers: int = 1, ignore: Any = None) -> Any:
        return self._ask("distance", points, ignore=ignore)[..., 0][()]

    def contains(self, points: Any, *, workers: int = 1, ignore: Any = None) -> Any:
        return self._ask("contains", points, ignore=ignore, dtype=np.bool_)[..., 0][()]

    def cast(
        self,
        origins: Any,
        directions: Any,
        *,
        max_distance: float = np.inf,
        workers: int = 1,
        ignore: Any = None,
    ) -> RayHits:
        return self._record(RayHits(), "cast", origins, directions, limit=max_distance, ignore=ignore)

    def cast_distance(
        self,
        origins: Any,
        directions: Any,
        *,
        max_distance: float = np.inf,
        workers: int = 1,
        ignore: Any = None,
    ) -> Any:
        return self._ask("cast_distance", origins, directions, limit=max_distance, ignore=ignore)[..., 0][()]

    def closest_to_segments(
        self, starts: Any, ends: Any, *, max_distance: float = np.inf, workers: int = 1, ignore: Any = None
    ) -> SegmentHits:
        return self._record(
            SegmentHits(), "closest_to_segments", starts, ends, limit=max_distance, ignore=ignore
        )

    def clearance(
        self,
        first: str,
        second: str,
        *,
        max_distance: float = np.inf,
        tolerance: float = 0.0,
        budget: int | None = None,
    ) -> Clearance:
        """Return the shortest connection of two parts."""
        table = np.empty((), CLEARANCE)
        limits = ctypes.c_double(max_distance), ctypes.c_double(tolerance), ctypes.c_size_t(budget or 0)
        self.call("clearance", self._scene, self._part(first), self._part(second), *limits, _address(table))
        return _clearance(first, second, table)

    def closest_pairs(
        self, *, max_distance: float = np.inf, most: int = 1000, of: str | None = None
    ) -> list[Clearance]:
        """Return the nearest pairs of parts."""
        parts, tables, count = np.empty((most, 2), np.int32), np.empty(most, CLEARANCE), ctypes.c_size_t()
        limits = -1 if of is None else self._part(of), ctypes.c_double(max_distance), ctypes.c_size_t(most)
        arrays = _address(parts), _address(tables), ctypes.byref(count)
        self.call("closest_pairs", self._scene, *limits, *arrays)
        names, found = self.names, slice(count.value)
        return [
            _clearance(names[one], names[other], table)
            for (one, other), table in zip(parts[found], tables[found], strict=True)
        ]

    def penetration(
        self, first: str, second: str, *, direction: Any = None, tolerance: float = 0.01
    ) -> Penetration:
        """Return how deep two parts are in each other."""
        found, along = np.empty(10), None if direction is None else np.array(direction, np.float64)
        given = None if along is None else _address(along), ctypes.c_double(tolerance), _address(found)
        self.call("penetration", self._scene, self._part(first), self._part(second), *given)
        way, deepest = (found[0], found[1], found[2:5]), (found[5], found[6], found[7:])
        return Penetration(first, second, *way, *deepest)


def _clearance(first: str, second: str, table: np.ndarray) -> Clearance:
    lower, distance, *ends, face, other_face, relation, _ = table.tolist()
    ends = [np.array(each) for each in ends]
    return Clearance(first, second, distance, lower, list(Relation)[relation], *ends, face, other_face)


def _address(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def through_library(scene: Scene, instructions: str = "") -> LibraryScene:
    """Return a scene, saved and opened by the library."""
    with tempfile.TemporaryDirectory(prefix="proximity_digest_") as folder:
        path = Path(folder) / "scene.prox"
        scene.save(path)
        return LibraryScene(path, instructions)


class LibraryTracker:
    """A tracker of the library, of a scene that follows a Python one, with the interface of `Tracker`."""

    def __init__(self, scene: Scene, *, fingers: int = 5, instructions: str = "", **settings: Any) -> None:
        self._tracker = ctypes.c_void_p()
        self._python, self._model = scene, scene.snapshot()
        self._scene = through_library(scene, instructions)
        self._library = self._scene._library
        self._library.proximity_default_settings.restype = Settings
        chosen = self._library.proximity_default_settings()
        for name, value in settings.items():
            setattr(chosen, name, value)
        self._parts = {part.name: part for part in scene.parts}
        self.contacts = np.zeros(fingers, CONTACT)
        arguments = ctypes.c_size_t(fingers), ctypes.byref(chosen), ctypes.byref(self._tracker)
        self._scene.call("create_tracker", self._scene._scene, *arguments)

    def tick(
        self,
        positions: Any,
        t_pose_ns: Any,
        now_ns: int,
        *,
        velocities: Any = None,
        paths: Any = None,
        path_bends: Any = None,
        bends: Any = None,
    ) -> np.ndarray:
        """Tick all fingers, with the parts at their present poses in the Python scene."""
        self._follow()
        instants = np.array(np.broadcast_to(t_pose_ns, len(self.contacts)), np.int64)
        given = [positions, velocities, paths, path_bends, bends]
        rows = [None if each is None else np.array(each, np.float64, order="C") for each in given]
        addresses = [None if each is None else each.ctypes.data for each in rows]
        polylines = None if paths is None else Paths(addresses[2], rows[2].shape[1], *addresses[3:])
        self._scene.call(
            "tick", self._tracker, ctypes.c_void_p(addresses[0]), _address(instants), ctypes.c_int64(now_ns),
            ctypes.c_void_p(addresses[1]), None if polylines is None else ctypes.byref(polylines),
            _address(self.contacts),
        )  # fmt: skip
        return self.contacts

    def ignore(self, finger: int, part: str, is_ignored: bool = True) -> None:
        """Have a finger ignore a part."""
        row = ctypes.c_size_t(finger), self._scene._part(part), int(is_ignored)
        self._scene.call("ignore", self._tracker, *row)

    def reset(self) -> None:
        """Reset all fingers."""
        self._library.proximity_reset_tracker(self._tracker)

    def _follow(self) -> None:
        """Apply the moves and hiding of the Python scene since the last tick."""
        model = self._python.snapshot()
        if model is self._model:
            return
        self._model, known, moved = model, self._parts, []
        self._parts = {part.name: part for part in self._python.parts}
        for name, part in self._parts.items():
            before = known[name]
            if part.is_hidden != before.is_hidden:
                self._scene.hide(name, part.is_hidden)
            if _motion_of(part) != _motion_of(before):
                moved.append(part)
        self._scene.move_many(
            [part.name for part in moved],
            [part.pose.matrix for part in moved],
            [part.velocity for part in moved],
            [part.angular_velocity for part in moved],
        )

    def __del__(self) -> None:
        if self._tracker:
            self._library.proximity_destroy_tracker(self._tracker)


class LibraryPartTracker:
    """A tracker of parts of the library, with the interface of `PartTracker`; its ticks move the scene."""

    def __init__(self, scene: LibraryScene, *parts: str, connections: int = 1, **settings: Any) -> None:
        self._tracker, self._scene, self._library = ctypes.c_void_p(), scene, scene._library
        self._library.proximity_default_part_settings.restype = PartSettings
        chosen = self._library.proximity_default_part_settings()
        for name, value in settings.items():
            setattr(chosen, name, value)
        self.connections = np.zeros(connections, CONNECTION)
        rows = np.array([scene._part(name) for name in parts], np.int32)
        counts = ctypes.c_size_t(len(rows)), ctypes.c_size_t(connections)
        made = ctypes.byref(chosen), ctypes.byref(self._tracker)
        scene.call("create_part_tracker", scene._scene, _address(rows), *counts, *made)

    def tick(
        self, matrix: Any, t_pose_ns: int, now_ns: int, *, velocity: Any = None, angular_velocity: Any = None
    ) -> np.ndarray:
        """Move the parts and return their connections."""
        given = (matrix, velocity, angular_velocity)
        rows = [None if each is None else np.array(each, np.float64, order="C") for each in given]
        pose, *velocities = (None if each is None else _address(each) for each in rows)
        instants = ctypes.c_int64(t_pose_ns), ctypes.c_int64(now_ns)
        self._scene.call("tick_part", self._tracker, pose, *instants, *velocities, _address(self.connections))
        return self.connections

    def reset(self) -> None:
        """Forget everything."""
        self._library.proximity_reset_part_tracker(self._tracker)

    def __del__(self) -> None:
        if self._tracker:
            self._library.proximity_destroy_part_tracker(self._tracker)


def _motion_of(part: Part) -> list[bytes]:
    return [each.tobytes() for each in (part.pose.matrix, part.velocity, part.angular_velocity)]
