"""Archives: files of arrays that are memory-mapped, and refused if a bit has changed.

Knows files, arrays and JSON only; what the arrays mean is the business of `compiled`. A file is a header of
`HEADER` bytes, a JSON document, and the arrays, each on a page of its own and filled up with zeros::

    magic, byte order, format version, bytes of the file, bytes and checksum of the JSON part, own checksum
    JSON: what the arrays are laid out for; their names, types, shapes, offsets and checksums; anything else
    page by page: the arrays

These first 64 bytes keep their form in every version, so that any version can tell what it has before it.
Checksums guard against damage (a cut, a flipped bit, a page that went astray), not against malice: what the
arrays say is looked at by `compiled_model`.
"""

import json
import math
import os
import struct
import sys
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from proximity.errors import MeshFormatError, SceneError
from proximity.system.regular_file import open_regular
from proximity.system.whole_file import whole_file

FORMAT_VERSION = 2
"""Grows whenever something that was written before would be read as something else."""
MAGIC = b"\x93PROX\r\n\x1a"
"""No text, and changed by programs that take it for text."""
EXTENSION = ".prox"
BYTE_ORDER_MARK = 0x01020304
PAGE = 4096
"""Bytes; what is mapped begins on a page, so every array also begins on a cache line."""

HEADER = struct.Struct("=8sIIQQI24xI")
_HEADER_CHECKSUM = struct.Struct("=I")
_TYPES = {name: np.dtype(name) for name in ("float64", "float32", "int64", "int32")}
_WEIGHTS = np.arange(1, PAGE // 8 + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15) | np.uint64(1)
"""Odd, so that no changed bit is lost in a product; all different, so that no two words may be exchanged."""
_NOT_UNDERSTOOD = (ValueError, TypeError, LookupError, ArithmeticError, RecursionError)
_AGAIN = "save the scene again with this version"


@dataclass(frozen=True, slots=True, eq=False)
class Contents:
    """Contents of an archive."""

    metadata: dict[str, Any]  # as it was written
    arrays: dict[str, np.ndarray]  # mapped copy-on-write: changes stay in this process


def is_archive(path: Any) -> bool:
    """Return whether a regular file begins like one of these, or is at least named so.

    *path*: of a file that may not be there: then it is none.
    """
    try:
        name = os.fsdecode(path)
        with open_regular(name) as file:
            begins_so = file.read(len(MAGIC)) == MAGIC
    except (OSError, ValueError, TypeError):
        return False
    return begins_so or Path(name).suffix.lower() == EXTENSION


def check_extension(path: Any) -> None:
    """Refuse to write to a name that does not end in ".prox": it could be that of a mesh."""
    try:
        name = os.fsdecode(path)
    except TypeError:
        return  # refused where it is written
    if name and not name.lower().endswith(EXTENSION):
        raise SceneError(f"{name} does not end in {EXTENSION}, expected the name of a compiled scene")


# --- writing ---------------------------------------------------------------------------------------------


def write_archive(
    path: Any, metadata: dict[str, Any], arrays: dict[str, np.ndarray], layout: dict[str, int]
) -> None:
    """Write a file, wholly or not at all: until it is whole it bears another name.

    *path*: a file that is there is replaced; who has it mapped keeps the old one. *layout*: what the arrays
    are laid out for; whoever reads must say the same.
    """
    head = _head(metadata, arrays, layout)
    with whole_file(path, takes_devices=False) as file:
        _write_all(file, head, arrays)


def _head(metadata: dict[str, Any], arrays: dict[str, np.ndarray], layout: dict[str, int]) -> bytes:
    """Header and JSON, filled up to whole pages."""
    table, offset = [], 0
    for name, array in arrays.items():
        entry = {"name": name, "dtype": array.dtype.name, "shape": list(array.shape), "offset": offset}
        table.append({**entry, "checksum": checksum_of(array.reshape(-1).view(np.uint8))})
        offset += _whole_pages(array.nbytes)
    document = {"layout": layout, "arrays": table, "metadata": metadata}
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
    """Map a file, after looking at every bit of it.

    *path*: the file. It must not be changed in place as long as the arrays live; `write_archive` never does.

    Notes
    -----
    Cost: reading the file at the speed of memory, if the system has it there: 10 to 30 ms for 200 MB.
    """
    shown = os.fsdecode(path)
    try:
        with open_regular(path) as file:
            if os.fstat(file.fileno()).st_size == 0:
                raise MeshFormatError(f"it is empty, expected a compiled scene; {_AGAIN}")
            whole = np.memmap(file, np.uint8, "c").view(np.ndarray)
        text_bytes = _checked_header(whole)
        head_bytes = HEADER.size + text_bytes
        document = json.loads(whole[HEADER.size : head_bytes].tobytes())
        if head_bytes != _whole_pages(head_bytes) or type(document["layout"]) is not dict:
            raise ValueError("arrays lie across pages, or their layout is not named")
        _check_layout(document["layout"], layout)
        return Contents(document["metadata"], _checked_arrays(whole[head_bytes:], document["arrays"]))
    except MeshFormatError as reason:
        raise MeshFormatError(f"{shown}: {reason}") from None
    except OSError as reason:
        raise MeshFormatError(f"{shown}: it cannot be opened ({_reported(reason)})") from reason
    except _NOT_UNDERSTOOD as reason:  # its checksums are right, but not what it says
        raise MeshFormatError(f"{shown}: its description cannot be understood; {_AGAIN}") from reason


def _checked_header(whole: np.ndarray) -> int:
    """Bytes of the JSON part, if the file is whole and of this version and machine."""
    header = whole[: HEADER.size].tobytes()
    if not header.startswith(MAGIC):
        raise MeshFormatError(f"it is named like a compiled scene, but does not begin like one; {_AGAIN}")
    if len(header) < HEADER.size:
        raise MeshFormatError(f"it is cut off after {len(header)} bytes; {_AGAIN}")
    _, mark, version, file_bytes, text_bytes, text_checksum, header_checksum = HEADER.unpack(header)
    if mark == int.from_bytes(BYTE_ORDER_MARK.to_bytes(4, "big"), "little"):
        raise MeshFormatError(
            f"it was written on a machine of another byte order, expected {sys.byteorder}-endian; "
            "save the scene again on this machine"
        )
    if header_checksum != zlib.crc32(header[: -_HEADER_CHECKSUM.size]):
        raise MeshFormatError(f"it is damaged: the checksum of its header differs; {_AGAIN}")
    if version != FORMAT_VERSION:
        raise MeshFormatError(f"it has format version {version}, expected {FORMAT_VERSION}; {_AGAIN}")
    if len(whole) < file_bytes:
        raise MeshFormatError(f"it is cut off after {len(whole)} of {file_bytes} bytes; {_AGAIN}")
    if len(whole) > file_bytes:
        raise MeshFormatError(f"there are {len(whole) - file_bytes} bytes after its end; {_AGAIN}")
    if text_checksum != zlib.crc32(whole[HEADER.size : HEADER.size + text_bytes].data):
        raise MeshFormatError(f"it is damaged: the checksum of its description differs; {_AGAIN}")
    return int(text_bytes)


def _check_layout(written: dict[str, int], expected: dict[str, int]) -> None:
    for name in sorted({*written, *expected}):
        if written.get(name) != expected.get(name):
            raise MeshFormatError(
                "it was saved by another version, with another layout of trees "
                f"({name} is {written.get(name)}, expected {expected.get(name)}); {_AGAIN}"
            )


def _checked_arrays(data: np.ndarray, table: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """The arrays in *data*, which they fill from its first byte to its last, each as it was written."""
    arrays, end = {}, 0
    for entry in table:
        name, dtype, shape = entry["name"], _TYPES.get(entry["dtype"]), entry["shape"]
        start, size = end, math.prod(shape) * (dtype.itemsize if dtype else 0)
        end = start + _whole_pages(size)
        if dtype is None or min(shape) < 0 or entry["offset"] != start or end > len(data):
            raise MeshFormatError(f"its table of arrays does not fit it ({name!r}); {_AGAIN}")
        if entry["checksum"] != checksum_of(data[start : start + size]) or data[start + size : end].any():
            raise MeshFormatError(f"it is damaged: the checksum of {name!r} differs; {_AGAIN}")
        arrays[name] = data[start : start + size].view(dtype).reshape(shape)
    if end != len(data):
        raise MeshFormatError(f"its table of arrays does not fit it (the end); {_AGAIN}")
    return arrays


def checksum_of(data: np.ndarray) -> int:
    """Return a number of 32 bits that tells *data* from what it becomes by damage.

    Sums of weighted words, a page each, and the CRC of those: no single flipped bit and no page in another's
    place goes unseen, and it takes as long as reading memory does, a fifth of what a CRC of all takes.

    *data*: (N,) uint8.
    """
    whole = len(data) // PAGE * PAGE
    sums = np.einsum("pw,w->p", data[:whole].view(np.uint64).reshape(-1, PAGE // 8), _WEIGHTS)
    return zlib.crc32(data[whole:].data, zlib.crc32(sums.data))


def _reported(reason: Exception) -> str:
    return (isinstance(reason, OSError) and reason.strerror) or str(reason)


def _whole_pages(size: int) -> int:
    return -(-size // PAGE) * PAGE
