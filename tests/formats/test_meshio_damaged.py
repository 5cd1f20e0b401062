"""Damaged, mislabelled and senseless files: one sentence that names the file, and never a part of it."""

import copy
import errno
import os
import re
import struct
import subprocess

import mesh_files
import numpy as np
import pytest
import shapes
import step_text
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from proximity import formats
from proximity.errors import MeshError, MeshFormatError, ProximityError
from proximity.formats import file_reader, libraries, text_rows

VERTICES, FACES = shapes.cube()
OUTSIDE = np.array([*FACES[:-1], [1, 7, 8]])
BINARY_STL = mesh_files.stl_binary(VERTICES, FACES)
ASCII_STL = mesh_files.stl_ascii(VERTICES, FACES)
OBJ = mesh_files.obj(VERTICES, FACES)
OFF = mesh_files.off(VERTICES, FACES)
ASCII_PLY = mesh_files.ply_ascii(VERTICES, FACES)
BINARY_PLY = mesh_files.ply_binary(VERTICES, FACES)
MIXED_PLY = mesh_files.ply_binary(VERTICES, [*FACES[:-2], [1, 3, 7, 5]], ">")
GLTF, BLOB = mesh_files.gltf_document([[(VERTICES, FACES)]], [{"mesh": 0, "name": "cube"}])
GLB = mesh_files.glb(GLTF, BLOB)
EXTENSION = "http://schemas.microsoft.com/3dmanufacturing/"
ITEM = ("1", "1 0 0 0 1 0 0 0 1 0 0 0")
MODEL = mesh_files.threemf_model({1: (VERTICES, FACES)}, [ITEM])
THREEMF = mesh_files.threemf(MODEL)
STEP = step_text.box_step((1, 2, 3)).encode()

WHOLE = {
    "binary.stl": BINARY_STL,
    "ascii.stl": ASCII_STL,
    "part.obj": OBJ,
    "part.off": OFF,
    "ascii.ply": ASCII_PLY,
    "binary.ply": BINARY_PLY,
    "mixed.ply": MIXED_PLY,
    "part.glb": GLB,
    "part.3mf": THREEMF,
}


def write(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    return path


def refusal(path, **options):
    """What the exception says after the path."""
    with pytest.raises(MeshError) as caught:
        formats.read_geometries(path, **options)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and "\n" not in message and "Traceback" not in message
    return message.removeprefix(f"{path}: ")


# Files that are none


def test_missing_file_is_said(tmp_path):
    assert refusal(tmp_path / "part.stl") == "there is no such file"


def test_empty_file_is_said(tmp_path):
    assert refusal(write(tmp_path, "part.stl", b"")) == "it is empty"


def test_directory_is_said(tmp_path):
    (tmp_path / "part.stl").mkdir()
    assert refusal(tmp_path / "part.stl") == "it is a directory, expected a file"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes here")
def test_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "part.stl")
    assert refusal(tmp_path / "part.stl") == "it is not a regular file, expected one"


def test_file_that_may_not_be_read_is_said(tmp_path, monkeypatch):
    path = write(tmp_path, "part.stl", BINARY_STL)

    def refuse(name):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(file_reader, "open_regular", refuse)
    assert refusal(path) == "it cannot be opened (Permission denied)"


@pytest.mark.parametrize(
    "reason",
    [
        TypeError("a\nb"),
        RecursionError(),
    ],
)
def test_what_no_reader_foresaw_is_one_sentence(tmp_path, monkeypatch, reason):
    def fail(source):
        raise reason

    monkeypatch.setitem(file_reader._READERS, "STL", fail)
    path = write(tmp_path, "part.stl", BINARY_STL)
    assert refusal(path) == f"it cannot be read ({text_rows.in_one_line(reason)})"
    with pytest.raises(MeshFormatError) as caught:
        formats.read_geometries(path)
    assert caught.value.__cause__ is reason


def test_path_without_a_letter_is_refused():
    with pytest.raises(MeshError, match=r"^the path is empty, expected the name of a file$"):
        formats.read_geometries("")


def test_too_little_memory_is_said(tmp_path, monkeypatch):
    path = write(tmp_path, "part.stl", BINARY_STL)

    def exhaust(name):
        raise MemoryError

    monkeypatch.setattr(file_reader, "open_regular", exhaust)
    assert refusal(path) == "there is not enough memory to read it"


