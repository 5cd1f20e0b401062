"""Read Wavefront OBJ, which has vertices, polygons that refer to them, and names of objects, but no units.

Each object (line ``o``) becomes a separate geometry. Groups and materials do not, as they only colour pieces
of one body. OBJ has no counts: if a file is truncated between two lines, this is only detected if a face
refers to a missing vertex.
"""

import re
from collections.abc import Iterable, Iterator

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import polygons, text_rows
from proximity.formats.contents import DialectError, RawFile, RawMesh, Source, check_part_count

_PASSED_OVER = frozenset((
    "vt", "vn", "vp", "g", "s", "mg", "usemtl", "mtllib", "usemap", "maplib", "bevel", "c_interp", "d_interp",
    "lod", "shadow_obj", "trace_obj", "cstype", "deg", "bmat", "step", "ctech", "stech", "parm", "end", "con",
))  # fmt: skip
_LOWER_DIMENSIONS = frozenset(["l", "p"])
_NAMING = frozenset(("g", "o", "usemtl", "mtllib", "usemap", "maplib", "shadow_obj", "trace_obj"))
_STRAY_SLASH = re.compile(r"\s/")
_UNKNOWN = re.compile(r"(?!(?:call|csh)$|[vf][-+.\d])[a-zA-Z$!%&@/;*_][!-~]*")
"""Pattern of unknown statements that are ignored. It excludes those that include other files, and a vertex or
face without a blank after its keyword."""
_FREE_FORM = frozenset(["curv", "curv2", "surf", "bsp", "bzp", "cdc", "cdp", "res"])


class _Lines:
    """Relevant lines of the file, sorted by kind."""

    def __init__(self, data: bytes) -> None:
        self.vertices: list[str] = []
        self.vertex_lines: list[int] = []
        self.faces: list[str] = []
        self.face_lines: list[int] = []
        self.vertices_before: list[int] = []  # for each face, as origin of relative indices
        self.objects: list[str] = []
        self.object_starts: list[int] = []  # row of the first face after each line "o"
        self.others: set[str] = set()
        self.unknown: list[str] = []  # place and reason of the first defect
        text = text_rows.as_text(data)
        lines = enumerate(text.split("\n"), 1)
        for line_id, line in _joined(lines) if "\\\n" in text else lines:
            self._sort(line_id, line)

    def _sort(self, line_id: int, line: str) -> None:
        key, _, rest = line.partition(" ")
        if key == "v":
            self.vertices.append(rest)
            self.vertex_lines.append(line_id)
        elif key == "f":
            self.faces.append(rest)
            self.face_lines.append(line_id)
            self.vertices_before.append(len(self.vertices))
        elif key not in ("vn", "vt") and line and not line.isspace():
            self._sort_rare(line_id, line)

    def _sort_rare(self, line_id: int, line: str) -> None:
        key, *rest = line.split("#", 1)[0].split(maxsplit=1)[:2] or ("",)
        if key in ("v", "f", "V", "F", "fo"):  # indented, tabs, capitals, or first version
            self._sort(line_id, f"{key[0].lower()} {rest[0] if rest else ''}")
        elif key == "o":
            # A name may contain a #; a comment begins after blank space.
            _, *name = re.split(r"\s#", line, maxsplit=1)[0].split(maxsplit=1)
            self.objects.append(name[0].strip() if name else "")
            self.object_starts.append(len(self.faces))
        elif key in _LOWER_DIMENSIONS:
            self.others.add(key)
        elif key in _FREE_FORM:
            raise MeshFormatError(
                f"line {line_id} is a free-form curve or surface ({key}), expected polygons only"
            )
        elif key and key not in _PASSED_OVER:
            begin = f"line {line_id} begins with {text_rows.shortened(key)}"
            if not _UNKNOWN.fullmatch(key):
                raise MeshFormatError(f"{begin}, which is not a statement of OBJ")
            self.unknown.append(begin)


