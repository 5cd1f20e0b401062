"""``proximity clearance``: tables, two parts, limits with an exit code, CSV and JSON."""

import csv
import json

import mesh_files
import numpy as np
import pytest
import shapes
from manifold3d import Manifold
from project import MESHES, SHARED_DATA

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
    deepest = {(pair["first"], pair["second"]): pair["deepest"] for pair in pairs}
    assert deepest["base", "crossing"] == pytest.approx(2.0, rel=0.002)
    assert deepest["base", "core"] == pytest.approx(4.0, rel=0.002)
    assert deepest["base", "beside"] == 0.0
    assert [pair["deepest"] for pair in pairs if pair["is_clash"]] == [
        pytest.approx(depth, rel=0.002) for depth in (4.0, 2.0, 0.0, 0.0)[: sum(p["is_clash"] for p in pairs)]
    ]
    assert "way out [mm]" in run(cubes).out
    assert "way out [mm]" not in run(cubes, "beside").out
    assert "unknown: a part is open" in run(cubes).out


def test_two_parts_are_labelled_lines(run, cubes):
    assert run(cubes, "beside", "base").out.splitlines()[0] == "distance        2 mm, apart"
    assert run(cubes, "base", "core").out.splitlines() == [
        "distance        0 mm, second inside first",
        "from            -3  -1  -1 mm (base)",
        "to              -3  -1  -1 mm (core)",
        "overlap         8 mm³",
        "deepest         4 mm: no point of one is farther inside the other",
        "way out         4 mm along 1  0  0: then base is free",
    ]
    assert "distance        0.2 cm" in run(cubes, "beside", "base", "--units", "cm").out


def test_one_part_is_measured_against_the_others(run, cubes):
    lines = run(cubes, "beside").out.splitlines()
    assert len(lines) == 7 and all("beside" in line for line in lines[1:5])
    assert lines[5:] == ["4 pairs; 0 of them touch or overlap.", "No clash."]


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
    assert (listed.code, listed.out.splitlines()[-2]) == (1, "2 pairs of 6 are nearer than 4.5 mm.")
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
        (("beside", "base", "--below", 1), 0, "No pair of beside and base is nearer than 1 mm."),
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

    assert len(few.out.splitlines()) == 23
    assert "nearest 20 of 28 pairs; 0 of them touch or overlap; --all lists all.\n" in few.out
    assert len(all_of_them.out.splitlines()) == 31
    near = run(tmp_path / "row.prox", "--below", 1000)
    assert "28 pairs of 28 are nearer than 1000 mm; these are the first 20, --all lists all.\n" in near.out


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
    assert rows[0][11:] == ["depth_m", "direction_x", "direction_y", "direction_z", "deepest_m"]
    assert rows[1][11:] == ["0.0", "", "", "", "0.0"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("a", "b", "c"), "3 names are given, expected two at most"),
        (("base", "pin", "--all"), "two parts are one pair"),
        (("bolt",), "no part is named 'bolt'; the scene has 'base', 'lid', 'pin', 'pin_2'"),
        (("pin", "pin"), "'pin' is asked how far it is from itself, expected two parts"),
        (("--below", "-1"), "expected 0 to"),
        (("--ignore-touching",), "requires --below"),
        (("--allow", "wanted.csv"), "requires --clashes or --below"),
        (("--clashes", "--below", "1"), "--clashes is given as well"),
        (("bass",), "no part is named 'bass'; did you mean 'base'?"),
        (("--below", "1", "--allow", "absent.csv"), "absent.csv: cannot be read"),
        (("--below", "1", "--allow", str(ASSEMBLY)), "expected CSV with the columns first and second"),
    ],
)
def test_what_cannot_be_measured_is_told(words, sentence, run):
    result = run(ASSEMBLY, *words)
    assert result.code == 2
    assert sentence in result.words


# --- the gate against clashes ---


