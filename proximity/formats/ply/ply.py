"""Read PLY, whose header declares the elements with vertices and polygons. It has no units."""

import re

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import polygons, text_rows
from proximity.formats.contents import RawFile, RawMesh, Source
from proximity.formats.ply import rows
from proximity.formats.ply.ply_header import Element, Header, read_header

_CORNER_LISTS = ("vertex_indices", "vertex_index")


def read_ply(source: Source) -> RawFile:
    """Read a PLY file, ASCII or binary of either byte order."""
    header = read_header(source.data)
    elements = {element.name: element for element in header.elements}
    surface = _surface(elements)
    notes: list[str] = []
    read = _read_ascii if header.is_ascii else _read_binary
    columns = read(source.data, header, notes)
    vertices = np.column_stack([np.asarray(columns["vertex"][axis], dtype=np.float64) for axis in "xyz"])
    lists = columns[surface.name][_corner_list(surface)]
    pieces = [(row_ids, counts, np.asarray(table)) for row_ids, counts, table in lists]
    if surface.name == "tristrips":
        faces = _unrolled(pieces)
        pieces = [(np.arange(len(faces)), np.full(len(faces), 3), faces)]
    faces, source_faces = polygons.assemble(
        vertices, pieces, sum(len(row_ids) for row_ids, _, _ in pieces), lambda row: f"face {row}"
    )
    kind = "ASCII" if header.is_ascii else "binary"
    return RawFile(f"PLY {kind}", [RawMesh("", vertices, faces, source_faces)], notes=notes)


def read_ply_points(data: bytes) -> np.ndarray:
    """Return the vertices of a PLY file, (N, 3), in the unit of the file. The file may have no faces."""
    header = read_header(data)
    _check_positions({element.name: element for element in header.elements})
    read = _read_ascii if header.is_ascii else _read_binary
    vertices = read(data, header, [])["vertex"]
    return np.column_stack([np.asarray(vertices[axis], dtype=np.float64) for axis in "xyz"])


def _unrolled(pieces: list[polygons.Piece]) -> np.ndarray:
    """Return the triangles of strips, (F, 3).

    -1 ends a strip, and every other triangle is reversed.
    """
    strips = {
        int(row): np.append(values[:count], -1)
        for row_ids, counts, table in pieces
        for row, count, values in zip(row_ids, counts, table.astype(np.float64), strict=True)
    }
    corners = np.concatenate([*(strips[row] for row in sorted(strips)), [-1, -1]])
    is_end = corners == -1
    positions = np.arange(len(corners))
    strip_starts = np.maximum.accumulate(np.where(is_end, positions + 1, 0))
    faces = np.column_stack([corners[:-2], corners[1:-1], corners[2:]])
    is_odd = (positions - strip_starts)[:-2] % 2 == 1
    faces[is_odd] = faces[is_odd][:, [0, 2, 1]]
    return faces[(faces != -1).all(axis=1)]


def _check_positions(elements: dict[str, Element]) -> Element:
    """Return the element with the vertices. Raise an error if it has no positions."""
    vertex = elements.get("vertex")
    if vertex is None or not vertex.count:
        raise MeshFormatError("its header declares no vertices")
    scalars = {column.name for column in vertex.properties if column.count_dtype is None}
    if not scalars >= {"x", "y", "z"}:
        raise MeshFormatError("its vertices have no x, y and z, expected positions in space")
    return vertex


def _surface(elements: dict[str, Element]) -> Element:
    """Return the element with the faces or the strips."""
    vertex = _check_positions(elements)
    surfaces = [elements[name] for name in ("face", "tristrips") if name in elements and elements[name].count]
    if len(surfaces) > 1:
        raise MeshFormatError("it holds faces and triangle strips, expected one of them")
    if not surfaces:
        kind = "a drawing of lines" if elements.get("edge", Element("edge", 0)).count else "a point cloud"
        raise MeshFormatError(f"it is {kind}: {vertex.count} vertices and no faces, so no surface")
    _corner_list(surfaces[0])
    return surfaces[0]


def _corner_list(face: Element) -> str:
    lists = [column.name for column in face.properties if column.count_dtype is not None]
    for name in _CORNER_LISTS:
        if name in lists:
            return name
    raise MeshFormatError(f"its faces have no list {' or '.join(_CORNER_LISTS)}")


def _read_binary(data: bytes, header: Header, notes: list[str]) -> dict[str, rows.Columns]:
    columns = {}
    at = header.data_start
    for element in header.elements:
        columns[element.name], at = rows.read_binary(data, at, element)
    # A wrong count shifts the rest of the file, so that only padding may follow the last row.
    if data[at:].strip(text_rows.PADDING):
        raise MeshFormatError(f"{len(data) - at} bytes follow the last row: a count in its header is wrong")
    if data[at:].strip(b"\r\n"):
        notes.append(f"{len(data) - at} bytes after the last row were ignored")
    return columns


def _read_ascii(data: bytes, header: Header, notes: list[str]) -> dict[str, rows.Columns]:
    text = text_rows.as_text(data[header.data_start :])
    if "comment" in text or "obj_info" in text:
        text = re.sub(r"(?m)^[ \t]*(comment|obj_info)\b.*", "", text)
    lines = text_rows.numbered_lines(text, len(data[: header.data_start].splitlines()) + 1)
    elements = [element for element in header.elements if element.properties]
    announced = sum(element.count for element in elements)
    if len(lines) != announced:
        lists = [[column.count_dtype is not None for column in element.properties] for element in elements]
        tables = [(element.count, is_list) for element, is_list in zip(elements, lists, strict=True)]
        regrouped = text_rows.regrouped(lines, tables)
        if regrouped is None:
            raise MeshFormatError(
                f"its header declares {announced} rows, but {len(lines)} follow: "
                f"{'it is cut off' if len(lines) < announced else 'a count is wrong'}"
            )
        lines = regrouped
    columns = {}
    first = 0
    for element in elements:
        part = lines[first : first + element.count]
        first += element.count
        line_ids = [line_id for line_id, _ in part]
        columns[element.name] = rows.read_ascii([line for _, line in part], line_ids, element, notes)
    notes += text_rows.end_notes(data)
    return columns
