"""Read which volumes of an object slicers treat as holes or do not print.

PrusaSlicer and SuperSlicer write all volumes of an object into one mesh, and name their ranges of triangles.
Bambu Studio and OrcaSlicer write each volume as an object, and name it with the object that it is a component
of.
"""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from proximity.formats.threemf.package import XmlFile
from proximity.kernels.entries import merged_faces
from proximity.mesh.diagnosis import manifold_solid
from proximity.mesh.topology import topology_of

SETTINGS = ("/metadata/slic3r_pe_model.config", "/metadata/model_settings.config")
PART, NEGATIVE = "part", "negative volume"
_KINDS = {
    **dict.fromkeys(("NegativeVolume", "negative_part"), NEGATIVE),
    **dict.fromkeys(("ParameterModifier", "modifier_part"), "modifier"),
    **dict.fromkeys(("SupportBlocker", "support_blocker"), "support blocker"),
    **dict.fromkeys(("SupportEnforcer", "support_enforcer"), "support enforcer"),
}
"""Kinds of volumes that are not parts, by the names that slicers use."""
_MAX_WORK, _WORK_OF_VOLUME = 5_000_000, 1000
"""Limit of the subtractions for a file in processed faces, including repetitions, which take about ten
seconds, and the cost of a volume in faces."""
_ROUNDING = 1e-13
"""Rounding error of a moved volume that is flush with the part, as a share of the largest coordinate."""

Arrays = tuple[np.ndarray, np.ndarray, np.ndarray]  # vertices, faces, rows of the faces in the file


@dataclass(slots=True)
class Run:
    """A volume that is a range of the triangles of a mesh."""

    first: int
    last: int
    kind: str = PART


class SlicerSettings(XmlFile):
    """File in which a slicer names volumes. Its ids are those of objects of the root model."""

    def __init__(self, file: str = "") -> None:
        super().__init__(file)
        self.runs: dict[str, list[Run]] = {}  # ranges of triangles by object
        self.kinds: dict[tuple[str, str], str] = {}  # kinds of volumes by object and component
        self._object = ""

    def start(self, uri: str | None, name: str, attributes: dict[str, str]) -> None:
        """Read an object, a volume of it, or a property of the volume."""
        if name == "object":
            self._object = attributes["id"]
        elif name == "part":
            kind = _KINDS.get(attributes.get("subtype", ""), PART)
            self.kinds[self._object, attributes["id"]] = kind
        elif name == "volume":
            run = Run(int(attributes["firstid"]), int(attributes["lastid"]))
            self.runs.setdefault(self._object, []).append(run)
        elif name == "metadata" and self._object in self.runs:
            key, value = attributes.get("key"), attributes.get("value", "")
            if key == "volume_type":
                self.runs[self._object][-1].kind = _KINDS.get(value, PART)
            elif key == "modifier" and value == "1":  # written before 2018
                self.runs[self._object][-1].kind = "modifier"


def subtract(
    part: Arrays, matrix: np.ndarray, negatives: list[tuple[Arrays, np.ndarray]], done: Counter[str]
) -> Arrays:
    """Return a part from which negative volumes are subtracted.

    *negatives*: arrays of each volume, and its matrix. *done*: counts parts that were "cut", and those for
    which this "failed".
    """
    done["work"] += len(part[1]) + sum(len(held[1]) + _WORK_OF_VOLUME for held, _ in negatives)
    solid = _solid(part, np.eye(4)) if done["work"] <= _MAX_WORK else None
    if solid is None:
        done["failed"] += 1
        return part
    # Volumes in one mesh have the same matrix. Multiplying by its inverse would separate flush faces.
    frames = [
        np.eye(4) if np.array_equal(other, matrix) else np.linalg.solve(matrix, other)
        for _, other in negatives
    ]
    tools = [
        _solid(held, frame, part[0], _ROUNDING * _largest(part[0], held[0], matrix, other))
        for (held, other), frame in zip(negatives, frames, strict=True)
    ]
    done["failed"] += None in tools
    met = [tool for tool in tools if tool is not None and _boxes_meet(solid, tool)]
    if not met:
        return part
    done["cut"] += 1
    for tool in met:
        solid -= tool
    mesh = solid.to_mesh64()
    vertices = np.ascontiguousarray(mesh.vert_properties[:, :3], dtype=np.float64)
    return vertices, mesh.tri_verts.astype(np.int64), np.array(mesh.face_id, dtype=np.int32)


def _solid(
    arrays: Arrays, matrix: np.ndarray, flush: np.ndarray | None = None, tolerance: float = 0.0
) -> Any:
    """Return a mesh moved by *matrix* as a ``manifold3d.Manifold``, or None if it is not a closed solid.

    *flush*: vertices of another mesh; coordinates within *tolerance* of theirs are set equal to them.
    """
    vertices, faces, rows = arrays
    points = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    if flush is not None:
        points = np.stack(
            [_snapped(*pair, tolerance) for pair in zip(points.T, flush.T, strict=True)], axis=1
        )
    faces = faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0.0 else faces
    if not np.isfinite(points).all():
        return None
    ids, corners = merged_faces(points, np.ascontiguousarray(faces, dtype=np.int32))
    if not topology_of(ids).is_balanced:
        return None
    solid = manifold_solid(corners, ids, rows)
    return solid if solid.status().name == "NoError" and solid.volume() > 0.0 else None


def _largest(*arrays: np.ndarray) -> float:
    """Return the largest absolute value of all numbers."""
    return max(float(np.abs(array).max(initial=0.0)) for array in arrays)


def _snapped(values: np.ndarray, marks: np.ndarray, tolerance: float) -> np.ndarray:
    """Return values in which each value within *tolerance* of a mark is replaced by the nearest mark."""
    marks = np.unique(marks)
    after = np.searchsorted(marks, values).clip(1, len(marks) - 1)
    before = after - 1
    nearest = marks[np.where(values - marks[before] <= marks[after] - values, before, after)]
    return np.where(np.abs(values - nearest) <= tolerance, nearest, values)


def _boxes_meet(one: Any, other: Any) -> bool:
    a, b = one.bounding_box(), other.bounding_box()
    return all(a[k] < b[k + 3] and b[k] < a[k + 3] for k in range(3))
