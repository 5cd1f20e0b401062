"""Parts with poses: the same queries as of one solid, answered for all of them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from operator import is_
from typing import Any

import numpy as np

from proximity.arrays import refuse_trimesh
from proximity.errors import MeshError, SceneError
from proximity.kernels.layout import BOX_LOWER, BOX_UPPER, OWN_LOWER, OWN_UPPER
from proximity.model.assembly import Model, assemble
from proximity.model.bvh import LocalFrame
from proximity.model.moving_models import Stage, write_motion, write_surface
from proximity.pose import Pose
from proximity.scene.deformation import deform_part
from proximity.scene.part import NO_VELOCITY, Part, checked_part, parts_of_mesh
from proximity.scene.part_motion import checked_move, checked_moves, checked_surface
from proximity.scene.queries import Queries
from proximity.scene.saved.compiled_scene import CompiledScene, write_scene
from proximity.scene.solid import Solid
from proximity.system.locks import fork_safe_lock

_OWN_LOWER, _OWN_UPPER = slice(OWN_LOWER, OWN_LOWER + 3), slice(OWN_UPPER, OWN_UPPER + 3)


@dataclass(frozen=True, slots=True)
class LoadReport:
    """Where a scene came from, and in which units.

    Parameters
    ----------
    path : str
        Of the file.
    format : str
        As people say it: "STL, binary".
    units : str
        Of the file's coordinates.
    units_declared : bool
        False: the file names none, *units* is what the caller said.
    notes : tuple of str
        Sentences a user should know.
    """

    path: str
    format: str
    units: str
    units_declared: bool
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        units = f"{self.units} {'declared' if self.units_declared else 'assumed'}"
        return f"LoadReport({self.path!r}, {self.format}, {units}, {len(self.notes)} notes)"


class Scene(Queries):
    """Parts that are asked together; they may move, change shape, come and go between questions.

    Parameters
    ----------
    parts : iterable of Part or Solid
        At least one; names must differ. A `Solid` becomes a part at the identity pose.
    report : LoadReport
        Where it came from, if from a file.

    Raises
    ------
    SceneError
        If there are no parts, two have one name, something else than parts is given, or velocities, stiffness
        or damping of a part are no numbers for it.
    PoseError
        If a part's pose is no rigid transform, or goes too far.

    Notes
    -----
    Thread: many threads may ask while another moves parts: an answer is that of one moment, before or after.
    Only `deform` must have the scene for itself.
    """

    report: LoadReport | None
    _stage: Stage
    _last_moved: tuple[Any, list[str], Any] = None, [], None  # by which names, which parts, their rows
    _torn: tuple[int, LocalFrame] | None = None  # the part that is being deformed: row, and frame before

    def __init__(self, parts: Iterable[Part | Solid], *, report: LoadReport | None = None) -> None:
        refuse_trimesh(parts, SceneError)
        if not isinstance(parts, Iterable):
            raise SceneError(f"a scene is made of a list of parts, not of one {type(parts).__name__}")
        if report is not None and not isinstance(report, LoadReport):
            raise SceneError(f"report is {report!r}, expected a LoadReport, or None")
        given = [checked_part(part) for part in parts]
        if not given:
            raise SceneError("a scene has no parts, expected at least one")
        taken: dict[str, int] = {}
        for row, part in enumerate(given):
            if not isinstance(part.name, str):
                raise SceneError(f"part {row} is named {part.name!r}, expected text")
            if part.name in taken:
                raise SceneError(
                    f"parts {taken[part.name]} and {row} are both named {part.name!r}, "
                    "expected names that differ"
                )
            taken[part.name] = row
        self.report = report
        self._lock = fork_safe_lock()
        self._assemble(given, loose=(), epoch=0)

    @classmethod
    def from_mesh(cls, vertices: Any, faces: Any = None, *, name: str = "mesh") -> "Scene":
        """Return a scene of the bodies in a mesh: welded, split and signed, as a file's are.

        Parameters
        ----------
        vertices : (V, 3) float64, m
            Corners, shared or not.
        faces : (F, 3) integers
            Rows of *vertices*, counter-clockwise seen from outside.
        name : str
            Of the part; several bodies are numbered.

        Raises
        ------
        MeshError
            If the arrays cannot be used.
        """
        refuse_trimesh(vertices, MeshError)
        return cls(parts_of_mesh(vertices, faces, name=name))

    @classmethod
    def _from_compiled(cls, compiled: CompiledScene) -> "Scene":
        """The scene that was saved; its trees are not made anew."""
        scene = cls.__new__(cls)
        scene._parts = [Part(**fields) for fields in compiled.parts]
        scene._row = {part.name: row for row, part in enumerate(scene._parts)}
        told = compiled.report
        scene.report = None if told is None else LoadReport(**{**told, "notes": tuple(told["notes"])})
        scene._lock = fork_safe_lock()
        scene._stage = Stage(compiled.model)
        scene._told = scene._stage.versions.copy()
        return scene

    def __reduce__(self) -> tuple[Any, ...]:
        with self._lock:
            parts = [self._part_now(row) for row in range(len(self._parts))]
            return _made_again, (parts, self.report, self._stage.loose_rows, self._stage.epoch)

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts, as they are at present."""
        with self._lock:
            return tuple(self._part_now(row) for row in range(len(self._parts)))

    @property
    def epoch(self) -> int:
        """A number that grows whenever indices of parts, their faces, or what is hidden change."""
        return self._stage.epoch

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner of the box around all parts, hidden ones too, m, (3,) each."""
        model = self._current()
        row = model.frames[-1]
        return row[BOX_LOWER : BOX_LOWER + 3].copy(), row[BOX_UPPER : BOX_UPPER + 3].copy()

    @property
    def part_sizes(self) -> np.ndarray:
        """Length, width and height of each part's box in the part's own frame, m, (P, 3)."""
        frames = self._current().frames[:-1]
        with np.errstate(over="ignore"):
            sizes: np.ndarray = frames[:, _OWN_UPPER] - frames[:, _OWN_LOWER]
        return sizes

    @property
    def memory_bytes(self) -> int:
        """Bytes held by meshes and trees."""
        solids = {part.solid for part in self._parts}  # one may be in several parts
        return self._stage.latest.memory_bytes + sum(solid._mesh_bytes for solid in solids)

    def part(self, name: str) -> Part:
        """Return the part of that name.

        Parameters
        ----------
        name : str
            As in `parts`.

        Raises
        ------
        SceneError
            If there is none; the message lists the names.
        """
        with self._lock:
            return self._part_now(self._find(name))

    def move(
        self, name: str, pose: Any, *, velocity: Any = NO_VELOCITY, angular_velocity: Any = NO_VELOCITY
    ) -> None:
        """Put a part somewhere else, and say how fast it moves there.

        Parameters
        ----------
        name : str
            Of the part.
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
            If there is no such part, or a velocity is not finite, or beyond 1e9 m/s or rad/s.
        PoseError
            If the pose is no rigid transform.

        Notes
        -----
        Cost: as `move_many`.
        """
        with self._lock:
            row = np.array([self._find(name)], np.int64)
            self._stage.move(row, *checked_move(name, pose, velocity, angular_velocity))

    def move_many(
        self, names: Iterable[str], poses: Any, velocities: Any = None, angular_velocities: Any = None
    ) -> None:
        """Put several parts somewhere else, all or, if one cannot be, none.

        Parameters
        ----------
        names : iterable of str
            Of K parts, each once.
        poses : (K, 4, 4) float64, or a list of Pose
            ``world_from_part``, metres.
        velocities : (K, 3) float64, m/s, scene's frame
            Of the parts' origins; zero where not given.
        angular_velocities : (K, 3) float64, rad/s, scene's frame
            About the parts' origins; zero where not given.

        Raises
        ------
        SceneError
            If there is no such part, one is named twice, or velocities are not finite, beyond 1e9 m/s or
            rad/s, or not as many.
        PoseError
            If some pose is no rigid transform; the message names the part.

        Notes
        -----
        Cost: some 10 µs for 20 parts of 200, whatever their faces, and as much for the next question or tick;
        some 0.5 ms more when a part moves for the first time, and some 10 ms when one leaves the scene far
        enough for another tree over the parts. The same names again, of the same `str` objects, save some µs.
        """
        if isinstance(names, str) or not isinstance(names, Iterable):
            raise SceneError(f"names are {names!r}, expected a list of names")
        names = list(names)  # before the lock is taken: they may come from somebody who asks this scene
        with self._lock:
            rows = self._rows_of(names)
            self._stage.move(rows, *checked_moves(names, poses, velocities, angular_velocities))

    def add(self, part: Part | Solid) -> None:
        """Add a part behind the others.

        Parameters
        ----------
        part : Part or Solid
            With a name of its own. A `Solid` becomes a part at the identity pose.

        Raises
        ------
        SceneError
            If the name is taken, or it is no part.
        PoseError
            If its pose is no rigid transform, or goes too far.

        Notes
        -----
        Cost: all arrays are copied, about 0.2 s for a million faces.
        """
        part = checked_part(part)
        with self._lock:
            if not isinstance(part.name, str):
                raise SceneError(f"the part to add is named {part.name!r}, expected text")
            if part.name in self._row:
                raise SceneError(f"a part is named {part.name!r} already, expected another name")
            now = [self._part_now(row) for row in range(len(self._parts))]
            self._assemble([*now, part], loose=self._stage.loose_rows, epoch=self._stage.epoch + 1)

    def remove(self, name: str) -> None:
        """Take a part out; indices of those behind it go down by one.

        Parameters
        ----------
        name : str
            Of the part. Its solid can still be asked, and added again.

        Raises
        ------
        SceneError
            If there is no such part, or no other.

        Notes
        -----
        Cost: as `add`.
        """
        with self._lock:
            gone = self._find(name)
            if len(self._parts) == 1:
                raise SceneError(f"part {name!r} is the only one, and a scene has at least one: hide it")
            kept = [row for row in range(len(self._parts)) if row != gone]
            loose = [new for new, row in enumerate(kept) if row in self._stage.loose_rows]
            solid = self._parts[gone].solid
            # In memory of its own: it would hold on to that of the whole scene.
            solid._share(assemble([solid._model.part_arrays(0)], [Pose()]))
            self._assemble([self._part_now(row) for row in kept], loose=loose, epoch=self._stage.epoch + 1)

    def hide(self, name: str) -> None:
        """Let no question find a part, until it is shown; what is hidden may move.

        Parameters
        ----------
        name : str
            Of the part.

        Raises
        ------
        SceneError
            If there is no such part.
        """
        with self._lock:
            self._stage.set_hidden(self._find(name), True)

    def show(self, name: str) -> None:
        """Let questions find a part again.

        Parameters
        ----------
        name : str
            Of the part.

        Raises
        ------
        SceneError
            If there is no such part.
        """
        with self._lock:
            self._stage.set_hidden(self._find(name), False)

    def set_surface(self, name: str, *, stiffness: float | None = None, damping: float = 0.0) -> None:
        """Say how a part answers a touch: rigid, or as a spring with a damper. Distances do not change.

        Parameters
        ----------
        name : str
            Of the part.
        stiffness : N/m
            Above 0; None for a rigid part.
        damping : N s/m
            0 or more; of a part that is not rigid.

        Raises
        ------
        SceneError
            If there is no such part, or they are no such numbers.
        """
        with self._lock:
            self._stage.set_surface(self._find(name), *checked_surface(name, stiffness, damping))

    def _assemble(self, parts: list[Part], *, loose: Iterable[int], epoch: int) -> None:
        """Put the arrays of *parts* together, and begin with what they say."""
        hidden = [row for row, part in enumerate(parts) if part.is_hidden]
        pieces = [part.solid._model.part_arrays(0) for part in parts]
        names = tuple(part.name for part in parts)
        model = assemble(
            pieces,
            [part.pose for part in parts],
            loose=list(loose),
            hidden=hidden,
            epoch=epoch,
            names=names,
        )
        for row, part in enumerate(parts):
            part.solid._share(model.part_alone(row))
            write_motion(model.frames[row], part.velocity, part.angular_velocity)
            write_surface(model.frames[row], part.stiffness, part.damping)
        stage, rows = Stage(model), {name: row for row, name in enumerate(names)}
        told = stage.versions.copy()
        # At once: in between nothing is called, so that no signal comes.
        self._parts, self._row, self._stage, self._told = parts, rows, stage, told

    def _part_now(self, row: int) -> Part:
        """A part with its present values; made when somebody asks, not when it moves."""
        self._mend_shape()
        version = self._stage.versions[row]
        if version != self._told[row]:
            self._parts[row] = replace(self._parts[row], **self._stage.values(row))
            self._told[row] = version
        return self._parts[row]

    def save(self, path: Any) -> None:
        """Write the scene as it stands to a file that `load` maps: no tree is made anew then.

        Parameters
        ----------
        path : path
            By custom it ends in ".prox". A file that is there is replaced, at once or not at all.

        Raises
        ------
        SceneError
            If it cannot be written; nothing is left behind then.

        Notes
        -----
        Cost: 176 bytes a face on the disk.
        Thread: parts may be asked and moved meanwhile; what is written is how they stood at one moment.
        """
        while True:
            model = self._current()
            with self._lock:
                if self._stage.current is model:
                    parts = [self._part_now(row) for row in range(len(self._parts))]
                    break
        write_scene(path, model, parts, self.report)

    def deform(self, name: str, vertices: Any) -> None:
        """Give a part another shape with the same faces; its tree is refitted, not rebuilt.

        ``part(name).solid`` is another solid from then on; whoever holds the one before has its old shape.

        Parameters
        ----------
        name : str
            Of the part.
        vertices : (V, 3) float64, m, part's frame
            Where each of ``part(name).solid.mesh.vertices`` is from now on. Those at one position are one
            corner and must stay together. Others may meet.

        Raises
        ------
        SceneError
            If there is no such part.
        MeshError
            If they cannot be used, would tear the surface, or would turn a closed part inside out; nothing
            changes then.

        Notes
        -----
        Sign: told as when the part was made. That was checked then, and is not now: of a part that meets
        itself since, or is pressed quite flat, pseudo-normals may tell the wrong side, even far off.
        Degenerate: faces may lose their area.
        Cost: a fortieth of making the part anew, 12 ms for 300 k faces; the first time somewhat more.
        Answers stay exact; where a part changes much, searches take longer than in a new tree. `contains`
        asks the surface, where it would look into a grid.
        Thread: must not run while another thread asks this scene or a solid of its parts.
        """
        with self._lock:
            row = self._find(name)
            self._part_now(row)
            self._reshape(row, vertices)

    def _reshape(self, row: int, vertices: Any) -> None:
        """Give a part another shape; whoever interrupts this leaves a note, and it is made whole again."""
        part, stage = self._parts[row], self._stage
        stage.current, self._torn = None, (row, LocalFrame.read(stage.frames[row]))
        try:
            solid = deform_part(stage.model_at_work(), row, part.solid, vertices, part.name)
        except MeshError:  # nothing has changed
            self._torn = None
            raise
        self._parts[row] = replace(part, solid=solid)
        stage.reshape(row)
        self._torn = None

    def _mend_shape(self) -> None:
        """Have a part whose deforming was interrupted be as its solid is: as before, or as it was to be."""
        if self._torn is not None:
            row, frame = self._torn
            frame.write(self._stage.frames[row])
            self._reshape(row, self._parts[row].solid.mesh.vertices)

    def _find(self, name: str) -> int:
        try:
            return self._row[name]
        except (KeyError, TypeError):
            known = ", ".join(repr(known) for known in list(self._row)[:10])
            more = "" if len(self._row) <= 10 else f" and {len(self._row) - 10} more"
            raise SceneError(f"no part is named {name!r}; the scene has {known}{more}") from None

    def _rows_of(self, names: list[str]) -> np.ndarray:
        """The rows of parts of those names, each once; mostly they are the very same as at the last move."""
        row_of, last, rows = self._last_moved
        if row_of is self._row and len(last) == len(names) and all(map(is_, last, names)):
            return rows
        rows = np.array([self._find(name) for name in names], np.int64)
        if len(set(names)) < len(names):
            twice = next(name for place, name in enumerate(names) if name in names[:place])
            raise SceneError(f"part {twice!r} is named twice, expected names that differ")
        self._last_moved = self._row, names, rows
        return rows

    def _brought_up_to_date(self) -> Model:
        with self._lock:
            self._mend_shape()
            stage = self._stage
            model = stage.current or stage.update()
            if model is None:
                # All copies are in use by questions that take long, or a tree has outgrown its place.
                now = [self._part_now(row) for row in range(len(self._parts))]
                # Trackers know faces by their slots. A solid that another scene has deformed since would be
                # made anew, with other slots: it takes over those that this scene has.
                present = stage.model_at_work()
                for row, part in enumerate(now):
                    part.solid._share(present.part_alone(row))
                self._assemble(now, loose=stage.loose_rows, epoch=stage.epoch)
                model = self._stage.latest
            return model

    def __repr__(self) -> str:
        faces = sum(part.solid.mesh.face_count for part in self._parts)
        return f"Scene({len(self._parts)} parts, {faces} faces)"


def _made_again(parts: list[Part], report: LoadReport | None, loose: list[int], epoch: int) -> Scene:
    """The copy of a scene: with a lock and arrays of its own, but for those of solids that it shares."""
    scene = Scene.__new__(Scene)
    scene.report, scene._lock = report, fork_safe_lock()
    scene._assemble(parts, loose=loose, epoch=epoch)
    return scene
