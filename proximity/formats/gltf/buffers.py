"""The bytes of a glTF document: chunks, buffers, accessors, each checked against the other."""

import base64
import binascii
import json
import os
import struct
import sys
import urllib.parse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import text_rows
from proximity.system.regular_file import open_regular

_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942
_GLB_HEADER_BYTES, _CHUNK_HEADER_BYTES = 12, 8
_DTYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_QUANTISED = (5120, 5121, 5122, 5123)  # whole numbers of one or two bytes
_COMPONENTS = {"SCALAR": 1, "VEC3": 3}
_LARGEST_INTEGER = 2**53  # of JSON, where numbers are float64
_BOUNDS_ROUNDING = 1e-5  # of the largest coordinate: single precision, or six digits of text


@dataclass(slots=True, eq=False)
class Document:
    """A parsed header and the buffers that it refers to."""

    json: dict[str, Any]
    buffers: list[bytes]

    def entry(self, kind: str, index: int) -> dict[str, Any]:
        """Return one entry of a list of the header.

        Parameters
        ----------
        kind : str
            "nodes", "meshes" ...
        index : int
            Which one.

        Raises
        ------
        MeshFormatError
            If there is none.
        """
        found = entries(self.json, kind)
        if not 0 <= index < len(found) or not isinstance(found[index], dict):
            raise MeshFormatError(f"it refers to {kind} {index}, but holds {len(found)}")
        return found[index]


def entries(holder: dict[str, Any], key: str) -> list[Any]:
    """Return a list of the header; it is empty where there is none.

    Raises
    ------
    MeshFormatError
        If there is something else.
    """
    values = holder.get(key) or []
    if not isinstance(values, list):
        raise MeshFormatError(f"its JSON has {key} that are not a list")
    return values


