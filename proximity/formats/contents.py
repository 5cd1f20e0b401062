"""The contents of a file: as its reader found them, and as the rest of the package takes them."""

from dataclasses import dataclass, field

import numpy as np

from proximity.errors import MeshFormatError
from proximity.pose import Pose

MOST_PARTS = 20_000
"""Parts that one file may place. A scene of so many takes ten seconds, and a small file can name millions."""

STEP_TOLERANCE = 1e-5
"""How far flat triangles may leave the curved surfaces of a STEP file, m: a tenth of what a fingertip can
feel. Halving it gives about 1.4 times as many triangles."""
UNPACKED_LIMIT = 2_000_000_000
"""Bytes that a 3MF file may unpack to, unless the caller says otherwise."""

UNKNOWN_FACE = -1
"""Stands for the CAD faces of a part whose triangles do not say which they belong to."""


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """One mesh at one place of a file, in metres; the arrays are read-only."""

    name: str  # unique in the file; from the scene graph, with its assemblies if need be; else the stem
    vertices: np.ndarray  # (V, 3) float64, m, in the part's own frame; scale and mirror are baked in
    faces: np.ndarray  # (F, 3) int64, triangles, rows of vertices
    source_faces: np.ndarray  # (F,) int32, zero-based: the file's polygon; STEP: the part's CAD face
    pose: Pose  # world_from_part, m
    is_hidden: bool = False  # in the file


@dataclass(frozen=True, slots=True, eq=False)
class FileContents:
    """All that was read from a file, and how it was understood.

    Rows of `Geometry.source_faces` count through the whole file in STL, OBJ, PLY and OFF, and within the
    mesh (the product, for STEP) in formats with a scene graph.
    """

    path: str  # as given
    format: str  # "STL binary", "STEP" ...
    units: str  # what one number of the file means: a name of UNITS, or several, comma-separated
    units_declared: bool  # False: the file declares none, and the caller's word was taken
    geometries: tuple[Geometry, ...]  # at least one
    notes: tuple[str, ...]  # sentences for the user: what was left out, renamed or assumed
    approximation: float  # m: how far triangles may be from curved faces; 0 where the file has triangles


@dataclass(slots=True, eq=False)
class RawMesh:
    """One mesh at one place, in the numbers of the file."""

    name: str  # as the file has it; "" where it has none
    vertices: np.ndarray  # (V, 3) float64
    faces: np.ndarray  # (F, 3) int64
    source_faces: np.ndarray  # (F,) int32
    matrix: np.ndarray | None = None  # (4, 4) float64, world from mesh; None: identity
    is_hidden: bool = False  # a part that no question finds until it is shown
    above: tuple[str, ...] = ()  # names of the assemblies that hold it, the outermost first


@dataclass(slots=True, eq=False)
class RawFile:
    """Contents that a reader found, before units, poses and names."""

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
    """Raise if a file places more parts than anybody means, before they are made."""
    if count > MOST_PARTS:
        raise MeshFormatError(f"it places {count} parts, expected at most {MOST_PARTS}")