# Files under a wrong name


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("part.ply", BINARY_STL, "it is named like PLY, but looks like STL"),
        ("part.stl", BINARY_PLY, "it is named like STL, but looks like PLY"),
        ("part.stl", OFF, "it is named like STL, but looks like OFF"),
        ("part.gltf", GLB, "it is named like glTF, but looks like GLB"),
        ("part.3mf", mesh_files.threemf("x", "a.txt"), "it is named like 3MF, but looks like a zip archive"),
        ("part.stl", b"<!DOCTYPE html><title>404</title>", "it is named like STL, but looks like a web page"),
        (
            "part.stl",
            b"version https://git-lfs.github.com/spec/v1\n",
            "it is named like STL, but looks like a Git LFS pointer (the file itself was not fetched)",
        ),
        (
            "part.dxf",
            b"0\nSECTION\n",
            "unknown extension '.dxf', expected one of "
            ".stl, .obj, .ply, .off, .glb, .gltf, .3mf, .step, .stp",
        ),
        (
            "part",
            ASCII_STL,
            "the name has no extension (it looks like STL), expected one of "
            ".stl, .obj, .ply, .off, .glb, .gltf, .3mf, .step, .stp",
        ),
    ],
)
def test_wrong_name_is_said_and_what_it_looks_like(tmp_path, name, data, message):
    assert refusal(write(tmp_path, name, data)) == message


# STL

HEAD = BINARY_STL[:80]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            b"\x01" * 20,
            "it has 20 bytes, but a binary STL file begins with 84 bytes before its faces, and an ASCII one "
            "with the word solid",
        ),
        (BINARY_STL[:-1], "its header claims 12 faces, but there are bytes for 11: it is cut off"),
        (
            BINARY_STL + b"\0" * 50,
            "its header claims 12 faces, but there are bytes for 13: its face count is wrong",
        ),
        (HEAD + bytes(4), "it contains no faces"),
        (ASCII_STL.replace(b"endsolid part", b""), "the line endsolid is missing at the end: it is cut off"),
        (b"solid a\nsolid b\nendsolid\n", "its lines solid and endsolid do not alternate"),
        (b"solid a\nendsolid a\n", "it contains no faces"),
        (ASCII_STL + b"facet\n", "there is 'facet' outside of solid and endsolid"),
        (ASCII_STL.replace(b"vertex 1.0", b"vertex one", 1), "facet 0 has 'one', expected a number"),
        (
            ASCII_STL.replace(b"endloop\n", b"", 3),
            "facet 0 is incomplete, expected facet normal, outer loop, three",
        ),
    ],
)
def test_damaged_stl_is_refused(tmp_path, data, message):
    assert refusal(write(tmp_path, "part.stl", data)).startswith(message)


def test_four_billion_faces_are_not_allocated(tmp_path):
    import tracemalloc

    path = write(tmp_path, "part.stl", HEAD + b"\xff" * 4 + bytes(100))
    tracemalloc.start()
    refusal(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e6


# OBJ


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (OBJ + b"f 0 1 2\n", "line 21 (face 12) refers to vertex 0, but OBJ counts from 1"),
        (
            OBJ + b"f 1 2 9\n",
            "line 21 (face 12) refers to vertex 8 (counted from 0), but there are 8 vertices",
        ),
        (
            OBJ + b"f -1 -2 -9\n",
            "line 21 (face 12) refers to vertex -9, counted back, but 8 vertices precede it",
        ),
        (
            OBJ + b"f 1 / 1 2 / 1 3 / 1\n",
            "line 21 (face 12) has a / that follows no vertex",
        ),  # was: 1 1 2 1 3 1
        (OBJ + b"f 1 2\n", "line 21 (face 12) has 2 corners, expected at least 3"),
        (OBJ + b"f 1 2 three\n", "line 21 (face 12) has 'three', expected a number"),
        (OBJ + b"f 1 2 2.5\n", "line 21 (face 12) refers to vertex 1.5, expected a whole number"),
        (b"v 1 2\n" + OBJ, "line 1 (vertex 1) has 2 numbers, expected 3"),
        (OBJ + b"\x07garbage\n", "line 21 begins with '\\x07garbage', which is not a statement of OBJ"),
        (OBJ + b"surf 0 1 0 1\n", "line 21 is a free-form curve or surface (surf), expected polygons only"),
        (b"v 0 0 0\nv 1 1 1\nl 1 2\n", "it holds 2 vertices and no faces, only lines: there is no surface"),
        (b"v 0 0 0\nv 1 1 1\n", "it holds 2 vertices and no faces, only points: there is no surface"),
        (b"# nothing\n", "it contains no faces"),
    ],
)
def test_damaged_obj_is_refused(tmp_path, data, message):
    assert refusal(write(tmp_path, "part.obj", data)) == message


