"""Files as other programs write them: read whole, or by trimesh with a note, or refused; never a part."""

import os
import re
import struct
import subprocess
import sys

import mesh_files
import numpy as np
import pytest
import shapes

from proximity import formats
from proximity.errors import MeshFormatError
from proximity.formats import dialects

VERTICES, FACES = shapes.box([1.0, 2.0, 3.0], [3.0, 5.0, 7.0])
SQUARES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
STL = mesh_files.stl_ascii(VERTICES, FACES)
OBJ = mesh_files.obj(VERTICES, FACES)
OFF = mesh_files.off(VERTICES, FACES)
PLY = mesh_files.ply_ascii(VERTICES, FACES)
BINARY_PLY = mesh_files.ply_binary(VERTICES, FACES)
NO_NORMALS = STL.replace(b" normal 0 0 0", b"")
WIDE_OBJ = re.sub(rb"(?m)^(v .*)$", rb"\1 1 1", OBJ)
END = b"end_header\n"
HEAD, ROWS = PLY[: PLY.index(END) + len(END)], PLY[PLY.index(END) + len(END) :]
PADDING = "bytes after the last row were ignored"


def read(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    return formats.read_geometries(path, units="m")


def refusal(tmp_path, name, data):
    with pytest.raises(MeshFormatError) as caught:
        read(tmp_path, name, data)
    assert type(caught.value) is MeshFormatError
    return str(caught.value).partition(": ")[2]


def corners(contents):
    """Corners of all faces, in the order of the file."""
    return np.concatenate([geometry.vertices[geometry.faces] for geometry in contents.geometries])


def each(pattern, replacement, data):
    """*data* with every line that matches changed."""
    changed, count = re.subn(b"(?m)" + pattern, replacement, data)
    assert count
    return changed


# Read here


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("words apart.stl", each(rb"^( *end)(loop|facet|solid)", rb"\1 \2", STL)),
        ("comments in front.stl", b"# of a solid\n; facet\n// endsolid\n" + STL),
        ("end of CP M.stl", STL + b"\x1a"),
        ("block of zeros.stl", STL + bytes(512)),
        ("joined.off", OFF.replace(b"OFF\n", b"OFF")),
        ("small letters.off", OFF.replace(b"OFF", b"off")),
        ("no keyword.off", OFF.replace(b"OFF\n", b"")),
        ("numbers on one line.off", OFF.replace(b"\n", b" ") + b"\n"),
        ("a number a line.off", each(rb" ", b"\n", OFF)),
        ("normals.off", each(rb"^(.*\..*)$", rb"\1 0 0 1", OFF.replace(b"OFF", b"NOFF"))),
        ("normals over lines.off", each(rb"^(.*\..*)$", rb"\1\n0 0 1", OFF.replace(b"OFF", b"NOFF"))),
        ("texture.off", each(rb"^(.*\..*)$", rb"\1 0.5 0.5", OFF.replace(b"OFF", b"STOFF"))),
        ("end.off", OFF + b"\x1a"),
        ("comments.ply", HEAD + ROWS.replace(b"\n3 0", b"\ncomment here\nobj_info 3 0\n3 0")),
        ("split rows.ply", HEAD + ROWS.replace(b"7.0\n", b"\n7.0\n").replace(b"3 0", b"3\n0")),
        ("mark.ply", b"\xef\xbb\xbf" + PLY),
        ("end.ply", PLY + b"\x1a\r\n"),
        ("capitals.obj", OBJ.upper()),
        ("first version.obj", OBJ.replace(b"f ", b"fo ")),
        ("end.obj", OBJ + b"\x1a"),
    ],
)  # fmt: skip
def test_dialect_is_read_as_if_it_were_none(tmp_path, name, data):
    contents = read(tmp_path, name, data)
    assert np.array_equal(corners(contents), VERTICES[FACES])
    assert contents.notes == ()
    assert contents.geometries[0].source_faces.tolist() == list(range(12))


@pytest.mark.parametrize(
    ("name", "data", "note"),
    [
        ("zeros.ply", BINARY_PLY + bytes(30), f"30 {PADDING}"),
        (
            "more numbers.ply",
            HEAD + each(rb"^(3 .*)$", rb"\1 9 9.5", ROWS),
            "the last 2 numbers of each row of element face were ignored",
        ),
        (
            "statements.obj",
            b"$ Contributed\n" + OBJ.replace(b"f 1 3 4", b"t crease 2/1/0 0 1\nvw 0 0 1\nf 1 3 4"),
            "3 of its lines are no statements of OBJ and were ignored: line 1 begins with '$'",
        ),
    ],
)
def test_what_is_passed_over_is_said_in_one_note(tmp_path, name, data, note):
    contents = read(tmp_path, name, data)
    assert np.array_equal(corners(contents), VERTICES[FACES])
    assert contents.notes == (note,)


