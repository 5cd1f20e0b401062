"""glTF: scene graph, numbers and extensions, as written by other programs."""

import base64
import copy
import json
import subprocess
import sys
import urllib.parse

import mesh_files
import numpy as np
import pytest
import shapes
from mesh_reading import corners, volume, world, write
from mesh_reading import read as read_file
from mesh_reading import refusal as refusal_of

import proximity
from proximity import formats
from proximity.formats import worker
from proximity.formats.gltf import primitives
from proximity.formats.gltf.primitives import DRACO

VERTICES, FACES = shapes.cube()
DOCUMENT, BLOB = mesh_files.gltf_document([[(VERTICES, FACES)]], [{"mesh": 0, "name": "cube"}])


def read(tmp_path, header, blob=BLOB):
    return read_file(tmp_path, "part.glb", mesh_files.glb(header, blob))


def refusal(tmp_path, header, blob=BLOB):
    return refusal_of(write(tmp_path, "part.glb", mesh_files.glb(header, blob)))


def changed(**changes):
    return copy.deepcopy({**DOCUMENT, **changes})


def with_arrays(header, *arrays, blob=BLOB):
    """Append buffer views of arrays; return their indices and the new bytes."""
    views = header["bufferViews"]
    first = len(views)
    for array in arrays:
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(array.tobytes())})
        blob += array.tobytes()
    header["buffers"][0]["byteLength"] = len(blob)
    return range(first, len(views)), blob


PENTAGON = [[np.cos(0.4 * np.pi * k), np.sin(0.4 * np.pi * k), 0] for k in range(5)]
SQUARE = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]


@pytest.mark.parametrize(
    ("corners", "mode", "faces"),
    [(PENTAGON, 6, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]), (SQUARE, 5, [[0, 1, 2], [1, 3, 2]])],
    ids=["fan", "strip"],
)
def test_fan_and_strip_are_read_all_of_them_facing_one_way(tmp_path, corners, mode, faces):
    header, blob = mesh_files.gltf_document([[(corners, list(range(len(corners))))]], [{"mesh": 0}])
    header["meshes"][0]["primitives"][0]["mode"] = mode
    (geometry,) = read(tmp_path, header, blob).geometries
    assert sorted(sorted(face) for face in geometry.faces.tolist()) == sorted(map(sorted, faces))
    assert geometry.source_faces.tolist() == list(range(len(faces)))
    a, b, c = geometry.vertices[geometry.faces].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def with_entry(*path, to=None, document=None, **changes):
    """Return the document with one entry replaced, or removed for None, and other changes."""
    header, *blob = copy.deepcopy(document) if document else [changed(**changes)]
    entry = header
    for key in path[:-1]:
        entry = entry[key]
    if to is None:
        del entry[path[-1]]
    else:
        entry[path[-1]] = to
    return (header, *blob)


def with_points():
    """Return a document whose integers are written with a decimal point."""
    text = json.dumps(DOCUMENT)
    for entry in ("count", "byteLength", "byteOffset", "componentType", "bufferView", "POSITION", "mesh"):
        for value in (*range(200), 5125, 5126):
            text = text.replace(f'"{entry}": {value},', f'"{entry}": {value}.0,')
            text = text.replace(f'"{entry}": {value}}}', f'"{entry}": {value}.0}}')
    assert text.count(".0") > 12
    return (json.loads(text),)


def at_odd_bytes():
    header, blob = changed(), b"\1" + BLOB[:96] + b"\1\1" + BLOB[96:]
    header["bufferViews"][0] |= {"byteOffset": 0, "byteLength": 97}
    header["accessors"][0]["byteOffset"], header["bufferViews"][1]["byteOffset"] = 1, 99
    header["buffers"][0]["byteLength"] = len(blob)
    return header, blob


def sparse(rows, values, row_type=5121):
    return {
        "count": 2 if row_type == 5121 else 1,
        "indices": {"bufferView": rows, "componentType": row_type},
        "values": {"bufferView": values},
    }


