"""A scan against its part, and parts in the frame of a map."""

import json
import re
import sys

import mesh_files
import numpy as np
import pytest
import shapes

LOWER = [260_978_300.857938, 7_007_098_221.195780, 0.0]  # mm
VERTICES, FACES = shapes.box(LOWER, np.add(LOWER, [20.0, 10.0, 5.0]))


@pytest.fixture
def map_part(tmp_path):
    """A part of 20 mm, far from the origin."""
    path = tmp_path / "part.obj"
    path.write_bytes(mesh_files.obj(VERTICES, FACES))
    return path


def test_coordinates_of_a_map_are_printed_with_the_digits_that_their_size_needs(run, map_part):
    # Regression: from and to were both 2.60978e+08.
    out = run("check", map_part).out
    corners = [
        re.search(rf"^{label} +(\S+)  (\S+)  (\S+) mm$", out, re.MULTILINE) for label in ("from", "to")
    ]
    sizes = np.diff([[float(word) for word in corner.groups()] for corner in corners], axis=0)[0]
    assert np.allclose(sizes, [20, 10, 5], atol=1e-4)


def test_answers_in_the_frame_of_a_map_keep_thousandths(run, map_part):
    x, y, _ = np.add(LOWER, [10, 20, 0]).tolist()
    lines = run("query", map_part, f"{x:.6f}", f"{y:.6f}", 3).out
    assert f"{x:.4f}" in lines and f"{LOWER[1] + 10:.4f}" in lines
    table = run("query", map_part, f"{x:.6f}", f"{y:.6f}", 3, f"{x + 0.5:.6f}", f"{y:.6f}", 3).out
    assert f"{x:.4f}" in table and f"{x + 0.5:.4f}" in table


# Scans


@pytest.fixture
def plate(tmp_path):
    """A plate of 127 x 60 x 5 mm."""
    path = tmp_path / "plate.stl"
    path.write_bytes(mesh_files.stl_binary(*shapes.box([0.0, 0.0, 0.0], [127.0, 60.0, 5.0])))
    return path


def scan(tmp_path, points, name="scan.csv"):
    path = tmp_path / name
    path.write_text("".join(" ".join(map(repr, map(float, point))) + "\n" for point in points))
    return path


def top_of(lower, upper, offset=0.0, count=400):
    """Return points on or above a rectangle of the plate's top, mm."""
    rng = np.random.default_rng(3)
    return np.column_stack([rng.uniform(lower, upper, (count, 2)), np.full(count, 5.0 + offset)])


WHOLE = ((0.0, 0.0), (127.0, 60.0))


@pytest.mark.parametrize(
    ("unit", "metres", "word"),
    [("m", 1.0, "metres"), ("in", 0.0254, "inches"), ("um", 1e-6, "micrometres"), ("cm", 0.01, "cm")],
)
def test_scan_in_another_unit_is_recognised_by_its_size(run, tmp_path, plate, unit, metres, word):
    path = scan(tmp_path, top_of(*WHOLE) * 1e-3 / metres)
    size = re.escape(f"{126.7 * 1e-3 / metres:.3g}"[:3])
    sentence = (
        rf"the scan is {size}\S* mm across, the part 127 mm: is it in {word}\? give --points-units {unit}"
    )
    asked = ("query", plate, "--points", path)
    assert re.search(f"^proximity: note: {sentence}$", run(*asked).err.strip())
    gated = run(*asked, "--within", 1000.0)  # Regression: 0, as all is near the origin.
    assert (gated.code, gated.out) == (2, "") and re.search(f"^proximity: {sentence}$", gated.err.strip())
    assert run(*asked, "--points-units", unit, "--within", 0.001).code == 0
    trusted = run(*asked, "--points-units", "mm", "--within", 1e6)
    assert (trusted.code, trusted.err.count("scan")) == (0, 0)


@pytest.mark.parametrize("upper", [(127.0, 60.0), (60.0, 30.0), (12.7, 2.0), (5.0, 5.0)])
def test_scan_of_a_region_is_no_other_unit(run, tmp_path, plate, upper):
    result = run("query", plate, "--points", scan(tmp_path, top_of((0.0, 0.0), upper)), "--within", 0.1)
    assert (result.code, result.err) == (0, "")


@pytest.mark.parametrize("text", ["", "# nothing\n", "x,y,z\n", "1 nan nan\n"])
def test_scan_without_a_point_never_passes(run, tmp_path, plate, text):
    path = tmp_path / "scan.csv"
    path.write_text(text)
    for more in ((), ("--json",), ("--csv", tmp_path / "answers.csv")):
        result = run("query", plate, "--points", path, "--within", 0.1, *more)
        assert result.code == 2 and "contains no finite point to compare with --within" in result.err


def test_worst_point_has_its_number_and_place_and_the_share_is_never_rounded_up(run, tmp_path, plate):
    points = top_of(*WHOLE, offset=0.05, count=25_000)
    points[21_234] = [30.0, 20.0, 5.4]
    path = scan(tmp_path, points)
    result = run("query", plate, "--points", path, "--within", 0.1, "--csv", tmp_path / "answers.csv")
    assert result.code == 1
    line, worst = result.out.splitlines()
    assert line.endswith("; 99.9 % within ±0.1 mm, 1 farther.")
    assert worst == "The worst is #21234 at 30  20  5.4: 0.4 mm from plate."
    found = json.loads(run("query", plate, "--points", path, "--within", 0.5, "--json").out)["summary"]
    assert found["worst"]["row"] == 21_234 and found["worst"]["query"] == [30.0, 20.0, 5.4]
    assert found["worst"]["signed_distance"] == pytest.approx(0.4) and found["share_within"] == 1.0


