"""Contents of a file, in the form that its reader returns and in the form that the rest of the package uses.

Matrices of scene graphs are split into rigid poses and a remainder that is applied to the vertices.
"""

from dataclasses import dataclass, field

import numpy as np

from proximity.errors import MeshFormatError
from proximity.pose import Pose

MAX_PARTS = 20_000
"""Maximum number of parts in one file. A scene of this size takes ten seconds, and a small file can declare
millions."""

STEP_TOLERANCE = 1e-5
"""Maximum distance of triangles from the curved surfaces of a STEP file, m. It is a tenth of the smallest
height that a fingertip can feel. Half the tolerance gives about 40 % more triangles."""
UNPACKED_LIMIT = 2_000_000_000
"""Default limit of the unpacked size of a 3MF file, bytes."""

UNKNOWN_FACE = -1
"""Number of the CAD face of triangles for which it is unknown."""
RIGID_TOLERANCE = 4 * float(np.finfo(np.float32).eps)
"""Maximum difference of stretches from one another, or from 1, at which they count as equal, because scene
graphs are written in single precision. A rotation within it is replaced by the nearest exact one."""


class DialectError(MeshFormatError):
    """Raised for a file whose grammar alone is not supported, with the number of its faces."""

    def __init__(self, message: str, face_count: int) -> None:
        super().__init__(message)
        self.face_count = face_count


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """One mesh at one pose, in metres. The arrays are read-only."""

    name: str  # unique; from the scene graph, with assemblies if needed, or the file's stem
    vertices: np.ndarray  # (V, 3) float64, m, in the part's own frame; scale and mirror are baked in
    faces: np.ndarray  # (F, 3) int64, triangles, rows of vertices
    source_faces: np.ndarray  # (F,) int32, row of the polygon in the file; STEP: of the CAD face in the part
    pose: Pose  # world_from_part, m
    is_hidden: bool = False  # whether it is hidden in the file
    deviations: np.ndarray | None = None  # (K,) m, of triangles from each CAD face; None: triangles are exact


@dataclass(frozen=True, slots=True, eq=False)
class FileContents:
    """Contents of a file, with its format and units.

    In STL, OBJ, PLY and OFF the values of `Geometry.source_faces` count through the whole file. In formats
    with a scene graph they count within the mesh, and for STEP within the product.
    """

    path: str  # path as given
    format: str  # "STL binary", "STEP" ...
    units: str  # unit of the numbers, a name of UNITS, or several separated by commas
    units_declared: bool  # False if the caller's unit was used, because the file declares none
    geometries: tuple[Geometry, ...]  # at least one
    notes: tuple[str, ...]  # sentences for the user on omitted or renamed parts and on assumptions
    approximation: float  # m, maximum distance of triangles from curved faces; 0 for a file of triangles


@dataclass(slots=True, eq=False)
class RawMesh:
    """One mesh at one pose, in the units of the file."""

    name: str  # name in the file, or ""
    vertices: np.ndarray  # (V, 3) float64
    faces: np.ndarray  # (F, 3) int64
    source_faces: np.ndarray  # (F,) int32
    matrix: np.ndarray | None = None  # (4, 4) float64, world from mesh; None: identity
    is_hidden: bool = False  # hidden from queries until it is shown
    above: tuple[str, ...] = ()  # names of the assemblies above it, the outermost first
    deviations: np.ndarray | None = None  # (K,) of each CAD face, or None if triangles are the shape


@dataclass(slots=True, eq=False)
class RawFile:
    """Contents that a reader returns, before units, poses and names are processed."""

    format: str
    meshes: list[RawMesh]
    units: str | None = None  # None: the file declares none
    metres_per_number: float | None = None  # if it is not `units` (STEP comes in metres)
    notes: list[str] = field(default_factory=list)
    approximation: float = 0.0  # m


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """Bytes of a file, and its path."""

    path: str  # path as given, for messages and neighbouring files
    data: bytes


def check_part_count(count: int) -> None:
    """Raise an error if a file places an implausible number of parts. Called before they are created."""
    if count > MAX_PARTS:
        raise MeshFormatError(f"it places {count} parts, expected at most {MAX_PARTS}")


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A matrix that is split into a deformation and a rigid motion, applied in this order."""

    rotation: np.ndarray  # (3, 3), exact
    translation: np.ndarray  # (3,), in the units of the file
    scale: float  # uniform scale, negative if it mirrors; 1.0 if `stretch` is given
    stretch: np.ndarray | None  # (3, 3), if the scale is not uniform

    @property
    def is_mirrored(self) -> bool:
        """Whether the matrix mirrors, so that faces must be reversed to stay oriented outwards."""
        return self.scale < 0.0 or (self.stretch is not None and bool(np.linalg.det(self.stretch) < 0.0))

    def part_vertices(self, vertices: np.ndarray, metres_per_number: float) -> np.ndarray:
        """Return the deformed vertices in metres. If nothing changes, return the same array.

        *vertices*: (V, 3) in units of the file.
        """
        factor = self.scale * metres_per_number
        with np.errstate(over="ignore", invalid="ignore"):  # infinities are reported later
            deformed = vertices if self.stretch is None else vertices @ self.stretch.T
            return deformed if factor == 1.0 else deformed * factor

    def pose(self, metres_per_number: float) -> Pose:
        """Return the rigid motion as a pose world_from_part, in metres."""
        return Pose(self.rotation, self.translation * metres_per_number)


def place(matrix: np.ndarray | None) -> Placement:
    """Split a matrix into a deformation and a rigid motion after it.

    *matrix*: (4, 4), world from mesh, acting on columns; None is the identity.
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