@pytest.fixture
def bolt(tmp_path, monkeypatch):
    """A bolt of 40 sides in a hole of 32 sides and the same radius, 5 mm, in a plate."""
    monkeypatch.chdir(tmp_path)
    hole = Manifold.cylinder(0.04, 5e-3, 5e-3, 32, True)
    solids = {
        "plate": Manifold.cube((0.04, 0.04, 0.01), True) - hole,
        "bolt": Manifold.cylinder(0.03, 5e-3, 5e-3, 40, True),
    }
    meshes = {name: solid.to_mesh64() for name, solid in solids.items()}
    Scene(
        [Solid(mesh.vert_properties, mesh.tri_verts.astype(int), name=name) for name, mesh in meshes.items()]
    ).save("bolt.prox")
    return "bolt.prox"


def test_a_bolt_fits_its_hole_within_the_approximation_and_clashes_below(run, bolt):
    deviation = 5.0 * (1.0 - np.cos(np.pi / 32))  # mm, of the hole's sides from the circle
    fits = run(bolt, "--clashes", "--contact", 0.03)
    assert (fits.code, fits.out) == (0, "No clash; 1 pair fits within 0.03 mm.\n")
    clash = run(bolt, "--clashes", "--contact", 0.001)
    assert clash.code == 1
    assert clash.out.splitlines()[-1].startswith("1 clash, plate and bolt: 0.02")
    pair = json.loads(run(bolt, "--json").out)["pairs"][0]
    assert pair["deepest_lower"] <= deviation * 1.001
    assert 0.5 * deviation <= pair["deepest"] <= deviation * 1.01
    assert pair["depth"] == pytest.approx(20.0, rel=0.02)  # the way out, along the axis


def test_clashes_are_the_deepest_first_and_alone(run, cubes):
    result = run(cubes, "--clashes")

    lines = result.out.splitlines()
    assert result.code == 1
    assert [line.split()[:2] for line in lines[1:3]] == [["base", "core"], ["base", "crossing"]]
    assert not any("beside" in line for line in lines)
    assert run(cubes, "beside", "--clashes").out == "No clash.\n"
    below = run(cubes, "--below", 0)
    assert (below.code, len(below.out.splitlines())) == (1, len(lines) + 1)


def test_patterns_name_parts_and_pairs_that_may_clash(run, cubes, tmp_path):
    assert len(json.loads(run(cubes, "b*", "--json").out)["pairs"]) == 7
    assert len(json.loads(run(cubes, "b*", "c*", "--json").out)["pairs"]) == 4
    allow = tmp_path / "allow.csv"
    allow.write_text("first,second\nbase,c*\n*,open\ncrossing,core\n")
    result = run(cubes, "--clashes", "--allow", allow)
    assert (result.code, result.out) == (0, "No clash.\n")
    allow.write_text("first,second\nbase,core\nbase,beside\n")
    result = run(cubes, "--clashes", "--allow", allow)
    assert result.code == 1
    assert f"1 pair of {allow} is no longer near" in result.err.replace("\n", " ")
    allow.write_text("first,second\nbase,core\nbase,crosing\n")
    refused = run(cubes, "--clashes", "--allow", allow)
    assert refused.code == 2
    assert "line 3: no part is named 'crosing'; did you mean 'crossing'?" in refused.words


@pytest.mark.parametrize(
    ("file", "count", "fits", "deepest"),
    [
        ("as1-oc-214.stp", 0, 22, 0.0),
        ("iris-box.step", 16, 10, 4.70),
        ("bracket-with-bolts.step", 2, 0, 1.42),
    ],
)
def test_assemblies_with_screws_have_their_clashes(file, count, fits, deepest, run):
    path = SHARED_DATA / "assemblies" / file
    if not path.is_file():
        pytest.skip(f"{path} is not here")
    found = json.loads(run(path, "--json", "--all").out)
    clashes = [pair for pair in found["pairs"] if pair["is_clash"]]

    assert len(clashes) == count
    assert max((pair["deepest"] for pair in clashes), default=0.0) == pytest.approx(deepest, rel=0.02)
    assert sum(pair["deepest_lower"] > 1e-5 for pair in found["pairs"] if not pair["is_clash"]) == fits
    assert all(pair["deepest"] < 0.0051 for pair in found["pairs"] if not pair["is_clash"])
    assert run(path, "--clashes").code == (1 if count else 0)
