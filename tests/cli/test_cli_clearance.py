"""``proximity clearance``: tables, limits and clashes as recorded in ``texts``; numbers by formulas."""

import csv
import json
import shutil
from dataclasses import replace

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


def cubes():
    """Cubes: one of 10 mm, one that intersects it, one inside it, one 2 mm away, an open one across it."""
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
    return scene


def bolt():
    """A bolt of 40 sides in a hole of 32 sides and the same radius, 5 mm, in a plate."""
    hole = Manifold.cylinder(0.04, 5e-3, 5e-3, 32, True)
    solids = {
        "plate": Manifold.cube((0.04, 0.04, 0.01), True) - hole,
        "bolt": Manifold.cylinder(0.03, 5e-3, 5e-3, 40, True),
    }
    meshes = {name: solid.to_mesh64() for name, solid in solids.items()}
    return Scene(
        [Solid(mesh.vert_properties, mesh.tri_verts.astype(int), name=name) for name, mesh in meshes.items()]
    )


def cubes_named(*names, size=0.01, apart=0.0):
    """A row of equal cubes."""
    places = [(apart * k, 0.0, 0.0) for k in range(len(names))]
    return Scene([Solid(*shapes.cube(size, at), name=name) for name, at in zip(names, places, strict=True)])


SCENES = {
    "cubes": cubes,
    "bolt": bolt,
    "row": lambda: cubes_named(*(f"p{k}" for k in range(8)), apart=0.02),
    "same": lambda: cubes_named("a", "b"),
    "two": lambda: cubes_named("=1+1", "b", size=0.1, apart=0.3),
    "base": lambda: cubes_named("base"),
}
LISTS = {
    "pins.csv": "second,first\nbase,pin\n",
    "all.csv": "first,second\nbase,c*\n*,open\ncrossing,core\n",
    "poses.csv": "position,x,y,z,qx,qy,qz,qw\n0,0,30,0,0,0,0,1\n2.5,0,12,0,0,0,1,0\n",
    "same.csv": "position,x,y,z,qx,qy,qz,qw\n0,0,30,0,0,0,0,1\n0,0,12,0,0,0,0,2\n",
    "some.csv": "first,second\nbase,core\nbase,beside\n",
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A folder of scenes, parts and lists of pairs that may be close."""
    monkeypatch.chdir(tmp_path)
    for name, make in SCENES.items():
        make().save(f"{name}.prox")
    for name, text in LISTS.items():
        (tmp_path / name).write_text(text)
    for name in ("assembly.step", "bracket.stl"):
        shutil.copy(MESHES / name, tmp_path)
    return tmp_path


TRANSCRIPT = """
assembly.step
assembly.step --contact 0
assembly.step --contact 4.1
assembly.step --below 4.5
assembly.step --below 4.5 --ignore-touching --csv wanted.csv
assembly.step --below 4.5 --ignore-touching --allow wanted.csv
assembly.step --below 4.5 --ignore-touching --allow pins.csv
bracket.stl
cubes.prox
cubes.prox beside
cubes.prox beside base
cubes.prox beside base --units cm
cubes.prox base core
cubes.prox base core --below 1 --ignore-touching
same.prox --below 1 --ignore-touching
cubes.prox beside --below 2.5
cubes.prox beside --below 0.5
cubes.prox beside base --below 1
cubes.prox beside base --below 3
cubes.prox --below 1e-9
cubes.prox --below 0
cubes.prox --clashes
cubes.prox beside --clashes
cubes.prox b*
cubes.prox b* c*
cubes.prox --clashes --allow all.csv
cubes.prox --clashes --allow some.csv
bolt.prox --clashes --contact 0.03
bolt.prox --clashes --contact 0.001
cubes.prox beside base --slide 0,1,0 0..10
cubes.prox beside base --slide 1,0,0 -8..8 --below 1 --csv curve.csv --plot curve.svg
cubes.prox beside base --slide 1,0,0 -8..8 --below 3
cubes.prox beside base --slide 0,-2,0 0..10 --units cm
assembly.step lid base --hinge 0,40,12 1,0,0 1..110 --below 0.1 --json
cubes.prox beside base --poses poses.csv
cubes.prox beside base --poses same.csv
cubes.prox beside base --poses none.csv
cubes.prox beside --hinge 0,0 1,0,0 0..1
cubes.prox beside --slide 1,0,0 0-1
cubes.prox --slide 1,0,0 0..1
cubes.prox beside --slide 1,0,0 0..1 --poses poses.csv
cubes.prox beside --slide 1,0,0 0..1 --clashes
cubes.prox beside --plot curve.svg
cubes.prox beside --page motion.html
cubes.prox beside --slide 1,0,0 0..1 --page motion.svg
cubes.prox b* --slide 1,0,0 0..1
cubes.prox beside base --along -y
cubes.prox beside base --along 0,-1,0 --json
cubes.prox base beside --along z
cubes.prox crossing base --along -x
cubes.prox beside --along z
cubes.prox beside base --along w
"""


def test_what_is_printed_is_as_recorded(transcript):
    transcript("clearance", TRANSCRIPT)


@pytest.mark.parametrize(("units", "ends"), [("mm", "-8..8"), ("cm", "-0.8..0.8")])
def test_page_of_a_motion_has_its_curve_and_its_positions_in_millimetres(run, monkeypatch, units, ends):
    saved = []
    monkeypatch.setattr("proximity.web.motion_page.save_page", lambda *given: saved.append(given))

    result = run(
        "cubes.prox", "beside", "base", "--slide", "1,0,0", ends, "--units", units, "--page", "a.html"
    )

    ((path, contents),) = saved
    motion = json.loads(contents["welcome"])["motion"]
    assert result.code == 0 and str(path) == "a.html"
    assert (motion["part"], motion["nearest"], motion["others"]) == ("beside", "base", ["base"])
    assert (motion["unit"], motion["scale"]) == ("mm", 1e-3)
    assert motion["positions"][0] == pytest.approx(-0.008) and motion["positions"][-1] == pytest.approx(0.008)
    assert len(motion["distances"]) == len(motion["positions"]) == len(motion["bounds"]) + 1
    assert {"geometry", "scene"} <= contents.keys()


def pairs_of(run, *words):
    return json.loads(run(*words, "--json").out)["pairs"]


def test_parts_of_several_files_are_measured_where_they_are(run, folder):
    for name, middle in (("near", 0.012), ("far", 0.020)):
        vertices, faces = shapes.cube(0.01, (middle, 0.0, 0.0))
        (folder / f"{name}.stl").write_bytes(mesh_files.stl_binary(1e3 * vertices, faces))
    files = ("base.prox", "near.stl", "far.stl")

    pairs = pairs_of(run, *files, "base")
    assert [(pair["second"], round(pair["distance"], 4)) for pair in pairs] == [("near", 2.0), ("far", 10.0)]
    assert "no part is named 'none.stl'" in run(*files, "none.stl").words


def test_parts_that_overlap_have_the_volumes_and_depths_of_formulas(run):
    pairs = pairs_of(run, "cubes.prox", "--all")

    found = {(pair["first"], pair["second"]): pair for pair in pairs}
    assert len(found) == 10
    for second, relation, overlap, deepest in (
        ("crossing", "crossing", pytest.approx(2 * 9 * 9), 2.0),
        ("core", "second inside first", pytest.approx(8.0), 4.0),
        ("beside", "apart", 0.0, 0.0),
        ("open", "crossing", None, None),
    ):
        pair = found["base", second]
        assert (pair["relation"], pair["overlap"]) == (relation, overlap)
        assert deepest is None or pair["deepest"] == pytest.approx(deepest, rel=0.002)
    deep = found["base", "crossing"]
    assert (deep["depth"], deep["direction"]) == (pytest.approx(2.0, rel=0.01), [-1.0, 0.0, 0.0])
    assert (found["base", "beside"]["depth"], found["base", "beside"]["direction"]) == (0.0, None)
    assert [pair["deepest"] for pair in pairs if pair["is_clash"]] == [
        pytest.approx(depth, rel=0.002) for depth in (4.0, 2.0, 0.0, 0.0)[: sum(p["is_clash"] for p in pairs)]
    ]


def test_twenty_pairs_are_shown_and_all_are_listed(run):
    for options, count, words in (
        ((), 23, "nearest 20 of 28 pairs; 0 of them touch or overlap; --all lists all."),
        (("--all",), 31, "28 pairs; 0 of them touch or overlap."),
        (
            ("--below", 1000),
            23,
            "28 pairs of 28 are nearer than 1000 mm; these are the first 20, --all lists",
        ),
    ):
        lines = run("row.prox", *options).out.splitlines()
        assert len(lines) == count and words in lines[-2]


def test_csv_has_all_digits_and_no_formulas(run, folder):
    assert run("two.prox", "--csv", "pairs.csv", "--units", "m").code == 0

    rows = list(csv.reader((folder / "pairs.csv").read_text(encoding="utf-8").splitlines()))
    assert rows[0][:5] == ["first", "second", "distance_m", "relation", "overlap_m3"]
    assert rows[1][:2] == ["'=1+1", "b"]
    expected = proximity.load("two.prox").clearance("=1+1", "b")
    assert float(rows[1][2]) == pytest.approx(expected.distance, abs=1e-15)
    np.testing.assert_allclose(np.array(rows[1][5:11], float)[::3], [0.05, 0.25], atol=1e-15)
    assert rows[0][11:] == ["depth_m", "direction_x", "direction_y", "direction_z", "deepest_m"]
    assert rows[1][11:] == ["0.0", "", "", "", "0.0"]


def test_bounds_of_cad_surfaces_decide_what_may_be_nearer(run, folder):
    found = {(pair["first"], pair["second"]): pair for pair in pairs_of(run, "assembly.step", "--cad")}
    pair = found["base", "pin"]
    assert 0.0 < pair["deviation"] < 1e-3
    assert pair["lower"] == pytest.approx(pair["distance"] - pair["deviation"], abs=1e-9)
    assert pair["upper"] == pytest.approx(pair["distance"] + pair["deviation"], abs=1e-9)
    assert "lower" not in pairs_of(run, "assembly.step")[0]

    words = "assembly.step", "base", "pin", "--below", 4  # the triangles keep it, the lower bound does not
    assert run(*words).code == 0
    assert run(*words, "--cad").code == 1
    run("assembly.step", "--cad", "--csv", "bounds.csv")
    header = (folder / "bounds.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header.endswith("deepest_mm,lower_mm,upper_mm")
    clashes = run("assembly.step", "--clashes", "--cad", "--contact", 0)
    assert (clashes.code, clashes.out.splitlines()[-1][:8]) == (0, "No clash")


def test_pair_without_a_bound_is_listed_as_one_that_may_be_near(run, folder):
    scene = proximity.load("assembly.step")
    parts = [replace(part, deviation=np.inf, deviation_by_face=part.deviation_by_face + np.inf)
             if part.name == "pin" else part for part in scene.parts]  # fmt: skip
    Scene(parts).save(folder / "unknown.prox")

    assert run("unknown.prox", "pin", "pin_2", "--below", 1).code == 0
    answer = run("unknown.prox", "pin", "pin_2", "--below", 1, "--cad")
    assert answer.code == 1
    assert "0 to unknown mm" in answer.out
    assert "of 1 pair is not known" in run("unknown.prox", "pin", "pin_2").out


def test_a_bolt_in_its_hole_overlaps_by_the_approximation_of_the_circle(run):
    deviation = 5.0 * (1.0 - np.cos(np.pi / 32))  # mm, of the hole's sides from the circle
    (pair,) = pairs_of(run, "bolt.prox")
    assert pair["deepest_lower"] <= deviation * 1.001
    assert 0.5 * deviation <= pair["deepest"] <= deviation * 1.01
    assert pair["depth"] == pytest.approx(20.0, rel=0.02)  # along the axis


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
    pairs = pairs_of(run, path, "--all")
    clashes = [pair for pair in pairs if pair["is_clash"]]

    assert len(clashes) == count
    assert max((pair["deepest"] for pair in clashes), default=0.0) == pytest.approx(deepest, rel=0.02)
    assert sum(pair["deepest_lower"] > 1e-5 for pair in pairs if not pair["is_clash"]) == fits
    assert all(pair["deepest"] < 0.0051 for pair in pairs if not pair["is_clash"])
    assert run(path, "--clashes").code == (1 if count else 0)
