"""Damaged, mislabelled or hostile files: one sentence with the position, never a partial shape."""

import copy
import errno
import json
import os
import re
import struct
import tracemalloc
from contextlib import ExitStack

import mesh_files
import numpy as np
import pytest
import shapes
import step_text
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import proximity
from proximity import formats
from proximity.errors import MeshError, MeshFormatError, MissingLibraryError, ProximityError
from proximity.formats import file_reader, libraries, text_rows, worker
from proximity.formats.libraries import Library
from proximity.recording import FrameLog, FrameReader, read_recording
from proximity.service.config import read_scene_file

VERTICES, FACES = shapes.cube()
OUTSIDE = np.array([*FACES[:-1], [1, 7, 8]])
STL = mesh_files.stl_binary(VERTICES, FACES)
TEXT_STL = mesh_files.stl_ascii(VERTICES, FACES)
OBJ = mesh_files.obj(VERTICES, FACES)
OFF = mesh_files.off(VERTICES, FACES)
PLY = mesh_files.ply_ascii(VERTICES, FACES)
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
    "binary.stl": STL, "ascii.stl": TEXT_STL, "part.obj": OBJ, "part.off": OFF, "ascii.ply": PLY,
    "binary.ply": BINARY_PLY, "mixed.ply": MIXED_PLY, "part.glb": GLB, "part.3mf": THREEMF,
}  # fmt: skip


