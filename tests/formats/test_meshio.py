"""Whole files: every number arrives, in metres, at its place, under its name."""

import base64
import io
import json
import zipfile

import mesh_files
import numpy as np
import pytest
import shapes
import step_text

from proximity import formats
from proximity.errors import ArgumentError, MeshError

VERTICES, FACES = shapes.cube()
SQUARES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
# 0.1 is no binary fraction: single precision in the way would show
VERTICES = VERTICES + 0.1

POLYGON_FORMATS = {
    "off": mesh_files.off,
    "obj": mesh_files.obj,
    "ply": mesh_files.ply_ascii,
    "little.ply": mesh_files.ply_binary,
    "big.ply": lambda vertices, polygons: mesh_files.ply_binary(vertices, polygons, ">"),
}
ALL_FORMATS = {
    **POLYGON_FORMATS,
    "ascii.stl": mesh_files.stl_ascii,
    "binary.stl": mesh_files.stl_binary,
}
IDENTITY_3MF = "1 0 0 0 1 0 0 0 1 0 0 0"


def read(tmp_path, name, data, **options):
    path = tmp_path / name
    path.write_bytes(data)
    return formats.read_geometries(path, **options)


def volume(geometry):
    a, b, c = geometry.vertices[geometry.faces].transpose(1, 0, 2)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0


def world(geometry):
    return geometry.pose.point(geometry.vertices)


@pytest.mark.parametrize("name", ALL_FORMATS)
def test_triangles_come_in_the_order_of_the_file_and_in_double_precision(tmp_path, name):
    contents = read(tmp_path, f"part.{name}", ALL_FORMATS[name](VERTICES, FACES), units="m")
    (geometry,) = contents.geometries
    expected = np.float32(VERTICES).astype(np.float64) if name == "binary.stl" else VERTICES
    assert np.array_equal(geometry.vertices[geometry.faces], expected[FACES])
    assert geometry.vertices.dtype == np.float64 and geometry.faces.dtype == np.int64
    assert np.array_equal(geometry.source_faces, np.arange(12)) and geometry.source_faces.dtype == np.int32
    assert geometry.pose.is_identity
    assert geometry.name == f"part.{name}".rpartition(".")[0]


@pytest.mark.parametrize("name", ALL_FORMATS)
def test_file_without_units_is_read_in_those_of_the_caller(tmp_path, name):
    data = ALL_FORMATS[name](VERTICES.round(), FACES)
    name = f"part.{name}"
    inches, default = read(tmp_path, name, data, units="in"), read(tmp_path, name, data)
    assert (inches.units, inches.units_declared) == ("in", False)
    assert (default.units, default.units_declared) == ("mm", False)
    assert inches.geometries[0].vertices.max() == 0.0254
    assert default.geometries[0].vertices.max() == 0.001


@pytest.mark.parametrize("name", POLYGON_FORMATS)
def test_polygons_become_triangles_that_know_their_polygon(tmp_path, name):
    polygons = [*SQUARES[:5], FACES[-2], FACES[-1]]  # of both sizes
    contents = read(tmp_path, f"part.{name}", POLYGON_FORMATS[name](VERTICES, polygons), units="m")
    (geometry,) = contents.geometries
    assert geometry.source_faces.tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 6]
    assert volume(geometry) == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize("name", POLYGON_FORMATS)
def test_trimesh_reads_the_same_from_whole_files(tmp_path, name):
    import trimesh

    path = tmp_path / f"part.{name}"
    path.write_bytes(POLYGON_FORMATS[name](VERTICES, FACES))
    ours = formats.read_geometries(path, units="m").geometries[0]
    theirs = trimesh.load_mesh(path, process=False, maintain_order=True)
    assert np.allclose(
        ours.vertices[ours.faces], theirs.triangles, rtol=1e-6
    )  # it keeps floats of PLY single


# STL


def test_binary_stl_whose_header_says_solid_is_binary(tmp_path):
    contents = read(tmp_path, "part.stl", mesh_files.stl_binary(VERTICES, FACES, header=b"solid part"))
    assert contents.format == "STL binary" and len(contents.geometries[0].faces) == 12


def test_stl_padded_by_less_than_a_face_is_read_and_it_is_said(tmp_path):
    contents = read(tmp_path, "part.stl", mesh_files.stl_binary(VERTICES, FACES) + b"\0" * 49)
    assert contents.notes == ("49 bytes after the last face were ignored",)