# OFF


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"FOO\n" + OFF[4:], "it does not begin with OFF, COFF, NOFF or CNOFF"),
        (b"OFF BINARY\n" + bytes(99), "it announces 0 vertices and 0 faces, expected both"),
        (b"OFF\n", "its counts of vertices, faces and edges are not three whole numbers"),
        (OFF[:-9], "it announces 8 vertices and 12 faces, but 19 lines follow: it is cut off"),
        (
            OFF + b"3 0 1 2\n",
            "it announces 8 vertices and 12 faces, but 21 lines follow: its counts are wrong",
        ),
        (
            mesh_files.off(VERTICES, OUTSIDE),
            "line 22 (face 11) refers to vertex 8 (counted from 0), but there are 8",
        ),
        (OFF.replace(b"3 1 7 5", b"4 1 7 5"), "line 22 (face 11) announces 4 corners, but 3 numbers follow"),
        (OFF.replace(b"3 1 7 5", b"2 1 7 5"), "line 22 (face 11) has 2 corners, expected at least 3"),
        (OFF.replace(b"1.0 1.0 1.0", b"1.0 1.0"), "line 10 (vertex 7) has 2 numbers, expected 3 or more"),
        (b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "it contains no faces"),
        (
            OFF.replace(b"8 12 0", b"9 11 0"),
            "line 11 (vertex 8) has 4 numbers, but other vertices have 3: it is damaged, or its counts are",
        ),
    ],
)
def test_damaged_off_is_refused(tmp_path, data, message):
    assert refusal(write(tmp_path, "part.off", data)).startswith(message)


# PLY


def ply(old, new, data=ASCII_PLY):
    assert old in data
    return data.replace(old, new, 1)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (ASCII_PLY[:60], "its header has no line end_header: it is cut off, or not a PLY file"),
        (
            ply(b"property list", b"property bag"),
            "line 9 of its header is 'property bag uchar int vertex_indices'",
        ),
        (
            ply(b"element face 12", b"element face " + b"9" * 5000),
            f"line 8 of its header is 'element face {'9' * 47}...'",
        ),
        (
            ply(b"end_header", b"element face 6\nproperty list uchar int vertex_indices\nend_header"),
            "line 10 of its header declares 'face' a second time",
        ),
        (ply(b"format ascii 1.0\n", b""), "its header has no line format"),
        (ply(b"element vertex 8", b"element vertex 0"), "its header declares no vertices"),
        (ply(b"double z", b"double depth"), "its vertices have no x, y and z, expected positions in space"),
        (ply(b"vertex_indices", b"corners"), "its faces have no list vertex_indices or vertex_index"),
        (
            ply(b"element face 12", b"element face 0"),
            "it is a point cloud: 8 vertices and no faces, there is no surface",
        ),
        (
            ply(b"element face 12", b"element face 0\nproperty uchar u\nelement edge 12"),
            "it is a drawing of lines: 8 vertices and no faces, there is no surface",
        ),
        (
            ply(b"element face", b"element tristrips 9\nproperty int a\nelement face"),
            "it holds faces and triangle strips, expected one of them",
        ),
        (
            ply(b"element vertex 8", b"element vertex 9"),
            "its header declares 21 rows, but 20 follow: it is cut off",
        ),
        (
            ply(b"element face 12", b"element face 11"),
            "its header declares 19 rows, but 20 follow: a count is wrong",
        ),
        (ply(b"3 1 7 5", b"4 1 7 5"), "line 30 (face 11) has 4 numbers, but its header declares 5"),
        (ply(b"3 1 7 5", b"9 1 7 5"), "line 30 (face 11) announces a list of 9, but has 4 numbers"),
        (ply(b"3 1 7 5", b"3 1 7 five"), "line 30 (face 11) has 'five', expected a number"),
        (ply(b"3 1 7 5", b"2 1 7"), "face 11 has 2 corners, expected at least 3"),
        (
            mesh_files.ply_ascii(VERTICES, OUTSIDE),
            "face 11 refers to vertex 8 (counted from 0), but there are 8",
        ),
        (BINARY_PLY[:-1], "it ends within row 11 of the 12 of element face: it is cut off"),
        (BINARY_PLY + b"\1", "1 bytes follow the last row: a count in its header is wrong"),
        (
            mesh_files.ply_header("binary_little_endian", 1, 1).replace(b"uchar", b"char")
            + bytes(24)
            + b"\xff",
            "row 0 of element face has a list of -1 entries",
        ),
        (
            mesh_files.ply_header("binary_little_endian", 1, 1).replace(b"uchar", b"uint")
            + bytes(24)
            + b"\xff" * 4,
            "it ends within row 0 of the 1 of element face: it is cut off",
        ),
    ],
)
def test_damaged_ply_is_refused(tmp_path, data, message):
    assert refusal(write(tmp_path, "part.ply", data)).startswith(message)


