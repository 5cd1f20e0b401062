"""Read OFF, which has counts of vertices and polygons, then a row of each, as text or binary, but no units.

A row is a line in nearly every file, although the format permits rows over several lines. Then colours must
not follow polygons, because their end would be unknown.
"""

import re
from collections.abc import Sequence
from typing import cast

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import polygons, text_rows
from proximity.formats.contents import RawFile, RawMesh, Source
from proximity.formats.ply import rows as binary_rows
from proximity.formats.ply.ply_header import Element, Property

_KEYWORD = re.compile(r"(?![A-Z]*nOFF)(?i:(ST)?(C)?(N)?OFF(?![a-z_])|(?=\d+\s))\s*(.*)")
"""Pattern of the first line. Texture, colour and normal may follow each position. Four- and n-dimensional
variants are not solids and do not match."""
_BINARY = re.compile(rb"(?:#[^\n]*\n|\s)*(ST)?(C)?(N)?OFF[ \t]+BINARY[^\n]*\n")
_WIDTHS = (2, 4, 3)  # number of values of texture, colour and normal
_INT, _FLOAT = np.dtype(">i4"), np.dtype(">f4")


def read_off(source: Source) -> RawFile:
    """Read an OFF file, text or binary."""
    if binary := _BINARY.match(source.data):
        return RawFile("OFF binary", [_read_binary(source.data, binary.end(), _width(binary.groups()))])
    lines = _content_lines(source.data)
    if not lines or (keyword := _KEYWORD.fullmatch(lines[0][1].strip())) is None:
        raise MeshFormatError("it does not begin with OFF, COFF, NOFF or CNOFF")
    *extras, rest_of_first = keyword.groups()
    lines = [(lines[0][0], rest_of_first), *lines[1:]] if rest_of_first else lines[1:]
    vertex_count, face_count, words = _counts(lines)
    lines = lines[1:]
    if words or len(lines) != vertex_count + face_count:
        tables = [(vertex_count, [False] * _width(extras)), (face_count, [True])]
        regrouped = text_rows.regrouped(words or lines, tables)
        if regrouped is None:
            raise MeshFormatError(
                f"it announces {vertex_count} vertices and {face_count} faces, but {len(lines)} lines follow"
                f": {'it is cut off' if len(lines) < vertex_count + face_count else 'its counts are wrong'}"
            )
        lines = regrouped
    line_ids = [line_id for line_id, _ in lines]
    rows = [row for _, row in lines]
    vertices = _read_vertices(rows[:vertex_count], line_ids)
    faces, source_faces = _read_faces(rows[vertex_count:], line_ids[vertex_count:], vertices)
    notes = text_rows.end_notes(source.data)
    return RawFile("OFF", [RawMesh("", vertices, faces, source_faces)], notes=notes)


def _content_lines(data: bytes) -> list[tuple[int, str]]:
    """Return the lines that are not blank and their numbers from 1. Comments are removed."""
    text = text_rows.as_text(data)
    return text_rows.numbered_lines(re.sub(r"#[^\n]*", "", text) if "#" in text else text)


def _width(extras: Sequence[str | bytes | None]) -> int:
    """Return the number of values of a vertex, according to the letters of the keyword."""
    return 3 + sum(width for width, extra in zip(_WIDTHS, extras, strict=True) if extra)


def _read_binary(data: bytes, start: int, width: int) -> RawMesh:
    """Read big-endian data, in which colours of any length follow the corners of each polygon."""
    if len(data) < start + 12:
        raise MeshFormatError("it ends within its counts of vertices, faces and edges: it is cut off")
    vertex_count, face_count = np.frombuffer(data, _INT, 2, start).tolist()
    if vertex_count <= 0 or face_count <= 0:
        raise MeshFormatError(f"it announces {vertex_count} vertices and {face_count} faces, expected both")
    vertex = Element("vertex", vertex_count, [Property(str(k), _FLOAT) for k in range(width)])
    face = Element("face", face_count, [Property("corners", _INT, _INT), Property("colour", _FLOAT, _INT)])
    columns, end = binary_rows.read_binary(data, start + 12, vertex)
    polygon_columns, end = binary_rows.read_binary(data, end, face)
    if data[end:].strip(text_rows.PADDING):
        raise MeshFormatError(f"{len(data) - end} bytes follow the last face: its counts are wrong")
    vertices = np.column_stack([columns[axis] for axis in "012"]).astype(np.float64)
    pieces = cast(list[polygons.Piece], polygon_columns["corners"])
    return RawMesh("", vertices, *polygons.assemble(vertices, pieces, face_count, lambda row: f"face {row}"))


def _counts(lines: list[tuple[int, str]]) -> tuple[int, int, list[tuple[int, str]]]:
    """Return the numbers of vertices and faces, and any words after the counts on the same line."""
    words = [(lines[0][0], word) for word in lines[0][1].split()] if lines else []
    behind: list[tuple[int, str]] = []
    if len(words) not in (2, 3):
        words = [(line_id, word) for line_id, line in lines for word in line.split()]
        words, behind = words[:3], words[3:]
    counts = [count for _, word in words if (count := text_rows.as_count(word)) is not None]
    if len(words) < 2 or len(counts) != len(words):
        raise MeshFormatError("its counts of vertices, faces and edges are not three whole numbers")
    return counts[0], counts[1], behind


def _read_vertices(rows: list[str], line_ids: list[int]) -> np.ndarray:
    def locate(row: int) -> str:
        return f"line {line_ids[row]} (vertex {row})"

    groups = text_rows.read_rows(rows, locate)
    for row_ids, table in groups:
        if table.shape[1] < 3:
            raise MeshFormatError(f"{locate(row_ids[0])} has {table.shape[1]} numbers, expected 3 or more")
    if len(groups) > 1:
        # A row is a polygon among the vertices, or has a number split in two.
        groups.sort(key=lambda group: len(group[0]))
        (odd_ids, odd), (_, usual) = groups[0], groups[-1]
        raise MeshFormatError(
            f"{locate(odd_ids[0])} has {odd.shape[1]} numbers, but other vertices have {usual.shape[1]}: "
            "it is damaged, or its counts are wrong"
        )
    return np.ascontiguousarray(groups[0][1][:, :3]) if groups else np.empty((0, 3))


def _read_faces(rows: list[str], line_ids: list[int], vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    def locate(row: int) -> str:
        return f"line {line_ids[row]} (face {row})"

    pieces = []
    for row_ids, table in text_rows.read_rows(rows, locate):
        # A colour may follow the corners, so the width is only an upper limit of a polygon's size.
        counts = text_rows.as_integers(table[:, :1], text_rows.located_in(locate, row_ids))[:, 0]
        wrong = np.flatnonzero((counts < 0) | (counts > table.shape[1] - 1))
        if len(wrong):
            raise MeshFormatError(
                f"{locate(row_ids[wrong[0]])} announces {counts[wrong[0]]} corners, but "
                f"{table.shape[1] - 1} numbers follow"
            )
        pieces.append((row_ids, counts, table[:, 1:]))
    return polygons.assemble(vertices, pieces, len(rows), locate)