def write(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    return path


def refusal(path, **options):
    """Return the error message after the path."""
    with pytest.raises(MeshError) as caught:
        formats.read_geometries(path, **options)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and "\n" not in message and "Traceback" not in message
    return message.removeprefix(f"{path}: ")


def says(message, words):
    """Test whether a message begins with these words, "…" matching any others."""
    return re.match(".*".join(map(re.escape, words.split("…"))), message) is not None


def swapped(data, *pairs):
    """Return *data* with each old piece, which must occur, replaced once."""
    for old, new in zip(pairs[::2], pairs[1::2], strict=True):
        assert old in data
        data = data.replace(old, new, 1)
    return data


def ply(*pairs):
    return swapped(PLY, *pairs)


def one_list(old, new, rest):
    """Return a binary PLY of a vertex and a face with another type of list length."""
    return mesh_files.ply_header("binary_little_endian", 1, 1).replace(old, new) + bytes(24) + rest


def glb(*path, to):
    """Return the document as GLB with one entry replaced, or removed for None."""
    header = copy.deepcopy(GLTF)
    entry = header
    for key in path[:-1]:
        entry = entry[key]
    entry[path[-1]] = to
    if to is None:
        del entry[path[-1]]
    return mesh_files.glb(header, BLOB)


def model(*pairs):
    return mesh_files.threemf(swapped(MODEL, *pairs))


COMPONENTS = "<object id='{}'><components><component objectid='{}'/></components></object>"


def spread_3mf(*ids, unit=' unit="millimeter"', root="", extra=""):
    """Return a root model whose object 9 has components, each in a separate model file."""
    others = {
        f"part{k}": swapped(
            mesh_files.threemf_model({own_id: (VERTICES, FACES)}, [], unit),
            "</resources>",
            extra + "</resources>",
        )
        for k, own_id in enumerate(ids)
    }
    parts = "".join(
        f'<component p:path="/3D/part{k}.model" objectid="{own_id}"/>' for k, own_id in enumerate(ids)
    )
    text = f'<object id="9"><components>{parts}</components></object>{root}</resources>'
    whole = swapped(
        mesh_files.threemf_model({}, [(9, ITEM[1])]), "</resources>", text, "<model ", '<model xmlns:p="p" '
    )
    return mesh_files.threemf(whole, **others)


POSITIONS, INDICES, PRIMITIVE = ("accessors", 0), ("accessors", 1), ("meshes", 0, "primitives", 0)
HEAD, NODE = STL[:80], ("nodes", 0)
FIVE_KINDS = ".stl, .obj, .ply, .off, .glb"
ALTERED = THREEMF[:90] + bytes([THREEMF[90] ^ 255]) + THREEMF[91:]
BEAMS = f'<model xmlns:m="{EXTENSION}beamlattice/2017/02" requiredextensions="m" '

NO_MESH, USED = "<object id='7'><shape/></object></resources>", '<item objectid="7"/><item objectid="1"'
BOTH = "</mesh><components><component objectid='1'/></components>"
CYCLE = COMPONENTS.format(2, 3) + COMPONENTS.format(3, 2) + "</resources>"


def two_corners(mode):
    header, blob = mesh_files.gltf_document([[(VERTICES, [0, 1])]], [{"mesh": 0}])
    header["meshes"][0]["primitives"][0]["mode"] = mode
    return mesh_files.glb(header, blob)


def without_scenes(**node):
    return mesh_files.glb(
        {**{k: v for k, v in GLTF.items() if k != "scenes"}, "nodes": [{"mesh": 0, **node}]}, BLOB
    )


TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
PLENTY = b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n210000 " + b"0 1 2 " * 70_000 + b"\n"
PARTS = b"".join(b"o %d\nf 1 2 3\n" % k for k in range(100_000))
CASES = [
    # wrong names
    ("part.stl", b"", "it is empty"),
    ("part.ply", STL, "it is named like PLY, but looks like STL"),
    ("part.stl", BINARY_PLY, "it is named like STL, but looks like PLY"),
    ("part.stl", OFF, "it is named like STL, but looks like OFF"),
    ("part.gltf", GLB, "it is named like glTF, but looks like GLB"),
    ("part.3mf", mesh_files.threemf("x", "a.txt"), "it is named like 3MF, but looks like a zip archive"),
    ("part.stl", b"<!DOCTYPE html><title>404</title>", "it is named like STL, but looks like a web page"),
    ("part.stl", b"version https://git-lfs.github.com/spec/v1\n", "it is named like STL…a Git LFS pointer"),
    ("part.dxf", b"0\nSECTION\n", f"unknown extension '.dxf', expected one of {FIVE_KINDS}"),
    ("part", TEXT_STL, f"the name has no extension (it looks like STL), expected one of {FIVE_KINDS}"),
    ("part.obj", OBJ.decode().encode("utf-16"), "it is named like OBJ…text in UTF-16 (save it as UTF-8)"),
    # STL
    ("part.stl", b"\x01" * 20, "it has 20 bytes, but a binary STL file begins with 84 bytes"),
    ("part.stl", STL[:-1], "its header claims 12 faces…bytes for 11: it is cut off"),
    ("part.stl", STL + bytes(50), "its header claims 12 faces…bytes for 13: its face count is wrong"),
    ("part.stl", HEAD + bytes(4), "it contains no faces"),
    ("part.stl", swapped(TEXT_STL, b"endsolid part", b""), "the line endsolid is missing at the end"),
    ("part.stl", b"solid a\nsolid b\nendsolid\n", "its lines solid and endsolid do not alternate"),
    ("part.stl", b"solid a\nendsolid a\n", "it contains no faces"),
    ("part.stl", TEXT_STL + b"facet\n", "there is 'facet' outside of solid and endsolid"),
    ("part.stl", swapped(TEXT_STL, b"vertex 1.0", b"vertex one"), "facet 0 has 'one', expected a number"),
    ("part.stl", TEXT_STL.replace(b"endloop\n", b"", 3), "facet 0 is incomplete, expected facet normal"),
    # OBJ
    ("part.obj", OBJ + b"f 0 1 2\n", "line 21 (face 12) refers to vertex 0, but OBJ counts from 1"),
    ("part.obj", OBJ + b"f 1 2 9\n", "line 21 (face 12) refers to vertex 8…there are 8 vertices"),
    ("part.obj", OBJ + b"f -1 -2 -9\n", "line 21 (face 12) refers to vertex -9, counted back, but 8"),
    ("part.obj", OBJ + b"f 1 / 1 2 / 1 3 / 1\n", "line 21 (face 12) has a / that follows no vertex"),
    ("part.obj", OBJ + b"f 1 2\n", "line 21 (face 12) has 2 corners, expected at least 3"),
    ("part.obj", OBJ + b"f 1 2 three\n", "line 21 (face 12) has 'three', expected a number"),
    ("part.obj", OBJ + b"f 1 2 2.5\n", "line 21 (face 12) refers to vertex 1.5, expected a whole number"),
    ("part.obj", b"v 1 2\n" + OBJ, "line 1 (vertex 1) has 2 numbers, expected 3"),
    ("part.obj", OBJ + b"\x07garbage\n", "line 21 begins with '\\x07garbage', which is not a statement"),
    ("part.obj", OBJ + b"surf 0 1 0 1\n", "line 21 is a free-form curve or surface (surf)"),
    ("part.obj", b"v 0 0 0\nv 1 1 1\nl 1 2\n", "it holds 2 vertices and no faces, only lines"),
    ("part.obj", b"v 0 0 0\nv 1 1 1\n", "it holds 2 vertices and no faces, only points"),
    ("part.obj", b"# nothing\n", "it contains no faces"),
    ("part.obj", b"Dear reader,\n", "line 1 begins with 'Dear', which is not a statement of OBJ"),
    # OFF
    ("part.off", b"FOO\n" + OFF[4:], "it does not begin with OFF, COFF, NOFF or CNOFF"),
    ("part.off", b"4" + OFF, "it does not begin with OFF, COFF, NOFF or CNOFF"),
    ("part.off", b"OFF BINARY\n" + bytes(99), "it announces 0 vertices and 0 faces, expected both"),
    ("part.off", b"OFF BINARY\n" + bytes(9), "it ends within its counts of vertices, faces and edges"),
    ("part.off", b"OFF\n", "its counts of vertices, faces and edges are not three whole numbers"),
    ("part.off", OFF[:-9], "it announces 8 vertices and 12 faces, but 19 lines follow: it is cut off"),
    ("part.off", OFF + b"3 0 1 2\n", "it announces 8…and 12 faces, but 21 lines follow: its counts"),
    ("part.off", b"OFF\n8 12 0 1\n", "it announces 8 vertices and 12 faces, but 0 lines follow"),
    ("part.off", mesh_files.off(VERTICES, OUTSIDE), "line 22 (face 11) refers to vertex 8…there are 8"),
    ("part.off", swapped(OFF, b"3 1 7 5", b"4 1 7 5"), "line 22 (face 11) announces 4 corners, but 3"),
    ("part.off", swapped(OFF, b"3 1 7 5", b"2 1 7 5"), "line 22 (face 11) has 2 corners, expected at least"),
    ("part.off", OFF.replace(b"1.0 1.0 1.0", b"1.0 1.0"), "line 10 (vertex 7) has 2 numbers, expected 3 or"),
    ("part.off", b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "it contains no faces"),
    ("part.off", swapped(OFF, b"8 12 0", b"9 11 0"), "line 11 (vertex 8) has 4 numbers…have 3: it is"),
    # PLY
    ("part.ply", PLY[:60], "its header has no line end_header: it is cut off"),
    ("part.ply", ply(b"property list", b"property bag"), "line 9 of its header is 'property bag uchar"),
    ("part.ply", ply(b"face 12", b"face " + b"9" * 5000), "line 8 of its header is 'element face 999…...'"),
    ("part.ply", ply(b"end_header", b"element face 6\nend_header"), "line 10 of its header declares 'face'"),
    ("part.ply", ply(b"format ascii 1.0\n", b""), "its header has no line format"),
    ("part.ply", ply(b"vertex 8", b"vertex 0"), "its header declares no vertices"),
    ("part.ply", ply(b"double z", b"double depth"), "its vertices have no x, y and z"),
    ("part.ply", ply(b"vertex_indices", b"corners"), "its faces have no list vertex_indices"),
    ("part.ply", ply(b"face 12", b"face 0"), "it is a point cloud: 8 vertices and no faces"),
    ("part.ply", ply(b"face 12", b"face 0\nproperty uchar u\nelement edge 12"), "it is a drawing of lines:"),
    ("part.ply", ply(b"element face", b"element tristrips 9\nproperty int a\nelement face"), "it holds"),
    ("part.ply", ply(b"vertex 8", b"vertex 9"), "its header declares 21 rows, but 20 follow: it is cut off"),
    ("part.ply", ply(b"face 12", b"face 11"), "its header declares 19 rows, but 20 follow: a count is wrong"),
    ("part.ply", ply(b"3 1 7 5", b"4 1 7 5"), "line 30 (face 11) has 4 numbers, but its header declares 5"),
    ("part.ply", ply(b"3 1 7 5", b"9 1 7 5"), "line 30 (face 11) announces a list of 9, but has 4"),
    ("part.ply", ply(b"3 1 7 5", b"3 1 7 five"), "line 30 (face 11) has 'five', expected a number"),
    ("part.ply", ply(b"3 1 7 5", b"2 1 7"), "face 11 has 2 corners, expected at least 3"),
    ("part.ply", mesh_files.ply_ascii(VERTICES, OUTSIDE), "face 11 refers to vertex 8 (counted from 0)"),
    ("part.ply", BINARY_PLY[:-1], "it ends within row 11 of the 12 of element face: it is cut off"),
    ("part.ply", BINARY_PLY + b"\1", "1 bytes follow the last row: a count in its header is wrong"),
    ("part.ply", one_list(b"uchar", b"char", b"\xff"), "row 0 of element face has a list of -1 entries"),
    ("part.ply", one_list(b"uchar", b"uint", b"\xff" * 4), "it ends within row 0 of the 1 of element face"),
    # glTF
    ("part.glb", GLB[:-1], f"its header says {len(GLB)} bytes…has {len(GLB) - 1}: it is cut off"),
    ("part.glb", GLB[:4] + struct.pack("<I", 1) + GLB[8:], "it is glTF version 1, expected 2"),
    ("part.glb", b"glTF", "it does not begin with a GLB header of 12 bytes"),
    ("part.glb", struct.pack("<4sII", b"glTF", 2, 12), "it has no JSON chunk"),
    ("part.glb", struct.pack("<4sII", b"glTF", 2, 16) + bytes(4), "it ends within the header of a chunk"),
    ("part.glb", swapped(GLB, b'{"asset"', b'["asset"'), "its JSON cannot be read ("),
    ("part.gltf", b'{"asset": ' + b"[" * 100000, "its JSON cannot be read ("),
    ("part.glb", glb("asset", to=None), "its JSON has no asset: it is not a glTF file"),
    ("part.glb", glb("asset", "version", to="1.0"), "it is glTF version '1.0', expected 2.0 (gltf-pipeline"),
    ("part.glb", glb("buffers", 0, "byteLength", to=10**9), "buffer 0 has "),
    ("part.glb", glb("buffers", 0, "uri", to="none.bin"), "buffer 0 is the file 'none.bin' beside it, which"),
    ("part.glb", glb("buffers", 0, "uri", to="data:;base64,***"), "buffer 0 inside the file is not base64"),
    ("part.glb", glb("buffers", 0, "uri", to=5), "the uri of buffer 0 is not text"),
    ("part.glb", swapped(GLB, b"BIN\0", b"XXX\0"), "buffer 0 is not there: it has no uri"),
    ("part.glb", glb("bufferViews", 1, "byteLength", to=10**6), "buffer view 1 reaches beyond…buffer 0"),
    ("part.glb", glb("bufferViews", 0, "byteStride", to=4), "accessor 0 (primitive 0 of mesh 0) has 8"),
    ("part.glb", glb(*POSITIONS, "componentType", to=5130), "accessor 0 (prim…type 'VEC3' of 5130, expected"),
    ("part.glb", glb(*POSITIONS, "componentType", to=5125), "accessor 0 (prim…type 'VEC3' of 5125, expected"),
    ("part.glb", glb(*POSITIONS, "bufferView", to=None), "accessor 0 (prim…no buffer view, expected"),
    ("part.glb", glb(*POSITIONS, "count", to=7), "triangle 2 of primitive 0 of mesh 0 refers to vertices"),
    ("part.glb", glb(*INDICES, "sparse", to={}), "the sparse part of accessor 1…has no indices or no values"),
    ("part.glb", glb(*INDICES, "count", to=35), "primitive 0 of mesh 0 has 35 corners…multiple of 3"),
    ("part.glb", glb(*INDICES, "byteOffset", to=1), "accessor 1 (prim…36 entries…fit into buffer view 1"),
    ("part.glb", glb("meshes", 0, "primitives", to=None), "mesh 0 has no primitives"),
    ("part.glb", glb(*PRIMITIVE, "indices", to=7), "it refers to accessors 7, but holds 2"),
    ("part.glb", glb(*PRIMITIVE, "mode", to=7), "primitive 0 of mesh 0 has mode 7, expected triangles (4)"),
    ("part.glb", glb(*PRIMITIVE, "mode", to=0), "it contains no faces (points and lines were ignored"),
    ("part.glb", glb(*PRIMITIVE, "attributes", to=None), "primitive 0 of mesh 0 has no attributes"),
    ("part.glb", glb(*PRIMITIVE, "extensions", to=5), "primitive 0 of mesh 0 has extensions that are not a"),
    ("part.glb", glb(*NODE, "children", to=[0]), "node 0 occurs in the scene twice, expected a tree"),
    ("part.glb", glb(*NODE, "scale", to=[1, 1]), "the scale of node 0 is not 3 finite numbers"),
    ("part.glb", glb(*NODE, "scale", to=[0, 0, 0]), "all of its parts have a scale of 0: 'cube'"),
    ("part.glb", glb(*NODE, "rotation", to=[0, 0, 0, 0]), "the rotation of node 0 is zero, expected a unit"),
    ("part.glb", glb(*NODE, "matrix", to=[1] * 16), "'cube': the last row of its matrix is [1.0, 1.0, 1.0"),
    ("part.glb", glb(*NODE, "mesh", to=10**400), f"the mesh of node 0: there is 1{'0' * 23}..., expected"),
    ("part.glb", glb("nodes", to={"a": 1}), "its JSON has nodes that are not a list"),
    ("part.glb", glb("scenes", 0, "nodes", to=[]), "it contains no faces (its scene places no"),
    ("part.glb", glb("extensionsRequired", to=["EXT_meshopt_compression"]), "its geometry is…unpack it by:"),
    ("part.glb", glb("extensionsUsed", to=["EXT_mesh_gpu_instancing"]), "its geometry is…export it without"),
    ("part.glb", glb("extensionsRequired", to=["ACME_curved"]), "it requires the extension 'ACME_curved'"),
    ("part.glb", two_corners(5), "primitive 0 of mesh 0 is a strip of 2 corners, expected at least 3"),
    ("part.glb", two_corners(6), "primitive 0 of mesh 0 is a fan of 2 corners, expected at least 3"),
    ("part.glb", without_scenes(children=[[]]), "the children of node 0: there is [], expected a whole"),
    # 3MF
    ("part.3mf", THREEMF[:-30], "its zip archive cannot be read (BadZipFile: "),
    ("part.3mf", ALTERED, "its zip archive cannot be read ("),
    ("part.3mf", mesh_files.threemf("<amf/>"), "its model file has no element model"),
    ("part.3mf", model('"millimeter"', '"parsec"'), "its unit is 'parsec', expected one of micron"),
    ("part.3mf", model('<item objectid="1"', '<item objectid="7"'), "an item refers to object '7'"),
    ("part.3mf", mesh_files.threemf(re.sub("<item[^>]*>", "", MODEL)), "its build has no items"),
    ("part.3mf", model('transform="1 ', 'transform="nan '), "'part1': it is placed by a matrix that is not"),
    ("part.3mf", mesh_files.threemf(MODEL[:-9]), "'3D/3dmodel.model' is not XML (unclosed token: line 1"),
    ("part.3mf", model("</resources>", "<!--" * 400_000), "'3D/3dmodel.model' is not XML"),
    ("part.3mf", model("<model", '<!DOCTYPE m [<!ENTITY a "a">]><model'), "'3D…document type (<!DOCTYPE>)"),
    ("part.3mf", model('x="1.0"', 'x="one"'), "line 1 of '3D/3dmodel.model': <vertex> cannot be read"),
    ("part.3mf", model('v3="5"', 'v3="8"'), "triangle 4 of 'part1' refers to vertices [0, 1, 8], but"),
    ("part.3mf", model('x="1.0"', ""), "line 1 of '3D/3dmodel.model': <vertex> has no x"),
    ("part.3mf", model("<triangles>", "<triangles/><triangles>"), "line 1 of '3D…has a second <triangles>"),
    ("part.3mf", model("<model ", '<model requiredextensions="b p" '), "it needs extensions…not read: 'b,"),
    ("part.3mf", model("<model ", BEAMS), "it needs extensions that are not read: 'beamlattice'"),
    ("part.3mf", mesh_files.threemf(mesh_files.threemf_model({1: (VERTICES, [])}, [ITEM])), "it contains no"),
    ("part.3mf", model("</resources>", NO_MESH, '<item objectid="1"', USED), "object '7' has no mesh and no"),
    ("part.3mf", model("</mesh>", BOTH), "object '1' has a mesh and components, expected one of the two"),
    ("part.3mf", model("</resources>", CYCLE), "object '2' is a component of itself, expected a tree"),
    ("part.3mf", model("</resources>", "<object id='1'/></resources>"), "object '1' of '3D…occurs twice"),
    ("part.3mf", spread_3mf(1, unit=' unit="inch"'), "'3D/3dmodel.model' is in mm, but '3D/part0.model' in"),
    ("part.3mf", spread_3mf(1, root=COMPONENTS.format(8, 1)), "a component refers to object '1', which is"),
    # counts beyond the limits
    ("part.obj", TRIANGLE + b"f " + b"1 2 3 " * 70_000, "line 4 (face 0) has 210000 corners…at most 20000"),
    ("part.off", PLENTY, "line 6…210000 corners"),
    ("part.obj", TRIANGLE + (b"f " + b"1 2 3 " * 6000 + b"\n") * 12, "its polygons of more…216000 together"),
    ("part.obj", TRIANGLE + PARTS, "it places 100000 parts"),
    # STEP
    ("part.step", STEP[:-10], "it does not end with END-ISO-10303-21: it is cut off"),
    ("part.step", swapped(STEP, b"ADVANCED_FACE", b"ADVANCED_FACX"), "its shells list 6 faces…mesh 5 only"),
    ("part.step", STEP.replace(b"CLOSED_SHELL", b"NO_SHELL"), "it contains no faces"),
    ("part.step", STEP[:2000] + STEP[-30:], "OpenCASCADE could not read all of it: ERR"),
    ("part.step", STEP + STEP, "it is several STEP files in one"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "data", "words"), CASES, ids=range(len(CASES)))
def test_file_is_refused_with_the_place_and_nothing_is_printed(tmp_path, capfd, name, data, words):
    assert says(refusal(write(tmp_path, name, data)), words)
    assert capfd.readouterr() == ("", "")


def test_what_is_no_file_is_said(tmp_path):
    assert refusal(tmp_path / "part.stl") == "there is no such file"
    (tmp_path / "part.stl").mkdir()
    assert refusal(tmp_path / "part.stl") == "it is a directory, expected a file"
    with pytest.raises(MeshError, match=r"^the path is empty, expected the name of a file$"):
        formats.read_geometries("")


@pytest.mark.parametrize(
    ("reason", "words"),
    [
        (PermissionError(13, "Permission denied"), "it cannot be opened (Permission denied)"),
        (MemoryError(), "there is not enough memory to read it"),
    ],
)
def test_file_that_may_not_or_cannot_be_read_is_said(tmp_path, monkeypatch, reason, words):
    def refuse(name):
        raise reason

    path = write(tmp_path, "part.stl", STL)
    monkeypatch.setattr(file_reader, "open_regular", refuse)
    assert refusal(path) == words


@pytest.mark.parametrize("reason", [TypeError("a\nb"), RecursionError()])
def test_what_no_reader_foresaw_is_one_sentence(tmp_path, monkeypatch, reason):
    def fail(source):
        raise reason

    monkeypatch.setitem(file_reader._READERS, "STL", fail)
    path = write(tmp_path, "part.stl", STL)
    assert refusal(path) == f"it cannot be read ({text_rows.in_one_line(reason)})"
    with pytest.raises(MeshFormatError) as caught:
        formats.read_geometries(path)
    assert caught.value.__cause__ is reason


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes of POSIX")
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("part.stl", proximity.load),
        ("part.prox", proximity.load),
        ("hand.csv", read_recording),
        ("run.frames", lambda path: list(FrameReader(path))),
        ("run.frames", FrameLog),
        ("scene.toml", read_scene_file),
    ],
)
def test_pipe_in_place_of_a_file_is_not_waited_for(tmp_path, name, read):
    os.mkfifo(tmp_path / name)
    with pytest.raises(ProximityError, match="is not a regular file"):
        read(tmp_path / name)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", "OpenCASCADE crashed on it (signal 11)"),
        (f"sys.exit({worker.TOO_MUCH})", "OpenCASCADE takes more than 600 s or 8 GB to mesh"),
        ("sys.exit(1)", "OpenCASCADE could not read all of it"),
    ],
)  # fmt: skip
@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_end_of_the_step_library_is_a_sentence(tmp_path, monkeypatch, code, words):
    script = write(tmp_path, "worker.py", f"import os, signal, sys; {code}".encode())
    monkeypatch.setattr(worker, "__file__", str(script))
    assert says(refusal(write(tmp_path, "part.step", STEP)), words)


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_missing_step_library_is_named_with_its_extra(tmp_path, monkeypatch):
    script = write(tmp_path, "worker.py", f"import sys; sys.exit({worker.NOT_INSTALLED})".encode())
    monkeypatch.setattr(worker, "__file__", str(script))

    with pytest.raises(
        MissingLibraryError, match=r"part\.step: STEP files need .*cascadio.*cad-proximity\[step\]"
    ):
        formats.read_geometries(write(tmp_path, "part.step", STEP))