def sparse_document(base_is_there=True):
    """Return the cube with two corners given by sparse values that replace wrong ones."""
    header = changed()
    moved = np.float32(VERTICES)
    moved[[3, 6]] = 9.0
    (rows, values), blob = with_arrays(
        header, np.array([3, 6], np.uint8), np.float32(VERTICES[[3, 6]]), blob=moved.tobytes() + BLOB[96:]
    )
    header["accessors"][0]["sparse"] = sparse(rows, values)
    if not base_is_there:
        del header["accessors"][0]["bufferView"]
    return header, blob


def quantised(component_type, dtype, is_normalized, unit):
    header = changed(
        nodes=[{"mesh": 0, "scale": [0.02 / (100 * unit)] * 3, "translation": [0.5, 0, 0]}],
        extensionsUsed=["KHR_mesh_quantization"],
        extensionsRequired=["KHR_mesh_quantization"],
    )
    stored = np.zeros((8, 4), dtype)  # rows of 4 or 8 bytes, as the extension requires
    stored[:, :3] = 100 * VERTICES
    (view,), blob = with_arrays(header, stored)
    header["bufferViews"][view]["byteStride"] = stored.strides[0]
    header["accessors"][0] |= {
        "bufferView": view, "componentType": component_type, "normalized": is_normalized, "min": [0, 0, 0],
        "max": [100, 100, 100],
    }  # fmt: skip
    return header, blob


def smallest_normalised():
    header = changed()
    (view,), blob = with_arrays(header, np.int8(-128 * VERTICES))
    header["accessors"][0] |= {"bufferView": view, "componentType": 5120, "normalized": True}
    return header, blob


def shift(*vector):
    matrix = np.eye(4)
    matrix[:3, 3] = vector
    return matrix


def skinned(matrices=None):
    """Return a skinned cube with a child, and two joints below a scaled armature."""
    nodes = [
        {"mesh": 0, "skin": 0, "translation": [0.3, 0, 0], "children": [1]},
        {"mesh": 0, "translation": [0, 0.2, 0]},
        {"scale": [0.01, 0.01, 0.01], "children": [3, 4]},
        *({"translation": joint} for joint in ([0, 0, 5], [1, 0, 0])),
    ]
    skin = {"joints": [3, 4]}
    header, blob = mesh_files.gltf_document([[(VERTICES, FACES)]], nodes, skins=[skin])
    header["scenes"] = [{"nodes": [0, 2]}]
    if matrices is not None:
        (view,), blob = with_arrays(header, np.array(matrices, "<f4").swapaxes(1, 2), blob=blob)
        accessor = {"type": "MAT4", "componentType": 5126, "count": len(matrices), "bufferView": view}
        header["accessors"].append(accessor)
        skin["inverseBindMatrices"] = len(header["accessors"]) - 1
    return header, blob


PUSH, LIFT = np.where(np.arange(8)[:, None] < 4, 0, [2.0, 0, 0]), np.full((8, 3), 0.5)


def morphed(mesh_weights=None, node_weights=None, targets=None):
    header = changed(nodes=[{"mesh": 0}, {"mesh": 0}], scenes=[{"nodes": [0, 1]}])
    views, blob = with_arrays(header, np.float32(PUSH), np.float32(LIFT))
    header["accessors"] += [
        {"bufferView": view, "componentType": 5126, "type": "VEC3", "count": 8} for view in views
    ]
    header["meshes"][0]["primitives"][0]["targets"] = targets or [{"POSITION": 2}, {"POSITION": 3}]
    if mesh_weights:
        header["meshes"][0]["weights"] = mesh_weights
    if node_weights:
        header["nodes"][1]["weights"] = node_weights
    return header, blob