def test_squares_of_ply_with_more_numbers_are_cut_here(tmp_path):
    head, rows = mesh_files.ply_ascii(VERTICES, SQUARES).split(b"end_header\n")
    contents = read(tmp_path, "part.ply", head + b"end_header\n" + each(rb"^(4 .*)$", rb"\1 7", rows))
    assert contents.geometries[0].source_faces.tolist() == np.repeat(range(6), 2).tolist()


# The belt, and a strip for each end, of which one begins with a doubled corner.
STRIPS = [1, 0, 3, 2, 7, 6, 5, 4, 1, 0, -1, 0, 4, 2, 6, -1, 3, 3, 1, 7, 5]


@pytest.mark.parametrize(
    ("layout", "body"),
    [
        ("ascii", b"\n".join([*ROWS.split(b"\n")[:8], b"21 " + b" ".join(b"%d" % k for k in STRIPS), b""])),
        (
            "binary_big_endian",
            VERTICES.astype(">f8").tobytes() + np.array([21, *STRIPS], dtype=">i4").tobytes(),
        ),
    ],
)
def test_ply_strips_are_unrolled_each_triangle_the_right_way_round(tmp_path, layout, body):
    head = mesh_files.ply_header(layout, 8, 1).replace(b"element face", b"element tristrips")
    (geometry,) = read(tmp_path, "part.ply", head.replace(b"list uchar", b"list int") + body).geometries
    sides = {tuple(np.sort(face)) for face in geometry.faces.tolist()}
    assert geometry.source_faces.tolist() == list(range(13)) and len(sides) == 13
    assert shapes.volume(geometry.vertices, geometry.faces) == 24.0


@pytest.mark.parametrize(("keyword", "extra"), [(b"OFF", 0), (b"COFF", 4), (b"STCNOFF", 9)])
def test_binary_off_is_read_whatever_follows_its_positions(tmp_path, keyword, extra):
    rows = np.hstack([VERTICES, np.full((8, extra), 0.5)]).astype(">f4").tobytes()
    polygons = [*SQUARES[:5], [1, 3, 7], [1, 7, 5]]
    colours = [0, 3, 0, 4, 0, 0, 1]
    faces = b"".join(
        struct.pack(f">i{len(p)}ii{n}f", len(p), *p, n, *[0.5] * n)
        for p, n in zip(polygons, colours, strict=True)
    )
    data = b"# by hand\n" + keyword + b" BINARY\n" + struct.pack(">3i", 8, 7, 0) + rows + faces
    contents = read(tmp_path, "part.off", data)
    (geometry,) = contents.geometries
    assert contents.format == "OFF binary" and shapes.volume(geometry.vertices, geometry.faces) == 24.0
    assert geometry.source_faces.tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 6]
    assert (
        refusal(tmp_path, "part.off", data[:-1])
        == "it ends within row 6 of the 7 of element face: it is cut off"
    )
    assert refusal(tmp_path, "part.off", data + b"\1") == "1 bytes follow the last face: its counts are wrong"


# Read by trimesh


@pytest.mark.parametrize(
    ("name", "data", "reason"),
    [
        ("no normals.stl", NO_NORMALS, "facet 0 is incomplete, expected facet normal"),
        ("broken.stl", each(rb"0 0 0$", b"0,5 ? x", STL), "facet 0 has '0,5', expected a number"),
        ("no loops.stl", each(rb"^ *(outer |end)loop\n", b"", STL), "facet 0 is incomplete, expected"),
        ("colours.stl", each(rb"^( *outer)", rb"color 1 0 0\n\1", STL), "facet 0 has 'color', expected"),
        ("signature.stl", STL + b"made by hand\n", "there is 'made' outside of solid and endsolid"),
        ("author.ply", PLY.replace(b"comment", b"author"), "line 3 of its header is 'author made"),
        ("real.ply", PLY.replace(b"list uchar", b"list float"), "line 9 of its header is 'property"),
        ("five.obj", WIDE_OBJ, "line 1 (vertex 1) has 5 numbers, expected 3"),
    ],
)  # fmt: skip
def test_grammar_that_we_refuse_is_read_by_trimesh_with_a_note(tmp_path, name, data, reason):
    contents = read(tmp_path, name, data)
    assert np.array_equal(corners(contents), VERTICES[FACES])
    (note,) = contents.notes
    assert note.startswith(f"trimesh read it, and numbered its faces; our own reader refuses it: {reason}")


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("four vertices.stl", each(rb"^( *endloop)", rb"vertex 9 9 9\n\1", STL), "facet 0 is incomplete"),
        ("two numbers.stl", NO_NORMALS.replace(b"vertex 1.0", b"vertex", 1), "facet 0"),
        ("cut.stl", NO_NORMALS[:-20], "the line endsolid is missing at the end"),
        ("lost.ply", PLY.replace(b"comment", b"author")[:-8], "line 3 of its header is"),
        ("squares.obj", each(rb"^(v .*)$", rb"\1 1 1", mesh_files.obj(VERTICES, SQUARES)), "line 1 (v"),
        ("backwards.obj", WIDE_OBJ.replace(b"f 1 3 4", b"f 1 3 -5") + b"v 1 1 1 1 1\n", "line 1"),
        ("open.obj", each(rb"^(v .*)$", rb"\1 1 1", mesh_files.obj(VERTICES, FACES[:-1])), "line 1 (v"),
    ],
)  # fmt: skip
def test_what_trimesh_would_take_for_something_else_stays_refused(tmp_path, name, data, message):
    assert refusal(tmp_path, name, data).startswith(message)


