"""Read a file into geometries in metres.

Its reader is chosen here, and parts are scaled, placed and named.
"""

import math
import os
from collections import Counter
from collections.abc import Callable
from functools import partial
from importlib import import_module
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from proximity.checks import positive
from proximity.errors import MeshError, MeshFormatError, MissingLibraryError, PoseError, ProximityError
from proximity.formats import format_detection, text_rows
from proximity.formats.contents import (
    STEP_TOLERANCE,
    UNPACKED_LIMIT,
    DialectError,
    FileContents,
    Geometry,
    Placement,
    RawFile,
    RawMesh,
    Source,
    place,
)
from proximity.formats.units import UNITS, metres_per_unit, unit_name
from proximity.system.regular_file import NotRegularFileError, open_regular

_LARGE_BYTES, _HEAD_BYTES = 1 << 26, 1 << 20
"""Minimum size of a file whose header is checked before the rest is read, and the number of bytes read for
that."""


def _imported(module: str, name: str) -> Callable[..., Any]:
    """Return a function of a reader that is imported on its first call.

    Importing all readers takes 40 ms.
    """

    def function(*arguments: Any, **options: Any) -> Any:
        return getattr(import_module(f"proximity.formats.{module}"), name)(*arguments, **options)

    return function


_READERS: dict[str, Callable[..., RawFile]] = {
    "STL": _imported("stl", "read_stl"),
    "OBJ": _imported("obj", "read_obj"),
    "PLY": _imported("ply.ply", "read_ply"),
    "OFF": _imported("off", "read_off"),
    "GLB": _imported("gltf.gltf", "read_glb"),
    "glTF": _imported("gltf.gltf", "read_gltf"),
    "STEP": _imported("step.step", "read_step"),
    "3MF": _imported("threemf.threemf", "read_3mf"),
}
_read_dialect = _imported("dialects", "read_dialect")
_POINT_READERS = {
    ".ply": _imported("ply.ply", "read_ply_points"),
    ".obj": _imported("obj", "read_obj_points"),
}


def read_geometries(
    path: str | os.PathLike[str],
    *,
    units: str = "mm",
    scale: float = 1.0,
    step_tolerance: float = STEP_TOLERANCE,
    unpacked_limit: float = UNPACKED_LIMIT,
    cache: bool = True,
) -> FileContents:
    """Read every mesh of a file in metres, with its pose.

    *path*: a file with one of the extensions of `EXTENSIONS`. *units*: unit of files that do not declare one
    (STL, OBJ, PLY, OFF), a key of `UNITS`. Files that declare a unit (glTF, 3MF, STEP) are read in it.
    *scale*: factor of all lengths. *step_tolerance*: maximum distance of triangles from the curved surfaces
    of a STEP file. *unpacked_limit*: maximum unpacked size of a 3MF file, which is an archive. *cache*:
    whether the triangles of a STEP file are read from the user's cache, or stored there.

    At least one geometry is returned. Meshes are not merged, dropped or repaired. Identical instances share
    their arrays.
    """
    units = unit_name(units)
    metres = metres_per_unit(units)
    scale = positive("scale", scale, "times")
    tolerance = positive("step_tolerance", step_tolerance, "metres")
    limit = positive("unpacked_limit", unpacked_limit, "bytes", may_be_infinite=True)
    of_step = {"tolerance": tolerance, "undeclared_metres": metres, "is_cached": cache}
    options: dict[str, dict[str, Any]] = {"STEP": of_step, "3MF": {"unpacked_limit": limit}}
    try:
        shown = os.fspath(path)
    except TypeError:
        raise MeshError(f"the path is {path!r}, expected text or a path") from None
    shown = shown if isinstance(shown, str) else os.fsdecode(shown)
    if not shown:
        raise MeshError("the path is empty, expected the name of a file")
    try:
        source = Source(shown, _read_bytes(shown, unpacked_limit))
        extension = Path(shown).suffix.lower()
        try:
            found = format_detection.find_format(source, extension)
            raw = _read(partial(_READERS[found], **options.get(found, {})), source)
        except DialectError as refusal:
            raw = _read_dialect(source.data, extension[1:], refusal)
        if raw.metres_per_number is not None:
            metres = raw.metres_per_number
        elif raw.units is not None:
            metres = UNITS[raw.units]
        geometries, naming = _geometries(raw, scale * metres, Path(shown).stem)
        if scale != 1.0:
            naming.append(f"all lengths are multiplied by {scale:g}, as was asked for")
    except MemoryError:
        raise MeshFormatError(f"{shown}: there is not enough memory to read it") from None
    except (MeshError, MissingLibraryError) as reason:
        raise type(reason)(f"{shown}: {reason}") from reason.__cause__
    return FileContents(
        shown,
        raw.format,
        raw.units or units,
        raw.units is not None,
        geometries,
        (*raw.notes, *naming),
        scale * raw.approximation,
    )


