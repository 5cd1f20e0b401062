"""Text of a STEP file: its end, and the parts that it has in other files.

OpenCASCADE opens the files that a file names, in any folder, and cascadio omits their shapes silently. So
their records are inserted into the text to convert, and checked with it: the product of a part file replaces
the empty one that refers to it.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from proximity.errors import MeshFormatError
from proximity.formats.step.product_structure import products_of
from proximity.formats.step.step_records import QUOTED, StepText, decoded
from proximity.formats.text_rows import PADDING, shortened
from proximity.system.regular_file import open_regular

_END = re.compile(rb"END-ISO-10303-21\s*+;")
_END_OF_SECTION = re.compile(rb"ENDSEC\s*+;")
_MARK = b"\xef\xbb\xbf"
_MAX_FILES = 1000
_EXTENSIONS = (".stp", ".step", ".p21")

_TOKEN = re.compile(rf"{QUOTED}|#\d+")
_STRING = re.compile(r"'(?:[^']|'')*+'")
_DATA = re.compile(r"\bDATA\s*+(?:\([^;]*+)?;")
_REFERRING = "APPLIED_DOCUMENT_REFERENCE", "PRODUCT_DEFINITION_WITH_ASSOCIATED_DOCUMENTS"
_NAMING = "DOCUMENT", "DOCUMENT_FILE", "APPLIED_EXTERNAL_IDENTIFICATION_ASSIGNMENT"
_ARGUMENTS = r"(?:'[^']*+'|[^';]++)*+;?"
_RECORD = re.compile(rf"{QUOTED}|(#\d++)\s*+={_ARGUMENTS}")
_LOCATION = re.compile(rf"=\s*+(?:{'|'.join(_NAMING)}|EXTERNAL_SOURCE)\s*+\({_ARGUMENTS}")


def without_trailer(data: bytes) -> tuple[str, list[str]]:
    """Return the text of a STEP file up to its end, with notes on its encoding and on trailing data."""
    data = data.removeprefix(_MARK)
    ends = [match.end() for match in _END.finditer(data)]
    if not ends:
        raise MeshFormatError("it does not end with END-ISO-10303-21: it is cut off")
    if len(ends) > 1:
        raise MeshFormatError(
            "it is several STEP files in one, of which OpenCASCADE would read the first only"
        )
    *sections, rest = _END_OF_SECTION.split(data[ends[0] :])
    is_signed = all(section.lstrip().startswith(b"SIGNATURE") for section in sections)
    is_known = is_signed and not rest.strip(PADDING)
    text, notes = decoded(data[: ends[0]])
    if not is_known:
        notes.append(f"{len(data) - ends[0]} bytes after END-ISO-10303-21 were ignored")
    return text + "\n", notes


def with_external_parts(text: str, path: str, notes: list[str]) -> str:
    """Return the text of the file at *path* with the records of the part files that it refers to."""
    if not any(kind in text for kind in _REFERRING):
        return text
    return _Merge(Path(path).resolve().parent, notes).merged(text, Path(path).resolve())


@dataclass(slots=True)
class _Merge:
    """A file and the files that it refers to, each once."""

    folder: Path  # files outside are not read
    notes: list[str]
    last_number: int = 0
    open_paths: list[Path] = field(default_factory=list)
    roots: dict[Path, tuple[str, str, str]] = field(default_factory=dict)  # definition, its shape, shape
    records: list[str] = field(default_factory=list)  # of the part files

    def merged(self, text: str, path: Path) -> str:
        """Return the text with the renumbered records of part files before its end."""
        self.last_number = max(map(int, re.findall(r"#(\d+)", text)), default=0)
        text = self._with_roots(text, path)
        end = text.rindex("ENDSEC")
        return text[:end] + "\n".join(self.records) + "\n" + text[end:]

    def _with_roots(self, text: str, path: Path) -> str:
        """Return the text with the products of part files instead of the references to them."""
        self.open_paths.append(path)
        source = StepText(text)
        products = products_of(source)
        renamed: dict[str, str] = {}
        gone: set[str] = set()
        for product, name in _references(source):
            definition = products.shapes.get(product)
            if definition is None or products.has_bodies(product) or product in products.assemblies:
                continue  # a drawing of the same shape
            if product in renamed:
                continue  # some programs refer to the file once for each use
            root = self._root(name, path)
            shape, representation = definition
            renamed |= dict(zip((product, shape, representation), root, strict=True))
            gone |= {product, shape, representation, products.links[shape]}
        if gone:
            text = _RECORD.sub(lambda match: "\n" if match[1] in gone else match[0], text)
        self.open_paths.pop()
        text = _LOCATION.sub(lambda match: _STRING.sub("''", match[0]), text)  # OpenCASCADE would open it
        return _with_references(text, lambda number: renamed.get(number, number)) if renamed else text

    def _root(self, name: str, path: Path) -> tuple[str, str, str]:
        """Return the root product of a part file, after its records have been read."""
        what = f"its part {shortened(name, 60)}"
        beside = (path.parent / name.replace("\\", "/")).resolve()
        if not beside.is_relative_to(self.folder):
            raise MeshFormatError(f"{what} is not in the folder of this file or below: it is not read")
        if beside in self.open_paths or len(self.roots) >= _MAX_FILES:
            raise MeshFormatError(f"{what} is part of itself, or one of more than {_MAX_FILES} files")
        if beside not in self.roots:
            try:
                with open_regular(beside) as file:
                    text, notes = without_trailer(file.read())
            except MeshFormatError as reason:
                raise MeshFormatError(f"{what}: {reason}") from None
            except (OSError, ValueError) as reason:
                reported = reason.strerror if isinstance(reason, OSError) else str(reason)
                raise MeshFormatError(f"{what} beside it cannot be read ({reported})") from reason
            self.notes += [f"{what}: {note}" for note in notes]
            self.roots[beside] = self._merged_root(text, beside, what)
        return self.roots[beside]

    def _merged_root(self, text: str, path: Path, what: str) -> tuple[str, str, str]:
        first = self.last_number
        self.last_number += max(map(int, re.findall(r"#(\d+)", text)), default=0)
        text = _with_references(text, lambda number: f"#{int(number[1:]) + first}")
        text = self._with_roots(text, path)
        products, data = products_of(StepText(text)), _DATA.search(text)
        roots = products.roots
        if len(roots) != 1 or data is None:
            raise MeshFormatError(f"{what} has {len(roots)} products that are part of no other, expected one")
        self.records.append(text[data.end() : text.rindex("ENDSEC")])
        return (roots[0], *products.shapes[roots[0]])


def _references(text: StepText) -> list[tuple[str, str]]:
    """Return products, and the names of part files that they refer to."""
    found = list(text.records(*_REFERRING, *_NAMING))
    names: dict[str, str] = {}
    for record in found:
        part_file = next((each for each in record.strings if each.lower().endswith(_EXTENSIONS)), "")
        if record.kind in _NAMING and part_file:
            owners = record.references if record.kind == _NAMING[2] else [record.own]
            names |= dict.fromkeys(owners, part_file)
    pairs = []
    for record in found:
        if record.kind in _REFERRING:
            part_file = next((names[number] for number in record.references if number in names), "")
            users = [record.own] if record.kind == _REFERRING[1] else record.references
            pairs += [(user, part_file) for user in users if part_file]
    return pairs


def _with_references(text: str, number_of: Callable[[str], str]) -> str:
    return _TOKEN.sub(lambda match: number_of(match[0]) if match[0][0] == "#" else match[0], text)
