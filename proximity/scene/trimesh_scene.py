"""Conversion of meshes of trimesh, PyVista and Open3D to scenes, and of scenes to trimesh objects."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from proximity.checks import as_points, trimesh_kind
from proximity.errors import ArgumentError, MeshError, PoseError
from proximity.formats import UNITS, Geometry, metres_per_unit, unit_name
from proximity.formats.contents import Placement, place
from proximity.pose import Pose
from proximity.scene.loader import scene_of
from proximity.scene.part import LoadReport
from proximity.scene.scene import Scene

Placed = tuple[str, Any, np.ndarray | None]
"""Name of a part, its mesh or other geometry, and its matrix, if any."""


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
        In metres. A mesh with several bodies is split; ``part.source_faces`` has the rows of the mesh's
        faces.

    Raises
    ------
    MeshError
        If it is neither of the two, has no unit or another one than *units*, has no faces, or is not usable.
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
    # For a unit of None, trimesh reports "none".
    declared = {str(each[1].units) for each in meshes} - {"None", "none"}
    units = _agreed_units(declared, units)
    report = LoadReport("", f"trimesh.{kind}", units, bool(declared), notes)
    return scene_of(_geometries(meshes, metres_per_unit(units)), f"trimesh.{kind}", report)


def from_mesh(mesh: Any, *, units: str | None = None, name: str = "mesh") -> Scene:
    """Return the scene of a mesh of trimesh, PyVista or Open3D.

    Parameters
    ----------
    mesh : trimesh.Trimesh, trimesh.Scene, pyvista.PolyData or open3d.geometry.TriangleMesh
        Also any object with arrays ``vertices`` and ``faces``. All faces must be triangles.
    units : str
        Unit of the coordinates: "mm", "m", "in", ...; only a mesh of trimesh may declare it itself.
    name : str
        Name of the part.

    Returns
    -------
    Scene
        In metres. A mesh with several bodies is split; ``part.source_faces`` has the rows of the mesh's
        faces.

    Raises
    ------
    MeshError
        If it is none of these, has no unit, has faces other than triangles, or is not usable.
    """
    if trimesh_kind(mesh) is not None:
        return from_trimesh(mesh, units=units, name=name)
    units, kind = _agreed_units(set(), units), type(mesh).__name__
    vertices, faces = _arrays_of(mesh)
    vertices = as_points(vertices, "vertices") * metres_per_unit(units)
    if not len(faces):
        raise MeshError(f"the {kind} holds no faces")
    geometry = Geometry(name, vertices, faces, np.arange(len(faces), dtype=np.int32), Pose())
    return scene_of([geometry], kind, LoadReport("", kind, units, False, ()))


def _arrays_of(mesh: Any) -> tuple[Any, np.ndarray]:
    if hasattr(mesh, "triangles"):  # Open3D
        return np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    if hasattr(mesh, "points") and hasattr(mesh, "faces"):  # PyVista: 3, i, j, k, 3, i, j, k, ...
        rows = np.asarray(mesh.faces)
        if rows.size % 4 or (rows[::4] != 3).any():
            raise MeshError("the mesh has faces that are no triangles: its method triangulate() makes these")
        return np.asarray(mesh.points), rows.reshape(-1, 4)[:, 1:]
    if hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
        return mesh.vertices, np.asarray(mesh.faces)
    raise MeshError(f"a {type(mesh).__name__} was given, expected a mesh of trimesh, PyVista or Open3D")


def to_trimesh(scene: Scene) -> Any:
    """Return a scene as a `trimesh.Scene`, for example for boolean operations, sections or export.

    Parameters
    ----------
    scene : Scene
        Every part becomes a node with its name and pose. Parts that share a mesh share a geometry.

    Returns
    -------
    trimesh.Scene
        In metres, also by its declared unit. The arrays are copies.

    Raises
    ------
    ArgumentError
        If *scene* is not a `Scene`.
    """
    import trimesh

    if not isinstance(scene, Scene):
        raise ArgumentError(f"a {type(scene).__name__} was given, expected a proximity.Scene")
    made, geometries = trimesh.Scene(), {}
    for part in scene.parts:
        mesh = part.solid.mesh
        if id(mesh) not in geometries:
            geometry = trimesh.Trimesh(mesh.vertices.copy(), mesh.faces.copy(), process=False)
            geometry.units = "m"
            geometries[id(mesh)] = geometry
        made.add_geometry(
            geometries[id(mesh)], node_name=part.name, geom_name=part.name, transform=part.pose.matrix
        )
    return made


def _agreed_units(declared: set[str], given: str | None) -> str:
    """Return the unit on which all meshes and the caller agree, or raise an error."""
    names = set(map(unit_name, declared))
    if given is not None:
        names.add(unit_name(given))
    if not names:
        raise MeshError(f"the mesh names no unit, expected units to be given: one of {', '.join(UNITS)}")
    if len(names) > 1:
        raise MeshError(f"units are given as {', '.join(sorted(names))}, expected one unit for all meshes")
    return names.pop()


def _placed(scene: Any) -> Iterator[Placed]:
    """Yield the name, geometry and matrix of each node of a trimesh scene that has a geometry."""
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        yield str(node), scene.geometry[geometry], np.asarray(matrix, np.float64)


def _geometries(placed: list[Placed], metres: float) -> list[Geometry]:
    """Return the meshes in metres. Instances of a mesh that are scaled equally share their arrays."""
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
