"""Read the zip archive of a 3MF file, whose parts are XML files that are parsed as streams.

The parser is Python's own (expat), which takes time linear in the size of the text. A document type is
refused, since through it XML can name other files or grow without end.
"""

import posixpath
import zipfile
from typing import Any, TypeVar
from urllib.parse import unquote
from xml.parsers import expat

from proximity.errors import MeshFormatError
from proximity.formats import text_rows

_BOMB_RATIO, _BOMB_BYTES = 200, 50_000_000
"""Maximum ratio of unpacked to packed size, and unpacked size to which it does not apply. XML of real meshes
shrinks to a tenth."""
_CHUNK_BYTES = 1 << 20
_LEAVES = frozenset({"vertex", "triangle"})
"""Elements that occur millions of times. They declare no prefixes."""
_RELATIONSHIPS, _USUAL_ROOT = "/_rels/.rels", "/3d/3dmodel.model"


class XmlFile:
    """Parses an XML file in pieces and passes each element to `start`."""

    def __init__(self, file: str) -> None:
        self.file = file  # name of the file in the archive
        # Prefixes are resolved here: expat would refuse undeclared ones also in unused data.
        self._uris: dict[str, list[str]] = {"": [""]}  # namespaces of each prefix, the innermost last
        self._declared: list[dict[str, str]] = []  # prefixes declared by each open element
        self._expat = expat.ParserCreate()
        self._expat.buffer_text = True
        self._expat.StartElementHandler = self._open
        self._expat.EndElementHandler = self._close
        self._expat.StartDoctypeDeclHandler = self._refuse_doctype

    def feed(self, data: bytes, *, is_last: bool = False) -> None:
        """Parse the next bytes. Raise MeshFormatError if they are not valid XML."""
        try:
            self._expat.Parse(data, is_last)
        except expat.ExpatError as reason:
            raise MeshFormatError(f"{shown(self.file)} is not XML ({reason})") from reason

    def start(self, uri: str | None, name: str, attributes: dict[str, str]) -> None:
        """Handle the start of an element.

        *uri*: namespace of its prefix, "" without a prefix, None if the prefix is not declared.
        """
        raise NotImplementedError

    def uri_of(self, prefix: str) -> str | None:
        """Return the namespace of a prefix at the current position."""
        uris = self._uris.get(prefix)
        return uris[-1] if uris else None

    def line(self) -> str:
        """Return the position of the current element, for a message."""
        return f"line {self._expat.CurrentLineNumber} of {shown(self.file)}"

    def _open(self, tag: str, attributes: dict[str, str]) -> None:
        if tag not in _LEAVES:
            declared = {key[6:]: uri for key, uri in attributes.items() if key.partition(":")[0] == "xmlns"}
            for prefix, uri in declared.items():
                self._uris.setdefault(prefix, []).append(uri)
            self._declared.append(declared)
        prefix, _, name = tag.rpartition(":")
        try:
            self.start(self.uri_of(prefix), name, attributes)
        except MeshFormatError:  # a subclass of ValueError
            raise
        except KeyError as missing:
            raise MeshFormatError(f"{self.line()}: <{name}> has no {missing.args[0]}") from None
        except (ValueError, OverflowError) as reason:
            raise MeshFormatError(f"{self.line()}: <{name}> cannot be read ({reason})") from None

    def _close(self, tag: str) -> None:
        if tag not in _LEAVES:
            for prefix in self._declared.pop():
                self._uris[prefix].pop()

    def _refuse_doctype(self, *_: Any) -> None:
        raise MeshFormatError(f"{shown(self.file)} has a document type (<!DOCTYPE>), expected none in a 3MF")


_File = TypeVar("_File", bound=XmlFile)


class Package:
    """Parts of an archive, which are unpacked up to a limit on their total size."""

    def __init__(self, archive: zipfile.ZipFile, packed: int, limit: float) -> None:
        self._archive, self._packed, self._unpacked, self._limit = archive, packed, 0, limit
        self._entries: dict[str, zipfile.ZipInfo] = {}
        for entry in archive.infolist():
            name = part_name(entry.filename)
            if name in self._entries and name.endswith(".model"):
                raise MeshFormatError("its archive holds two model files of one name, expected each once")
            self._entries[name] = entry

    def __contains__(self, name: str) -> bool:
        return name in self._entries

    def read(self, name: str, kind: type[_File]) -> _File:
        """Return a parsed part of the archive.

        *name*: name in the form that `part_name` returns. *kind*: class that parses it.
        """
        entry = self._entries[name]
        self._unpacked += entry.file_size  # the archive gives no more bytes than it declares
        size = f"its models of {self._packed:,} bytes unpack to {self._unpacked:,} bytes"
        if self._unpacked > self._limit:
            raise MeshFormatError(f"{size}, expected at most {self._limit:,} (unpacked_limit)")
        if self._unpacked > max(_BOMB_BYTES, _BOMB_RATIO * self._packed):
            raise MeshFormatError(f"{size}, expected at most {_BOMB_RATIO} times as many")
        parsed = kind(entry.filename)
        with self._archive.open(entry) as stream:
            while piece := stream.read(_CHUNK_BYTES):  # the checksum is compared at the end
                parsed.feed(piece)
        parsed.feed(b"", is_last=True)
        return parsed

    def root(self) -> str:
        """Return the name of the root model.

        It is in the relationships of the archive, or else the usual one.
        """
        named = self.read(_RELATIONSHIPS, _Relationships).models if _RELATIONSHIPS in self else set()
        if len(named) > 1 or not named <= self._entries.keys():
            raise MeshFormatError(
                f"its _rels/.rels names the models {sorted(named)}, expected one in the archive"
            )
        if not named and _USUAL_ROOT not in self:
            raise MeshFormatError("the archive has no file 3D/3dmodel.model: it is not a 3MF file")
        return named.pop() if named else _USUAL_ROOT


class _Relationships(XmlFile):
    """File that states the kinds of the archive's parts."""

    def __init__(self, file: str) -> None:
        super().__init__(file)
        self.models: set[str] = set()

    def start(self, uri: str | None, name: str, attributes: dict[str, str]) -> None:
        """Read a relationship."""
        if name == "Relationship" and attributes["Type"].endswith("/3dmodel"):
            self.models.add(part_name(attributes["Target"]))


def part_name(text: str) -> str:
    """Return a normalized name that can be compared.

    It is in lower case, with slashes between folders and one at the start.
    """
    return posixpath.normpath("/" + unquote(text).strip().replace("\\", "/").strip("/")).lower()


def shown(text: str) -> str:
    """Return a name from the file, quoted and shortened for messages."""
    return text_rows.shortened(text, 60)
