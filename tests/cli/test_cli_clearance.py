"""``proximity clearance``: tables, two parts, limits with an exit code, CSV and JSON."""

import csv
import json

import mesh_files
import numpy as np
import pytest
import shapes
from project import MESHES

import proximity
from proximity import Pose, Scene, Solid

COMMAND = ("clearance",)
MIDDLE = (0.0, 0.0, 0.0)
ASSEMBLY = MESHES / "assembly.step"


@pytest.fixture
def cubes(tmp_path, monkeypatch):
    """Cubes: one of 10 mm, one that crosses it, one inside it, one 2 mm away, an open one across it."""
    monkeypatch.chdir(tmp_path)
    vertices, faces = shapes.cube(0.01, MIDDLE)
    scene = Scene(
        [
            Solid(vertices, faces, name="base"),
            Solid(vertices, faces, name="crossing"),
            Solid(*shapes.cube(0.002, MIDDLE), name="core"),
            Solid(vertices, faces, name="beside"),
            Solid(vertices, faces[:-1], name="open"),
        ]
    )
    places = [[0, 0, 0], [0.008, 0.001, 0.001], [-0.002, 0, 0], [0, 0.012, 0], [0.001, -0.009, 0.002]]
    scene.move_many([part.name for part in scene.parts], [Pose(None, place).matrix for place in places])
    scene.save("cubes.prox")
    return "cubes.prox"


def test_parts_of_several_files_are_measured_where_they_are(run, tmp_path):
    for name, middle in (("near", 0.012), ("far", 0.020)):
        vertices, faces = shapes.cube(0.01, (middle, 0.0, 0.0))
        (tmp_path / f"{name}.stl").write_bytes(mesh_files.stl_binary(1e3 * vertices, faces))
    vertices, faces = shapes.cube(0.01, MIDDLE)
    Scene([Solid(vertices, faces, name="base")]).save(tmp_path / "base.prox")
    files = [tmp_path / name for name in ("base.prox", "near.stl", "far.stl")]

    pairs = json.loads(run(*files, "base", "--json").out)["pairs"]

    assert [(pair["second"], round(pair["distance"], 4)) for pair in pairs] == [("near", 2.0), ("far", 10.0)]
    assert "no part is named 'none.stl'" in run(*files, "none.stl").words


def test_all_pairs_are_a_table_the_nearest_first(run):
    result = run(ASSEMBLY)

    lines = result.out.splitlines()
    assert (result.code, result.err) == (0, "")
    assert lines[0].split() == [
        "first", "second", "distance", "[mm]", "relation", "overlap", "[mm³]", "from", "[mm]", "to", "[mm]",
    ]  # fmt: skip
    assert lines[1].split()[:5] == ["lid", "pin", "0", "touching", "-"]
    assert lines[6].split()[:4] == ["pin", "pin_2", "38", "apart"]
    assert lines[7] == "6 pairs; 3 of them touch or overlap."


def test_parts_that_overlap_are_named_with_their_volume(run, cubes):
    pairs = json.loads(run(cubes, "--all", "--json").out)["pairs"]

    found = {(pair["first"], pair["second"]): (pair["relation"], pair["overlap"]) for pair in pairs}
    assert len(found) == 10
    assert found["base", "crossing"] == ("crossing", pytest.approx(2 * 9 * 9))
    assert found["base", "core"] == ("second inside first", pytest.approx(8.0))
    assert found["base", "beside"] == ("apart", 0.0)
    assert found["base", "open"] == ("crossing", None)
    deep = {(pair["first"], pair["second"]): (pair["depth"], pair["direction"]) for pair in pairs}
    assert deep["base", "crossing"] == (pytest.approx(2.0, rel=0.01), [-1.0, 0.0, 0.0])
    assert deep["base", "beside"] == (0.0, None)
    assert "depth [mm]" in run(cubes).out
    assert "depth [mm]" not in run(cubes, "beside").out
    assert "unknown: a part is open" in run(cubes).out


def test_two_parts_are_labelled_lines(run, cubes):
    assert run(cubes, "beside", "base").out.splitlines()[0] == "distance        2 mm, apart"
    assert run(cubes, "base", "core").out.splitlines() == [
        "distance        0 mm, second inside first",
        "from            -3  -1  -1 mm (base)",
        "to              -3  -1  -1 mm (core)",
        "overlap         8 mm³",
        "depth           4 mm: moved by it along 1  0  0, base is free",
    ]
    assert "distance        0.2 cm" in run(cubes, "beside", "base", "--units", "cm").out


def test_one_part_is_measured_against_the_others(run, cubes):
    lines = run(cubes, "beside").out.splitlines()

    assert len(lines) == 6 and all("beside" in line for line in lines[1:5])
    assert lines[5] == "4 pairs; 0 of them touch or overlap."


def test_gaps_and_depths_up_to_contact_are_touching(run):
    def relations(*words):
        pairs = json.loads(run(ASSEMBLY, "--json", *words).out)["pairs"]
        return {(pair["first"], pair["second"]): pair["relation"] for pair in pairs}

    assert relations()["base", "lid"] == "touching"
    assert relations("--contact", 0)["base", "lid"] == "apart"
    assert relations("--contact", 4.1)["base", "pin"] == "touching"


