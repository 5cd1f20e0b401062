"""Read the JSON of a glTF document, and the chunks, buffers and buffer views that it refers to."""

import base64
import binascii
import json
import os
import struct
import sys
import urllib.parse
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import text_rows
from proximity.system.regular_file import open_regular

_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942
_GLB_HEADER_BYTES, _CHUNK_HEADER_BYTES = 12, 8
_CONVERSION = " (gltf-pipeline converts files of version 1)"
_MAX_INTEGER = 2**53  # largest exact integer in JSON, where numbers are float64


@dataclass(slots=True, eq=False)
class Document:
    """Parsed JSON of a document and the buffers that it refers to."""

    json: dict[str, Any]
    buffers: list[bytes] = field(default_factory=list)
    arrays: dict[int, np.ndarray] = field(default_factory=dict)  # arrays of the accessors that were read
    wrong_bounds: list[str] = field(default_factory=list)  # sentences about wrong min and max of accessors

    def entry(self, kind: str, index: int) -> dict[str, Any]:
        """Return one entry of a list in the JSON, such as "nodes" or "meshes"."""
        found = entries(self.json, kind)
        if not 0 <= index < len(found) or not isinstance(found[index], dict):
            raise MeshFormatError(f"it refers to {kind} {index}, but holds {len(found)}")
        return found[index]

    def view(self, index: int) -> memoryview:
        """Return the bytes of a buffer view without copying them."""
        view = self.entry("bufferViews", index)
        buffer_index = integer(view.get("buffer"), f"the buffer of buffer view {index}")
        start = integer(view.get("byteOffset", 0), f"the offset of buffer view {index}")
        end = start + integer(view.get("byteLength"), f"the length of buffer view {index}")
        self.entry("buffers", buffer_index)
        if end > len(self.buffers[buffer_index]):
            raise MeshFormatError(f"buffer view {index} reaches beyond the end of buffer {buffer_index}")
        return memoryview(self.buffers[buffer_index])[start:end]


def entries(holder: dict[str, Any], key: str) -> list[Any]:
    """Return a list in the JSON. A missing list is empty."""
    values = holder.get(key) or []
    if not isinstance(values, list):
        raise MeshFormatError(f"its JSON has {key} that are not a list")
    return values


def extension(holder: dict[str, Any], name: str, place: str) -> dict[str, Any]:
    """Return the content that an entry has in an extension. A missing extension is empty."""
    extensions = holder.get("extensions") or {}
    if not isinstance(extensions, dict):
        raise MeshFormatError(f"{place} has extensions that are not a JSON object")
    found = extensions.get(name)
    return found if isinstance(found, dict) else {}


def integer(value: Any, what: str) -> int:
    """Return a non-negative integer. A number such as 8.0 is accepted."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _MAX_INTEGER:
        raise MeshFormatError(f"{what}: there is {shown(value)}, expected a whole number, 0 or more")
    return value


def numbers(values: Any, count: int, what: str) -> list[float]:
    """Return a list of finite numbers."""
    if (
        not isinstance(values, list)
        or len(values) != count
        or not all(isinstance(value, (int, float)) and abs(value) <= sys.float_info.max for value in values)
    ):
        raise MeshFormatError(f"{what} is not {count} finite numbers")
    return values


def shown(value: Any) -> str:
    """Return a JSON value as a short text for a message."""
    if isinstance(value, str):
        return text_rows.shortened(value)
    text = repr(value)
    return text if len(text) <= 24 else text[:24] + "..."


def split_glb(data: bytes) -> tuple[bytes, bytes | None, list[str]]:
    """Return the JSON chunk and the binary chunk of a GLB file, and notes."""
    if len(data) < _GLB_HEADER_BYTES or data[:4] != b"glTF":
        raise MeshFormatError("it does not begin with a GLB header of 12 bytes")
    _, version, length = struct.unpack_from("<4sII", data)
    if version != 2:
        raise MeshFormatError(f"it is glTF version {version}, expected 2{_CONVERSION}")
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


def parse_header(header: bytes) -> Document:
    """Parse the JSON of a document. Its buffers are not loaded."""
    try:
        tree = json.loads(header.decode("utf-8-sig"))
    except (ValueError, RecursionError) as reason:
        raise MeshFormatError(f"its JSON cannot be read ({' '.join(str(reason).split())[:120]})") from reason
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        raise MeshFormatError("its JSON has no asset: it is not a glTF file")
    version = str(tree["asset"].get("version", ""))
    if version.split(".")[0] != "2":
        raise MeshFormatError(f"it is glTF version {text_rows.shortened(version)}, expected 2.0{_CONVERSION}")
    return Document(tree)


def load_buffers(document: Document, path: str, binary: bytes | None) -> None:
    """Load the buffers of a document from the file itself or from files in its folder."""
    for k in range(len(entries(document.json, "buffers"))):
        entry = document.entry("buffers", k)
        length = integer(entry.get("byteLength"), f"the length of buffer {k}")
        data = _buffer_bytes(entry.get("uri"), k, path, binary, length)
        if len(data) < length:
            raise MeshFormatError(
                f"buffer {k} has {len(data)} bytes, but {length} are declared: it is cut off"
            )
        document.buffers.append(data[:length])


def _buffer_bytes(uri: Any, k: int, path: str, binary: bytes | None, length: int) -> bytes:
    if uri is None:
        if k or binary is None:
            raise MeshFormatError(
                f"buffer {k} is not there: it has no uri and the file no binary chunk for it"
            )
        return binary
    if not isinstance(uri, str):
        raise MeshFormatError(f"the uri of buffer {k} is not text")
    if uri[:5].lower() == "data:":
        return _data_uri_bytes(uri, k)
    return _read_beside(uri, f"buffer {k} is the file {text_rows.shortened(uri, 80)}", path, length)


def _data_uri_bytes(uri: str, k: int) -> bytes:
    """Return the bytes of a data URI.

    Base64 may have line breaks or percent-encoding, and may lack padding.
    """
    head, _, text = uri.partition(",")
    data = urllib.parse.unquote_to_bytes(text)
    if not head.lower().endswith(";base64"):
        return data
    data = data.translate(None, b" \t\r\n").rstrip(b"=")
    try:
        return base64.b64decode(data + b"=" * (-len(data) % 4), validate=True)
    except (binascii.Error, ValueError) as reason:
        raise MeshFormatError(f"buffer {k} inside the file is not base64 text ({reason})") from reason


def _read_beside(uri: str, what: str, path: str, length: int) -> bytes:
    """Return the first bytes of a file in the document's folder or below it.

    Links are followed. A file elsewhere is refused.
    """
    try:
        folder = Path(path).resolve().parent
        beside = (folder / urllib.parse.unquote(uri)).resolve()
        if "://" in uri or not beside.is_relative_to(folder):
            raise MeshFormatError(f"{what}, which is not in the folder of this file or below: it is not read")
        with open_regular(beside) as file:
            held = os.fstat(file.fileno()).st_size
            data = file.read(length) if held >= length else b""
    except MeshFormatError:  # a subclass of ValueError
        raise
    except (OSError, ValueError) as reason:
        reported = reason.strerror if isinstance(reason, OSError) else str(reason)
        raise MeshFormatError(f"{what} beside it, which cannot be read ({reported})") from reason
    if held < length:
        raise MeshFormatError(f"{what} of {held} bytes, but {length} are declared: it is cut off")
    return data
