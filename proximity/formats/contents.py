"""Contents of a file, as found by its reader and as used by the rest of the package."""

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
"""CAD face of triangles that do not name theirs."""


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
    approximation: float  # m: how far triangles may be from curved faces; 0 where the file has triangles


@dataclass(slots=True, eq=False)
class RawMesh:
    """One mesh at one pose, in the numbers of the file."""

    name: str  # as the file has it; "" where it has none
    vertices: np.ndarray  # (V, 3) float64
    faces: np.ndarray  # (F, 3) int64
    source_faces: np.ndarray  # (F,) int32
    matrix: np.ndarray | None = None  # (4, 4) float64, world from mesh; None: identity
    is_hidden: bool = False  # a part that no query finds until it is shown
    above: tuple[str, ...] = ()  # names of the assemblies that hold it, the outermost first


@dataclass(slots=True, eq=False)
class RawFile:
    """Contents found by a reader, before units, poses and names."""

    format: str
    meshes: list[RawMesh]
    units: str | None = None  # None: the file declares none
    metres_per_number: float | None = None  # where `units` says another (STEP comes in metres)
    notes: list[str] = field(default_factory=list)
    approximation: float = 0.0  # m


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """The bytes of a file and where they came from."""

    path: str  # as given, for messages and neighbouring files
    data: bytes


def check_part_count(count: int) -> None:
    """Raise if a file places more than the maximum number of parts, before they are made."""
    if count > MAX_PARTS:
        raise MeshFormatError(f"it places {count} parts, expected at most {MAX_PARTS}")
