"""A solid in a scene, with its name, pose, motion and surface; and the report of loading."""

from dataclasses import dataclass, field, replace
from math import pi
from typing import TYPE_CHECKING, Any

import numpy as np

from proximity.checks import as_float64, is_ready, not_negative, positive, refuse_trimesh
from proximity.errors import ArgumentError, PoseError, SceneError
from proximity.mesh.body_split import Repairs, split_bodies
from proximity.mesh.bvh import common_frame
from proximity.pose import Pose, quaternion_hint
from proximity.scene.model.scene_state import FARTHEST_MOVE, FASTEST_MOVE, first_unfit_move
from proximity.scene.queries.html_table import html_table
from proximity.scene.solid import Solid

if TYPE_CHECKING:
    from proximity.scene.walls.thin_walls import ThinWalls

PART_COLUMNS = ("name", "faces", "sign by", "watertight", "position, m", "hidden", "stiffness, N/m")
NO_REPAIRS = Repairs(0, 0, 0.0, 0, 0, 0, False)
NO_DEVIATIONS = np.zeros(0)
NO_DEVIATIONS.flags.writeable = False
NO_VELOCITY = np.zeros(3)
NO_VELOCITY.flags.writeable = False
NO_VELOCITIES = np.zeros((0, 3))
"""Represents zero velocities of all parts that are moved."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A solid with a name, a pose in the scene, and the origin of its faces.

    ``pose`` is world_from_part. ``velocity``, m/s, is the velocity of the part's origin, and
    ``angular_velocity``, rad/s, is about that origin; both are in the scene's frame. ``source_faces`` has,
    for each row of ``solid.mesh.faces``, the row of the face in the file or in the caller's array.
    ``repairs`` counts the repairs on loading. Queries and ticks ignore a part if ``is_hidden`` is set.
    ``stiffness``, N/m, and ``damping``, N s/m, describe a deformable part; a rigid part has a ``stiffness``
    of None. ``deviation``, m, is an upper bound of the distance between the triangles and the CAD surfaces of
    a STEP file, in both directions; ``inf`` if no bound is known, as for a deformed part; 0 for a file of
    triangles. ``deviation_by_face[part.source_faces[face_id]]`` is that of one CAD face; it is empty for a
    file of triangles.
    """

    name: str
    solid: Solid
    pose: Pose  # world_from_part; a scene takes a (4, 4) matrix as well
    source_faces: np.ndarray  # (F,) int32, row of the caller's faces, or of the file's
    repairs: Repairs = NO_REPAIRS  # on loading
    velocity: np.ndarray = field(default_factory=lambda: NO_VELOCITY)  # (3,) m/s, of its origin, in the scene
    angular_velocity: np.ndarray = field(default_factory=lambda: NO_VELOCITY)  # (3,) rad/s, about its origin
    is_hidden: bool = False  # ignored by queries
    stiffness: float | None = None  # N/m; None: rigid
    damping: float = 0.0  # N s/m, of a part that is not rigid
    deviation: float = 0.0  # m, from the CAD surfaces
    deviation_by_face: np.ndarray = field(default_factory=lambda: NO_DEVIATIONS)  # (K,) m, of each CAD face

    def thin_places(
        self,
        *,
        below: float | None = None,
        resolution: float | None = None,
        wall_angle: float = pi / 4,
        workers: int = 1,
    ) -> "ThinWalls":
        """Return the thinnest walls of the part, with bounds of the least thickness over its whole surface.

        The thickness is the length of a ray against the normal of a face, up to where it leaves the material.
        It is that of a wall if the two faces there are parallel within *wall_angle*. Other rays, such as
        those next to the edge of a side with a draft, belong to corners.

        Parameters
        ----------
        below : m
            Limit: walls thinner than this are thin. Default: the thinnest walls are listed without a limit.
        resolution : m
            Longest edge of the triangles into which the surface is cut for samples, which give the share and
            the positions. Default: from the area, about 25 000 samples. The bounds do not depend on it.
        wall_angle : rad
            Largest angle between the two sides of a wall, up to 1.5. A wedge with a smaller angle has the
            least thickness 0, at its edge.
        workers : int
            Threads; -1 for all cores.

        Returns
        -------
        ThinWalls
            Bounds of the least thickness, the decision about the limit, the thinnest positions, the samples.

        Raises
        ------
        ArgumentError
            If an argument is out of range, or *resolution* needs more than a million samples.
        NotWatertightError
            If the part has no inside.

        Notes
        -----
        Degenerate: two faces in front of each other are left out if their common part, seen along the normal,
        is narrower than a millionth of the part's size. A wall thinner than the limit by less than a
        ten-millionth of the size, and a hundredth of the limit, keeps it, since files have single precision.
        Cost: 1 to 5 s for 50 thousand faces on one core, more for many needles.
        Source: the bound is the least value of linear functions on polygons, see `scene.walls.facing_faces`.
        """
        from proximity.scene.walls.thin_walls import find_thin_walls  # not needed by queries

        return find_thin_walls(self, below, resolution, wall_angle, workers)

    def __repr__(self) -> str:
        return f"Part({self.name!r}, {self.solid.mesh.face_count} faces)"

    def _repr_html_(self) -> str:
        return html_table(repr(self), PART_COLUMNS, [part_cells(self)])


