"""One model file of a 3MF archive: its unit, objects and build items, parsed as a stream.

The parser is Python's own (expat): linear in the size of the text, nothing but arrays of numbers is kept,
and a document type, through which XML can name other files or grow without end, is refused.
"""

from array import array
from dataclasses import dataclass, field
from typing import Any, NamedTuple
from xml.parsers import expat

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import text_rows

_UNITS = {"micron": "um", "millimeter": "mm", "centimeter": "cm", "inch": "in", "foot": "ft", "meter": "m"}
_DEFAULT_UNIT = "millimeter"  # of the specification
_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/"
_HARMLESS_EXTENSIONS = ("/production/", "/material/")
"""Production only spreads objects over files, materials only colour them."""
_IDENTITY = np.eye(4)


class Reference(NamedTuple):
    """Reference to an object with a matrix: an item of the build, or a component of another object."""

    target: tuple[str, str]  # model file and id of the object
    matrix: np.ndarray  # (4, 4) float64, acts on columns
    part_number: str  # "" where it has none


@dataclass(slots=True)
class Object:
    """An object of a model file: a mesh, or components."""

    name: str
    has_mesh: bool = False
    coordinates: array = field(default_factory=lambda: array("d"))  # x y z x y z ...
    corners: array = field(default_factory=lambda: array("q"))
    components: list[Reference] = field(default_factory=list)


class ModelParser:
    """Takes a model file piece by piece.

    Parameters
    ----------
    file : str
        Its name in the archive.
    """

    unit: str | None  # a key of `units.UNITS`; None before the element model was seen
    objects: dict[str, Object]  # by id
    items: list[Reference]

    def __init__(self, file: str) -> None:
        self.unit, self.objects, self.items = None, {}, []
        self._file = file
        self._current: Object | None = None
        self._namespaces: dict[str, str] = {}
        self._lists: set[tuple[int, str]] = set()
        self._expat = expat.ParserCreate(namespace_separator=" ")
        self._expat.buffer_text = True
        self._expat.StartElementHandler = self._start
        self._expat.StartNamespaceDeclHandler = self._declare
        self._expat.StartDoctypeDeclHandler = self._refuse_doctype

    def feed(self, data: bytes, *, is_last: bool = False) -> None:
        """Parse the next bytes.

        Raises
        ------
        MeshFormatError
            If it is not XML, or says what is not understood.
        """
        try:
            self._expat.Parse(data, is_last)
        except expat.ExpatError as reason:
            raise MeshFormatError(f"{_shown(self._file)} is not XML ({reason})") from reason
        if is_last and self.unit is None:
            raise MeshFormatError("its model file has no element model")

    def _declare(self, prefix: str | None, uri: str) -> None:
        self._namespaces[prefix or ""] = uri

    def _refuse_doctype(self, *_: Any) -> None:
        raise MeshFormatError(
            f"{_shown(self._file)} has a document type (<!DOCTYPE>), expected none in a 3MF"
        )

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        namespace, _, name = tag.rpartition(" ")
        if namespace and not namespace.startswith(_CORE):
            return  # of an extension
        try:
            if name == "vertex":
                self._vertex(attributes)
            elif name == "triangle":
                self._triangle(attributes)
            elif name == "model":
                self.unit = self._unit_of(attributes)
            elif name in ("object", "mesh", "vertices", "triangles", "component", "item"):
                self._structure(name, attributes)
        except MeshFormatError:  # a ValueError, too
            raise
        except KeyError as missing:
            raise MeshFormatError(f"{self._line()}: <{name}> has no {missing.args[0]}") from None
        except (ValueError, OverflowError) as reason:
            raise MeshFormatError(f"{self._line()}: <{name}> cannot be read ({reason})") from None

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
                raise MeshFormatError(f"object {_shown(own_id)} of {_shown(self._file)} occurs twice")
            self._current = self.objects[own_id] = Object(attributes.get("name", "").strip() or own_id)
        elif name == "item":
            self._current = None
            self.items.append(self._reference(attributes))
        elif self._current is not None and name == "component":
            self._current.components.append(self._reference(attributes))
        elif self._current is not None:
            if (len(self.objects), name) in self._lists:
                raise MeshFormatError(f"{self._line()}: an object has a second <{name}>, expected one")
            self._lists.add((len(self.objects), name))
            self._current.has_mesh = True

    def _reference(self, attributes: dict[str, str]) -> Reference:
        path = next((value for key, value in attributes.items() if key.rpartition(" ")[2] == "path"), "")
        matrix = _IDENTITY
        if "transform" in attributes:
            numbers = [float(word) for word in attributes["transform"].split()]
            if len(numbers) != 12:
                raise ValueError(f"its transform has {len(numbers)} numbers, expected 12")
            matrix = np.eye(4)
            matrix[:3] = np.array(numbers).reshape(4, 3).T  # the format multiplies rows
        file = path.strip("/") or self._file
        return Reference((file, attributes["objectid"]), matrix, attributes.get("partnumber", "").strip())

    def _unit_of(self, attributes: dict[str, str]) -> str:
        needed = attributes.get("requiredextensions", "")
        # Prefixes are the writer's choice: only what they stand for counts.
        if not all(
            any(word in self._namespaces.get(prefix, "") for word in _HARMLESS_EXTENSIONS)
            for prefix in needed.split()
        ):
            raise MeshFormatError(f"it needs the extensions {needed[:40]}, which are not read")
        unit = attributes.get("unit", _DEFAULT_UNIT).strip().lower()
        if unit not in _UNITS:
            raise MeshFormatError(f"its unit is {unit[:40]!r}, expected one of {', '.join(_UNITS)}")
        return _UNITS[unit]

    def _line(self) -> str:
        return f"line {self._expat.CurrentLineNumber} of {_shown(self._file)}"


def _shown(text: str) -> str:
    return text_rows.shortened(text, 60)