def sparsely_morphed():
    """Return a cube morphed by a sparse target, one of zeros, and one of normals only."""
    header, blob = morphed([1, 1, 1], targets=[{"POSITION": 2}, {"POSITION": 3}, {"NORMAL": 3}])
    views, blob = with_arrays(header, np.uint16([7]), np.float32([0, 0, 4]), blob=blob)
    header["accessors"][2] = {
        "componentType": 5126,
        "type": "VEC3",
        "count": 8,
        "sparse": sparse(*views, 5123),
    }
    del header["accessors"][3]["bufferView"]
    return header, blob


def with_left_out():
    """Return a scene with animations, skins, morph targets, lines, and a second scene."""
    header, blob = mesh_files.gltf_document(
        [[(VERTICES, FACES), (VERTICES, FACES)]],
        [{"mesh": 0, "skin": 0, "children": [1]}, {"mesh": 0, "translation": [0, 0, 1]}],
        animations=[{}],
        skins=[{"joints": [0, 1]}],
    )
    header["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": 0}]
    header["meshes"][0]["primitives"][1]["mode"] = 1
    header["scenes"].append({"nodes": []})
    return header, blob


TEXT, HALF = base64.b64encode(BLOB).decode(), float(np.sqrt(0.5))
LINES = "\r\n".join(TEXT[k : k + 76] for k in range(0, len(TEXT), 76))
PRIMITIVE, SKIN = ("meshes", 0, "primitives", 0), [shift(2, 0, -5), shift(1, 0, 0)]
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
POSITIONS, WAYS = "accessor 0 (primitive 0 of mesh 0)", ": the positions were taken as they are"
SPARSE = f"the sparse part of {POSITIONS} "
AT_REST = "its skins were not applied, the meshes are in their rest position"
MORPHED = "its morph targets were applied with the weights of the file"
FLAT = {"mesh": 0, "scale": [1, 0, 3], "rotation": [HALF, 0, 0, HALF], "translation": [0, 0, 7]}
GONE = [{"name": "away", "scale": [0, 0, 0], "children": [1]}, {"mesh": 0, "name": "below"},
        {"mesh": 0, "name": "line", "scale": [0, 2, 0]}, {"mesh": 0, "name": "stays"}]  # fmt: skip