def read_vertices(path: str) -> np.ndarray:
    """Return the vertices of a PLY, OBJ or STL file, (N, 3), in the units of the file.

    The file may have no faces. STL files repeat a vertex for each face; it is returned once.
    """
    reader = _POINT_READERS.get(Path(path).suffix.lower())
    if reader is None:
        parts = read_geometries(path, units="m").geometries
        vertices = np.concatenate([part.vertices for part in parts])
        return vertices[np.sort(np.unique(vertices, axis=0, return_index=True)[1])]
    try:
        points: np.ndarray = reader(_read_bytes(path, math.inf))
        return points
    except MeshFormatError as reason:
        raise MeshFormatError(f"{path}: {reason}") from reason


def _read(reader: Callable[[Source], RawFile], source: Source) -> RawFile:
    try:
        return reader(source)
    except ProximityError:
        raise
    except (TypeError, AttributeError, LookupError, ArithmeticError, RecursionError, ValueError) as reason:
        # an error that the reader does not check for
        raise MeshFormatError(f"it cannot be read ({text_rows.in_one_line(reason)})") from reason


def _read_bytes(path: str, unpacked_limit: float) -> bytes:
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            if size > _LARGE_BYTES:
                _check_large(file.read(_HEAD_BYTES), size, Path(path).suffix.lower(), unpacked_limit)
                file.seek(0)
            data = file.read()
    except MeshFormatError as reason:  # a subclass of ValueError; a large file is not passed to trimesh
        raise MeshFormatError(str(reason)) from None
    except FileNotFoundError:
        raise MeshFormatError("there is no such file") from None
    except IsADirectoryError:
        raise MeshFormatError("it is a directory, expected a file") from None
    except (OSError, ValueError) as reason:
        reported = reason.strerror if isinstance(reason, OSError) else str(reason)
        if isinstance(reason, NotRegularFileError):
            raise MeshFormatError(f"it {reported}, expected one") from reason
        raise MeshFormatError(f"it cannot be opened ({reported})") from reason
    if not data:
        raise MeshFormatError("it is empty")
    return data


def _check_large(head: bytes, size: int, extension: str, unpacked_limit: float) -> None:
    """Raise an error if the header of a large file contradicts its size.

    Otherwise gigabytes would be read in vain.
    """
    format_detection.check_size(head, size, extension)
    if extension == ".ply":
        from proximity.formats.ply import ply_header  # imported for this format only

        ply_header.check_size(ply_header.read_header(head), size)
    if extension == ".3mf" and size > unpacked_limit:
        raise MeshFormatError(f"it has {size:,} bytes, expected at most {unpacked_limit:,} (unpacked_limit)")


