"""Unlikely sizes of parts, and the probable unit of a file."""

import mesh_files
import numpy as np
import pytest
import shapes

import proximity
from proximity.formats import UNITS, likely_unit, size_notes


@pytest.mark.parametrize(
    ("number", "units", "likely"),
    [
        (0.2286, "mm", "m"),  # nine inches, written in metres
        (1.0, "mm", "in"),  # one inch
        (30.0, "mm", "mm"), (60_000.0, "mm", "um"), (60.0, "m", "mm"), (0.3, "m", "m"), (3000.0, "in", "mm"),
        (40.0, "um", "mm"), (1e-9, "m", None), (0.0, "mm", None), (float("inf"), "m", None),
    ],
)  # fmt: skip
def test_likely_unit(number, units, likely):
    assert likely_unit(number * UNITS[units], units) == likely


@pytest.mark.parametrize(
    ("parts", "whole", "units", "is_declared", "note"),
    [
        ([("a", 0.05)], 0.05, "mm", False, None),
        ([("a", 0.0005), ("b", 50.0)], 50.0, "mm", False, None),
        ([("a", 0.002)], 0.002, "mm", True, None),
        ([("a", 0.005)], 0.005, "mm", False,
         "the whole is 5 mm across: the file declares no unit and was read in mm; "
         "the likely unit is in (inches), the whole is then 127 mm across"),
        ([("a", 0.0002286)], 0.0002286, "mm", False,
         "the part is 0.2286 mm across: the file declares no unit and was read in mm; "
         "the likely unit is m (metres), the whole is then 228.6 mm across"),
        ([("a", 0.1), ("chip", 0.0003)], 0.1, "mm", False,
         "part 'chip' is 0.3 mm across: the file declares no unit and was read in mm, "
         "which is the likely unit for the whole of 100 mm"),
        ([("a", 60.0), ("b", 80.0), ("c", 1.0)], 90.0, "m", True,
         "2 of 3 parts are more than 50 m across, the largest 'b' 80 m: the file declares m; the likely "
         "unit is mm (millimetres), the whole is then 90 mm across; "
         "if it was written in the wrong unit, load it with a scale of 0.001"),
        ([("a", 0.0001), ("b", 80.0)], 80.0, "in, mm", True,
         "part 'a' is 0.1 mm across and part 'b' is 80 m across: the file declares in; the likely unit is "
         "mm (millimetres), the whole is then 3.15 m across; "
         "if it was written in the wrong unit, load it with a scale of 0.0393701"),
        ([("a", 1e-12)], 1e-12, "m", True,
         "the part is 1e-09 mm across: the file declares m; no common unit makes the whole, "
         "1e-09 mm across, a likely size"),
    ],
)  # fmt: skip
def test_note_names_the_likely_unit(parts, whole, units, is_declared, note):
    assert size_notes(parts, whole, units, is_declared) == ([] if note is None else [note])


def test_file_in_metres_that_was_read_in_millimetres_is_noted(tmp_path):
    path = tmp_path / "cube.stl"
    path.write_bytes(mesh_files.stl_binary(*shapes.cube(0.2)))
    scene = proximity.load(path)
    (note,) = scene.report.notes
    assert "the likely unit is m (metres)" in note
    assert proximity.load(path, units="m").report.notes == ()
    np.testing.assert_allclose(scene.part_sizes, [[0.0002] * 3], rtol=1e-6)


def test_file_that_declares_the_wrong_unit_is_noted_and_so_is_what_was_compiled_of_it(tmp_path):
    cube = shapes.cube(100.0)
    path = tmp_path / "cube.glb"
    path.write_bytes(mesh_files.glb(*mesh_files.gltf_document([[cube]], [{"mesh": 0, "name": "cube"}])))
    likely = "the part is 100 m across: the file declares m; the likely unit is mm"
    for scene, begins in ((proximity.load(path), likely), (proximity.Scene.from_mesh(*cube), "")):
        scene.save(tmp_path / "cube.prox")
        (note,) = proximity.load(tmp_path / "cube.prox").report.notes
        assert note.startswith(begins) and "the likely unit is mm" in note
        assert scene.report is None or scene.report.notes == (note,)


def test_size_of_a_turned_part_is_that_in_its_own_frame():
    vertices, faces = shapes.cube(0.1)
    solid = proximity.Solid(vertices * [1.0, 2.0, 3.0], faces)
    turned = proximity.Pose(np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]), [1.0, 2.0, 3.0])
    rows = np.arange(len(faces), dtype=np.int32)
    scene = proximity.Scene([proximity.Part("block", solid, turned, rows)])
    np.testing.assert_allclose(scene.part_sizes, [[0.1, 0.2, 0.3]], rtol=1e-12)
