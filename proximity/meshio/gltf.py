"""glTF and GLB: checked here, read by trimesh; always in metres.

The structure is checked before trimesh sees it: lengths, references, bounds of every accessor that holds
geometry. Then a reduced copy goes to trimesh, which decodes the arrays and multiplies the matrices: one mesh
for each primitive, nodes under names of our own, no materials, cameras or animations. So nothing depends on
how trimesh makes names unique, orders nodes, or treats what it does not know.
"""

import json
import re
from typing import Any

import numpy as np

from proximity.errors import MeshFormatError
from proximity.meshio import gltf_buffers, gltf_nodes, library, tables
from proximity.meshio.contents import RawFile, RawMesh, Source
from proximity.meshio.gltf_buffers import Document, integer

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

    Parameters
    ----------
    source : Source
        The file.

    Raises
    ------
    MeshFormatError
        If anything in it contradicts itself.
    """
    header, binary, notes = gltf_buffers.split_glb(source.data)
    return read_document(header, source.path, binary, "GLB", notes)


def read_gltf(source: Source) -> RawFile:
    """Read a glTF file and the buffers beside it.

    Parameters
    ----------
    source : Source
        The file.

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
    """Read the geometry of a glTF document.

    Parameters
    ----------
    header : bytes
        JSON.
    path : str
        Where the file lies, for buffers beside it.
    binary : bytes or None
        The chunk of a GLB file.
    format_name : str
        For the report.
    notes : list of str
        What was noticed already.
    named_after_meshes : bool
        Names of meshes come before names of nodes.
    """
    document = gltf_buffers.parse_document(header, path, binary)
    _check_extensions(document)
    nodes = gltf_nodes.walk(document, named_after_meshes=named_after_meshes)
    used = sorted({node.mesh for node in nodes if node.mesh is not None})
    primitives = {mesh: _primitives(document, mesh, notes) for mesh in used}
    scene = _load_reduced(document, nodes, primitives)
    parts = _assemble_all(scene, primitives)
    meshes = []
    for node in nodes:
        part = None if node.mesh is None else parts[node.mesh]
        if part is not None:
            matrix = np.array(scene.graph.get(node.label)[0], dtype=np.float64)
            meshes.append(RawMesh(node.name, *part, matrix))
    notes += _notes(document, nodes)
    return RawFile(format_name, meshes, units="m", notes=notes)


def _check_extensions(document: Document) -> None:
    """Compressed positions would arrive as zeros."""
    named = [name for key in _EXTENSION_LISTS for name in gltf_buffers.entries(document.json, key)]
    lost = [name for name in _LOST_EXTENSIONS if name in named]
    if lost:
        raise MeshFormatError(f"its geometry is stored by {lost[0]}, which is not read; export it without")
    for name in map(str, gltf_buffers.entries(document.json, "extensionsRequired")):
        if not _LOOKS.search(name):
            raise MeshFormatError(
                f"it requires the extension {tables.shortened(name, 60)}, which is not read"
            )


def _primitives(document: Document, mesh: int, notes: list[str]) -> list[dict[str, Any]]:
    """The surfaces of a mesh, checked, as trimesh shall see them."""
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
            note = "points and lines were left out, they bound nothing"
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
    vertex_count = gltf_buffers.check_accessor(document, position, place, "VEC3", (_POSITION_TYPE,))
    corner_count = vertex_count
    reduced: dict[str, Any] = {"attributes": {"POSITION": position}, "mode": mode}
    if primitive.get("indices") is not None:
        reduced["indices"] = integer(primitive["indices"], f"the indices of {place}")
        corner_count = gltf_buffers.check_accessor(
            document, reduced["indices"], place, "SCALAR", _INDEX_TYPES
        )
    if mode == _TRIANGLES and corner_count % 3:
        raise MeshFormatError(f"{place} has {corner_count} corners, which is no multiple of 3")
    if mode == _TRIANGLE_STRIP and corner_count < 3:
        raise MeshFormatError(f"{place} is a strip of {corner_count} corners, expected at least 3")
    extensions = primitive.get("extensions") or {}
    if not isinstance(extensions, dict):
        raise MeshFormatError(f"{place} has extensions that are no object of JSON")
    face_ids = extensions.get("TM_brep_faces")
    if isinstance(face_ids, dict) and "faceIndices" in face_ids:
        index = integer(face_ids["faceIndices"], f"the CAD faces of {place}")
        gltf_buffers.check_accessor(document, index, place, "SCALAR", _INDEX_TYPES)
        reduced["attributes"]["_CAD_FACE"] = index
    reduced["face_count"] = corner_count // 3 if mode == _TRIANGLES else corner_count - 2
    return reduced


def _load_reduced(document: Document, nodes: list[gltf_nodes.Node], primitives: dict[int, list[dict]]) -> Any:
    meshes = []
    for mesh, parts in primitives.items():
        for k, part in enumerate(parts):
            kept = {key: value for key, value in part.items() if key != "face_count"}
            meshes.append({"name": f"{mesh}.{k}", "primitives": [kept]})
    reduced: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [k for k, node in enumerate(nodes) if node.is_root]}],
        "nodes": [node.reduced for node in nodes],
        "meshes": meshes,
        **gltf_buffers.reduced_accessors(document, meshes),
    }
    files = {f"buffer{k}": data for k, data in enumerate(document.buffers)}
    return library.load_scene(json.dumps(reduced).encode(), "gltf", files)


def _assemble_all(scene: Any, primitives: dict[int, list[dict[str, Any]]]) -> dict[int, Part | None]:
    """Arrays of every mesh; meshes of the same accessors, as cascadio writes instances, share them."""
    parts: dict[int, Part | None] = {}
    first: dict[str, int] = {}
    for mesh, own in primitives.items():
        twin = first.setdefault(json.dumps(own, sort_keys=True), mesh)
        parts[mesh] = parts[twin] if twin in parts else _assembled(scene, mesh, own)
    return parts


def _assembled(scene: Any, mesh: int, primitives: list[dict[str, Any]]) -> Part | None:
    """All primitives of a mesh as one: they are what one body shows in several materials."""
    vertices: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    rows: list[np.ndarray] = []
    vertex_count = row_count = 0
    for k, primitive in enumerate(primitives):
        if not primitive["face_count"]:
            continue
        geometry = scene.geometry.get(f"{mesh}.{k}")
        found = 0 if geometry is None else len(geometry.faces)
        if found != primitive["face_count"]:
            raise MeshFormatError(
                f"primitive {k} of mesh {mesh} has {primitive['face_count']} triangles, but {found} were read"
            )
        own = np.asarray(geometry.faces, dtype=np.int64)
        if own.min() < 0 or own.max() >= len(geometry.vertices):
            face = int(np.flatnonzero(((own < 0) | (own >= len(geometry.vertices))).any(axis=1))[0])
            raise MeshFormatError(
                f"triangle {face} of primitive {k} of mesh {mesh} refers to vertices {own[face].tolist()}, "
                f"but there are {len(geometry.vertices)}"
            )
        vertices.append(np.array(geometry.vertices, dtype=np.float64))
        faces.append(own + vertex_count)
        cad_faces = geometry.vertex_attributes.get("_CAD_FACE")
        rows.append(np.arange(row_count, row_count + found) if cad_faces is None else np.ravel(cad_faces))
        vertex_count += len(vertices[-1])
        row_count += found
    if not row_count:
        return None
    source_faces = np.concatenate(rows).astype(np.int32)
    return np.concatenate(vertices), np.concatenate(faces), source_faces


def _notes(document: Document, nodes: list[gltf_nodes.Node]) -> list[str]:
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
