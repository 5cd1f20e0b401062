"""Files from public reports, in a folder next to the project: read completely, or refused with advice."""

import numpy as np
import pytest

import proximity

# Number of notes for files of a box of 20 x 10 x 5 mm.
BOXES = {
    "obj_dollar_line.obj": 1, "obj_tag_t_vw.obj": 1, "off_face_over_lines.off": 0, "off_joined_header.off": 0,
    "ply_comments_in_body.ply": 0, "ply_split_rows.ply": 0, "ply_tristrips.ply": 0,
    "ply_vertex_index_extra_numbers.ply": 1, "stl_comments.stl": 0, "stl_ctrlz.stl": 0,
    "stl_end_solid.stl": 0, "stl_no_normal.stl": 1, "3mf_case_path.3mf": 0, "3mf_slice_required.3mf": 1,
    "3mf_support_object.3mf": 1, "3mf_two_roots.3mf": 0, "3mf_unbound_prefix_meta.3mf": 0,
    "gltf_sparse.gltf": 0, "gltf_quantized.gltf": 0, "gltf_wrong_min.gltf": 1, "gltf_zero_scale_node.gltf": 1,
    "gltf_data_uri_newlines.gltf": 0, "gltf_data_uri_no_padding.gltf": 0, "step_signature.step": 1,
    "step_trailing_blank.step": 1, "step_trailing_nul.step": 1, "step_unreferenced_shell.step": 2,
}  # fmt: skip
OTHERS = {  # faces and volume, mm³, of each part; bounds, mm; number of notes; hidden parts
    "3mf_nonprint_item.3mf": ([12, 12], [1000, 1000], [[0, 0, 0], [70, 10, 5]], 2, []),
    "3mf_prusa_negative.3mf": (None, [750], [[0, 0, 0], [20, 10, 5]], 1, []),
    "gltf_morph_weights.gltf": ([12], [1000], [[10, 0, 0], [30, 10, 5]], 1, []),
    "gltf_visibility.gltf": ([12, 12], [1000, 1000], [[0, 0, 0], [20, 10, 1005]], 1, [0]),
    "gltf_fan.gltf": ([2], [np.nan], [[0, 0, 0], [0, 10, 5]], 0, []),
}
FILES = {name: ([12], [1000], [[0, 0, 0], [20, 10, 5]], count, []) for name, count in BOXES.items()} | OTHERS


def in_own_process(name):
    """Test whether a library in a subprocess reads the file."""
    return name.endswith(".step") or name == "stl_no_normal.stl"


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.processes] * in_own_process(name)) for name in FILES],
)
def test_file_after_a_public_report_is_read_whole(shared_data, name):
    face_counts, volumes, bounds, note_count, hidden = FILES[name]
    if not (path := shared_data / "reports" / name).is_file():
        pytest.skip("the files after public reports are not here")
    scene = proximity.load(path)
    meshes = [part.solid.mesh for part in scene.parts]
    assert face_counts in (None, [mesh.face_count for mesh in meshes])
    found = [1e9 * part.solid.diagnosis.volume for part in scene.parts]
    assert found == pytest.approx(volumes, rel=1e-6, nan_ok=True)
    assert np.allclose(np.array(scene.bounds) * 1e3, bounds, rtol=0, atol=1e-5)
    assert len(scene.report.notes) == note_count
    assert [row for row, part in enumerate(scene.parts) if part.is_hidden] == hidden


def test_file_in_utf16_is_refused(shared_data):
    with pytest.raises(proximity.MeshFormatError, match="save it as UTF-8"):
        proximity.load(shared_data / "reports" / "obj_utf16.obj")


@pytest.mark.parametrize(
    ("name", "corners_mm"),
    [
        ("gltf_skin_node_moved", [[0, 0, 0], [20, 10, 5]]),
        ("gltf_turned_ball", [[-9.97669, -9.97669, -10], [9.97669, 9.97669, 10]]),
    ],
)
def test_skin_and_turned_ball_are_where_a_viewer_shows_them(shared_data, name, corners_mm):
    bounds = proximity.load(shared_data / "reports-2" / f"{name}.gltf").bounds
    assert np.allclose(np.array(bounds) * 1e3, corners_mm, atol=1e-4)


@pytest.mark.processes
@pytest.mark.parametrize(
    ("encoding", "names"), [("latin1", ["Gehäuse", "Pièce"]), ("gb18030", ["海绵座", "垫圈"])]
)
def test_names_keep_their_letters(shared_data, encoding, names):
    scene = proximity.load(shared_data / "reports-2" / f"step_names_{encoding}.step")
    assert [part.name for part in scene.parts] == names and "not UTF-8" in scene.report.notes[0]
