"""``proximity compile``, and compiled scenes as input of the other commands."""

import csv
import io
import json
import os
import sys

import numpy as np
import pytest
import shapes
from project import MESHES

import proximity


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    """Run the test in an empty folder."""
    monkeypatch.chdir(tmp_path)


def test_one_line_says_what_was_written(run, tmp_path):
    result = run("compile", MESHES / "assembly.glb", "--out", "cell.prox")

    size = (tmp_path / "cell.prox").stat().st_size
    assert (result.code, result.err) == (0, "")
    assert result.out == f"cell.prox: 4 parts, 1192 faces, {size} bytes\n"


SCENE_FILE = """
[[parts]]
file = "{0}/bracket.stl"
[[parts]]
file = "{0}/gear.stl"
position = [0.2, 0, 0]
[input]
poses = "shm://cell/poses"
"""


def test_several_files_are_one_scene(run):
    files = MESHES / "bracket.stl", MESHES / "gear.stl"

    result = run("compile", *files, MESHES / "gear.stl", "--out", "a.prox")

    scene = proximity.load("a.prox")
    assert (result.code, result.err) == (0, "")
    assert [part.name for part in scene.parts] == ["bracket", "gear", "gear#2"]
    assert scene.report.notes == ("parts of several files have one name; numbered: gear#2",)


def test_scene_file_is_compiled_with_parts_where_it_places_them(run, tmp_path):
    (tmp_path / "cell.toml").write_text(SCENE_FILE.format(MESHES))

    assert run("compile", "cell.toml").code == 0

    scene = proximity.load("cell.prox")
    assert [part.name for part in scene.parts] == ["bracket", "gear"]
    assert scene["gear"].pose.translation.tolist() == [0.2, 0.0, 0.0]
    assert scene.report.format == "scene file" and scene.report.path.endswith("cell.toml")
    listed = json.loads(run("check", "cell.toml", "--json").out)
    assert [part["name"] for part in listed["parts"]] == ["bracket", "gear"]


def test_lengths_of_a_file_with_a_wrong_unit_are_scaled(run):
    files = MESHES / "assembly.glb", "--scale", 0.5

    shown = json.loads(run("check", *files, "--json").out)

    whole = json.loads(run("check", MESHES / "assembly.glb", "--json").out)
    assert np.allclose(shown["size"], 0.5 * np.array(whole["size"]))
    assert shown["notes"][-1] == "all lengths are multiplied by 0.5, as was asked for"
    run("compile", MESHES / "assembly.glb", "--out", "cell.prox")
    assert "a compiled scene is not scaled" in run("check", "cell.prox", "--scale", 0.5).words


@pytest.mark.parametrize("options", [("--json",), ("--ray", 0, 0, -1)])
def test_compiled_scene_answers_as_its_file(options, run):
    run("compile", MESHES / "assembly.glb", "--out", "cell.prox")

    compiled = run("query", "cell.prox", 30, 20, 7.5, *options)

    assert compiled.code == 0
    asked = run("query", MESHES / "assembly.glb", 30, 20, 7.5, *options)
    assert compiled.out == asked.out.replace(str(MESHES / "assembly.glb"), "cell.prox")


def test_check_says_what_the_scene_was_compiled_from(run):
    run("compile", MESHES / "bracket.stl", "--out", "cell.prox", "--units", "cm")
    shown = run("check", "cell.prox").out.splitlines()
    assert shown[:4] == [
        "file            cell.prox",
        f"compiled from   {MESHES / 'bracket.stl'}",
        "format          STL binary",
        "units of file   cm (assumed: the file declares none)",
    ]


def test_check_as_json_is_that_of_the_file(run):
    run("compile", MESHES / "assembly.glb", "--out", "cell.prox")

    compiled = json.loads(run("check", "cell.prox", "--json").out)
    direct = json.loads(run("check", MESHES / "assembly.glb", "--json").out)

    assert compiled.pop("compiled_from") == str(MESHES / "assembly.glb")
    assert direct.pop("compiled_from") is None
    assert {**compiled, "file": direct["file"]} == direct


