"""3MF: a zip archive with an XML model, read by trimesh; the model names its unit.

trimesh skips what it cannot resolve and can merge objects of several model files, so that the archive's
own vertices and triangles are counted, and every reference is looked up, before and after.
"""

import io
import re
import zipfile
import zlib
from typing import Any

import numpy as np

from proximity.errors import MeshFormatError
from proximity.meshio import library
from proximity.meshio.contents import RawFile, RawMesh, Source

_UNITS = {"micron": "um", "millimeter": "mm", "centimeter": "cm", "inch": "in", "foot": "ft", "meter": "m"}
_DEFAULT_UNIT = "millimeter"  # of the specification
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_VERTEX, _TRIANGLE = (re.compile(rb"<(?:\w+:)?%s[\s/>]" % word) for word in (b"vertex", b"triangle"))
_MODEL = re.compile(rb"<(?:\w+:)?model\b([^>]*)>")
_OBJECT_ID = re.compile(rb"<(?:\w+:)?object\b[^>]*?\sid\s*=\s*[\"']([^\"']*)")
_REFERENCE = re.compile(rb"<(?:\w+:)?(item|component)\b[^>]*?\sobjectid\s*=\s*[\"']([^\"']*)")
_UNIT = re.compile(rb"\sunit\s*=\s*[\"']([^\"']*)")
_NEEDED_EXTENSION = re.compile(rb"\srequiredextensions\s*=\s*[\"']([^\"']*)")


def read_3mf(source: Source) -> RawFile:
    """Read a 3MF file.

    Parameters
    ----------
    source : Source
        The file.

    Raises
    ------
    MeshFormatError
        If the archive is damaged, or trimesh did not get all that is in it.
    """
    models = _read_models(source.data)
    unit = _unit(models)
    references = [match for model in models for match in _REFERENCE.finditer(model)]
    ids = {match for model in models for match in _OBJECT_ID.findall(model)}
    for reference in references:
        if reference.group(2) not in ids:
            kind, target = map(_shown, reference.groups())
            raise MeshFormatError(f"a {kind} refers to object {target!r}, which is not there")
    if not any(reference.group(1) == b"item" for reference in references):
        raise MeshFormatError("its build has no items: it places nothing")
    scene = library.load_scene(source.data, "3mf")
    _check_counts(scene, models)
    meshes = []
    placed = set()
    for node in scene.graph.nodes_geometry:
        matrix, geometry_name = scene.graph.get(node)
        placed.add(geometry_name)
        name = _own_name(str(node), str(geometry_name))
        mesh = _raw_mesh(name, scene.geometry[geometry_name], np.asarray(matrix, dtype=np.float64))
        if len(mesh.faces):
            meshes.append(mesh)
    unplaced = len(scene.geometry) - len(placed)
    notes = [f"{unplaced} of its objects are not placed by the build and were left out"] if unplaced else []
    return RawFile("3MF", meshes, units=unit, notes=notes)


def _own_name(node: str, geometry: str) -> str:
    """The part number of an item where it has one, else the object's name without trimesh's numbering."""
    return geometry if re.fullmatch(re.escape(geometry) + r"_\d+", node) else node


def _read_models(data: bytes) -> list[bytes]:
    """The XML of all model files, without comments, the root model first."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".model")]
            names.sort(key=lambda name: not name.lower().endswith("3d/3dmodel.model"))
            # reading to the end also compares the checksum
            models = [_COMMENT.sub(b"", archive.read(name)) for name in names]
    except (
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        OSError,
        NotImplementedError,
        RuntimeError,
        ValueError,
    ) as reason:
        raise MeshFormatError(f"its zip archive cannot be read ({library.in_one_line(reason)})") from reason
    if not names or not names[0].lower().endswith("3d/3dmodel.model"):
        raise MeshFormatError("the archive has no file 3D/3dmodel.model: it is no 3MF")
    return models


def _unit(models: list[bytes]) -> str:
    root = _MODEL.search(models[0])
    if root is None:
        raise MeshFormatError("its model file has no element model")
    needed = _NEEDED_EXTENSION.search(root.group(1))
    if needed is not None and set(needed.group(1).split()) - {b"p", b"m"}:
        # production only spreads objects over files, materials only colour them
        raise MeshFormatError(f"it needs the extensions {_shown(needed.group(1))}, which are not read")
    declared = _UNIT.search(root.group(1))
    name = _DEFAULT_UNIT if declared is None else declared.group(1).decode("latin-1").strip().lower()
    if name not in _UNITS:
        raise MeshFormatError(f"its unit is {name[:40]!r}, expected one of {', '.join(_UNITS)}")
    return _UNITS[name]


def _shown(raw: bytes) -> str:
    return raw.decode("utf-8", "replace")[:40]


def _check_counts(scene: Any, models: list[bytes]) -> None:
    for what, pattern, read in (
        ("vertices", _VERTEX, [len(mesh.vertices) for mesh in scene.geometry.values()]),
        ("triangles", _TRIANGLE, [len(getattr(mesh, "faces", ())) for mesh in scene.geometry.values()]),
    ):
        held = sum(len(pattern.findall(model)) for model in models)
        if held != sum(read):
            spread = ", which is spread over several model files" if len(models) > 1 else ""
            raise MeshFormatError(f"it holds {held} {what}{spread}, but {sum(read)} were read")


def _raw_mesh(name: str, geometry: Any, matrix: np.ndarray) -> RawMesh:
    faces = np.asarray(getattr(geometry, "faces", np.empty((0, 3))), dtype=np.int64)
    vertices = np.array(geometry.vertices, dtype=np.float64)
    outside = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))
    if len(outside):
        raise MeshFormatError(
            f"triangle {outside[0]} of {name!r} refers to vertices {faces[outside[0]].tolist()}, "
            f"but there are {len(vertices)}"
        )
    return RawMesh(name, vertices, faces, np.arange(len(faces), dtype=np.int32), matrix)