# glTF


def changed_gltf(*path, to):
    """The document with one entry replaced (or removed, for None), as GLB."""
    header = copy.deepcopy(GLTF)
    entry = header
    for key in path[:-1]:
        entry = entry[key]
    entry[path[-1]] = to
    if to is None:
        del entry[path[-1]]
    return mesh_files.glb(header, BLOB)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (GLB[:-1], f"its header says {len(GLB)} bytes, but the file has {len(GLB) - 1}: it is cut off"),
        (GLB[:4] + struct.pack("<I", 1) + GLB[8:], "it is glTF version 1, expected 2"),
        (b"glTF", "it does not begin with a GLB header of 12 bytes"),
        (struct.pack("<4sII", b"glTF", 2, 12), "it has no JSON chunk"),
        (
            struct.pack("<4sII", b"glTF", 2, 16) + bytes(4),
            "it ends within the header of a chunk: it is cut off",
        ),
        (GLB.replace(b'{"asset"', b'["asset"'), "its JSON cannot be read ("),
        (changed_gltf("asset", to=None), "its JSON has no asset: it is not a glTF file"),
        (
            changed_gltf("asset", "version", to="1.0"),
            "it is glTF version '1.0', expected 2.0 (gltf-pipeline converts files of version 1)",
        ),
        (changed_gltf("buffers", 0, "byteLength", to=10**9), "buffer 0 has "),
        (
            changed_gltf("buffers", 0, "uri", to="none.bin"),
            "buffer 0 is the file 'none.bin' beside it, which cannot",
        ),
        (
            changed_gltf("buffers", 0, "uri", to="data:;base64,***"),
            "buffer 0 inside the file is not base64 text",
        ),
        (changed_gltf("buffers", 0, "uri", to=5), "the uri of buffer 0 is no text"),
        (mesh_files.glb(GLTF, BLOB).replace(b"BIN\0", b"XXX\0"), "buffer 0 is not there: it has no uri"),
        (
            changed_gltf("bufferViews", 1, "byteLength", to=10**6),
            "buffer view 1 reaches beyond the end of buffer 0",
        ),
        (
            changed_gltf("bufferViews", 0, "byteStride", to=4),
            "accessor 0 (primitive 0 of mesh 0) has 8 entries, which",
        ),
        (
            changed_gltf("accessors", 0, "componentType", to=5130),
            "accessor 0 (primitive 0 of mesh 0) has type 'VEC3' of 5130, expected 'VEC3' of 5126",
        ),
        (
            changed_gltf("accessors", 0, "componentType", to=5125),
            "accessor 0 (primitive 0 of mesh 0) has type 'VEC3' of 5125, expected 'VEC3' of 5126",
        ),
        (
            changed_gltf("accessors", 0, "bufferView", to=None),
            "accessor 0 (primitive 0 of mesh 0) has no buffer view: there are no positions",
        ),
        (
            changed_gltf("accessors", 1, "sparse", to={}),
            "the sparse part of accessor 1 (primitive 0 of mesh 0) has no indices or no values",
        ),
        (
            changed_gltf("accessors", 1, "count", to=35),
            "primitive 0 of mesh 0 has 35 corners, which is not a multiple of 3",
        ),
        (
            changed_gltf("accessors", 0, "count", to=7),
            "triangle 2 of primitive 0 of mesh 0 refers to vertices",
        ),
        (changed_gltf("meshes", 0, "primitives", to=None), "mesh 0 has no primitives"),
        (
            changed_gltf("meshes", 0, "primitives", 0, "indices", to=7),
            "it refers to accessors 7, but holds 2",
        ),
        (
            changed_gltf("meshes", 0, "primitives", 0, "mode", to=7),
            "primitive 0 of mesh 0 has mode 7, expected triangles (4), a strip (5) or a fan (6)",
        ),
        (changed_gltf("nodes", 0, "children", to=[0]), "node 0 occurs in the scene twice, expected a tree"),
        (changed_gltf("nodes", 0, "scale", to=[1, 1]), "the scale of node 0 is not 3 finite numbers"),
        (
            changed_gltf("nodes", 0, "scale", to=[0, 0, 0]),
            "all of its parts are scaled to nothing: 'cube'",
        ),
        (
            changed_gltf("nodes", 0, "rotation", to=[0, 0, 0, 0]),
            "the rotation of node 0 is zero, expected a unit",
        ),
        (
            changed_gltf("nodes", 0, "matrix", to=[1] * 16),
            "'cube': the last row of its matrix is [1.0, 1.0, 1.0, 1.0]",
        ),
        (
            changed_gltf("accessors", 1, "byteOffset", to=1),
            "accessor 1 (primitive 0 of mesh 0) has 36 entries, which do not fit into buffer view 1",
        ),
        (changed_gltf("nodes", to={"a": 1}), "its JSON has nodes that are not a list"),
        (
            changed_gltf("meshes", 0, "primitives", 0, "attributes", to=None),
            "primitive 0 of mesh 0 has no attributes",
        ),
        (
            changed_gltf("meshes", 0, "primitives", 0, "mode", to=0),
            "it contains no faces (points and lines were ignored: they enclose nothing)",
        ),
        (
            changed_gltf("scenes", 0, "nodes", to=[]),
            "it contains no faces (its default scene places no meshes)",
        ),
        (
            changed_gltf("meshes", 0, "primitives", 0, "extensions", to=5),
            "primitive 0 of mesh 0 has extensions that are not a JSON object",
        ),
        (
            changed_gltf("nodes", 0, "mesh", to=10**400),
            f"the mesh of node 0: there is 1{'0' * 23}..., expected a whole number, 0 or more",
        ),
        (
            changed_gltf("extensionsRequired", to=["EXT_meshopt_compression"]),
            "its geometry is stored by EXT_meshopt_compression, which is not supported; export it without, "
            "or unpack it by: gltfpack -noq -kn",
        ),
        (
            changed_gltf("extensionsUsed", to=["EXT_mesh_gpu_instancing"]),
            "its geometry is stored by EXT_mesh_gpu_instancing, which is not supported; export it without",
        ),
        (
            changed_gltf("extensionsRequired", to=["KHR_texture_transform", "ACME_curved_surfaces"]),
            "it requires the extension 'ACME_curved_surfaces', which is not read",
        ),
    ],
)
def test_damaged_glb_is_refused(tmp_path, data, message):
    assert refusal(write(tmp_path, "part.glb", data)).startswith(message)


