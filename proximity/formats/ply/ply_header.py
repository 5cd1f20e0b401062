"""Read the header of a PLY file, which declares the elements, their lengths and their properties."""

import re
from dataclasses import dataclass, field

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import text_rows
from proximity.formats.contents import DialectError

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "int64": "i8", "uint64": "u8",
    "float16": "f2", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_END = re.compile(rb"[\r\n][ \t]*(end_header)[ \t]*(?:\r\n|\n|\r|$)")
_FACE = re.compile(rb"^element[ \t]+face[ \t]+(\d{1,18})\s*$", re.MULTILINE)
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True, slots=True)
class Property:
    """A property of an element, which is a column of its table."""

    name: str
    dtype: np.dtype
    count_dtype: np.dtype | None = None  # type of the length that precedes the entries of a list


@dataclass(slots=True)
class Element:
    """An element of the file, which is a table."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)


@dataclass(slots=True)
class Header:
    """Declarations in the header."""

    is_ascii: bool
    elements: list[Element]
    data_start: int  # first byte of the data


def read_header(data: bytes) -> Header:
    """Read the header of a PLY file."""
    last_line = _END.search(data)
    if last_line is None:
        raise MeshFormatError("its header has no line end_header: it is cut off, or not a PLY file")
    end, data_start = last_line.start(1), last_line.end()
    lines = data[:end].decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if lines[0].removeprefix("\xef\xbb\xbf").strip().lower() != "ply":
        raise MeshFormatError("its first line is not ply")
    byte_order: str | None = None
    elements: list[Element] = []
    declared: set[tuple[str, str]] = set()  # elements with their properties
    for line_id, line in enumerate(lines[1:], 2):
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) > 1 and words[1] in _BYTE_ORDERS:
            byte_order = _BYTE_ORDERS[words[1]]
        elif (element := _element(words)) is not None:
            _check_new("", element.name, declared, line_id)
            elements.append(element)
        elif elements and (column := _property(words, byte_order or "<")) is not None:
            _check_new(elements[-1].name, column.name, declared, line_id)
            elements[-1].properties.append(column)
        else:
            message = f"line {line_id} of its header is {text_rows.shortened(line, 60)}"
            face = _FACE.search(data[:end])
            if face is None or words[0] in ("format", "element"):
                raise MeshFormatError(message)
            raise DialectError(message, int(face[1]))
    if byte_order is None:
        raise MeshFormatError("its header has no line format")
    return Header(byte_order == "", elements, data_start)


def _check_new(table: str, name: str, declared: set[tuple[str, str]], line_id: int) -> None:
    """Raise an error if a name is declared twice, since only one of the columns or tables would be read."""
    if (table, name) in declared:
        twice = text_rows.shortened(name)
        raise MeshFormatError(f"line {line_id} of its header declares {twice} a second time")
    declared.add((table, name))


def _element(words: list[str]) -> Element | None:
    """Return the element that a line declares, or None."""
    count = text_rows.as_count(words[2]) if words[0] == "element" and len(words) == 3 else None
    return None if count is None else Element(words[1], count)


def _property(words: list[str], byte_order: str) -> Property | None:
    """Return the property that a line declares, or None."""
    if words[0] != "property":
        return None
    if len(words) == 3 and words[1] in _TYPES:
        return Property(words[2], np.dtype(byte_order + _TYPES[words[1]]))
    is_list = len(words) == 5 and words[1] == "list" and words[2] in _TYPES and words[3] in _TYPES
    if not is_list or _TYPES[words[2]].startswith("f"):
        return None
    return Property(
        words[4], np.dtype(byte_order + _TYPES[words[3]]), np.dtype(byte_order + _TYPES[words[2]])
    )


def check_size(header: Header, size: int) -> None:
    """Raise an error if a file of *size* bytes is too short for the declared rows."""
    least, most = 0, 0.0
    for element in header.elements:
        for column in element.properties:
            width = 1 if header.is_ascii else column.dtype.itemsize
            if column.count_dtype is None:
                least, most = least + element.count * width, most + element.count * width
            else:
                counted = column.count_dtype.itemsize
                least += element.count * (1 if header.is_ascii else counted)
                most += element.count * (counted + (256.0 ** min(counted, 4)) * width)
    held = size - header.data_start
    if held < least or (not header.is_ascii and held > most + 2):
        rows = sum(element.count for element in header.elements)
        raise MeshFormatError(
            f"its header declares {rows:,} rows of {least:,} bytes or more, but {held:,} follow: "
            f"{'it is cut off, or a count is wrong' if held < least else 'a count is wrong'}"
        )
