"""OFF: a line of counts, then that many lines of vertices and of polygons; no units."""

import re

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import polygons, text_rows
from proximity.formats.contents import RawFile, RawMesh, Source

_KEYWORD = re.compile(r"(ST)?C?N?OFF\b(.*)", re.DOTALL)
"""Texture, colour and normal may follow each position; four- and n-dimensional variants are not solids."""


def read_off(source: Source) -> RawFile:
    """Read an OFF file.

    Raises
    ------
    MeshFormatError
        If the lines are not as many as the counts say, or do not hold what they should.
    """
    lines = _content_lines(source.data)
    if not lines or (keyword := _KEYWORD.fullmatch(lines[0][1].strip())) is None:
        raise MeshFormatError("it does not begin with OFF, COFF, NOFF or CNOFF")
    rest_of_first = keyword.group(2).strip()
    if rest_of_first.split(maxsplit=1)[:1] == ["BINARY"]:
        raise MeshFormatError("it is a binary OFF file, which is not supported; export it as text")
    lines = [(lines[0][0], rest_of_first), *lines[1:]] if rest_of_first else lines[1:]
    vertex_count, face_count = _counts(lines)
    line_ids = [line_id for line_id, _ in lines[1:]]
    rows = [row for _, row in lines[1:]]
    if len(rows) != vertex_count + face_count:
        raise MeshFormatError(
            f"it announces {vertex_count} vertices and {face_count} faces, but {len(rows)} lines follow: "
            f"{'it is cut off' if len(rows) < vertex_count + face_count else 'its counts are wrong'}"
        )
    vertices = _read_vertices(rows[:vertex_count], line_ids)
    faces, source_faces = _read_faces(rows[vertex_count:], line_ids[vertex_count:], vertices)
    notes = text_rows.end_notes(source.data)
    return RawFile("OFF", [RawMesh("", vertices, faces, source_faces)], notes=notes)


def _content_lines(data: bytes) -> list[tuple[int, str]]:
    """Lines that say something, comments removed, with their numbers from 1."""
    text = data.decode("latin-1").removeprefix("\xef\xbb\xbf").replace("\r\n", "\n").replace("\r", "\n")
    if "#" in text:
        text = re.sub(r"#[^\n]*", "", text)
    return [(line_id, row) for line_id, row in enumerate(text.split("\n"), 1) if row and not row.isspace()]


def _counts(lines: list[tuple[int, str]]) -> tuple[int, int]:
    words = lines[0][1].split() if lines else []
    counts = [count for word in words if (count := text_rows.as_count(word)) is not None]
    if len(words) not in (2, 3) or len(counts) != len(words):
        raise MeshFormatError("its counts of vertices, faces and edges are not three whole numbers")
    return counts[0], counts[1]


def _read_vertices(rows: list[str], line_ids: list[int]) -> np.ndarray:
    def locate(row: int) -> str:
        return f"line {line_ids[row]} (vertex {row})"

    groups = text_rows.read_rows(rows, locate)
    for row_ids, table in groups:
        if table.shape[1] < 3:
            raise MeshFormatError(f"{locate(row_ids[0])} has {table.shape[1]} numbers, expected 3 or more")
    if len(groups) > 1:
        # A polygon among the vertices, or a number torn in two.
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
        # A colour may follow the corners, so the width says only the most that a polygon can have.
        counts = text_rows.as_integers(table[:, :1], text_rows.of_rows(locate, row_ids))[:, 0]
        wrong = np.flatnonzero((counts < 0) | (counts > table.shape[1] - 1))
        if len(wrong):
            raise MeshFormatError(
                f"{locate(row_ids[wrong[0]])} announces {counts[wrong[0]]} corners, but "
                f"{table.shape[1] - 1} numbers follow"
            )
        pieces.append((row_ids, counts, table[:, 1:]))
    return polygons.assemble(vertices, pieces, len(rows), locate)