def test_gltf_without_scenes_whose_children_are_no_numbers_is_refused(tmp_path):
    header = {**GLTF, "nodes": [{"mesh": 0, "children": [[]]}]}
    del header["scenes"]
    message = refusal(write(tmp_path, "part.glb", mesh_files.glb(header, BLOB)))
    assert message == "the children of node 0: there is [], expected a whole number, 0 or more"


def test_bounds_of_gltf_positions_may_be_rounded(tmp_path):
    header, blob = mesh_files.gltf_document([[(VERTICES + 0.1, FACES)]], [{"mesh": 0}])
    header["accessors"][0] |= {"min": [0.1, 0.1, 0.1], "max": [1.1, 1.10000002, 1.0999999]}
    path = write(tmp_path, "part.glb", mesh_files.glb(header, blob))
    assert len(formats.read_geometries(path).geometries) == 1


def test_gltf_without_scenes_places_what_is_nobodys_child(tmp_path):
    contents = formats.read_geometries(write(tmp_path, "part.glb", changed_gltf("scenes", to=None)))
    assert [geometry.name for geometry in contents.geometries] == ["cube"]


def test_strip_of_two_corners_is_refused(tmp_path):
    header, blob = mesh_files.gltf_document([[(VERTICES, [0, 1])]], [{"mesh": 0}])
    header["meshes"][0]["primitives"][0]["mode"] = 5
    message = refusal(write(tmp_path, "part.glb", mesh_files.glb(header, blob)))
    assert message == "primitive 0 of mesh 0 is a strip of 2 corners, expected at least 3"