def test_compiled_scene_is_compiled_again(run, tmp_path):
    run("compile", MESHES / "assembly.glb", "--out", "a.prox")
    assert run("compile", "a.prox", "--out", "b.prox").code == 0
    assert (tmp_path / "a.prox").read_bytes() == (tmp_path / "b.prox").read_bytes()


def test_damaged_scene_is_one_line(run, tmp_path):
    run("compile", MESHES / "box.stl", "--out", "box.prox")
    data = (tmp_path / "box.prox").read_bytes()
    (tmp_path / "box.prox").write_bytes(data[:-1])

    for words in ("query box.prox 0 0 0", "check box.prox", "compile box.prox --out b.prox"):
        result = run(*words.split())
        assert (result.code, result.out) == (2, "")
        assert result.err == (
            f"proximity: box.prox: it is cut off after {len(data) - 1} of {len(data)} bytes; "
            "save the scene again with this version\n"
        )


def test_units_of_a_file_that_declares_none_are_taken(run):
    run("compile", MESHES / "box.stl", "--out", "box.prox", "--units", "in")
    (answer,) = json.loads(run("query", "box.prox", 43, 0, 0, "--units", "in", "--json").out)["answers"]
    assert answer["signed_distance"] == pytest.approx(3.0, rel=1e-12)


@pytest.mark.parametrize("link", [None, os.symlink, os.link])
def test_file_is_never_written_over_itself(link, run, tmp_path):
    source, out = tmp_path / "a.prox", tmp_path / "b.prox"
    source.write_bytes((MESHES / "box.stl").read_bytes())
    if link is None:
        out = tmp_path / "." / "sub" / ".." / "a.prox"
        (tmp_path / "sub").mkdir()
    else:
        link(source, out)
    before = source.stat()

    result = run("compile", source, "--out", out)

    assert (result.code, result.out) == (2, "")
    assert "itself, expected another file" in " ".join(result.err.replace("│", " ").split())
    assert source.stat().st_mtime_ns == before.st_mtime_ns and source.stat().st_nlink == before.st_nlink
    assert out.is_symlink() == (link is os.symlink)


def test_a_part_named_as_a_formula_is_text_in_a_spreadsheet(run):
    """Regression: a part named =HYPERLINK(...) was a formula, and an escape sequence moved the cursor."""
    names = ['=HYPERLINK("http://x")', "+1\r\n@sum", "-2\x1b[2J", "a=b\u2028c"]
    cubes = [proximity.Solid(*shapes.cube(0.01, (row, 0, 0))) for row in range(4)]
    parts = [
        proximity.Part(name, cube, proximity.Pose(), np.arange(12))
        for name, cube in zip(names, cubes, strict=True)
    ]
    proximity.Scene(parts).save("cell.prox")
    points = "".join(f"{1000 * row} 0 0 @name\r\n" for row in range(4))

    result = run("query", "cell.prox", "--points", "-", "--csv", "-", stdin=f"x y z name\n{points}")

    rows = list(csv.DictReader(io.StringIO(result.out)))
    assert [row["part_name"] for row in rows] == ['\'=HYPERLINK("http://x")', "'+1??@sum", "'-2?[2J", "a=b?c"]
    assert {row["name"] for row in rows} == {"'@name"}
    assert [float(row["signed_distance_mm"]) for row in rows] == [-5.0] * 4  # numbers keep their sign


def test_slow_conversion_says_that_the_next_command_spares_it(run, monkeypatch, tmp_path):
    monkeypatch.setattr("proximity.cli.options.SLOW_S", -1.0)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("PROXIMITY_CACHE_DIR", str(tmp_path / "cache"))
    kept = "the triangles are stored, and the next command will not convert the file again"
    path = MESHES / "assembly.step"

    assert "opens immediately" in run("check", path, "--no-cache").err
    assert not (tmp_path / "cache").exists()
    assert kept in run("check", path).err
    assert "opens immediately" in run("check", path).err