RAISED = with_entry("accessors", 0, "min", to=[0, 0, 0.5])
READ = {  # a document; vertices of the cubes in the world; notes
    "no scenes": (with_entry("scenes"), [VERTICES]),
    "rounded bounds": (with_entry("accessors", 0, "max", to=[1.00000002, 1.0, 0.9999999]), [VERTICES]),
    # Regression: extensions of shaders and quantised normals were refused as if they concerned positions.
    **{name: (with_entry("extensionsUsed", to=[name], extensionsRequired=[name]), [VERTICES])
       for name in ("KHR_technique_webgl", "KHR_techniques_webgl", "KHR_mesh_quantization")},
    "meshopt offered": (with_entry("extensionsUsed", to=[MESHOPT[0]]), [VERTICES]),
    "Draco offered": (
        with_entry(*PRIMITIVE, "extensions", to={DRACO: {"bufferView": 99}}, extensionsUsed=[DRACO]),
        [VERTICES]),
    "whole numbers with a point": (with_points(), [VERTICES]),
    "arrays at odd bytes": (at_odd_bytes(), [VERTICES]),
    **{f"data URI, {how}": (with_entry("buffers", 0, "uri", to=uri), [VERTICES]) for how, uri in {
        "no padding": "data:;base64," + TEXT.rstrip("="),
        "lines": "data:application/octet-stream;base64," + LINES,
        "percent-encoded": "data:application/gltf-buffer;base64," + urllib.parse.quote(LINES, safe=""),
        "capitals": "DATA:application/octet-stream;charset=binary;BASE64," + TEXT,
        "no base64": "data:application/octet-stream," + urllib.parse.quote_from_bytes(BLOB)}.items()},
    "sparse positions replace those below": (sparse_document(), [VERTICES]),
    "sparse positions among zeros": (
        sparse_document(False), [VERTICES * np.isin(np.arange(8), (3, 6))[:, None]]),
    **{f"quantised positions, {kind} {is_normalized}": (
           quantised(component_type, kind, is_normalized, unit), [0.02 * VERTICES + (0.5, 0, 0)])
       for component_type, kind, is_normalized, unit in (
           (5120, "i1", False, 1.0), (5121, "u1", False, 1.0), (5122, "<i2", True, 1 / 32767),
           (5123, "<u2", True, 1 / 65535), (5120, "i1", True, 1 / 127))},
    "smallest normalised number": (smallest_normalised(), [-VERTICES]),
    # Regression: wrong bounds were refused. Other programs ignore them and read the data.
    "wrong bounds": (
        with_entry("accessors", 0, "max", to=[9, 1, 1], document=RAISED), [VERTICES],
        f"{POSITIONS} says that its min is (0, 0, 0.5), but it is (0, 0, 0) (and 1 more){WAYS}"),
    "bounds that are no numbers": (
        with_entry("accessors", 0, "min", to=[None] * 3), [VERTICES],
        f"{POSITIONS} has a min that is not 3 finite numbers{WAYS}"),
    "several scenes without a default": (
        with_entry("scene", scenes=[{"nodes": [0]}, {"nodes": []}]), [VERTICES],
        "it holds several scenes and names no default: the first was read"),
    "skin that is placed by its joints and not by its node": (
        skinned(SKIN), [0.01 * (VERTICES + np.array([2, 0, 0])), VERTICES + np.array([0.3, 0.2, 0])]),
    "skin that its joints bend stays straight": (
        skinned(), [0.01 * (VERTICES + np.array([0, 0, 5])), VERTICES + np.array([0.3, 0.2, 0])], AT_REST),
    "morph targets with the weights of mesh and node": (
        morphed([1, 0], [0.5, 1]), [VERTICES + PUSH, VERTICES + 0.5 * PUSH + 0.5], MORPHED),
    "morph target that is sparse, nothing or of normals only": (
        sparsely_morphed(), [VERTICES + np.where(np.arange(8) == 7, 4, 0)[:, None] * [0, 0, 1]] * 2, MORPHED),
    "nodes scaled to nothing": (
        with_entry("nodes", to=GONE, scenes=[{"nodes": [0, 2, 3]}]), [VERTICES],
        "left out, as the file scales them by 0: 'below', 'line'"),
    "node that is flattened to a sheet": (
        with_entry("nodes", to=[FLAT, {"mesh": 0, "name": "solid"}], scenes=[{"nodes": [0, 1]}]),
        [VERTICES[:, [0, 2, 1]] * [1, -3, 0] + [0, 0, 7], VERTICES],
        "flattened to a sheet by a scale of 0 in the file: node 0"),
    "what is left out of a scene": (
        with_left_out(), [VERTICES, np.add(VERTICES, [0, 0, 1])],
        "points and lines were ignored: they enclose no volume",
        "it holds several scenes, the default one was read", "its animations were not applied",
        "its morph targets were not applied, the meshes are in their basic shape", AT_REST),
}  # fmt: skip
UNPACKED = "which is not supported; export it without, or unpack it by: gltfpack -noq -kn"
REFUSED = [  # a document, and the start of its error message
    *((with_entry("accessors", 0, *path, to=to, document=sparse_document()), SPARSE + words)
      for path, to, words in (
          (("sparse", "count"), 3, "has 3 entries, which do not"),
          (("sparse", "count"), 10**15, "has 1000000000000000"),
          (("sparse", "indices", "componentType"), 5126, "has"),
          (("sparse", "values"), 7, "has no indices or no values"),
          (("count",), 6, "replaces entry 6, but there are 6"))),
    (with_entry("accessors", 0, "sparse", "values", "bufferView", document=sparse_document()),
     "the buffer view of " + SPARSE.strip()),
    (with_entry("accessors", 0, "count", to=10**12, document=sparse_document(False)),
     f"{POSITIONS} has 1000000000000 entries, but no buffer vi"),
    (skinned([np.eye(4)]), "skin 0 has 2 joints, but 1 matrices"),
    (morphed([1, 0, 1]), "primitive 0 of mesh 0 has 2 morph targets, but 3 weights"),
    (morphed([1, 0], targets=[{"POSITION": 9}]), "it refers to accessors 9, but holds 4"),
    (morphed([1], targets=[{"POSITION": 1}]),
     "accessor 1 (a morph target of primitive 0 of mesh 0) has type 'SCALAR' of"),
    (morphed(["much"]), "the weights of node 0 is not 1 finite numbers"),
    (with_entry("accessors", 2, "count", to=7, document=morphed([1, 0])),
     "a morph target of primitive 0 of mesh 0 moves 7 vertices, but there are 8"),
    # By name, and not because of its empty buffer.
    *((with_entry("buffers", extensionsUsed=[name],
                  to=[*DOCUMENT["buffers"], {"byteLength": 9, "extensions": {name: {"fallback": True}}}]),
       f"its geometry is stored by {name}, {UNPACKED}") for name in MESHOPT),
]  # fmt: skip


