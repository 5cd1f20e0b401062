"""A solid in a scene: name, pose, motion, and how it answers a touch; and the report of loading."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from proximity.checks import refuse_trimesh
from proximity.errors import SceneError
from proximity.mesh.body_split import Repairs, split_bodies
from proximity.mesh.part_arrays import common_frame
from proximity.pose import Pose
from proximity.scene.part_motion import checked_matrix, checked_surface, checked_velocity
from proximity.scene.solid import Solid

NO_REPAIRS = Repairs(0, 0, 0.0, 0, 0, 0, False)
NO_VELOCITY = np.zeros(3)
NO_VELOCITY.flags.writeable = False


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A solid with a name, a pose in the scene, and references to where its faces came from.

    ``pose`` is world_from_part. ``velocity``, m/s, is that of the part's origin, ``angular_velocity``, rad/s,
    about it, both in the scene's frame. ``source_faces`` has, for each row of ``solid.mesh.faces``, the row
    of the file's or the caller's faces; ``repairs`` counts what was repaired on loading. A part with
    ``is_hidden`` is ignored by queries and ticks. ``stiffness``, N/m, and ``damping``, N s/m, are those of
    a deformable part; a ``stiffness`` of None is rigid.
    """

    name: str
    solid: Solid
    pose: Pose  # world_from_part; a scene takes a (4, 4) matrix as well
    source_faces: np.ndarray  # (F,) int32, row of the caller's faces, or of the file's
    repairs: Repairs = NO_REPAIRS  # what was mended on loading
    velocity: np.ndarray = field(default_factory=lambda: NO_VELOCITY)  # (3,) m/s, of its origin, in the scene
    angular_velocity: np.ndarray = field(default_factory=lambda: NO_VELOCITY)  # (3,) rad/s, about its origin
    is_hidden: bool = False  # no question finds it
    stiffness: float | None = None  # N/m; None: rigid
    damping: float = 0.0  # N s/m, of a part that is not rigid

    def __repr__(self) -> str:
        return f"Part({self.name!r}, {self.solid.mesh.face_count} faces)"


@dataclass(frozen=True, slots=True)
class LoadReport:
    """The file and the units that a scene came from.

    Parameters
    ----------
    path : str
        Name of the file.
    format : str
        Name of the format, for example "STL, binary".
    units : str
        Unit of the file's coordinates.
    units_declared : bool
        False: the file declares none, and *units* is that of the caller.
    notes : tuple of str
        Sentences for the user.
    approximation : float, m
        How far triangles may be from the curved faces of a STEP file; 0 where the file has triangles.
    """

    path: str
    format: str
    units: str
    units_declared: bool
    notes: tuple[str, ...]
    approximation: float = 0.0

    def __repr__(self) -> str:
        units = f"{self.units} {'declared' if self.units_declared else 'assumed'}"
        return f"LoadReport({self.path!r}, {self.format}, {units}, {len(self.notes)} notes)"


def checked_part(given: Any) -> Part:
    """Return a part to put into a scene, with everything that a user may have set looked at.

    *given*: a `Solid` becomes a part at the identity pose.
    """
    part = _as_part(given)
    checked_matrix(part.name, part.pose)
    if not isinstance(part.repairs, Repairs):
        raise SceneError(f"repairs of part {part.name!r} are {part.repairs!r}, expected Repairs")
    stiffness, damping = checked_surface(part.name, part.stiffness, part.damping)
    velocity = checked_velocity(part.name, part.velocity, "velocity", "m/s")
    angular_velocity = checked_velocity(part.name, part.angular_velocity, "angular_velocity", "rad/s")
    velocity.flags.writeable = angular_velocity.flags.writeable = False
    return replace(
        part,
        velocity=velocity,
        angular_velocity=angular_velocity,
        is_hidden=bool(part.is_hidden),
        stiffness=stiffness,
        damping=damping,
    )


def _as_part(part: Any) -> Part:
    if isinstance(part, Part):
        if not isinstance(part.solid, Solid):
            raise SceneError(f"part {part.name!r} holds a {type(part.solid).__name__}, expected a Solid")
        return part if isinstance(part.pose, Pose) else replace(part, pose=Pose.of(part.pose))
    if isinstance(part, Solid):
        rows = np.arange(part.mesh.face_count, dtype=np.int32)
        rows.flags.writeable = False
        return Part(part.name, part, Pose(), rows)
    refuse_trimesh(part)
    raise SceneError(f"a scene is made of Part and Solid, not of {type(part).__name__}")


def parts_of_mesh(vertices: Any, faces: Any, *, source_faces: Any = None, name: str = "mesh") -> list[Part]:
    """Return the bodies of a mesh as parts.

    *source_faces*: what the rows of *faces* are called outside; their numbers where not given. *name*: of the
    part; several bodies are numbered from 1.
    """
    bodies = split_bodies(vertices, faces, source_faces)
    lower = np.min([body.mesh.vertices.min(axis=0) for body in bodies], axis=0)
    upper = np.max([body.mesh.vertices.max(axis=0) for body in bodies], axis=0)
    frame = common_frame(lower, upper) if len(bodies) > 1 else None
    count, parts = len(bodies), []
    for number in range(1, count + 1):
        body = bodies.pop(0)  # what is made of it has not all to be there at once
        own = name if count == 1 else f"{name}.{number}"
        solid = Solid._of_mesh(body.mesh, body.topology, own, frame)
        parts.append(Part(own, solid, Pose(), body.source_faces, body.repairs))
    return parts