@pytest.mark.parametrize("where", ["tempfile.TemporaryDirectory", "subprocess.Popen"])
def test_full_disk_on_the_way_to_the_step_library_is_said(tmp_path, monkeypatch, where):
    def fail(*arguments, **options):
        raise OSError(errno.ENOSPC, "No space left on device")

    path = write(tmp_path, "part.step", STEP)
    monkeypatch.setattr(f"proximity.formats.libraries.{where}", fail)
    assert refusal(path) == "OpenCASCADE cannot be handed it in a temporary folder (No space left on device)"


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
    used, stem = 36 if name.endswith("stl") else 8, name.split(".")[0]
    assert re.match(
        rf"vertex \d+ of '{stem}' is not finite: \(1.0, {value}, 0.0\); \d of the {used} vertices in use",
        message,
    )


def test_vertex_that_no_face_uses_may_be_anything(tmp_path):
    data = mesh_files.obj([*VERTICES, [np.nan] * 3], FACES)
    assert len(formats.read_geometries(write(tmp_path, "part.obj", data)).geometries[0].faces) == 12


def test_position_that_overflows_in_metres_is_not_finite(tmp_path):
    path = write(tmp_path, "part.obj", mesh_files.obj(VERTICES * 1e308, FACES))
    assert refusal(path, units="km").startswith("vertex 1 of 'part' is not finite: (1e+308, 0.0, 0.0)")