@dataclass(frozen=True, slots=True)
class LoadReport:
    """The file of a scene, its units, and notes for the user.

    Parameters
    ----------
    path : str
        Name of the file.
    format : str
        Name of the format, for example "STL, binary".
    units : str
        Unit of the file's coordinates.
    units_declared : bool
        Whether the file declares its unit. If not, *units* is the caller's.
    notes : tuple of str
        Sentences for the user.
    approximation : float, m
        Largest deviation of triangles from the curved faces of a STEP file; 0 for a file of triangles.
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


def part_cells(part: Part) -> tuple[Any, ...]:
    """Return the values of `PART_COLUMNS`."""
    solid, stiffness = part.solid, "rigid" if part.stiffness is None else part.stiffness
    texts = part.name, solid.mesh.face_count, solid.sign_method.value, "yes" if solid.is_watertight else "no"
    return *texts, Pose.of(part.pose).translation, "yes" if part.is_hidden else "no", stiffness


def checked_part(given: Any) -> Part:
    """Return a part for a scene, after validating all fields that a user may set.

    *given*: a part, or a `Solid`, which becomes a part at the identity pose.
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
        deviation=not_negative(
            f"deviation of part {part.name!r}", part.deviation, "metres", may_be_infinite=True
        ),
    )


def with_deviations(part: Part, deviations: np.ndarray | None) -> Part:
    """Return a part with its deviation from CAD faces.

    *deviations*: (K,) m, of each CAD face; None for a file of triangles. Welding moves the triangles, too.
    """
    if deviations is None:
        return part
    if part.repairs.weld_distance:
        deviations = deviations + part.repairs.weld_distance
        deviations.flags.writeable = False
    deviation = largest_deviation(deviations, part.source_faces)
    return replace(part, deviation=deviation, deviation_by_face=deviations)


def largest_deviation(by_face: np.ndarray, source_faces: np.ndarray) -> float:
    """Return the largest deviation of the CAD faces of a part, m; 0 for a file of triangles."""
    return float(by_face[np.unique(source_faces)].max(initial=0.0)) if len(by_face) else 0.0


def deformed(part: Part, solid: Solid) -> Part:
    """Return a part with the solid of another shape, which has no CAD surfaces."""
    count = len(part.deviation_by_face)
    if not count:
        return replace(part, solid=solid)
    return replace(part, solid=solid, deviation=np.inf, deviation_by_face=np.full(count, np.inf))


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

    *source_faces*: the caller's id of each row of *faces*; by default the row's number. *name*: name of the
    part. If there are several bodies, their names end in a number from 1 on.
    """
    bodies = split_bodies(vertices, faces, source_faces)
    lower = np.min([body.mesh.vertices.min(axis=0) for body in bodies], axis=0)
    upper = np.max([body.mesh.vertices.max(axis=0) for body in bodies], axis=0)
    frame = common_frame(lower, upper) if len(bodies) > 1 else None
    count, parts = len(bodies), []
    for number in range(1, count + 1):
        body = bodies.pop(0)  # frees each body as soon as its solid is made
        own = name if count == 1 else f"{name}.{number}"
        solid = Solid._of_mesh(body.mesh, body.topology, own, frame)
        parts.append(Part(own, solid, Pose(), body.source_faces, body.repairs))
    return parts


# --- moves and surfaces, as callers give them ---


def checked_moves(
    names: list[str], poses: Any, velocities: Any, angular_velocities: Any
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return validated matrices (K, 4, 4) and velocities (K, 3) for the named parts.

    The arguments are (K, 4, 4) or (K, 3) array-like. *poses* may also be a list of Pose. *velocities* or
    *angular_velocities* may be None, for which (0, 3) is returned.
    """
    matrices = _as_matrices(names, poses)
    linear = _as_velocities(names, velocities, "velocities")
    angular = _as_velocities(names, angular_velocities, "angular_velocities")
    row = first_unfit_move(matrices, linear, angular)
    if row >= 0:
        # Validate each one, to raise the error of the one that is invalid.
        matrices = np.array([checked_matrix(*each) for each in zip(names, matrices, strict=True)])
        for name, velocity in zip(names, linear, strict=False):
            checked_velocity(name, velocity, "velocity", "m/s")
        for name, velocity in zip(names, angular, strict=False):
            checked_velocity(name, velocity, "angular_velocity", "rad/s")
    return matrices, linear, angular


