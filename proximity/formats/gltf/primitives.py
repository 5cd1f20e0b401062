"""Surfaces of glTF meshes: triangles of every mode, packed or not, displaced by morph targets."""

import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats.gltf import accessors
from proximity.formats.gltf.buffers import Document, entries, extension, integer
from proximity.formats.libraries import run_library
from proximity.formats.worker import NOT_INSTALLED, TOO_MUCH
from proximity.system.extras import needed

DRACO = "KHR_draco_mesh_compression"
_DRACO_SECONDS, _DRACO_BYTES, _DRACO_BYTES_PER_BYTE = 120, 2 << 30, 400
"""Limits of unpacking: packed meshes seldom grow twentyfold."""
_TRIANGLES, _TRIANGLE_STRIP, _TRIANGLE_FAN = 4, 5, 6


@dataclass(slots=True, eq=False)
class Primitive:
    """A surface as stored in the file: the triangles of one material."""

    place: str  # for messages
    key: tuple  # equal for two primitives with the same surface
    mode: int
    position: int  # accessor
    targets: list[Any]  # of displacements, JSON
    face_ids: np.ndarray | None  # CAD face of each triangle; shared ids if there are several surfaces
    packed: tuple[int, int] | None  # by Draco: buffer view, and the identifier of positions in it
    points: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))  # (V, 3), stored numbers
    corners: np.ndarray | None = None  # rows of points; None: all of them, in turn

    @property
    def corner_count(self) -> int:
        """Rows of points that make triangles, in turn."""
        return len(self.points if self.corners is None else self.corners)

    @property
    def face_count(self) -> int:
        """Triangles."""
        return self.corner_count // 3 if self.mode == _TRIANGLES else self.corner_count - 2


def read_meshes(document: Document, meshes: Iterable[int], notes: list[str]) -> dict[int, list[Primitive]]:
    """Return the surfaces of meshes, with all references checked."""
    found = {mesh: _primitives(document, mesh, notes) for mesh in meshes}
    every = [primitive for primitives in found.values() for primitive in primitives]
    packed = list(dict.fromkeys(primitive.packed for primitive in every if primitive.packed is not None))
    arrays = _unpacked([(document.view(view), position_id) for view, position_id in packed])
    for primitive in every:
        if primitive.packed is not None:
            faces, primitive.points = arrays[packed.index(primitive.packed)]
            primitive.corners, primitive.mode = faces.ravel(), _TRIANGLES  # strips are unpacked as triangles
        _check_count(primitive)
    return found


def _primitives(document: Document, mesh: int, notes: list[str]) -> list[Primitive]:
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
            note = "points and lines were ignored: they enclose no volume"
            notes += [] if note in notes else [note]
            continue
        if mode > _TRIANGLE_FAN:
            raise MeshFormatError(
                f"{place} has mode {mode}, expected triangles (4), a strip (5) or a fan (6)"
            )
        found.append(_primitive(document, primitive, mode, place))
    return found


def _primitive(document: Document, entry: dict[str, Any], mode: int, place: str) -> Primitive:
    position = integer(entry["attributes"].get("POSITION"), f"the positions of {place}")
    corners = entry.get("indices")
    corners = None if corners is None else integer(corners, f"the indices of {place}")
    face_ids = extension(entry, "TM_brep_faces", place).get("faceIndices")
    face_ids = None if face_ids is None else integer(face_ids, f"the CAD faces of {place}")
    targets = entries(entry, "targets")
    accessor = document.entry("accessors", position)
    is_stored = accessor.get("bufferView") is not None or accessor.get("sparse") is not None
    packed = None if is_stored else _packed(entry, place)
    if not is_stored and packed is None:
        raise MeshFormatError(f"accessor {position} ({place}) has no buffer view, expected positions")
    primitive = Primitive(
        place,
        (mode, position, corners, face_ids, packed, str(targets)),
        mode,
        position,
        targets,
        None if face_ids is None else accessors.read_indices(document, face_ids, place),
        packed,
    )
    if packed is None:
        primitive.points = accessors.read_positions(document, position, place)
        if corners is not None:
            primitive.corners = accessors.read_indices(document, corners, place)
    return primitive


def _packed(entry: dict[str, Any], place: str) -> tuple[int, int] | None:
    """Return the location of positions packed by Draco, unless they are also stored unpacked."""
    found = extension(entry, DRACO, place)
    if not found:
        return None
    ids = found.get("attributes")
    position_id = ids.get("POSITION") if isinstance(ids, dict) else None
    return (
        integer(found.get("bufferView"), f"the packed data of {place}"),
        integer(position_id, f"the packed positions of {place}"),
    )


