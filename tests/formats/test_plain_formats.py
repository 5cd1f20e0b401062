"""STL, OBJ, OFF and PLY: all numbers are read, for all styles of writing them."""

import re
import struct
import subprocess
import sys

import mesh_files
import numpy as np
import pytest
import shapes
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_reading import read, refusal, write

from proximity import formats
from proximity.errors import ArgumentError, MeshError
from proximity.formats import dialects

VERTICES, FACES = shapes.box([1.0, 2.0, 3.0], [3.0, 5.0, 7.0])
SQUARES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
INTS = ("int", "i")

POLYGON_FORMATS = {
    "off": mesh_files.off,
    "obj": mesh_files.obj,
    "ply": mesh_files.ply_ascii,
    "little.ply": mesh_files.ply_binary,
    "big.ply": lambda vertices, polygons: mesh_files.ply_binary(vertices, polygons, ">"),
    "ints.ply": lambda vertices, polygons: mesh_files.ply_binary(vertices, polygons, ">", INTS),
}
ALL_FORMATS = {**POLYGON_FORMATS, "ascii.stl": mesh_files.stl_ascii, "binary.stl": mesh_files.stl_binary}


def corners(contents):
    """Return the corners of all faces, in the order of the file."""
    return np.concatenate([geometry.vertices[geometry.faces] for geometry in contents.geometries])


def each(pattern, replacement, data):
    """Return *data* with every matching line changed."""
    changed, count = re.subn(b"(?m)" + pattern, replacement, data)
    assert count
    return changed


@st.composite
def meshes(draw):
    """Draw vertices anywhere, and polygons of 3 to 5 distinct ones."""
    numbers = st.floats(-1e9, 1e9, allow_subnormal=False)
    vertices = draw(st.lists(st.tuples(numbers, numbers, numbers), min_size=5, max_size=9))
    rows = st.lists(st.integers(0, len(vertices) - 1), min_size=3, max_size=5, unique=True)
    return np.array(vertices), draw(st.lists(rows, min_size=1, max_size=9))


@pytest.mark.parametrize("name", ALL_FORMATS)
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mesh=meshes())
def test_every_number_comes_back_in_the_order_of_the_file(tmp_path, name, mesh):
    vertices, polygons = mesh
    polygons = polygons if name in POLYGON_FORMATS else [polygon[:3] for polygon in polygons]
    contents = read(tmp_path, f"part.{name}", ALL_FORMATS[name](vertices, polygons), units="m")
    (geometry,) = contents.geometries
    expected = np.float32(vertices).astype(np.float64) if name == "binary.stl" else vertices
    sizes = [len(polygon) - 2 for polygon in polygons]
    assert geometry.source_faces.tolist() == np.repeat(np.arange(len(polygons)), sizes).tolist()
    assert geometry.vertices.dtype == np.float64 and geometry.faces.dtype == np.int64
    assert geometry.source_faces.dtype == np.int32 and geometry.pose.is_identity
    assert geometry.name == f"part.{name}".rpartition(".")[0]
    for row, polygon in enumerate(polygons):
        own = geometry.vertices[geometry.faces[geometry.source_faces == row]].reshape(-1, 3)
        if len(polygon) == 3:
            assert np.array_equal(own, expected[polygon])
        assert {tuple(point) for point in own} == {tuple(point) for point in expected[polygon]}


@pytest.mark.parametrize("name", ALL_FORMATS)
def test_file_without_units_is_read_in_those_of_the_caller(tmp_path, name):
    data = ALL_FORMATS[name](*shapes.cube())
    for units, declared, largest in (({"units": "in"}, "in", 0.0254), ({}, "mm", 0.001)):
        contents = read(tmp_path, f"part.{name}", data, **units)
        assert (contents.units, contents.units_declared) == (declared, False)
        assert contents.geometries[0].vertices.max() == largest


@pytest.mark.parametrize("name", POLYGON_FORMATS)
def test_trimesh_reads_the_same_from_whole_files(tmp_path, name):
    import trimesh

    path = write(tmp_path, f"part.{name}", POLYGON_FORMATS[name](VERTICES + 0.1, FACES))
    theirs = trimesh.load_mesh(path, process=False, maintain_order=True)
    # trimesh keeps floats of PLY in single precision.
    assert np.allclose(corners(formats.read_geometries(path, units="m")), theirs.triangles, rtol=1e-6)


# STL, OBJ, OFF and PLY as written by other programs

