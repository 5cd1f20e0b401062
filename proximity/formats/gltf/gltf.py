"""Read the triangles of the default scene of glTF and GLB files.

Materials, cameras and animations are ignored. Lengths are always in metres.
"""

import re
from collections.abc import Sequence

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import text_rows
from proximity.formats.contents import RIGID_TOLERANCE, UNKNOWN_FACE, RawFile, RawMesh, Source
from proximity.formats.gltf import buffers, primitives, scene_graph
from proximity.formats.gltf.buffers import Document
from proximity.formats.gltf.primitives import Primitive
from proximity.formats.gltf.scene_graph import Node

Part = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Vertices, faces and source faces of a mesh."""

_EXTENSION_LISTS = ("extensionsUsed", "extensionsRequired")
_MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_INSTANCING = "EXT_mesh_gpu_instancing"
_READ = ("KHR_node_visibility", "KHR_mesh_quantization", primitives.DRACO)
_LOOKS = re.compile(
    r"material|technique|texture|light|xmp|animation|audio|image|packing|metadata|features|selectab|hoverab|"
    r"interactiv",
    re.IGNORECASE,
)
"""Pattern of the names of extensions that do not change the shape."""


def read_glb(source: Source) -> RawFile:
    """Read a binary glTF file."""
    header, binary, notes = buffers.split_glb(source.data)
    return read_document(header, source.path, binary, "GLB", notes)


def read_gltf(source: Source) -> RawFile:
    """Read a glTF file and its external buffers."""
    return read_document(source.data, source.path, None, "glTF", [])


def read_document(
    header: bytes, path: str, binary: bytes | None, format_name: str, notes: list[str]
) -> RawFile:
    """Read the geometry of a glTF document."""
    document = buffers.parse_header(header)
    _check_extensions(document)  # a packed file may have no buffers
    buffers.load_buffers(document, path, binary)
    nodes = [node for node in scene_graph.walk(document) if node.mesh != scene_graph.NO_MESH]
    if not nodes:
        notes.append("its scene places no meshes")
    surfaces = primitives.read_meshes(document, sorted({node.mesh for node in nodes}), notes)
    parts = _parts(document, nodes, surfaces)
    meshes = _placed(nodes, parts, notes)
    pairs = zip(nodes, parts, strict=True)
    if unknown := [node.label for node, part in pairs if part and part[2][0] == UNKNOWN_FACE]:
        notes.append(f"the numbers of the CAD faces of {text_rows.listed(unknown)} are unknown")
    notes += _notes(document, nodes, surfaces)
    return RawFile(format_name, meshes, units="m", notes=notes)


def _check_extensions(document: Document) -> None:
    """Raise an error if an extension stores geometry.

    The geometry would be missing, or be read as zeros.
    """
    used, required = (list(map(str, buffers.entries(document.json, key))) for key in _EXTENSION_LISTS)
    refused = "its geometry is stored by {}, which is not supported; export it without"
    if _INSTANCING in used + required:
        raise MeshFormatError(refused.format(_INSTANCING))
    for name in _MESHOPT:
        if name in required or _has_empty_buffer(document, name):
            raise MeshFormatError(f"{refused.format(name)}, or unpack it by: gltfpack -noq -kn")
    if primitives.DRACO in required:
        primitives.check_draco_installed()
    for name in required:
        if name not in _READ and not _LOOKS.search(name):
            raise MeshFormatError(
                f"it requires the extension {text_rows.shortened(name, 60)}, which is not read"
            )


def _has_empty_buffer(document: Document, name: str) -> bool:
    """Return whether only an extension contains the bytes of a buffer."""
    count = len(buffers.entries(document.json, "buffers"))
    every = ((k, document.entry("buffers", k)) for k in range(count))
    return any("uri" not in entry and buffers.extension(entry, name, f"buffer {k}") for k, entry in every)


def _parts(
    document: Document, nodes: Sequence[Node], surfaces: dict[int, list[Primitive]]
) -> list[Part | None]:
    """Return the arrays of each node's mesh.

    Meshes with the same accessors share arrays, as in files of cascadio.
    """
    made: dict[tuple, Part | None] = {}
    parts = []
    for node in nodes:
        own = surfaces[node.mesh]
        key = node.weights, *(primitive.key for primitive in own)
        if key not in made:
            made[key] = _assembled(document, own, node.weights)
        parts.append(made[key])
    return parts


def _assembled(document: Document, own: list[Primitive], weights: tuple[float, ...]) -> Part | None:
    """Join all primitives of a mesh, since they are one body in several materials."""
    own = [primitive for primitive in own if primitive.face_count]
    if not own:
        return None
    vertices: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    vertex_count = 0
    for primitive in own:
        vertices.append(primitives.vertices(document, primitive, weights))
        faces.append(primitives.triangles(primitive) + vertex_count)
        vertex_count += len(vertices[-1])
    row_count = sum(primitive.face_count for primitive in own)
    ids, *others = [primitive.face_ids for primitive in own]
    if ids is None:
        ids = np.arange(row_count)
    elif others or len(ids) != row_count:
        ids = np.full(row_count, UNKNOWN_FACE)  # ids of CAD faces refer to the first surface only
    return np.concatenate(vertices), np.concatenate(faces), ids.astype(np.int32)


@np.errstate(over="ignore", invalid="ignore")  # infinities are reported later
def _placed(nodes: Sequence[Node], parts: Sequence[Part | None], notes: list[str]) -> list[RawMesh]:
    """Return the meshes of the parts at their nodes.

    A scale of 0 flattens a mesh, which becomes a sheet or is omitted.
    """
    meshes: list[RawMesh] = []
    sheets, nothing = [], []
    for node, part in zip(nodes, parts, strict=True):
        if part is None:
            continue
        (vertices, faces, rows), matrix = part, node.matrix
        dimensions = _dimensions(matrix)
        if dimensions < 2:
            nothing.append(node.label)
            continue
        if dimensions == 2:
            sheets.append(node.label)
            vertices = vertices @ matrix[:3, :3].T
            matrix = np.eye(4)
            matrix[:3, 3] = node.matrix[:3, 3]
        meshes.append(RawMesh(node.name, vertices, faces, rows, matrix, node.is_hidden, node.above))
    if nothing and not meshes:
        raise MeshFormatError(f"all of its parts have a scale of 0: {text_rows.listed(nothing)}")
    if nothing:
        notes.append(f"left out, as the file scales them by 0: {text_rows.listed(nothing)}")
    if sheets:
        notes.append(f"flattened to a sheet by a scale of 0 in the file: {text_rows.listed(sheets)}")
    return meshes


def _dimensions(matrix: np.ndarray) -> int:
    """Return the number of dimensions that a matrix preserves.

    An invalid matrix counts as regular and is refused later.
    """
    if not np.isfinite(matrix).all() or (matrix[3] != (0.0, 0.0, 0.0, 1.0)).any():
        return 3
    stretches = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return int((stretches > RIGID_TOLERANCE * stretches[0]).sum())


def _notes(document: Document, nodes: Sequence[Node], surfaces: dict[int, list[Primitive]]) -> list[str]:
    notes = []
    if len(document.json.get("scenes") or []) > 1:
        has_default = document.json.get("scene") is not None
        which = ", the default one" if has_default else " and names no default: the first"
        notes.append(f"it holds several scenes{which} was read")
    if document.json.get("animations"):
        notes.append("its animations were not applied")
    if any(any(node.weights) for node in nodes):
        notes.append("its morph targets were applied with the weights of the file")
    elif any(primitive.targets for own in surfaces.values() for primitive in own):
        notes.append("its morph targets were not applied, the meshes are in their basic shape")
    if any(node.is_bent for node in nodes):
        notes.append("its skins were not applied, the meshes are in their rest position")
    if document.wrong_bounds:
        more = len(document.wrong_bounds) - 1
        others = f" (and {more} more)" if more else ""
        notes.append(f"{document.wrong_bounds[0]}{others}: the positions were taken as they are")
    return notes