def integer(value: Any, what: str) -> int:
    """Return a whole number that is not negative.

    Raises
    ------
    MeshFormatError
        If it is something else.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _LARGEST_INTEGER:
        raise MeshFormatError(f"{what}: there is {_shown(value)}, expected a whole number, 0 or more")
    return value


def numbers(values: Any, count: int, what: str) -> list[float]:
    """Return a list of finite numbers.

    Parameters
    ----------
    values : object
        Out of JSON.
    count : int
        How many there should be.
    what : str
        For the message.

    Raises
    ------
    MeshFormatError
        If it is something else.
    """
    if (
        not isinstance(values, list)
        or len(values) != count
        or not all(isinstance(value, (int, float)) and abs(value) <= sys.float_info.max for value in values)
    ):
        raise MeshFormatError(f"{what} is not {count} finite numbers")
    return values


def _shown(value: Any) -> str:
    """A value of JSON, as long as a message can bear."""
    if isinstance(value, str):
        return text_rows.shortened(value)
    text = repr(value)
    return text if len(text) <= 24 else text[:24] + "..."


def split_glb(data: bytes) -> tuple[bytes, bytes | None, list[str]]:
    """Return the JSON and the binary chunk of a GLB file, and notes.

    Raises
    ------
    MeshFormatError
        If lengths do not fit.
    """
    if len(data) < _GLB_HEADER_BYTES or data[:4] != b"glTF":
        raise MeshFormatError("it does not begin with a GLB header of 12 bytes")
    _, version, length = struct.unpack_from("<4sII", data)
    if version != 2:
        raise MeshFormatError(f"it is glTF version {version}, expected 2")
    if length > len(data):
        raise MeshFormatError(f"its header says {length} bytes, but the file has {len(data)}: it is cut off")
    notes = [f"{len(data) - length} bytes after its end were ignored"] if length < len(data) else []
    chunks: dict[int, bytes] = {}
    at = _GLB_HEADER_BYTES
    while at < length:
        if at + _CHUNK_HEADER_BYTES > length:
            raise MeshFormatError("it ends within the header of a chunk: it is cut off")
        chunk_length, kind = struct.unpack_from("<II", data, at)
        at += _CHUNK_HEADER_BYTES
        if at + chunk_length > length:
            raise MeshFormatError(
                f"a chunk of {chunk_length} bytes does not fit into the {length - at} that are left: "
                "it is cut off"
            )
        chunks.setdefault(kind, data[at : at + chunk_length])
        at += chunk_length
    if _JSON_CHUNK not in chunks:
        raise MeshFormatError("it has no JSON chunk")
    return chunks[_JSON_CHUNK], chunks.get(_BINARY_CHUNK), notes


def parse_document(header: bytes, path: str, binary: bytes | None) -> Document:
    """Return the parsed header with all buffers, checked.

    Raises
    ------
    MeshFormatError
        If it is not JSON or no glTF 2, or a buffer is missing or short.
    """
    try:
        tree = json.loads(header.decode("utf-8-sig"))
    except (ValueError, RecursionError) as reason:
        raise MeshFormatError(f"its JSON cannot be read ({' '.join(str(reason).split())[:120]})") from reason
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        raise MeshFormatError("its JSON has no asset: it is not a glTF file")
    version = str(tree["asset"].get("version", ""))
    if version.split(".")[0] != "2":
        raise MeshFormatError(f"it is glTF version {text_rows.shortened(version)}, expected 2.0")
    document = Document(tree, [])
    for k in range(len(entries(tree, "buffers"))):
        entry = document.entry("buffers", k)
        length = integer(entry.get("byteLength"), f"the length of buffer {k}")
        data = _buffer_bytes(entry.get("uri"), k, path, binary, length)
        if len(data) < length:
            raise MeshFormatError(
                f"buffer {k} has {len(data)} bytes, but {length} are declared: it is cut off"
            )
        document.buffers.append(data[:length])
    return document


def _buffer_bytes(uri: Any, k: int, path: str, binary: bytes | None, length: int) -> bytes:
    if uri is None:
        if k or binary is None:
            raise MeshFormatError(
                f"buffer {k} is not there: it has no uri and the file no binary chunk for it"
            )
        return binary
    if not isinstance(uri, str):
        raise MeshFormatError(f"the uri of buffer {k} is no text")
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.partition("base64,")[2], validate=True)
        except (binascii.Error, ValueError) as reason:
            raise MeshFormatError(f"buffer {k} inside the file is not base64 text ({reason})") from reason
    return _read_beside(uri, f"buffer {k} is the file {text_rows.shortened(uri, 80)}", path, length)


def _read_beside(uri: str, what: str, path: str, length: int) -> bytes:
    """The first bytes of a file in the folder of the document, or below it, links followed; no other."""
    try:
        folder = Path(path).resolve().parent
        beside = (folder / urllib.parse.unquote(uri)).resolve()
        if "://" in uri or not beside.is_relative_to(folder):
            raise MeshFormatError(f"{what}, which is not in the folder of this file or below: it is not read")
        with open_regular(beside) as file:
            held = os.fstat(file.fileno()).st_size
            data = file.read(length) if held >= length else b""
    except MeshFormatError:  # a ValueError, too
        raise
    except (OSError, ValueError) as reason:
        reported = reason.strerror if isinstance(reason, OSError) else str(reason)
        raise MeshFormatError(f"{what} beside it, which cannot be read ({reported})") from reason
    if held < length:
        raise MeshFormatError(f"{what} of {held} bytes, but {length} are declared: it is cut off")
    return data


def check_accessor(
    document: Document, index: int, place: str, kind: str, component_types: tuple[int, ...]
) -> int:
    """Return how many entries an accessor has, after checking that all of them are there.

    Parameters
    ----------
    document : Document
        The file.
    index : int
        Which accessor.
    place : str
        Who asks, for the message.
    kind : str
        "SCALAR" or "VEC3".
    component_types : tuple of int
        Component types that are taken.

    Raises
    ------
    MeshFormatError
        If it is of another kind, reaches beyond its buffer, or holds other positions than it says.
    """
    accessor = document.entry("accessors", index)
    name = f"accessor {index} ({place})"
    if kind == accessor.get("type") == "VEC3" and accessor.get("componentType") in _QUANTISED:
        raise MeshFormatError(
            f"{name} has quantised positions (KHR_mesh_quantization), which are not supported; export it "
            "without"
        )
    if accessor.get("type") != kind or accessor.get("componentType") not in component_types:
        raise MeshFormatError(
            f"{name} has type {_shown(accessor.get('type'))} of {_shown(accessor.get('componentType'))}, "
            f"expected {kind!r} of {' or '.join(map(str, component_types))}"
        )
    if "sparse" in accessor or accessor.get("normalized") or "bufferView" not in accessor:
        raise MeshFormatError(f"{name} is sparse, normalised or without a buffer, expected plain numbers")
    count = integer(accessor.get("count"), f"the count of {name}")
    view_index = integer(accessor["bufferView"], f"the buffer view of {name}")
    view = document.entry("bufferViews", view_index)
    buffer_index = integer(view.get("buffer"), f"the buffer of {name}")
    view_start = integer(view.get("byteOffset", 0), f"the offset of buffer view {view_index}")
    view_length = integer(view.get("byteLength"), f"the length of buffer view {view_index}")
    document.entry("buffers", buffer_index)
    if view_start + view_length > len(document.buffers[buffer_index]):
        raise MeshFormatError(f"buffer view {view_index} reaches beyond the end of buffer {buffer_index}")
    component_bytes = np.dtype(_DTYPES[accessor["componentType"]]).itemsize
    entry_bytes = _COMPONENTS[kind] * component_bytes
    stride = integer(view.get("byteStride", entry_bytes), f"the stride of buffer view {view_index}")
    start = integer(accessor.get("byteOffset", 0), f"the offset of {name}")
    if stride < entry_bytes or (count and start + (count - 1) * stride + entry_bytes > view_length):
        raise MeshFormatError(f"{name} has {count} entries, which do not fit into buffer view {view_index}")
    if start % component_bytes or (view_start + start) % component_bytes or stride % component_bytes:
        raise MeshFormatError(
            f"{name} begins at byte {start} of buffer view {view_index}, which begins at {view_start} with "
            f"entries every {stride} bytes, expected multiples of {component_bytes}"
        )
    if kind == "VEC3" and count:
        _check_bounds(accessor, values(document, index), name)
    return count


def _check_bounds(accessor: dict[str, Any], positions: np.ndarray, name: str) -> None:
    """The format demands the bounds of positions; many writers leave them out."""
    rounding = _BOUNDS_ROUNDING * float(np.abs(positions[np.isfinite(positions)]).max(initial=0.0))
    for key, measured in (("min", np.fmin.reduce(positions)), ("max", np.fmax.reduce(positions))):
        if accessor.get(key) is None:
            continue
        reported = numbers(accessor[key], 3, f"the {key} of {name}")
        if any(abs(a - float(b)) > rounding for a, b in zip(reported, measured, strict=True)):
            shown = [", ".join(f"{value:g}" for value in values) for values in (reported, measured)]
            raise MeshFormatError(f"{name} says that its {key} is ({shown[0]}), but it is ({shown[1]})")


def values(document: Document, index: int) -> np.ndarray:
    """Return the entries of an accessor as they stand in its buffer, (count, components).

    Parameters
    ----------
    document : Document
        The file.
    index : int
        Which accessor; `check_accessor` has passed it.
    """
    accessor = document.json["accessors"][index]
    view = document.json["bufferViews"][accessor["bufferView"]]
    dtype = np.dtype(_DTYPES[accessor["componentType"]])
    width = _COMPONENTS[accessor["type"]]
    return np.ndarray(
        (accessor["count"], width),
        dtype,
        document.buffers[view["buffer"]],
        view.get("byteOffset", 0) + accessor.get("byteOffset", 0),
        (view.get("byteStride", width * dtype.itemsize), dtype.itemsize),
    )