@pytest.mark.parametrize(("surface_count", "face_count"), [(1, 5), (2, len(FACES))])
def test_cad_faces_that_fit_no_triangles_are_unknown_and_noted(tmp_path, surface_count, face_count):
    # Regression: "names the CAD faces of 5 triangles, but there are 12", and the file was refused.
    surfaces = [(VERTICES, FACES)] * surface_count
    header, blob = mesh_files.gltf_document([surfaces], [{"mesh": 0, "name": "lid"}])
    (view,), blob = with_arrays(header, np.arange(face_count, dtype="<u4"), blob=blob)
    accessor = {"type": "SCALAR", "componentType": 5125, "count": face_count, "bufferView": view}
    header["accessors"].append(accessor)
    faces = {"faceIndices": len(header["accessors"]) - 1}
    header["meshes"][0]["primitives"][0]["extensions"] = {"TM_brep_faces": faces}
    contents = read(tmp_path, header, blob)
    (part,) = contents.geometries
    assert len(part.faces) == len(FACES) * surface_count and set(part.source_faces.tolist()) == {-1}
    assert contents.notes == ("the numbers of the CAD faces of 'lid' are unknown",)


ROUNDED = {
    "quantised positions, i1 True",
    "skin that its joints bend stays straight",
    "node that is flattened to a sheet",
}
"""Documents whose numbers are multiplied; in the others the bits stay the same."""


@pytest.mark.parametrize("name", READ)
def test_document_is_read_as_it_is_meant_and_what_was_passed_over_is_said(tmp_path, name):
    document, expected, *notes = READ[name]
    contents = read(tmp_path, *document)
    for geometry, vertices in zip(contents.geometries, expected, strict=True):
        off = np.abs(corners(geometry) - vertices[FACES]).max()
        assert off <= (1e-12 if name in ROUNDED else 0.0), geometry.name
    assert [note for note in contents.notes if not note.endswith("they are numbered")] == notes


@pytest.mark.parametrize(("document", "words"), REFUSED, ids=[words[-40:] for _, words in REFUSED])
def test_document_that_does_not_fit_together_is_refused(tmp_path, document, words):
    assert refusal(tmp_path, *document).startswith(words)


@pytest.mark.parametrize("has_indices", [True, False])
def test_primitives_of_a_mesh_are_one_body_with_indices_or_corners_three_by_three(tmp_path, has_indices):
    pieces = [(SHIFTED, FACES[:6]), (SHIFTED, FACES[6:])]
    if not has_indices:
        pieces = [(SHIFTED[FACES.ravel()], FACES), (SHIFTED, [])]
    header, blob = mesh_files.gltf_document([pieces], [{"mesh": 0}])
    if not has_indices:
        del header["meshes"][0]["primitives"][0]["indices"]
    (geometry,) = read(tmp_path, header, blob).geometries
    assert geometry.source_faces.tolist() == list(range(12))
    assert volume(geometry) == pytest.approx(1.0, rel=1e-6)
    assert has_indices or np.array_equal(geometry.faces, np.arange(36).reshape(12, 3))


