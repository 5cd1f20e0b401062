"""Compiled scenes: saving a scene with its trees, and opening it without building them.

This module lists the fields of scenes, parts and solids once, for writing and for reading. In the file, all
parts share a few long arrays.
"""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, is_dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from proximity.errors import MeshFormatError, SceneError
from proximity.kernels import layout
from proximity.kernels.layout import MOMENT_STRIDE, REGION_COPIES, STATIC_COPIES
from proximity.mesh.triangle_mesh import TriangleMesh
from proximity.pose import Pose
from proximity.scene.model.assembly import Model, finished
from proximity.scene.model.scene_state import write_motion, write_surface
from proximity.scene.part import largest_deviation
from proximity.scene.saved.archive import read_archive, write_archive
from proximity.scene.saved.description import (
    deviations_of,
    expect,
    list_of,
    names_of,
    numbers_below,
    repairs_of,
    report_of,
    solid_of,
    surfaces_of,
    velocities_of,
)
from proximity.scene.saved.stored_model import check_mesh, complete_model, named
from proximity.scene.sign import kernel_sign
from proximity.scene.solid import Solid

LAYOUT = {name: value for name, value in vars(layout).items() if name.isupper() and isinstance(value, int)}
LAYOUT |= {"MOMENT_STRIDE": MOMENT_STRIDE, "STATIC_COPIES": STATIC_COPIES, "REGION_COPIES": REGION_COPIES}
_OF_SCENE = {*layout.SCENE_FIELDS, "super_node", "dynamic_count"}
LAYOUT |= {
    f"FRAME_{field.upper()}": layout.field_at(layout.FRAME, field)
    for field in (layout.FRAME.names or ())[:-1]
}
LAYOUT |= {
    f"{'SCENE' if field in _OF_SCENE else 'PART'}_{field.upper()}": layout.field_at(layout.PART, field)
    for field in layout.PART.names or ()
}
LAYOUT["SCENE_GRID"] = LAYOUT["PART_GRID"]
"""Numbers that define the layout of a model's arrays. A file with other numbers is rejected.

A change that no number shows, such as another meaning of a column, needs another `archive.FORMAT_VERSION`.
"""

_FIELDS = (
    "name", "repairs", "velocity", "angular_velocity", "is_hidden", "stiffness", "damping",
)  # fmt: skip
"""Fields of a part that are stored as JSON. The solid, the pose and the source faces are arrays."""


_CONTRADICTIONS = (ValueError, TypeError, LookupError, ArithmeticError, MeshFormatError)


@dataclass(frozen=True, slots=True, eq=False)
class CompiledScene:
    """Contents of a compiled scene."""

    model: Model
    parts: list[dict[str, Any]]  # the fields of each part, by name
    report: dict[str, Any] | None  # the fields of the report, by name


def write_scene(path: Any, model: Model, parts: Iterable[Any], report: Any) -> None:
    """Write the parts, the report and the arrays of a scene to a file."""
    parts = list(parts)
    # A solid in several parts is written once; its arrays are those of its first part.
    row_of: dict[int, int] = {}
    for row, part in enumerate(parts):
        row_of.setdefault(id(part.solid), row)
    number_of = {solid: number for number, solid in enumerate(row_of)}
    solids = [(row, parts[row].solid) for row in row_of.values()]
    metadata = {
        "report": None if report is None else asdict(report),
        "parts": {field: [_plain(getattr(part, field)) for part in parts] for field in _FIELDS},
        "deviations": [_finite(part.deviation_by_face) for part in parts],
        "solid_of_part": [number_of[id(part.solid)] for part in parts],
        "solids": [
            [row, str(solid.name), solid.sign_method.value, solid.sign_reason, solid.is_watertight]
            for row, solid in solids
        ],
        "vertex_counts": [solid.mesh.vertex_count for _, solid in solids],
        "face_counts": [solid.mesh.face_count for _, solid in solids],
    }
    arrays = {
        "reals": model.reals,
        # A copy: later models of the scene write to other words of the same array.
        "words": model.words.copy(),
        "frames": layout.columns_of(model.frames),
        "parts": layout.columns_of(model.parts),
        "vertices": np.concatenate([solid.mesh.vertices for _, solid in solids]),
        "faces": np.concatenate([solid.mesh.faces for _, solid in solids]),
        "source_faces": np.concatenate([_source_faces(part) for part in parts]),
        "poses": np.array([[*part.pose.rotation.flat, *part.pose.translation] for part in parts]),
    }
    write_archive(path, metadata, arrays, LAYOUT)


