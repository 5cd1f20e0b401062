"""Parts with poses: the same queries as of one solid, answered for all of them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from proximity.bodies import Repairs, split_bodies
from proximity.bvh import LARGEST_COORDINATE
from proximity.deforming import deform_part
from proximity.errors import PoseError, SceneError
from proximity.kernels.layout import BOX_LOWER, BOX_UPPER
from proximity.model import Model, assemble
from proximity.part_arrays import common_frame
from proximity.pose import Pose
from proximity.queries import Queries
from proximity.solid import Solid


@dataclass(frozen=True, slots=True)
class LoadReport:
    """Where a scene came from, and in which units."""

    path: str
    format: str  # as people say it: "STL, binary"
    units: str  # of the file's coordinates
    units_declared: bool  # False: the file names none, *units* is what the caller said
    notes: tuple[str, ...]  # sentences a user should know


NO_REPAIRS = Repairs(0, 0, 0.0, 0, 0, 0, False)


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A solid with a name, a place in the scene, and the way back to where its faces came from."""

    name: str
    solid: Solid
    pose: Pose  # world_from_part; a scene takes a (4, 4) matrix as well
    source_faces: np.ndarray  # (F,) int32, row of the caller's faces, or of the file's
    repairs: Repairs = NO_REPAIRS  # what was mended on the way

    def __repr__(self) -> str:
        return f"Part({self.name!r}, {self.solid.mesh.face_count} faces)"


