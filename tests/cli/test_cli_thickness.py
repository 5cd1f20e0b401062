"""``proximity thickness``: text and exit codes as recorded in ``texts``; files that it writes."""

import csv
import json
import shutil

import mesh_files
import numpy as np
import pytest
import shapes
from project import MESHES
from thick_parts import covered_pocket, prism

import proximity
from proximity import Scene, Solid

COMMAND = ("thickness",)
TRANSCRIPT = """
plate.stl
plate.stl --below 1.5
plate.stl --below 1.6
plate.stl --below 0.16 --units cm
wedge.stl --below 1 --wall-angle 20
wedge.stl --below 3 --wall-angle 20 --json
pocket.stl --below 3.5
pocket.stl --below 3.5 --json
tetrahedron.stl --wall-angle 1
two.prox
two.prox --below 2
two.prox a --below 0.9
two.prox b* --below 2 --resolution 0.5
two.prox c --below 2
two.prox a --resolution 1e-6
open.stl --below 1
plate.stl --below 0
plate.stl --wall-angle 90
plate.stl --report page.html
plate.stl --below 1 --report page.png
none.stl
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A folder of parts, in mm."""
    monkeypatch.chdir(tmp_path)
    parts = {
        "plate": shapes.box((0, 0, 0), (10, 20, 1.5)),
        "wedge": prism(np.radians(30)),
        "pocket": covered_pocket(),
        "tetrahedron": shapes.tetrahedron(),
        "open": shapes.open_box(),
    }
    for name, mesh in parts.items():
        (tmp_path / f"{name}.stl").write_bytes(mesh_files.stl_binary(*mesh))
    row = [shapes.box((0, 0, 0), (5e-3, 5e-3, 1e-3)), shapes.box((0, 0, 0.01), (5e-3, 5e-3, 0.013))]
    Scene([Solid(*mesh, name=name) for name, mesh in zip(("a", "=b"), row, strict=True)]).save("two.prox")
    shutil.copy(MESHES / "plate.stl", tmp_path / "holes.stl")
    return tmp_path


def test_what_is_printed_is_as_recorded(transcript):
    transcript("thickness", TRANSCRIPT.replace("b*", "'*b'"))


def test_csv_has_the_thinnest_positions_and_no_formulas(run, folder):
    assert run("two.prox", "--below", "4", "--csv", "thin.csv").code == 1

    rows = list(csv.DictReader((folder / "thin.csv").read_text(encoding="utf-8").splitlines()))
    assert {row["part"] for row in rows} == {"a", "'=b"}
    for row in rows:
        point, opposite = (
            np.array([float(row[f"{end}{axis}_mm"]) for axis in "xyz"]) for end in ("", "opposite_")
        )
        assert np.linalg.norm(point - opposite) == pytest.approx(float(row["thickness_mm"]))
        assert float(row["thickness_mm"]) == pytest.approx(1.0 if row["part"] == "a" else 3.0)


def test_edge_of_a_wedge_has_no_thickness(run):
    result = run("wedge.stl", "--below", "1", "--json")
    (part,) = json.loads(result.out)["parts"]

    assert (result.code, part["lower"], part["is_thin"]) == (1, 0.0, True)
    assert part["least"] < 1e-5


def test_json_has_the_answers_of_the_library(run):
    (part,) = json.loads(run("holes.stl", "--below", "3", "--json").out)["parts"]

    found = proximity.load("holes.stl").parts[0].thin_places(below=0.003)
    assert part["least"] == pytest.approx(1e3 * found.upper) and part["is_thin"] is True
    assert part["share"] == pytest.approx(found.share)
    assert len(part["positions"]) == len(found.thickness)


@pytest.mark.parametrize(("below", "verdict"), [("1", "Passed"), ("1.6", "Failed")])
def test_report_is_one_page_with_a_picture(below, verdict, run, folder):
    for library in ("pyvista", "matplotlib", "jinja2"):
        pytest.importorskip(library, reason="reports need cad-proximity[picture]")
    run("plate.stl", "--below", below, "--report", "page.html")

    page = (folder / "page.html").read_text(encoding="utf-8")
    assert f"<b>{verdict}.</b>" in page and "data:image/png;base64," in page
    assert ("<td>1.5</td>" in page) == (verdict == "Failed")
