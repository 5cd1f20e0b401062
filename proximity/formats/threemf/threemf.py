"""3MF: a zip archive of XML model files, whose build items and components place objects.

Objects are numbered per model file. Every placement becomes a mesh of its own; meshes that stand in many
places share their arrays. How many placements there must be is counted first, without making them.
"""

import graphlib
import io
import zipfile
import zlib
from collections.abc import Iterator

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import text_rows
from proximity.formats.contents import RawFile, RawMesh, Source, check_part_count
from proximity.formats.threemf.model_file import ModelParser, Object, Reference

UNPACKED_LIMIT = 2_000_000_000
"""Bytes that a 3MF file may unpack to, unless the caller says otherwise."""
_BOMB_RATIO, _BOMB_BYTES = 200, 50_000_000
"""What unpacks to so much more than it is holds no geometry: XML of real meshes shrinks to a tenth."""
_CHUNK_BYTES = 1 << 20

_Id = tuple[str, str]  # model file, id of the object in it
_Arrays = tuple[np.ndarray, np.ndarray, np.ndarray]


def read_3mf(source: Source, unpacked_limit: float = UNPACKED_LIMIT) -> RawFile:
    """Read a 3MF file.

    Raises
    ------
    MeshFormatError
        If the archive is damaged, unpacks to more than the limit, or says what cannot be put together.
    """
    models = _read_models(source.data, unpacked_limit)
    unit = _common_unit(models)
    objects = {
        (file, own_id): held for file, model in models.items() for own_id, held in model.objects.items()
    }
    items = next(iter(models.values())).items
    _check_references(objects, items)
    counts = _placement_counts(objects)
    declared = sum(counts[item.target] for item in items)
    check_part_count(declared)
    placements = list(_placements(objects, items))
    if len(placements) != declared:
        raise MeshFormatError(f"its build places {declared} meshes, but {len(placements)} were made")
    arrays = {target: _arrays_of(objects[target]) for _, target, _ in placements}
    meshes = [
        RawMesh(name, *arrays[target], matrix)
        for name, target, matrix in placements
        if len(arrays[target][1])
    ]
    unplaced = sum(1 for key, held in objects.items() if held.has_mesh and key not in arrays)
    notes = [f"{unplaced} of its objects are not part of the build and were ignored"] if unplaced else []
    return RawFile("3MF", meshes, units=unit, notes=notes)


def _read_models(data: bytes, unpacked_limit: float) -> dict[str, ModelParser]:
    """All model files by name, parsed, the root model first."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = [entry for entry in archive.infolist() if entry.filename.lower().endswith(".model")]
            entries.sort(key=lambda entry: not entry.filename.lower().endswith("3d/3dmodel.model"))
            if not entries or not entries[0].filename.lower().endswith("3d/3dmodel.model"):
                raise MeshFormatError("the archive has no file 3D/3dmodel.model: it is not a 3MF file")
            if len({entry.filename for entry in entries}) < len(entries):
                raise MeshFormatError("its archive holds two model files of one name, expected each once")
            # The archive gives no more bytes than it declares.
            _check_size(sum(entry.file_size for entry in entries), len(data), unpacked_limit)
            return {entry.filename: _parsed(archive, entry) for entry in entries}
    except (
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        OSError,
        NotImplementedError,
        RuntimeError,
    ) as reason:
        raise MeshFormatError(f"its zip archive cannot be read ({text_rows.in_one_line(reason)})") from reason


def _check_size(unpacked: int, packed: int, limit: float) -> None:
    shown = f"its models of {packed:,} bytes unpack to {unpacked:,} bytes"
    if unpacked > limit:
        raise MeshFormatError(f"{shown}, expected at most {limit:,} (unpacked_limit)")
    if unpacked > max(_BOMB_BYTES, _BOMB_RATIO * packed):
        raise MeshFormatError(f"{shown}, expected at most {_BOMB_RATIO} times as many")


def _parsed(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> ModelParser:
    parser = ModelParser(entry.filename)
    with archive.open(entry) as stream:
        while piece := stream.read(_CHUNK_BYTES):  # at its end the checksum is compared
            parser.feed(piece)
    parser.feed(b"", is_last=True)
    return parser


def _common_unit(models: dict[str, ModelParser]) -> str | None:
    root, first = next(iter(models.items()))
    for name, model in models.items():
        if model.unit != first.unit:
            raise MeshFormatError(
                f"{_shown(root)} is in {first.unit}, but {_shown(name)} in {model.unit}; "
                "expected one unit in all"
            )
    return first.unit


def _check_references(objects: dict[_Id, Object], items: list[Reference]) -> None:
    if not items:
        raise MeshFormatError("its build has no items: it places nothing")
    references = [("an item", item) for item in items]
    for (_, own_id), held in objects.items():
        if held.has_mesh and held.components:
            raise MeshFormatError(
                f"object {_shown(own_id)} has a mesh and components, expected one of the two"
            )
        references += [("a component", component) for component in held.components]
    for kind, reference in references:
        shown = _shown(reference.target[1])
        target = objects.get(reference.target)
        if target is None:
            raise MeshFormatError(f"{kind} refers to object {shown}, which is not there")
        if not (target.has_mesh or target.components):
            raise MeshFormatError(
                f"object {shown} has no mesh and no components: its content is not supported"
            )


def _placement_counts(objects: dict[_Id, Object]) -> dict[_Id, int]:
    """Number of meshes that each object makes where it is placed."""
    below = {key: [component.target for component in held.components] for key, held in objects.items()}
    counts: dict[_Id, int] = {}
    try:
        for key in graphlib.TopologicalSorter(below).static_order():
            counts[key] = sum(counts[target] for target in below[key]) if below[key] else 1
    except graphlib.CycleError as reason:
        first = _shown(reason.args[1][0][1])
        raise MeshFormatError(f"object {first} is a component of itself, expected a tree") from None
    return counts


def _placements(objects: dict[_Id, Object], items: list[Reference]) -> Iterator[tuple[str, _Id, np.ndarray]]:
    """Name, object and matrix of every mesh that the build places, in the order of the file."""
    for item in items:
        waiting = [(item.target, item.matrix)]
        while waiting:
            key, matrix = waiting.pop()
            held = objects[key]
            if not held.components:
                own = f"{item.part_number}/{held.name}" if key != item.target else item.part_number
                yield (own if item.part_number else held.name), key, matrix
            for component in reversed(held.components):
                waiting.append((component.target, matrix @ component.matrix))


def _arrays_of(held: Object) -> _Arrays:
    vertices = np.frombuffer(held.coordinates, dtype=np.float64).reshape(-1, 3)
    faces = np.frombuffer(held.corners, dtype=np.int64).reshape(-1, 3)
    outside = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))
    if len(outside):
        raise MeshFormatError(
            f"triangle {outside[0]} of {_shown(held.name)} refers to vertices {faces[outside[0]].tolist()}, "
            f"but there are {len(vertices)}"
        )
    return vertices, faces, np.arange(len(faces), dtype=np.int32)


def _shown(text: str) -> str:
    return text_rows.shortened(text, 60)