def read_scene(path: Any) -> CompiledScene:
    """Return the scene in a file of `write_scene`.

    Its arrays are mapped into memory, and trees are not rebuilt.
    """
    contents = read_archive(path, LAYOUT)
    try:
        return _scene(contents.metadata, contents.arrays)
    except _CONTRADICTIONS as reason:  # its checksums are right, but not its contents
        raise MeshFormatError(
            f"{path}: its contents are inconsistent ({reason}); save the scene again with this version"
        ) from reason


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    return value.tolist() if isinstance(value, np.ndarray) else value


def _finite(deviations: np.ndarray) -> list[float | None]:
    """Return deviations as JSON has them, with None for infinity."""
    return [value if value < np.inf else None for value in deviations.tolist()]


def _source_faces(part: Any) -> np.ndarray:
    rows = np.asarray(part.source_faces)
    expected = (part.solid.mesh.face_count,)
    if rows.shape != expected or rows.dtype.kind not in "iu" or not _is_int32(rows):
        raise SceneError(
            f"part {part.name!r} cannot be saved: its source_faces are {rows.dtype} of shape {rows.shape}, "
            f"expected int32 of shape {expected}"
        )
    return rows.astype(np.int32)


def _is_int32(rows: np.ndarray) -> bool:
    limits = np.iinfo(np.int32)
    return bool((rows >= limits.min).all() and (rows <= limits.max).all())


def _scene(metadata: dict[str, Any], arrays: dict[str, np.ndarray]) -> CompiledScene:
    fields = metadata["parts"]
    names = names_of(fields["name"])
    model_arrays = (
        _array(arrays, "reals", np.float64),
        _array(arrays, "words", np.float32),
        _array(arrays, "frames", np.float64, layout.FRAME_COLUMNS).view(layout.FRAME).reshape(-1),
        _array(arrays, "parts", np.int64, layout.PART_COLUMNS).view(layout.PART).reshape(-1),
    )
    reals, words, frames, rows = model_arrays
    values = _values(fields, names)
    poses = _array(arrays, "poses", np.float64, 12)
    _write_rows(frames, rows, poses, values)
    # From here on, traversals rely on a valid model.
    complete_model(*model_arrays, names)
    model = finished(*model_arrays, names=names)

    # Solids have separate rows: those of the scene's model are reused once its parts have moved.
    whole = finished(reals, words, frames.copy(), rows.copy())
    solids, solid_of_part = _solids(metadata, arrays, whole, names)
    faces = _slices(
        _array(arrays, "source_faces", np.int32), [solids[number].mesh.face_count for number in solid_of_part]
    )
    deviations = deviations_of(metadata.get("deviations"), faces)
    parts = [
        {
            "solid": solids[number],
            "pose": Pose.known(pose[:9].reshape(3, 3), pose[9:]),
            "source_faces": of_source,
            "deviation": largest_deviation(by_face, of_source),
            "deviation_by_face": by_face,
            **{field: values[field][row] for field in _FIELDS},
        }
        for row, (number, pose, of_source, by_face) in enumerate(
            zip(solid_of_part, poses, faces, deviations, strict=True)
        )
    ]
    return CompiledScene(model, parts, report_of(metadata["report"]))