def test_json_nested_without_end_is_refused(tmp_path):
    path = write(tmp_path, "part.gltf", b'{"asset": ' + b"[" * 100000)
    assert refusal(path).startswith("its JSON cannot be read (")


# 3MF


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (THREEMF[:-30], "its zip archive cannot be read (BadZipFile: "),
        (THREEMF[:90] + bytes([THREEMF[90] ^ 255]) + THREEMF[91:], "its zip archive cannot be read ("),
        (mesh_files.threemf("<amf/>"), "its model file has no element model"),
        (
            mesh_files.threemf(MODEL.replace('"millimeter"', '"parsec"')),
            "its unit is 'parsec', expected one of micron",
        ),
        (
            mesh_files.threemf(MODEL.replace('<item objectid="1"', '<item objectid="7"')),
            "an item refers to object '7'",
        ),
        (mesh_files.threemf(re.sub("<item[^>]*>", "", MODEL)), "its build has no items: it places nothing"),
        (
            mesh_files.threemf(MODEL.replace('transform="1 ', 'transform="nan ')),
            "'part1': it is placed by a matrix that",
        ),
        (mesh_files.threemf(MODEL[:-9]), "'3D/3dmodel.model' is not XML (unclosed token: line 1, column "),
        (
            mesh_files.threemf(MODEL.replace('x="1.0"', 'x="one"', 1)),
            "line 1 of '3D/3dmodel.model': <vertex> cannot",
        ),
        (
            mesh_files.threemf(MODEL.replace('v3="5"', 'v3="8"')),
            "triangle 4 of 'part1' refers to vertices [0, 1, 8], but there are 8",
        ),
        (
            mesh_files.threemf(MODEL.replace('x="1.0"', "", 1)),
            "line 1 of '3D/3dmodel.model': <vertex> has no x",
        ),
        (
            mesh_files.threemf(MODEL.replace("<triangles>", "<triangles/><triangles>")),
            "line 1 of '3D/3dmodel.model': an object has a second <triangles>",
        ),
        (
            mesh_files.threemf(MODEL.replace("<model ", '<model requiredextensions="b p" ')),
            "it needs extensions that are not read: 'b, p'",
        ),
        (
            # A prefix means what the file says: here not materials, but beams that would be left out.
            mesh_files.threemf(
                MODEL.replace(
                    "<model ", f'<model xmlns:m="{EXTENSION}beamlattice/2017/02" requiredextensions="m" '
                )
            ),
            "it needs extensions that are not read: 'beamlattice'",
        ),
        (
            mesh_files.threemf(
                MODEL.replace("</resources>", "<object id='7'><shape/></object></resources>").replace(
                    '<item objectid="1"', '<item objectid="7"/><item objectid="1"'
                )
            ),
            "object '7' has no mesh and no components: its content is not supported",
        ),
        (mesh_files.threemf(mesh_files.threemf_model({1: (VERTICES, [])}, [ITEM])), "it contains no faces"),
    ],
)
def test_damaged_3mf_is_refused(tmp_path, data, message):
    assert refusal(write(tmp_path, "part.3mf", data)).startswith(message)


def test_3mf_that_calls_a_known_extension_by_another_name_is_read(tmp_path):
    model = MODEL.replace(
        "<model ", f'<model xmlns:q="{EXTENSION}production/2015/06" requiredextensions="q" '
    )
    contents = formats.read_geometries(write(tmp_path, "part.3mf", mesh_files.threemf(model)))
    assert len(contents.geometries[0].faces) == 12


COMPONENTS = "<object id='{}'><components><component objectid='{}'/></components></object>"


