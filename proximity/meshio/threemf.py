"""3MF: a zip archive with an XML model, read by trimesh; the model names its unit.

trimesh skips what it cannot resolve and merges objects of one id, or of one file beside the root model, so
that ids, components and references are checked before, and vertices and triangles counted after.
"""

import graphlib
import io
import re
import zipfile
import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from proximity.errors import MeshFormatError
from proximity.meshio import library, tables
from proximity.meshio.contents import RawFile, RawMesh, Source

_UNITS = {"micron": "um", "millimeter": "mm", "centimeter": "cm", "inch": "in", "foot": "ft", "meter": "m"}
_DEFAULT_UNIT = "millimeter"  # of the specification
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_VERTEX, _TRIANGLE = (re.compile(rb"<(?:\w+:)?%s[\s/>]" % word) for word in (b"vertex", b"triangle"))
_MODEL = re.compile(rb"<(?:\w+:)?model\b([^>]*)>")
_TAG = re.compile(rb"<(?:[\w.-]+:)?(object|mesh|component|item)(?=[\s/>])((?:[^>\"']|\"[^\"]*\"|'[^']*')*)>")
_ID, _TARGET, _PATH = (
    re.compile(rb"\s%s\s*=\s*[\"']([^\"']*)" % name) for name in (b"id", b"objectid", rb"(?:[\w.-]+:)?path")
)
_UNIT = re.compile(rb"\sunit\s*=\s*[\"']([^\"']*)")
_NEEDED_EXTENSION = re.compile(rb"\srequiredextensions\s*=\s*[\"']([^\"']*)")
_NAMESPACE = re.compile(rb"\sxmlns:([^\s=]+)\s*=\s*[\"']([^\"']*)")
_HARMLESS_EXTENSIONS = re.compile(rb"/(production|material)/")
"""Production only spreads objects over files, materials only colour them."""


@dataclass(slots=True)
class _Object:
    """One object of a model file."""

    file: str
    has_mesh: bool = False
    components: list[bytes] = field(default_factory=list)  # ids


@dataclass(frozen=True, slots=True)
class _Reference:
    """What places an object."""

    kind: str  # item or component
    target: bytes  # id
    file: str


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
    objects, references = _objects_and_references(models)
    _check_references(objects, references)
    _check_objects(objects, next(iter(models)))
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


def _read_models(data: bytes) -> dict[str, bytes]:
    """The XML of all model files by name, without comments, the root model first."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".model")]
            names.sort(key=lambda name: not name.lower().endswith("3d/3dmodel.model"))
            # reading to the end also compares the checksum
            models = {name: _COMMENT.sub(b"", archive.read(name)) for name in names}
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
    if len(models) < len(names):
        raise MeshFormatError("its archive holds two model files of one name, expected each once")
    return models


def _unit(models: dict[str, bytes]) -> str:
    """The unit that all model files declare; trimesh would take that of the root for all."""
    units = {name: _unit_of(model) for name, model in models.items()}
    root, unit = next(iter(units.items()))
    for name, other in units.items():
        if other != unit:
            raise MeshFormatError(
                f"{_name(root)} is in {unit}, but {_name(name)} in {other}; expected one unit in all"
            )
    return unit


def _unit_of(model: bytes) -> str:
    root = _MODEL.search(model)
    if root is None:
        raise MeshFormatError("its model file has no element model")
    needed = _NEEDED_EXTENSION.search(root.group(1))
    if needed is not None:
        # Prefixes are the writer's choice: only what they stand for tells.
        meant = dict(_NAMESPACE.findall(root.group(1)))
        words = needed.group(1).split()
        if not all(_HARMLESS_EXTENSIONS.search(meant.get(word, b"")) for word in words):
            raise MeshFormatError(f"it needs the extensions {_shown(needed.group(1))}, which are not read")
    declared = _UNIT.search(root.group(1))
    unit = _DEFAULT_UNIT if declared is None else declared.group(1).decode("latin-1").strip().lower()
    if unit not in _UNITS:
        raise MeshFormatError(f"its unit is {unit[:40]!r}, expected one of {', '.join(_UNITS)}")
    return _UNITS[unit]


def _objects_and_references(models: dict[str, bytes]) -> tuple[dict[bytes, _Object], list[_Reference]]:
    objects: dict[bytes, _Object] = {}
    references: list[_Reference] = []
    for name, model in models.items():
        current = None
        for kind, attributes in _TAG.findall(model):
            if kind == b"object":
                own_id = _attribute(_ID, attributes)
                if own_id in objects:
                    # trimesh would put all of them into each of their places
                    raise MeshFormatError(
                        f"object {_shown(own_id)!r} is there twice, in {_name(objects[own_id].file)} and in "
                        f"{_name(name)}; expected ids that differ"
                    )
                current = objects[own_id] = _Object(name)
            elif kind == b"mesh":
                if current is not None:
                    current.has_mesh = True
            else:
                target = _attribute(_TARGET, attributes)
                path = _attribute(_PATH, attributes).decode("utf-8", "replace").strip("/")
                references.append(_Reference(kind.decode(), target, path or name))
                if kind == b"component" and current is not None:
                    current.components.append(target)
    return objects, references


def _attribute(pattern: re.Pattern[bytes], attributes: bytes) -> bytes:
    found = pattern.search(attributes)
    return b"" if found is None else found.group(1)


def _check_references(objects: dict[bytes, _Object], references: list[_Reference]) -> None:
    for reference in references:
        target = objects.get(reference.target)
        if target is None or target.file != reference.file:
            what = "an item" if reference.kind == "item" else "a component"
            raise MeshFormatError(f"{what} refers to object {_shown(reference.target)!r}, which is not there")
        if not (target.has_mesh or target.components):
            raise MeshFormatError(
                f"object {_shown(reference.target)!r} has no mesh and no components: "
                "what it is made of is not read"
            )
    if not any(reference.kind == "item" for reference in references):
        raise MeshFormatError("its build has no items: it places nothing")


def _check_objects(objects: dict[bytes, _Object], root: str) -> None:
    """Refuse what trimesh reads otherwise than it stands there."""
    files: set[str] = set()
    for own_id, held in objects.items():
        if held.has_mesh and held.components:
            raise MeshFormatError(
                f"object {_shown(own_id)!r} has a mesh and components, expected one of the two"
            )
        if held.file != root and (held.components or held.file in files):
            # it takes all meshes of such a file for one, and passes over the places of components
            raise MeshFormatError(
                f"{_name(held.file)} holds several objects, or one of components; expected a single mesh"
            )
        files.add(held.file)
    try:
        graphlib.TopologicalSorter({own_id: held.components for own_id, held in objects.items()}).prepare()
    except graphlib.CycleError as reason:
        first = _shown(reason.args[1][0])
        raise MeshFormatError(f"object {first!r} is a component of itself, expected a tree") from None


def _name(file: str) -> str:
    return tables.shortened(file, 60)


def _shown(raw: bytes) -> str:
    return raw.decode("utf-8", "replace")[:40]


def _check_counts(scene: Any, models: dict[str, bytes]) -> None:
    for what, pattern, read in (
        ("vertices", _VERTEX, [len(mesh.vertices) for mesh in scene.geometry.values()]),
        ("triangles", _TRIANGLE, [len(getattr(mesh, "faces", ())) for mesh in scene.geometry.values()]),
    ):
        held = sum(len(pattern.findall(model)) for model in models.values())
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