def test_solids_of_one_ascii_stl_keep_their_names_and_count_faces_through(tmp_path):
    data = mesh_files.stl_ascii(VERTICES, FACES, "Left Lid") + mesh_files.stl_ascii(
        VERTICES, FACES[:2], "vertex"
    )
    left, right = read(tmp_path, "part.stl", data, units="m").geometries
    assert (left.name, right.name) == ("Left Lid", "vertex")
    assert right.source_faces.tolist() == [12, 13]


def test_ascii_stl_may_be_written_in_capitals_on_any_system(tmp_path):
    data = mesh_files.stl_ascii(VERTICES, FACES).upper().replace(b"\n", b"\r\n")
    data = data.replace(b"NORMAL 0 0 0", b"NORMAL -nan(ind) 1.#QNAN 0")
    (geometry,) = read(tmp_path, "part.stl", data, units="m").geometries
    assert np.array_equal(geometry.vertices[geometry.faces], VERTICES[FACES])


# OBJ


def test_obj_relative_references_count_back_from_the_face(tmp_path):
    text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nf -4 -1 -3\n"
    (geometry,) = read(tmp_path, "part.obj", text).geometries
    assert geometry.faces.tolist() == [[0, 1, 2], [0, 3, 1]]


def test_obj_textures_normals_colours_and_continued_lines_do_no_harm(tmp_path):
    text = (
        b"# made for a test\nmtllib none.mtl\nv 0 0 0 1 0 0\n\tv 1 0 0 # a comment\nv 0 1 0 1.0\nvt 0 0\n"
        b"vn 0 0 1\nusemtl red\ns off\nf 1/1/1 2//1 \\\n 3/1 # a comment\n"
    )
    (geometry,) = read(tmp_path, "part.obj", text).geometries
    assert geometry.faces.tolist() == [[0, 1, 2]] and geometry.vertices.tolist()[1] == [0.001, 0, 0]


def test_obj_materials_do_not_tear_a_body_apart(tmp_path):
    whole = mesh_files.obj(VERTICES, FACES).decode().splitlines()
    text = "\n".join([*whole[:10], "usemtl a", *whole[10:14], "usemtl b", *whole[14:], ""])
    (geometry,) = read(tmp_path, "part.obj", text.encode(), units="m").geometries
    assert np.array_equal(geometry.faces, FACES)


def test_obj_objects_are_geometries_of_their_own(tmp_path):
    text = "o Lid\nv 0 0 0\nv 1 0 0\nv 0 1 0\no Größe\nv 0 0 5\nv 1 0 5\nv 0 1 5\nf 4 5 6\no Lid\nf 1 2 3\n"
    lid, other = read(tmp_path, "part.obj", text.encode(), units="m").geometries
    assert (lid.name, other.name) == ("Lid", "Größe")
    assert lid.source_faces.tolist() == [1] and other.source_faces.tolist() == [0]
    assert other.vertices.tolist() == [[0, 0, 5], [1, 0, 5], [0, 1, 5]] and other.faces.tolist() == [
        [0, 1, 2]
    ]


@pytest.mark.parametrize("line", ["# from C:\\parts\\", "o C:\\", "f 3 2 1 # a\\"])
def test_backslash_behind_a_comment_or_a_name_swallows_no_line(tmp_path, line):
    text = f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{line}\nf 1 2 3\n"
    (geometry,) = read(tmp_path, "part.obj", text.encode()).geometries
    assert geometry.faces.tolist()[-1] == [0, 1, 2]


def test_obj_names_may_hold_a_number_sign(tmp_path):
    text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\no part#1\nf 1 2 3\no part#2 # a comment\nf 3 2 1\n"
    contents = read(tmp_path, "part.obj", text)
    assert [geometry.name for geometry in contents.geometries] == ["part#1", "part#2"]


def test_obj_lines_are_left_out_and_a_missing_end_is_said(tmp_path):
    contents = read(tmp_path, "part.obj", mesh_files.obj(VERTICES, FACES) + b"l 1 2")
    assert contents.notes == (
        "its points and lines were ignored: they enclose nothing",
        "its last line has no end: it may have been cut off",
    )


# OFF and PLY


