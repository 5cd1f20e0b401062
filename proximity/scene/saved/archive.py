"""Archives: files of arrays that are mapped into memory, and rejected if a bit has changed.

This module deals only with files, arrays and JSON; `compiled_scene` defines the contents. A file has a header
of `HEADER` bytes, a JSON document, and the arrays, each starting on a page and padded with zeros::

    magic, byte order, format version, bytes of the file, bytes and checksum of the JSON part, own checksum
    JSON: layout of the arrays; their names, types, shapes, offsets and checksums; any other data
    page by page: the arrays

The first 64 bytes have the same form in every version, so that any version can recognise any file. Checksums
detect damage (a cut, a flipped bit, a misplaced page), not malice: `compiled_model` validates the contents of
the arrays.
"""

import json
import math
import os
import struct
import sys
import zlib
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

import proximity
from proximity.errors import FileVersionError, MeshFormatError, SceneError
from proximity.kernels.entries import checksum_of
from proximity.kernels.layout import EXTENSION, MAGIC
from proximity.kernels.scene.store import stored_bytes
from proximity.kernels.scene.store.model_validation import FAULT_SIZE, SOUND
from proximity.kernels.scene.store.stored_bytes import BYTE_ORDER_MARK, FORMAT_VERSION, PAGE
from proximity.system.regular_file import open_regular
from proximity.system.whole_file import whole_file

HEADER = struct.Struct("=8sIIQQI24xI")
_HEADER_CHECKSUM = struct.Struct("=I")
_TYPES = {name: np.dtype(name) for name in ("float64", "float32", "int64", "int32")}
_NOT_UNDERSTOOD = (ValueError, TypeError, LookupError, ArithmeticError, RecursionError)
AGAIN = "save the scene again with this version"
SENTENCES = {
    stored_bytes.NO_MAGIC: "it is no compiled scene; `proximity compile` makes one of files of parts",
    stored_bytes.CUT_HEADER: "it is cut off after {0} bytes",
    stored_bytes.OTHER_ORDER: "it was written on a machine of another byte order, expected "
    f"{sys.byteorder}-endian",
    stored_bytes.BAD_HEADER: "it is damaged: the checksum of its header differs",
    stored_bytes.OTHER_VERSION: "it has format version {0}, expected {1}",
    stored_bytes.CUT_OFF: "it is cut off after {0} of {1} bytes",
    stored_bytes.TOO_LONG: "there are {0} bytes after its end",
    stored_bytes.BAD_TEXT: "it is damaged: the checksum of its description differs",
    stored_bytes.BAD_ARRAY_TABLE: "its table of arrays does not fit it ({name})",
    stored_bytes.BAD_ARRAY: "it is damaged: the checksum of {name} differs",
    stored_bytes.BAD_END: "its table of arrays does not fit it (the end)",
}
"""Message for each kind of fault. {0} and {1} are numbers from the kernel, {name} is the array's name."""


@dataclass(frozen=True, slots=True, eq=False)
class Contents:
    """Contents of an archive."""

    metadata: dict[str, Any]  # as written
    arrays: dict[str, np.ndarray]  # mapped copy-on-write: changes stay in this process


def check_extension(path: Any) -> None:
    """Raise an error unless a file name ends in ".prox". Another name could be that of a mesh."""
    try:
        name = os.fsdecode(path)
    except TypeError:
        return  # raises where it is written
    if name and not name.lower().endswith(EXTENSION):
        raise SceneError(f"{name} does not end in {EXTENSION}, expected the name of a compiled scene")


# --- writing ---------------------------------------------------------------------------------------------


def write_archive(
    path: Any, metadata: dict[str, Any], arrays: dict[str, np.ndarray], layout: dict[str, int]
) -> None:
    """Write a file atomically. Until it is complete it has another name.

    *path*: an existing file is replaced; a process that has mapped it keeps the old contents. *layout*:
    numbers that define the layout of the arrays; a reader must give the same numbers.
    """
    head = _head(metadata, arrays, layout)
    with whole_file(path, takes_devices=False) as file:
        _write_all(file, head, arrays)


def _head(metadata: dict[str, Any], arrays: dict[str, np.ndarray], layout: dict[str, int]) -> bytes:
    """Return the header and the JSON part, padded to whole pages."""
    table, offset = [], 0
    for name, array in arrays.items():
        entry = {"name": name, "dtype": array.dtype.name, "shape": list(array.shape), "offset": offset}
        in_order = np.ascontiguousarray(array).reshape(-1)
        with np.errstate(over="ignore"):  # sums wrap around, which uncompiled kernels would warn of
            table.append({**entry, "checksum": checksum_of(in_order.view(np.uint8))})
        offset += _whole_pages(array.nbytes)
    document = {"version": proximity.__version__, "layout": layout, "arrays": table, "metadata": metadata}
    text = json.dumps(document, separators=(",", ":"), default=np.generic.item).encode("ascii")
    head_bytes = _whole_pages(HEADER.size + len(text))
    text = text.ljust(head_bytes - HEADER.size)
    fields = (MAGIC, BYTE_ORDER_MARK, FORMAT_VERSION, head_bytes + offset, len(text), zlib.crc32(text))
    header = HEADER.pack(*fields, 0)[: -_HEADER_CHECKSUM.size]
    return header + _HEADER_CHECKSUM.pack(zlib.crc32(header)) + text