STL = mesh_files.stl_ascii(VERTICES, FACES)
BINARY_STL = mesh_files.stl_binary(VERTICES, FACES)
OBJ = mesh_files.obj(VERTICES, FACES)
OFF = mesh_files.off(VERTICES, FACES)
PLY = mesh_files.ply_ascii(VERTICES, FACES)
BINARY_PLY = mesh_files.ply_binary(VERTICES, FACES)
NO_NORMALS = STL.replace(b" normal 0 0 0", b"")
WIDE_OBJ = each(rb"^(v .*)$", rb"\1 1 1", OBJ)
END = b"end_header\n"
HEAD, ROWS = PLY[: PLY.index(END) + len(END)], PLY[PLY.index(END) + len(END) :]
NO_LINES = "its points and lines were ignored: they enclose no volume"
NO_END = "its last line has no end: it may have been cut off"
CORNERS = rb"^f (\d) (\d) (\d)$"
STRIP = b"element strip 0\nproperty list int int s\nelement face"


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("words apart.stl", each(rb"^( *end)(loop|facet|solid)", rb"\1 \2", STL)),
        ("comments in front.stl", b"# of a solid\n; facet\n// endsolid\n" + STL),
        ("capitals.stl", STL.upper().replace(b"\n", b"\r\n").replace(b"0 0 0", b"-nan(ind) 1.#QNAN 0")),
        ("end of CP M.stl", STL + b"\x1a"),
        ("block of zeros.stl", STL + bytes(512)),
        ("solid.stl", mesh_files.stl_binary(VERTICES, FACES, header=b"solid part")),
        ("joined.off", OFF.replace(b"OFF\n", b"OFF")),
        ("small letters.off", OFF.replace(b"OFF", b"off")),
        ("no keyword.off", OFF.replace(b"OFF\n", b"")),
        ("numbers on one line.off", OFF.replace(b"\n", b" ") + b"\n"),
        ("a number a line.off", each(rb" ", b"\n", OFF)),
        ("normals.off", each(rb"^(.*\..*)$", rb"\1 0 0 1", OFF.replace(b"OFF", b"NOFF"))),
        ("normals over lines.off", each(rb"^(.*\..*)$", rb"\1\n0 0 1", OFF.replace(b"OFF", b"NOFF"))),
        ("texture.off", each(rb"^(.*\..*)$", rb"\1 0.5 0.5", OFF.replace(b"OFF", b"STOFF"))),
        ("colours of faces.off", each(rb"^(3 .*)$", rb"\1 0.5 0.5 0.5 # red", OFF)),
        ("counts in front.off", b"# a box\n" + OFF.replace(b"OFF\n", b"OFF ").replace(b"12 0", b"12 0 # n")),
        ("end.off", OFF + b"\x1a"),
        ("comments.ply", HEAD + ROWS.replace(b"\n3 0", b"\ncomment here\nobj_info 3 0\n3 0")),
        ("split rows.ply", HEAD + ROWS.replace(b"7.0\n", b"\n7.0\n").replace(b"3 0", b"3\n0")),
        ("mark.ply", b"\xef\xbb\xbf" + PLY),
        ("end.ply", PLY + b"\x1a\r\n"),
        ("word.ply", BINARY_PLY.replace(b"comment made", b"comment end_header comes later")),
        ("blank.ply", BINARY_PLY.replace(b"\nend_header\n", b"\nend_header \r\n")),
        ("no rows.ply", BINARY_PLY.replace(b"element face", STRIP)),
        ("capitals.obj", OBJ.upper()),
        ("first version.obj", OBJ.replace(b"f ", b"fo ")),
        ("materials.obj", OBJ.replace(b"f 1 3 4", b"usemtl a\nf 1 3 4\nusemtl b")),
        ("textures.obj", b"mtllib a\nvn 0 0 1\n" + each(CORNERS, rb"f \1/1/1 \2//1 \\\n \3/1 # c", OBJ)),
        ("colours.obj", each(rb"^v (.*)$", rb"\tv \1 1 0 0 # red", OBJ)),
        ("end.obj", OBJ + b"\x1a"),
    ],
)  # fmt: skip
def test_dialect_is_read_as_if_it_were_none(tmp_path, name, data):
    contents = read(tmp_path, name, data, units="m")
    assert np.array_equal(corners(contents), VERTICES[FACES])
    assert contents.notes == ()
    assert contents.geometries[0].source_faces.tolist() == list(range(12))


@pytest.mark.parametrize(
    ("name", "data", "notes"),
    [
        ("padded.stl", BINARY_STL + bytes(49), ["49 bytes after the last face were ignored"]),
        ("zeros.ply", BINARY_PLY + bytes(30), ["30 bytes after the last row were ignored"]),
        ("more numbers.ply", HEAD + each(rb"^(3 .*)$", rb"\1 9 9.5", ROWS),
         ["the last 2 numbers of each row of element face were ignored"]),
        ("lines.obj", OBJ + b"l 1 2", [NO_LINES, NO_END]),
        ("statements.obj",
         b"$ Contributed\n" + OBJ.replace(b"f 1 3 4", b"t crease 2/1/0 0 1\nvw 0 0 1\nf 1 3 4"),
         ["3 of its lines are not statements of OBJ and were ignored: line 1 begins with '$'"]),
    ],
)  # fmt: skip
def test_what_is_passed_over_is_said(tmp_path, name, data, notes):
    contents = read(tmp_path, name, data, units="m")
    assert np.array_equal(corners(contents), VERTICES[FACES])
    assert list(contents.notes) == notes