def test_off_may_have_comments_colours_and_its_counts_on_the_first_line(tmp_path):
    text = (
        b"# a box\nCOFF 3 1 0 # counts\n\n0 0 0 9 9 9 1\n1 0 0 9 9 9 1\n0 1 0 9 9 9 1\n3 0 1 2 0.5 0.5 0.5\n"
    )
    (geometry,) = read(tmp_path, "part.off", text).geometries
    assert geometry.faces.tolist() == [[0, 1, 2]]


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


@pytest.mark.parametrize("line_end", [b"\n", b" \r\n"])
def test_ply_header_ends_with_a_line_of_its_own_only(tmp_path, line_end):
    # Was: "its header declares no vertices".
    data = mesh_files.ply_binary(VERTICES, FACES)
    data = data.replace(b"element vertex", b"comment end_header comes later\nelement vertex")
    data = data.replace(b"\nend_header\n", b"\nend_header" + line_end)
    assert len(read(tmp_path, "part.ply", data).geometries[0].faces) == 12


def test_ply_element_without_rows_takes_no_room(tmp_path):
    data = mesh_files.ply_binary(VERTICES, FACES)
    data = data.replace(b"element face", b"element strip 0\nproperty list int int s\nelement face")
    assert len(read(tmp_path, "part.ply", data).geometries[0].faces) == 12


def test_name_given_by_number_does_not_meet_one_of_the_file(tmp_path):
    data = b"".join(mesh_files.stl_ascii(VERTICES, FACES, name) for name in ("a", "a_2", "a", "a"))
    names = [geometry.name for geometry in read(tmp_path, "part.stl", data).geometries]
    assert names == ["a", "a_2", "a_3", "a_4"]