class Scene(Queries):
    """Parts that are asked together. Poses change by `move`, shapes by `deform`; nothing else does.

    Parameters
    ----------
    parts : iterable of Part or Solid
        At least one; names must differ. A `Solid` becomes a part at the identity pose.
    report : LoadReport
        Where it came from, if from a file.

    Raises
    ------
    SceneError
        If there are no parts, two have one name, or something else than parts is given.
    PoseError
        If a part's pose is no rigid transform.

    Notes
    -----
    Thread: many threads may ask at once; neither `move` nor `deform` may run meanwhile.
    """

    report: LoadReport | None

    def __init__(self, parts: Iterable[Part | Solid], *, report: LoadReport | None = None) -> None:
        if not isinstance(parts, Iterable):
            raise SceneError(f"a scene is made of a list of parts, not of one {type(parts).__name__}")
        self._parts = [_as_part(part) for part in parts]
        if not self._parts:
            raise SceneError("a scene has no parts, expected at least one")
        self._row: dict[str, int] = {}
        for row, part in enumerate(self._parts):
            if not isinstance(part.name, str):
                raise SceneError(f"part {row} is named {part.name!r}, expected text")
            if part.name in self._row:
                raise SceneError(
                    f"parts {self._row[part.name]} and {row} are both named {part.name!r}, "
                    "expected names that differ"
                )
            self._row[part.name] = row
        self.report = report
        pieces = [part.solid._model.part_arrays(0) for part in self._parts]
        self._model = assemble(pieces, [part.pose for part in self._parts])
        for row, part in enumerate(self._parts):
            part.solid._share(self._model.part_alone(row))
        self._moved: dict[int, Pose] = {}

    @classmethod
    def from_mesh(cls, vertices: Any, faces: Any, *, name: str = "mesh") -> "Scene":
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
        return cls(parts_of_mesh(vertices, faces, name=name))

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts, at their present poses."""
        return tuple(self._parts)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner of the box around all parts, m, (3,) each."""
        row = self._current().frames[-1]
        return row[BOX_LOWER : BOX_LOWER + 3].copy(), row[BOX_UPPER : BOX_UPPER + 3].copy()

    @property
    def memory_bytes(self) -> int:
        """Bytes held by meshes and trees."""
        return self._model.memory_bytes + sum(part.solid._mesh_bytes for part in self._parts)

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
        return self._parts[self._find(name)]

    def move(self, name: str, pose: Any) -> None:
        """Put a part somewhere else; no tree is rebuilt but the small one over parts.

        Parameters
        ----------
        name : str
            Of the part.
        pose : Pose or (4, 4) float64
            ``world_from_part``, metres.

        Raises
        ------
        SceneError
            If there is no such part.
        PoseError
            If it is no rigid transform.
        """
        row = self._find(name)
        pose = Pose.of(pose)
        if not np.abs(pose.translation).max() <= LARGEST_COORDINATE / 4.0:
            raise PoseError(
                f"part {name!r} would be moved by {np.abs(pose.translation).max():.3g} m, "
                "which is farther than can be computed with"
            )
        self._parts[row] = replace(self._parts[row], pose=pose)
        self._moved[row] = pose

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
        Sign: told as when the part was made. That was checked then, and is not now: where a deformed part
        meets itself, a pseudo-normal may tell the wrong side there.
        Degenerate: faces may lose their area.
        Cost: a fortieth of making the part anew, 12 ms for 300 k faces; the first time somewhat more.
        Answers stay exact; where a part changes much, searches take longer than in a new tree. `contains`
        asks the surface, where it would look into a grid.
        Thread: must not run while another thread asks this scene or a solid of its parts.
        """
        row = self._find(name)
        part = self._parts[row]
        solid = deform_part(self._model, row, part.solid, vertices, name)
        self._parts[row] = replace(part, solid=solid)
        # Its box has changed: the tree over the parts is made anew before the next question.
        self._moved[row] = part.pose

    def _find(self, name: str) -> int:
        try:
            return self._row[name]
        except (KeyError, TypeError):
            known = ", ".join(repr(known) for known in list(self._row)[:10])
            more = "" if len(self._row) <= 10 else f" and {len(self._row) - 10} more"
            raise SceneError(f"no part is named {name!r}; the scene has {known}{more}") from None

    def _current(self) -> Model:
        if self._moved:
            self._model = self._model.moved(self._moved)
            self._moved = {}
        return self._model

    def __repr__(self) -> str:
        faces = sum(part.solid.mesh.face_count for part in self._parts)
        return f"Scene({len(self._parts)} parts, {faces} faces)"


def _as_part(part: Any) -> Part:
    if isinstance(part, Part):
        if not isinstance(part.solid, Solid):
            raise SceneError(f"part {part.name!r} holds a {type(part.solid).__name__}, expected a Solid")
        return part if isinstance(part.pose, Pose) else replace(part, pose=Pose.of(part.pose))
    if isinstance(part, Solid):
        rows = np.arange(part.mesh.face_count, dtype=np.int32)
        rows.flags.writeable = False
        return Part(part.name, part, Pose(), rows)
    raise SceneError(f"a scene is made of Part and Solid, not of {type(part).__name__}")


def parts_of_mesh(
    vertices: Any, faces: Any, *, source_faces: Any = None, name: str = "mesh", pose: Pose | None = None
) -> list[Part]:
    """Return the bodies of a mesh as parts.

    Parameters
    ----------
    vertices, faces
        As `Scene.from_mesh`.
    source_faces : (F,) integers
        What the rows of *faces* are called outside; their numbers where not given.
    name : str
        Of the part; several bodies are numbered from 1.
    pose : Pose
        ``world_from_part``.
    """
    bodies = split_bodies(vertices, faces, source_faces)
    pose = Pose() if pose is None else pose
    lower = np.min([body.mesh.vertices.min(axis=0) for body in bodies], axis=0)
    upper = np.max([body.mesh.vertices.max(axis=0) for body in bodies], axis=0)
    frame = common_frame(lower, upper) if len(bodies) > 1 else None
    parts = []
    for number, body in enumerate(bodies, start=1):
        own = name if len(bodies) == 1 else f"{name}.{number}"
        solid = Solid(body.mesh.vertices, body.mesh.faces, name=own, frame=frame)
        parts.append(Part(own, solid, pose, body.source_faces, body.repairs))
    return parts
