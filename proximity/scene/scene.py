"""Scenes: parts with poses, with the same queries as one solid."""

import weakref
from collections.abc import Iterable, Iterator
from typing import Any, cast

import numpy as np

from proximity.checks import refuse_trimesh
from proximity.errors import SceneError
from proximity.scene.model.assembly import Model
from proximity.scene.model.scene_state import box_of_vertices
from proximity.scene.motion_clearance import MotionQueries
from proximity.scene.part import (
    NO_VELOCITY,
    PART_COLUMNS,
    LoadReport,
    Part,
    checked_move,
    checked_moves,
    checked_part,
    checked_surface,
    part_cells,
    parts_of_mesh,
)
from proximity.scene.queries.closest_parts import ClosestPartQueries
from proximity.scene.queries.html_table import html_table
from proximity.scene.queries.queries import Ignored
from proximity.scene.scene_parts import ClosedParts, SceneParts, checked_parts, with_arrays
from proximity.scene.solid import Solid
from proximity.scene.walls.thickness import ThicknessQueries
from proximity.system.locks import fork_safe_lock


class Scene(ClosestPartQueries, MotionQueries, ThicknessQueries):
    """Parts that are queried together; they may be moved, deformed, added and removed between queries.

    A scene is a context manager: ``with proximity.load("a.prox") as scene`` closes it at the end: see
    `close`.

    Parameters
    ----------
    parts : iterable of Part or Solid
        At least one; names must differ. A `Solid` becomes a part at the identity pose.
    report : LoadReport
        Report of the file that the scene was loaded from.

    Raises
    ------
    SceneError
        If there are no parts, an entry is not a part, two have the same name, or velocities, stiffness or
        damping of a part are out of range.
    PoseError
        If a part's pose is not a rigid transform, or is too far away.

    Notes
    -----
    Thread: many threads may query while another moves parts; every answer is of one state, before or after
    the move. Only `deform` must not run at the same time as queries.
    """

    report: LoadReport | None
    _parts: SceneParts

    def __init__(self, parts: Iterable[Part | Solid], *, report: LoadReport | None = None) -> None:
        refuse_trimesh(parts)
        if not isinstance(parts, Iterable):
            raise SceneError(f"a scene is made of a list of parts, not of one {type(parts).__name__}")
        if report is not None and not isinstance(report, LoadReport):
            raise SceneError(f"report is {report!r}, expected a LoadReport, or None")
        self._begin(SceneParts.of(*with_arrays(checked_parts(parts))), report)

    def _begin(self, parts: SceneParts, report: LoadReport | None) -> None:
        self._parts, self.report, self._lock = parts, report, fork_safe_lock()
        self._bounds: tuple[Any, Any, Any] = (lambda: None, None, None)  # of a model: reference, two corners

    @classmethod
    def from_mesh(cls, vertices: Any, faces: Any = None, *, name: str = "mesh") -> "Scene":
        """Return a scene of the bodies in a mesh, welded, split and signed like a loaded file.

        Parameters
        ----------
        vertices : (V, 3) float64, m
            Corners, shared or not.
        faces : (F, 3) integers
            Rows of *vertices*, counter-clockwise seen from outside.
        name : str
            Name of the part; several bodies are numbered.

        Raises
        ------
        MeshError
            If the arrays cannot be used.
        """
        refuse_trimesh(vertices)
        return cls._of_parts(SceneParts.of_new(parts_of_mesh(vertices, faces, name=name)), None)

    @classmethod
    def _of_parts(cls, parts: SceneParts, report: LoadReport | None) -> "Scene":
        scene = cls.__new__(cls)
        scene._begin(parts, report)
        return scene

    def __reduce__(self) -> tuple[Any, ...]:
        with self._lock:
            state = self._parts.state
            return _made_again, (list(self._parts), self.report, state.dynamic_rows, state.epoch)

    def snapshot(self) -> Model:
        """Return the arrays of the present state, as queries and trackers use them.

        A snapshot does not change. Release it when no longer needed: each further one needs more memory.
        """
        return self._parts.state.current or self._updated()

    def _updated(self) -> Model:
        with self._lock:
            model = self._parts.updated()
            if model is None:
                # All copies are in use by long queries, or a tree has outgrown its memory.
                self._parts = self._parts.in_new_memory()
                model = self._parts.state.latest
            return model

    def _ignoring(self, ignore: Ignored) -> Model:
        names = ignore if isinstance(ignore, Iterable) and not isinstance(ignore, str) else (ignore,)
        known = list(names)
        while True:
            model, parts = self.snapshot(), self._parts
            rows = [parts.find(name) for name in known]  # type: ignore[arg-type]
            if parts.state.epoch == model.epoch:
                return model.ignoring(rows)

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts in their present state."""
        with self._lock:
            return tuple(self._parts)

    @property
    def epoch(self) -> int:
        """A number that grows when indices of parts, their faces, or their visibility change."""
        return self._parts.state.epoch

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner of the smallest box around all parts, hidden ones too, m, (3,) each."""
        known = self._bounds
        if known[0]() is not self.snapshot():
            model = self.snapshot()
            known = self._bounds = weakref.ref(model), *box_of_vertices(model)
        return known[1].copy(), known[2].copy()

    def _model_and_parts(self) -> tuple[Model, list[Part]]:
        """Return the arrays of the present state, and the parts in the same state."""
        while True:
            model = self.snapshot()
            with self._lock:
                if self._parts.state.current is model:
                    return model, list(self._parts)

    @property
    def part_sizes(self) -> np.ndarray:
        """Length, width and height of each part's box in the part's own frame, m, (P, 3)."""
        frames = self.snapshot().frames[:-1]
        with np.errstate(over="ignore"):
            return np.subtract(frames["own_upper"], frames["own_lower"])

    @property
    def memory_bytes(self) -> int:
        """Bytes of meshes and trees."""
        return self._parts.memory_bytes

    def part(self, name: str | int) -> Part:
        """Return the part of that name or index; ``scene[name]`` is the same.

        Parameters
        ----------
        name : str or int
            Name as in `parts`, or index: ``scene[hit.part]``.

        Raises
        ------
        SceneError
            If the part does not exist; the message lists the names.
        """
        with self._lock:
            return self._parts[self._parts.find(name)]

    __getitem__ = part

    def __iter__(self) -> Iterator[Part]:
        return iter(self.parts)

    def __len__(self) -> int:
        return len(self._parts)

    def move(
        self, name: str, pose: Any, *, velocity: Any = NO_VELOCITY, angular_velocity: Any = NO_VELOCITY
    ) -> None:
        """Set the pose of a part, and its velocity.

        Parameters
        ----------
        name : str
            Name of the part.
        pose : Pose or (4, 4) float64
            ``world_from_part``, metres.
        velocity : (3,) float64, m/s, scene's frame
            Of the part's origin.
        angular_velocity : (3,) float64, rad/s, scene's frame
            About the part's origin: a point of the part moves with velocity + angular_velocity x (point -
            origin).

        Raises
        ------
        SceneError
            If the part does not exist, or a velocity is not finite, or beyond 1e9 m/s or rad/s.
        PoseError
            If the pose is not a rigid transform.
        """
        with self._lock:
            row = np.array([self._parts.find(name)], np.int64)
            self._parts.state.move(row, *checked_move(name, pose, velocity, angular_velocity))

    def move_many(
        self, names: Iterable[str], poses: Any, velocities: Any = None, angular_velocities: Any = None
    ) -> None:
        """Set the poses of several parts; if one cannot be set, none is.

        Parameters
        ----------
        names : iterable of str
            Names of K parts, each once.
        poses : (K, 4, 4) float64, or a list of Pose
            ``world_from_part``, metres.
        velocities : (K, 3) float64, m/s, scene's frame
            Of the parts' origins. Default: zero.
        angular_velocities : (K, 3) float64, rad/s, scene's frame
            About the parts' origins. Default: zero.

        Raises
        ------
        SceneError
            If a part does not exist, one is named twice, or velocities are not finite, beyond 1e9 m/s or
            rad/s, or not one for each part.
        PoseError
            If a pose is not a rigid transform; the message names the part.

        Notes
        -----
        Cost: 10 µs for 20 parts of 200, regardless of faces, and the same for the next query or tick; 0.5 ms
        more when a part moves for the first time, and 10 ms when one leaves the scene far enough for a new
        tree over the parts. Repeating the same names, as the same `str` objects, saves some µs.
        """
        if isinstance(names, str) or not isinstance(names, Iterable):
            raise SceneError(f"names are {names!r}, expected a list of names")
        names = list(names)  # before the lock is taken: the iterable may query this scene
        with self._lock:
            rows = self._parts.rows_of(names)
            self._parts.state.move(rows, *checked_moves(names, poses, velocities, angular_velocities))

    def add(self, part: Part | Solid) -> None:
        """Add a part after the others.

        Parameters
        ----------
        part : Part or Solid
            Its name must be new. A `Solid` becomes a part at the identity pose.

        Raises
        ------
        SceneError
            If the name is in use, or it is not a part.
        PoseError
            If its pose is not a rigid transform, or is too far away.

        Notes
        -----
        Cost: all arrays are copied, about 0.2 s for a million faces.
        """
        part = checked_part(part)
        with self._lock:
            if not isinstance(part.name, str):
                raise SceneError(f"the part to add is named {part.name!r}, expected text")
            if part.name in self._parts.row_of:
                raise SceneError(f"a part is named {part.name!r} already, expected another name")
            self._parts = self._parts.with_part(part)

    def remove(self, name: str) -> None:
        """Remove a part, at the cost of `add`; the indices of later parts decrease by one.

        Parameters
        ----------
        name : str
            Name of the part. Its solid can still be used, and added again.

        Raises
        ------
        SceneError
            If the part does not exist, or it is the only one.
        """
        with self._lock:
            row = self._parts.find(name)
            if len(self._parts) == 1:
                raise SceneError(f"part {name!r} is the only one and cannot be removed: hide it instead")
            self._parts = self._parts.without(row)

    def hide(self, name: str) -> None:
        """Hide a part from queries and ticks until it is shown. A hidden part may be moved.

        Parameters
        ----------
        name : str
            Name of the part.

        Raises
        ------
        SceneError
            If the part does not exist.
        """
        with self._lock:
            self._parts.state.set_hidden(self._parts.find(name), True)

    def show(self, name: str) -> None:
        """Show a hidden part again.

        Parameters
        ----------
        name : str
            Name of the part.

        Raises
        ------
        SceneError
            If the part does not exist.
        """
        with self._lock:
            self._parts.state.set_hidden(self._parts.find(name), False)

    def set_surface(self, name: str, *, stiffness: float | None = None, damping: float = 0.0) -> None:
        """Set how a part reacts to a touch: rigid, or as a spring with a damper. Distances do not change.

        Parameters
        ----------
        name : str
            Name of the part.
        stiffness : N/m
            Above 0; None for a rigid part.
        damping : N s/m
            0 or more; not allowed for a rigid part.

        Raises
        ------
        SceneError
            If the part does not exist, or a number is out of range.
        """
        with self._lock:
            self._parts.state.set_surface(self._parts.find(name), *checked_surface(name, stiffness, damping))

    def save(self, path: Any) -> None:
        """Write the scene to a file that `load` opens in milliseconds, without rebuilding trees.

        Parameters
        ----------
        path : path
            Named "….prox". An existing file is replaced, wholly or not at all.

        Raises
        ------
        SceneError
            If *path* does not end in ".prox", or cannot be written; no incomplete file is left.

        Notes
        -----
        Cost: 176 bytes a face on the disk.
        Thread: parts may be queried and moved during the call; the file has the state of one moment.
        """
        from proximity.scene.saved.archive import check_extension
        from proximity.scene.saved.compiled_scene import write_scene  # loads kernels that queries do not need

        check_extension(path)
        write_scene(path, *self._model_and_parts(), self.report)

    def deform(self, name: str, vertices: Any) -> None:
        """Move the vertices of a part; its faces stay, and its tree is refitted, not rebuilt.

        ``part(name).solid`` is a new solid afterwards; the previous solid keeps its shape.

        Parameters
        ----------
        name : str
            Name of the part.
        vertices : (V, 3) float64, m, part's frame
            New positions of ``part(name).solid.mesh.vertices``. Vertices at the same position are one
            corner and must stay together. Other vertices may meet.

        Raises
        ------
        SceneError
            If the part does not exist.
        MeshError
            If they cannot be used, would tear the surface, or would turn a closed part inside out. The part
            is then unchanged.

        Notes
        -----
        Sign: by the method chosen when the part was made; it is not checked again. If the part now
        intersects itself or is almost flat, pseudo-normals may give the wrong sign, even far away.
        Degenerate: faces may lose their area.
        Cost: 12 ms for 300 k faces, a fortieth of making the part again; somewhat more the first time.
        Answers stay exact; after a large change, searches take longer than in a new tree. `contains`
        searches the surface instead of a grid.
        Thread: must not run while another thread queries this scene or a solid of its parts.
        """
        with self._lock:
            self._parts.mend()
            self._parts.deform(self._parts.find(name), vertices)

    def close(self) -> None:
        """Release the parts and their memory, and the mapped file of a compiled scene.

        Queries, changes and trackers of a closed scene raise `SceneError`. Answers, parts, solids and
        snapshots remain valid; a part, a solid or a snapshot keeps the memory, and the file, until it is
        deleted. Closing twice has no effect.
        """
        with self._lock:
            self._parts = cast(SceneParts, ClosedParts())

    def __enter__(self) -> "Scene":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        if isinstance(self._parts, ClosedParts):
            return "Scene(closed)"
        return f"Scene({len(self._parts)} parts, {self._parts.face_count} faces)"

    def _repr_html_(self) -> str:
        parts = () if isinstance(self._parts, ClosedParts) else self.parts
        return html_table(repr(self), PART_COLUMNS, map(part_cells, parts), len(parts))


def _made_again(parts: list[Part], report: LoadReport | None, dynamic: list[int], epoch: int) -> Scene:
    """Return the copy of a scene, with its own lock and arrays."""
    return Scene._of_parts(SceneParts.of(*with_arrays(parts), dynamic=dynamic, epoch=epoch), report)