# glTF


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
    header, blob = mesh_files.gltf_document([[(VERTICES, FACES)]], gltf_nodes_of_a_gripper())
    if name == "robot.gltf":
        header["buffers"][0]["uri"] = (
            "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
        )
    elif name == "apart.gltf":
        header["buffers"][0]["uri"] = "the%20buffer.bin"
        (tmp_path / "the buffer.bin").write_bytes(blob)
    data = mesh_files.glb(header, blob) if name.endswith("glb") else json.dumps(header).encode()
    contents = read(tmp_path, name, data, units="in")
    assert (contents.units, contents.units_declared) == ("m", True)
    first, second, third = contents.geometries
    assert [first.name, second.name, third.name] == ["jaw", "jaw_2", name.split(".")[0]]
    assert contents.notes == ("2 of its meshes are called 'jaw'; from the second on they are numbered",)
    assert np.allclose(
        first.pose.matrix, [[0, -1, 0, 10], [1, 0, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-15
    )
    assert np.allclose(second.pose.translation, [10, -1, 0], atol=1e-15) and third.pose.is_identity
    assert np.array_equal(first.vertices, np.float32(VERTICES).astype(np.float64))


def test_instances_of_one_mesh_share_their_arrays(tmp_path):
    document = mesh_files.gltf_document([[(VERTICES, FACES)]], gltf_nodes_of_a_gripper())
    first, second, third = read(tmp_path, "robot.glb", mesh_files.glb(*document)).geometries
    assert first.vertices is second.vertices is third.vertices and first.faces is third.faces


def test_primitives_of_a_mesh_are_one_body(tmp_path):
    document = mesh_files.gltf_document([[(VERTICES, FACES[:6]), (VERTICES, FACES[6:])]], [{"mesh": 0}])
    (geometry,) = read(tmp_path, "part.glb", mesh_files.glb(*document)).geometries
    assert geometry.source_faces.tolist() == list(range(12))
    assert volume(geometry) == pytest.approx(1.0, rel=1e-6)


def test_quantised_normals_do_no_harm(tmp_path):
    # Was: refused, as if the positions were.
    document = mesh_files.gltf_document(
        [[(VERTICES, FACES)]], [{"mesh": 0}], extensionsRequired=["KHR_mesh_quantization"]
    )
    assert len(read(tmp_path, "part.glb", mesh_files.glb(*document)).geometries[0].faces) == 12


def test_what_is_left_out_of_a_scene_is_said(tmp_path):
    header, blob = mesh_files.gltf_document(
        [[(VERTICES, FACES), (VERTICES, FACES)]],
        [{"mesh": 0, "skin": 0}, {"mesh": 0}],
        animations=[{}],
        skins=[{}],
    )
    header["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": 0}]
    header["meshes"][0]["primitives"][1]["mode"] = 1
    header["scenes"].append({"nodes": []})
    contents = read(tmp_path, "part.glb", mesh_files.glb(header, blob) + b"\0\0")
    assert len(contents.geometries) == 2 and len(contents.geometries[0].faces) == 12
    assert contents.notes[:6] == (
        "2 bytes after its end were ignored",
        "points and lines were ignored: they enclose nothing",
        "it holds several scenes, the default one was read",
        "its animations were not applied",
        "its morph targets were not applied, the meshes are in their basic shape",
        "its skins were not applied, the meshes are in their rest position",
    )


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
    """In the world everything stands where the file says; the pose is rigid, and faces look outward."""
    document = mesh_files.gltf_document([[(VERTICES, FACES)]], [{"mesh": 0, **node}])
    (geometry,) = read(tmp_path, "part.glb", mesh_files.glb(*document)).geometries
    matrix = np.eye(4)
    if "matrix" in node:
        matrix = np.reshape(node["matrix"], (4, 4)).T
    else:
        turn = np.eye(3)[[2, 0, 1]] if "rotation" in node else np.eye(3)
        matrix[:3, :3] = turn * node["scale"]
        matrix[:3, 3] = node.get("translation", 0)
    points = np.float32(VERTICES).astype(np.float64)
    assert np.allclose(world(geometry), points @ matrix[:3, :3].T + matrix[:3, 3], rtol=1e-14, atol=1e-14)
    assert volume(geometry) == pytest.approx(abs(np.linalg.det(matrix[:3, :3])), rel=1e-6)


def test_rotation_in_single_precision_is_rigid_and_changes_no_vertex(tmp_path):
    angle = 0.3
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    document = mesh_files.gltf_document(
        [[(VERTICES, FACES)]], [{"mesh": 0, "matrix": [float(x) for x in np.float32(turn.T).ravel()]}]
    )
    (geometry,) = read(tmp_path, "part.glb", mesh_files.glb(*document)).geometries
    assert np.array_equal(geometry.vertices, np.float32(VERTICES).astype(np.float64))
    assert np.allclose(geometry.pose.rotation, turn[:3, :3], atol=1e-7)


def test_primitive_without_indices_takes_vertices_three_by_three(tmp_path):
    header, blob = mesh_files.gltf_document(
        [[(VERTICES[FACES.ravel()], FACES), (VERTICES, [])]], [{"mesh": 0}]
    )
    del header["meshes"][0]["primitives"][0]["indices"]
    (geometry,) = read(tmp_path, "part.glb", mesh_files.glb(header, blob)).geometries
    assert np.array_equal(geometry.faces, np.arange(36).reshape(12, 3))


def test_triangle_strip_is_read(tmp_path):
    square = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
    header, blob = mesh_files.gltf_document([[(square, [0, 1, 2, 3])]], [{"mesh": 0}])
    header["meshes"][0]["primitives"][0]["mode"] = 5
    (geometry,) = read(tmp_path, "part.glb", mesh_files.glb(header, blob)).geometries
    assert geometry.source_faces.tolist() == [0, 1]
    a, b, c = geometry.vertices[geometry.faces].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


# 3MF


@pytest.mark.parametrize(
    ("unit", "name", "metres"),
    [
        ("", "mm", 0.001),
        (' unit="inch"', "in", 0.0254),
        (' unit="micron"', "um", 1e-6),
        (' unit="meter"', "m", 1.0),
    ],
)
def test_3mf_declares_its_unit_and_places_its_objects(tmp_path, unit, name, metres):
    items = [(1, IDENTITY_3MF), (1, "0 1 0 -1 0 0 0 0 1 5 6 7"), (2, "2 0 0 0 2 0 0 0 2 0 0 0")]
    model = mesh_files.threemf_model(
        {1: (VERTICES, FACES), 2: (VERTICES, FACES), 3: (VERTICES, FACES)}, items, unit
    )
    contents = read(tmp_path, "part.3mf", mesh_files.threemf(model), units="km")
    assert (contents.format, contents.units, contents.units_declared) == ("3MF", name, True)
    named = {geometry.name: geometry for geometry in contents.geometries}
    assert sorted(named) == ["part1", "part1_2", "part2"]
    first, turned, doubled = (named[name] for name in sorted(named))
    assert np.array_equal(first.vertices, VERTICES * metres)
    assert np.allclose(turned.pose.translation, np.array([5, 6, 7]) * metres, rtol=1e-15)
    assert np.allclose(turned.pose.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    assert np.array_equal(doubled.vertices, VERTICES * (2 * metres))
    assert "1 of its objects are not part of the build and were ignored" in contents.notes


def test_3mf_behind_a_large_picture_is_recognised(tmp_path):
    model = mesh_files.threemf_model({1: (VERTICES, FACES)}, [(1, IDENTITY_3MF)])
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("Metadata/thumbnail.png", bytes(100_000))
        archive.writestr("3D/3dmodel.model", model)
    assert len(read(tmp_path, "part.3mf", out.getvalue()).geometries) == 1


# STEP


@pytest.mark.parametrize(("unit", "metres"), [("mm", 0.001), ("m", 1.0), ("in", 0.0254)])
def test_step_declares_its_unit_and_triangles_know_their_cad_face(tmp_path, unit, metres):
    data = step_text.box_step((1, 2, 3), unit, name="lid").encode()
    contents = read(tmp_path, "part.step", data, units="km")
    assert (contents.format, contents.units, contents.units_declared) == ("STEP", unit, True)
    (geometry,) = contents.geometries
    assert geometry.name == "lid"
    assert volume(geometry) == pytest.approx(6 * metres**3, rel=1e-6)  # it comes in single precision
    assert np.bincount(geometry.source_faces).tolist() == [2] * 6
    assert contents.notes == (
        "curved faces are approximated within 0.01 mm by flat triangles: distances are exact to the "
        "triangles",
    )


def test_step_without_units_is_read_in_those_of_the_caller(tmp_path):
    contents = read(tmp_path, "part.stp", step_text.box_step((1, 2, 3), None).encode(), units="cm")
    assert (contents.units, contents.units_declared) == ("cm", False)
    assert contents.geometries[0].vertices.max() == pytest.approx(0.03, rel=1e-6)


def test_step_assembly_keeps_products_and_places(shared_data):
    contents = formats.read_geometries(shared_data / "cad" / "box_sides.STEP")
    names = [geometry.name for geometry in contents.geometries]
    assert names == [
        *("box_base", "side_long", "side_long_2", "side_short", "side_short_B"),
        *("gusset", "gusset_2", "gusset_3", "gusset_4", "box_top"),
    ]
    gussets = contents.geometries[5:9]
    assert all(gusset.vertices is gussets[0].vertices for gusset in gussets)
    corners = np.concatenate([world(geometry) for geometry in contents.geometries])
    assert np.allclose(np.ptp(corners, axis=0), [0.18415, 0.1143, 0.09525], atol=1e-6)  # inches in the file


def test_step_part_agrees_with_its_stl_twin(shared_data):
    step = formats.read_geometries(shared_data / "cad" / "featuretype.STEP").geometries[0]
    stl = formats.read_geometries(shared_data / "cad" / "featuretype.STL", units="in").geometries[0]
    assert np.allclose(step.vertices.min(axis=0), stl.vertices.min(axis=0), atol=1e-7)
    assert np.allclose(step.vertices.max(axis=0), stl.vertices.max(axis=0), atol=1e-7)
    assert volume(step) == pytest.approx(volume(stl), rel=2e-3)  # two tessellations


def test_finer_step_tolerance_gives_more_triangles(shared_data):
    path = shared_data / "cad" / "featuretype.STEP"
    coarse, fine = (
        len(formats.read_geometries(path, step_tolerance=tolerance).geometries[0].faces)
        for tolerance in (1e-3, 1e-5)
    )
    assert fine > coarse


# units


def test_unit_that_does_not_exist_is_refused_with_the_list():
    with pytest.raises(
        MeshError, match=r"there is no unit 'inch', expected one of m, dm, cm, mm, um, nm, km, in, ft"
    ):
        formats.metres_per_unit("inch")
    with pytest.raises(MeshError, match="there is no unit 5"):
        formats.read_geometries("part.stl", units=5)


@pytest.mark.parametrize("tolerance", [0.0, "fine"])
def test_tolerance_that_is_no_length_is_refused(tolerance):
    with pytest.raises(ArgumentError, match=r"step_tolerance is .*, expected a positive number of metres"):
        formats.read_geometries("part.step", step_tolerance=tolerance)