def test_solids_of_one_ascii_stl_keep_their_names_and_count_faces_through(tmp_path):
    data = b"".join(mesh_files.stl_ascii(VERTICES, FACES, name) for name in ("Left Lid", "vertex"))
    left, right = read(tmp_path, "part.stl", data).geometries
    assert (left.name, right.name) == ("Left Lid", "vertex")
    assert right.source_faces.tolist() == list(range(12, 24))
    data = b"".join(mesh_files.stl_ascii(VERTICES, FACES, name) for name in ("a", "a_2", "a", "a"))
    names = [geometry.name for geometry in read(tmp_path, "part.stl", data).geometries]
    assert names == ["a", "a_2", "a_3", "a_4"]  # all different from names of the file


def test_obj_relative_references_count_back_from_the_face(tmp_path):
    text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nf -4 -1 -3\n"
    (geometry,) = read(tmp_path, "part.obj", text).geometries
    assert geometry.faces.tolist() == [[0, 1, 2], [0, 3, 1]]


def test_obj_objects_are_geometries_of_their_own(tmp_path):
    corners_of_two = "o Lid#1\nv 0 0 0\nv 1 0 0\nv 0 1 0\no Größe # a comment\nv 0 0 5\nv 1 0 5\nv 0 1 5\n"
    text = corners_of_two + "f 4 5 6\no Lid#1\nf 1 2 3\n"
    lid, other = read(tmp_path, "part.obj", text, units="m").geometries
    assert (lid.name, other.name) == ("Lid#1", "Größe")
    assert lid.source_faces.tolist() == [1] and other.source_faces.tolist() == [0]
    assert other.vertices.tolist() == [[0, 0, 5], [1, 0, 5], [0, 1, 5]] and other.faces.tolist() == [
        [0, 1, 2]
    ]


@pytest.mark.parametrize("line", ["# from C:\\parts\\", "o C:\\", "f 3 2 1 # a\\"])
def test_backslash_behind_a_comment_or_a_name_swallows_no_line(tmp_path, line):
    text = f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{line}\nf 1 2 3\n"
    (geometry,) = read(tmp_path, "part.obj", text).geometries
    assert geometry.faces.tolist()[-1] == [0, 1, 2]


@pytest.mark.parametrize("line_end", [b"\n", b"\r\n", b"\r"])
def test_ply_elements_in_any_order_with_other_properties_and_lists(tmp_path, line_end):
    text = (
        b"ply\nformat ascii 1.0\nelement camera 1\nproperty float f\nelement face 2\nproperty uchar red\n"
        b"property list uchar float texcoord\nproperty list uchar uint vertex_index\nelement vertex 4\n"
        b"property float nx\nproperty float x\nproperty float y\nproperty float z\nend_header\n35\n"
        b"7 2 0.5 0.5 3 0 1 2\n7 0 4 0 1 2 3\n9 0 0 0\n9 1 0 0\n9 1 1 0\n9 0 1 0\n"
    )
    (geometry,) = read(tmp_path, "part.ply", text.replace(b"\n", line_end), units="m").geometries
    assert geometry.faces.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3]]
    assert geometry.source_faces.tolist() == [0, 1, 1] and geometry.vertices[2].tolist() == [1, 1, 0]


def test_squares_of_ply_with_more_numbers_are_cut_here(tmp_path):
    head, rows = mesh_files.ply_ascii(VERTICES, SQUARES).split(END)
    contents = read(tmp_path, "part.ply", head + END + each(rb"^(4 .*)$", rb"\1 7", rows))
    assert contents.geometries[0].source_faces.tolist() == np.repeat(range(6), 2).tolist()


# The sides, and a strip for each end, one of which begins with a doubled corner.
STRIPS = [1, 0, 3, 2, 7, 6, 5, 4, 1, 0, -1, 0, 4, 2, 6, -1, 3, 3, 1, 7, 5]
TEXT_STRIPS = b"\n".join([*ROWS.split(b"\n")[:8], b"21 " + b" ".join(b"%d" % k for k in STRIPS), b""])
BINARY_STRIPS = VERTICES.astype(">f8").tobytes() + np.array([21, *STRIPS], dtype=">i4").tobytes()


