"""Objects of trimesh as scenes. This module does not import trimesh."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from proximity.checks import trimesh_kind
from proximity.errors import MeshError, PoseError
from proximity.formats import UNITS, Geometry, metres_per_unit
from proximity.formats.node_placement import Placement, place
from proximity.scene.loader import scene_of
from proximity.scene.part import LoadReport
from proximity.scene.scene import Scene

Placed = tuple[str, Any, np.ndarray | None]
"""Name of a part, its mesh or other geometry, and the matrix that places it."""
SYNONYMS = {
    "meter": "m",
    "meters": "m",
    "centimeter": "cm",
    "centimeters": "cm",
    "millimeter": "mm",
    "millimeters": "mm",
    "micron": "um",
    "microns": "um",
    "inch": "in",
    "inches": "in",
    "foot": "ft",
    "feet": "ft",
    "yard": "yd",
    "yards": "yd",
}
"""Units as trimesh writes them out, and what they are called here."""


def from_trimesh(mesh: Any, *, units: str | None = None, name: str = "mesh") -> Scene:
    """Return the scene of a `trimesh.Trimesh` or a `trimesh.Scene`.

    Parameters
    ----------
    mesh : trimesh.Trimesh or trimesh.Scene
        The meshes; those of a scene are placed by its graph. The scale or mirroring of a matrix is applied
        to the part's vertices, the rest is the part's pose.
    units : str
        Unit of the coordinates: "mm", "m", "in", ...; required if ``mesh.units`` is not set.
    name : str
        Name of the part, if there is one mesh. The parts of a scene are named after their nodes.

    Returns
    -------
    Scene
        In metres. A mesh that is several bodies is split; ``part.source_faces`` has the rows of the mesh's
        faces.

    Raises
    ------
    MeshError
        If it is neither of the two, has no unit or another one than *units*, has no faces, or cannot be
        used.
    """
    kind = trimesh_kind(mesh)
    if kind is None:
        raise MeshError(f"a {type(mesh).__name__} was given, expected a trimesh.Trimesh or a trimesh.Scene")
    placed: list[Placed] = [(name, mesh, None)] if kind == "Trimesh" else list(_placed(mesh))
    meshes = [each for each in placed if trimesh_kind(each[1]) == "Trimesh" and len(each[1].faces)]
    if not meshes:
        raise MeshError(f"the trimesh.{kind} holds no faces")
    left_out = len(placed) - len(meshes)
    notes = (f"{left_out} of its geometries have no faces and were ignored",) if left_out else ()
    # Where None was assigned, trimesh says "none".
    declared = {str(each[1].units) for each in meshes} - {"None", "none"}
    units = _agreed_units(declared, units)
    report = LoadReport("", f"trimesh.{kind}", units, bool(declared), notes)
    return scene_of(_geometries(meshes, metres_per_unit(units)), f"trimesh.{kind}", report)


def _agreed_units(declared: set[str], given: str | None) -> str:
    """The unit that all meshes agree on, and the caller too."""
    names = {SYNONYMS.get(name.lower(), name.lower()) for name in declared}
    if given is not None:
        metres_per_unit(given)  # refuses what is no unit
        names.add(given)
    if not names:
        raise MeshError(f"the mesh names no unit, expected units to be given: one of {', '.join(UNITS)}")
    if len(names) > 1:
        raise MeshError(f"units are given as {', '.join(sorted(names))}, expected one unit for all meshes")
    return names.pop()


def _placed(scene: Any) -> Iterator[Placed]:
    """Name, geometry and matrix of each node of a trimesh scene that has a geometry."""
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        yield str(node), scene.geometry[geometry], np.asarray(matrix, np.float64)


def _geometries(placed: list[Placed], metres: float) -> list[Geometry]:
    """The meshes in metres; the same mesh, deformed alike, has the same arrays."""
    shared: dict[tuple[Any, ...], tuple[np.ndarray, np.ndarray]] = {}
    geometries = []
    for name, mesh, matrix in placed:
        try:
            placement = place(matrix)
            pose = placement.pose(metres)
        except (MeshError, PoseError) as unfit:
            raise MeshError(f"part {name!r}: {unfit}") from unfit
        stretch = None if placement.stretch is None else placement.stretch.tobytes()
        key = id(mesh), placement.scale, stretch
        if key not in shared:
            shared[key] = _arrays(mesh, placement, metres)
        vertices, faces = shared[key]
        geometries.append(Geometry(name, vertices, faces, np.arange(len(faces), dtype=np.int32), pose))
    return geometries


def _arrays(mesh: Any, placement: Placement, metres: float) -> tuple[np.ndarray, np.ndarray]:
    vertices = placement.part_vertices(np.array(mesh.vertices, np.float64), metres)
    faces = np.array(mesh.faces, np.int64)
    return vertices, np.ascontiguousarray(faces[:, ::-1]) if placement.is_mirrored else faces