def _joined(lines: Iterable[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """Join lines of numbers that a backslash continues. Comments and names may end in a backslash."""
    pieces: list[str] = []
    for line_id, line in lines:
        continues = line.endswith("\\") and "#" not in line
        if continues and (pieces or line.split(maxsplit=1)[0] not in _NAMING):
            pieces.append(line[:-1])
        else:
            yield line_id - len(pieces), " ".join([*pieces, line])
            pieces = []
    if pieces:
        yield line_id - len(pieces) + 1, " ".join(pieces) + "\\"


def read_obj(source: Source) -> RawFile:
    """Read an OBJ file."""
    lines = _Lines(source.data)
    vertices = _read_vertices(lines)
    if len(vertices) and not lines.faces:
        kind = "lines" if "l" in lines.others else "points"
        raise MeshFormatError(
            f"it holds {len(vertices)} vertices and no faces, only {kind}: it has no surface"
        )
    faces, source_faces = _read_faces(lines, vertices)
    notes = ["its points and lines were ignored: they enclose no volume"] if lines.others else []
    if lines.unknown and not lines.faces:
        raise MeshFormatError(f"{lines.unknown[0]}, which is not a statement of OBJ")
    if lines.unknown:
        count = len(lines.unknown)
        notes.append(f"{count} of its lines are not statements of OBJ and were ignored: {lines.unknown[0]}")
    notes += text_rows.end_notes(source.data)
    return RawFile("OBJ", _split_objects(lines, vertices, faces, source_faces), notes=notes)


def read_obj_points(data: bytes) -> np.ndarray:
    """Return the vertices of an OBJ file, (N, 3), in the unit of the file. The file may have no faces."""
    return _read_vertices(_Lines(data))


def _read_vertices(lines: _Lines) -> np.ndarray:
    """Return the positions of the vertices. Weights and colours may follow them in a line."""

    def locate(row: int) -> str:
        return f"line {lines.vertex_lines[row]} (vertex {row + 1})"

    vertices = np.empty((len(lines.vertices), 3))
    for row_ids, table in text_rows.read_rows(_without_comments(lines.vertices), locate):
        if table.shape[1] not in (3, 4, 6, 7):
            message = f"{locate(row_ids[0])} has {table.shape[1]} numbers, expected 3"
            is_dialect = table.shape[1] > 3 and len(row_ids) == len(vertices)
            raise DialectError(message, len(lines.faces)) if is_dialect else MeshFormatError(message)
        vertices[row_ids] = table[:, :3]
    return vertices


def _without_comments(rows: list[str]) -> list[str]:
    return [row.split("#", 1)[0] for row in rows] if any("#" in row for row in rows) else rows


def _read_faces(lines: _Lines, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    def locate(row: int) -> str:
        return f"line {lines.face_lines[row]} (face {row})"

    rows = _without_comments(lines.faces)
    if any("/" in row for row in rows):  # remove texture and normal of each corner
        text = "\n".join(["", *rows])
        dynamic = _STRAY_SLASH.search(text)
        if dynamic is not None:
            row = text.count("\n", 0, dynamic.end()) - 1
            raise MeshFormatError(f"{locate(row)} has a / that follows no vertex")
        rows = re.sub(r"/[^\s]*", "", text).split("\n")[1:]
    before = np.array(lines.vertices_before, dtype=np.int64)
    pieces = []
    for row_ids, table in text_rows.read_rows(rows, locate):
        if (table == 0.0).any():
            row = row_ids[np.flatnonzero((table == 0.0).any(axis=1))[0]]
            raise MeshFormatError(f"{locate(row)} refers to vertex 0, but OBJ counts from 1")
        corners = np.where(table > 0.0, table - 1.0, table + before[row_ids, None])
        too_far = (table < 0.0) & (corners < 0.0)
        if too_far.any():
            row, column = np.argwhere(too_far)[0]
            raise MeshFormatError(
                f"{locate(row_ids[row])} refers to vertex {table[row, column]:g}, counted back, but "
                f"{before[row_ids[row]]} vertices precede it"
            )
        pieces.append((row_ids, np.full(len(row_ids), table.shape[1]), corners))
    return polygons.assemble(vertices, pieces, len(rows), locate)


def _split_objects(
    lines: _Lines, vertices: np.ndarray, faces: np.ndarray, source_faces: np.ndarray
) -> list[RawMesh]:
    """Return one mesh for each object that has faces.

    Lines with the same name continue the same object.
    """
    names = ["", *lines.objects]
    ids = {name: k for k, name in enumerate(dict.fromkeys(names))}
    lengths = np.diff([0, *lines.object_starts, len(lines.faces)])
    row_names = np.repeat(np.array([ids[name] for name in names]), lengths)
    present = sorted(set(row_names.tolist()))
    check_part_count(len(present))
    known = list(ids)
    if len(present) <= 1:
        return [RawMesh(_decoded(known[k]), vertices, faces, source_faces) for k in present]
    face_names = row_names[source_faces]
    order = np.argsort(face_names, kind="stable")
    ends = np.searchsorted(face_names[order], present, side="right")
    meshes = []
    for k, rows in zip(present, np.split(order, ends[:-1]), strict=True):
        # Each object keeps only its own vertices. Otherwise all vertices would be copied for each object.
        used, local = np.unique(faces[rows], return_inverse=True)
        meshes.append(RawMesh(_decoded(known[k]), vertices[used], local.reshape(-1, 3), source_faces[rows]))
    return meshes


def _decoded(name: str) -> str:
    return name.encode("latin-1").decode("utf-8", "replace")
