"""PLY: vertices and polygons out of the elements that a header declares; no units."""

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import polygons, text_rows
from proximity.formats.contents import RawFile, RawMesh, Source
from proximity.formats.ply import rows
from proximity.formats.ply.ply_header import Element, Header, read_header

_CORNER_LISTS = ("vertex_indices", "vertex_index")


def read_ply(source: Source) -> RawFile:
    """Read a PLY file, ASCII or binary of either byte order.

    Raises
    ------
    MeshFormatError
        If the data are more or less than the header declares, or hold no surface.
    """
    header = read_header(source.data)
    elements = {element.name: element for element in header.elements}
    _check_elements(elements)
    columns = _read_ascii(source.data, header) if header.is_ascii else _read_binary(source.data, header)
    vertices = np.column_stack([np.asarray(columns["vertex"][axis], dtype=np.float64) for axis in "xyz"])
    name = _corner_list(elements["face"])
    pieces = [(row_ids, counts, np.asarray(table)) for row_ids, counts, table in columns["face"][name]]
    faces, source_faces = polygons.assemble(
        vertices, pieces, elements["face"].count, lambda row: f"face {row}"
    )
    mesh = RawMesh("", vertices, faces, source_faces)
    if header.is_ascii:
        return RawFile("PLY ASCII", [mesh], notes=text_rows.end_notes(source.data))
    return RawFile("PLY binary", [mesh])


def _check_elements(elements: dict[str, Element]) -> None:
    vertex = elements.get("vertex")
    if vertex is None or not vertex.count:
        raise MeshFormatError("its header declares no vertices")
    scalars = {column.name for column in vertex.properties if column.count_dtype is None}
    if not scalars >= {"x", "y", "z"}:
        raise MeshFormatError("its vertices have no x, y and z, expected positions in space")
    if "tristrips" in elements:
        raise MeshFormatError("it holds triangle strips, expected faces")
    if not elements.get("face", Element("face", 0)).count:
        kind = "a drawing of lines" if elements.get("edge", Element("edge", 0)).count else "a point cloud"
        raise MeshFormatError(f"it is {kind}: {vertex.count} vertices and no faces, there is no surface")
    _corner_list(elements["face"])


def _corner_list(face: Element) -> str:
    lists = [column.name for column in face.properties if column.count_dtype is not None]
    for name in _CORNER_LISTS:
        if name in lists:
            return name
    raise MeshFormatError(f"its faces have no list {' or '.join(_CORNER_LISTS)}")


def _read_binary(data: bytes, header: Header) -> dict[str, rows.Columns]:
    columns = {}
    at = header.data_start
    for element in header.elements:
        columns[element.name], at = rows.read_binary(data, at, element)
    # A wrong count shifts everything behind it, so that nothing may be left over; a line end does no harm.
    if data[at:].strip(b"\r\n"):
        raise MeshFormatError(f"{len(data) - at} bytes follow the last row: a count in its header is wrong")
    return columns


def _read_ascii(data: bytes, header: Header) -> dict[str, rows.Columns]:
    text = data[header.data_start :].decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    header_lines = len(data[: header.data_start].splitlines())
    lines = [
        (line_id, line)
        for line_id, line in enumerate(text.split("\n"), header_lines + 1)
        if line and not line.isspace()
    ]
    announced = sum(element.count for element in header.elements if element.properties)
    if len(lines) != announced:
        raise MeshFormatError(
            f"its header declares {announced} rows, but {len(lines)} follow: "
            f"{'it is cut off' if len(lines) < announced else 'a count is wrong'}"
        )
    columns = {}
    first = 0
    for element in header.elements:
        if not element.properties:
            continue
        part = lines[first : first + element.count]
        first += element.count
        columns[element.name] = rows.read_ascii([line for _, line in part], [k for k, _ in part], element)
    return columns