@pytest.mark.parametrize(
    ("layout", "body"), [("ascii", TEXT_STRIPS), ("binary_big_endian", BINARY_STRIPS)], ids=["text", "binary"]
)
def test_ply_strips_are_unrolled_each_triangle_the_right_way_round(tmp_path, layout, body):
    head = mesh_files.ply_header(layout, 8, 1).replace(b"element face", b"element tristrips")
    data = head.replace(b"list uchar", b"list int") + body
    (geometry,) = read(tmp_path, "part.ply", data, units="m").geometries
    sides = {tuple(np.sort(face)) for face in geometry.faces.tolist()}
    assert geometry.source_faces.tolist() == list(range(13)) and len(sides) == 13
    assert shapes.volume(geometry.vertices, geometry.faces) == 24.0


@pytest.mark.parametrize(("keyword", "extra"), [(b"OFF", 0), (b"COFF", 4), (b"STCNOFF", 9)])
def test_binary_off_is_read_whatever_follows_its_positions(tmp_path, keyword, extra):
    rows = np.hstack([VERTICES, np.full((8, extra), 0.5)]).astype(">f4").tobytes()
    polygons, colours = [*SQUARES[:5], [1, 3, 7], [1, 7, 5]], [0, 3, 0, 4, 0, 0, 1]
    faces = b"".join(
        struct.pack(f">i{len(p)}ii{n}f", len(p), *p, n, *[0.5] * n)
        for p, n in zip(polygons, colours, strict=True)
    )
    data = b"# by hand\n" + keyword + b" BINARY\n" + struct.pack(">3i", 8, 7, 0) + rows + faces
    contents = read(tmp_path, "part.off", data, units="m")
    (geometry,) = contents.geometries
    assert contents.format == "OFF binary" and shapes.volume(geometry.vertices, geometry.faces) == 24.0
    assert geometry.source_faces.tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 6]
    for wrong, words in (
        (data[:-1], "it ends within row 6 of the 7 of element face: it is cut off"),
        (data + b"\1", "1 bytes follow the last face: its counts are wrong"),
    ):
        assert refusal(write(tmp_path, "part.off", wrong)) == words


@pytest.mark.processes
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
    contents = read(tmp_path, name, data, units="m")
    assert np.array_equal(corners(contents), VERTICES[FACES])
    (note,) = contents.notes
    assert note.startswith(
        f"trimesh read it, and numbered its faces; the reader of this package refuses it: {reason}"
    )


@pytest.mark.processes
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
    assert refusal(write(tmp_path, name, data)).startswith(message)


@pytest.mark.processes
@pytest.mark.parametrize(
    ("where", "name", "value"),
    [(dialects, "_MAX_SECONDS", 0), (dialects, "_MAX_BYTES", 1 << 20), (sys, "executable", "no-python")],
    ids=["time", "memory", "no process"],
)
def test_trimesh_that_takes_too_much_or_cannot_be_started_leaves_the_refusal(
    tmp_path, monkeypatch, where, name, value
):
    monkeypatch.setattr(where, name, value)
    assert refusal(write(tmp_path, "part.stl", NO_NORMALS)).startswith("facet 0 is incomplete")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("part.stl", STL.replace(b"endloop\n", b"", 3)),
        ("part.stl", BINARY_STL[:-1]),
        ("part.ply", PLY.replace(b"element face 12", b"element face " + b"9" * 30)),
        ("part.ply", PLY.replace(b"3 0 2 3", b"3 0 2 3 9")),
        ("part.off", OFF.replace(b"3 0 2 3", b"4 0 2 3")),
        ("part.obj", OBJ.replace(b"f 1 3 4", b"f 1 3 9")),
        ("part.obj", OBJ.replace(b"f 1 3 4", b"f1 3 4")),
        ("part.obj", OBJ + b"call other.obj\n"),
    ],
)
def test_damaged_files_are_not_handed_to_trimesh(tmp_path, monkeypatch, name, data):
    def start(*arguments, **options):
        raise AssertionError("trimesh was asked")

    monkeypatch.setattr(subprocess, "run", start)
    refusal(write(tmp_path, name, data))


def test_unit_or_tolerance_that_does_not_exist_is_refused():
    with pytest.raises(MeshError, match=r"unknown unit 'furlong', expected one of m, dm, cm, mm, um, nm, km"):
        formats.metres_per_unit("furlong")
    with pytest.raises(MeshError, match="unknown unit 5"):
        formats.read_geometries("part.stl", units=5)
    for tolerance in (0.0, "fine"):
        with pytest.raises(ArgumentError, match=r"step_tolerance is .*, expected a positive number of m"):
            formats.read_geometries("part.step", step_tolerance=tolerance)