# The scene

SHIFTED = VERTICES + 0.1  # not a binary fraction: rounding to single precision would show


def gltf_nodes_of_a_gripper():
    quarter = [0.0, 0.0, float(np.sqrt(0.5)), float(np.sqrt(0.5))]
    return [
        {"name": "arm", "translation": [10, 0, 0], "rotation": quarter, "children": [1, 2]},
        {"name": "jaw", "mesh": 0, "translation": [1, 0, 0]},
        {"name": "jaw", "mesh": 0, "translation": [-1, 0, 0]},
        {"mesh": 0},
    ]


@pytest.mark.parametrize("name", ["robot.glb", "robot.gltf", "apart.gltf"])
def test_scene_graph_keeps_names_and_poses_and_is_in_metres(tmp_path, name):
    header, blob = mesh_files.gltf_document([[(SHIFTED, FACES)]], gltf_nodes_of_a_gripper())
    if name == "robot.gltf":
        header["buffers"][0]["uri"] = (
            "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
        )
    elif name == "apart.gltf":
        header["buffers"][0]["uri"] = "the%20buffer.bin"
        (tmp_path / "the buffer.bin").write_bytes(blob)
    data = mesh_files.glb(header, blob) if name.endswith("glb") else json.dumps(header).encode()
    contents = read_file(tmp_path, name, data, units="in")
    assert (contents.units, contents.units_declared) == ("m", True)
    first, second, third = contents.geometries
    assert [first.name, second.name, third.name] == ["jaw", "jaw_2", name.split(".")[0]]
    assert contents.notes == ("2 of its meshes are called 'jaw'; from the second on they are numbered",)
    assert np.allclose(
        first.pose.matrix, [[0, -1, 0, 10], [1, 0, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-15
    )
    assert np.allclose(second.pose.translation, [10, -1, 0], atol=1e-15) and third.pose.is_identity
    assert np.array_equal(first.vertices, np.float32(SHIFTED).astype(np.float64))


def test_instances_of_one_mesh_share_their_arrays(tmp_path):
    document = mesh_files.gltf_document([[(SHIFTED, FACES)]], gltf_nodes_of_a_gripper())
    contents = read_file(tmp_path, "robot.glb", mesh_files.glb(*document) + b"\0\0")
    first, second, third = contents.geometries
    assert contents.notes[0] == "2 bytes after its end were ignored"
    assert first.vertices is second.vertices is third.vertices and first.faces is third.faces


@pytest.mark.parametrize(
    "node",
    [
        {"scale": [0.5, 0.5, 0.5], "translation": [1, 2, 3]},
        {"scale": [1, 2, 3], "rotation": [0.5, 0.5, 0.5, 0.5]},
        {"scale": [-1, 1, 1]},
        {"scale": [-2, -2, -2], "translation": [0, 0, 1]},
        {"matrix": [1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 7, 0, 0, 1]},
    ],
    ids=["scale", "uneven scale", "mirror", "point mirror", "shear"],
)
def test_what_is_not_rigid_goes_into_the_vertices(tmp_path, node):
    """World positions match the file; the pose is rigid, and faces point outward."""
    document = mesh_files.gltf_document([[(SHIFTED, FACES)]], [{"mesh": 0, **node}])
    (geometry,) = read_file(tmp_path, "part.glb", mesh_files.glb(*document)).geometries
    matrix = np.eye(4)
    if "matrix" in node:
        matrix = np.reshape(node["matrix"], (4, 4)).T
    else:
        turn = np.eye(3)[[2, 0, 1]] if "rotation" in node else np.eye(3)
        matrix[:3, :3] = turn * node["scale"]
        matrix[:3, 3] = node.get("translation", 0)
    points = np.float32(SHIFTED).astype(np.float64)
    assert np.allclose(world(geometry), points @ matrix[:3, :3].T + matrix[:3, 3], rtol=1e-14, atol=1e-14)
    assert volume(geometry) == pytest.approx(abs(np.linalg.det(matrix[:3, :3])), rel=1e-6)


def test_rotation_in_single_precision_is_rigid_and_changes_no_vertex(tmp_path):
    angle = 0.3
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    document = mesh_files.gltf_document(
        [[(SHIFTED, FACES)]], [{"mesh": 0, "matrix": [float(x) for x in np.float32(turn.T).ravel()]}]
    )
    (geometry,) = read_file(tmp_path, "part.glb", mesh_files.glb(*document)).geometries
    assert np.array_equal(geometry.vertices, np.float32(SHIFTED).astype(np.float64))
    assert np.allclose(geometry.pose.rotation, turn[:3, :3], atol=1e-7)


def test_ground_plane_without_thickness_can_be_touched(tmp_path):
    square = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]])
    nodes = [{"mesh": 0, "scale": [2, 0, 2]}]
    path = tmp_path / "ground.glb"
    path.write_bytes(mesh_files.glb(*mesh_files.gltf_document([[(square, [[0, 2, 1], [1, 2, 3]])]], nodes)))
    assert proximity.load(path).closest([1.0, 0.25, 1.0]).signed_distance == pytest.approx(0.25)