def checked_move(
    name: str, pose: Any, velocity: Any, angular_velocity: Any
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the results of `checked_moves` for one part.

    *pose*: (4, 4) array-like; *velocity*, *angular_velocity*: (3,) array-like.
    """
    linear = checked_velocity(name, velocity, "velocity", "m/s").reshape(1, 3)
    angular = checked_velocity(name, angular_velocity, "angular_velocity", "rad/s").reshape(1, 3)
    matrix = pose.matrix if isinstance(pose, Pose) else pose
    if not isinstance(matrix, np.ndarray) or matrix.shape != (4, 4) or matrix.dtype.kind != "f":
        matrix = checked_matrix(name, pose)
    matrices = np.array(matrix, np.float64, order="C").reshape(1, 4, 4)
    if first_unfit_move(matrices, linear, angular) >= 0:
        matrices = np.ascontiguousarray(checked_matrix(name, pose)).reshape(1, 4, 4)
    return matrices, linear, angular


def checked_matrix(name: str, pose: Any) -> np.ndarray:
    """Return a validated pose as a (4, 4) matrix.

    *pose*: (4, 4) array-like.
    """
    try:
        pose = Pose.of(pose)
    except PoseError as unfit:
        raise PoseError(f"part {name!r}: {unfit}") from unfit
    distance = float(np.abs(pose.translation).max())
    if not distance <= FARTHEST_MOVE:
        raise PoseError(
            f"part {name!r} would be moved by {distance:.3g} m, which is farther than can be computed with"
        )
    return np.asarray(pose.matrix)


def checked_velocity(name: str, velocity: Any, what: str, unit: str) -> np.ndarray:
    """Return a validated copy of a velocity, (3,) float64.

    *velocity*: (3,) array-like.
    """
    expected = f"3 finite numbers, {unit}"
    array = as_float64(velocity, f"entries of {what} of part {name!r}", expected=expected)
    if array.shape != (3,):
        raise ArgumentError(f"{what} of part {name!r} has shape {array.shape}, expected {expected}")
    if not np.isfinite(array).all():
        raise ArgumentError(f"{what} of part {name!r} is {array.tolist()}, expected {expected}")
    if np.abs(array).max() > FASTEST_MOVE:
        most = f"at most {FASTEST_MOVE:g} {unit} along each axis"
        raise ArgumentError(f"{what} of part {name!r} is {array.tolist()}, expected {most}")
    return array.copy()


def checked_surface(name: str, stiffness: Any, damping: Any) -> tuple[float | None, float]:
    """Return the validated stiffness, N/m, and damping, N s/m, of a part.

    The stiffness of a rigid part is None, and its damping must be 0.
    """
    damping = not_negative(f"damping of part {name!r}", damping, "N s/m")
    if stiffness is not None:
        unit = "N/m, or None for a rigid part"
        return positive(f"stiffness of part {name!r}", stiffness, unit), damping
    if damping:
        raise ArgumentError(f"part {name!r} is rigid (no stiffness), but has a damping of {damping:g} N s/m")
    return None, 0.0


def _as_matrices(names: list[str], poses: Any) -> np.ndarray:
    if is_ready(poses, (len(names), 4, 4)):
        return np.asarray(poses)
    if isinstance(poses, (list, tuple)) and any(isinstance(pose, Pose) for pose in poses):
        if len(poses) != len(names):
            raise PoseError(
                f"there are {len(poses)} poses for {len(names)} parts, expected one for each part"
            )
        return np.array([checked_matrix(*each) for each in zip(names, poses, strict=True)])
    expected = f"numbers of shape ({len(names)}, 4, 4)"
    matrices = as_float64(poses, "entries of poses", expected=expected)
    if not names and not matrices.size:
        return matrices.reshape(0, 4, 4)
    if matrices.shape != (len(names), 4, 4):
        raise PoseError(
            f"poses have shape {matrices.shape}, expected ({len(names)}, 4, 4): one for each part named"
            + quaternion_hint(matrices)
        )
    return matrices


def _as_velocities(names: list[str], velocities: Any, what: str) -> np.ndarray:
    if velocities is None:
        return NO_VELOCITIES
    if is_ready(velocities, (len(names), 3)):
        return np.asarray(velocities)
    expected = f"numbers of shape ({len(names)}, 3)"
    array = as_float64(velocities, f"entries of {what}", expected=expected)
    if array.shape != (len(names), 3):
        raise ArgumentError(
            f"{what} have shape {array.shape}, expected ({len(names)}, 3): one for each part named"
        )
    return array