def test_pairs_that_are_meant_to_be_near_do_not_fail_a_build(run, cubes, tmp_path):
    gate = (ASSEMBLY, "--below", 4.5)
    assert run(*gate).code == 1
    listed = run(*gate, "--ignore-touching", "--csv", tmp_path / "wanted.csv")
    assert (listed.code, listed.out.splitlines()[-1]) == (1, "2 pairs of 6 are nearer than 4.5 mm.")
    assert run(*gate, "--ignore-touching", "--allow", tmp_path / "wanted.csv").code == 0
    (tmp_path / "turned.csv").write_text("second,first\nbase,pin\n")
    assert "pin_2" in run(*gate, "--ignore-touching", "--allow", tmp_path / "turned.csv").out
    # Parts that cross or contain each other are no contacts.
    assert run(cubes, "base", "core", "--below", 1, "--ignore-touching").code == 1


def test_equal_parts_at_one_place_are_no_contact(run, tmp_path):
    vertices, faces = shapes.cube(0.01, MIDDLE)
    Scene([Solid(vertices, faces, name="a"), Solid(vertices, faces, name="b")]).save(tmp_path / "same.prox")

    assert run(tmp_path / "same.prox", "--below", 1, "--ignore-touching").code == 1


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (("beside", "--below", 2.5), 1, "2 pairs of 4 are nearer than 2.5 mm."),
        (("beside", "--below", 0.5), 0, "No pair of beside and another part is nearer than 0.5 mm."),
        (("beside", "base", "--below", 1), 0, "beside and base are not nearer than 1 mm."),
        (("beside", "base", "--below", 3), 1, "distance        2 mm, apart"),
        (("--below", 1e-9), 1, "pairs of 10 are nearer than 1e-09 mm."),
    ],
)
def test_exit_code_tells_whether_something_is_too_near(words, code, sentence, run, cubes):
    result = run(cubes, *words)

    assert result.code == code
    assert sentence in result.out


def test_twenty_pairs_are_shown_and_all_are_listed(run, tmp_path):
    scene = Scene([Solid(*shapes.cube(0.01, (0.02 * k, 0, 0)), name=f"p{k}") for k in range(8)])
    scene.save(tmp_path / "row.prox")

    few, all_of_them = run(tmp_path / "row.prox"), run(tmp_path / "row.prox", "--all")

    assert len(few.out.splitlines()) == 22
    assert few.out.endswith("nearest 20 of 28 pairs; 0 of them touch or overlap; --all lists all.\n")
    assert len(all_of_them.out.splitlines()) == 30
    near = run(tmp_path / "row.prox", "--below", 1000)
    assert near.out.endswith(
        "28 pairs of 28 are nearer than 1000 mm; these are the first 20, --all lists all.\n"
    )


def test_only_part_is_said_to_be_alone(run):
    result = run(MESHES / "bracket.stl")

    assert (result.code, result.out) == (0, "There is only one part, and no other to compare it with.\n")


def test_csv_has_all_digits_and_no_formulas(run, tmp_path):
    scene = Scene(
        [Solid(*shapes.cube(0.1, MIDDLE), name="=1+1"), Solid(*shapes.cube(0.1, (0.3, 0, 0)), name="b")]
    )
    scene.save(tmp_path / "two.prox")

    result = run(tmp_path / "two.prox", "--csv", tmp_path / "pairs.csv", "--units", "m")

    assert result.code == 0
    rows = list(csv.reader((tmp_path / "pairs.csv").read_text(encoding="utf-8").splitlines()))
    assert rows[0][:5] == ["first", "second", "distance_m", "relation", "overlap_m3"]
    assert rows[1][:2] == ["'=1+1", "b"]
    expected = proximity.load(tmp_path / "two.prox").clearance("=1+1", "b")
    assert float(rows[1][2]) == pytest.approx(expected.distance, abs=1e-15)
    np.testing.assert_allclose(np.array(rows[1][5:11], float)[::3], [0.05, 0.25], atol=1e-15)
    assert rows[0][11:] == ["depth_m", "direction_x", "direction_y", "direction_z"]
    assert rows[1][11:] == ["0.0", "", "", ""]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("a", "b", "c"), "3 names are given, expected two at most"),
        (("base", "pin", "--all"), "two parts are one pair"),
        (("bolt",), "no part is named 'bolt'; the scene has 'base', 'lid', 'pin', 'pin_2'"),
        (("pin", "pin"), "'pin' is asked how far it is from itself, expected two parts"),
        (("--below", "-1"), "expected 0 to"),
        (("--ignore-touching",), "requires --below"),
        (("--allow", "wanted.csv"), "requires --below"),
        (("--below", "1", "--allow", "absent.csv"), "absent.csv: cannot be read"),
        (("--below", "1", "--allow", str(ASSEMBLY)), "expected CSV with the columns first and second"),
    ],
)
def test_what_cannot_be_measured_is_told(words, sentence, run):
    result = run(ASSEMBLY, *words)

    assert result.code == 2
    assert sentence in result.words