def invisible(is_visible=False):
    return {"KHR_node_visibility": {"visible": is_visible}}


@pytest.mark.processes
def test_hidden_node_is_a_hidden_part_and_so_is_all_below_it(tmp_path):
    nodes = [
        {"name": "group", "extensions": invisible(), "children": [1]},
        {"name": "lid", "mesh": 0, "extensions": invisible(True), "translation": [5, 0, 0]},
        {"name": "box", "mesh": 0, "extensions": invisible(True)},
    ]
    header = changed(
        nodes=nodes,
        scenes=[{"nodes": [0, 2]}],
        extensionsUsed=["KHR_node_visibility"],
        extensionsRequired=["KHR_node_visibility"],
    )
    path = tmp_path / "part.glb"
    path.write_bytes(mesh_files.glb(header, BLOB))
    scene = proximity.load(path)
    assert [(part.name, part.is_hidden) for part in scene.parts] == [("lid", True), ("box", False)]
    assert "hidden in the file, and so in the scene: 'lid'" in scene.report.notes
    above_lid = [5.5, 0.5, 1.25]
    assert scene.signed_distance(above_lid) > 4
    scene.show("lid")
    assert scene.signed_distance(above_lid) == pytest.approx(0.25)
    checked = subprocess.run(
        [sys.executable, "-m", "proximity", "check", path], capture_output=True, text=True, check=True
    )
    assert "hidden in the file, and so in the scene: 'lid'" in checked.stdout


def test_hidden_part_stays_hidden_when_its_name_is_given_twice(tmp_path):
    two = np.concatenate([VERTICES, VERTICES + 3])
    faces = np.concatenate([FACES, FACES + 8])
    nodes = [
        {"mesh": 0, "name": "a", "extensions": invisible()},
        {"mesh": 0, "name": "a.1", "extensions": invisible()},
    ]
    path = tmp_path / "part.glb"
    path.write_bytes(mesh_files.glb(*mesh_files.gltf_document([[(two, faces)]], nodes)))
    parts = proximity.load(path).parts
    assert len(parts) == 4 and len({part.name for part in parts}) == 4
    assert all(part.is_hidden for part in parts)


def test_morph_weight_beyond_all_numbers_is_refused_without_a_warning(tmp_path):
    path = tmp_path / "part.glb"
    path.write_bytes(mesh_files.glb(*morphed([1.7e308, 0])))
    with pytest.raises(proximity.MeshError, match=r"vertex 4 of 'part' is not finite: \(inf, "):
        formats.read_geometries(path)


