"""The contents of a file: as found by its reader, and as used by the rest of the package.

Matrices of scene graphs are split into rigid poses and a remainder that goes into the vertices.
"""

from dataclasses import dataclass, field

import numpy as np

from proximity.errors import MeshFormatError
from proximity.pose import Pose

MAX_PARTS = 20_000
"""Maximum number of parts in one file. A scene of this size takes ten seconds, and a small file can declare
millions."""

STEP_TOLERANCE = 1e-5
"""Maximum distance of triangles from the curved surfaces of a STEP file, m: a tenth of the smallest height
that a fingertip can feel. Half the tolerance gives about 40 % more triangles."""
UNPACKED_LIMIT = 2_000_000_000
"""Default limit of the unpacked size of a 3MF file, bytes."""

UNKNOWN_FACE = -1
"""Face id of triangles whose CAD face is not known."""
RIGID_TOLERANCE = 4 * float(np.finfo(np.float32).eps)
"""Largest difference of stretches from one another, or from 1, that counts as equal: scene graphs are written
in single precision. A rotation within it is replaced by the nearest exact one."""


class DialectError(MeshFormatError):
    """A refusal for the grammar alone, with the number of faces of the file."""

    def __init__(self, message: str, face_count: int) -> None:
        super().__init__(message)
        self.face_count = face_count


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """One mesh at one pose of a file, in metres; the arrays are read-only."""

    name: str  # unique in the file; from the scene graph, with its assemblies if needed; else the stem
    vertices: np.ndarray  # (V, 3) float64, m, in the part's own frame; scale and mirror are baked in
    faces: np.ndarray  # (F, 3) int64, triangles, rows of vertices
    source_faces: np.ndarray  # (F,) int32, zero-based: the file's polygon; STEP: the part's CAD face
    pose: Pose  # world_from_part, m
    is_hidden: bool = False  # in the file


@dataclass(frozen=True, slots=True, eq=False)
class FileContents:
    """Contents of a file, with its format and units.

    Rows of `Geometry.source_faces` count through the whole file in STL, OBJ, PLY and OFF, and within the
    mesh (the product, for STEP) in formats with a scene graph.
    """

    path: str  # as given
    format: str  # "STL binary", "STEP" ...
    units: str  # unit of the file's numbers: a name of UNITS, or several, comma-separated
    units_declared: bool  # False: the file declares none, and the caller's unit was used
    geometries: tuple[Geometry, ...]  # at least one
    notes: tuple[str, ...]  # sentences for the user: parts left out, renamed or assumed
    approximation: float  # m: largest distance of triangles from curved faces; 0 for a file of triangles


@dataclass(slots=True, eq=False)
class RawMesh:
    """One mesh at one pose, in the numbers of the file."""

    name: str  # as in the file; "" if it has none
    vertices: np.ndarray  # (V, 3) float64
    faces: np.ndarray  # (F, 3) int64
    source_faces: np.ndarray  # (F,) int32
    matrix: np.ndarray | None = None  # (4, 4) float64, world from mesh; None: identity
    is_hidden: bool = False  # hidden from queries until it is shown
    above: tuple[str, ...] = ()  # names of the assemblies above it, the outermost first


@dataclass(slots=True, eq=False)
class RawFile:
    """Contents found by a reader, before units, poses and names."""

    format: str
    meshes: list[RawMesh]
    units: str | None = None  # None: the file declares none
    metres_per_number: float | None = None  # if `units` differs from it (STEP comes in metres)
    notes: list[str] = field(default_factory=list)
    approximation: float = 0.0  # m


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """The bytes of a file and where they came from."""

    path: str  # as given, for messages and neighbouring files
    data: bytes


def check_part_count(count: int) -> None:
    """Raise if a file places an implausible number of parts, before they are made."""
    if count > MAX_PARTS:
        raise MeshFormatError(f"it places {count} parts, expected at most {MAX_PARTS}")


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A matrix as *turn and shift* after *deform*."""

    rotation: np.ndarray  # (3, 3), exact
    translation: np.ndarray  # (3,), in the units of the file
    scale: float  # uniform, negative if it mirrors; 1.0 if `stretch` is given
    stretch: np.ndarray | None  # (3, 3), if the scale is not uniform

    @property
    def is_mirrored(self) -> bool:
        """Whether faces must be reversed to stay oriented outwards."""
        return self.scale < 0.0 or (self.stretch is not None and bool(np.linalg.det(self.stretch) < 0.0))

    def part_vertices(self, vertices: np.ndarray, metres_per_number: float) -> np.ndarray:
        """Return vertices deformed and in metres; the same array if nothing changes.

        *vertices*: (V, 3) units of the file.
        """
        factor = self.scale * metres_per_number
        with np.errstate(over="ignore", invalid="ignore"):  # infinities are found and named later
            deformed = vertices if self.stretch is None else vertices @ self.stretch.T
            return deformed if factor == 1.0 else deformed * factor

    def pose(self, metres_per_number: float) -> Pose:
        """Return world_from_part, in metres."""
        return Pose(self.rotation, self.translation * metres_per_number)


def place(matrix: np.ndarray | None) -> Placement:
    """Split a matrix into a rigid motion after a deformation.

    *matrix*: (4, 4) or None; world from mesh, acting on columns; None is the identity.
    """
    if matrix is None:
        return Placement(np.eye(3), np.zeros(3), 1.0, None)
    if not np.isfinite(matrix).all():
        raise MeshFormatError("it is placed by a matrix that is not finite")
    if np.abs(matrix[3] - (0.0, 0.0, 0.0, 1.0)).max() > RIGID_TOLERANCE:
        raise MeshFormatError(f"the last row of its matrix is {matrix[3].tolist()}, expected [0, 0, 0, 1]")
    linear, translation = matrix[:3, :3], matrix[:3, 3].copy()
    left, stretches, right = np.linalg.svd(linear)
    if stretches[2] <= RIGID_TOLERANCE * stretches[0]:
        raise MeshFormatError("it is placed by a matrix that flattens it, expected an invertible one")
    sign = 1.0 if np.linalg.det(left) * np.linalg.det(right) > 0.0 else -1.0
    rotation = sign * (left @ right)
    if stretches[0] - stretches[2] > RIGID_TOLERANCE * stretches[0]:
        return Placement(rotation, translation, 1.0, sign * (right.T * stretches) @ right)
    scale = float(stretches[1])  # exact for a diagonal matrix
    return Placement(
        rotation, translation, sign * (1.0 if abs(scale - 1.0) <= RIGID_TOLERANCE else scale), None
    )