def write_gltf(path, uri):
    path.write_text(json.dumps({**GLTF, "buffers": [{**GLTF["buffers"][0], "uri": uri}]}))
    return path


@pytest.mark.parametrize(
    "uri",
    [
        *("../secret.bin", "inner/../../secret.bin", "%2e%2e/secret.bin", "link.bin"),
        *("/etc/passwd", "/dev/zero", "file:///etc/passwd"),
    ],
)
def test_buffer_outside_the_folder_is_not_read(tmp_path, uri):
    (tmp_path / "secret.bin").write_bytes(b"secret " * 100)
    folder = tmp_path / "parts"
    (folder / "inner").mkdir(parents=True)
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    words = f"buffer 0 is the file {uri!r}, which is not in the folder of this file or below: it is not read"
    assert refusal(write_gltf(folder / "part.gltf", uri)) == words


def test_buffer_below_the_folder_is_read_and_a_pipe_not_waited_for(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "mesh 1.bin").write_bytes(BLOB)
    path = write_gltf(tmp_path / "part.gltf", "data/mesh%201.bin")
    assert len(formats.read_geometries(path).geometries[0].faces) == 12
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.bin")
        assert "is not a regular file" in refusal(write_gltf(tmp_path / "part.gltf", "pipe.bin"))


def test_nodes_nested_deeply_are_followed_and_too_many_instances_refused(tmp_path):
    count = 20_000
    nodes = [{"children": [k + 1], "translation": [0, 0, 0.5]} for k in range(count)] + [{"mesh": 0}]
    deep = mesh_files.glb({**GLTF, "nodes": nodes, "scenes": [{"nodes": [0]}]}, BLOB)
    (geometry,) = formats.read_geometries(write(tmp_path, "part.glb", deep)).geometries
    assert geometry.pose.translation.tolist() == [0, 0, count / 2]
    header = {**GLTF, "nodes": [{"mesh": 0}] * 100_000, "scenes": [{"nodes": list(range(100_000))}]}
    path = write(tmp_path, "part.glb", mesh_files.glb(header, BLOB))
    assert refusal(path) == "it places 100000 parts, expected at most 20000"