def _values(fields: dict[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    """Return the fields of all parts by name. Each is a list with one entry for each part."""
    count = len(names)
    stiffness, damping = surfaces_of(fields["stiffness"], fields["damping"], names)
    return {
        "name": names,
        "repairs": [repairs_of(each) for each in list_of(dict, fields["repairs"], "repairs", count)],
        "velocity": velocities_of(fields["velocity"], "velocity", count),
        "angular_velocity": velocities_of(fields["angular_velocity"], "angular_velocity", count),
        "is_hidden": list_of(bool, fields["is_hidden"], "is_hidden", count),
        "stiffness": stiffness,
        "damping": damping,
    }


def _write_rows(frames: np.ndarray, rows: np.ndarray, poses: np.ndarray, values: dict[str, Any]) -> None:
    """Overwrite poses, velocities, surfaces and visibility in the tables by those from the metadata."""
    count = len(poses)
    expect(count == len(values["name"]), f"there are {len(values['name'])} parts, but {count} poses")
    for table, what in ((rows, "the trees"), (frames, "frames")):
        expect(len(table) == count + 1, f"there are {count} parts, but {what} of {len(table) - 1}")
    layout.columns_of(frames)[:-1, :12] = poses
    rows["is_hidden"][:-1] = values["is_hidden"]
    for row in range(count):
        write_motion(frames[row], values["velocity"][row], values["angular_velocity"][row])
        write_surface(frames[row], values["stiffness"][row], values["damping"][row])


def _solids(
    metadata: dict[str, Any], arrays: dict[str, np.ndarray], model: Model, names: tuple[str, ...]
) -> tuple[list[Solid], list[int]]:
    """Return all solids, and a list with the number of each part's solid."""
    rows = model.parts
    reported = [solid_of(each, len(names)) for each in list_of(list, metadata["solids"], "solids")]
    solid_of_part = numbers_below(len(reported), metadata["solid_of_part"], "solid_of_part", len(names))
    vertex_counts, face_counts = (
        numbers_below(2**31, metadata[counts], counts, len(reported))
        for counts in ("vertex_counts", "face_counts")
    )
    vertices = _slices(_array(arrays, "vertices", np.float64, 3), vertex_counts)
    faces = _slices(_array(arrays, "faces", np.int32, 3), face_counts)
    for row, number in enumerate(solid_of_part):
        is_alike = (face_counts[number], kernel_sign(reported[number][2])) == (
            rows["face_count"][row],
            rows["sign"][row],
        )
        expect(is_alike, f"{named(row, names)} has other faces, or another sign, than its solid")
        check_mesh(model.words, rows, row, vertices[number], faces[number], names)
    for number, solid in enumerate(reported):
        expect(solid_of_part[solid[0]] == number, f"solid {number} is not that of part {solid[0]}")
    solids = [
        Solid._from_model(
            model, row, TriangleMesh._from_checked(own, of_own), name, (method, reason, is_watertight)
        )
        for (row, name, method, reason, is_watertight), own, of_own in zip(
            reported, vertices, faces, strict=True
        )
    ]
    return solids, solid_of_part


def _array(arrays: dict[str, np.ndarray], name: str, dtype: type, columns: int | None = None) -> np.ndarray:
    array = arrays[name]
    expected = array.shape[:1] if columns is None else (len(array), columns)
    if array.dtype != dtype or array.shape != expected:
        raise ValueError(f"{name} are {array.dtype} of shape {array.shape}")
    return array


def _slices(array: np.ndarray, counts: list[int]) -> list[np.ndarray]:
    """Cut an array into read-only runs of *counts* rows."""
    ends = np.cumsum([0, *counts]).tolist()
    expect(ends[-1] == len(array), f"there are {len(array)} rows, but {ends[-1]} are spoken of")
    array.flags.writeable = False
    return [array[start:end] for start, end in pairwise(ends)]
