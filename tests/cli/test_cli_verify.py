"""``proximity verify``: output as recorded in ``texts``, exit codes, files for builds and people."""

import csv
import json
import re
import sys
from xml.etree import ElementTree

import pytest
import shapes
from pages import PAGES
from project import MESHES
from requirement_files import requirement, save_cubes, write_file

from proximity import Scene, Solid

COMMAND = ("verify",)
NEAR = 'between = ["base", "near"]\n'
HOLDS = requirement(NEAR + "gap = { least = 1.5, greatest = 2.5 }", "near clears base")
VIOLATED = requirement("clash = { deepest = 0.5 }", "no part <clashes>")
UNDECIDED = requirement(NEAR + "along = [0, -1, 0]\ngap = { least = 1 }", "near drops")
MOTION = "motion = { slide = { direction = [0, 1, 0], end = 5 } }"
OPENS = requirement('between = ["near", "base"]\ngap = { least = 1 }\n' + MOTION, "near opens")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_cubes(tmp_path)
    write_file(tmp_path, HOLDS, VIOLATED, UNDECIDED, OPENS)
    write_file(tmp_path, HOLDS, name="good.toml")
    write_file(tmp_path, HOLDS, UNDECIDED, name="open.toml")
    write_file(tmp_path, HOLDS + "colour = 3\n", name="bad.toml")
    (tmp_path / "damaged.json").write_text("{")
    return tmp_path


TRANSCRIPT = """
fit.toml
good.toml
open.toml
bad.toml
none.toml
good.toml --write-receipt good.json
--receipt good.json
fit.toml --receipt good.json
--receipt damaged.json
--json
"""


def test_what_is_printed_is_as_recorded(transcript):
    transcript("verify", TRANSCRIPT)


@pytest.mark.parametrize(("file", "code"), [("good", 0), ("fit", 1), ("bad", 2), ("open", 3)])
@pytest.mark.parametrize("more", [(), ("--json",)])
def test_exit_code_is_the_worst_verdict(run, file, code, more):
    assert run(f"{file}.toml", *more).code == code


def test_json_and_csv_have_all_pairs_with_bounds_and_points(run, folder):
    result = run("fit.toml", "--json", "--csv", "pairs.csv")
    found = json.loads(result.out)
    assert result.code == 1 and found["verdict"] == "is violated"
    assert [each["verdict"] for each in found["requirements"]] == [
        "holds", "is violated", "cannot be decided", "holds",
    ]  # fmt: skip
    first = found["pairs"][0]
    assert (first["lower"], first["upper"], first["least"]) == (pytest.approx(2.0), pytest.approx(2.0), 1.5)
    assert (first["from"][1], first["to"][1]) == (5.0, 7.0)
    rows = list(csv.DictReader((folder / "pairs.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == len(found["pairs"]) == 1 + 6 + 1 + 1
    for row, pair in zip(rows, found["pairs"], strict=True):
        assert (row["requirement"], row["first"], row["verdict"]) == (
            pair["requirement"], pair["first"], pair["verdict"],
        )  # fmt: skip
        assert pair["lower"] is None or float(row["lower_mm"]) == pair["lower"]
    assert found["files"].keys() == {"fit.toml", str(folder / "cubes.prox")}


def test_junit_has_a_failure_and_an_error(run, folder):
    run("fit.toml", "--junit", "fit.xml")
    suite = ElementTree.parse(folder / "fit.xml").getroot()
    assert [suite.get(key) for key in ("tests", "failures", "errors")] == ["4", "1", "1"]
    cases = {case.get("name"): [each.tag for each in case] for case in suite}
    assert cases == {
        "near clears base": [], "no part <clashes>": ["failure"], "near drops": ["error"], "near opens": [],
    }  # fmt: skip
    assert all(float(case.get("time")) >= 0.0 for case in suite)
    (failure,) = suite.iter("failure")
    assert failure.get("message").startswith("depth of base and core: from 5 to 5 mm; greatest 0.5 mm")


def test_report_is_one_page_without_other_files(run, folder):
    pytest.importorskip("jinja2", reason="pages need jinja2: pip install cad-proximity[picture]")
    for file, outcome in (("good", "Passed"), ("fit", "Failed"), ("open", "Undecided")):
        run(f"{file}.toml", "--report", "page.html")
        page = (folder / "page.html").read_text(encoding="utf-8")
        assert f"<b>{outcome}.</b>" in page
    assert "<script" not in page and not re.findall(r"(?:src|href)=\"", page)
    run("fit.toml", "--report", "page.html")
    page = (folder / "page.html").read_text(encoding="utf-8")
    assert "no part &lt;clashes&gt;" in page and "<clashes>" not in page
    assert page.count('class="over"') >= 4 and page.count('class="held"') == 2


def test_report_without_its_library_is_refused_before_the_models_are_read(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    result = run("none.toml", "--report", "page.html")
    assert result.code == 2 and "is not installed" in result.err and "none.toml" not in result.err


def test_names_are_not_control_characters_or_formulas(run, folder):
    solids = [
        Solid(*shapes.cube(1.0, (2.0 * k, 0.0, 0.0)), name=name) for k, name in enumerate(("=1+1", "\x1b[2J"))
    ]
    Scene(solids).save(folder / "cubes.prox")
    write_file(folder, requirement('between = ["*", "*"]\ngap = { least = 2000 }', "@a\\u001b"))
    result = run("fit.toml", "--csv", "pairs.csv", "--junit", "fit.xml")
    assert "\x1b" not in result.out + (folder / "pairs.csv").read_text() + (folder / "fit.xml").read_text()
    assert (
        (folder / "pairs.csv")
        .read_text()
        .splitlines()[1]
        .startswith("'@a?,is violated,gap,2000.0,1000.0,1000.0,,0.0,'=1+1,")
    )
    ElementTree.parse(folder / "fit.xml")


def test_narrow_terminal_keeps_verdict_and_bounds(run, monkeypatch):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "70")
    monkeypatch.setenv("FORCE_COLOR", "1")
    result = run("good.toml")
    assert "holds" in result.words and result.code == 0


def test_file_in_the_guide_is_the_sample():
    assert (
        f"```toml\n{(MESHES / 'fit.toml').read_text(encoding='utf-8')}```" in PAGES["guide/requirements.md"]
    )
