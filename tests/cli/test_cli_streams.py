"""Points answered while they are read: answers before an invalid line, names, and notes on units."""

import csv
import io
import itertools
import json
import sys

import mesh_files
import numpy as np
import pytest
import shapes
from fake_scene import FakeScene

import proximity
from proximity import cli
from proximity.cli.parts import query


@pytest.fixture
def ball(monkeypatch):
    """Replace every file by a ball of 20 mm."""
    fakes = {"load": lambda path, *, units, **options: FakeScene(), "kernels_are_cached": lambda: True}
    for name, value in fakes.items():
        monkeypatch.setitem(vars(proximity), name, value)


BAD = "0 0 11\n0 0 12\n0 0 13\n0 0\n0 0 14\n"
COMPLAINT = "proximity: standard input, line 4: 2 values, expected 3\n"


def test_answers_before_a_bad_line_are_written_as_csv(ball, run, monkeypatch):
    # Regression: none.
    monkeypatch.setattr(query, "POINTS_PER_CHUNK", 2)

    result = run("query", "ball.stl", "--points", "-", "--csv", "-", stdin=BAD)

    rows = list(csv.DictReader(io.StringIO(result.out)))
    assert [row["signed_distance_mm"] for row in rows] == ["1.0", "2.0", "3.0"]
    assert (result.code, result.err) == (2, COMPLAINT)


def test_segments_before_one_without_an_end_are_answered(ball, run, monkeypatch):
    monkeypatch.setattr(query, "POINTS_PER_CHUNK", 1)
    stdin = "0 0 12\n0 0 30\n" * 2 + "0 0 40\n"

    result = run("query", "ball.stl", "--points", "-", "--segment", "--csv", "-", stdin=stdin)

    assert [row["distance_mm"] for row in csv.DictReader(io.StringIO(result.out))] == ["2.0", "2.0"]
    assert result.code == 2
    assert result.err == "proximity: points are taken in pairs (start, end), but there are 5\n"


def test_error_of_the_scene_before_any_answer_leaves_no_half_document(ball, run, monkeypatch):
    # Regression: an unterminated document.
    def refuse(self, origins, directions, *, workers=1):
        raise proximity.ArgumentError("direction 0 has no length")

    monkeypatch.setattr(FakeScene, "cast", refuse)

    result = run("query", "ball.stl", 0, 0, 0, "--ray", 0, 0, 0, "--json")

    assert (result.code, result.out, result.err) == (2, "", "proximity: direction 0 has no length\n")


def test_stream_without_an_end_is_answered_as_it_comes(ball, run, monkeypatch):
    """At most two chunks are read ahead of the output."""
    monkeypatch.setattr(query, "POINTS_PER_CHUNK", 10)
    read = itertools.count()

    class Endless(io.StringIO):
        def readline(self, size=-1):
            assert next(read) < 50, "read on, and nothing was written"
            return "0 0 11\n"

    class Enough(Exception):
        pass

    def write(question, stream, chunks):
        for _, chunk in zip(range(3), chunks, strict=False):
            assert chunk["signed_distance"] == [1.0] * 10
        raise Enough

    monkeypatch.setattr("proximity.cli.parts.answers.write_csv", write)
    monkeypatch.setattr(sys, "argv", ["proximity", "query", "ball.stl", "--points", "-", "--csv", "-"])
    monkeypatch.setattr(sys, "stdin", Endless())

    with pytest.raises(Enough):
        cli.main()


NAMED = "name,x,y,z\nA1,0,0,11\nB2,0,0,12\n"


def test_own_csv_is_read_again_with_its_names_and_parts(ball, run, monkeypatch):
    scene = FakeScene(name="pin#2, left")
    monkeypatch.setitem(vars(proximity), "load", lambda path, **options: scene)
    written = run("query", "b.stl", "--points", "-", "--csv", "-", stdin=NAMED).out

    assert run("query", "b.stl", "--points", "-", "--csv", "-", stdin=written).out == written


def cube_of(size, tmp_path):
    path = tmp_path / "cube.stl"
    path.write_bytes(mesh_files.stl_ascii(*shapes.cube(size, (0.0, 0.0, 0.0))))
    return path


@pytest.mark.parametrize("units", ["mm", "in"])
def test_distances_to_a_cube_are_as_they_are_written(run, tmp_path, units):
    # Regression: 3.000000000000001 at -13 mm.
    path = cube_of(20.0, tmp_path)
    for x, distance in ((-13, 3.0), (-11, 1.0), (13.1, 3.1), (-10.7, 0.7), (-10, 0.0), (9, -1.0)):
        result = run("query", path, x, 0, 0, "--json", "--units", units)
        (answer,) = json.loads(result.out)["answers"]
        assert answer["signed_distance"] == distance


def test_query_and_check_name_the_likely_unit(run, tmp_path):
    path = cube_of(0.2, tmp_path)

    asked, checked = run("query", path, 0, 0, 1), run("check", path)
    asked_in_metres = run("query", path, 0, 0, 1, "--units", "m")

    assert asked.err.startswith("proximity: note: the part is 0.2 mm across: the file declares no unit")
    assert "the likely unit is m (metres)" in asked.err
    assert "\nnote            the part is 0.2 mm across: the file declares no unit" in checked.out
    assert asked_in_metres.err == ""


def test_size_of_the_whole_is_that_of_its_turned_parts(run, tmp_path):
    """The box around the boxes of the parts would be larger."""
    rod = shapes.cube(1.0)
    scaled = (rod[0] * [0.1, 0.002, 0.002], rod[1])
    half = np.sqrt(0.5)
    turned = {"mesh": 0, "name": "rod", "rotation": [0.0, 0.0, np.sin(np.pi / 8), np.cos(np.pi / 8)]}
    path = tmp_path / "rod.glb"
    path.write_bytes(mesh_files.glb(*mesh_files.gltf_document([[scaled]], [turned])))

    document = json.loads(run("check", path, "--json").out)

    assert document["size"] == pytest.approx([102 * half, 102 * half, 2.0], rel=1e-6)
    assert document["parts"][0]["size"] == pytest.approx([100.0, 2.0, 2.0], rel=1e-6)
