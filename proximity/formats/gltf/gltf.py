"""glTF and GLB: triangles of the default scene, always in metres; no materials, cameras or animations."""

import json
import re
from typing import Any

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import text_rows
from proximity.formats.contents import RawFile, RawMesh, Source
from proximity.formats.gltf import buffers, scene_graph
from proximity.formats.gltf.buffers import Document, integer

Part = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Vertices, faces and source faces of a mesh."""

_TRIANGLES, _TRIANGLE_STRIP, _TRIANGLE_FAN = 4, 5, 6
_POSITION_TYPE = 5126  # float32
_INDEX_TYPES = (5121, 5123, 5125)  # unsigned, 1, 2 and 4 bytes
_EXTENSION_LISTS = ("extensionsUsed", "extensionsRequired")
_LOST_EXTENSIONS = (
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
    "EXT_mesh_gpu_instancing",
)
"""Extensions that hold geometry which is not read here."""
_LOOKS = re.compile(
    r"material|texture|light|xmp|animation|audio|image|packing|metadata|features|quantization", re.IGNORECASE
)
"""In names of extensions that change no shape, or not without being seen: positions that are quantised are
refused where they stand, and normals that are do no harm."""


def read_glb(source: Source) -> RawFile:
    """Read a binary glTF file.

    Raises
    ------
    MeshFormatError
        If anything in it contradicts itself.
    """
    header, binary, notes = buffers.split_glb(source.data)
    return read_document(header, source.path, binary, "GLB", notes)


def read_gltf(source: Source) -> RawFile:
    """Read a glTF file and the buffers beside it.

    Raises
    ------
    MeshFormatError
        If anything in it contradicts itself, or a buffer is missing.
    """
    return read_document(source.data, source.path, None, "glTF", [])


def read_document(
    header: bytes,
    path: str,
    binary: bytes | None,
    format_name: str,
    notes: list[str],
    *,
    named_after_meshes: bool = False,
) -> RawFile:
    """Read the geometry of a glTF document."""
    document = buffers.parse_document(header, path, binary)
    _check_extensions(document)
    nodes = scene_graph.walk(document, named_after_meshes=named_after_meshes)
    used = sorted({node.mesh for node in nodes if node.mesh is not None})
    primitives = {mesh: _primitives(document, mesh, notes) for mesh in used}
    parts = _assemble_all(document, primitives)
    meshes = []
    for node in nodes:
        part = None if node.mesh is None else parts[node.mesh]
        if part is not None:
            meshes.append(RawMesh(node.name, *part, node.matrix))
    notes += _notes(document, nodes)
    return RawFile(format_name, meshes, units="m", notes=notes)


def _check_extensions(document: Document) -> None:
    """Compressed positions would arrive as zeros."""
    named = [name for key in _EXTENSION_LISTS for name in buffers.entries(document.json, key)]
    lost = [name for name in _LOST_EXTENSIONS if name in named]
    if lost:
        raise MeshFormatError(
            f"its geometry is stored by {lost[0]}, which is not supported; export it without"
        )
    for name in map(str, buffers.entries(document.json, "extensionsRequired")):
        if not _LOOKS.search(name):
            raise MeshFormatError(
                f"it requires the extension {text_rows.shortened(name, 60)}, which is not read"
            )


def _primitives(document: Document, mesh: int, notes: list[str]) -> list[dict[str, Any]]:
    """The surfaces of a mesh, checked: what its accessors are, and how many faces it has."""
    found = []
    primitives = document.entry("meshes", mesh).get("primitives")
    if not isinstance(primitives, list):
        raise MeshFormatError(f"mesh {mesh} has no primitives")
    for k, primitive in enumerate(primitives):
        place = f"primitive {k} of mesh {mesh}"
        if not isinstance(primitive, dict) or not isinstance(primitive.get("attributes"), dict):
            raise MeshFormatError(f"{place} has no attributes")
        mode = integer(primitive.get("mode", _TRIANGLES), f"the mode of {place}")
        if mode < _TRIANGLES:
            note = "points and lines were ignored: they enclose nothing"
            notes += [] if note in notes else [note]
            continue
        if mode not in (_TRIANGLES, _TRIANGLE_STRIP):
            raise MeshFormatError(f"{place} has mode {mode}, expected triangles (4) or a strip (5)")
        found.append(_checked_primitive(document, primitive, mode, place))
    return found


def _checked_primitive(
    document: Document, primitive: dict[str, Any], mode: int, place: str
) -> dict[str, Any]:
    position = integer(primitive["attributes"].get("POSITION"), f"the positions of {place}")
    vertex_count = buffers.check_accessor(document, position, place, "VEC3", (_POSITION_TYPE,))
    corner_count = vertex_count
    reduced: dict[str, Any] = {"attributes": {"POSITION": position}, "mode": mode}
    if primitive.get("indices") is not None:
        reduced["indices"] = integer(primitive["indices"], f"the indices of {place}")
        corner_count = buffers.check_accessor(document, reduced["indices"], place, "SCALAR", _INDEX_TYPES)
    if mode == _TRIANGLES and corner_count % 3:
        raise MeshFormatError(f"{place} has {corner_count} corners, which is not a multiple of 3")
    if mode == _TRIANGLE_STRIP and corner_count < 3:
        raise MeshFormatError(f"{place} is a strip of {corner_count} corners, expected at least 3")
    extensions = primitive.get("extensions") or {}
    if not isinstance(extensions, dict):
        raise MeshFormatError(f"{place} has extensions that are not a JSON object")
    face_ids = extensions.get("TM_brep_faces")
    if isinstance(face_ids, dict) and "faceIndices" in face_ids:
        index = integer(face_ids["faceIndices"], f"the CAD faces of {place}")
        buffers.check_accessor(document, index, place, "SCALAR", _INDEX_TYPES)
        reduced["attributes"]["_CAD_FACE"] = index
    reduced["face_count"] = corner_count // 3 if mode == _TRIANGLES else corner_count - 2
    return reduced


def _assemble_all(document: Document, primitives: dict[int, list[dict[str, Any]]]) -> dict[int, Part | None]:
    """Arrays of every mesh; meshes of the same accessors, as cascadio writes instances, share them."""
    parts: dict[int, Part | None] = {}
    first: dict[str, int] = {}
    for mesh, own in primitives.items():
        twin = first.setdefault(json.dumps(own, sort_keys=True), mesh)
        parts[mesh] = parts[twin] if twin in parts else _assembled(document, mesh, own)
    return parts


def _assembled(document: Document, mesh: int, primitives: list[dict[str, Any]]) -> Part | None:
    """All primitives of a mesh as one: they are what one body shows in several materials."""
    vertices: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    rows: list[np.ndarray] = []
    vertex_count = row_count = 0
    for k, primitive in enumerate(primitives):
        if not primitive["face_count"]:
            continue
        attributes = primitive["attributes"]
        points = buffers.values(document, attributes["POSITION"]).astype(np.float64)
        own = _triangles(document, primitive, len(points))
        outside = np.flatnonzero((own >= len(points)).any(axis=1))
        if len(outside):
            raise MeshFormatError(
                f"triangle {outside[0]} of primitive {k} of mesh {mesh} refers to vertices "
                f"{own[outside[0]].tolist()}, but there are {len(points)}"
            )
        vertices.append(points)
        faces.append(own + vertex_count)
        rows.append(_source_faces(document, primitive, row_count))
        vertex_count += len(points)
        row_count += len(own)
    if not row_count:
        return None
    source_faces = np.concatenate(rows).astype(np.int32)
    return np.concatenate(vertices), np.concatenate(faces), source_faces


def _triangles(document: Document, primitive: dict[str, Any], vertex_count: int) -> np.ndarray:
    """Corners of the faces, (F, 3) int64; every other triangle of a strip runs the other way round."""
    if "indices" in primitive:
        corners = buffers.values(document, primitive["indices"]).astype(np.int64).ravel()
    else:
        corners = np.arange(vertex_count, dtype=np.int64)
    if primitive["mode"] == _TRIANGLES:
        return corners.reshape(-1, 3)
    faces = np.column_stack([corners[:-2], corners[1:-1], corners[2:]])
    faces[1::2] = faces[1::2, [0, 2, 1]]
    return faces


def _source_faces(document: Document, primitive: dict[str, Any], first: int) -> np.ndarray:
    """Rows of the faces in the file; of a CAD part the CAD face of each."""
    index = primitive["attributes"].get("_CAD_FACE")
    if index is None:
        return np.arange(first, first + primitive["face_count"])
    rows = buffers.values(document, index).astype(np.int64).ravel()
    if len(rows) != primitive["face_count"]:
        raise MeshFormatError(
            f"accessor {index} names the CAD faces of {len(rows)} triangles, "
            f"but there are {primitive['face_count']}"
        )
    return rows


def _notes(document: Document, nodes: list[scene_graph.Node]) -> list[str]:
    notes = []
    if len(document.json.get("scenes") or []) > 1:
        notes.append("it holds several scenes, the default one was read")
    if document.json.get("animations"):
        notes.append("its animations were not applied")
    used = {node.mesh for node in nodes if node.mesh is not None}
    if any(
        primitive.get("targets")
        for mesh in used
        for primitive in document.entry("meshes", mesh)["primitives"]
    ):
        notes.append("its morph targets were not applied, the meshes are in their basic shape")
    if any(node.has_skin for node in nodes):
        notes.append("its skins were not applied, the meshes are in their rest position")
    return notes