def _write_all(file: BinaryIO, head: bytes, arrays: dict[str, np.ndarray]) -> None:
    file.write(head)
    for array in arrays.values():
        file.write(array.reshape(-1).view(np.uint8).data)
        file.write(bytes(_whole_pages(array.nbytes) - array.nbytes))


# --- reading ---------------------------------------------------------------------------------------------


def read_archive(path: Any, layout: dict[str, int]) -> Contents:
    """Map a file into memory, after verifying all of its checksums.

    *path*: the file. It must not be changed in place while the arrays exist; `write_archive` never does.

    Notes
    -----
    Cost: reading the file at the speed of memory, if the system has it cached: 10 to 30 ms for 200 MB.
    """
    shown = os.fsdecode(path)
    try:
        with open_regular(path) as file:
            if os.fstat(file.fileno()).st_size == 0:
                raise MeshFormatError(f"it is empty, expected a compiled scene; {AGAIN}")
            whole = np.memmap(file, np.uint8, "c").view(np.ndarray)
        text_bytes = _checked_header(whole)
        head_bytes = HEADER.size + text_bytes
        document = json.loads(whole[HEADER.size : head_bytes].tobytes())
        if head_bytes != _whole_pages(head_bytes) or type(document["layout"]) is not dict:
            raise ValueError("arrays lie across pages, or their layout is not named")
        _check_layout(document, layout)
        return Contents(document["metadata"], _checked_arrays(whole[head_bytes:], document["arrays"]))
    except MeshFormatError as reason:
        raise type(reason)(f"{shown}: {reason}") from None
    except OSError as reason:
        raise MeshFormatError(f"{shown}: it cannot be opened ({_reported(reason)})") from reason
    except _NOT_UNDERSTOOD as reason:  # its checksums are right, but not its contents
        raise MeshFormatError(f"{shown}: its description cannot be understood; {AGAIN}") from reason


def _checked_header(whole: np.ndarray) -> int:
    """Return the number of bytes of the JSON part.

    The file must be whole, and of this version and machine.
    """
    fault = np.zeros(FAULT_SIZE, np.int64)
    _refuse(stored_bytes.fault_in_header(whole, fault), fault)
    return int(fault[0])


def _refuse(kind: int, fault: np.ndarray, name: str = "") -> None:
    if kind == stored_bytes.NO_MAGIC:
        raise MeshFormatError(SENTENCES[kind])
    if kind == stored_bytes.OTHER_ORDER:
        raise MeshFormatError(f"{SENTENCES[kind]}; save the scene again on this machine")
    if kind != SOUND:
        error = FileVersionError if kind == stored_bytes.OTHER_VERSION else MeshFormatError
        raise error(f"{SENTENCES[kind].format(*fault.tolist(), name=repr(name))}; {AGAIN}")


def _check_layout(document: dict[str, Any], expected: dict[str, int]) -> None:
    written = document["layout"]
    for name in sorted({*written, *expected}):
        if written.get(name) != expected.get(name):
            raise FileVersionError(
                f"it was saved by version {document.get('version', 'unknown')}, expected "
                f"{proximity.__version__}: the layout of trees differs ({name} is {written.get(name)}, "
                f"expected {expected.get(name)}); {AGAIN}"
            )


def _checked_arrays(data: np.ndarray, table: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Return the arrays by name, after checking that they fill *data* and match their checksums."""
    rows, fault = [], np.zeros(FAULT_SIZE, np.int64)
    for entry in table:
        dtype, shape = _TYPES.get(entry["dtype"]), entry["shape"]
        size = math.prod(shape) * dtype.itemsize if dtype is not None and min(shape) >= 0 else -1
        rows.append((entry["offset"], size, entry["checksum"]))
    with np.errstate(over="ignore"):
        kind = stored_bytes.fault_in_arrays(data, np.array(rows, np.int64).reshape(-1, 3), fault)
    _refuse(kind, fault, table[fault[0]]["name"] if table else "")
    return {
        entry["name"]: data[start : start + size].view(entry["dtype"]).reshape(entry["shape"])
        for entry, (start, size, _) in zip(table, rows, strict=True)
    }


def _reported(reason: Exception) -> str:
    return (isinstance(reason, OSError) and reason.strerror) or str(reason)


def _whole_pages(size: int) -> int:
    return -(-size // PAGE) * PAGE