def large_ply(vertex_count, face_count, scalar=b"binary_little_endian"):
    return mesh_files.ply_header(scalar.decode(), vertex_count, face_count, "float")


@pytest.mark.parametrize(
    ("name", "head", "words"),
    [
        ("part.stl", HEAD + (7).to_bytes(4, "little"), "its header says 7 faces: 434 bytes, but"),
        ("part.glb", b"glTF" + bytes([2, 0, 0, 0, 99, 0, 0, 0]), "its header says 99 bytes, but the file"),
        ("part.ply", large_ply(10**10, 9), "its header declares 10,000,000,009 rows of 120,000,000,009"),
        ("part.ply", large_ply(10, 9), "its header declares 19 rows of 129 bytes or more, but "),
        ("part.ply", large_ply(10, 9).replace(b"comment", b"author"), "line 3 of its header is 'author made"),
        ("part.obj", b"", "it is named like OBJ, a format of text, but holds zero bytes"),
        ("part.3mf", b"PK\3\4", "it has 10,600,000,000 bytes, expected at most 2,000,000,000 (unpacked_l"),
    ],
)
def test_large_file_whose_header_lies_is_refused_unread(tmp_path, name, head, words):
    path = write(tmp_path, name, head)
    os.truncate(path, 10_600_000_000)  # a sparse file
    assert says(refusal(path), words)