def test_trimesh_that_takes_too_long_or_cannot_be_started_leaves_the_refusal(tmp_path, monkeypatch):
    data = NO_NORMALS
    monkeypatch.setattr(dialects, "_MOST_SECONDS", 0.001)
    assert refusal(tmp_path, "part.stl", data).startswith("facet 0 is incomplete")
    monkeypatch.undo()
    monkeypatch.setattr(sys, "executable", "no-python")
    assert refusal(tmp_path, "part.stl", data).startswith("facet 0 is incomplete")


def test_damaged_files_are_not_handed_to_trimesh(tmp_path, monkeypatch):
    def start(*arguments, **options):
        raise AssertionError("trimesh was asked")

    monkeypatch.setattr(subprocess, "run", start)
    for name, data in [
        ("part.stl", STL.replace(b"endloop\n", b"", 3)),
        ("part.stl", mesh_files.stl_binary(VERTICES, FACES)[:-1]),
        ("part.ply", PLY.replace(b"element face 12", b"element face " + b"9" * 30)),
        ("part.ply", PLY.replace(b"3 0 2 3", b"3 0 2 3 9")),
        ("part.off", OFF.replace(b"3 0 2 3", b"4 0 2 3")),
        ("part.obj", OBJ.replace(b"f 1 3 4", b"f 1 3 9")),
        ("part.obj", OBJ.replace(b"f 1 3 4", b"f1 3 4")),
        ("part.obj", OBJ + b"call other.obj\n"),
    ]:
        refusal(tmp_path, name, data)


def test_large_file_in_a_dialect_is_refused_unread(tmp_path):
    path = tmp_path / "part.ply"
    path.write_bytes(BINARY_PLY.replace(b"comment", b"author"))
    os.truncate(path, 10_600_000_000)  # takes no room on the disk
    with pytest.raises(MeshFormatError, match=r"line 3 of its header is 'author made for a test'$"):
        formats.read_geometries(path)


# Refused


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        (
            "part.obj",
            OBJ.decode().encode("utf-16"),
            "it is named like OBJ, but looks like text in UTF-16 (save it as UTF-8)",
        ),
        ("part.off", b"4" + OFF, "it does not begin with OFF, COFF, NOFF or CNOFF"),
        ("part.off", b"OFF\n8 12 0 1\n", "it announces 8 vertices and 12 faces, but 0 lines follow: it is"),
        ("part.off", b"OFF BINARY\n" + bytes(9), "it ends within its counts of vertices, faces and edges"),
        ("part.obj", b"Dear reader,\n", "line 1 begins with 'Dear', which is not a statement of OBJ"),
    ],
)  # fmt: skip
def test_other_kinds_are_refused_with_what_was_expected(tmp_path, name, data, message):
    assert refusal(tmp_path, name, data).startswith(message)


@pytest.mark.parametrize("kind", ["stl", "obj", "off", "ply"])
def test_files_after_public_reports_are_read_whole(shared_data, kind):
    paths = sorted((shared_data / "reports").glob(f"{kind}_*"))
    assert paths
    for path in paths:
        if path.name == "obj_utf16.obj":
            with pytest.raises(MeshFormatError, match="save it as UTF-8"):
                formats.read_geometries(path)
            continue
        (geometry,) = formats.read_geometries(path).geometries
        assert len(geometry.faces) == 12, path.name
        lower, upper = geometry.vertices.min(axis=0), geometry.vertices.max(axis=0)
        np.testing.assert_allclose([lower, upper], [[0, 0, 0], [0.02, 0.01, 0.005]], rtol=1e-12)
        assert shapes.volume(geometry.vertices, geometry.faces) == pytest.approx(1e-6)
