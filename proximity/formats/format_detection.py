"""Detection of a file's format from its contents, independently of its name."""

import re

from proximity.errors import MeshFormatError
from proximity.formats.contents import Source

EXTENSIONS: dict[str, str] = {
    ".stl": "STL",
    ".obj": "OBJ",
    ".ply": "PLY",
    ".off": "OFF",
    ".glb": "GLB",
    ".gltf": "glTF",
    ".3mf": "3MF",
    ".step": "STEP",
    ".stp": "STEP",
}
"""Extension, lower case -> format."""

STL_HEADER_BYTES = 84
STL_FACET_BYTES = 50

_SIGNATURES: tuple[tuple[bytes, str], ...] = (
    (rb"glTF", "GLB"),
    (rb"PK(\x03\x04|\x05\x06)", "a zip archive"),
    (rb"ply\s", "PLY"),
    (rb"\s*ISO-10303-21\s*;", "STEP"),
    (rb"(#[^\n]*\n|\s)*(?i:(ST)?C?N?4?n?OFF)(?![a-zA-Z_])", "OFF"),  # some join it with the counts
    (rb"\s*\{[\s\S]*\"asset\"", "glTF"),
    (rb"version https://git-lfs", "a Git LFS pointer (the file itself was not fetched)"),
    (rb"\s*(<!doctype html|<html)", "a web page"),
    (rb"\s*<(\?xml|svg)", "an XML file"),
    (rb"\x1f\x8b", "a gzip archive"),
    (rb"\x89PNG|\xff\xd8\xff|GIF8", "an image"),
    (rb"%PDF-", "a PDF document"),
    (rb"\xff\xfe|\xfe\xff", "text in UTF-16 (save it as UTF-8)"),
)
_ASCII_STL = re.compile(rb"(\xef\xbb\xbf)?(\s|[#;!/][^\r\n]*[\r\n])*solid\b", re.IGNORECASE)
_OBJ_LINES = re.compile(rb"((mtllib|usemtl|o|g|s)\s[^\n]*\n|#[^\n]*\n|\s)*v\s+[-+.\d]")
_SNIFFED_BYTES = 65536
_TEXT_EXTENSIONS = frozenset([".obj", ".off", ".gltf", ".step", ".stp"])


def find_format(source: Source, extension: str) -> str:
    """Return the format of a file by its extension; raise if the content contradicts it."""
    looks_like = describe_content(source.data)
    if extension == ".toml":
        raise MeshFormatError(
            "it is named like a scene file, expected a file of parts; `proximity compile` makes one of it"
        )
    if extension not in EXTENSIONS:
        guess = f" (it looks like {looks_like})" if looks_like else ""
        named = f"unknown extension {extension!r}" if extension else "the name has no extension"
        raise MeshFormatError(f"{named}{guess}, expected one of {', '.join(EXTENSIONS)}")
    expected = EXTENSIONS[extension]
    if looks_like is not None and looks_like != expected:
        raise MeshFormatError(f"it is named like {expected}, but looks like {looks_like}")
    return expected


def describe_content(data: bytes) -> str | None:
    """Return the format of *data*: one of `EXTENSIONS`, the name of another format, or None."""
    head = data[:_SNIFFED_BYTES]
    if head.startswith(b"\xef\xbb\xbf"):
        head = head[3:]
    if is_binary_stl(data):
        return "STL"
    # The directory of an archive is at its end.
    if head.startswith(b"PK\x03\x04") and b".model" in (head + data[-_SNIFFED_BYTES:]).lower():
        return "3MF"
    for pattern, name in _SIGNATURES:
        if re.match(pattern, head, re.IGNORECASE if name.startswith("a") else 0):
            return name
    if is_ascii_stl(data):
        return "STL"
    return "OBJ" if _OBJ_LINES.match(head) else None


def is_binary_stl(data: bytes) -> bool:
    """Return whether a file has the length required by its face count, with or without a leading "solid"."""
    if len(data) <= STL_HEADER_BYTES:
        return False
    return len(data) == STL_HEADER_BYTES + STL_FACET_BYTES * stl_face_count(data)


def stl_face_count(data: bytes) -> int:
    """Return the face count that a binary STL file claims."""
    return int.from_bytes(data[STL_HEADER_BYTES - 4 : STL_HEADER_BYTES], "little")


def is_ascii_stl(data: bytes) -> bool:
    """Return whether the file begins with "solid", comments aside, and continues as text."""
    return _ASCII_STL.match(data[:_SNIFFED_BYTES]) is not None and b"\0" not in data[:1024].rstrip(b"\0")


def check_size(head: bytes, size: int, extension: str) -> None:
    """Refuse a large file whose first bytes contradict its size in bytes, before the rest is read."""
    held = f"bytes, but the file has {size:,}"
    if extension == ".stl" and not is_ascii_stl(head):
        claimed = STL_HEADER_BYTES + STL_FACET_BYTES * stl_face_count(head)
        if claimed != size:
            raise MeshFormatError(f"its header says {stl_face_count(head):,} faces: {claimed:,} {held}")
    elif extension == ".glb" and head[:4] == b"glTF" and int.from_bytes(head[8:12], "little") != size:
        raise MeshFormatError(f"its header says {int.from_bytes(head[8:12], 'little'):,} {held}")
    elif extension in _TEXT_EXTENSIONS and b"\0" in head and b"OFF BINARY" not in head:
        raise MeshFormatError(
            f"it is named like {EXTENSIONS[extension]}, a format of text, but holds zero bytes "
            "(text in UTF-16 is to be saved as UTF-8)"
        )