def test_four_billion_faces_are_not_allocated(tmp_path):
    path = write(tmp_path, "part.stl", HEAD + b"\xff" * 4 + bytes(100))
    tracemalloc.start()
    refusal(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e6


@pytest.fixture
def one_process(monkeypatch):
    """Run trimesh in one process for all files of a test; each import takes long."""
    opened = {}
    with ExitStack() as ends:

        def run(task, data, *, seconds, byte_count, **more):
            limits = task, seconds, byte_count
            if limits not in opened:
                opened[limits] = ends.enter_context(Library(*limits))
            return opened[limits].run(data, **more)

        monkeypatch.setattr(libraries, "run_library", run)
        yield


@pytest.mark.usefixtures("one_process")
@pytest.mark.parametrize("name", WHOLE)
def test_no_beginning_of_a_file_is_taken_for_the_whole(tmp_path, name):
    """For any truncation: refused, complete, or noted (OBJ has no counts)."""
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
    """Draw a file of any format with a few bytes changed, removed or inserted."""
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
            pieces = [b"-", b"9", b"\n", b" ", b"nan", b"1e999", b"\0\0\0\0", b"\xff\xff"]
            data[at:at] = draw(st.sampled_from(pieces))
        else:
            data[at:at] = data[at : at + 50]
    return name, bytes(data)


@pytest.mark.usefixtures("one_process")
@settings(
    max_examples=400,
    derandomize=True,
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