def _geometries(raw: RawFile, metres: float, stem: str) -> tuple[tuple[Geometry, ...], list[str]]:
    meshes = [mesh for mesh in raw.meshes if len(mesh.faces)]
    if not meshes:
        reasons = f" ({'; '.join(raw.notes)})" if raw.notes else ""
        raise MeshFormatError(f"it contains no faces{reasons}")
    names = [mesh.name.strip() or stem for mesh in meshes]
    if raw.format == "STEP":
        names = _with_assemblies(meshes, names)
    names, notes = unique_names(names)
    hidden = [
        text_rows.shortened(name, 60) for mesh, name in zip(meshes, names, strict=True) if mesh.is_hidden
    ]
    if hidden:
        notes.append(f"hidden in the file, and so in the scene: {text_rows.listed(hidden)}")
    shared: dict[tuple, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
    geometries = []
    for mesh, name in zip(meshes, names, strict=True):
        try:
            placement = place(mesh.matrix)
            pose = placement.pose(metres)
        except (MeshError, PoseError) as reason:
            raise MeshFormatError(f"{text_rows.shortened(name, 60)}: {reason}") from reason
        stretch = None if placement.stretch is None else placement.stretch.tobytes()
        key = (id(mesh.vertices), id(mesh.faces), placement.scale, stretch)
        if key not in shared:
            shared[key] = _arrays(mesh, name, placement, metres)
        vertices, faces, source_faces = shared[key]
        deviations = _deviations(mesh, placement, metres)
        geometries.append(Geometry(name, vertices, faces, source_faces, pose, mesh.is_hidden, deviations))
    return tuple(geometries), notes


def _arrays(
    mesh: RawMesh, name: str, placement: Placement, metres: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    vertices = placement.part_vertices(mesh.vertices, metres)
    faces = mesh.faces[:, ::-1] if placement.is_mirrored else mesh.faces
    arrays = (vertices, np.ascontiguousarray(faces), mesh.source_faces)
    for array in arrays:
        array.flags.writeable = False
    _check_finite(mesh, vertices, name)
    return arrays


def _deviations(mesh: RawMesh, placement: Placement, metres: float) -> np.ndarray | None:
    """Return the deviations of a mesh at its position, m.

    Positions of assemblies have single precision: each level adds half a unit in the last place of its
    rotation, twice, as the nearest rotation replaces it, and of its translation.
    """
    if mesh.deviations is None:
        return None
    stretch = placement.scale if placement.stretch is None else np.linalg.norm(placement.stretch, 2)
    deviations = mesh.deviations * abs(stretch)
    if mesh.matrix is not None and (mesh.matrix != np.eye(4)).any():
        reach = np.linalg.norm(mesh.vertices, axis=1).max() + np.linalg.norm(placement.translation)
        deviations = deviations + (len(mesh.above) + 1) * 2 * np.finfo(np.float32).eps * reach
    deviations = deviations * metres
    deviations.flags.writeable = False
    return np.asarray(deviations)


def _check_finite(mesh: RawMesh, vertices: np.ndarray, name: str) -> None:
    is_bad = ~np.isfinite(vertices).all(axis=1)
    if not is_bad.any():
        return
    is_used = np.zeros(len(vertices), dtype=bool)
    is_used[mesh.faces.ravel()] = True
    is_bad &= is_used
    if is_bad.any():
        vertex = int(np.flatnonzero(is_bad)[0])
        values = ", ".join(str(float(value)) for value in mesh.vertices[vertex])
        raise MeshError(
            f"vertex {vertex} of {text_rows.shortened(name, 60)} is not finite: ({values}); "
            f"{int(is_bad.sum())} of the {int(is_used.sum())} vertices in use are not finite"
        )


def _with_assemblies(meshes: list[RawMesh], names: list[str]) -> list[str]:
    """Prepend the names of assemblies to names that several meshes share.

    Assemblies that contain all meshes are omitted.
    """
    levels = zip(*(mesh.above for mesh in meshes), strict=False)
    common = sum(1 for _ in takewhile(lambda level: len(set(level)) == 1, levels))
    counts = Counter(names)
    return [
        "/".join((*mesh.above[common:], name)) if counts[name] > 1 else name
        for mesh, name in zip(meshes, names, strict=True)
    ]


def unique_names(names: list[str]) -> tuple[list[str], list[str]]:
    """Make names unique. Return them, and notes about the changed ones.

    *names*: names in the file. The first mesh of a name keeps it; a number is appended to the others.
    """
    taken = set(names)
    unique: list[str] = []
    last: dict[str, int] = {}  # last number appended to each name
    for name in names:
        if name not in last:
            last[name] = 1
            unique.append(name)
            continue
        last[name] += 1
        while f"{name}_{last[name]}" in taken:
            last[name] += 1
        unique.append(f"{name}_{last[name]}")
        taken.add(unique[-1])
    notes = [
        f"{count} of its meshes are called {text_rows.shortened(name, 60)}; "
        "from the second on they are numbered"
        for name, count in Counter(names).items()
        if count > 1
    ]
    return unique, notes
