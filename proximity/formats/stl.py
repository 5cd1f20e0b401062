"""Read STL files, which are binary (a count and fixed records) or text.

Neither variant states units or shares vertices. Reading the binary variant takes three lines of NumPy and
saves the time to import trimesh. Text without normals or loops, or with additional words, is left to trimesh.
"""

import re
from collections.abc import Iterator

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import text_rows
from proximity.formats.contents import DialectError, RawFile, RawMesh, Source
from proximity.formats.format_detection import (
    STL_FACET_BYTES,
    STL_HEADER_BYTES,
    is_ascii_stl,
    is_binary_stl,
    stl_face_count,
)

FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])

# No anchor at the start: with it the search takes a quarter of the whole reading.
_SOLID_LINE = re.compile(r"solid\b[ \t]*([^\n]*)")
_COMMENTS = re.compile(r"(\s|[#;!/][^\n]*\n)*")  # before the first solid
_APART = re.compile(r"^([ \t]*end)[ \t]+(?=(?:solid|loop|facet)\b)", re.IGNORECASE | re.MULTILINE)
_FACET_OR_VERTEX = re.compile(r"(?<!end)facet|vertex(?=(?:\s+[-+.\de]+){3}\s+[a-z])")

# Each facet becomes one row of numbers: its words turn into marks, so that one strict reading of the table
# checks the position of every word and number.
_FACET_MARK, _VERTEX_MARK, _END_MARK = 1.0, 2.0, 3.0
_MARKED_COLUMNS = {0: _FACET_MARK, 4: _VERTEX_MARK, 8: _VERTEX_MARK, 12: _VERTEX_MARK, 16: _END_MARK}
_FACET_COLUMNS = 17
_CORNER_COLUMNS = [5, 6, 7, 9, 10, 11, 13, 14, 15]
_WORDS = (
    ("endfacet", f" {_END_MARK:.0f}\n"),
    ("endloop", " "),
    ("facet", f" {_FACET_MARK:.0f} "),
    ("vertex", f" {_VERTEX_MARK:.0f} "),
    ("normal", " "),
    ("outer", " "),
    ("loop", " "),
)


def read_stl(source: Source) -> RawFile:
    """Read a binary or ASCII STL file."""
    if is_ascii_stl(source.data) and not is_binary_stl(source.data):
        return _read_ascii(source.data)
    return _read_binary(source.data)


def _read_binary(data: bytes) -> RawFile:
    if len(data) < STL_HEADER_BYTES:
        raise MeshFormatError(
            f"it has {len(data)} bytes, but a binary STL file begins with {STL_HEADER_BYTES} bytes "
            "before its faces, and an ASCII one with the word solid"
        )
    # Compared before any allocation: the count may claim four billion faces.
    claimed = stl_face_count(data)
    held, rest = divmod(len(data) - STL_HEADER_BYTES, STL_FACET_BYTES)
    if held != claimed:
        raise MeshFormatError(
            f"its header claims {claimed} faces, but there are bytes for {held}: "
            f"{'it is cut off' if held < claimed else 'its face count is wrong'}, or it is not an STL file"
        )
    facets = np.frombuffer(data, dtype=FACET, count=claimed, offset=STL_HEADER_BYTES)
    vertices = facets["corners"].reshape(-1, 3).astype(np.float64)
    # Remaining bytes are too few for a face: some writers append padding.
    notes = [f"{rest} bytes after the last face were ignored"] if rest else []
    return RawFile("STL binary", [_mesh("", vertices, 0)], notes=notes)


def _mesh(name: str, vertices: np.ndarray, first_row: int) -> RawMesh:
    face_count = len(vertices) // 3
    rows = np.arange(first_row, first_row + face_count, dtype=np.int32)
    return RawMesh(name, vertices, np.arange(3 * face_count).reshape(-1, 3), rows)


def _read_ascii(data: bytes) -> RawFile:
    text = text_rows.as_text(data)
    text = _COMMENTS.sub("", text, count=1) if text.lstrip()[:1] in "#;!/" else text
    lowered = text.lower()
    if "end " in lowered:
        text = _APART.sub(r"\1", text)
        lowered = text.lower()
    try:
        return RawFile("STL ASCII", _read_solids(text, lowered))
    except MeshFormatError as reason:
        face_count = _plain_facets(lowered)
        if not face_count:
            raise
        raise DialectError(str(reason), face_count) from None