def _check_count(primitive: Primitive) -> None:
    count, place = primitive.corner_count, primitive.place
    if primitive.mode == _TRIANGLES and count % 3:
        raise MeshFormatError(f"{place} has {count} corners, which is not a multiple of 3")
    if primitive.mode != _TRIANGLES and count < 3:
        kind = "strip" if primitive.mode == _TRIANGLE_STRIP else "fan"
        raise MeshFormatError(f"{place} is a {kind} of {count} corners, expected at least 3")


@np.errstate(over="ignore", invalid="ignore")  # infinities are found and named later
def vertices(document: Document, primitive: Primitive, weights: tuple[float, ...]) -> np.ndarray:
    """Return positions, (V, 3) float64, m, displaced by the morph targets according to their weights."""
    points = accessors.as_lengths(document, primitive.position, primitive.points)
    if any(weights[len(primitive.targets) :]):
        raise MeshFormatError(
            f"{primitive.place} has {len(primitive.targets)} morph targets, but {len(weights)} weights"
        )
    for target, weight in zip(primitive.targets, weights, strict=False):
        if not weight or not isinstance(target, dict) or target.get("POSITION") is None:
            continue
        index = integer(target["POSITION"], f"a morph target of {primitive.place}")
        shifts = accessors.read_positions(document, index, f"a morph target of {primitive.place}")
        if len(shifts) != len(points):
            raise MeshFormatError(
                f"a morph target of {primitive.place} moves {len(shifts)} vertices, "
                f"but there are {len(points)}"
            )
        points += weight * accessors.as_lengths(document, index, shifts)
    return points


def triangles(primitive: Primitive) -> np.ndarray:
    """Return corners of the faces, (F, 3) int64; every other triangle of a strip is reversed."""
    if primitive.corners is None:
        corners = np.arange(len(primitive.points), dtype=np.int64)
    else:
        corners = primitive.corners.astype(np.int64)
    if primitive.mode == _TRIANGLES:
        faces = corners.reshape(-1, 3)
    elif primitive.mode == _TRIANGLE_FAN:
        faces = np.column_stack([np.broadcast_to(corners[:1], len(corners) - 2), corners[1:-1], corners[2:]])
    else:
        faces = np.column_stack([corners[:-2], corners[1:-1], corners[2:]])
        faces[1::2] = faces[1::2, [0, 2, 1]]
    outside = np.flatnonzero((faces >= len(primitive.points)).any(axis=1))
    if len(outside):
        raise MeshFormatError(
            f"triangle {outside[0]} of {primitive.place} refers to vertices {faces[outside[0]].tolist()}, "
            f"but there are {len(primitive.points)}"
        )
    return faces


def check_draco_installed() -> None:
    """Raise if DracoPy is not installed, with what to install."""
    with needed(f"geometry stored by {DRACO} needs", "gltf"):
        import DracoPy  # noqa: F401


def _unpacked(streams: Sequence[tuple[memoryview, int]]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return faces, (F, 3), and stored positions, (V, 3), of Draco streams, by identifiers of positions."""
    if not streams:
        return []
    check_draco_installed()
    given = io.BytesIO()
    np.save(given, np.array([position_id for _, position_id in streams]))
    for stream, _ in streams:
        np.save(given, np.frombuffer(stream, dtype=np.uint8))
    data = given.getvalue()
    byte_count = _DRACO_BYTES + _DRACO_BYTES_PER_BYTE * len(data)
    done = run_library("draco", data, seconds=_DRACO_SECONDS, byte_count=byte_count)
    if done.returncode:
        printed = done.printed.strip().splitlines()
        if done.returncode in (TOO_MUCH, NOT_INSTALLED):  # installed, but without memory to import it
            reported = f"it takes more than {_DRACO_SECONDS} s or {byte_count >> 30} GB, expected less"
        elif done.returncode < 0 or not printed:
            reported = f"the decoder crashed, signal {-done.returncode}"
        else:
            reported = printed[-1][:160]
        raise MeshFormatError(f"its geometry stored by {DRACO} cannot be unpacked ({reported})")
    found = io.BytesIO(done.output)
    arrays = [(np.load(found), np.load(found)) for _ in streams]
    if not all(array.shape[1:] == (3,) for pair in arrays for array in pair):
        raise MeshFormatError(f"its positions stored by {DRACO} are not 3 numbers each")
    return arrays