def spread_3mf(*ids, unit=' unit="millimeter"', root="", extra=""):
    """A root model whose object 9 has components, each an object in a model file of its own."""
    others = {
        f"part{k}": mesh_files.threemf_model({own_id: (VERTICES, FACES)}, [], unit).replace(
            "</resources>", extra + "</resources>"
        )
        for k, own_id in enumerate(ids)
    }
    components = "".join(
        f'<component p:path="/3D/part{k}.model" objectid="{own_id}"/>' for k, own_id in enumerate(ids)
    )
    model = mesh_files.threemf_model({}, [(9, ITEM[1])]).replace(
        "</resources>", f'<object id="9"><components>{components}</components></object>{root}</resources>'
    )
    return mesh_files.threemf(model.replace("<model ", '<model xmlns:p="p" ', 1), **others)


@pytest.mark.parametrize(
    "data",
    [spread_3mf(1, 2), spread_3mf(1, 1)],  # ids count per model file
    ids=["ids differ", "one id in both"],
)
def test_3mf_of_several_model_files_is_read(tmp_path, data):
    contents = formats.read_geometries(write(tmp_path, "part.3mf", data))
    assert [len(geometry.faces) for geometry in contents.geometries] == [12, 12]


def test_model_file_of_a_3mf_may_hold_objects_that_are_not_placed(tmp_path):
    extra = "<object id='7'><mesh/></object>" + COMPONENTS.format(8, 1)
    contents = formats.read_geometries(write(tmp_path, "part.3mf", spread_3mf(1, extra=extra)))
    assert [len(geometry.faces) for geometry in contents.geometries] == [12]
    assert contents.notes == ("1 of its objects are not part of the build and were ignored",)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            mesh_files.threemf(MODEL.replace("</resources>", "<object id='1'/></resources>")),
            "object '1' of '3D/3dmodel.model' occurs twice",
        ),
        (
            mesh_files.threemf(
                MODEL.replace("</mesh>", "</mesh><components><component objectid='1'/></components>")
            ),
            "object '1' has a mesh and components, expected one of the two",
        ),
        (
            mesh_files.threemf(
                MODEL.replace(
                    "</resources>", COMPONENTS.format(2, 3) + COMPONENTS.format(3, 2) + "</resources>"
                )
            ),
            "object '2' is a component of itself, expected a tree",
        ),
        (
            spread_3mf(1, unit=' unit="inch"'),
            "'3D/3dmodel.model' is in mm, but '3D/part0.model' in in; expected one unit in all",
        ),
        (spread_3mf(1, root=COMPONENTS.format(8, 1)), "a component refers to object '1', which is not there"),
    ],
)
def test_3mf_that_would_be_put_together_wrongly_is_refused(tmp_path, data, message):
    assert refusal(write(tmp_path, "part.3mf", data)).startswith(message)


# STEP


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (STEP[:-10], "it does not end with END-ISO-10303-21: it is cut off"),
        (
            STEP.replace(b"ADVANCED_FACE", b"ADVANCED_FACX", 1),
            "its shells list 6 faces, but OpenCASCADE could mesh 5 only; export it in another format, as 3MF",
        ),
        (STEP.replace(b"CLOSED_SHELL", b"NO_SHELL"), "it contains no faces"),
        (STEP[:2000] + STEP[-30:], "OpenCASCADE could not read all of it: ERR"),
        (STEP + STEP, "it is several STEP files in one, of which OpenCASCADE would read the first only"),
    ],
)
def test_damaged_step_is_refused_and_nothing_is_printed(tmp_path, capfd, data, message):
    assert refusal(write(tmp_path, "part.step", data)).startswith(message)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("returncode", "message"),
    [
        (-11, "OpenCASCADE crashed on it (signal 11)"),
        (3, "STEP files need the package cascadio, which cannot be imported"),
        (1, "OpenCASCADE could not read all of it"),
    ],
)
def test_crash_of_the_step_library_is_an_error_like_others(tmp_path, monkeypatch, returncode, message):
    def crash(*arguments, **options):
        return subprocess.CompletedProcess(arguments, returncode)

    monkeypatch.setattr(libraries.subprocess, "run", crash)
    assert refusal(write(tmp_path, "part.step", STEP)) == message


@pytest.mark.parametrize("where", ["tempfile.TemporaryDirectory", "subprocess.run"])
def test_full_disk_on_the_way_to_the_step_library_is_said(tmp_path, monkeypatch, where):
    # Was: an OSError, of which the command line said that the output cannot be written.
    def fail(*arguments, **options):
        raise OSError(errno.ENOSPC, "No space left on device")

    path = write(tmp_path, "part.step", STEP)
    monkeypatch.setattr(f"proximity.formats.libraries.{where}", fail)

    with pytest.raises(MeshError) as caught:
        formats.read_geometries(path)

    expected = "OpenCASCADE cannot be handed it in a temporary folder (No space left on device)"
    assert str(caught.value) == f"{path}: {expected}"