def test_error_in_a_line_comes_after_the_answers_before_it(run, tmp_path, plate):
    path = scan(tmp_path, top_of(*WHOLE, count=25_000))
    path.write_text(path.read_text() + "1 2 three\n")
    result = run("query", plate, "--points", path)
    assert result.code == 2 and "line 25001: 'three' is not a number" in result.err
    assert result.out.count("\n") == 25_001


def test_normals_behind_points_are_read(run, tmp_path, plate):
    path = scan(
        tmp_path, np.column_stack([top_of(*WHOLE, count=3), np.tile([0.0, 0.0, 1.0], (3, 1))]), "scan.xyz"
    )
    result = run("query", plate, "--points", path, "--csv", "-")
    assert result.out.splitlines()[0].startswith("nx,ny,nz,x_mm,y_mm,z_mm,")
    assert run("query", plate, "--points", path, "--within", 0.001).code == 0


def test_scan_may_be_a_mesh(run, tmp_path, plate):
    vertices, faces = shapes.box([1.0, 1.0, 1.0], [126.0, 59.0, 4.0])
    for name, data in {
        "scan.stl": mesh_files.stl_binary(vertices, faces),
        "ascii.stl": mesh_files.stl_ascii(vertices, faces),
        "scan.obj": mesh_files.obj(vertices, faces),
        "cloud.obj": "".join("v {} {} {} 0.5 0.5 0.5\n".format(*point) for point in vertices).encode(),
        "scan.ply": mesh_files.ply_binary(vertices, faces),
    }.items():
        (tmp_path / name).write_bytes(data)
        found = json.loads(run("query", plate, "--points", tmp_path / name, "--json").out)
        rows = sorted(tuple(answer["query"]) for answer in found["answers"])
        assert rows == sorted(map(tuple, vertices.tolist())), name
        assert all(answer["signed_distance"] == pytest.approx(-1.0) for answer in found["answers"])


@pytest.mark.parametrize(("within", "verdict"), [(0.1, "Failed"), (0.5, "Passed")])
def test_report_is_one_page_with_verdict_picture_histogram_and_worst_points(
    run, tmp_path, plate, within, verdict
):
    pytest.importorskip("pyvista", reason="pictures need PyVista: pip install cad-proximity[picture]")
    points = top_of(*WHOLE, offset=0.05, count=500)
    points[:12, 2] = 5.2 + 0.01 * np.arange(12)
    path, page = scan(tmp_path, points, "scan <1>.csv"), tmp_path / "report.html"
    result = run("query", plate, "--points", path, "--within", within, "--report", page)
    assert result.code == (verdict == "Failed")

    text = page.read_text(encoding="utf-8")
    assert f"<b>{verdict}.</b> {'97.6' if within == 0.1 else '100.0'} % within ±{within:g} mm" in text
    assert "<title>scan &lt;1&gt;.csv against plate.stl</title>" in text and "<1>" not in text
    assert text.count("<svg") == text.count('src="data:image/png;base64,') == 1
    assert re.findall(r"<td>#(\d+)</td>", text) == [str(row) for row in range(11, 1, -1)]
    (policy,) = re.findall(r'"Content-Security-Policy" content="([^"]*)"', text)
    assert policy == "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
    assert "<script" not in text and not re.findall(r"(?:src|href)=\"(?!data:|#)", text)


def test_report_that_cannot_be_drawn_is_refused_before_the_scan_is_read(run, tmp_path, plate, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    monkeypatch.setitem(sys.modules, "jinja2", None)
    result = run("query", plate, "--points", "none.csv", "--within", 1, "--report", tmp_path / "report.html")
    assert result.code == 2 and "is not installed" in result.err and "none.csv" not in result.err


def test_picture_says_that_its_points_are_in_another_unit(run, tmp_path, plate):
    pytest.importorskip("pyvista", reason="pictures need PyVista: pip install cad-proximity[picture]")
    path = scan(tmp_path, top_of(*WHOLE, count=20) * 1e-3)
    asked = ("picture", plate, "--points", path, "-o", tmp_path / "plate.png", "--size", "640x360")
    assert "is it in metres? give --points-units m" in run(*asked).err
    assert run(*asked, "--points-units", "m", "--range", "-0.05,0.2").err == ""


@pytest.mark.parametrize("text", ["0", "-1", "nan", "0.2,0.1", "-0.1", "-0.2,-0.1", "1,2,3", "a", "-1,inf"])
def test_range_that_zero_is_not_in_is_refused(run, tmp_path, plate, text):
    path = scan(tmp_path, top_of(*WHOLE))
    result = run("picture", plate, "--points", path, "-o", tmp_path / "plate.png", "--range", text)
    assert result.code == 2 and "expected a length above 0, or two as in -0.05,0.2" in result.words