@pytest.mark.processes
def test_draco_stream_that_is_damaged_or_holds_no_positions_is_refused(tmp_path):
    stream = draco_stream()
    message = "its geometry stored by KHR_draco_mesh_compression cannot be unpacked ("
    for damaged in (b"DRACO", stream[: len(stream) // 2], b"\0" * 100):
        assert refusal(tmp_path, *packed_document(damaged)).startswith(message)
    assert refusal(tmp_path, *packed_document(stream, position_id=5)).startswith(message)
    pairs = draco_stream(generic_attributes={5: np.zeros((8, 2), np.float32)})
    assert refusal(tmp_path, *packed_document(pairs, position_id=5)) == (
        "its positions stored by KHR_draco_mesh_compression are not 3 numbers each"
    )


def packed_document(stream, position_id=0):
    header = changed(extensionsUsed=[DRACO], extensionsRequired=[DRACO])
    for accessor in header["accessors"]:
        del accessor["bufferView"]
    (view,), blob = with_arrays(header, np.frombuffer(stream, np.uint8), blob=b"")
    header["bufferViews"] = header["bufferViews"][view:]
    header["meshes"][0]["primitives"][0]["extensions"] = {
        DRACO: {"bufferView": 0, "attributes": {"POSITION": position_id}}
    }
    return header, blob


def draco_stream(**options):
    packer = pytest.importorskip("DracoPy")
    return packer.encode(np.float32(VERTICES), np.uint32(FACES), quantization_bits=10, **options)


@pytest.mark.processes
@pytest.mark.parametrize("options", [{}, {"preserve_order": True}, {"compression_level": 10}])
def test_geometry_packed_by_draco_is_read(tmp_path, options):
    header, blob = packed_document(draco_stream(**options))
    header["nodes"] = [{"mesh": 0, "name": "a"}, {"mesh": 0, "name": "b", "translation": [2, 0, 0]}]
    header["scenes"] = [{"nodes": [0, 1]}]
    path = tmp_path / "part.glb"
    path.write_bytes(mesh_files.glb(header, blob))
    scene = proximity.load(path)
    assert [part.solid.mesh.face_count for part in scene.parts] == [12, 12]
    assert np.allclose(scene.bounds, [[0, 0, 0], [3, 1, 1]], atol=1e-6)
    assert scene.signed_distance([2.5, 0.5, 0.5]) == pytest.approx(-0.5, abs=1e-3)


@pytest.mark.processes
@pytest.mark.parametrize(("name", "value"), [("_DRACO_SECONDS", 0), ("_DRACO_BYTES", 1 << 20)])
@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory")
def test_draco_stream_that_takes_too_much_is_refused(tmp_path, monkeypatch, name, value):
    stream = draco_stream()
    monkeypatch.setattr(primitives, name, value)
    assert "cannot be unpacked (it takes more than " in refusal(tmp_path, *packed_document(stream))


@pytest.mark.processes
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_crash_of_the_draco_decoder_is_a_sentence(tmp_path, monkeypatch):
    pytest.importorskip("DracoPy")
    (tmp_path / "worker.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    monkeypatch.setattr(worker, "__file__", str(tmp_path / "worker.py"))
    assert "(the decoder crashed, signal 11)" in refusal(tmp_path, *packed_document(b"DRACO"))


@pytest.mark.processes
@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory")
def test_draco_stream_that_claims_a_billion_faces_is_refused(tmp_path):
    draco_stream()  # skips without the decoder
    # A sequential mesh: face and vertex counts in seven bits per byte.
    claimed = b"DRACO\2\2\1\0\0\0" + b"\x80\x94\xeb\xdc\x03" * 2 + b"\1" + b"\0" * 4000
    assert "cannot be unpacked (" in refusal(tmp_path, *packed_document(claimed))


def test_draco_without_its_decoder_is_refused_before_buffers_with_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    header, blob = packed_document(b"")
    header["buffers"] = [{"byteLength": 10, "uri": "not there.bin"}]
    words = r"part.glb: geometry stored by KHR_draco_mesh_compression needs DracoPy, which is not installed: "
    with pytest.raises(proximity.MissingLibraryError, match=words + r'pip install "cad-proximity\[gltf\]"'):
        read(tmp_path, header, blob)
