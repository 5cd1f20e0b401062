"""Scenes as files that are opened without making anything anew: which arrays and words stand in `archive`.

What a scene, its parts and their solids consist of is listed here once, for both ways. Parts share a file's
few long arrays, however many they are.
"""

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, is_dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from proximity.archive import read_archive, write_archive
from proximity.bodies import Repairs
from proximity.errors import MeshFormatError, SceneError
from proximity.kernels import layout
from proximity.kernels.winding import MOMENT_STRIDE
from proximity.mesh import TriangleMesh
from proximity.model import Model, finished
from proximity.pose import Pose
from proximity.sign import SignMethod
from proximity.solid import Solid
from proximity.top import REGION_COPIES, STATIC_COPIES

LAYOUT = {name: value for name, value in vars(layout).items() if name.isupper() and isinstance(value, int)}
LAYOUT |= {"MOMENT_STRIDE": MOMENT_STRIDE, "STATIC_COPIES": STATIC_COPIES, "REGION_COPIES": REGION_COPIES}
"""What the arrays of a model are laid out by: a file with other numbers is refused. What no number shows, say
another meaning of a column, needs another `archive.FORMAT_VERSION`."""

# Fields of a part that JSON can hold, and what makes them of what it held. Solid, pose and source faces are
# arrays.
_FIELDS: dict[str, Callable[[Any], Any]] = {
    "name": str,
    "repairs": lambda counts: Repairs(**counts),
    "velocity": lambda numbers: _vector(numbers),
    "angular_velocity": lambda numbers: _vector(numbers),
    "is_hidden": bool,
    "stiffness": lambda number: number,
    "damping": float,
}


@dataclass(frozen=True, slots=True, eq=False)
class CompiledScene:
    """What a file gives back."""

    model: Model
    parts: list[dict[str, Any]]  # the fields of each part, by name
    report: dict[str, Any] | None  # the fields of the report, by name


def write_scene(path: Any, model: Model, parts: Iterable[Any], report: Any) -> None:
    """Write what a scene consists of.

    Parameters
    ----------
    path : path
        The file.
    model : Model
        Up to date.
    parts : iterable of Part
        In the order of the model's.
    report : LoadReport or None
        Where the scene came from.

    Raises
    ------
    SceneError
        If the file cannot be written, or a part's source faces are not what they should be.
    """
    parts = list(parts)
    # A solid may be in several parts: it is written once, and its first part is where its arrays are.
    row_of: dict[int, int] = {}
    for row, part in enumerate(parts):
        row_of.setdefault(id(part.solid), row)
    number_of = {solid: number for number, solid in enumerate(row_of)}
    solids = [(row, parts[row].solid) for row in row_of.values()]
    metadata = {
        "report": None if report is None else asdict(report),
        "parts": {field: [_plain(getattr(part, field)) for part in parts] for field in _FIELDS},
        "solid_of_part": [number_of[id(part.solid)] for part in parts],
        "solids": [
            [row, solid.name, solid.sign_method.value, solid.sign_reason, solid.is_watertight]
            for row, solid in solids
        ],
        "vertex_counts": [solid.mesh.vertex_count for _, solid in solids],
        "face_counts": [solid.mesh.face_count for _, solid in solids],
    }
    arrays = {
        "reals": model.reals,
        # Of this model's words nothing changes, but of those that later models of its scene are written to.
        "words": model.words.copy(),
        "frames": model.frames,
        "parts": model.parts,
        "vertices": np.concatenate([solid.mesh.vertices for _, solid in solids]),
        "faces": np.concatenate([solid.mesh.faces for _, solid in solids]),
        "source_faces": np.concatenate([_source_faces(part) for part in parts]),
        "poses": np.array([[*part.pose.rotation.flat, *part.pose.translation] for part in parts]),
    }
    write_archive(path, metadata, arrays, LAYOUT)


def read_scene(path: Any) -> CompiledScene:
    """Return what `write_scene` wrote; the arrays are mapped, and trees are not made anew.

    Parameters
    ----------
    path : path
        The file.

    Raises
    ------
    MeshFormatError
        If it is damaged, or does not fit this version or machine.
    """
    contents = read_archive(path, LAYOUT)
    try:
        return _scene(contents.metadata, contents.arrays)
    except (ValueError, TypeError, LookupError) as reason:  # its checksums are right, but not what it says
        raise MeshFormatError(
            f"{path}: its contents do not hold together ({reason}); save the scene again with this version"
        ) from reason


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    return value.tolist() if isinstance(value, np.ndarray) else value


def _vector(numbers: list[float]) -> np.ndarray:
    vector = np.array(numbers)
    vector.flags.writeable = False
    return vector


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
    arrays_of_model = (
        _array(arrays, "reals", np.float64),
        _array(arrays, "words", np.float32),
        _array(arrays, "frames", np.float64, layout.FRAME_COLUMNS),
        _array(arrays, "parts", np.int64, layout.PART_COLUMNS),
    )
    fields = metadata["parts"]
    model = finished(*arrays_of_model, names=tuple(map(str, fields["name"])))
    # Solids look at rows of their own: those of the scene's model serve for others once its parts have moved.
    reals, words, frames, rows_of_parts = arrays_of_model
    solids = _solids(metadata, arrays, finished(reals, words, frames.copy(), rows_of_parts.copy()))
    poses = _array(arrays, "poses", np.float64, 12)
    solid_of_part = metadata["solid_of_part"]
    faces = _slices(
        _array(arrays, "source_faces", np.int32), [solids[number].mesh.face_count for number in solid_of_part]
    )
    parts = [
        {
            "solid": solids[number],
            "pose": Pose.known(pose[:9].reshape(3, 3), pose[9:]),
            "source_faces": rows,
            **{field: made_of(fields[field][row]) for field, made_of in _FIELDS.items()},
        }
        for row, (number, pose, rows) in enumerate(zip(solid_of_part, poses, faces, strict=True))
    ]
    if len(model.parts) != len(parts) + 1 or len(model.frames) != len(model.parts):
        raise ValueError(f"there are {len(parts)} parts, but the trees of {len(model.parts) - 1}")
    return CompiledScene(model, parts, metadata["report"])


def _solids(metadata: dict[str, Any], arrays: dict[str, np.ndarray], model: Model) -> list[Solid]:
    vertices = _slices(_array(arrays, "vertices", np.float64, 3), metadata["vertex_counts"])
    faces = _slices(_array(arrays, "faces", np.int32, 3), metadata["face_counts"])
    return [
        Solid._from_model(
            model,
            row,
            TriangleMesh._from_checked(own, of_own),
            name,
            (SignMethod(method), reason, is_watertight),
        )
        for (row, name, method, reason, is_watertight), own, of_own in zip(
            metadata["solids"], vertices, faces, strict=True
        )
    ]


def _array(arrays: dict[str, np.ndarray], name: str, dtype: type, columns: int | None = None) -> np.ndarray:
    array = arrays[name]
    expected = array.shape[:1] if columns is None else (len(array), columns)
    if array.dtype != dtype or array.shape != expected:
        raise ValueError(f"{name} are {array.dtype} of shape {array.shape}")
    return array


def _slices(array: np.ndarray, counts: list[int]) -> list[np.ndarray]:
    """*array* cut into runs of so many rows, read-only."""
    ends = np.cumsum([0, *counts]).tolist()
    if ends[-1] != len(array) or min(counts) < 0:
        raise ValueError(f"there are {len(array)} rows, but {ends[-1]} are spoken of")
    array.flags.writeable = False
    return [array[start:end] for start, end in pairwise(ends)]