def _plain_facets(lowered: str) -> int:
    """Return the number of facets, or 0 if the text is irregular.

    Each facet must have three vertices of three numbers. Each of the other words must occur in all facets or
    in none.
    """
    found = "".join(word[0] for word in _FACET_OR_VERTEX.findall(lowered))
    count = len(found) // 4
    counts = {lowered.count(word) for word in ("normal", "outer", "endloop", "endfacet")}
    is_plain = found == "fvvv" * count and lowered.count("vertex") == 3 * count and counts <= {0, count}
    return count if is_plain else 0


def _read_solids(text: str, lowered: str) -> list[RawMesh]:
    meshes: list[RawMesh] = []
    row = 0
    for name, body in _solids(text, lowered):
        vertices = _read_facets(lowered[body], row)
        if len(vertices):
            meshes.append(_mesh(name, vertices, row))
        row += len(vertices) // 3
    if len(meshes) == 1:
        meshes[0].name = ""  # exporters write the name of the program there
    return meshes


def _solids(text: str, lowered: str) -> Iterator[tuple[str, slice]]:
    """Yield the name and the body of each solid. Raise an error if there is text outside of them."""
    begin = None  # match of the open solid
    end = 0  # end of the parsed text
    for line in _SOLID_LINE.finditer(lowered):
        closes = lowered.endswith("end", 0, line.start())
        start = line.start() - (3 if closes else 0)
        if closes == (begin is None):
            raise MeshFormatError("its lines solid and endsolid do not alternate")
        if begin is None:
            _check_blank(text[end:start])
            begin = line
        else:
            yield text[begin.start(1) : begin.end(1)], slice(begin.end(), start)
            begin, end = None, line.end()
    if begin is not None:
        raise MeshFormatError("the line endsolid is missing at the end: it is cut off")
    _check_blank(text[end:])


def _check_blank(text: str) -> None:
    words = text.split(maxsplit=1)
    if words:
        raise MeshFormatError(f"there is {text_rows.shortened(words[0])} outside of solid and endsolid")


def _read_facets(body: str, first_row: int) -> np.ndarray:
    """Return the corners of all facets of one solid, (3 F, 3) float64.

    *body*: text in lower case.
    """
    counts = {word: body.count(word) for word in ("normal", "outer", "endloop", "endfacet")}
    marked = body.replace("\n", " ")
    for word, mark in _WORDS:
        marked = marked.replace(word, mark)
    if "#" in marked or "(" in marked:
        # spelling of NaN by some compilers
        marked = re.sub(r"-?(nan|1\.)[#(]\w+\)?", "nan", marked)
    rows = marked.split("\n")
    if rows[-1].isspace() or not rows[-1]:
        rows.pop()
    groups = text_rows.read_rows(rows, lambda row: f"facet {first_row + row}")
    table = groups[0][1] if len(groups) == 1 else np.empty((0, 0))
    if not rows:
        return np.empty((0, 3))
    is_whole = (
        table.shape == (len(rows), _FACET_COLUMNS)
        and all((table[:, column] == mark).all() for column, mark in _MARKED_COLUMNS.items())
        and len(set(counts.values())) == 1
    )
    if not is_whole:
        raise MeshFormatError(
            f"facet {first_row + _first_odd(groups)} is incomplete, expected facet normal, outer loop, three "
            "times vertex, endloop, endfacet"
        )
    return np.ascontiguousarray(table[:, _CORNER_COLUMNS]).reshape(-1, 3)


def _first_odd(groups: list[tuple[np.ndarray, np.ndarray]]) -> int:
    """Return the first row that is not a facet, or 0 if only the words between the numbers are wrong."""
    odd: list[int] = []
    for row_ids, table in groups:
        if table.shape[1] != _FACET_COLUMNS:
            odd.extend(row_ids[:1])
            continue
        is_odd = np.zeros(len(table), dtype=bool)
        for column, mark in _MARKED_COLUMNS.items():
            is_odd |= table[:, column] != mark
        odd.extend(row_ids[is_odd][:1])
    return int(min(odd, default=0))