# Numbers


@pytest.mark.parametrize(
    "name", ["part.obj", "part.off", "ascii.ply", "binary.ply", "binary.stl", "part.glb"]
)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_vertex_that_is_not_finite_is_named_and_counted(tmp_path, name, value):
    vertices = VERTICES.copy()
    vertices[3, 1] = value
    writers = {
        "part.obj": mesh_files.obj,
        "part.off": mesh_files.off,
        "ascii.ply": mesh_files.ply_ascii,
        "binary.ply": mesh_files.ply_binary,
        "binary.stl": mesh_files.stl_binary,
        "part.glb": lambda v, f: mesh_files.glb(*mesh_files.gltf_document([[(v, f)]], [{"mesh": 0}])),
    }
    message = refusal(write(tmp_path, name, writers[name](vertices, FACES)))
    used = 36 if name.endswith("stl") else 8
    stem = name.split(".")[0]
    pattern = (
        rf"vertex \d+ of '{stem}' is not finite: \(1.0, {value}, 0.0\); \d of the {used} vertices in use"
    )
    assert re.match(pattern, message)


def test_vertex_that_no_face_uses_may_be_anything(tmp_path):
    data = mesh_files.obj([*VERTICES, [np.nan] * 3], FACES)
    assert len(formats.read_geometries(write(tmp_path, "part.obj", data)).geometries[0].faces) == 12


def test_position_that_overflows_in_metres_is_not_finite(tmp_path):
    path = write(tmp_path, "part.obj", mesh_files.obj(VERTICES * 1e308, FACES))
    assert refusal(path, units="km").startswith("vertex 1 of 'part' is not finite: (1e+308, 0.0, 0.0)")


# Any damage at all


@pytest.mark.parametrize("name", WHOLE)
def test_no_beginning_of_a_file_is_taken_for_the_whole(tmp_path, name):
    """Cut anywhere: refused, or nothing is missing, or (OBJ has no counts) it is said."""
    data = WHOLE[name]
    whole = formats.read_geometries(write(tmp_path, name, data)).geometries[0]
    for length in range(1, len(data), 1 if len(data) < 1500 else 7):
        try:
            contents = formats.read_geometries(write(tmp_path, name, data[:length]))
        except ProximityError:
            continue
        part = contents.geometries[0]
        is_same = np.array_equal(part.vertices[part.faces], whole.vertices[whole.faces])
        at_a_line = name == "part.obj" and data[length - 1 : length] == b"\n"
        assert is_same or at_a_line or "it may have been cut off" in contents.notes[-1]


@st.composite
def damaged(draw):
    """A file of any format with a few bytes changed, taken away or put in."""
    name = draw(st.sampled_from(sorted(WHOLE)))
    data = bytearray(WHOLE[name])
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(len(data) - 1, 0)))
        kind = draw(st.sampled_from(["change", "cut", "insert", "double"]))
        if kind == "change":
            data[at : at + 1] = bytes([draw(st.integers(0, 255))])
        elif kind == "cut":
            del data[at : at + draw(st.integers(1, 60))]
        elif kind == "insert":
            data[at:at] = draw(
                st.sampled_from([b"-", b"9", b"\n", b" ", b"nan", b"1e999", b"\0\0\0\0", b"\xff\xff"])
            )
        else:
            data[at:at] = data[at : at + 50]
    return name, bytes(data)


@settings(
    max_examples=400,
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(file=damaged())
def test_damaged_file_gives_a_sentence_or_a_valid_mesh(tmp_path, file):
    name, data = file
    try:
        contents = formats.read_geometries(write(tmp_path, name, data))
    except ProximityError as reason:
        assert str(reason).startswith(str(tmp_path)) and "\n" not in str(reason)
        return
    for geometry in contents.geometries:
        assert geometry.faces.min() >= 0 and geometry.faces.max() < len(geometry.vertices)
        assert len(geometry.faces) == len(geometry.source_faces) > 0
        assert np.isfinite(geometry.vertices[geometry.faces]).all()
