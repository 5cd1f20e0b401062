"""Read a model file of a 3MF archive, with its unit, objects and build items.

Only arrays of numbers are kept.
"""

import re
from array import array
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats.threemf.package import XmlFile, part_name, shown

_UNITS = {"micron": "um", "millimeter": "mm", "centimeter": "cm", "inch": "in", "foot": "ft", "meter": "m"}
_DEFAULT_UNIT = "millimeter"  # default of the specification
_CORE = re.compile(r"https?://schemas\.microsoft\.com/3dmanufacturing/(core/|\d{4}/\d{2}/?$)")
"""Pattern of the namespaces of the core. Those of drafts before 1.0 contain only the date."""
_STRUCTURE = frozenset({"object", "mesh", "vertices", "triangles", "component", "item"})
_NAMES = _STRUCTURE | {"model", "vertex", "triangle"}
_HARMLESS_EXTENSIONS = ("/production/", "/material/", "/trianglesets/", "/slice/")
"""Extensions that spread objects over files, colour them, name sets of triangles, or accompany meshes."""
_LEFT_OUT_TYPES = ("support", "solidsupport", "other")
"""Types in the core that are omitted. Supports are broken off after printing, and "other" is never
printed."""
_IDENTITY = np.eye(4)


class Reference(NamedTuple):
    """Reference to an object with a matrix. It is an item of the build or a component of another object."""

    target: tuple[str, str]  # model file and id of the object
    matrix: np.ndarray  # (4, 4) float64, acts on columns
    part_number: str = ""
    is_printable: bool = True


@dataclass(slots=True)
class Object:
    """An object of a model file, which has a mesh or components."""

    name: str
    kind: str = ""  # type of an object that is not a part
    is_coarse: bool = False  # whether its shape is in slices and its mesh only approximates it
    has_mesh: bool = False
    coordinates: array = field(default_factory=lambda: array("d"))  # x y z x y z ...
    corners: array = field(default_factory=lambda: array("q"))
    components: list[Reference] = field(default_factory=list)


class ModelFile(XmlFile):
    """Contents of a model file in the archive."""

    unit: str | None  # a key of `units.UNITS`; None before the element model was seen
    objects: dict[str, Object]  # objects by id
    items: list[Reference]
    notes: list[str]

    def __init__(self, file: str) -> None:
        super().__init__(file)
        self.unit, self.objects, self.items, self.notes = None, {}, [], []
        self._name = part_name(file)
        self._current: Object | None = None
        self._lists: set[tuple[int, str]] = set()

    def start(self, uri: str | None, name: str, attributes: dict[str, str]) -> None:
        """Read an element of the core specification. Elements of extensions are ignored."""
        if uri is None and name in _NAMES:
            raise MeshFormatError(f"{self.line()}: the prefix of <{name}> is not declared")
        if uri is None or (uri and not _is_core(uri)):
            return
        if name == "vertex":
            self._vertex(attributes)
        elif name == "triangle":
            self._triangle(attributes)
        elif name == "model":
            self.unit = self._unit_of(attributes)
        elif name in _STRUCTURE:
            self._structure(name, attributes)

    def _vertex(self, attributes: dict[str, str]) -> None:
        if self._current is not None:
            point = float(attributes["x"]), float(attributes["y"]), float(attributes["z"])
            self._current.coordinates.extend(point)

    def _triangle(self, attributes: dict[str, str]) -> None:
        if self._current is not None:
            corners = int(attributes["v1"]), int(attributes["v2"]), int(attributes["v3"])
            self._current.corners.extend(corners)

    def _structure(self, name: str, attributes: dict[str, str]) -> None:
        if name == "object":
            own_id = attributes["id"]
            if own_id in self.objects:
                raise MeshFormatError(f"object {shown(own_id)} of {shown(self.file)} occurs twice")
            kind = attributes.get("type", "").strip()
            self._current = self.objects[own_id] = Object(
                name=attributes.get("name", "").strip() or own_id,
                kind=kind if kind in _LEFT_OUT_TYPES else "",
                is_coarse=_without_prefix(attributes, "meshresolution") == "lowres",
            )
        elif name == "item":
            self._current = None
            self.items.append(self._reference(attributes))
        elif self._current is not None and name == "component":
            self._current.components.append(self._reference(attributes))
        elif self._current is not None:
            if (len(self.objects), name) in self._lists:
                raise MeshFormatError(f"{self.line()}: an object has a second <{name}>, expected one")
            self._lists.add((len(self.objects), name))
            self._current.has_mesh = True

    def _reference(self, attributes: dict[str, str]) -> Reference:
        path = _without_prefix(attributes, "path")
        matrix = _IDENTITY
        if "transform" in attributes:
            numbers = [float(word) for word in attributes["transform"].split()]
            if len(numbers) != 12:
                raise ValueError(f"its transform has {len(numbers)} numbers, expected 12")
            matrix = np.eye(4)
            matrix[:3] = np.array(numbers).reshape(4, 3).T  # in the format the matrix acts on rows
        file = part_name(path) if path else self._name
        return Reference(
            (file, attributes["objectid"]),
            matrix,
            attributes.get("partnumber", "").strip(),
            attributes.get("printable", "").strip() not in ("0", "false"),
        )

    def _unit_of(self, attributes: dict[str, str]) -> str:
        needed = attributes.get("requiredextensions", "")
        # A writer may choose any prefix, so that only the namespaces are compared.
        uris = [self.uri_of(prefix) or prefix.replace("/", "") for prefix in needed.split()]
        unread = [uri for uri in uris if not any(word in uri for word in _HARMLESS_EXTENSIONS)]
        if unread:
            raise MeshFormatError(
                f"it needs extensions that are not read: {shown(', '.join(map(_extension_name, unread)))}"
            )
        if any("/slice/" in uri for uri in uris):
            self.notes.append("it needs the slice extension: its meshes were read, its slices were not")
        unit = attributes.get("unit", _DEFAULT_UNIT).strip().lower()
        if unit not in _UNITS:
            raise MeshFormatError(f"its unit is {unit[:40]!r}, expected one of {', '.join(_UNITS)}")
        return _UNITS[unit]


def _extension_name(uri: str) -> str:
    """Return the name of an extension, the last word of its namespace before the year and month."""
    return next((word for word in reversed(uri.split("/")) if word and not word.isdigit()), uri)


@lru_cache(64)
def _is_core(uri: str) -> bool:
    return _CORE.match(uri) is not None


def _without_prefix(attributes: dict[str, str], name: str) -> str:
    return next((value.strip() for key, value in attributes.items() if key.rpartition(":")[2] == name), "")
